"""The equation in one coordinate: right on every dyad and force and through dead centres, refused where one is not enough."""

from dataclasses import replace

import numpy as np
import pytest

from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.minimal import adapter
from gauss_bench.engines.minimal.adapter import Minimal
from gauss_bench.engines.minimal.equation import write_equation
from gauss_bench.linkage.load import load
from gauss_bench.reference.build import random_states
from gauss_bench.trajectory import RunFailure, Status
from tests.conftest import needs
from tests.engine_runs import certified, changed, linkage, open_by, ran, relative_error

ENGINE = Minimal()
LINKAGES = [("crank_slider", "paper"), ("four_bar", "torque"), ("six_bar", "torque"), ("shaper", "torque"), ("jansen", "walk")]
FREE = [*LINKAGES, ("squeezer", "squeeze"), ("dyads", "loaded"), ("small/pendulum", None)]  # a pendulum has no dyad
ROCKERS = {  # none of its links turns round: crank and rocker each have dead centres
    "links.crank.points.B": [0.25, 0.0],
    "links.coupler.points.C": [0.3, 0.0],
    "links.rocker.points.C": [0.2, 0.0],
    "assembly.sketch": {"B": [0.12, 0.2], "C": [0.4, 0.2]},
    "scenarios.conservative.start.crank_deg": 60.0,
}
SHORT_ROD = {  # shorter than the crank, which therefore swings: dead centres of the crank's angle and of the slide
    "links.crank.points.A": [0.3, 0.0],
    "links.rod.points": {"A": [0.0, 0.0], "B": [0.2, 0.0], "P": [0.1, 0.05]},
    "assembly.sketch": {"A": [0.3, 0.0], "B": [0.5, 0.0]},
    "scenarios.conservative.start.crank_deg": 10.0,
    "scenarios.conservative.start.speed": 5.0,
}


needs("llvmlite")


def by_kernel(mechanism, times):
    """Gauss's principle in absolute coordinates, compiled: another derivation, and in hundredths of a second."""
    return ran(get("gauss-native"), mechanism, times, integrator="dop853", tolerance=1e-12)


def with_dead_centres(name):
    return changed("four_bar", "conservative", ROCKERS) if name == "rockers" else changed("crank_slider", "conservative", SHORT_ROD)


@pytest.mark.parametrize(("name", "scenario"), FREE)
def test_accelerations_are_those_of_the_linkage(name, scenario):
    mechanism = linkage(name, scenario)
    model, states = ENGINE.build(mechanism, Choice()), random_states(mechanism, 20)
    for t, q, v, a in zip(states.t, states.q, states.v, states.a, strict=True):
        assert relative_error(model.acceleration(t, q, v), a) < 1e-9  # rounding, amplified by dyads that are nearly stretched


@pytest.mark.parametrize(("name", "scenario"), LINKAGES)
def test_it_moves_as_the_certified_reference_does(name, scenario):
    mechanism = load(name, scenario)
    exact = certified(mechanism, 0.5)
    found = ran(ENGINE, mechanism, exact.t, integrator="dop853_fixed", step=5e-4)
    allowed = 1e-11 + exact.error_q.max() + exact.floor_q.max()
    assert np.abs(found.q - exact.q).max() < 10 * allowed
    assert relative_error(found.a, exact.a) < 1e-9
    assert open_by(mechanism, found) < 1e-14  # nothing drifts
    adaptive = ran(ENGINE, mechanism, exact.t, integrator="dop853", tolerance=1e-11)
    assert np.abs(adaptive.q - exact.q).max() < 1e-8
    assert adaptive.steps < found.steps / 4


@pytest.mark.parametrize(("integrator", "order"), [("rk4", 4), ("semi_implicit_euler", 1)])
def test_errors_fall_by_the_order_of_the_method(integrator, order):
    exact = certified(load("four_bar", "torque"), 0.2)
    runs = [ran(ENGINE, load("four_bar", "torque"), exact.t, integrator=integrator, step=h) for h in (1e-3, 5e-4)]
    coarse, fine = (np.abs(found.q - exact.q).max() for found in runs)
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.1)


@pytest.mark.long("rockers-rk4", "rockers-dop853_fixed")
@pytest.mark.slow("rockers-dop853")
@pytest.mark.parametrize("integrator", ["rk4", "dop853_fixed", "dop853"])
@pytest.mark.parametrize("name", ["rockers", "short_rod"])
def test_dead_centres_are_passed_in_another_coordinate(name, integrator):
    mechanism, times = with_dead_centres(name), np.linspace(0.0, 1.0, 7)
    model = ENGINE.build(mechanism, Choice(integrator=integrator, step=2e-4))
    assert (model.smallest_openings.min(axis=1) < 0.1).all()  # no coordinate is regular everywhere
    expected = by_kernel(mechanism, times)
    found = ran(ENGINE, mechanism, times, integrator=integrator, step=2e-4, tolerance=1e-11)
    assert "changed" in found.note
    if integrator == "rk4":  # the order is kept through changes of coordinate
        coarse = ran(ENGINE, mechanism, times, integrator="rk4", step=4e-4).q
        ratio = np.abs(coarse - expected.q).max() / np.abs(found.q - expected.q).max()
        assert np.log2(ratio) == pytest.approx(4.0, abs=0.5)
    assert np.abs(found.q - expected.q).max() < (1e-5 if integrator == "rk4" else 1e-7)
    assert relative_error(found.v, expected.v) < (1e-4 if integrator == "rk4" else 1e-6)
    assert open_by(mechanism, found) < 1e-13


def test_a_sample_may_fall_on_a_change_of_coordinate():
    """Samples at every step hold the one at which a guard stopped the steps, and all agree with rare ones."""
    mechanism = with_dead_centres("short_rod")
    often = ran(ENGINE, mechanism, np.linspace(0.0, 1.0, 2001), step=5e-4, integrator="rk4")
    rare = ran(ENGINE, mechanism, np.array([0.0, 0.1, 1.0]), step=5e-4, integrator="rk4")
    assert "changed" in often.note
    np.testing.assert_allclose(often.q[[0, 200, 2000]], rare.q, atol=1e-12)
    assert np.abs(np.diff(often.q, axis=0)).max() < 0.05


@pytest.mark.slow
def test_a_spring_on_the_angle_of_a_link_that_dyads_hold_counts_whole_turns():
    """The shaper's lever only swings, the crank turns; a coil between them is wound up turn by turn."""
    coil = {"type": "rotational_spring_damper", "links": ["lever", "crank"], "k": 0.02, "c": 0.005}
    scenario = {"start": {"crank_deg": 0.0, "speed": 20.0}, "duration": 1.0, "forces": ["coil"]}
    mechanism = changed("shaper", "wound", {"forces.coil": coil, "scenarios.wound": scenario})
    times = np.linspace(0.0, 1.0, 5)
    expected = by_kernel(mechanism, times)
    assert np.ptp(expected.q[:, 2]) > 2 * np.pi
    assert np.abs(ran(ENGINE, mechanism, times, integrator="dop853_fixed", step=5e-4).q - expected.q).max() < 1e-9


REFUSED = {
    ("eight_bar", "torque"): "no dyad of pins and slides closes the loops",
    ("parallelogram", "torque"): "redundant constraint rows",
    ("five_bar", "spring"): "2 degrees of freedom",
    ("sleigh", "glide"): "knife edge",
    ("four_bar", "driven"): "prescribed",
    ("friction", None): "dry friction",
}


def test_a_linkage_that_one_coordinate_cannot_describe_is_skipped_with_a_reason():
    for case, reason in REFUSED.items():
        assert reason in str(ENGINE.skip(linkage(*case), Choice()))


def test_a_run_ends_with_a_reason_if_no_coordinate_is_regular():
    """Steps of a fifth of a turn go past every dead centre at once."""
    with pytest.raises(RunFailure, match="smaller step") as failure:
        ran(ENGINE, with_dead_centres("rockers"), np.linspace(0.0, 2.0, 11), integrator="rk4", step=0.2)
    assert failure.value.status is Status.NOT_CONVERGED
    assert np.isfinite(failure.value.reached.q).all(axis=1)[[0, -1]].tolist() == [True, False]


def test_a_derivation_that_is_wrong_is_refused(monkeypatch):
    def wrong(mechanism, *rest):
        links = tuple(replace(link, inertia=1.05 * link.inertia) for link in mechanism.links)
        return write_equation(replace(mechanism, links=links), *rest)

    monkeypatch.setattr(adapter, "write_equation", wrong)
    with pytest.raises(RunFailure, match="differs from the linkage"):
        ENGINE.build(load("four_bar", "torque"), Choice())
