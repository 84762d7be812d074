"""Make faults by a rule in code that decides, one at a time: a test near it must fail, or the fault is listed with a reason.

    python -m tests.mutants --deciding            thresholds and comparisons of what decides "ok", "cannot", a cause or a spread
    python -m tests.mutants --sample 200 --seed 1 so many of all other mutants of those files

A fault is planted in a copy of the project. Only tests that ran its line are asked, the quickest first, of the files that `NEAR`
names; which lines a test runs is found once by tracing. `mutants_survived.toml` lists what survives: equivalent code, or a number
whose size is a matter of taste, each with its reason. A survivor that is not in the list ends the run with exit code 1.
"""

import argparse
import ast
import json
import os
import random
import re
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import accumulate
from pathlib import Path

from tests.test_mutations import ROOT, copy_project, run_tests

HANGS = 60  # [s] after which a test that waits for ever has seen the fault
SURVIVED = ROOT / "tests" / "mutants_survived.toml"
NEAR = {  # pattern of files -> the tests near them
    "judge.py": "test_scrutiny test_measurements_metrics test_conformance test_api",
    "runs/scrutiny.py": "test_scrutiny test_api",
    "advice/*.py": "test_recommend",
    "diagnosis/*.py": "test_diagnosis test_selftest",
    "sweep/*.py": "test_sweep",
    "atlas/*.py": "test_atlas",
    "releases/*.py": "test_releases",
    "bench/clock.py": "test_measurements_clock test_measurements_kernel test_search",
    "runs/blocks.py": "test_measurements_clock test_bench_survived",
    "bench/search.py": "test_search test_measurements_findings",
    "bench/conformance.py": "test_conformance",
    "bench/gate.py": "test_measurements_gate test_bench_check",
}
SIGNS = (
    "Lt <, GtE >=, LtE <=, Gt >, Eq ==, NotEq !=, In in, NotIn not in, Is is, IsNot is not, And and, Or or, Add +, Sub -, Mult *"
)
SIGN = dict(pair.split(" ", 1) for pair in f"{SIGNS}, Div /".split(", "))
PAIRS = "Lt GtE, LtE Gt, Eq NotEq, In NotIn, Is IsNot, And Or, Add Sub, Mult Div"
CALLS = "min max, fmin fmax, minimum maximum, any all"
OTHER = {a: b for pair in f"{PAIRS}, {CALLS}".split(", ") for a, b in (pair.split(), pair.split()[::-1])}


@dataclass(frozen=True)
class Mutant:
    """One fault: the characters [start, end) of a file become others.

    Attributes:
        deciding: whether it is a threshold (a number outside of functions) or a comparison.
        line: of the file, from 1; text: that line as it was; mutant: as it becomes.
    """

    file: str
    start: int
    end: int
    new: str
    deciding: bool
    line: int
    text: str
    mutant: str


def mutants_of(file: str, source: str) -> list[Mutant]:
    """Return all mutants of a file, in its order."""
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def offset(line: int | None, column: int | None) -> int:
        begin = starts[(line or 1) - 1]  # columns count bytes
        return begin + len(source[begin : starts[line or 1]].encode()[:column].decode())

    def span(node: ast.expr) -> tuple[int, int]:
        return offset(node.lineno, node.col_offset), offset(node.end_lineno, node.end_col_offset)

    def between(left: ast.expr, right: ast.expr, operator: ast.AST) -> Iterator[tuple[int, int, str]]:
        name, (_, start), (end, _) = type(operator).__name__, span(left), span(right)
        if name in OTHER and (at := source.find(SIGN[name], start, end)) >= 0:
            yield at, at + len(SIGN[name]), SIGN[OTHER[name]]

    def changes(node: ast.AST, within: bool) -> Iterator[tuple[int, int, str]]:
        match node:
            case ast.Compare(ops=[operator]):
                yield from between(node.left, node.comparators[0], operator)
            case ast.BoolOp(values=[first, second, *_]):
                yield from between(first, second, node.op)
            case ast.BinOp() if within:
                yield from between(node.left, node.right, node.op)
            case ast.UnaryOp(op=ast.Not()):
                start, _ = span(node)
                yield start, start + len("not "), ""
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in OTHER:
                _, end = span(node.func)
                yield end - len(name), end, OTHER[name]
            case ast.Call(func=ast.Attribute(attr="abs")):
                yield *span(node.func), ""
            case ast.Constant(value=bool()):
                yield *span(node), str(not node.value)
            case ast.Constant(value=int() | float()) if within:
                yield *span(node), repr(node.value + 1 if isinstance(node.value, int) else 2 * node.value or 1.0)
            case ast.Constant(value=int() | float()):
                for factor in (10, 0.1):
                    yield *span(node), repr(_scaled(node.value, factor))

    found: list[Mutant] = []

    def visit(node: ast.AST, within: bool) -> None:
        number = isinstance(node, ast.Constant) and not isinstance(node.value, bool) and not within
        for start, end, new in changes(node, within):
            line = source.count("\n", 0, start) + 1
            begin, stop = starts[line - 1], source.find("\n", end)
            text, mutant = source[begin:stop].strip(), (source[begin:start] + new + source[end:stop]).strip()
            found.append(Mutant(file, start, end, new, number or isinstance(node, ast.Compare), line, text, mutant))
        for child in ast.iter_child_nodes(node):
            if not (isinstance(node, ast.Subscript) and child is node.slice):  # an index that is off mostly crashes
                visit(child, within or isinstance(node, ast.FunctionDef))

    visit(ast.parse(source), False)
    return found


def _scaled(value: float, factor: float) -> float:
    """Return a threshold ten times as large or small; a whole number stays one and changes by one at least."""
    if isinstance(value, int):
        return max(value * 10, value + 1) if factor > 1 else min(value // 10, value - 1)
    return value * factor or factor


TRACER = """
import json, os, sys, time
import pytest

WATCHED = {os.path.abspath(x) for x in json.loads(os.environ["WATCHED"])}
lines, took = {}, {}


class Traced:
    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        seen, start = set(), time.process_time()

        def trace(frame, event, value):
            file = frame.f_code.co_filename
            if file not in WATCHED:
                return None
            seen.add((file, frame.f_lineno))
            return trace

        import threading
        sys.settrace(trace)
        threading.settrace(trace)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            threading.settrace(None)
            took[item.nodeid] = time.process_time() - start
            lines[item.nodeid] = [[os.path.relpath(file), line] for file, line in sorted(seen)]


code = pytest.main([*json.loads(os.environ["ARGUMENTS"])], plugins=[Traced()])
with open(os.environ["INTO"], "w") as file:
    json.dump({"lines": lines, "took": took}, file)
sys.exit(code)
"""


Ran = dict[tuple[str, int], list[str]]  # file and line -> the tests that ran it, quickest first


def trace_tests(copy: Path, files: Sequence[str], tests: Sequence[str]) -> tuple[Ran, dict[str, float]]:
    """Run the tests once and return which of them ran each line, and the seconds of each test."""
    into = copy / "traced.json"
    arguments = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not long", *tests]
    given = {"WATCHED": json.dumps(list(files)), "ARGUMENTS": json.dumps(arguments), "INTO": str(into)}
    where = os.environ | given | {"PYTHONPATH": str(copy)}
    subprocess.run([sys.executable, "-c", TRACER], cwd=copy, env=where, check=False, stdout=sys.stderr)
    found = json.loads(into.read_text(encoding="utf-8"))
    ran: Ran = {}
    for test in sorted(found["lines"], key=lambda x: found["took"][x]):
        for file, line in found["lines"][test]:
            ran.setdefault((file, line), []).append(test)
    return ran, found["took"]


def tests_near(files: Sequence[str]) -> list[str]:
    """Return the test files near some files."""
    names = [x for pattern, near in NEAR.items() if any(Path(file).match(pattern) for file in files) for x in near.split()]
    return [f"tests/{x}.py" for x in dict.fromkeys(names)]


def deciding_files() -> list[str]:
    """Return the files whose mutants are looked at."""
    found = [x for pattern in NEAR for x in sorted((ROOT / "gauss_bench").glob(pattern))]
    return [str(x.relative_to(ROOT)) for x in found if x.name != "__init__.py"]


def listed() -> dict[tuple[str, str, str], str]:
    """Return the reasons of known survivors by file, line and mutated line."""
    rows = tomllib.loads(SURVIVED.read_text(encoding="utf-8")).get("mutant", []) if SURVIVED.exists() else []
    return {(x["file"], x["text"], x["mutant"]): x["reason"] for x in rows}


def plant(mutants: Sequence[Mutant], most: float, copy: Path) -> Iterator[tuple[Mutant, str]]:
    """Yield each mutant with how it ended: "dies", "survives", or "no test runs it".

    Args:
        most: seconds of tests, as they took when sound, that are asked of one mutant.
    """
    files = sorted({x.file for x in mutants})
    ran, took = trace_tests(copy, files, tests_near(files))
    for mutant in mutants:
        asked = _affordable(_tests_of(mutant, ran), took, most)
        yield mutant, _outcome(copy, mutant, asked) if asked else "no test runs it"


def _tests_of(mutant: Mutant, ran: Ran) -> list[str]:
    """Return the tests that ran the line; of a number outside of functions those that ran a line which names it."""
    lines = [mutant.line]
    if names := re.findall(r"[A-Z_0-9]*[A-Z][A-Z_0-9]*", mutant.text.partition("=")[0]) if mutant.text[:1].isupper() else []:
        named = re.compile(rf"\b({'|'.join(names)})\b")
        source = (ROOT / mutant.file).read_text(encoding="utf-8").splitlines()
        lines = [number for number, line in enumerate(source, 1) if number != mutant.line and named.search(line)]
    found = [x for line in lines for x in ran.get((mutant.file, line), [])]
    return list(dict.fromkeys(found or (x for (file, _), tests in ran.items() if file == mutant.file for x in tests)))


def _affordable(tests: Sequence[str], took: Mapping[str, float], most: float) -> list[str]:
    """Return the quickest of the tests that take no more than `most` seconds together; one at least."""
    quickest = sorted(tests, key=lambda x: took[x])
    spent = accumulate(took[x] for x in quickest)
    return quickest[: max(1, sum(x <= most for x in spent))]


def _outcome(copy: Path, mutant: Mutant, tests: list[str]) -> str:
    path = copy / mutant.file
    sound = path.read_text(encoding="utf-8")
    path.write_text(sound[: mutant.start] + mutant.new + sound[mutant.end :], encoding="utf-8")
    try:
        code, _ = run_tests(copy, tests, HANGS)
    except subprocess.TimeoutExpired:
        code = None
    finally:
        path.write_text(sound, encoding="utf-8")
    return "survives" if code == 0 else "dies"  # a failure, a crash, or no end


def main() -> int:
    """Plant the chosen mutants, print the end of each, and return 1 if an unknown one survives."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--deciding", action="store_true", help="thresholds and comparisons")
    options.add_argument("--sample", type=int, default=0, metavar="N", help="so many of the others")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--file", action="append", default=[], metavar="FILE", help="of these files alone")
    options.add_argument("--most", type=float, default=20.0, metavar="S", help="seconds of tests for one mutant (default 20)")
    given = options.parse_args()
    files = given.file or deciding_files()
    every = [x for file in files for x in mutants_of(file, (ROOT / file).read_text(encoding="utf-8"))]
    others = [x for x in every if not x.deciding]
    chosen = [x for x in every if x.deciding] if given.deciding else []
    chosen += random.Random(given.seed).sample(others, min(given.sample, len(others)))
    known, lost, start = listed(), 0, time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        for count, (mutant, how) in enumerate(plant(chosen, given.most, copy_project(Path(folder))), 1):
            reason = known.get((mutant.file, mutant.text, mutant.mutant), "")
            lost += how != "dies" and not reason
            print(json.dumps({"how": how, "reason": reason} | asdict(mutant)), flush=True)
            print(f"{count}/{len(chosen)} {time.monotonic() - start:.0f} s, {lost} unknown survivors", file=sys.stderr, flush=True)
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
