"""Give the judge motions with one thing wrong, and test the program that measures them by the documentation."""

from collections import Counter

import numpy as np
import pytest

from tests.engine_runs import document
from tests.fuzz.judged import KINDS, over_judged
from tests.fuzz.limits import Motion, shares
from tests.fuzz.mechanics import Mechanics

PENDULUM = document("small/level")
T = np.linspace(0.0, 1.0, 101)
FALL = 2.0 * 9.81 * 0.5 / (0.1 + 2.0 * 0.25)  # [rad/s^2] of the level pendulum
NONE = np.zeros((101, 1))


def level(**changes):
    """Return the pendulum at rest in the level position, as if without gravity, with additions to q, v and a."""
    q = np.hstack([NONE + 0.5, NONE, NONE]) + changes.get("q", 0.0)
    return Motion(T, q, 0 * q + changes.get("v", 0.0), 0 * q + changes.get("a", 0.0))


def rows_of(x, again=None, truth=None):
    start = Motion(T[:1], np.array([[0.5, 0.0, 0.0]]), np.zeros((1, 3)), np.zeros((1, 3)))
    with np.errstate(all="ignore"):
        return shares(Mechanics(PENDULUM, "run"), 0.5, start, x, again, truth)


def test_limits_are_those_of_the_documentation_in_numbers():
    """The size is 0.5 m and the duration 1 s, from which the limits follow."""
    assert rows_of(level(q=np.array([5e-6, 0.0, 0.0])))["start"] == pytest.approx(1.0)
    assert rows_of(level(v=np.array([0.0, 0.0, 1e-5])))["start"] == pytest.approx(1.0)
    assert rows_of(level(q=np.array([0.0, 5e-3, 0.0])))["loops"] == pytest.approx(1.0)
    assert rows_of(level(v=np.array([0.0, 0.0125, 0.0])))["rates"] == pytest.approx(1.0)
    assert rows_of(level(a=np.array([0.0, 0.0, 0.025])))["rates"] == pytest.approx(1.0)
    assert rows_of(level(q=np.array([0.0, 0.025, 0.0])), truth=level())["truth"] == pytest.approx(1.0)
    assert rows_of(level(q=np.array([0.0, 0.0, 0.025])), again=level())["repetition"] == pytest.approx(1.0)
    true = np.array([0.0, -0.5 * FALL, -FALL])
    assert rows_of(level(a=true))["accelerations"] == pytest.approx(0.0, abs=1e-9)
    assert rows_of(level(a=1.01 * true))["accelerations"] == pytest.approx(1.0)


def test_samples_and_a_repetition_allow_no_more_than_two_limits_each():
    """Velocities jump in every second sample: three limits are allowed alone, and five with a repetition."""
    swing = np.where(np.arange(101) % 2, 1e3, 0.0)[:, None] * np.array([0.0, 0.0, 1.0])
    alone = rows_of(level(v=swing))["rates"]
    assert alone == pytest.approx(rows_of(level(v=swing), again=level())["rates"] * 5 / 3, rel=1e-6)


def test_energy_that_is_gained_is_held_against_three_hundredths_of_what_moves():
    """The pendulum rises by a quarter of a metre, and the 4.905 J that it gains are all its energy."""
    rise = np.clip(4 * T, 0.0, 1.0)[:, None] * np.array([0.0, 0.25, 0.0])
    assert rows_of(level(q=rise))["energy"] == pytest.approx(1 / 0.03)


@pytest.mark.long("11")
@pytest.mark.slow("5")
@pytest.mark.parametrize("count", [5, len(KINDS)])
def test_no_motion_beyond_what_is_documented_is_ok(count):
    """One motion of some kinds or of each kind; `make fuzz` asks for thousands."""
    judged = [*over_judged(3, count)]
    assert [sentence for _, _, sentence in judged if sentence] == []
    found = Counter(word.partition(": ")[2] for _, word, _ in judged)
    assert found["beyond, not ok"] >= count // 2
