"""What runs, sweeps, certificates and baselines left on disk, damaged by lot, and verbs that read it or go on with it."""

import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from tests.fuzz.driven import LATE, Ending, endings
from tests.fuzz.files import damage_bytes
from tests.fuzz.kills import written_by

WHOLE = "whole"
RUN = ("run", "four_bar", "--suite", "gate", "--no-costs", "--until", "0.02", "--steps", "0.01", "--engine", "gauss", "--jobs", "1")
SWEEP = ("sweep", "crank_slider", "--vary", "links.rod.mass=0.7:0.8:24", "--engine", "gauss", "--step", "0.01", "--until", "0.05")
MADE = ((*RUN, "--out", "run"), (*SWEEP, "--jobs", "1", "--out", "sweep"))
MADE += (("certify", "pendulum", "--until", "0.02", "--digits", "8", "--out", "certificate.npz"),)
MADE += (("check", "four_bar", "--engine", "gauss", "--baseline", "baseline.csv", "--accept", "new", "--jobs", "1"),)
ASKED = {  # what is damaged -> what is asked then, in a copy
    "run": (*(["report", "--out", "run", "--against", f"../{WHOLE}/run"],) * 4, ["report", "--out", "run"]),
    "sweep": (["sweep", *MADE[1][1:]],),
    "certificate.npz": (["verify", "certificate.npz", "--jobs", "1"],),
    "baseline.csv": (["check", "four_bar", "--engine", "gauss", "--baseline", "baseline.csv", "--jobs", "1"],),
    "run again": ([*MADE[0]],),
}
KINDS = ("run", "run", "run", "run again", "sweep", "sweep", "certificate.npz", "baseline.csv")


def made(folder: Path) -> None:
    """What is damaged later, sound."""
    (folder / WHOLE).mkdir(parents=True)
    for verb in MADE:
        command = [sys.executable, "-m", "gauss_bench", *verb]
        subprocess.run(command, check=True, capture_output=True, cwd=folder / WHOLE)


def damage(kind: str, whole: Path, copy: Path, rng: random.Random) -> None:
    """A copy in which one file is not as it was."""
    shutil.copytree(whole, copy)
    place = copy / kind.removesuffix(" again")
    path = rng.choice(sorted(x for x in place.rglob("*") if x.is_file())) if place.is_dir() else place
    content = path.read_bytes()
    path.unlink()
    match rng.randrange(12):
        case 0:
            return
        case 1:
            path.mkdir()
        case 2:
            path.symlink_to(path.name)
        case 3:
            path.write_bytes(b"")
        case 4:
            path.write_bytes(rng.choice(sorted(x for x in whole.rglob("*") if x.is_file())).read_bytes())
        case _:
            for _ in range(rng.choice((1, 1, 2, 4))):
                content = damage_bytes(content, rng)
            path.write_bytes(content)


def over_stored(seed: int, count: int, folder: Path, late: float = LATE) -> Iterator[tuple[int, Ending]]:
    """Number and ending of what is asked of each of `count` damaged things.

    What is gone on with, and says that all is well, has to be what it was before the damage.
    """
    made(folder)
    chances = [random.Random(f"stored {seed} {number}") for number in range(count)]
    kinds = [rng.choice(KINDS) for rng in chances]
    asked = [(list(rng.choice(ASKED[kind])), True) for rng, kind in zip(chances, kinds, strict=True)]

    def begin(i: int) -> None:
        copy = folder / f"damaged {i}"
        damage(kinds[i], folder / WHOLE, copy, chances[i])
        os.chdir(copy)

    for i, ending in enumerate(endings(asked, folder, late, begin)):
        copy, kind = folder / f"damaged {i}", kinds[i].removesuffix(" again")
        if ending.code == 0 and ending.arguments[0] == kind and written_by(copy / kind) != written_by(folder / WHOLE / kind):
            yield i, replace(ending, fault="went on, and is not what it was")
        else:
            yield i, ending
        shutil.rmtree(copy)
