"""Dragging reaches the target or the nearest point, moves no locked part, and never jumps to another assembly."""

import numpy as np
import pytest

from gauss_bench.kinematics.dragging import Drag, Locks
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.coordinates import position, value
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import GROUND


def residual(mechanism, q):
    return float(np.abs(Constraints(mechanism).residual(q)[0]).max())


def at(mechanism, q, point):
    return position(q, mechanism.find_point(point))


def test_a_crank_pin_follows_to_the_nearest_point_of_its_circle():
    mechanism = load("four_bar")
    drag, pin = Drag(mechanism, mechanism.q0, "crank.B"), 0.12
    for angle in np.radians([10.0, 60.0, 130.0, 200.0, 290.0, 400.0, 250.0]):
        for radius in (pin, 0.05, 0.4):
            found = drag.to(radius * np.array([np.cos(angle), np.sin(angle)]))
            nearest = pin * np.array([np.cos(angle), np.sin(angle)])
            assert np.abs(at(mechanism, found.q, "crank.B") - nearest).max() < 1e-10
            assert found.reached == (radius == pin)
            assert found.apart == pytest.approx(abs(radius - pin), abs=1e-11)
            assert bool(found.note) != found.reached
            assert residual(mechanism, found.q) < 1e-12


def test_a_slider_goes_no_further_than_its_stroke_and_comes_back():
    mechanism = load("crank_slider")
    drag = Drag(mechanism, mechanism.q0, "slider.B")
    for target, end in ((0.9, 0.71), (0.2, 0.41), (0.5, 0.5), (0.9, 0.71), (0.6, 0.6)):
        found = drag.to(np.array([target, 0.1]))
        assert at(mechanism, found.q, "slider.B") == pytest.approx([end, 0.0], abs=1e-9)
        assert not found.reached
        assert "cannot come nearer" in found.note


@pytest.mark.slow
def test_an_arm_pulled_straight_folds_back_as_it_was():
    mechanism = load("five_bar")
    drag, rng = Drag(mechanism, mechanism.q0, "left_arm.C"), np.random.default_rng(3)
    home = at(mechanism, mechanism.q0, "left_arm.C")
    for angle in rng.uniform(np.radians(60.0), np.radians(140.0), 25):
        outside = 0.75 * np.array([np.cos(angle), np.sin(angle)])
        assert not drag.to(outside).reached
        back = drag.to(home)
        assert back.reached
        assert np.abs(np.angle(np.exp(1j * (back.q - mechanism.q0)[2::3]))).max() < 1e-8


def test_locks_hold_what_they_name_and_the_rest_moves():
    five, shaper = load("five_bar"), load("shaper")
    joint = next(x for x in five.pins if GROUND not in (x.a.link, x.b.link))
    (ram,) = (x for x in shaper.slides if x.name == "ram")
    for mechanism, point, locks, held, moves in (
        (five, "left_arm.C", Locks(links=(five.links[0].name,)), lambda q: q[2], True),
        (five, "right_arm.P", Locks(points=("left_arm.C",)), lambda q: at(five, q, "left_arm.C"), False),
        (five, "right_arm.P", Locks(joints=(joint.joint,)), lambda q: value(joint.motion, q), True),
        (shaper, "crank.A", Locks(slides=("ram",)), lambda q: value(ram.motion, q), False),
    ):
        drag = Drag(mechanism, mechanism.q0, point, locks)
        found = [drag.to(np.array(target)) for target in ([0.1, 0.3], [0.4, 0.2], [0.3, 0.6])]
        assert max(np.abs(held(x.q) - held(mechanism.q0)).max() for x in found) < 1e-9
        assert (max(np.abs(x.q - mechanism.q0).max() for x in found) > 1e-3) == moves
        assert any("no motion is left free" in x.note for x in found) != moves


def test_a_parallelogram_goes_straight_through_its_flat_positions():
    """The motion forks there. All three cranks stay parallel if any of them is dragged around, twice each way."""
    mechanism = load("parallelogram")
    name = mechanism.links[0].name
    tip = next(p for p in mechanism.links[0].points if np.hypot(*mechanism.links[0].points[p]) > 0)
    drag = Drag(mechanism, mechanism.q0, f"{name}.{tip}")
    pivot = at(mechanism, mechanism.q0, f"{name}.{next(p for p in mechanism.links[0].points if p != tip)}")
    start = at(mechanism, mechanism.q0, f"{name}.{tip}") - pivot
    for angle in [*np.arange(0.0, 4 * np.pi, 0.1), *np.arange(4 * np.pi, 0.0, -0.17)]:
        c, s = np.cos(angle), np.sin(angle)
        found = drag.to(pivot + np.array([[c, -s], [s, c]]) @ start)
        assert found.reached
        coupler = mechanism.links.index(next(x for x in mechanism.links if x.name == "coupler"))
        assert abs(found.q[3 * coupler + 2] - mechanism.q0[3 * coupler + 2]) < 1e-7


def test_what_cannot_be_dragged_is_refused_by_name():
    mechanism = load("four_bar")
    for point, locks, said in (
        ("ground.A", Locks(), "fixed to the ground"),
        ("crank.nowhere", Locks(), "no point"),
        ("crank.B", Locks(links=("lever",)), "no link 'lever'"),
        ("crank.B", Locks(slides=("guide",)), "no slide 'guide'"),
    ):
        with pytest.raises(ValueError, match=said):
            Drag(mechanism, mechanism.q0, point, locks)
    with pytest.raises(ValueError, match="joints are open"), np.errstate(all="ignore"):
        Drag(mechanism, np.full(mechanism.n, np.nan), "crank.B")
