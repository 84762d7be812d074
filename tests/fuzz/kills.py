"""Kill runs and sweeps at random moments and continue them: they must end with the same bytes as undisturbed ones.

In a round, the run in a folder is killed and started again until it ends, and is then started once more. Finished tasks must stay
in the journal, each task once, and no process may be left behind.
"""

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from gauss_bench.bench.journal import entry_of
from tests.faults import alive

VERB = [sys.executable, "-m", "gauss_bench"]
RUN = [*VERB, "run", "four_bar", "--suite", "gate", "--no-costs", "--until", "0.05", "--steps", "0.01,0.005"]
RUN += [x for name in ("gauss", "lagrange", "schur", "yuan_ge_eq16") for x in ("--engine", name)]
SWEEP = [*VERB, "sweep", "crank_slider", "--vary", "links.rod.mass=0.7:0.8:40", "--engine", "gauss"]
SWEEP += ["--step", "0.01", "--until", "0.2"]
SIGN, GONE = "SIGN_OF_KILLS", 20.0  # [s] until the workers of a killed run have ended
VERBS = {"run": RUN, "sweep": SWEEP}
MOMENTS = 0.25, 0.95  # of what the undisturbed run lasts
TORN = b'{"key": "torn'  # what a kill in the middle of a write leaves


def written_by(folder: Path) -> dict[Path, bytes]:
    """Return path -> content of all files of a run or sweep except its journal."""
    return {x.relative_to(folder): x.read_bytes() for x in folder.rglob("*") if x.is_file() and ".run" not in x.parts}


def undisturbed(verb: list[str], folder: Path) -> tuple[dict[Path, bytes], float]:
    """Return the files that a run with one worker writes, and its duration [s]."""
    began = time.monotonic()
    subprocess.run([*verb, "--jobs", "1", "--out", str(folder)], check=True, capture_output=True)
    return written_by(folder), time.monotonic() - began


def over_kills(
    seed: int, count: int, folder: Path, jobs: int = 2, names: Sequence[str] = ("run", "sweep", "run", "run")
) -> Iterator[tuple[int, str, str]]:
    """Yield number, word and sentence of each of `count` kills; a sentence says what was lost, doubled, changed or left.

    `names` of what is killed, a folder each, over and over.
    """
    chance, killed, at = random.Random(f"kills {seed}"), 0, 0
    whole = {name: undisturbed(verb, folder / name) for name, verb in VERBS.items() if name in names}
    while killed < count:
        name = names[at % len(names)]
        place, at = folder / f"{name} {at}", at + 1
        asked = [*VERBS[name], "--jobs", str(jobs), "--out", str(place)]
        known, ended = finished(place), False
        while killed < count and not ended:
            ended = not killed_once(asked, chance.uniform(*MOMENTS) * whole[name][1])
            before, known = known, finished(place)
            lost = [x for x in before if x not in known]
            faults = [f"{len(lost)} of {len(before)} finished ones are lost"] if lost else []
            faults += [f"process {pid} is left" for pid in left_of(place)]
            if not ended or faults:
                yield killed, f"{name} {'ended' if ended else 'killed'}, {'some' if known else 'none'} finished", "; ".join(faults)
            killed += not ended
        yield from ((killed, f"{name} in the end", x) for x in faults_of_the_end(asked, place, whole[name][0]))


def killed_once(asked: list[str], after: float) -> bool:
    """Tell whether the run was killed; otherwise it ended before."""
    process = subprocess.Popen(
        asked, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ | {SIGN: asked[-1]}, start_new_session=True
    )
    try:
        process.wait(after)
    except subprocess.TimeoutExpired:
        os.kill(process.pid, signal.SIGKILL)
        return process.wait() != 0
    return False


def left_of(place: Path) -> list[int]:
    """Return the processes of a killed run that do not end by themselves."""
    until = time.monotonic() + GONE
    while left := alive(f"{SIGN}={place}\0".encode()):
        if time.monotonic() > until:
            return left
        time.sleep(0.1)
    return []


def finished(place: Path) -> list[bytes]:
    """Return the finished tasks in a folder: whole lines of the journal, or part files with their content."""
    journal = place / ".run" / "journal.jsonl"
    if journal.exists():
        return journal.read_bytes().split(b"\n")[:-1]
    return [x.name.encode() + b" " + x.read_bytes() for x in sorted((place / "samples").glob("part-*.parquet"))]


def faults_of_the_end(asked: list[str], place: Path, whole: dict[Path, bytes]) -> Iterator[str]:
    """Yield what is wrong with a killed run that is continued to its end after a torn line."""
    journal = place / ".run" / "journal.jsonl"
    if asked[len(VERB)] == "run":
        journal.parent.mkdir(parents=True, exist_ok=True)
        with journal.open("ab") as file:
            file.write(TORN)
    before = finished(place)
    done = subprocess.run(asked, check=False, capture_output=True, text=True)
    if done.returncode:
        yield f"going on ends with {done.returncode}: {done.stderr[-300:]!r}"
    there = finished(place)
    if any(x not in there for x in before):
        yield "going on loses what was finished"
    if journal.exists():
        entries = [entry_of(line + b"\n") for line in there]
        keys = [x["key"] for x in entries if x]
        if not len(set(keys)) == len(keys) == len(entries):
            yield f"{len(entries)} lines of {len(set(keys))} tasks"
    found = written_by(place)
    different = sorted(str(x) for x in found.keys() | whole.keys() if found.get(x) != whole.get(x))
    if different:
        yield f"differs from the undisturbed one: {', '.join(different)}"
