"""What a missing tool does to a test: a skip that names it on a desk, a failure where everything should be installed."""

import shutil
import sys
from pathlib import Path

import pytest

from tests.conftest import LISTED, needs


def test_a_module_or_a_program_that_is_there_is_given() -> None:
    assert needs("tomllib") is sys.modules["tomllib"]
    assert needs("no-such-tool", "sh") == shutil.which("sh")


def test_a_missing_tool_is_a_named_skip_and_in_ci_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CI", raising=False)
    with pytest.raises(pytest.skip.Exception, match="needs no-such-tool or no_such_module, not installed"):
        needs("no-such-tool", "no_such_module")
    monkeypatch.setenv("CI", "true")
    with pytest.raises(pytest.fail.Exception, match="needs no-such-tool"):
        needs("no-such-tool")


@pytest.mark.parametrize("path", LISTED.values(), ids=LISTED)
def test_a_list_of_tests_names_tests_that_are_there(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines == sorted(set(lines)), "each once, in order"
    for line in lines:
        file, _, test = line.partition("::")
        assert f"def {test.partition('[')[0]}(" in (path.parent / file).read_text(encoding="utf-8"), line


def test_no_test_is_both_slow_and_long() -> None:
    slow, long = (set(path.read_text(encoding="utf-8").splitlines()) for path in LISTED.values())
    assert not slow & long
