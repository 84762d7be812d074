"""Constraints and forces against automatic differentiation: phi and the energies are written a second time, in symbols."""

import casadi as ca
import numpy as np
import pytest

from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.load import built_in, load
from gauss_bench.mechanism.model import (
    GROUND,
    AxisSpringDamper,
    Force,
    JointDamping,
    Mechanism,
    Point,
    PointForce,
    Prismatic,
    RotationalSpringDamper,
    SpringDamper,
    Torque,
)
from tests.conftest import DATA, everything, redundant

MECHANISMS = [*(load(name) for name in built_in() if name != "excavator"), everything(), redundant(), load("six_bar", "cycloid")]
ROUNDING = 1e-11  # states of size 1 and speeds of size 5 through a dozen operations, relative to entries up to 100


def rotation(theta: ca.SX) -> ca.SX:
    return ca.vertcat(ca.horzcat(ca.cos(theta), -ca.sin(theta)), ca.horzcat(ca.sin(theta), ca.cos(theta)))


def theta(q: ca.SX, link: int) -> ca.SX:
    return 0 if link == GROUND else q[3 * link + 2]


def where(q: ca.SX, point: Point) -> ca.SX:
    if point.link == GROUND:
        return ca.DM(point.local)
    return q[3 * point.link : 3 * point.link + 2] + rotation(theta(q, point.link)) @ ca.DM(point.local)


def along(q: ca.SX, point: Point, origin: Point, angle: float) -> ca.SX:
    axis = rotation(theta(q, origin.link) + angle) @ ca.DM([1.0, 0.0])
    return ca.dot(axis, where(q, point) - where(q, origin))


def residual(mechanism: Mechanism, q: ca.SX) -> ca.SX:
    rows = []
    for joint in mechanism.joints:
        if isinstance(joint, Prismatic):
            left = along(q, joint.block, joint.guide, joint.angle + np.pi / 2)
            turn = theta(q, joint.block.link) - theta(q, joint.guide.link)
            rows += [left - joint.offset, turn - joint.turn]
        else:
            rows.append(where(q, joint.b) - where(q, joint.a))
    return ca.vertcat(*rows)


def coordinates(f: Force, q: ca.SX) -> list[tuple[ca.SX, float, float, float]]:
    """The scalar coordinates a force acts on, with k, c and rest: its generalised force is their gradient times a law."""
    match f:
        case SpringDamper():
            return [(ca.norm_2(where(q, f.b) - where(q, f.a)), f.k, f.c, f.rest)]
        case AxisSpringDamper():
            return [(along(q, f.point, f.origin, f.angle), f.k, f.c, f.rest)]
        case RotationalSpringDamper():
            return [(theta(q, f.b) - theta(q, f.a), f.k, f.c, f.rest)]
        case JointDamping():
            found = []
            for pair in f.pairs:
                slide = isinstance(pair, Prismatic)
                x = along(q, pair.block, pair.guide, pair.angle) if slide else theta(q, pair.b.link) - theta(q, pair.a.link)
                found.append((x, 0.0, f.c, 0.0))
            return found
    return []


def generalised(mechanism: Mechanism, q: ca.SX, v: ca.SX) -> ca.SX:
    Q = ca.SX.zeros(mechanism.n)
    for i, link in enumerate(mechanism.links):
        Q[3 * i : 3 * i + 2] += link.mass * ca.DM(mechanism.gravity)
    for f in mechanism.forces:
        if isinstance(f, Torque):
            Q += f.value * ca.gradient(ca.SX(theta(q, f.link) - theta(q, f.reaction)), q)
        elif isinstance(f, PointForce):
            Q += ca.jacobian(where(q, f.point), q).T @ (rotation(theta(q, f.frame)) @ ca.DM(f.value))
        for x, k, c, rest in coordinates(f, q):
            row = ca.gradient(x, q)
            Q -= row * (k * (x - rest) + c * ca.dot(row, v))
    return Q


@pytest.mark.parametrize("mechanism", MECHANISMS, ids=lambda m: f"{m.name}.{m.scenario}.{m.redundant}")
def test_rows_and_forces_equal_automatic_differentiation(mechanism: Mechanism, rng: np.random.Generator) -> None:
    q, v = ca.SX.sym("q", mechanism.n), ca.SX.sym("v", mechanism.n)
    phi = residual(mechanism, q)
    J = ca.jacobian(phi, q)
    for edge in mechanism.knife_edges:
        normal = rotation(theta(q, edge.point.link) + edge.angle) @ ca.DM([0.0, 1.0])
        J = ca.vertcat(J, normal.T @ ca.jacobian(where(q, edge.point), q))
    gamma = -ca.jtimes(J @ v, q, v)
    symbolic = ca.Function("terms", [q, v], [phi, J, gamma, generalised(mechanism, q, v)])
    evaluator = Evaluator(mechanism)
    rows = evaluator.constraints
    joints = np.r_[: rows.joint_rows, rows.holonomic : rows.m]

    def worst(found: np.ndarray, expected: np.ndarray) -> float:
        return float(np.abs(found - expected).max(initial=0.0))

    for _ in range(20):
        x, u = rng.normal(size=mechanism.n), rng.normal(0.0, 5.0, mechanism.n)
        expected = [np.array(value) for value in symbolic(x, u)]
        terms = evaluator.terms(0.1, x, u)
        assert worst(terms.phi[: rows.joint_rows], expected[0].reshape(-1)) < ROUNDING
        assert worst(terms.J[joints], expected[1]) < ROUNDING
        assert worst(terms.gamma[joints], expected[2][:, 0]) < ROUNDING * 25
        assert worst(terms.Q, expected[3][:, 0]) < ROUNDING * 25


def test_a_driver_is_a_row_with_its_time_terms() -> None:
    mechanism = load("six_bar", "cycloid")
    evaluator = Evaluator(mechanism)
    t, h = 0.3, 1e-5
    row = evaluator.constraints.joint_rows

    def phi(t: float) -> float:
        return float(evaluator.constraints(t, mechanism.q0, mechanism.v0).phi[row])

    rows = evaluator.constraints(t, mechanism.q0, mechanism.v0)
    assert rows.phi_t[row] == pytest.approx((phi(t + h) - phi(t - h)) / (2 * h), rel=1e-8)
    assert rows.gamma[row] == pytest.approx(-(phi(t + h) - 2 * phi(t) + phi(t - h)) / h**2, rel=1e-4)


def test_conservative_forces_are_the_gradient_of_the_potential(rng: np.random.Generator) -> None:
    mechanism = everything("conservative")
    applied = Evaluator(mechanism).applied
    q, h = mechanism.q0 + rng.normal(0.0, 0.1, mechanism.n), 1e-5
    steps = h * np.eye(mechanism.n)
    slope = (applied.potential(q + steps) - applied.potential(q - steps)) / (2 * h)
    assert np.abs(applied.generalised(q, 0 * q) + slope).max() < 1e-7  # second-order differences of energies of 10 J


def test_power_is_what_the_potential_does_not_explain(any_mechanism: Mechanism, rng: np.random.Generator) -> None:
    applied = Evaluator(any_mechanism).applied
    q, v, h = any_mechanism.q0, rng.normal(size=any_mechanism.n), 1e-6
    rate = (applied.potential(q + h * v) - applied.potential(q - h * v)) / (2 * h)
    assert applied.generalised(q, v) @ v + rate == pytest.approx(float(applied.power(q, v)), abs=1e-7)


def test_a_batch_of_states_is_the_states_one_by_one(any_mechanism: Mechanism, rng: np.random.Generator) -> None:
    evaluator = Evaluator(any_mechanism)
    q, v = rng.normal(size=(2, 3, any_mechanism.n)), rng.normal(size=(2, 3, any_mechanism.n))
    rows = evaluator.constraints(0.0, q, v)
    for k in np.ndindex(2, 3):
        one = evaluator.constraints(0.0, q[k], v[k])
        for batch, single in ((rows.phi, one.phi), (rows.J, one.J), (rows.gamma, one.gamma)):
            np.testing.assert_array_equal(batch[k], single)


@pytest.mark.parametrize("linkage", ["excavator", DATA / "pushed.toml"], ids=str)
def test_rows_of_active_bars_and_driven_slides_have_consistent_rates(linkage: str, rng: np.random.Generator) -> None:
    mechanism = load(linkage)
    rows = Evaluator(mechanism).constraints
    driven = slice(rows.joint_rows, rows.holonomic)
    t, h = 0.4, 1e-4
    for _ in range(5):
        q, v, a = (rng.normal(size=mechanism.n) for _ in range(3))

        def at(s: float, q: np.ndarray = q, v: np.ndarray = v, a: np.ndarray = a) -> np.ndarray:
            return rows(t + s, q + s * v + s * s / 2 * a, v).phi[driven]

        here = rows(t, q, v)
        rate, second = (at(h) - at(-h)) / (2 * h), (at(h) - 2 * at(0.0) + at(-h)) / h**2
        assert (
            np.abs((here.J @ v + here.phi_t)[driven] - rate).max() < 1e-6
        )  # differences at h = 1e-4: truncation 1e-8, rounding 1e-8
        assert np.abs((here.J @ a - here.gamma)[driven] - second).max() < 1e-5


def test_active_bars_keep_their_lengths_and_do_the_work() -> None:
    from gauss_bench.api.simulate import simulate

    found = simulate("excavator", "gauss", stabilization="projection", at=[0.0, 1.0, 2.0])
    assert found["status"] == "ok"
    assert found["metrics"]["position_drift"] < 1e-14
    # RK4 at a millisecond leaves some 1e-9 J; where a law ends, its jerk jumps and the quadrature's bar is as large
    assert found["metrics"]["energy_error"] < 1e-9 + 2 * found["metrics"]["energy_error_bar"]
    assert found["metrics"]["energy_error_bar"] < 1e-7
    assert set(found["drivers"]) == {"ground.P-boom.A", "boom.Q-bucket.R"}
