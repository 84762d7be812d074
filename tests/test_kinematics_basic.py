"""Motion in point coordinates satisfies the constraints in absolute coordinates, and never changes to another assembly."""

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gauss_bench.kinematics import basic_coordinates, root_finding
from gauss_bench.kinematics.basic_coordinates import basic_motion, branch_of
from gauss_bench.kinematics.branches import branches
from gauss_bench.kinematics.motion import LimitOfMotion, Motion
from gauss_bench.kinematics.point_equations import PointModel
from gauss_bench.kinematics.root_finding import ROOT_FINDERS, ExitFlag, Root
from gauss_bench.linkage.load import built_in, load, load_document
from gauss_bench.mechanism import motion_laws
from gauss_bench.mechanism.coordinates import position, value
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import Mechanism
from tests.conftest import DATA, driven, everything
from tests.four_bars import four_bar

METHODS = list(ROOT_FINDERS)


def document_of(name: str) -> dict[str, Any]:
    path = built_in().get(name, DATA / f"{name}.toml")
    return tomllib.loads(Path(path).read_text(encoding="utf-8"))


def turning(mechanism: Mechanism, **travels: float) -> Mechanism:
    """Return the mechanism with links or slides driven over `travels` [rad, m] in a second, from the start, by the sine law."""
    still = driven(mechanism, **dict.fromkeys(travels, motion_laws.constant(0.0, 0.0)))
    starts = {driver.name: float(value(driver.coordinate, mechanism.q0)) for driver in still.drivers}
    return driven(mechanism, **{name: motion_laws.rise("sine", starts[name], x, 1.0) for name, x in travels.items()})


def violations(mechanism: Mechanism, times: np.ndarray, motion: Motion) -> np.ndarray:
    """Return the largest |phi|, |J v + phi_t| and |J a - gamma| of joints and drivers in absolute coordinates, as an array (3,)."""
    rows = Constraints(mechanism)(times, motion.q, motion.v)
    rates = (rows.J @ motion.v[..., None])[..., 0] + rows.phi_t
    seconds = (rows.J @ motion.a[..., None])[..., 0] - rows.gamma
    return np.array([np.abs(x).max() for x in (rows.phi, rates, seconds)])


ROUNDING = np.array([1e-12, 1e-11, 1e-10])  # promised of positions, velocities, accelerations of order 1 to 100


def slotted(slot_deg: float, offset: float, flag: bool) -> Mechanism:
    """A crank whose block slides in the slot of a lever, with or without a link pinned to the lever's end."""
    document = document_of("shaper")
    for gone in ("rod", "ram"):
        del document["links"][gone]
    for gone in ("B", "C", "ram"):
        del document["joints"][gone]
    document |= {"expect": {}, "assembly": {"sketch": {"A": [0.1, 0.3]}, "angles_deg": {"lever": 71.6 - slot_deg, "crank": 0.0}}}
    document["observe"]["points"] = ["lever.B"]
    document["joints"]["slot"] |= {"angle_deg": slot_deg, "offset": offset}
    document["scenarios"] = {"rest": {"duration": 1.0, "start": {"angles_deg": {"crank": 0.0}}}}
    if flag:
        document["links"]["flag"] = {"points": {"B": [0.0, 0.0]}, "mass": 1.0, "inertia": 1.0}
        document["joints"]["B"] = {"type": "revolute", "at": ["lever.B", "flag.B"]}
        document["assembly"]["angles_deg"]["flag"] = 20.0
        document["scenarios"]["rest"]["start"]["angles_deg"]["flag"] = 20.0
    return load_document(document)


def cylinder(flag: bool = False) -> Mechanism:
    document = tomllib.loads((DATA / "kinematics" / "cylinder.toml").read_text(encoding="utf-8"))
    if not flag:
        del document["links"]["flag"], document["joints"]["Q"]
        for angles in (document["assembly"]["angles_deg"], document["scenarios"]["rest"]["start"]["angles_deg"]):
            del angles["flag"]
    return load_document(document)


MOVES: dict[str, tuple[Callable[[], Mechanism], dict[str, float], int]] = {  # linkage, travels [rad, m], number of equations
    "slot along x": (lambda: slotted(0.0, 0.0, flag=True), {"crank": 6.0, "flag": -2.0}, 2),
    "oblique slot": (lambda: slotted(30.0, 0.05, flag=True), {"crank": 6.0, "flag": -2.0}, 2),
    "lever with one point": (lambda: slotted(30.0, 0.05, flag=False), {"crank": 6.0}, 2),
    "boom": (cylinder, {"boom": 0.8}, 2),  # the barrel has one point: the piston shows its direction
    "bore": (cylinder, {"bore": 0.1}, 4),
    "barrel": (cylinder, {"barrel": -0.2}, 4),
    "barrel and piston with two points": (lambda: cylinder(flag=True), {"boom": 0.8, "flag": 1.0}, 4),
    "pins through three links": (lambda: load("jansen"), {"crank": 2 * np.pi}, 8),
}


@pytest.mark.parametrize("name", MOVES)
def test_every_kind_of_link_moves_as_in_absolute_coordinates(name: str) -> None:
    build, travel, rows = MOVES[name]
    mechanism = turning(build(), **travel)
    assert len(PointModel(mechanism).a) == rows
    times = np.linspace(0.0, 1.0, 25)
    motion = basic_motion(mechanism, times)
    assert np.abs(motion.q[-1] - motion.q[0]).max() > 0.05
    peak = max(1.0, np.abs(motion.a).max() / 100)  # rounding grows with accelerations
    assert (violations(mechanism, times, motion) < peak * ROUNDING).all()


def test_both_assemblies_of_the_four_bar_are_told_apart() -> None:
    mechanism = load("four_bar", "driven")
    both = [replace(mechanism, q0=q) for q in branches(mechanism, mechanism.q0)]
    assert sorted(branch_of(x, x.q0)["C"] for x in both) == [-1, 1]
    for x in both:
        branch, motion = branch_of(x, x.q0), basic_motion(x, np.linspace(0.0, 1.0, 37))
        assert all(branch_of(x, q) == branch for q in motion.q)
        B, C, D = (position(motion.q, p) for p in (x.joints[1].a, x.joints[2].a, x.joints[3].a))
        b, d = C - B, C - D
        np.testing.assert_array_equal(np.sign(b[:, 0] * d[:, 1] - b[:, 1] * d[:, 0]), branch["C"])


def test_a_limit_of_motion_is_named_with_the_input_it_lies_at() -> None:
    mechanism = driven(load_document(four_bar(0.3, 0.2, 0.25, 0.4)), a=motion_laws.constant(np.radians(60.0), 1.0))
    limit = np.arccos((0.3**2 + 0.4**2 - 0.45**2) / (2 * 0.3 * 0.4))
    with pytest.raises(LimitOfMotion, match=r"no solution beyond a = 1\.37") as caught:
        basic_motion(mechanism, np.linspace(0.0, 1.0, 11))
    assert 0 < limit - caught.value.inputs[0] < 1e-6  # a step of 10 degrees halved twenty times is 2e-7 rad
    reached = caught.value.reached
    assert len(reached.q) == int((limit - np.radians(60.0)) / 0.1) + 1
    assert (violations(mechanism, np.linspace(0.0, 1.0, 11)[: len(reached.q)], reached) < ROUNDING * 10).all()  # near the fold


def test_what_points_cannot_express_is_refused() -> None:
    four_bar, crank_slider, law = load("four_bar", "driven"), load("crank_slider", "driven"), motion_laws.constant(0.0, 1.0)
    for mechanism, text in (
        (everything(), "knife edges"),
        (driven(four_bar), "0 inputs for 1 degrees of freedom"),
        (driven(crank_slider, slider=law), "slider is known without driver 1"),
    ):
        with pytest.raises(ValueError, match=text):
            PointModel(mechanism)


def rosenbrock(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


def circles(apart: float) -> Any:
    """Two unit circles whose centres are `apart`: they meet in 2, 1 or 0 points."""

    def residual(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        to = np.array([x, x - [apart, 0.0]])
        return (np.sum(to**2, axis=1) - 1) / 2, to

    return residual


@pytest.mark.parametrize("method", METHODS)
def test_a_search_converges_and_says_so(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    search = ROOT_FINDERS[method]
    root = search(rosenbrock, np.array([-1.2, 1.0]))
    assert (root.flag, root.x) == (ExitFlag.CONVERGED, pytest.approx([1.0, 1.0], abs=1e-12))
    assert search(rosenbrock, np.array([np.nan, 1.0])).flag == ExitFlag.STALLED
    monkeypatch.setattr(root_finding, "LIMIT", 1)
    again = search(rosenbrock, np.array([-1.2, 1.0]))
    assert (again.flag, again.iterations) == (ExitFlag.TOO_MANY, 1)


@pytest.mark.parametrize("method", METHODS)
def test_circles_that_do_not_meet_have_no_root(method: str) -> None:
    search = ROOT_FINDERS[method]
    assert search(circles(1.8), np.array([0.8, 0.5])).x == pytest.approx([0.9, np.sqrt(1 - 0.81)], abs=1e-12)
    root = search(circles(2.2), np.array([0.8, 0.5]))
    assert root.flag != ExitFlag.CONVERGED
    assert root.residual > 0.1  # at the middle, the smallest of the largest: (1.1^2 - 1) / 2 = 0.105


def test_a_result_far_from_its_prediction_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
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
