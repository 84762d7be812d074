"""A library of planar trees of joints with loops that pins close. It stands for your library and does not use gauss_bench.

Vectors of the plane are complex numbers. Link i hangs on a joint with the coordinate y[i]; link -1 is the ground.
"""

from typing import NamedTuple

import numpy as np


class Joint(NamedTuple):
    """The joint of a link to its parent: a pin, where `near` and `far` coincide, or a slide of `far` from `near` along `axis`."""

    parent: int
    near: complex  # in the parent's frame, from its centre of mass
    far: complex  # in the link's frame
    axis: complex = 0  # direction of a slide in the parent's frame; 0 for a pin
    turn: float = 0.0  # angle of a sliding link in the parent's frame


class Tree(NamedTuple):
    """A tree of n links and the forces on them."""

    joints: list
    masses: list
    inertias: list
    gravity: complex
    pins: list  # pins that close loops: (link, place, link, place)
    pushes: list  # forces at points: (link, place, force, link in whose frame the force is given)
    laws: list  # forces bias - k (x - rest) - c x' along coordinates x: (coordinate as `measure` takes it, k, c, rest, bias)


class Motion(NamedTuple):
    """The motion of n links; the last entry of each array is the ground."""

    place: np.ndarray  # (n + 1,) centres of mass
    angle: np.ndarray  # (n + 1,)
    move: np.ndarray  # (n + 1, n) derivatives of place by y
    turn: np.ndarray  # (n + 1, n) derivatives of angle by y
    spin: np.ndarray  # (n + 1,) rates of angle
    bias: np.ndarray  # (n + 1,) accelerations of place at y'' = 0


def follow(tree, y, dy):
    """Return the motion of all links at coordinates y and rates dy (n,), joint by joint from the ground outwards."""
    n = len(tree.joints)
    place, bias, move = (np.zeros((n + 1, *more), dtype=complex) for more in ((), (), (n,)))
    angle, spin, turn = np.zeros(n + 1), np.zeros(n + 1), np.zeros((n + 1, n))
    for i, (p, near, far, axis, fixed) in enumerate(tree.joints):
        E = np.exp(1j * angle[p])  # turns vectors from the parent's frame into the ground's
        arm = E * (near + axis * y[i])  # from the parent's centre of mass to the joint
        turn[i], spin[i], angle[i] = turn[p], spin[p], angle[p] + fixed
        if not axis:  # a pin
            turn[i, i], spin[i], angle[i] = 1.0, spin[p] + dy[i], angle[p] + y[i]
        back = np.exp(1j * angle[i]) * far  # from the link's centre of mass to the joint
        place[i] = place[p] + arm - back
        move[i] = move[p] + 1j * (arm * turn[p] - back * turn[i])
        move[i, i] += E * axis
        # centripetal accelerations, and the Coriolis acceleration of a slide
        bias[i] = bias[p] - arm * spin[p] ** 2 + 2j * E * axis * spin[p] * dy[i] + back * spin[i] ** 2
    return Motion(place, angle, move, turn, spin, bias)


def point(x, link, local):
    """Return the place of a point of a link, its derivative by y (n,), and its acceleration at y'' = 0."""
    arm = np.exp(1j * x.angle[link]) * local
    return x.place[link] + arm, x.move[link] + 1j * arm * x.turn[link], x.bias[link] - arm * x.spin[link] ** 2


def measure(x, kind, a, *more):
    """Return the value of a coordinate and its derivative by y (n,).

    The coordinate is ("angle", a, b), which is the angle of link b minus that of link a, or (kind, a, place, b, place, frame,
    direction) between a point of link a and a point of link b. Its value is their "distance", or their offset "along" a direction
    in the frame of a link.
    """
    if kind == "angle":
        return x.angle[more[0]] - x.angle[a], x.turn[more[0]] - x.turn[a]
    near, b, far, frame, direction = more
    first, second = point(x, a, near), point(x, b, far)
    gap, change = second[0] - first[0], second[1] - first[1]
    if kind == "distance":
        return abs(gap), (change * gap.conjugate()).real / abs(gap)
    e = np.exp(1j * (x.angle[frame] + direction))  # the direction turns with its frame, which adds the last term below
    return (gap * e.conjugate()).real, (change * e.conjugate()).real + (gap * e.conjugate()).imag * x.turn[frame]


def solve(tree, y, dy, pull=0.0):
    """Return the accelerations (n,) and the forces (pins,) of the closing pins on their second links.

    With the forces F of the pins and their gaps: M y'' = f + J^T F,  J y'' = gamma - 2 pull J y' - pull^2 gap.
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
    forces = np.linalg.lstsq(J @ X, np.hstack([wanted.real, wanted.imag]) - J @ free, rcond=1e-10)[0]  # pins may be redundant
    return free + X @ forces, forces[: len(gap)] + 1j * forces[len(gap) :]


def step(tree, method, y, dy, h, pull):
    """Return the state (2, n) after one step of length h by the method "midpoint" or "rk4"."""

    def rate(state):
        return np.array([state[1], solve(tree, *state, pull)[0]])

    state = np.array([y, dy])
    k1 = rate(state)
    k2 = rate(state + h / 2 * k1)
    if method == "midpoint":
        return state + h * k2
    k3 = rate(state + h / 2 * k2)
    k4 = rate(state + h * k3)
    return state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
