"""A test whose tool is missing is skipped and names the tool; in CI, where all tools must be installed, it fails."""

import shutil
import sys

import pytest

from tests.conftest import COLLECTED, TIMED, needs


def test_a_module_or_a_program_that_is_there_is_given():
    assert needs("tomllib") is sys.modules["tomllib"]
    assert needs("no-such-tool", "sh") == shutil.which("sh")


def test_a_missing_tool_is_a_named_skip_and_in_ci_a_failure(monkeypatch):
    monkeypatch.delenv("CI", raising=False)
    with pytest.raises(pytest.skip.Exception, match="needs no-such-tool or no_such_module, not installed"):
        needs("no-such-tool", "no_such_module")
    monkeypatch.setenv("CI", "true")
    with pytest.raises(pytest.fail.Exception, match="needs no-such-tool"):
        needs("no-such-tool")


def test_a_mark_names_cases_that_are_there(request):
    named = {}  # file, function and what its mark names -> its cases
    for item in request.config.stash[COLLECTED]:
        for mark in getattr(item.obj, "pytestmark", ()):
            if mark.name in TIMED and mark.args:
                named.setdefault((item.path.name, item.originalname, mark.args), set()).add(item.callspec.id)
    for (file, function, cases), there in named.items():
        assert set(cases) <= there, f"{file}, {function}: no case of {sorted(set(cases) - there)}"
