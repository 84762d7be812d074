"""The loop equations of a linkage with given inputs, put together from link units.

phi are the unknown and q the known variables: angles of links [rad], one for all links joined by slides, and coordinates along
slides and active bars [m]. A loop l is closed where the vectors of its ways add up to nothing; its matrices are the sums of the
link units A_i, J_i, J_i' put in the columns of their variables by U_i and K_i, and those of all loops stand one below the other:

    A_l = sum A_i,   J_l = sum J_i U_i,   B_l = sum J_i K_i,   Jd_l = sum J_i' U_i,   Bd_l = sum J_i' K_i

    A(phi; q) = 0:   J dphi = -A,   phi += dphi
    J phi' = -B q'
    J phi'' = -B q'' - Bd q' - Jd phi'

All are solved in the least-squares sense, which is the solution itself where J is square, and the common one of consistent
equations where loops repeat each other.
Source: Wang et al., Automated modeling for kinematic analysis of planar linkages based on link units, Trans. CSAM 41(2), 2010,
eqs. (1)-(5), (9)-(15); (13)-(15) print the stack as a transposed row, which would stand the loops side by side.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from gauss_bench.kinematics.inputs import Input
from gauss_bench.kinematics.link_units import MOVING, Way
from gauss_bench.kinematics.topology import Levels, absolute_states, find_graph, shared_angles
from gauss_bench.linkage.closure import CLOSED, RANK_TOLERANCE
from gauss_bench.mechanism.coordinates import position, value
from gauss_bench.mechanism.model import GROUND, LengthDriver, Mechanism, Prismatic
from gauss_bench.terms import Array

NEWTON_STEPS = 12
SETTLED = 1e-9  # [rad, m] last Newton step: convergence is quadratic, so what is left is below rounding
FORKED = 1e-7  # of the largest singular value of J: closer to a singular position, assemblies are not told apart
REGULAR = 1e-4  # the same for rates, whose relative error is rounding over the square of this: eight digits are left
LARGEST_GROUP = 3  # loops; a larger group is not told apart from what follows it, since the sets to try explode


class Stopped(ArithmeticError):
    """There is no closed state here, or (`singular`) J has lost rank at it."""

    def __init__(self, text: str, singular: bool):
        self.singular = singular
        super().__init__(text)


@dataclass(frozen=True)
class Variable:
    """The angle of a link and of all that slides join to it, or the coordinate along a slide or bar (where `link` is None)."""

    name: str
    link: int | None = None

    def __str__(self) -> str:
        return f"s({self.name})" if self.link is None else f"theta({self.name})"


@dataclass(frozen=True, eq=False)
class Matrices:
    """The stacked loop equations at a state: A (2L,), J and J_rate (2L, TU), B and B_rate (2L, TK)."""

    A: Array
    J: Array
    B: Array
    J_rate: Array
    B_rate: Array


@dataclass(frozen=True, eq=False)
class PlacedWay:
    """A way of a loop, the columns of its slides in x (for their values), and U and K of eqs. (9)-(10) side by side (C, TU + TK).

    A row has one 1, in the column of the variable that its column of the unit belongs to.
    """

    way: Way
    slides: list[int]
    factors: Array


@dataclass(frozen=True, eq=False)
class LoopGroup:
    """Loops whose unknowns can only be solved together (an Assur group): rows and columns of J."""

    rows: list[int]
    columns: list[int]


def solve_rows(J: Array, rhs: Array) -> Array:
    """Least-squares solution of J x = rhs."""
    return np.asarray(np.linalg.lstsq(J, rhs, rcond=RANK_TOLERANCE)[0]) if J.size else np.zeros(J.shape[1])


class LoopEquations:
    """The loop equations; states x (TU + TK,) hold the unknown variables, then the known ones.

    Variables stand in the order of the links, then of the slides; the known ones in that of the inputs. An input `joint` may also
    be the name of an active bar of the mechanism's drivers: the bar then is one more link S, without mass.

    Raises:
        ValueError: the inputs are not as many as degrees of freedom, not found, not free or twice the same; a link hangs on
            nothing; the linkage has knife edges.
    """

    def __init__(self, mechanism: Mechanism, inputs: Sequence[Input]):
        self.mechanism, self.inputs = mechanism, inputs
        if mechanism.couplings:
            self._refuse(f"has the coupling {mechanism.couplings[0].name}, which loops know nothing of")
        if mechanism.knife_edges:
            self._refuse("has knife edges, which loops know nothing of")
        if len(inputs) != mechanism.dof:
            self._refuse(f"has {mechanism.dof} degrees of freedom, but the inputs are {len(inputs)}")
        bars = {d.name: d for d in mechanism.drivers if isinstance(d, LengthDriver)}
        self.bars = [bars[x.joint] for x in inputs if x.joint in bars]
        self.graph = find_graph(mechanism, self.bars)
        frames, bars_after = shared_angles(mechanism), range(len(mechanism.links), self.graph.links)
        frames |= {i: (i, 0.0) for i in bars_after}
        order = [*range(self.graph.links), GROUND]
        self.roots, self.phase = [frames[i][0] for i in order], np.array([frames[i][1] for i in order])
        names = [link.name for link in mechanism.links] + [bar.name for bar in self.bars]
        angles = [Variable(names[i], i) for i in range(self.graph.links) if self.roots[i] == i]
        slides = [Variable(e.slide) for pair in self.graph.pairs for e in pair.elements if e.kind in MOVING]
        self.known = [self._driven(x, [*angles, *slides]) for x in inputs]
        if len(set(self.known)) < len(inputs):
            self._refuse(f"has two inputs for one variable: {', '.join(x.name for x in self.known)}")
        self.unknown = [x for x in [*angles, *slides] if x not in self.known]
        self.variables = (*self.unknown, *self.known)
        self.column = {x.name if x.link is None else x.link: k for k, x in enumerate(self.variables)}
        self.is_angle = np.array([x.link is not None for x in self.variables])
        self.turning = np.array([[float(x.link == root) for x in self.variables] for root in self.roots])
        self.ways = [[self._place(p.way(self.roots[p.link] != GROUND)) for p in loop.passages] for loop in self.graph.loops]
        self.lengths = np.where(self.is_angle, 1.0, self._size())[: len(self.unknown)]
        self.groups = self._groups()

    def _refuse(self, text: str) -> None:
        raise ValueError(f"{self.mechanism.name} {text}")

    def _driven(self, given: Input, variables: Sequence[Variable]) -> Variable:
        """The variable that an input prescribes."""
        wanted = None if given.link is None else self.roots[given.link]
        name = given.joint if given.link is None else self.mechanism.link_name(given.link)
        matching = [x for x in variables if x.link == wanted and (wanted is not None or x.name == given.joint)]
        if not matching:
            self._refuse(f"cannot be driven at {name!r}: neither a slide, nor an active bar, nor a link that can turn")
        return matching[0]

    def _size(self) -> float:
        """Return the longest vector through a moving link [m]: it makes columns of J per metre comparable with those per radian."""
        ways = (p.way for loop in self.ways for p in loop if p.way.link != GROUND)
        return max((abs(way.leave.at - way.enter.at) for way in ways), default=0.0) or 1.0

    def _place(self, way: Way) -> PlacedWay:
        own: list[Variable] = [x for x in self.variables if way.turns and x.link == self.roots[way.link]]
        own += [Variable(name) for name in way.slides]
        factors = np.array([[float(c == x) for x in self.variables] for c in own]).reshape(len(own), len(self.variables))
        return PlacedWay(way, [self.column[name] for name in way.slides], factors)

    def input_levels(self, times: Array) -> Levels:
        """Values, rates and second rates (k, TK) of the known variables.

        Raises:
            ValueError: a law is not finite.
        """
        levels = [np.array([np.broadcast_to(x, np.shape(times)) for x in given.law(times)]) for given in self.inputs]
        prescribed = np.moveaxis(np.array(levels).reshape(len(levels), 3, len(times)), 0, -1)
        if not np.isfinite(prescribed).all():
            self._refuse("has an input that is not finite")
        phases = [0.0 if x.link is None else self.phase[x.link] for x in self.inputs]
        return prescribed[0] - np.array(phases), prescribed[1], prescribed[2]

    def input_values(self, x: Array) -> dict[str, float]:
        """Name of each input -> its value in x, as its law counts it [rad, m]."""
        inputs: dict[str, float] = {}
        for given, known in zip(self.inputs, x[len(self.unknown) :], strict=True):
            if given.link is None:
                inputs[str(given.joint)] = float(known)
            else:
                inputs[self.mechanism.link_name(given.link)] = float(known + self.phase[given.link])
        return inputs

    def start(self) -> Array:
        """x of the mechanism's q0."""
        q = self.mechanism.q0
        values: dict[str | int, float] = {i: float(theta) for i, theta in enumerate(q[2::3])}
        for joint in self.mechanism.joints:
            if isinstance(joint, Prismatic):
                values[joint.name] = float(value(joint.motion, q))
        for i, bar in enumerate(self.bars, start=len(self.mechanism.links)):
            x, y = position(q, bar.b) - position(q, bar.a)
            values[i], values[bar.name] = float(np.arctan2(y, x)), float(np.hypot(x, y))
        return np.array([values[key] for key in self.column])

    def at(self, x: Array, x_rate: Array) -> Matrices:
        """Evaluate A and all matrices at a state x and its rate (TU + TK,)."""
        theta, omega = self.turning @ x + self.phase, self.turning @ x_rate
        L, TU = len(self.ways), len(self.unknown)
        A, both, both_rate = np.zeros(2 * L), np.zeros((2 * L, len(x))), np.zeros((2 * L, len(x)))
        for l, ways in enumerate(self.ways):
            rows = slice(2 * l, 2 * l + 2)
            for p in ways:
                unit = p.way.units(theta[p.way.link], omega[p.way.link], x[p.slides], x_rate[p.slides])
                A[rows] += unit.vector
                both[rows] += unit.J @ p.factors
                both_rate[rows] += unit.J_rate @ p.factors
        return Matrices(A, both[:, :TU], both[:, TU:], both_rate[:, :TU], both_rate[:, TU:])

    def close(self, x: Array) -> tuple[Array, Array, int]:
        """Return the closed state near x with the same inputs, its J, and the number of Newton steps.

        Raises:
            Stopped: Newton does not converge, or J has lost rank where it does.
        """
        x, still, TU = x.copy(), np.zeros_like(x), len(self.unknown)
        count, last = 0, np.inf
        while count < NEWTON_STEPS and last >= SETTLED:
            here = self.at(x, still)
            step = solve_rows(here.J, -here.A)
            x[:TU] += step
            count, last = count + 1, float(np.abs(step).max(initial=0.0))
        here = self.at(x, still)
        if last >= SETTLED or not np.abs(here.A).max(initial=0.0) < CLOSED:
            raise Stopped("the loops do not close", False)
        self.check_rank(here.J, FORKED)
        return x, here.J, count

    def check_rank(self, J: Array, tolerance: float) -> None:
        """Raise Stopped if J has singular values below the tolerance, relative to the largest."""
        sizes = np.linalg.svd(J * self.lengths, compute_uv=False) if J.size else np.zeros(0)
        rank = int((sizes > tolerance * sizes.max(initial=0.0)).sum())
        if rank < len(self.unknown):
            raise Stopped(f"the Jacobian has rank {rank} of {len(self.unknown)}", True)

    def rates(self, x: Array, speed: Array, second: Array) -> tuple[Array, Array]:
        """Return rates and second rates of x (TU + TK,) for given ones of the inputs (TK,)."""
        here = self.at(x, np.zeros_like(x))
        x_rate = np.concatenate([solve_rows(here.J, -here.B @ speed), speed])
        here = self.at(x, x_rate)
        bias = here.B @ second + here.B_rate @ speed + here.J_rate @ x_rate[: len(self.unknown)]
        return x_rate, np.concatenate([solve_rows(here.J, -bias), second])

    def absolute(self, x: Array, x_rate: Array, x_second: Array) -> Levels:
        """Return q, v, a (k, n) of states x (k, TU + TK)."""
        angles = (x @ self.turning.T + self.phase, x_rate @ self.turning.T, x_second @ self.turning.T)
        slides = {v.name: (x[:, k], x_rate[:, k], x_second[:, k]) for k, v in enumerate(self.variables) if v.link is None}
        return absolute_states(self.graph, len(self.mechanism.links), angles, slides)

    def _groups(self) -> list[LoopGroup]:
        """Return the smallest sets of loops that can be solved one after the other: no more unknowns than equations in each."""
        TU = len(self.unknown)
        needs = [{int(k) for p in ways for k in np.flatnonzero(p.factors[:, :TU].any(axis=0))} for ways in self.ways]
        left, groups = list(range(len(needs))), []
        while left:
            sets = (c for size in range(1, LARGEST_GROUP + 1) for c in combinations(left, size))
            own = next((c for c in sets if len(set().union(*(needs[l] for l in c))) <= 2 * len(c)), tuple(left))
            columns = set().union(*(needs[l] for l in own))
            groups.append(LoopGroup([2 * l + i for l in own for i in (0, 1)], sorted(columns)))
            left = [l for l in left if l not in own]
            needs = [need - columns for need in needs]
        return groups
