"""`python -m tests.fuzz`: try hostile files and arguments, random motions, kills, calls and properties at length.

It exits with 1 if anything ended with a fault or too late, or was wrong and yet called ok.
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
from tests.fuzz.driven import LATE, Ending, endings, run_list
from tests.fuzz.judged import over_judged
from tests.fuzz.kills import over_kills
from tests.fuzz.motions import over_motions

PROPERTIES = Path(__file__).parents[1] / "test_properties.py"
OFTEN = 30.0  # [s] between lines of progress
COUNTS = {
    "files": (2000, "damaged linkage files"),
    "lists": (500, "lists of arguments"),
    "motions": (200, "runs that are compared with other mechanics"),
    "kills": (10, "kills of runs and sweeps"),
    "calls": (500, "calls of simulate in one process"),
    "properties": (300, "linkages for each property"),
    "judged": (60, "motions with one thing wrong, judged"),
}


def main() -> int:
    options = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    for name, (usual, what) in COUNTS.items():
        options.add_argument(f"--{name}", type=int, default=usual, metavar="N", help=f"{what} (default {usual})")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--late", type=float, default=LATE, metavar="S", help="processor time until a refusal must be there")
    asked = options.parse_args()
    seed, begin, found, bad = asked.seed, time.monotonic(), Counter[str](), 0
    told = begin
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        warm(folder)
        streams = {
            "files": lambda count: in_words(over_files(seed, count, folder, asked.late)),
            "lists": lambda count: in_words(over_lists(seed, count, folder / "lists", asked.late)),
            "motions": lambda count: over_motions(seed, count),
            "judged": lambda count: over_judged(seed, count),
            "kills": lambda count: over_kills(seed, count, folder),
            "calls": lambda count: over_calls(simulated(seed), count),
        }
        for kind, stream in streams.items():
            wanted = getattr(asked, kind)
            for tried, (number, word, sentence) in enumerate(stream(wanted) if wanted else (), 1):
                found[f"{kind}: {word}"] += 1
                if sentence:
                    bad += 1
                    print(f"{kind} {number} {sentence}", flush=True)
                if time.monotonic() - told > OFTEN:
                    told = time.monotonic()
                    print(f"{kind} {tried} of {wanted} after {told - begin:.0f} s; {bad} bad", file=sys.stderr, flush=True)
    if asked.properties and over_properties(seed, asked.properties):
        bad += 1
    for word, count in sorted(found.items()):
        print(f"{count:7d}  {word}")
    print(f"{sum(found.values())} in {time.monotonic() - begin:.0f} s; {bad} bad", file=sys.stderr)
    return 1 if bad else 0


def in_words(stream: Iterator[tuple[int, Ending]]) -> Iterator[tuple[int, str, str]]:
    """Yield number, word, and a sentence if an ending is a fault."""
    for number, x in stream:
        word = x.fault or ("at work" if x.at_work else f"exit {x.code}")
        yield number, word, f"{x.fault} [{x.seconds:.1f} s]: {x.arguments!r:.300}\n    {x.said!r:.700}" if x.fault else ""


def over_properties(seed: int, count: int) -> bool:
    """Tell whether a property fails; pytest prints the smallest linkage for which it does."""
    print(f"properties: {count} linkages each, seed {seed}", flush=True)
    os.environ["PROPERTIES"] = str(count)
    return pytest.main([str(PROPERTIES), f"--hypothesis-seed={seed}", "-rA", "--tb=short", "--no-header"]) != pytest.ExitCode.OK


def warm(folder: Path) -> None:
    """Import what verbs import, so that forked processes need not."""
    importlib.import_module("sympy")
    run_list(["show", "four_bar"], folder)
    for room in ("api.exchange", "api.kinematics", "verbs.catalogue", "verbs.pictures", "verbs.searches", "verbs.suites"):
        importlib.import_module(f"gauss_bench.{room}")


def over_files(seed: int, count: int, folder: Path, late: float = LATE) -> Iterator[tuple[int, Ending]]:
    """Yield number and ending of two verbs on each of `count` damaged files: `show`, and another one."""
    for number in range(count):
        name, content = files.damaged_file(seed, number)
        place = folder / f"f{number}"
        place.mkdir()
        (place / f"{name}.toml").write_bytes(content)
        path = f"f{number}/{name}.toml"
        for ending in endings([(["show", path], False), more_of(path, random.Random(f"asked {seed} {number}"))], folder, late):
            yield number, ending
        shutil.rmtree(place)


def more_of(path: str, rng: random.Random) -> tuple[list[str], bool]:
    """Return a random list of arguments for a file, and whether it may take long."""
    short = ["simulate", path, "--at", "0.02", "--json"]
    kinds = ("mujoco", "pinocchio", "exudyn", "casadi", "c")
    return rng.choice(
        (
            *((short, False),) * 8,
            (["simulate", path, "--at", "0.02", "--engine", "minimal"], True),
            (["simulate", path], True),
            (["simulate", path, "--at", "0.02", "--plot", "p.svg", "--out", "p.csv", "--animate", "p.html", "--replace"], True),
            *((["kinematics", path, "--intervals", "20"], False),) * 5,
            (["kinematics", path, "--intervals", "20", "--method", "basic", "--json"], False),
            (["kinematics", path, "--driver", "constant", "--intervals", "20", "--animate", "k.svg", "--plot", "k2.svg"], False),
            (["show", path, "--svg", "s.svg", "--json"], False),
            *((["export", path, "--engine", rng.choice(kinds), "--out", "e.txt", "--replace"], True),) * 2,
            (["certify", path, "--until", "0.01", "--digits", "6"], True),
            (["import", path, "--out", "i.toml", "--replace"], False),
            (["recommend", path, "--position", "1e-3", "--until", "0.01", "--budget", "2", "--engine", "gauss"], True),
            (["diagnose", path, "--engine", "gauss", "--until", "0.01", "--budget", "2"], True),
        )
    )


def over_lists(seed: int, count: int, folder: Path, late: float = LATE, only: Collection[str] = ()) -> Iterator[tuple[int, Ending]]:
    """Yield number and ending of each of `count` random lists, of these verbs alone if some are given."""
    four_bar = built_in()["four_bar"].read_bytes()
    lists.places(folder, four_bar)
    asked = [*islice(lists.hostile_lists(seed, only), count)]
    return enumerate(endings(asked, folder, late, lambda i: lists.places(folder, four_bar)))


if __name__ == "__main__":
    raise SystemExit(main())
