"""Motion laws: value, rate and second rate belong together, the rise is complete, and outside its time a law rests."""

import numpy as np
import pytest

from gauss_bench.mechanism.motion_laws import RISE_LAWS, MotionLaw, constant, rise, table

TABLE = table(0.2, np.array([0.0, 0.3, 0.7, 1.0]), np.array([0.0, 0.4, 0.1, 1.0]))
LAWS = [constant(0.1, 2.0), *(rise(name, 0.3, 1.7, 0.8) for name in RISE_LAWS), TABLE]
PEAKS = {"sine": (2.0, 2 * np.pi), "cosine": (np.pi / 2, np.pi**2 / 2), "poly345": (1.875, 10 / np.sqrt(3))}  # textbook


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_rates_are_derivatives(law: MotionLaw) -> None:
    t, h = np.linspace(0.013, 0.787, 41), 1e-5
    ahead, behind = law(t + h), law(t - h)
    assert np.abs((ahead[0] - behind[0]) / (2 * h) - law(t)[1]).max() < 1e-7  # differences of the second order
    knots = np.min(np.abs(t[:, None] - [0.3, 0.7]), axis=1) < 2 * h  # a cubic spline's second rate has corners there
    assert np.abs((ahead[1] - behind[1]) / (2 * h) - law(t)[2])[~knots].max() < 1e-6


@pytest.mark.parametrize("name", RISE_LAWS)
def test_a_rise_reaches_its_travel_in_its_time_with_the_peaks_of_the_textbook(name: str) -> None:
    law = rise(name, 0.3, 1.7, 0.8)
    t = np.linspace(0.0, 0.8, 200001)
    value, rate, second = law(t)
    assert value[[0, -1]] == pytest.approx([0.3, 2.0], abs=1e-14)
    speed, acceleration = PEAKS[name]
    assert np.abs(rate).max() == pytest.approx(speed * 1.7 / 0.8, rel=1e-8)
    assert np.abs(second).max() == pytest.approx(acceleration * 1.7 / 0.8**2, rel=1e-8)


@pytest.mark.parametrize("law", [law for law in LAWS if law.name != "constant"], ids=lambda law: law.name)
def test_outside_its_time_a_law_rests(law: MotionLaw) -> None:
    for t in (-0.5, 1.5):
        _, rate, second = law(t)
        assert rate == 0.0
        assert second == 0.0


def test_a_table_goes_through_its_points_and_is_clamped() -> None:
    assert TABLE(np.array([0.0, 0.3, 0.7, 1.0]))[0] == pytest.approx([0.2, 0.6, 0.3, 1.2], abs=1e-14)
    assert TABLE(np.array([0.0, 1.0]))[1] == pytest.approx([0.0, 0.0], abs=1e-13)
