"""Engines of libraries on the same linkages: accelerations, driven motions and torques, samples, and reasons to refuse."""

import sys

import numpy as np
import pytest
from hypothesis import given

from gauss_bench.engines import FOREIGN, get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load, load_document
from gauss_bench.mechanism.coordinates import value
from gauss_bench.mechanism.spaces import angles
from gauss_bench.reference.build import random_states
from tests.conftest import DATA, exhaustive, needs
from tests.drawn_linkages import examples, linkages
from tests.engine_runs import DRIVEN, LINKAGES, QUICK, acceleration_errors, by_gauss, linkage, ran

# settings, the most exact of each
BEST = {"pinocchio": "default", "exudyn": "tuned", "mujoco": "rigid", "casadi": "interpreted/rk4"}
RIGHT = {  # median and largest relative error of accelerations that an engine's arithmetic explains
    "pinocchio": (1e-12, 1e-10),  # rounding, amplified by transmission angles
    "exudyn": (1e-11, 1e-9),  # fourth-order differences at a relative step of 1e-3
    "mujoco": (5e-9, 1e-7),  # closures a little soft, and the load on a driven crank over its armature
    "casadi": (1e-12, 1e-10),
}
EQUAL = {"pinocchio": "rk4", "exudyn": "generalized_alpha", "mujoco": "rk4", "casadi": "rk4"}  # integrators with equal steps
# [m, rad] at a millisecond: measured at most 2.4e-10, 4.2e-6, 5.5e-8 and 2.4e-10
FOLLOWS = {"pinocchio": 1e-9, "exudyn": 1e-5, "mujoco": 1e-7, "casadi": 1e-9}
ENGINES = pytest.mark.parametrize("name", FOREIGN)
SEVERAL = [("excavator", "dig"), ("five_bar", "driven")]
SLIDES = [(str(DATA / "gripper.toml"), "close"), (str(DATA / "excavator_arm.toml"), "lift")]


@pytest.fixture(autouse=True)
def _library(request):
    if "missing" not in request.node.name:
        needs(request.node.callspec.params["name"])


@ENGINES
@pytest.mark.parametrize(("kind", "scenario"), exhaustive([*LINKAGES.items(), *DRIVEN], ("eight_bar", "torque"), *QUICK))
def test_accelerations_at_given_states_are_those_of_the_linkage(kind, scenario, name):
    mechanism = load(kind, scenario)
    errors = acceleration_errors(get(name), mechanism, BEST[name], random_states(mechanism, 25))
    assert np.median(errors) < RIGHT[name][0]
    assert errors.max() < RIGHT[name][1]


@ENGINES
@pytest.mark.parametrize(
    ("kind", "scenario"), exhaustive([*SLIDES, *SEVERAL, ("six_bar", "cycloid")], SLIDES[0], SEVERAL[0], ("six_bar", "cycloid"))
)
def test_what_is_driven_follows_its_law(kind, scenario, name):
    mechanism, times = load(kind, scenario), np.array([0.0, 0.05, 0.1])
    if (kind, scenario) in REFUSED[name]:
        return
    found = ran(get(name), mechanism, times, settings=BEST[name], integrator=EQUAL[name])
    for driver in mechanism.drivers:
        assert np.abs(value(driver.coordinate, found.q) - driver.law(times)[0]).max() < 1e-8
    expected = by_gauss(mechanism, times, integrator="rk4", stabilization="projection")
    assert np.abs(found.q - expected.q).max() < FOLLOWS[name]


@ENGINES
@given(document=linkages())
@examples(40)
def test_a_drawn_linkage_is_refused_or_its_model_is_that_of_the_linkage(document, name):
    """An engine compares its model with the linkage where it builds it, and raises RunFailure if they differ."""
    mechanism, engine, choice = load_document(document), get(name), Choice(BEST[name], EQUAL[name])
    if engine.skip(mechanism, choice) is None:
        engine.build(mechanism, choice)


@ENGINES
def test_samples_are_where_they_were_asked_for(name):
    """The first is the start, angles are not wrapped, and a time between two steps is met by shorter ones."""
    mechanism, times = load("crank_slider", "paper"), [0.0, 0.0707, 0.1, 0.10012, 0.2]
    found, exact = (ran(get(name), mechanism, times, settings=BEST[name], integrator=EQUAL[name]), by_gauss(mechanism, times))
    assert found.steps == 71 + 30 + 1 + 100
    np.testing.assert_allclose(found.q[0], mechanism.q0, rtol=0, atol=1e-12)
    assert np.abs(found.q - exact.q).max() < 1e-4
    turned = angles(ran(get(name), mechanism, [0.0, 1.5], settings=BEST[name], integrator=EQUAL[name], step=2e-3).q)[:, 0]
    assert turned[-1] < -4 * np.pi


REFUSED = {  # linkage, scenario -> a word of the reason
    "pinocchio": {("everything", "free"): "knife edge", ("wedge", None): "loop of slides"},
    "exudyn": {("sleigh", "glide"): "knife"},
    "mujoco": {
        ("wedge", None): "loop of slides",
        ("loaded", "axis"): "axis_on_a_carried_link",
        ("loaded", "frame"): "turned_with_a_third",
        ("five_bar", "driven"): "pin between this link and the ground",
    },
    "casadi": {("parallelogram", "torque"): "redundant"},
}


@ENGINES
def test_a_linkage_is_refused_with_a_reason_even_if_the_library_is_missing(name, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)  # importing it now fails
    choice = Choice(BEST[name], EQUAL[name])
    for (kind, scenario), reason in (REFUSED[name] | {("friction", None): "friction"}).items():
        assert reason in str(get(name).skip(linkage(kind, scenario), choice))
    for kind, scenario in (("four_bar", "driven"), ("excavator", "dig"), ("crank_slider", "paper")):
        assert get(name).skip(load(kind, scenario), choice) is None
    if name != "casadi":
        assert get(name).skip(load("parallelogram", "torque"), choice) is None
