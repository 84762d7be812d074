"""Planar mechanics that shares no code with the suite: from the tables of a linkage file to its motion.

Newton's and Euler's equations of every link and the second derivatives of its joints, written out here from the numbers of the
file, and one linear system a time:

    M a + J^T lambda = Q,    J a = gamma

with rows and columns scaled by the masses, integrated by scipy's DOP853 at two tolerances. Of the suite only the start is taken,
and refused where it does not close in the equations of this file. Only what linkages by lot have is known: pins, slides, springs
with dampers between two points, and torques.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
GROUND = "ground"
TOLERANCES = (1e-11, 1e-9)
MOST = 5_000  # evaluations of the equations: what needs more is too stiff to be known here
CLOSED = 1e-7  # [m, rad, m/s, rad/s] of a start


class NoMotion(Exception):
    """The motion is not known here; the message says why."""


@dataclass(frozen=True)
class Place:
    """A point at a time: place, its change with the link's angle, velocity, and the part of its acceleration that is known."""

    at: Array
    turned: Array
    velocity: Array
    known: Array


class Mechanics:
    """The equations of a document's linkage, in x, y of each centre of mass and the angle of each link, in the file's order."""

    def __init__(self, document: dict[str, Any], scenario: str):
        self.links, self.ground = document["links"], document["ground"]["points"]
        self.number = {name: i for i, name in enumerate(self.links)}
        self.joints = document["joints"].values()
        forces = document.get("forces", {})
        self.forces = [forces[name] for name in document["scenarios"][scenario].get("forces", [])]
        self.gravity = np.array(document.get("gravity", [0.0, -9.81]))
        self.mass = np.array([[x["mass"], x["mass"], x["inertia"]] for x in self.links.values()]).ravel()
        self.evaluations = 0

    def place(self, name: str, q: Array, v: Array) -> Place:
        owner, _, point = name.partition(".")
        none = np.zeros(2)
        if owner == GROUND:
            return Place(np.array(self.ground[point], dtype=float), none, none, none)
        i, link = 3 * self.number[owner], self.links[owner]
        sx, sy = np.subtract(link["points"][point], link["com"])
        c, s = np.cos(q[i + 2]), np.sin(q[i + 2])
        arm = np.array([c * sx - s * sy, s * sx + c * sy])
        across, spin = np.array([-arm[1], arm[0]]), v[i + 2]
        return Place(q[i : i + 2] + arm, across, v[i : i + 2] + spin * across, -(spin**2) * arm)

    def rows(self, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """What the joints leave open (m,), its Jacobian (m, n), and gamma (m,), where J a = gamma."""
        gap: list[float] = []
        J: list[Array] = []
        gamma: list[float] = []
        n = len(q)

        def put(row: Array, owner: str, force: Array, moment: float) -> None:
            if owner != GROUND:
                i = 3 * self.number[owner]
                row[i : i + 2] += force
                row[i + 2] += moment

        for joint in self.joints:
            if joint["type"] == "revolute":
                first, *others = joint["at"]
                one = self.place(first, q, v)
                for name in others:
                    two = self.place(name, q, v)
                    for axis in np.eye(2):
                        row = np.zeros(n)
                        put(row, name.partition(".")[0], axis, axis @ two.turned)
                        put(row, first.partition(".")[0], -axis, -axis @ one.turned)
                        gap.append(axis @ (two.at - one.at))
                        J.append(row)
                        gamma.append(axis @ (one.known - two.known))
                continue
            guide, block = (joint[x].partition(".")[0] for x in ("guide", "block"))
            one, two = self.place(joint["guide"], q, v), self.place(joint["block"], q, v)
            turn, spin = (q[3 * self.number[guide] + 2], v[3 * self.number[guide] + 2]) if guide != GROUND else (0.0, 0.0)
            angle = turn + joint["angle"]
            along, normal = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
            d, rate = two.at - one.at, two.velocity - one.velocity
            row = np.zeros(n)
            put(row, block, normal, normal @ two.turned)
            put(row, guide, -normal, -normal @ one.turned - along @ d)
            gap.append(normal @ d - joint["offset"])
            J.append(row)
            gamma.append(-normal @ (two.known - one.known) + 2 * spin * along @ rate + spin**2 * normal @ d)
            row = np.zeros(n)
            put(row, block, np.zeros(2), 1.0)
            put(row, guide, np.zeros(2), -1.0)
            gap.append(q[3 * self.number[block] + 2] + joint["block_angle"] - angle)
            J.append(row)
            gamma.append(0.0)
        return np.array(gap), np.array(J), np.array(gamma)

    def loads(self, q: Array, v: Array) -> Array:
        """Forces and torques on the links (n,)."""
        Q = np.zeros(len(q))
        for i in range(len(self.links)):
            Q[3 * i : 3 * i + 2] = self.mass[3 * i] * self.gravity
        for force in self.forces:
            if force["type"] == "torque":
                for link, value in self.torques(force):
                    Q[3 * self.number[link] + 2] += value
                continue
            names = force["between"]
            one, two = (self.place(name, q, v) for name in names)
            d = two.at - one.at
            length = float(np.hypot(*d))
            unit = d / length
            pull = force["k"] * (length - force["rest"]) + force["c"] * float(unit @ (two.velocity - one.velocity))
            for name, place, sign in ((names[0], one, 1.0), (names[1], two, -1.0)):
                owner = name.partition(".")[0]
                if owner != GROUND:
                    i = 3 * self.number[owner]
                    Q[i : i + 2] += sign * pull * unit
                    Q[i + 2] += sign * pull * unit @ place.turned
        return Q

    def torques(self, force: dict[str, Any]) -> list[tuple[str, float]]:
        """The links on which a torque acts, with its value on each."""
        ends = [(force["link"], force["value"]), (force.get("reaction", GROUND), -force["value"])]
        return [(link, value) for link, value in ends if link != GROUND]

    def springs(self, q: Array, v: Array) -> list[tuple[dict[str, Any], float, float]]:
        """Springs with their lengths [m] and the rates of these [m/s]."""
        found = []
        for force in self.forces:
            if force["type"] != "torque":
                one, two = (self.place(name, q, v) for name in force["between"])
                d = two.at - one.at
                length = float(np.hypot(*d))
                found.append((force, length, float(d @ (two.velocity - one.velocity)) / length))
        return found

    def potential(self, q: Array) -> float:
        """Energy [J] of weights and springs."""
        weights = self.mass.reshape(-1, 3)[:, :1] * self.gravity * q.reshape(-1, 3)[:, :2]
        stretched = (0.5 * force["k"] * (length - force["rest"]) ** 2 for force, length, _ in self.springs(q, 0 * q))
        return float(sum(stretched) - weights.sum())

    def torque_work(self, q: Array) -> float:
        """What steady torques have given [J], by the angles that their links have turned from zero."""
        torques = [x for force in self.forces if force["type"] == "torque" for x in self.torques(force)]
        return float(sum(value * q[3 * self.number[link] + 2] for link, value in torques))

    def power(self, q: Array, v: Array) -> float:
        """What dampers take [W], negative."""
        return float(-sum(force["c"] * rate**2 for force, _, rate in self.springs(q, v)))

    def acceleration(self, q: Array, v: Array) -> Array:
        self.evaluations += 1
        if self.evaluations > MOST:
            raise NoMotion(f"more than {MOST} evaluations")
        _, J, gamma = self.rows(q, v)
        root = np.sqrt(self.mass)
        scaled = J / root
        size = np.linalg.norm(scaled, axis=1)
        scaled, right = scaled / size[:, None], gamma / size
        n, m = len(q), len(right)
        whole = np.block([[np.eye(n), scaled.T], [scaled, np.zeros((m, m))]])
        found = np.linalg.solve(whole, np.concatenate([self.loads(q, v) / root, right]))
        return np.asarray(found[:n] / root)

    def motion(self, q: Array, v: Array, until: float, tolerance: float) -> Array:
        """q (n,) at the end, from q and v at the start."""
        n, self.evaluations = len(q), 0

        def rate(t: float, y: Array) -> Array:
            return np.concatenate([y[n:], self.acceleration(y[:n], y[n:])])

        found = solve_ivp(rate, (0.0, until), np.concatenate([q, v]), method="DOP853", rtol=tolerance, atol=tolerance)
        if not found.success:
            raise NoMotion(found.message)
        return np.asarray(found.y[:n, -1])


def true_end(document: dict[str, Any], scenario: str, q: Array, v: Array, until: float) -> tuple[Array, float]:
    """Where the links are in the end (n,), and how far that may be off.

    Raises:
        NoMotion: it is not known, or the start does not close.
    """
    mechanics = Mechanics(document, scenario)
    gap, J, _ = mechanics.rows(q, v)
    opened = max(np.abs(gap).max(), np.abs(J @ v).max())
    if opened > CLOSED:
        raise NoMotion(f"the start is open by {opened:.1e}")
    try:
        with np.errstate(all="ignore"):
            one, other = (mechanics.motion(q, v, until, x) for x in TOLERANCES)
    except (np.linalg.LinAlgError, ValueError, ArithmeticError) as error:
        raise NoMotion(str(error)) from error
    return one, float(np.abs(one - other).max())
