"""`python -m tests.fuzz`: hostile files and arguments, motions by lot, kills, calls, and properties of drawn linkages, at length.

Exits 1 where one of them ended as none may: with a fault, too late, or wrong and yet called ok.
"""

import argparse
import importlib
import os
import random
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Collection, Iterator
from itertools import islice
from pathlib import Path

import pytest

from gauss_bench.linkage.load import built_in
from tests.fuzz import files, lists
from tests.fuzz.calls import over_calls, simulated
from tests.fuzz.driven import LATE, Ending, endings, run_one
from tests.fuzz.judged import over_judged
from tests.fuzz.kills import over_kills
from tests.fuzz.motions import MOTIONS, over_motions
from tests.fuzz.sound import over_sound
from tests.fuzz.stored import over_stored

PROPERTIES = Path(__file__).parents[1] / "test_properties.py"
BATCH = 500  # files that lie in the folder at a time
OFTEN = 30.0  # [s] between words on how far it is
COUNTS = {
    "files": (2000, "damaged linkage files"),
    "lists": (500, "lists of arguments"),
    "stored": (200, "damaged files of runs and sweeps"),
    "motions": (200, "runs held against other mechanics"),
    "kills": (10, "kills of runs and sweeps"),
    "calls": (500, "calls of simulate in one process"),
    "properties": (300, "linkages for each property"),
    "judged": (60, "motions with one thing wrong, judged"),
    "sound": (20, "sound motions of the gate, to be ok"),
}


def main() -> int:
    options = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    for name, (usual, what) in COUNTS.items():
        options.add_argument(f"--{name}", type=int, default=usual, metavar="N", help=f"{what} (default {usual})")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--late", type=float, default=LATE, metavar="S", help="processor time until a refusal must be there")
    asked = options.parse_args()
    seed, began, found, bad = asked.seed, time.monotonic(), Counter[str](), 0
    said = began
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        warm(folder)
        streams = {
            "files": lambda count: in_words(over_files(seed, count, folder, asked.late)),
            "lists": lambda count: in_words(over_lists(seed, count, folder, asked.late)),
            "stored": lambda count: in_words(over_stored(seed, count, folder / "stored", asked.late)),
            "motions": lambda count: over_motions(seed, count),
            "judged": lambda count: over_judged(seed, count),
            "sound": lambda count: over_sound(seed, count, folder),
            "kills": lambda count: over_kills(seed, count, folder),
            "calls": lambda count: over_calls(simulated(seed), count),
        }
        for kind, stream in streams.items():
            wanted = getattr(asked, kind)
            for number, word, sentence in stream(wanted) if wanted else ():
                found[f"{kind}: {word}"] += 1
                if sentence:
                    bad += 1
                    print(f"{kind} {number} {sentence}", flush=True)
                if time.monotonic() - said > OFTEN:
                    said = time.monotonic()
                    print(
                        f"{kind} {number % MOTIONS} of {wanted} after {said - began:.0f} s; {bad} bad", file=sys.stderr, flush=True
                    )
    if asked.properties and over_properties(seed, asked.properties):
        bad += 1
    for word, count in sorted(found.items()):
        print(f"{count:7d}  {word}")
    print(f"{sum(found.values())} in {time.monotonic() - began:.0f} s; {bad} ended as none may", file=sys.stderr)
    return 1 if bad else 0


def in_words(stream: Iterator[tuple[int, Ending]]) -> Iterator[tuple[int, str, str]]:
    """Number, word, and a sentence where an ending is a fault."""
    for number, x in stream:
        word = x.fault or ("at work" if x.at_work else f"exit {x.code}")
        yield number, word, f"{x.fault} [{x.seconds:.1f} s]: {x.arguments!r:.300}\n    {x.said!r:.700}" if x.fault else ""


def over_properties(seed: int, count: int) -> bool:
    """Whether one of the properties does not hold; its smallest linkage, and what brings it back, are printed."""
    print(f"properties: {count} linkages each, seed {seed}", flush=True)
    os.environ["PROPERTIES"] = str(count)
    return pytest.main([str(PROPERTIES), f"--hypothesis-seed={seed}", "-rA", "--tb=short", "--no-header"]) != pytest.ExitCode.OK


def warm(folder: Path) -> None:
    """Import what verbs import, once, before any process is forked: an import that is broken off leaves half a module."""
    importlib.import_module("sympy")
    said = [["show", "four_bar", "--svg", str(folder / "w.svg")], ["kinematics", "four_bar", "--intervals", "8"], ["list"]]
    for arguments in (
        *said,
        ["simulate", "four_bar", "--at", "0.01"],
        ["export", "four_bar", "--engine", "c", "--out", str(folder / "w.c")],
    ):
        run_one(arguments, 60.0)


def over_files(seed: int, count: int, folder: Path, late: float = LATE) -> Iterator[tuple[int, Ending]]:
    """Number of the file and ending, of what is asked of each of `count` files: to be shown, and one thing more."""
    for begin in range(0, count, BATCH):
        numbers = range(begin, min(begin + BATCH, count))
        asked: list[tuple[list[str], bool]] = []
        for number in numbers:
            name, content = files.damaged_file(seed, number)
            at = folder / f"f{number}"
            at.mkdir(exist_ok=True)
            (at / f"{name}.toml").write_bytes(content)
            path = f"f{number}/{name}.toml"
            asked += [(["show", path], False), more_of(path, random.Random(f"asked {seed} {number}"))]
        for i, ending in enumerate(endings(asked, folder, late)):
            yield numbers[i // 2], ending
        for number in numbers:
            shutil.rmtree(folder / f"f{number}")


def more_of(path: str, rng: random.Random) -> tuple[list[str], bool]:
    """What else is asked of a file, and whether it may take long."""
    short = ["simulate", path, "--at", "0.02", "--json"]
    kinds = ("mujoco", "pinocchio", "exudyn", "casadi", "c")
    return rng.choice(
        (
            *((short, False),) * 8,
            ([*short, "--engine", "lagrange"], False),
            (["simulate", path, "--at", "0.02", "--engine", "minimal"], True),
            (["simulate", path], True),
            (["simulate", path, "--at", "0.02", "--plot", "p.svg", "--out", "p.csv", "--animate", "p.html", "--replace"], True),
            *((["kinematics", path, "--intervals", "20"], False),) * 5,
            (["kinematics", path, "--intervals", "20", "--method", "basic", "--json"], False),
            (["kinematics", path, "--driver", "constant", "--intervals", "20", "--animate", "k.svg", "--plot", "k2.svg"], False),
            (["show", path, "--svg", "s.svg", "--json"], False),
            (["export", path, "--engine", rng.choice(kinds), "--out", "e.txt", "--replace"], True),
            (["export", path, "--engine", rng.choice(kinds), "--out", "e.txt", "--replace", "--json"], True),
            (["certify", path, "--until", "0.01", "--digits", "6"], True),
            (["import", path, "--out", "i.toml", "--replace"], False),
            (["recommend", path, "--position", "1e-3", "--until", "0.01", "--budget", "2", "--engine", "gauss"], True),
            (["diagnose", path, "--engine", "gauss", "--until", "0.01", "--budget", "2"], True),
        )
    )


def over_lists(seed: int, count: int, folder: Path, late: float = LATE, only: Collection[str] = ()) -> Iterator[tuple[int, Ending]]:
    """Number of the list and its ending; of these verbs alone where some are given."""
    place = folder / "lists"
    four_bar = built_in()["four_bar"].read_bytes()
    lists.places(place, four_bar)
    asked = [*islice(lists.hostile_lists(seed, only), count)]
    return enumerate(endings(asked, place, late, lambda i: lists.places(place, four_bar)))


if __name__ == "__main__":
    raise SystemExit(main())
