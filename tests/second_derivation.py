"""The equations of motion of a linkage a second time: from positions and energies alone, in CasADi's symbols, by differentiation.

    phi(t, q) = 0        pins, slides, drivers
    c(t, q, v) = 0       d phi/dt, and below it the knife edges, which have no position level
    J = dc/dv,           gamma = -(dc/dt + dc/dq v),         so that dc/dt = J a - gamma along a motion
    Q = -dV/dq - dR/dv + f,    V potential energy, R half the power lost in dampers, f what has neither

Nothing of `mechanism/coordinates.py`, `mechanism/equations.py` and the rates in `mechanism/motion_laws.py` is used, on purpose:
what both would share no test could find wrong.
"""

from typing import Any, assert_never

import casadi as ca
import numpy as np

from gauss_bench.engines.casadi.equations import Equations
from gauss_bench.mechanism import model
from gauss_bench.mechanism.model import GROUND
from gauss_bench.mechanism.motion_laws import MotionLaw

Symbol = Any  # casadi.SX, which has no types


def equations(mechanism: model.Mechanism) -> Equations:
    """The equations of a mechanism, whose numbers may be symbols too; dry friction is not among them."""
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", mechanism.n), ca.SX.sym("v", mechanism.n)
    rows = [row for joint in mechanism.joints for row in joint_rows(joint, q)]
    rows += [value(driver.coordinate, q) - prescribed(driver.law, t) for driver in mechanism.drivers]
    phi = ca.vertcat(ca.SX(0, 1), *rows)
    c = ca.vertcat(rate(phi, q, v) + ca.jacobian(phi, t), *(sideways(edge, q, v) for edge in mechanism.knife_edges))
    gravity = ca.vertcat(*mechanism.gravity)
    V = -sum((link.mass * ca.dot(gravity, q[3 * i : 3 * i + 2]) for i, link in enumerate(mechanism.links)), ca.SX(0))
    V += sum((potential(f, q) for f in mechanism.forces), ca.SX(0))
    # Rayleigh's function: half the power lost in dampers
    dampers = [(x, c) for f in mechanism.forces for x, _, c, _ in sprung(f)]
    R = sum((c * rate(value(x, q), q, v) ** 2 / 2 for x, c in dampers), ca.SX(0))
    neither = sum((without_potential(f, q) for f in mechanism.forces), ca.SX(mechanism.n, 1))
    mass = ca.vertcat(*(x for link in mechanism.links for x in (link.mass, link.mass, link.inertia)))
    gamma = -(rate(c, q, v) + ca.jacobian(c, t))
    Q = -ca.gradient(V, q) - ca.gradient(R, v) + neither
    return Equations(t, q, v, phi, c, mass, ca.jacobian(c, v), gamma, Q, V, ca.dot(neither, v) - 2 * R)


def rate(x: Symbol, q: Symbol, v: Symbol) -> Symbol:
    """(dx/dq) v."""
    return ca.jtimes(x, q, v)


def rotate(x: Any, theta: Symbol) -> Symbol:
    return ca.vertcat(ca.cos(theta) * x[0] - ca.sin(theta) * x[1], ca.sin(theta) * x[0] + ca.cos(theta) * x[1])


def angle(q: Symbol, link: int) -> Symbol:
    return ca.SX(0) if link == GROUND else q[3 * link + 2]


def position(q: Symbol, point: model.Point) -> Symbol:
    """(2,) [m]."""
    if point.link == GROUND:
        return ca.SX(ca.DM(point.local))
    return q[3 * point.link : 3 * point.link + 2] + rotate(point.local, angle(q, point.link))


def value(x: model.Coordinate, q: Symbol) -> Symbol:
    """A scalar coordinate [rad, m]."""
    match x:
        case model.Angle():
            return angle(q, x.b) - angle(q, x.a)
        case model.Along():
            axis = rotate((1.0, 0.0), angle(q, x.origin.link) + x.angle)
            return ca.dot(axis, position(q, x.point) - position(q, x.origin))
        case model.Distance():
            return ca.sqrt(ca.sumsqr(position(q, x.b) - position(q, x.a)))
    assert_never(x)


def joint_rows(joint: model.Joint, q: Symbol) -> tuple[Symbol, Symbol]:
    """The two residuals of a joint."""
    if isinstance(joint, model.Revolute):
        gap = position(q, joint.b) - position(q, joint.a)
        return gap[0], gap[1]
    left = value(model.Along(joint.guide, joint.block, joint.angle + np.pi / 2), q)
    return left - joint.offset, value(model.Angle(joint.guide.link, joint.block.link), q) - joint.turn


def freedom(joint: model.Joint) -> model.Coordinate:
    """The coordinate that a joint leaves free: the angle of a pin, or the distance along a slide."""
    if isinstance(joint, model.Revolute):
        return model.Angle(joint.a.link, joint.b.link)
    return model.Along(joint.guide, joint.block, joint.angle)


def sideways(edge: model.KnifeEdge, q: Symbol, v: Symbol) -> Symbol:
    """Velocity of a knife edge across its direction."""
    across = rotate((0.0, 1.0), angle(q, edge.point.link) + edge.angle)
    return ca.dot(across, rate(position(q, edge.point), q, v))


def sprung(f: model.Force) -> list[tuple[model.Coordinate, Any, Any, Any]]:
    """The coordinates x of springs and dampers, with k, c and rest: V = k (x - rest)^2 / 2, R = c x'^2 / 2."""
    match f:
        case model.SpringDamper():
            return [(model.Distance(f.a, f.b), f.k, f.c, f.rest)]
        case model.AxisSpringDamper():
            return [(model.Along(f.origin, f.point, f.angle), f.k, f.c, f.rest)]
        case model.RotationalSpringDamper():
            return [(model.Angle(f.a, f.b), f.k, f.c, f.rest)]
        case model.JointDamping():
            return [(freedom(pair), 0.0, f.c, 0.0) for pair in f.pairs]
        case model.Torque() | model.PointForce():
            return []
    assert_never(f)


def potential(f: model.Force, q: Symbol) -> Symbol:
    """Potential energy of one force [J]."""
    match f:
        case model.Torque():
            return -f.value * value(model.Angle(f.reaction, f.link), q)
        case model.PointForce() if f.frame == GROUND:
            return -ca.dot(ca.vertcat(*f.value), position(q, f.point))
    return sum((k * (value(x, q) - rest) ** 2 / 2 for x, k, _, rest in sprung(f)), ca.SX(0))


def without_potential(f: model.Force, q: Symbol) -> Symbol:
    """Generalised force (n,) of a force that turns with a link."""
    if isinstance(f, model.PointForce) and f.frame != GROUND:
        return ca.jacobian(position(q, f.point), q).T @ rotate(f.value, angle(q, f.frame))
    return ca.SX(*q.shape)


def prescribed(law: MotionLaw, t: Symbol) -> Symbol:
    """A motion law's value at t; its rates are left to differentiation. The ends of a law belong to its motion."""
    made = law.numbers
    if law.name == "constant":
        return made["start"] + made["speed"] * t
    if law.name == "table":
        return made["start"] + splined(made["times"], made["angles"], t)
    s = t / made["time"]
    risen = {
        "sine": s - ca.sin(2 * np.pi * s) / (2 * np.pi),
        "cosine": (1 - ca.cos(np.pi * s)) / 2,
        "poly345": 10 * s**3 - 15 * s**4 + 6 * s**5,
    }[law.name]
    return made["start"] + made["travel"] * ca.if_else(s < 0, 0, ca.if_else(s > 1, 1, risen))


def splined(times: Any, values: Any, t: Symbol) -> Symbol:
    """Cubic spline at rest at both ends and outside."""
    from scipy.interpolate import CubicSpline  # its import takes longer than most runs

    spline = CubicSpline(times, values, bc_type="clamped")
    inner = spline.x[1:-1]
    first, *others = (ca.pw_const(t, inner, ca.DM(c)) if len(inner) else ca.SX(c[0]) for c in (*spline.c, spline.x[:-1]))
    *others, knot = others
    inside = first
    for coefficient in others:
        inside = inside * (t - knot) + coefficient
    return ca.if_else(t < times[0], values[0], ca.if_else(t > times[-1], values[-1], inside))
