"""Plant faults in a copy of the package, one at a time: the test that is named for a fault must fail.

A measurement that no test guards can be wrong for years and look right. `mutations.toml` keeps what has been tried, so that a test
that goes blind is noticed. A mutation whose text is no longer in its file fails: it has to move with the code.
"""

import json
import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from gauss_bench.diagnosis.faults import TABLES

ROOT = Path(__file__).parents[1]
MUTATIONS = tomllib.loads((ROOT / "tests" / "mutations.toml").read_text(encoding="utf-8"))["mutation"]
KEYS = {"fault", "file", "text", "mutant", "test"}
NEEDED = ("gauss_bench", "tests", "mechanisms", "pyproject.toml")
LIMIT = 600  # [s] of one run of tests
SECOND = 10**9  # [ns]
SAMPLE = 7  # one mutation in so many is planted in every run of the slow tests
FAILED = 1  # pytest's exit code where tests ran and failed; anything else is no test's word


@pytest.fixture(scope="session")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package and its tests, in which faults are planted."""
    return copy_project(tmp_path_factory.mktemp("spoilt"))


def copy_project(folder: Path) -> Path:
    """Copy the project into a folder, and return it."""
    for name in NEEDED:
        (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, folder / name)
    return folder


SERVER = """
import ast, gc, importlib, json, os, pathlib, pkgutil, signal, sys
import hypothesis, matplotlib, mpmath, networkx, numpy, pandas, pyarrow, pydantic, pytest
import scipy.integrate, scipy.interpolate, scipy.optimize, scipy.sparse.linalg
import gauss_bench

for module in pkgutil.walk_packages(gauss_bench.__path__, "gauss_bench."):
    try:
        importlib.import_module(module.name)
    except (ImportError, SystemExit):
        pass  # an extra that is not there

ours = {name: module for name, module in sys.modules.items() if name.startswith("gauss_bench") and module.__file__}


def imported(name):
    tree = ast.parse(pathlib.Path(ours[name].__file__).read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (x.name for x in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (node.module, *(f"{node.module}.{x.name}" for x in node.names))


users = {name: [] for name in ours}
for name in ours:
    for used in {*imported(name)} & {*ours}:
        users[used].append(name)


def forget(file):
    # What was made from this file, directly or by way of others, is to be imported anew; from data, everything.
    spoilt = [name for name, module in ours.items() if not file.endswith(".py") or module.__file__ == os.path.abspath(file)]
    while spoilt:
        name = spoilt.pop()
        if sys.modules.pop(name, None):
            room, _, last = name.rpartition(".")
            vars(ours[room]).pop(last, None) if room else None
            spoilt += users[name]


gc.collect()
gc.freeze()  # children need not look through what is there already
for line in sys.stdin:
    order = json.loads(line)
    if not (child := os.fork()):
        signal.alarm(order["limit"])
        told = os.open(order["told"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(told, 1), os.dup2(told, 2)
        for file in order["spoilt"]:
            forget(file)
        code = pytest.main(order["arguments"])
        sys.stdout.flush()
        os._exit(code)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


class Spoilt:
    """Runs tests in a folder, each time in a child of a process that has loaded the libraries and the sound project.

    The child forgets what a spoilt file was imported into before it imports it anew.
    """

    def __init__(self, folder: Path) -> None:
        self.told = folder / "told"
        where = os.environ | {"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
        command = [sys.executable, "-c", SERVER]
        self.process = subprocess.Popen(command, cwd=folder, env=where, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def outcome(self, tests: list[str], spoilt: tuple[str, ...] = (), limit: int = LIMIT) -> tuple[int, str]:
        """Return exit code and output of pytest; `spoilt` are the files that changed since the start."""
        # plain assertions, because rewriting them takes longer than running them
        arguments = ["-q", "-x", "-p", "no:cacheprovider", "--assert=plain", *tests]
        order = {"told": str(self.told), "limit": limit, "arguments": arguments, "spoilt": spoilt}
        assert self.process.stdin
        assert self.process.stdout
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()
        return int(self.process.stdout.readline()), self.told.read_text(encoding="utf-8")

    def stop(self) -> None:
        self.process.communicate()


@pytest.fixture(scope="session")
def spoilt(copy: Path) -> Iterator[Spoilt]:
    tests = Spoilt(copy)
    yield tests
    tests.stop()


def test_a_mutation_names_a_place_and_a_test_that_are_there() -> None:
    for mutation in MUTATIONS:
        assert set(mutation) == KEYS
        file, _, name = mutation["test"].partition("::")
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8"), mutation["fault"]
    for fault in (*MUTATIONS, *(x for x in TABLES["fault"] if "file" in x)):
        assert (ROOT / fault["file"]).read_text(encoding="utf-8").count(fault["text"]) == 1, f"{fault}: let it follow the code"


@pytest.mark.long
def test_without_a_fault_every_test_passes(spoilt: Spoilt) -> None:
    code, told = spoilt.outcome(sorted({mutation["test"] for mutation in MUTATIONS}))
    assert code == 0, told[-3000:]


@pytest.mark.parametrize(
    "mutation",
    [pytest.param(m, marks=pytest.mark.long if k % SAMPLE else pytest.mark.slow, id=m["fault"]) for k, m in enumerate(MUTATIONS)],
)
def test_a_planted_fault_is_seen(mutation: dict[str, str], copy: Path, spoilt: Spoilt) -> None:
    path = copy / mutation["file"]
    sound, when = path.read_text(encoding="utf-8"), path.stat().st_mtime_ns
    assert mutation["text"] in sound, "let the mutation follow the code"
    path.write_text(sound.replace(mutation["text"], mutation["mutant"]), encoding="utf-8")
    spoilt_at = when + 2 * SECOND * (1 + MUTATIONS.index(mutation))  # what is compiled is told by its second and its size
    os.utime(path, ns=(spoilt_at, spoilt_at))
    try:
        code, told = spoilt.outcome([mutation["test"]], (mutation["file"],))
    finally:
        path.write_text(sound, encoding="utf-8")
        os.utime(path, ns=(when, when))  # what is compiled of it holds again
    assert code == FAILED, f"not seen by {mutation['test']}:\n{told[-3000:]}"
