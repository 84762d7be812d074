"""Motion by loops and by points, against printed matrices, closed forms and the constraints in absolute coordinates.

Loops and link units are those of Wang et al. (2010). A motion never changes to another assembly.
"""

import csv
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given

from gauss_bench.kinematics import basic_coordinates, root_finding
from gauss_bench.kinematics.basic_coordinates import basic_motion, branch_of
from gauss_bench.kinematics.branches import branches
from gauss_bench.kinematics.link_units import PIN, Element, link_type
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.kinematics.motion import LimitOfMotion, Motion, MotionError, SingularPosition
from gauss_bench.kinematics.point_equations import PointModel
from gauss_bench.kinematics.root_finding import ROOT_FINDERS, ExitFlag, Root
from gauss_bench.kinematics.topology import find_graph
from gauss_bench.linkage.load import load, load_document
from gauss_bench.mechanism.coordinates import acceleration, position, value, velocity
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import AngleDriver, LengthDriver
from gauss_bench.mechanism.motion_laws import MotionLaw, constant, rise
from tests.conftest import DATA, driven, everything, redundant
from tests.drawn_linkages import PARTS, every_freedom, examples, linkages
from tests.engine_runs import document
from tests.four_bars import four_bar

Solver = Callable[..., Motion]
SOLVERS = [loop_motion, basic_motion]
SIX = ["crank_slider", "four_bar", "parallelogram", "six_bar", "shaper", "eight_bar"]


def test_links_have_the_names_of_the_paper():
    excavator = load("excavator")
    bars = [d for d in excavator.drivers if isinstance(d, LengthDriver)]
    for mechanism, active, codes in (
        (load("six_bar"), [], {"crank": "RR", "ternary": "RRR", "slider": "RP1"}),
        (load("shaper"), [], {"block": "RP1", "lever": "RRP2"}),
        (excavator, bars, {"boom": "4R", "bucket": "RR", bars[0].name: "S"}),
    ):
        graph, names = find_graph(mechanism, active), [x.name for x in (*mechanism.links, *active)]
        assert {name: link_type(graph.elements(names.index(name))) for name in codes} == codes
    assert link_type(find_graph(load("six_bar")).elements(-1), frame=True) == "RRP0"
    assert link_type([Element(x, x, PIN, 0j) for x in "abcde"]) == "5R"
    multiple = [Element(pair, node, PIN, 0j) for pair, node in (("B", "B"), ("B.001", "B"), ("C", "C"))]
    assert link_type(multiple) == "RR"


# Loops


@pytest.mark.parametrize("name", [*SIX, "five_bar", "jansen", "redundant"])
def test_loops_are_independent_and_leave_every_link_as_often_as_they_enter_it(name):
    mechanism = redundant() if name == "redundant" else load(name)
    graph = find_graph(mechanism)
    n, p = len(mechanism.links) + 1, len(mechanism.joints)
    crossed, M, names = np.zeros((len(graph.loops), p)), np.zeros((n, p)), [pair.name for pair in graph.pairs]
    for k, pair in enumerate(graph.pairs):
        M[pair.links[0], k], M[pair.links[1], k] = -1, 1
    for l, loop in enumerate(graph.loops):
        for path in loop.paths:
            k = names.index(path.leave.pair)
            crossed[l, k] = 1 if path.link == graph.pairs[k].links[0] else -1
    assert len(crossed) == p - n + 1 == np.linalg.matrix_rank(crossed)
    np.testing.assert_array_equal(crossed @ M.T, 0)


# Motion


def violations(mechanism, times, motion):
    """Return the largest |phi|, |J v + phi_t| and |J a - gamma| of joints and drivers in absolute coordinates, as an array (3,)."""
    rows = Constraints(mechanism)(times, motion.q, motion.v)
    rates = (rows.J @ motion.v[..., None])[..., 0] + rows.phi_t
    seconds = (rows.J @ motion.a[..., None])[..., 0] - rows.gamma
    return np.array([np.abs(x).max() for x in (rows.phi, rates, seconds)])


ROUNDING = np.array([1e-12, 1e-11, 1e-10])  # promised of positions, velocities, accelerations of order 1 to 100


def relative(found, true):
    return float(np.abs(found - true).max() / max(1.0, np.abs(true).max()))


@pytest.mark.parametrize("solve", SOLVERS)
@pytest.mark.parametrize("name", SIX)
def test_driven_points_agree_with_closed_forms_in_forty_digits(name, solve):
    mechanism = load(name, "driven")
    with (DATA / f"kinematics_{name}.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    times = np.array(sorted({float(row["crank_deg_from_start"]) for row in rows})) / 360.0  # the crank turns once a second
    motion = solve(mechanism, times)
    for point in mechanism.observed_points:
        own = sorted((row for row in rows if row["point"] == point.name), key=lambda row: float(row["crank_deg_from_start"]))
        true = np.array([[float(row[key]) for key in ("x", "y", "vx", "vy", "ax", "ay")] for row in own])
        assert len(own) == len(times) == 12
        q, v, a = motion.q, motion.v, motion.a
        assert relative(position(q, point), true[:, :2]) < 1e-13  # promised: 1e-12, 1e-11, 1e-10
        assert relative(velocity(q, v, point), true[:, 2:4]) < 1e-12
        assert relative(acceleration(q, v, a, point), true[:, 4:]) < 1e-11


@given(linkages(parts=[x for x in PARTS if x != "sled"], laws=every_freedom()))
@examples(12)
def test_any_linkage_moves_by_points_as_by_loops(drawn):
    """Links with one point, slots at any angle and offset, cylinders, active bars, and pins through several links."""
    mechanism, times = load_document(drawn), np.linspace(0.0, 0.2, 5)
    try:
        true = loop_motion(mechanism, times)
    except MotionError:
        assume(False)
    assert_alike(mechanism, times, true)


def assert_alike(mechanism, times, true):
    """Compare motion by points with the true one by loops."""
    found = basic_motion(mechanism, times)
    np.testing.assert_allclose(true.q[0], mechanism.q0, atol=1e-12)
    for level in "qva":
        assert relative(getattr(found, level), getattr(true, level)) < 1e-12


@pytest.mark.parametrize(("name", "travel"), [("boom", 0.8), ("bore", 0.1), ("barrel", -0.2)])
def test_a_barrel_with_one_point_has_the_direction_that_its_piston_shows(name, travel):
    mechanism, times = load_document(document("kinematics/cylinder")), np.linspace(0.0, 1.0, 25)
    (still,) = driven(mechanism, **{name: constant(0.0, 0.0)}).drivers
    start = float(value(still.coordinate, mechanism.q0))
    mechanism = driven(mechanism, **{name: rise("sine", start, travel, 1.0)})
    assert_alike(mechanism, times, loop_motion(mechanism, times))


def test_both_assemblies_of_the_four_bar_are_told_apart():
    mechanism = load("four_bar", "driven")
    both = [replace(mechanism, q0=q) for q in branches(mechanism, mechanism.q0)]
    assert sorted(branch_of(x, x.q0)["C"] for x in both) == [-1, 1]
    for x in both:
        branch, motion = branch_of(x, x.q0), basic_motion(x, np.linspace(0.0, 1.0, 37))
        assert all(branch_of(x, q) == branch for q in motion.q)
        B, C, D = (position(motion.q, p) for p in (x.joints[1].a, x.joints[2].a, x.joints[3].a))
        b, d = C - B, C - D
        np.testing.assert_array_equal(np.sign(b[:, 0] * d[:, 1] - b[:, 1] * d[:, 0]), branch["C"])


def test_a_result_far_from_its_prediction_is_not_believed(monkeypatch):
    mechanism = load("parallelogram", "driven")
    times = np.array([0.0, 5 / 360])
    assert branch_of(mechanism, mechanism.q0) == {}  # it is redundant: no group distinguishes its assemblies
    lies = iter([None, Root(PointModel(mechanism).points.unknown_at(mechanism.q0) + 0.03, ExitFlag.CONVERGED, 1, 0.0)])
    true = basic_motion(mechanism, times)
    search = basic_coordinates.gauss_newton
    monkeypatch.setattr(basic_coordinates, "gauss_newton", lambda *given: next(lies, None) or search(*given))
    found = basic_motion(mechanism, times)
    assert next(lies, "told") == "told"
    assert np.abs(found.q - true.q).max() < 1e-13  # found in two halves instead


# Where it ends


def turned(mechanism, speed):
    return driven(mechanism, **{mechanism.links[0].name: constant(float(mechanism.q0[2]), speed)})


@pytest.mark.parametrize(
    ("solve", "step", "exact", "said"),
    [  # halving ends at 1e-10 rad, or at 10 degrees halved twenty times: 2e-7 rad
        (loop_motion, 0.01, 2e-10, r"bars stops at a = 1\.\d+ rad on the way .*limit of motion"),
        (loop_motion, 0.5, 2e-10, r"bars stops at a = 1\.\d+ rad on the way .*limit of motion"),
        (basic_motion, 0.1, 1e-6, r"no solution beyond a = 1\.37"),
    ],
)
def test_a_limit_of_motion_is_a_typed_error_that_says_where(solve, step, exact, said):
    mechanism = turned(load_document(four_bar(0.3, 0.2, 0.25, 0.4)), 1.0)
    limit = np.arccos((0.3**2 + 0.4**2 - (0.2 + 0.25) ** 2) / (2 * 0.3 * 0.4))  # coupler and rocker in line
    times = np.arange(0.0, 2.0, step)
    with pytest.raises(LimitOfMotion, match=said) as caught:
        solve(mechanism, times)
    error, reached = caught.value, len(caught.value.reached.q)
    input = error.inputs["a"] if solve is loop_motion else error.inputs[0]
    assert -1e-12 < limit - input < exact
    assert mechanism.q0[2] + times[reached - 1] < limit < mechanism.q0[2] + times[reached]
    assert solve is basic_motion or error.time == times[reached]
    np.testing.assert_array_equal(error.reached.a, solve(mechanism, times[:reached]).a)
    assert (violations(mechanism, times[:reached], error.reached) < ROUNDING * 10).all()  # near the fold
    way = limit - float(mechanism.q0[2])  # in 1 s
    assert np.isfinite(solve(turned(mechanism, way - 1e-6), np.ones(1)).a).all()
    with pytest.raises(MotionError, match=r"a = 1\.37"):
        solve(turned(mechanism, way - 1e-9), np.ones(1))  # so near to the limit rounding decides the rates


@pytest.mark.parametrize(("solve", "near"), [(loop_motion, 1e-6), (basic_motion, 1e-3)])  # [rad] where the rank counts as lost
@pytest.mark.parametrize("samples", [20, 181])
def test_a_change_point_is_a_singular_position_not_a_limit(solve, near, samples):
    """A parallelogram with two cranks only: at 180 degrees it may go on as an antiparallelogram. 181 samples meet it exactly."""
    mechanism = load_document(four_bar(0.2, 0.4, 0.2, 0.4))
    with pytest.raises(SingularPosition, match=r"rank 1 of 2|more than one way") as caught:
        solve(turned(mechanism, np.pi), np.linspace(0.0, 1.2, samples))
    (reached,) = caught.value.inputs.values() if solve is loop_motion else caught.value.inputs
    assert reached == pytest.approx(np.pi, abs=near)


def test_inputs_and_linkages_that_do_not_fit_are_refused():
    mechanism, five, law = load("crank_slider", "driven"), load("five_bar", "spring"), constant(0.0, 1.0)
    for solve, wrong, text in (
        (loop_motion, driven(mechanism), "1 degrees of freedom, but 0 inputs"),
        (basic_motion, driven(mechanism), "0 inputs for 1 degrees of freedom"),
        (loop_motion, driven(mechanism, slider=law), "cannot be driven at 'slider'"),
        (basic_motion, driven(mechanism, slider=law), "slider is known without driver 1"),
        (loop_motion, driven(mechanism, crank=MotionLaw("nan", lambda t: (np.nan * t, t, t))), "not finite"),
        (loop_motion, replace(five, drivers=(AngleDriver("left", law, 0),) * 2), "two inputs for one variable"),
        (loop_motion, replace(everything(), drivers=(AngleDriver("", law, 0),) * 8), "knife edges"),
        (basic_motion, everything(), "knife edges"),
        (
            loop_motion,
            replace(everything(), drivers=(AngleDriver("", law, 0),) * 8, knife_edges=()),
            "no joints hold sled to the frame",
        ),
    ):
        with pytest.raises(ValueError, match=text):
            solve(wrong, np.zeros(1))
    assert not issubclass(MotionError, ValueError)


# Searches


def rosenbrock(x):
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


def circles(apart):
    """Two unit circles whose centres are `apart`: they meet in 2, 1 or 0 points."""

    def residual(x):
        to = np.array([x, x - [apart, 0.0]])
        return (np.sum(to**2, axis=1) - 1) / 2, to

    return residual


@pytest.mark.parametrize("method", ROOT_FINDERS)
def test_a_search_converges_and_says_so(method, monkeypatch):
    search = ROOT_FINDERS[method]
    root = search(rosenbrock, np.array([-1.2, 1.0]))
    assert (root.flag, root.x) == (ExitFlag.CONVERGED, pytest.approx([1.0, 1.0], abs=1e-12))
    assert search(rosenbrock, np.array([np.nan, 1.0])).flag == ExitFlag.STALLED
    monkeypatch.setattr(root_finding, "LIMIT", 1)
    again = search(rosenbrock, np.array([-1.2, 1.0]))
    assert (again.flag, again.iterations) == (ExitFlag.TOO_MANY, 1)


@pytest.mark.parametrize("method", ROOT_FINDERS)
def test_circles_that_do_not_meet_have_no_root(method):
    search = ROOT_FINDERS[method]
    assert search(circles(1.8), np.array([0.8, 0.5])).x == pytest.approx([0.9, np.sqrt(1 - 0.81)], abs=1e-12)
    root = search(circles(2.2), np.array([0.8, 0.5]))
    assert root.flag != ExitFlag.CONVERGED
    assert root.residual > 0.1  # at the middle, the smallest of the largest: (1.1^2 - 1) / 2 = 0.105
