"""The common parts of adapters to libraries of joint trees, tested on a stand-in for a library."""

from dataclasses import replace

import numpy as np
import pytest

from gauss_bench.engines.base import Choice
from gauss_bench.engines.shared import closing_pins, driven_rows, drivers_by_coordinate, jointed, open_tree
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.engines.tree_model import OpenModel, TreeModel, acceleration_by_steps, comparison, extrapolate, verify
from gauss_bench.formulations.gauss import gauss
from gauss_bench.integrate.fixed_step import STEPS, held_back
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.spaces import angles, places
from gauss_bench.trajectory import RunFailure
from tests.engine_runs import DRIVEN, by_gauss, linkage, moved

TREE = {"tree": "file order"}


class StandIn(TreeModel):
    """A library whose accelerations are those of Gauss's principle, and whose steps are the suite's."""

    library = "Stand-in"

    def __init__(self, mechanism, choice):
        super().__init__(mechanism, choice, TREE)
        self.evaluator = Evaluator(mechanism)

    def tree_acceleration(self, t, y, dy):
        q, v, rest = self.tree.absolute(y, dy, np.zeros(self.tree.n))
        speeds = np.array([self.tree.absolute(y, one, one)[1] for one in np.eye(self.tree.n)])
        return np.asarray(np.linalg.lstsq(speeds.T, gauss(self.evaluator.terms(t, q, v)).a - rest, rcond=None)[0])

    def run(self):
        y, dy = self.y0, self.dy0
        for begin, count, h, last, row in self.plan:
            for i in range(count):
                y, dy = STEPS["dop853_fixed"](held_back(self.tree_acceleration, last), begin + i * h, y, dy, h)
            if row is not None:
                self.y[row], self.dy[row] = y, dy


@pytest.mark.parametrize("name", ["crank_slider", "four_bar", "swinging_block"])
def test_a_motion_in_tree_coordinates_is_that_in_absolute_ones(name):
    mechanism, times = linkage(name), np.linspace(0.0, 0.1, 6)
    found, expected = moved(StandIn(mechanism, Choice(step=5e-3)), times), by_gauss(mechanism, times)
    assert np.abs(found.q - expected.q).max() < 1e-9  # DOP853 with a tolerance of 1e-10, along a tenth of a second
    assert np.abs(found.a - expected.a).max() < 1e-8 * np.abs(expected.a).max()
    assert found.steps == 5 * 4  # five intervals of 20 ms


def described(mechanism, tree, y, dy):
    """The linkage itself, described as a library would."""
    own = open_tree(Evaluator(mechanism), tree, y, dy)
    gaps = np.array([position(own.q, b) - position(own.q, a) for a, b in closing_pins(tree)]).reshape(-1, 2)
    return OpenModel(gaps, own.mass, own.forces, np.linalg.solve(own.mass, own.forces), places(own.q))


QUANTITIES = {
    "gaps": "gaps of open pins",
    "mass": "mass matrix",
    "forces": "forces and velocity terms",
    "accelerations": "forces of the open tree",
    "positions": "positions of links",
}


@pytest.mark.parametrize("part", QUANTITIES)
def test_a_quantity_that_differs_by_a_millionth_is_named(part):
    mechanism = linkage("loaded")
    tree = spanning_tree(mechanism)
    verify(mechanism, tree, lambda y, dy: described(mechanism, tree, y, dy), 1e-10)

    def spoiled(y, dy):
        model = described(mechanism, tree, y, dy)
        return replace(model, **{part: getattr(model, part) * (1 + 1e-6)})

    with pytest.raises(RunFailure, match=f"differs from the linkage: {QUANTITIES[part]}"):
        verify(mechanism, tree, spoiled, 1e-10)


def test_differences_are_measured_by_lengths_masses_and_loads_of_the_linkage():
    mechanism = linkage("loaded")
    tree = spanning_tree(mechanism)
    y, dy = tree.relative(mechanism.q0, mechanism.v0)
    own = open_tree(Evaluator(mechanism), tree, y, dy)
    scales = {what: scale for what, (_, _, scale) in comparison(described(mechanism, tree, y, dy), own).items()}
    extent = np.abs(mechanism.q0).max()
    assert scales["gaps of open pins"] == pytest.approx(extent)
    assert scales["positions of links"] == pytest.approx(extent)
    assert scales["mass matrix"] == own.mass.max()
    assert scales["forces and velocity terms"] == scales["forces of the open tree"] == own.load
    unloaded = comparison(described(mechanism, tree, y, dy), replace(own, load=0.0))
    assert unloaded["forces of the open tree"][2] == 1.0  # else nothing but an exact zero would do


@pytest.mark.parametrize("told", [{}, {"mass": np.eye(1)}, {"forces": np.zeros(1)}])
def test_a_description_that_leaves_the_motion_open_is_refused(told):
    with pytest.raises(TypeError, match="they determine the motion"):
        OpenModel(np.zeros((0, 2)), **told)


SLIDES = [("excavator_arm", "lift"), ("gripper", "close"), ("pushed", "push")]


@pytest.mark.parametrize(("name", "law"), [*DRIVEN, *SLIDES, ("five_bar", "driven"), ("excavator", None)])
def test_a_driven_angle_or_slide_at_the_start_is_the_row_of_tree_coordinates_that_its_law_prescribes(name, law):
    mechanism = linkage(name, law)
    tree = spanning_tree(mechanism)
    y, dy = tree.relative(mechanism.q0, mechanism.v0)
    rows, constants = driven_rows(mechanism, tree)
    laws = np.array([driver.law(0.0)[:2] for driver in jointed(mechanism)], dtype=float).reshape(-1, 2)
    np.testing.assert_allclose(rows @ y + constants, laws[:, 0], atol=1e-9)
    np.testing.assert_allclose(rows @ dy, laws[:, 1], atol=1e-9)
    for at, driver in drivers_by_coordinate(mechanism, tree).items():
        np.testing.assert_array_equal(rows[jointed(mechanism).index(driver)], np.eye(tree.n)[at])


@pytest.mark.parametrize("name", ["dyads", "swinging_block", "four_bar"])
def test_the_angle_of_any_driven_link_is_its_row_of_tree_coordinates(name, rng):
    (driver,) = load("four_bar", "driven").drivers
    undriven = linkage(name)
    mechanism = replace(undriven, drivers=tuple(replace(driver, link=i) for i in range(len(undriven.links))))
    tree = spanning_tree(mechanism)
    rows, constants = driven_rows(mechanism, tree)
    y = rng.standard_normal(tree.n)
    q, _, _ = tree.absolute(y, y, y)
    np.testing.assert_allclose(rows @ y + constants, angles(q), atol=1e-14)
    assert constants.any() == (name != "four_bar")  # the others have a slide whose block stands askew


# accelerations of a library that only steps


class Bead:
    """A mass on a ring of radius 1 in the plane; a step constrains the velocity along the ring at its beginning."""

    weight = np.array([0.0, -9.81])

    def rates(self, t, y, dy, h):
        found = []
        for _ in range(2):
            dy = dy + h * self.weight
            dy = dy - (y @ dy) / (y @ y) * y
            y = y + h * dy
            found.append(dy)
        return found[0], found[1]


def test_accelerations_are_measured_with_the_term_of_the_turning_constraint():
    y, dy = np.array([np.cos(0.3), np.sin(0.3)]), 2.0 * np.array([-np.sin(0.3), np.cos(0.3)])
    found = acceleration_by_steps(Bead().rates, 0.0, y, dy, (4e-5, 2e-5, 1e-5))
    along = np.array([-np.sin(0.3), np.cos(0.3)])
    np.testing.assert_allclose(found, (along @ Bead.weight) * along - 4.0 * y, rtol=1e-9)


def test_values_of_a_parabola_are_extrapolated_to_its_value_at_zero():
    steps = (0.4, 0.2, 0.1)
    values = [np.array([3.0 + 2.0 * h - 5.0 * h * h, h]) for h in steps]
    np.testing.assert_allclose(extrapolate(steps, values), [3.0, 0.0], atol=1e-14)
