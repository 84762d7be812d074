"""The messages that DART prints become failures; `test_engines_elsewhere.py` holds everything else about DART."""

import os

import pytest

import gauss_bench
from gauss_bench.engines.dart.messages import Messages
from gauss_bench.trajectory import RunFailure, Status

ENGINE = "dart"


@pytest.mark.usefixtures("elsewhere")
def test_a_run_that_blows_up_is_a_warning_of_one_sentence() -> None:
    run = gauss_bench.simulate("eight_bar", "dart", "torque", "shut,lcp=PGS", at=[0.0, 1.0], step=1e-2)
    assert run.status == "warning"
    assert run.message.startswith("DART: Warning")
    assert "\x1b" not in run.message


def test_what_a_library_prints_is_a_failure_with_its_first_line_and_does_not_reach_the_streams(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with Messages() as messages:
        messages.check()
        os.write(2, b"\x1b[1;33mWarning [X.cpp:1]\x1b[0m Non-finite\n" * 3)
        os.write(1, b"and more\n")
        with pytest.raises(RunFailure, match=r"^DART: Warning \[X.cpp:1\] Non-finite$") as caught:
            messages.check()
    assert caught.value.status is Status.WARNING
    print("after")
    assert capfd.readouterr() == ("after\n", "")
