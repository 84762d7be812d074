"""`python -m tests.fuzz`: hostile files and arguments, motions by lot, kills, calls, and properties of drawn linkages, at length.

Exits 1 where one of them ended as none may: with a fault, too late, or wrong and yet called ok.
"""

import argparse
import importlib
import os
import random
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
    options.add_argument("--first", type=int, default=0, metavar="K", help="number of the first file, list and what was stored")
    options.add_argument("--late", type=float, default=LATE, metavar="S", help="processor time until a refusal must be there")
    options.add_argument("--keep", type=Path, metavar="DIR", help="where files that broke something are kept")
    asked = options.parse_args()
    began, found = time.monotonic(), Counter[str]()
    bad: list[Ending | str] = []
    told = began

    def tell(kind: str, number: int, wanted: int) -> None:
        nonlocal told
        if time.monotonic() - told > OFTEN:
            told = time.monotonic()
            print(
                f"{kind} {number} of {wanted} after {told - began:.0f} s; {len(bad)} ended as none may", file=sys.stderr, flush=True
            )

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        warm(folder)
        for kind, wanted, stream in (
            ("file", asked.files, over_files(asked.seed, asked.first, asked.files, folder, asked.late)),
            ("list", asked.lists, over_lists(asked.seed, asked.first, asked.lists, folder, asked.late)),
            ("stored", asked.stored, over_stored(asked.seed, asked.first, asked.stored, folder / "stored", asked.late)),
        ):
            for number, ending in stream if wanted else ():
                tell(kind, number - asked.first, wanted)
                word = ending.fault or ("at work" if ending.at_work else f"exit {ending.code}")
                found[f"{kind}: {word}"] += 1
                if ending.fault:
                    bad.append(ending)
                    print(f"{kind} {number} {ending.fault} [{ending.seconds:.1f} s]: {ending.arguments!r:.300}")
                    print(f"    {ending.said!r:.700}", flush=True)
                    if kind == "file" and asked.keep:
                        keep(asked.keep, asked.seed, number)
        for kind, wanted, others in (
            ("motion", asked.motions, over_motions(asked.seed, asked.motions)),
            ("judged", asked.judged, over_judged(asked.seed, asked.judged)),
            ("sound", asked.sound, over_sound(asked.seed, asked.sound, folder)),
            ("kill", asked.kills, over_kills(asked.seed, asked.kills, folder)),
            ("call", asked.calls, over_calls(simulated(asked.seed), asked.calls)),
        ):
            for number, word, sentence in others if wanted else ():
                tell(kind, number % MOTIONS, wanted)
                found[f"{kind}: {word}"] += 1
                if sentence:
                    bad.append(sentence)
                    print(f"{kind} {number} {sentence}", flush=True)
    if asked.properties and over_properties(asked.seed, asked.properties):
        bad.append("a property does not hold")
    for word, count in sorted(found.items()):
        print(f"{count:7d}  {word}")
    print(f"{sum(found.values())} in {time.monotonic() - began:.0f} s; {len(bad)} ended as none may", file=sys.stderr)
    return 1 if bad else 0


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


def keep(folder: Path, seed: int, number: int) -> None:
    name, content = files.damaged_file(seed, number)
    at = folder / f"{seed}_{number}"
    at.mkdir(parents=True, exist_ok=True)
    (at / f"{name}.toml").write_bytes(content)


def over_files(seed: int, first: int, count: int, folder: Path, late: float = LATE) -> Iterator[tuple[int, Ending]]:
    """Number of the file and ending, of what is asked of each of `count` files: to be shown, and one thing more."""
    for begin in range(first, first + count, BATCH):
        numbers = range(begin, min(begin + BATCH, first + count))
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
            for left in (folder / f"f{number}").iterdir():
                left.unlink()


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


def over_lists(
    seed: int, first: int, count: int, folder: Path, late: float = LATE, only: Collection[str] = ()
) -> Iterator[tuple[int, Ending]]:
    """Number of the list and its ending; of these verbs alone where some are given."""
    place = folder / "lists"
    four_bar = built_in()["four_bar"].read_bytes()
    lists.places(place, four_bar)
    asked = [*islice(lists.hostile_lists(seed, only), first, first + count)]
    found = endings(asked, place, late, lambda i: lists.places(place, four_bar))
    return ((first + i, ending) for i, ending in enumerate(found))


if __name__ == "__main__":
    raise SystemExit(main())
