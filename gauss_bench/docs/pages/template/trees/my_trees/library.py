"""A library of planar trees of joints whose loops are closed by pins; it stands for yours, and knows nothing of gauss_bench.

Vectors of the plane are complex numbers. Link i hangs on one joint with one coordinate y[i]; -1 is the ground.
"""

from typing import NamedTuple

import numpy as np


class Joint(NamedTuple):
    """The joint of a link to its parent: a pin at `near` and `far`, or a slide from `near` along `axis` (0 for a pin)."""

    parent: int
    near: complex  # in the parent's frame, from its centre of mass
    far: complex  # in the link's frame
    axis: complex = 0  # in the parent's frame
    turn: float = 0.0  # angle of the link in the parent's frame, of a slide


class Tree(NamedTuple):
    """Joints, masses, inertias (n,); gravity; pins (link, place, link, place) that close loops; what acts.

    A push (link, place, force, frame) is a force in the frame of a link. A law (coordinate, k, c, rest, bias) is the force
    bias - k (x - rest) - c x' along a coordinate x: ("angle", a, b) of link b against link a, or ("distance" or "along", a, place,
    b, place, frame, direction) from a point of link a to one of link b, along a direction in the frame of a link.
    """

    joints: list
    masses: list
    inertias: list
    gravity: complex
    pins: list
    pushes: list
    laws: list


class Motion(NamedTuple):
    """The motion of all links, and of the ground as the last one."""

    place: np.ndarray  # (n + 1,) of centres of mass
    angle: np.ndarray  # (n + 1,)
    move: np.ndarray  # (n + 1, n) derivative of place by y
    turn: np.ndarray  # (n + 1, n) derivative of angle by y
    spin: np.ndarray  # (n + 1,) rate of angle
    bias: np.ndarray  # (n + 1,) acceleration of place at y'' = 0


def follow(tree, y, dy):
    """Return the motion of all links, joint by joint from the ground outwards."""
    n = len(tree.joints)
    place, bias, move = (np.zeros((n + 1, *more), dtype=complex) for more in ((), (), (n,)))
    angle, spin, turn = np.zeros(n + 1), np.zeros(n + 1), np.zeros((n + 1, n))
    for i, (p, near, far, axis, fixed) in enumerate(tree.joints):
        E = np.exp(1j * angle[p])
        arm = E * (near + axis * y[i])
        turn[i], spin[i], angle[i] = turn[p], spin[p], angle[p] + fixed
        if not axis:
            turn[i, i], spin[i], angle[i] = 1.0, spin[p] + dy[i], angle[p] + y[i]
        back = np.exp(1j * angle[i]) * far  # from the centre of mass to the joint
        place[i] = place[p] + arm - back
        move[i] = move[p] + 1j * (arm * turn[p] - back * turn[i])
        move[i, i] += E * axis
        bias[i] = bias[p] - arm * spin[p] ** 2 + 2j * E * axis * spin[p] * dy[i] + back * spin[i] ** 2
    return Motion(place, angle, move, turn, spin, bias)


def point(x, link, local):
    """Return place, derivative (n,) and acceleration at y'' = 0 of a point of a link; the ground's motion is the last."""
    arm = np.exp(1j * x.angle[link]) * local
    return x.place[link] + arm, x.move[link] + 1j * arm * x.turn[link], x.bias[link] - arm * x.spin[link] ** 2


def measure(x, kind, a, *more):
    """Return a coordinate and its derivative (n,)."""
    if kind == "angle":
        return x.angle[more[0]] - x.angle[a], x.turn[more[0]] - x.turn[a]
    near, b, far, frame, direction = more
    first, second = point(x, a, near), point(x, b, far)
    gap, change = second[0] - first[0], second[1] - first[1]
    if kind == "distance":
        return abs(gap), (change * gap.conjugate()).real / abs(gap)
    e = np.exp(1j * (x.angle[frame] + direction))
    return (gap * e.conjugate()).real, (change * e.conjugate()).real + (gap * e.conjugate()).imag * x.turn[frame]


def solve(tree, y, dy, pull=0.0):
    """Return accelerations (n,) and the forces (pins,) of the closing pins on their second links.

    M y'' = f + J^T x,  J y'' = gamma - 2 pull J y' - pull^2 gap
    """
    x, m, inertias = follow(tree, y, dy), np.array(tree.masses), np.array(tree.inertias)
    move, turn = x.move[:-1], x.turn[:-1]
    M = (move.conj().T * m @ move).real + turn.T * inertias @ turn
    f = (move.conj().T @ (m * (tree.gravity - x.bias[:-1]))).real
    for link, local, force, frame in tree.pushes:
        f = f + (point(x, link, local)[1].conj() * force * np.exp(1j * x.angle[frame])).real
    for coordinate, k, c, rest, bias in tree.laws:
        value, row = measure(x, *coordinate)
        f = f + row * (bias - k * (value - rest) - c * row @ dy)
    free = np.linalg.solve(M, f)
    if not tree.pins:
        return free, np.zeros(0, dtype=complex)
    ends = [(point(x, a, near), point(x, b, far)) for a, near, b, far in tree.pins]
    gap, rows, bias = (np.array([second[k] - first[k] for first, second in ends]) for k in range(3))
    J = np.vstack([rows.real, rows.imag])
    wanted = -bias - 2 * pull * (rows @ dy) - pull**2 * gap
    X = np.linalg.solve(M, J.T)
    forces = np.linalg.lstsq(J @ X, np.hstack([wanted.real, wanted.imag]) - J @ free, rcond=1e-10)[0]  # redundant pins too
    return free + X @ forces, forces[: len(gap)] + 1j * forces[len(gap) :]


def step(tree, method, y, dy, h, pull):
    """Return the state after one step: "midpoint" or "rk4"."""

    def rate(state):
        return np.array([state[1], solve(tree, *state, pull)[0]])

    state = np.array([y, dy])
    one = rate(state)
    two = rate(state + h / 2 * one)
    if method == "midpoint":
        return state + h * two
    three = rate(state + h / 2 * two)
    return state + h / 6 * (one + 2 * two + 2 * three + rate(state + h * three))
