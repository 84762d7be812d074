"""Plant faults in a copy of the package, one at a time: the test that is named for a fault must fail.

A measurement that no test guards can be wrong for years and look right. `mutations.toml` keeps what has been tried, so that a test
that goes blind is noticed. A mutation whose text is no longer in its file fails: it has to move with the code.
"""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from gauss_bench.diagnosis.faults import TABLES

ROOT = Path(__file__).parents[1]
MUTATIONS = tomllib.loads((ROOT / "tests" / "mutations.toml").read_text(encoding="utf-8"))["mutation"]
KEYS = {"fault", "file", "text", "mutant", "test"}
NEEDED = ("gauss_bench", "tests", "mechanisms", "pyproject.toml")
LIMIT = 600  # [s] of one run of tests
SAMPLE = 7  # one mutation in so many is planted in every run of the slow tests
FAILED = 1  # pytest's exit code where tests ran and failed; anything else is no test's word


@pytest.fixture(scope="session")
def copy(tmp_path_factory):
    """A copy of the package and its tests, in which faults are planted."""
    return copy_project(tmp_path_factory.mktemp("spoilt"))


def copy_project(folder):
    """Copy the project into a folder, and return it."""
    for name in NEEDED:
        (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, folder / name)
    return folder


def run_tests(folder, tests, limit=LIMIT):
    """Return pytest's exit code and output for tests of a copy of the project.

    Raises:
        TimeoutExpired: the tests take longer than `limit` [s].
    """
    # no bytecode is written, since it is told from a spoilt file by second and size alone; plain assertions are quicker
    where = os.environ | {"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [sys.executable, "-B", "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "--assert=plain", *tests]
    done = subprocess.run(command, cwd=folder, env=where, capture_output=True, text=True, timeout=limit, check=False)
    return done.returncode, done.stdout + done.stderr


def test_a_mutation_names_a_place_and_a_test_that_are_there():
    for mutation in MUTATIONS:
        assert set(mutation) == KEYS
        file, _, name = mutation["test"].partition("::")
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8"), mutation["fault"]
    for fault in (*MUTATIONS, *(x for x in TABLES["fault"] if "file" in x)):
        assert (ROOT / fault["file"]).read_text(encoding="utf-8").count(fault["text"]) == 1, f"{fault}: let it follow the code"


@pytest.mark.long
def test_without_a_fault_every_test_passes(copy):
    code, told = run_tests(copy, sorted({mutation["test"] for mutation in MUTATIONS}))
    assert code == 0, told[-3000:]


@pytest.mark.parametrize(
    "mutation",
    [pytest.param(m, marks=pytest.mark.long if k % SAMPLE else pytest.mark.slow, id=m["fault"]) for k, m in enumerate(MUTATIONS)],
)
def test_a_planted_fault_is_seen(mutation, copy):
    path = copy / mutation["file"]
    sound = path.read_text(encoding="utf-8")
    path.write_text(sound.replace(mutation["text"], mutation["mutant"]), encoding="utf-8")
    try:
        code, told = run_tests(copy, [mutation["test"]])
    finally:
        path.write_text(sound, encoding="utf-8")
    assert code == FAILED, f"not seen by {mutation['test']}:\n{told[-3000:]}"
