"""Scalar coordinates against differences, and the coordinate by which motions are compared."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from gauss_bench.compiler.elimination.program import generate
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.formulations import FORMULATIONS
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import document_of, load, load_document
from gauss_bench.linkage.schema import TorqueTable
from gauss_bench.mechanism import coordinates
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import (
    GROUND,
    Along,
    Angle,
    Distance,
    Law,
    Load,
    Point,
    PointForce,
    Weighted,
)
from gauss_bench.mechanism.motion_laws import Factor, read_factor
from tests.engine_runs import document, table_of_faults

LINKS = 3
STEP = 1e-4  # fourth-order differences: truncation and rounding both near 1e-12


def points(random):
    return [Point(link, random.normal(size=2), f"{link}") for link in (GROUND, *range(LINKS))]


def every_coordinate():
    random = np.random.default_rng(5)
    ends = [(a, b) for a in points(random) for b in points(random) if a.link != b.link]
    angles = [Angle(a.link, b.link) for a, b in ends]
    return [*angles, *(Along(a, b, random.uniform(-3, 3)) for a, b in ends), *(Distance(a, b) for a, b in ends)]


def derivative(f):
    near, far = f(STEP) - f(-STEP), f(2 * STEP) - f(-2 * STEP)
    return (8 * near - far) / (12 * STEP)


@pytest.mark.parametrize("coordinate", every_coordinate(), ids=lambda c: type(c).__name__)
def test_rate_and_second_rate_are_the_derivatives_of_the_value(coordinate):
    q, v, a = np.random.default_rng(1).normal(size=(3, 3 * LINKS))
    rate = derivative(lambda t: coordinates.value(coordinate, q + v * t))
    second = derivative(lambda t: coordinates.rate(coordinate, q + v * t + a * t * t / 2, v + a * t))
    G = coordinates.gradient(coordinate, q)
    assert coordinates.rate(coordinate, q, v) == pytest.approx(rate, abs=1e-9)
    assert G @ v == pytest.approx(coordinates.rate(coordinate, q, v), abs=1e-13)
    assert G @ a + coordinates.bias(coordinate, q, v) == pytest.approx(second, abs=1e-9)


@pytest.mark.parametrize("coordinate", every_coordinate(), ids=lambda c: type(c).__name__)
def test_batches_and_long_double_are_the_single_state_again(coordinate):
    q, v = np.random.default_rng(2).normal(size=(2, 4, 3 * LINKS))
    for f, arguments in ((coordinates.value, (q,)), (coordinates.gradient, (q,)), (coordinates.bias, (q, v))):
        batch = f(coordinate, *arguments)
        longer = f(coordinate, *(x.astype(np.longdouble) for x in arguments))
        assert longer.dtype == np.longdouble
        np.testing.assert_allclose(batch, [f(coordinate, *x) for x in zip(*arguments, strict=True)], rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(np.asarray(longer, float), batch, rtol=1e-13, atol=1e-13)


@dataclass(frozen=True, eq=False)
class Push:
    """A force of a kind that the suite does not know, given by its loads."""

    name: str
    parts: tuple[Load, ...]
    factor: Factor | None = None

    def to_loads(self):
        return self.parts


def pushed(*parts, factor=None):
    return replace(load("four_bar", "torque"), forces=(Push("push", parts, factor),))


def test_a_law_acts_along_every_coordinate_in_terms_and_kernels():
    """Q is the force of the law times the gradient of its coordinate, and a kernel has the same accelerations."""
    mechanism = load("four_bar", "torque")
    a, b = mechanism.find_point("ground.D"), mechanism.find_point("coupler.P")
    turn = Angle(GROUND, 2)
    along = [turn, Along(a, b, 0.3, across=True), Along(b, a, 0.3), Along(a, b, 0.2, body=0), Distance(a, b)]
    q, v = mechanism.q0, mechanism.v0 + 0.1
    for x in (*along, Weighted(((turn, 0.3), (Distance(a, b), -2.0)))):
        law = Law(x, k=3.0, c=0.5, rest=0.2, bias=0.7, inverse_square=0.04)
        value, rate = coordinates.value(x, q), coordinates.rate(x, q, v)
        force = law.bias - law.k * (value - law.rest) - law.c * rate + law.inverse_square / value**2
        changed = pushed(law)
        forces = AppliedForces(changed)
        np.testing.assert_allclose(forces.generalised(q, v) - forces.gravity, force * coordinates.gradient(x, q), rtol=1e-12)
        # the potential falls by the work of the force and of gravity, but for what the damping dissipates
        fall = -derivative(lambda s, forces=forces: forces.potential(q + s * v))
        assert fall == pytest.approx(forces.generalised(q, v) @ v + law.c * rate**2, abs=1e-8)
        program = generate(changed, "gauss")
        compiled, _ = program.acceleration(np.zeros((1, 1)), q[None], changed.v0[None], program.values)
        np.testing.assert_allclose(
            compiled[0], FORMULATIONS["gauss"](Evaluator(changed).terms(0.0, q, changed.v0)).a, rtol=1e-9, atol=1e-9
        )


def test_the_equation_in_one_coordinate_refuses_a_spring_on_a_sum_of_angles_by_name():
    angles = Weighted(((Angle(GROUND, 2), 0.3), (Angle(GROUND, 0), 1.0)))
    minimal = get("minimal")
    assert "sum of angles (push)" in str(minimal.skip(pushed(Law(angles, k=3.0)), Choice()))
    four_bar = load("four_bar")
    a, b = (four_bar.find_point(x) for x in ("ground.A", "coupler.P"))
    for law in (Law(angles, c=0.1, bias=0.2), Law(Weighted(((Distance(a, b), 0.5), (Angle(GROUND, 0), 0.0))), bias=2.0)):
        mechanism = pushed(law)
        assert minimal.skip(mechanism, Choice()) is None
        found = minimal.build(mechanism, Choice()).acceleration(0.0, mechanism.q0, mechanism.v0)
        np.testing.assert_allclose(
            found, FORMULATIONS["gauss"](Evaluator(mechanism).terms(0.0, mechanism.q0, mechanism.v0)).a, rtol=1e-9, atol=1e-9
        )


def test_a_load_made_of_numbers_of_a_force_is_one_of_a_kernel_too():
    mechanism = load("four_bar", "torque")
    at, values = mechanism.find_point("coupler.P"), np.array([0.0, 4.0])
    computed, given = pushed(PointForce("f", at, values, 1)), replace(mechanism, forces=(PointForce("f", at, values, 1),))
    a, b = (generate(m, "gauss").acceleration(np.zeros((1, 1)), m.q0[None], m.v0[None], np.zeros(0))[0] for m in (computed, given))
    np.testing.assert_allclose(a, b, rtol=1e-12)


def test_a_force_of_another_kind_that_varies_is_refused():
    factor = read_factor({"over_time": {"law": "ramp", "start": 0.1, "time": 0.3}})
    at = load("four_bar").find_point("coupler.P")
    for refused in (lambda: pushed(PointForce("f", at, np.ones(2), 1, factor)), lambda: pushed(factor=factor)):
        with pytest.raises(TypeError, match="force push: only a Torque or a PointForce may vary, not a Push"):
            refused()


def test_a_file_with_such_a_force_is_refused_by_its_field(monkeypatch):
    monkeypatch.setattr(TorqueTable, "read", lambda name, table, names: Push(name, (), read_factor(table)))
    varying = document_of("four_bar")[0] | {"format": "planar-linkage/2"}
    varying["forces"]["motor"]["over_time"] = {"law": "step", "start": 0.1}
    with pytest.raises(LinkageError, match=r"forces\.motor\.over_time: .*only a Torque or a PointForce may vary, not a Push"):
        load_document(varying, "torque", "four_bar.toml")


def slotted(**more):
    """A block on a fixed guide that carries a pendulum, without a crank: the block is the first link and never turns."""
    return document("small/slotted") | more


def test_without_crank_and_driver_the_first_coordinate_that_moves_is_measured():
    measured = load_document(slotted()).measured
    assert (measured.name, measured.unit) == ("angle of bar", "rad")


@pytest.mark.parametrize(
    ("measure", "name", "unit", "value"),
    [
        ({"link": "bar"}, "angle of bar", "rad", np.radians(-60.0)),
        ({"joint": "guide"}, "slide guide", "m", 0.1),
        ({"point": "bar.B"}, "x of bar.B", "m", 0.1 + 0.25),
        ({"point": "bar.B", "angle_deg": 90.0}, "y of bar.B", "m", -0.5 * np.sin(np.radians(60.0))),
        ({"point": "bar.B", "angle": np.pi / 4}, "axis at 45 deg of bar.B", "m", (0.35 - 0.5 * np.sin(np.pi / 3)) / np.sqrt(2)),
        ({"between": ["ground.O", "bar.B"]}, "distance ground.O-bar.B", "m", np.hypot(0.35, 0.5 * np.sin(np.pi / 3))),
    ],
)
def test_a_file_may_name_what_is_measured(measure, name, unit, value):
    mechanism = load_document(slotted(measure=measure))
    measured = mechanism.measured
    assert (measured.name, measured.unit) == (name, unit)
    motion = np.array([mechanism.q0] * 3)
    np.testing.assert_allclose(coordinates.value(measured.coordinate, motion), [value] * 3, rtol=0, atol=1e-12)
    assert mechanism.digest == load_document(slotted()).digest


def test_a_driven_coordinate_goes_before_the_crank():
    document, _, _ = document_of("four_bar")
    assert load_document(document, "torque").measured.name == "angle of crank"
    document["scenarios"]["driven"]["driver"] |= {"link": "rocker"}
    document["scenarios"]["driven"]["driver"] |= {"law": "constant", "start_deg": 100.0, "speed": 0.1}
    assert load_document(document, "driven").measured.name == "angle of rocker"
    assert load("excavator").measured.name == "distance ground.P-boom.A"


@pytest.mark.parametrize(("measure", "fault"), table_of_faults("measures"))
def test_a_measure_that_means_nothing_is_refused(measure, fault):
    with pytest.raises(LinkageError) as error:
        load_document(slotted(measure=measure))
    assert fault in str(error.value)
