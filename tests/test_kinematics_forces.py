"""Instant centres, mechanical advantage, driving torque, pin forces and other assemblies, against constructions on paper."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench.kinematics.advantage import advantages
from gauss_bench.kinematics.branches import branches
from gauss_bench.kinematics.centres import centres
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.linkage.load import document_of, load, load_document
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import GROUND, Mechanism
from gauss_bench.metrics import driving_forces
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory

TEMPLATES = Path(gauss_bench.__file__).parent / "studio" / "templates"


def cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def meeting(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return the point at which the line through a and b meets the line through c and d."""
    return a + (b - a) * cross(c - a, d - c) / cross(b - a, d - c)


def by_names(mechanism: Mechanism, q: Array) -> dict[frozenset[str], Array | None]:
    """Return the names of two links -> their instant centre (2,), None if they only translate against each other."""
    return {frozenset(mechanism.link_name(i) for i in x.links): x.at for x in centres(mechanism, q)}


def driven(name: str | Path, samples: int, scenario: str = "driven") -> tuple[Mechanism, Trajectory]:
    mechanism = load(name, scenario)
    t = np.linspace(0.0, mechanism.duration, samples)
    motion = loop_motion(mechanism, t)
    return mechanism, Trajectory(t, motion.q, motion.v, motion.a, 0)


def test_any_three_centres_of_the_eight_bar_lie_in_a_line() -> None:
    mechanism = load("eight_bar")
    found = {x.links: x.at for x in centres(mechanism, mechanism.q0)}
    assert len(found) == 28
    for a, b, c in combinations(range(GROUND, 7), 3):
        three = [found[a, b], found[b, c], found[a, c]]
        if all(x is not None and np.abs(x).max() < 10 for x in three):
            p, r, s = three
            assert abs(cross(r - p, s - p)) < 1e-9 * max(1.0, float(np.abs(three).max()) ** 2)


def test_a_slider_has_its_centre_at_infinity_across_its_guide() -> None:
    mechanism, motion = driven("crank_slider", 9)
    (found,) = (x for x in centres(mechanism, motion.q[1]) if x.links == (GROUND, 2))
    assert found.at is None
    assert found.along is not None
    assert np.abs(found.along) == pytest.approx([1.0, 0.0], abs=1e-12)
    rod = next(x for x in centres(mechanism, motion.q[1]) if x.links == (GROUND, 1))
    pin, slider = (position(motion.q[1], mechanism.find_point(x)) for x in ("crank.A", "slider.B"))
    assert rod.at == pytest.approx(meeting(np.zeros(2), pin, slider, slider + np.array([0.0, 1.0])), abs=1e-10)


def test_more_freedom_than_one_has_no_centres_of_its_own() -> None:
    mechanism = load("five_bar")
    with pytest.raises(ValueError, match="2 free motions"):
        centres(mechanism, mechanism.q0)


def test_the_advantage_of_a_toggle_is_half_the_cotangent() -> None:
    """Arms of one length l at an angle from the line: the knee's arm turns by d theta, the ram falls 2 l sin(theta) d theta."""
    mechanism, motion = driven(TEMPLATES / "toggle_press.toml", 13)
    upper = next(i for i, x in enumerate(mechanism.links) if x.name == "upper")
    told = {x.output: x for x in advantages(mechanism, motion.q)}
    angle = motion.q[:, 3 * upper + 2] + np.pi / 2
    across_knee = (
        told["press"].mechanical / told["upper"].mechanical * 0.2 * np.cos(angle)
    )  # (d theta / d s) of unit force over the arm
    assert np.abs(across_knee) == pytest.approx(np.abs(0.5 / np.tan(angle)), rel=1e-9)


def test_at_a_dead_centre_the_advantage_is_infinite() -> None:
    mechanism = load("crank_slider")
    (told,) = advantages(mechanism, mechanism.q0[None])
    assert np.isinf(told.mechanical[0])
    assert abs(told.velocity[0]) < 1e-12


def test_driving_torque_of_the_crank_slider_by_virtual_work() -> None:
    """tau omega = d/dt kinetic energy + power into gravity and spring, from the motion of three bodies on paper."""
    mechanism, motion = driven("crank_slider", 61)
    r, length, omega = 0.15, 0.56, 2 * np.pi
    theta = motion.q[:, 2]
    beta = -np.arcsin(r * np.sin(theta) / length)
    beta_1 = -r * np.cos(theta) * omega / (length * np.cos(beta))
    beta_2 = (r * np.sin(theta) * omega**2 + length * np.sin(beta) * beta_1**2) / (length * np.cos(beta))
    pin = r * np.exp(1j * theta)
    arm = length * np.exp(1j * beta)
    x_1 = (1j * omega * pin + 1j * beta_1 * arm).real
    x_2 = (-(omega**2) * pin + (1j * beta_2 - beta_1**2) * arm).real
    g_1, g_2 = 1j * omega * pin + 0.5j * beta_1 * arm, -(omega**2) * pin + 0.5 * (1j * beta_2 - beta_1**2) * arm
    inertia = 0.77 * length**2 / 12
    power = 0.77 * (g_1.conj() * g_2).real + inertia * beta_1 * beta_2 + 0.1 * x_1 * x_2
    power += 9.81 * (0.37 * 0.5 * r * np.cos(theta) * omega + 0.77 * g_1.imag)
    power -= (5.0 * (0.71 - (pin + arm).real) - 1.0 * x_1) * x_1
    assert driving_forces(Evaluator(mechanism), motion)[:, 0] == pytest.approx(power / omega, abs=1e-11)


def test_the_other_assembly_of_a_four_bar_is_the_mirrored_triangle() -> None:
    mechanism, motion = driven("four_bar", 9)
    for q in motion.q[:3]:
        found = branches(mechanism, q)
        assert len(found) == 2
        assert np.abs(found[0] - q).max() < 1e-12
        B, C, D = (position(q, mechanism.find_point(x)) for x in ("crank.B", "coupler.C", "ground.D"))
        line = (D - B) / np.hypot(*(D - B))
        mirrored = B + 2 * line * ((C - B) @ line) - (C - B)
        assert position(found[1], mechanism.find_point("coupler.C")) == pytest.approx(mirrored, abs=1e-12)
        assert np.abs((found[1] - q)[2::3]).max() <= np.pi


def test_branches_of_what_is_not_held_are_refused() -> None:
    mechanism = load("five_bar")
    with pytest.raises(ValueError, match="1 of its motions stay free"):
        branches(load("five_bar", "spring"), mechanism.q0)


def test_centres_of_a_four_bar_by_kennedys_construction() -> None:
    mechanism, motion = driven("four_bar", 13)
    for q in motion.q[1:-1]:
        found = by_names(mechanism, q)
        A, B, C, D = (position(q, mechanism.find_point(x)) for x in ("ground.A", "crank.B", "coupler.C", "rocker.D"))
        assert len(found) == 6
        for links, at in (
            (("ground", "crank"), A),
            (("crank", "coupler"), B),
            (("coupler", "rocker"), C),
            (("ground", "rocker"), D),
        ):
            assert np.abs(found[frozenset(links)] - at).max() < 1e-13
        for links, at in ((("ground", "coupler"), meeting(A, B, D, C)), (("crank", "rocker"), meeting(A, D, B, C))):
            if np.abs(at).max() < 10:
                assert found[frozenset(links)] == pytest.approx(at, abs=1e-9)


def test_velocity_ratio_of_a_four_bar_by_its_centres_and_advantage_its_inverse() -> None:
    """omega_rocker / omega_crank = AP / DP with P the centre of crank and rocker, on the frame line."""
    mechanism, motion = driven("four_bar", 25)
    (told,) = advantages(mechanism, motion.q)
    assert (told.input, told.output, told.units) == ("crank", "rocker", ("rad", "rad"))
    for q, ratio in zip(motion.q, told.velocity, strict=True):
        at = by_names(mechanism, q)[frozenset(("crank", "rocker"))]
        assert at is not None
        assert ratio == pytest.approx(at[0] / (at[0] - 0.4), rel=1e-9)
    assert told.mechanical * told.velocity == pytest.approx(1.0)
    assert told.velocity == pytest.approx(motion.v[:, 8] / motion.v[:, 2], rel=1e-9)


@pytest.mark.parametrize(("rod", "output"), [(0.26, 0.22), (0.5, 0.5)])
def test_assemblies_of_a_six_bar_are_counted_as_its_circles_meet(rod: float, output: float) -> None:
    """Each assembly of the first four-bar allows two of the second where E is within reach of both its bars, else none."""
    document, _, _ = document_of(TEMPLATES / "watt_six_bar.toml")
    document["links"]["rod"]["points"]["F"], document["links"]["output"]["points"]["F"] = [rod, 0.0], [output, 0.0]
    mechanism = load_document(document, "driven")
    q = mechanism.q0
    B, C, D, E, G = (position(q, mechanism.find_point(x)) for x in ("crank.B", "coupler.C", "ground.D", "ternary.E", "ground.G"))
    line = (D - B) / np.hypot(*(D - B))
    mirrored = B + 2 * line * ((C - B) @ line) - (C - B)
    other = complex(*D) + complex(*(mirrored - D)) / complex(*(C - D)) * complex(*(E - D))
    expected = sum(2 for x in (complex(*E), other) if abs(rod - output) < abs(x - complex(*G)) < rod + output)
    assert expected == (2 if rod < 0.5 else 4)
    assert len(branches(mechanism, q)) == expected
