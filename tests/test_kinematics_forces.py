"""Instant centres, mechanical advantage, driving torque, pin forces and other assemblies, against constructions on paper."""

from itertools import combinations

import numpy as np
import pytest

from gauss_bench.kinematics.branches import branches
from gauss_bench.kinematics.centres import advantages, centres
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import GROUND
from gauss_bench.metrics import driving_forces
from gauss_bench.trajectory import Trajectory


def cross(a, b):
    return float(a[0] * b[1] - a[1] * b[0])


def meeting(a, b, c, d):
    """Return the point at which the line through a and b meets the line through c and d."""
    return a + (b - a) * cross(c - a, d - c) / cross(b - a, d - c)


def driven(name, samples):
    mechanism = load(name, "driven")
    return mechanism, loop_motion(mechanism, np.linspace(0.0, mechanism.duration, samples))


def test_any_three_centres_of_the_eight_bar_lie_in_a_line():
    mechanism = load("eight_bar")
    found = {x.links: x.at for x in centres(mechanism, mechanism.q0)}
    assert len(found) == 28
    for a, b, c in combinations(range(GROUND, 7), 3):
        three = [found[a, b], found[b, c], found[a, c]]
        if all(x is not None and np.abs(x).max() < 10 for x in three):
            p, r, s = three
            assert abs(cross(r - p, s - p)) < 1e-9 * max(1.0, float(np.abs(three).max()) ** 2)


def test_a_slider_has_its_centre_at_infinity_across_its_guide():
    mechanism, motion = driven("crank_slider", 9)
    found = {x.links: x for x in centres(mechanism, motion.q[1])}
    slider, rod = found[GROUND, 2], found[GROUND, 1]
    assert slider.at is None
    assert np.abs(slider.along) == pytest.approx([1.0, 0.0], abs=1e-12)
    A, B = (position(motion.q[1], mechanism.find_point(x)) for x in ("crank.A", "slider.B"))
    assert rod.at == pytest.approx(meeting(np.zeros(2), A, B, B + np.array([0.0, 1.0])), abs=1e-10)


@pytest.mark.parametrize("motion", ["six_bar/driven", "parallelogram/driven", "five_bar/driven", "excavator/dig"])
def test_drivers_supply_the_power_that_the_links_take_up(motion):
    mechanism = load(*motion.split("/"))
    evaluator, times = Evaluator(mechanism), np.linspace(0.0, mechanism.duration, 25)
    x = loop_motion(mechanism, times)
    exerted = driving_forces(evaluator, Trajectory(times, x.q, x.v, x.a, None))
    supplied = sum(force * driver.law(times)[1] for force, driver in zip(exerted.T, mechanism.drivers, strict=True))
    taken = ((evaluator.mass * x.a - evaluator.applied.generalised(x.q, x.v, times)) * x.v).sum(-1)
    assert supplied == pytest.approx(taken, rel=1e-9, abs=1e-9)


def test_at_a_dead_centre_the_advantage_is_infinite():
    mechanism = load("crank_slider")
    (told,) = advantages(mechanism, mechanism.q0[None])
    assert np.isinf(told.mechanical[0])
    assert abs(told.velocity[0]) < 1e-12


def test_more_freedom_than_one_has_no_centres_and_no_branches_of_its_own():
    mechanism = load("five_bar", "spring")
    for search, said in ((centres, "2 free motions"), (branches, "1 of its motions stay free")):
        with pytest.raises(ValueError, match=said):
            search(mechanism, mechanism.q0)


def test_velocity_ratio_of_a_four_bar_by_its_centres_and_advantage_its_inverse():
    """omega_rocker / omega_crank = AP / DP with P the centre of crank and rocker, on the frame line."""
    mechanism, motion = driven("four_bar", 25)
    (told,) = advantages(mechanism, motion.q)
    assert (told.input, told.output, told.units) == ("crank", "rocker", ("rad", "rad"))
    for q, ratio in zip(motion.q, told.velocity, strict=True):
        (at,) = (x.at for x in centres(mechanism, q) if x.links == (0, 2))
        assert ratio == pytest.approx(at[0] / (at[0] - 0.4), rel=1e-9)
    assert told.mechanical * told.velocity == pytest.approx(1.0)
    assert told.velocity == pytest.approx(motion.v[:, 8] / motion.v[:, 2], rel=1e-9)
