"""Faults planted in a copy of the package, one at a time: each must be seen by the test that is named for it.

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

ROOT = Path(__file__).parents[1]
MUTATIONS = tomllib.loads((ROOT / "tests" / "mutations.toml").read_text(encoding="utf-8"))["mutation"]
KEYS = {"fault", "file", "text", "mutant", "test"}
NEEDED = ("gauss_bench", "tests", "mechanisms", "pyproject.toml")
FAILED = 1  # pytest's exit code where tests ran and failed; anything else is no test's word


@pytest.fixture(scope="session")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package and its tests, to be spoilt."""
    folder = tmp_path_factory.mktemp("spoilt")
    for name in NEEDED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, folder / name)
    return folder


def outcome(folder: Path, tests: list[str]) -> subprocess.CompletedProcess[str]:
    """What the tests say of the package in a folder."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", *tests]
    where = os.environ | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(command, cwd=folder, env=where, capture_output=True, text=True, timeout=600)


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda m: m["fault"])
def test_a_mutation_names_a_place_that_is_there(mutation: dict[str, str]) -> None:
    assert set(mutation) == KEYS
    path = ROOT / mutation["file"]
    assert path.exists(), f"{mutation['file']} is gone: let the mutation follow the code"
    assert path.read_text(encoding="utf-8").count(mutation["text"]) == 1, "let the mutation follow the code"
    file, _, name = mutation["test"].partition("::")
    assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8")


@pytest.mark.slow
def test_without_a_fault_every_test_passes(copy: Path) -> None:
    found = outcome(copy, sorted({mutation["test"] for mutation in MUTATIONS}))
    assert found.returncode == 0, found.stdout[-3000:]


@pytest.mark.slow
@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda m: m["fault"])
def test_a_planted_fault_is_seen(mutation: dict[str, str], copy: Path) -> None:
    path = copy / mutation["file"]
    sound = path.read_text(encoding="utf-8")
    path.write_text(sound.replace(mutation["text"], mutation["mutant"]), encoding="utf-8")
    try:
        found = outcome(copy, [mutation["test"]])
    finally:
        path.write_text(sound, encoding="utf-8")
    assert found.returncode == FAILED, f"not seen by {mutation['test']}:\n{found.stdout[-2000:]}{found.stderr[-2000:]}"
