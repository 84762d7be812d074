"""What a missing tool does to a test: a skip that names it on a desk, a failure where everything should be installed."""

import shutil
import sys

import pytest

from tests.conftest import SLOW, needs


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


def test_the_list_of_slow_tests_names_tests_that_are_there() -> None:
    for line in SLOW.read_text(encoding="utf-8").splitlines():
        file, _, test = line.partition("::")
        assert f"def {test.partition('[')[0]}(" in (SLOW.parent / file).read_text(encoding="utf-8"), line
