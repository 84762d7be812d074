"""Compiled kinematics: whole turns against the library's closures, limits, assemblies."""

from dataclasses import replace
from functools import cache, partial
from unittest.mock import Mock

import numpy as np
import pytest

from gauss_bench.compiler.closure import compile_closure
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.turns.tracker import Tracker
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.kinematics.singular import singular_positions
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import AngleDriver, SlideDriver
from gauss_bench.mechanism.motion_laws import constant
from tests.conftest import exhaustive, redundant
from tests.engine_runs import changed

TURNING = ["four_bar", "crank_slider", "six_bar", "eight_bar", "shaper", "jansen", "parallelogram", "squeezer", "redundant"]
ROUNDING = 1e-12  # of the largest value of its kind: rounding times the condition of J, squared for accelerations


@cache
def mechanism(name):
    linkage, _, scenario = name.partition("/")
    return redundant() if linkage == "redundant" else load(linkage, scenario or None)


@cache
def closure(name, backend="llvm", **more):
    return compile_closure(mechanism(name), backend=backend, **more)


def crank_angle(m):
    return float(m.q0[3 * (m.crank or 0) + 2])


def library(m, angles, link=None):
    """The motion at angles of a link, the crank, at one radian per second: derivatives by the angle."""
    index = (m.crank or 0) if link is None else link
    law = replace(constant(0.0, 1.0), motion=lambda t: (np.interp(t, np.arange(len(angles)), angles), 1.0 + 0 * t, 0 * t))
    return loop_motion(replace(m, drivers=(AngleDriver(m.link_name(index), law, index),)), np.arange(len(angles)))


def by_input(compiled, u):
    """The states at values of the only input, with the derivatives by it."""
    return compiled.sweep(np.stack([u, np.ones_like(u), np.zeros_like(u)], axis=1)[:, :, None])


def assert_same(sweep, q, v, a, tolerance=ROUNDING):
    """The first samples of a sweep are these."""
    for found, wanted in ((sweep.q[: len(q)], q), (sweep.v[: len(q)], v), (sweep.a[: len(q)], a)):
        assert found.shape == wanted.shape
        assert np.abs(found - wanted).max() <= tolerance * max(1.0, float(np.abs(wanted).max()))


def turn_angles(m, count):
    return crank_angle(m) + 2 * np.pi / count * np.arange(count)


@pytest.mark.parametrize("name", exhaustive(TURNING, "crank_slider", "shaper", "redundant"))
def test_a_whole_turn_is_that_of_the_link_units(name, monkeypatch):
    monkeypatch.delattr(Tracker, "_close_by_library")  # compiled code closes all samples
    truth = library(mechanism(name), turn_angles(mechanism(name), 180))
    for backend in ("llvm", "numpy"):
        sweep = closure(name, backend).turn(180)
        assert len(sweep.q) == 180
        assert sweep.loss is None
        assert_same(sweep, truth.q, truth.v, truth.a)


@pytest.mark.parametrize(("name", "backend"), [("five_bar/driven", "llvm"), ("excavator/dig", "numpy")])
def test_several_inputs_follow_their_laws(name, backend):
    m = mechanism(name)
    times = np.linspace(0.0, m.duration, 301)
    sweep = closure(name, backend).sweep(np.array([driver.law(times) for driver in m.drivers]).T)
    truth = loop_motion(m, times)
    assert sweep.loss is None
    assert_same(sweep, truth.q, truth.v, truth.a)


def test_lanes_and_parts_make_no_difference():
    for lanes, count in ((1, 7), (2, 1001), (16, 1), (16, 33)):
        one, other = closure("six_bar").turn(count), closure("six_bar", lanes=lanes).turn(count)
        # parts begin elsewhere, and what Newton leaves, less than 4e-15 of the loops' vectors, is divided by the smallest pivot
        assert_same(other, one.q, one.v, one.a, tolerance=2e-13)


def test_samples_may_lie_far_apart():
    fine, coarse = closure("jansen").turn(300), closure("jansen").turn(5)
    assert_same(coarse, fine.q[::60], fine.v[::60], fine.a[::60])


def test_rates_of_the_input_count():
    """v = d u', a = d u'' + e u'^2."""
    unit = closure("shaper").turn(100)
    u, w, b = turn_angles(mechanism("shaper"), 100), np.linspace(-3.0, 5.0, 100), np.linspace(20.0, -10.0, 100)
    sweep = closure("shaper").sweep(np.stack([u, w, b], axis=1)[:, :, None])
    assert_same(sweep, unit.q, unit.v * w[:, None], unit.a * w[:, None] ** 2 + unit.v * b[:, None])


def test_angles_stay_continuous_over_many_turns_and_back():
    there = crank_angle(mechanism("four_bar")) + np.linspace(0.0, 20 * np.pi, 7201)
    q = by_input(closure("four_bar"), np.concatenate([there, there[::-1]])).q
    assert np.abs(np.diff(q[:, 2::3], axis=0)).max() < 0.02
    assert q[7200, 2] - q[0, 2] == pytest.approx(20 * np.pi, abs=1e-12)
    assert np.abs(q[-1] - q[0]).max() < 1e-13


def test_a_parallelogram_with_a_third_crank_passes_the_flat_positions():
    """Each of its loops alone is singular there, and both together are not."""
    m = mechanism("parallelogram")
    names = [link.name for link in m.links]
    flat = np.array([0.0, 1e-9, np.pi - 1e-9, np.pi, np.pi + 1e-9])
    q = by_input(closure("parallelogram"), np.concatenate([flat, flat + 2 * np.pi])).q
    cranks = [3 * names.index(x) + 2 for x in ("crank", "crank2", "crank3")]
    assert np.abs(q[:, cranks] - q[:, cranks[:1]]).max() < 1e-13
    assert np.abs(q[:, 3 * names.index("coupler") + 2]).max() < 1e-13


# Where a motion ends


@cache
def two_crank_parallelogram():
    points = {"links.rocker.points.C": [0.12, 0.0], "links.coupler.points.C": [0.4, 0.0]}
    sketch = {"assembly.sketch": {"B": [0.12, 0.01], "C": [0.52, 0.01]}}
    return changed("four_bar", "rest", points | sketch | {"scenarios.rest": {"duration": 1.0, "start": {"crank_deg": 60.0}}})


@pytest.mark.parametrize(("sense", "backend"), [(1, "llvm"), (-1, "numpy")])
def test_a_limit_is_reported_where_it_is(sense, backend, monkeypatch):
    m = mechanism("four_bar")
    rocker = [link.name for link in m.links].index("rocker")
    limits = [s.value for s in singular_positions(m) if s.coordinate == "rocker"]
    start = float(m.q0[3 * rocker + 2])
    angles = start + sense * np.linspace(0.0, 2.0, 401)
    limit = min((x for x in limits if (x - start) * sense > 0), key=lambda x: abs(x - start))
    driver = AngleDriver("rocker", constant(0.0, 1.0), rocker)
    by_library = Mock(side_effect=Tracker._close_by_library)
    monkeypatch.setattr(Tracker, "_close_by_library", lambda *arguments: by_library(*arguments))
    sweep = by_input(compile_closure(replace(m, drivers=(driver,)), backend=backend), angles)
    loss = sweep.loss
    assert loss.kind == "limit of motion"
    assert loss.inputs["rocker"] == pytest.approx(limit, abs=1e-9)  # the library halves its way to 1e-10 rad
    assert loss.sample == int(((angles - limit) * sense < 0).sum())
    assert by_library.call_count == 1  # compiled code closes all samples before
    assert np.isnan(sweep.q[loss.sample :]).all()
    truth = library(m, angles[: loss.sample], rocker)
    assert_same(sweep, truth.q, truth.v, truth.a)


@pytest.mark.parametrize(("count", "backend"), [(720, "llvm"), (719, "llvm"), (50, "numpy")])
def test_a_change_point_is_a_singular_position(count, backend):
    """Whether a sample meets it, or all step over it: the assembly changes sides there."""
    m = two_crank_parallelogram()
    sweep = compile_closure(m, backend=backend).turn(count)
    loss = sweep.loss
    assert loss.kind == "singular position"
    assert loss.inputs["crank"] == pytest.approx(np.pi, abs=1e-6)  # the library's rank counts as lost at 1e-7 of the largest
    assert loss.sample == int((turn_angles(m, count) < np.pi - 1e-9).sum())
    assert np.abs(sweep.q[: loss.sample, 3 + 2]).max() < 1e-12  # the coupler only shifts


def test_next_to_a_change_point_rates_are_not_given():
    """Nothing moves fast there, and yet rounding is divided by the square of the sine of a dyad: refused from 1e-4 on."""
    m = two_crank_parallelogram()
    compiled = compile_closure(m)
    for gap, closed in ((1e-2, True), (1e-5, False)):
        sweep = by_input(compiled, np.array([crank_angle(m), np.pi - gap]))
        assert np.isfinite(sweep.q).all(axis=1).tolist() == [True, closed]


def test_a_start_at_a_dead_centre_is_refused():
    """A slider cannot push its crank out of line."""
    m = load("crank_slider", "driven")
    with pytest.raises(KernelError, match="singular"):
        compile_closure(replace(m, drivers=(SlideDriver(m.slides[0].name, constant(0.0, 1.0), m.slides[0]),)))


# What is asked for


def test_what_does_not_fit_is_refused():
    for match, call, asked in (
        ("power of 2", lambda lanes: closure("four_bar", lanes=lanes), 3),
        ("knife edges", closure, "sleigh"),
        ("a turn needs a single one", closure("five_bar/driven").turn, 10),
        ("levels of shape", partial(by_input, closure("five_bar/driven")), np.zeros(5)),
        ("levels of shape", partial(by_input, closure("four_bar")), np.zeros(0)),
        ("not finite", partial(by_input, closure("four_bar")), np.array([0.0, np.nan])),
    ):
        with pytest.raises(ValueError, match=match):  # a KernelError is one too
            call(asked)
