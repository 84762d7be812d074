"""Rows are published from a committed tree alone; `make` runs with stand-ins for all its commands."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
GIT = ["git", "-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false"]
FIELD = [
    "run --suite field --jobs 2 --out reports/field",
    "-m gauss_bench.report.field_run reports/field",  # keeps the tables that pages read
    "report --out reports",
    "-m gauss_bench.report.pictures reports README.md",  # whose table and pictures follow the rows
    "-m gauss_bench.report.citation reports CITATION.cff",  # which names the rows
]


@pytest.fixture
def tree(tmp_path):
    """Return a committed tree with the project's Makefile, in which stand-ins write down their arguments."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    (tmp_path / ".gitignore").write_text(".venv/\nreports/local/\n")
    (tmp_path / "reports").mkdir()
    for name in ("source.py", "constraints.txt", "pyproject.toml", "reports/page.md"):
        (tmp_path / name).write_text("a\n")
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    for name in ("gauss-bench", "python"):
        said = tmp_path / ".venv" / "bin" / name
        said.write_text('#!/bin/sh\necho "$@" >> .venv/called\n')
        said.chmod(0o755)
    (tmp_path / ".venv" / ".ready").touch()
    for command in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "all"]):
        subprocess.run([*GIT, *command], cwd=tmp_path, check=True)
    return tmp_path


def make(tree, goal):
    """Run `make` for a goal; return its exit code, the arguments of all calls, and its stderr."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("GIT_", "MAKE"))}
    done = subprocess.run(["make", goal], cwd=tree, capture_output=True, text=True, env=clean)
    called = tree / ".venv" / "called"
    return done.returncode, called.read_text() if called.exists() else "", done.stderr


@pytest.mark.parametrize("goal", ["publish", "field"])
def test_a_clean_tree_is_published_and_the_field_run_again_alone(tree, goal):
    code, called, _ = make(tree, goal)
    assert code == 0
    first, others = called.splitlines()[: -len(FIELD)], called.splitlines()[-len(FIELD) :]
    assert others == FIELD
    assert [("--suite full" in x, x.split()[-2:]) for x in first] == [(True, ["--out", "reports"])] * (goal == "publish")


@pytest.mark.parametrize("goal", ["publish", "field"])
@pytest.mark.parametrize(("name", "published"), [("source.py", False), ("new.py", False), ("reports/page.md", True)])
def test_a_tree_that_is_not_committed_is_not(tree, name, published, goal):
    (tree / name).write_text("b\n")
    code, called, said = make(tree, goal)
    assert (code == 0) is published
    assert bool(called) is published
    assert published or name in said


def test_a_users_run_leaves_what_is_published_alone(tree):
    _, called, _ = make(tree, "bench")
    assert "--out" not in called  # its default is tested where the command line is
    assert "--against reports" in called
