"""The loop equations of a linkage with its drivers as inputs, assembled from the contributions of the links.

The variables are angles of links [rad], and coordinates [m] along slides and active bars (bars whose length is an input). A state x
has the TU unknown variables phi, then the TK known variables q, which the drivers prescribe. Links that are joined by slides share
one angle.

A loop is closed if the vectors through its links add up to zero. The link i contributes its vector A_i, the Jacobian J_i of A_i by
the variables of the link, and its time derivative J_i' (see `link_units`). The matrices U_i and K_i, of zeros and ones, move the
columns of J_i to those of the unknown and of the known variables of the linkage. For the loop l of L loops,

    A_l = sum A_i,   J_l = sum J_i U_i,   B_l = sum J_i K_i,   J_l' = sum J_i' U_i,   B_l' = sum J_i' K_i.

The rows of all loops, stacked, are the matrices A, J, B, J', B' of the linkage. The loop equations A = 0 give

    positions A(phi; q) = 0 by Newton's method:   J dphi = -A,   phi += dphi
    velocities:                                   J phi' = -B q'
    accelerations:                                J phi'' = -B q'' - B' q' - J' phi'

All are solved in the least-squares sense, because redundant joints make the equations of the loops dependent. The solution is exact
if J is square.

Source: Wang et al. (2010), eqs. (1)-(5), (9)-(15). The paper prints the stacked matrices of (13)-(15) as a transposed row, in which
the blocks of the loops would be beside, not below, each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.kinematics.link_units import MOVING, LinkPath
from gauss_bench.kinematics.topology import Levels, absolute_states, find_graph, shared_angles
from gauss_bench.linkage.closure import CLOSED
from gauss_bench.mechanism.close import Residual, minimum_norm, project
from gauss_bench.mechanism.coordinates import position, value
from gauss_bench.mechanism.model import GROUND, AngleDriver, Driver, LengthDriver, Mechanism
from gauss_bench.mechanism.spaces import angles
from gauss_bench.terms import Array, largest

NEWTON_STEPS = 12
SETTLED = 1e-9  # [rad, m] largest last Newton step: convergence is quadratic, so that the error left is below rounding
FORKED = 1e-7  # smallest ratio of singular values of J at which assemblies can be distinguished
REGULAR = 1e-4  # smallest such ratio at which rates are computed: rounding over its square leaves them eight digits

# the angle of the link with this index (slides make further links share it), or the coordinate along the slide or bar of this name
Variable = int | str


class Stopped(ArithmeticError):
    """The loops cannot be closed near a state, or J loses rank there; `singular` is True in the second case."""

    def __init__(self, text: str, singular: bool):
        self.singular = singular
        super().__init__(text)


@dataclass(frozen=True, eq=False)
class Matrices:
    """The stacked equations of L loops at a state, with TU unknown and TK known variables.

    Attributes:
        A: (2L,) sums of the vectors around the loops [m], zero if the loops are closed.
        J, J_rate: (2L, TU) Jacobian of A by the unknown variables, and its time derivative.
        B, B_rate: (2L, TK) the same by the known variables.
    """

    A: Array
    J: Array
    B: Array
    J_rate: Array
    B_rate: Array


class LoopEquations:
    """The equations of the L loops of a linkage, for states x (TU + TK,).

    Unknown variables are in the order of the links, then of the slides; known variables in that of the drivers. A driver of a
    length is treated as an active bar: one more link without mass, whose length is a variable (type S of the paper).

    Attributes:
        bars: the drivers of lengths.
        graph: links and pairs of the linkage, with the active bars as links after those of the mechanism.
        variables: the unknown, then the known variables, in the order of x.
        column: variable -> its index in x.
        is_angle: (TU + TK,) True for variables that are angles.
        turning: (links + 1, TU + TK) matrix; turning x + phase are the angles of all links, with the ground last.
        roots, phase: root of each link, and its angle minus that of the root [rad], in the same order; see `shared_angles`.
        offsets: (TK,) driven angle of each input minus that of the root, which is the variable [rad]; 0 for lengths.
        paths: for each loop a list of (path through a link, indices in x of its slides, indices in x of all variables of its
            Jacobian, which are the columns of ones in U and K).
        lengths: (TU,) factors of the columns of J that make derivatives by lengths and by angles comparable.

    Raises:
        ValueError: there are not as many drivers as degrees of freedom; a driver turns a link that cannot turn; two drivers
            prescribe one variable; no joint connects some link to the frame; the linkage has couplings or knife edges.
    """

    def __init__(self, mechanism: Mechanism):
        self.mechanism, self.drivers = mechanism, mechanism.drivers
        if mechanism.couplings:
            self._refuse(f"has the coupling {mechanism.couplings[0].name}, which loop equations do not support")
        if mechanism.knife_edges:
            self._refuse("has knife edges, which loop equations do not support")
        if len(self.drivers) != mechanism.dof:
            self._refuse(f"has {mechanism.dof} degrees of freedom, but {len(self.drivers)} inputs")
        self.bars = [d for d in self.drivers if isinstance(d, LengthDriver)]
        self.graph = find_graph(mechanism, self.bars)
        # link -> (root, phase); a bar shares its angle with no other link
        frames = shared_angles(mechanism) | {i: (i, 0.0) for i in range(len(mechanism.links), self.graph.links)}
        order = [*range(self.graph.links), GROUND]
        self.roots, self.phase = [frames[i][0] for i in order], np.array([frames[i][1] for i in order])
        self.offsets = np.array([self.phase[x.link] if isinstance(x, AngleDriver) else 0.0 for x in self.drivers])
        # one angle for each root; links that slide on the frame share its angle, which is no variable
        variables: list[Variable] = [i for i in range(self.graph.links) if self.roots[i] == i]
        variables += [e.slide for pair in self.graph.pairs for e in pair.elements if e.kind in MOVING]
        self.known = [self._find_variable(x, variables) for x in self.drivers]
        if len(set(self.known)) < len(self.drivers):
            names = [link.name for link in mechanism.links] + [bar.name for bar in self.bars]
            twice = ", ".join(names[x] if isinstance(x, int) else x for x in self.known)
            self._refuse(f"has two inputs for one variable: {twice}")
        self.unknown = [x for x in variables if x not in self.known]
        self.variables = (*self.unknown, *self.known)
        self.column = {x: k for k, x in enumerate(self.variables)}
        self.is_angle = np.array([isinstance(x, int) for x in self.variables])
        self.turning = np.array([[float(x == root) for x in self.variables] for root in self.roots])
        self.paths = [[self._find_columns(path) for path in loop.paths] for loop in self.graph.loops]
        # length of the longest vector through a moving link [m]; 1 m if there is none
        vectors = (path.leave.at - path.enter.at for loop in self.graph.loops for path in loop.paths if path.link != GROUND)
        size = max(map(abs, vectors), default=0.0) or 1.0
        self.lengths = np.where(self.is_angle, 1.0, size)[: len(self.unknown)]

    def _refuse(self, text: str) -> None:
        """Raise ValueError with the name of the linkage."""
        raise ValueError(f"{self.mechanism.name} {text}")

    def _find_variable(self, driver: Driver, variables: Sequence[Variable]) -> Variable:
        """Return the variable that a driver prescribes."""
        variable = self.roots[driver.link] if isinstance(driver, AngleDriver) else driver.name
        if variable not in variables:
            self._refuse(f"cannot be driven at {driver.name!r}, which slides hold at a fixed angle")
        return variable

    def _find_columns(self, path: LinkPath) -> tuple[LinkPath, list[int], list[int]]:
        """Return the path, the indices in x of its slides, and those of all variables of its Jacobian: an entry of `paths`."""
        slides = [self.column[name] for name in path.slides]
        # in the order of the columns of the link unit: the angle of the link's root, then slides
        return path, slides, [self.column[self.roots[path.link]], *slides] if path.turns else slides

    def input_levels(self, times: Array) -> Levels:
        """Return the TK inputs and their first and second time derivatives, (k, TK) each, at times (k,).

        Raises:
            ValueError: a motion law has a value that is not finite.
        """
        # (TK, 3, k) value, rate and second rate of every driver, then (3, k, TK); the shape is given because there may be no driver
        levels = [np.array([np.broadcast_to(x, np.shape(times)) for x in driver.law(times)]) for driver in self.drivers]
        prescribed = np.moveaxis(np.array(levels).reshape(len(levels), 3, len(times)), 0, -1)
        if not np.isfinite(prescribed).all():
            self._refuse("has an input that is not finite")
        # a law gives the angle of the driven link, but the variable is that of its root
        return prescribed[0] - self.offsets, prescribed[1], prescribed[2]

    def input_values(self, x: Array) -> dict[str, float]:
        """Return input -> value in a state x [rad, m], measured as in the motion law of its driver."""
        values = x[len(self.unknown) :] + self.offsets
        return {driver.name: float(value) for driver, value in zip(self.drivers, values, strict=True)}

    def start(self) -> Array:
        """Return the state x at the mechanism's start q0."""
        q = self.mechanism.q0
        values: dict[Variable, float] = {i: float(theta) for i, theta in enumerate(angles(q))}
        for slide in self.mechanism.slides:
            values[slide.name] = float(value(slide.motion, q))
        for i, bar in enumerate(self.bars, start=len(self.mechanism.links)):  # bars are further links
            x, y = position(q, bar.b) - position(q, bar.a)
            values[i], values[bar.name] = float(np.arctan2(y, x)), float(np.hypot(x, y))
        return np.array([values[key] for key in self.column])  # `column` has the order of x

    def evaluate(self, x: Array, x_rate: Array) -> Matrices:
        """Return the matrices of the loop equations at a state x with the time derivative x_rate, (TU + TK,) each."""
        theta, omega = self.turning @ x + self.phase, self.turning @ x_rate
        L, unknowns = len(self.paths), len(self.unknown)
        A, JB, JB_rate = np.zeros(2 * L), np.zeros((2 * L, len(x))), np.zeros((2 * L, len(x)))  # JB: J and B side by side
        for l, paths in enumerate(self.paths):
            rows = slice(2 * l, 2 * l + 2)
            for path, slides, columns in paths:
                unit = path.link_unit(theta[path.link], omega[path.link], x[slides], x_rate[slides])
                A[rows] += unit.vector
                JB[rows, columns] += unit.J
                JB_rate[rows, columns] += unit.J_rate
        return Matrices(A, JB[:, :unknowns], JB[:, unknowns:], JB_rate[:, :unknowns], JB_rate[:, unknowns:])

    def with_inputs(self, inputs: Array) -> Residual:
        """Return the function that returns A (2L,) and J (2L, TU) at unknown variables phi (TU,), with these inputs (TK,)."""
        still = np.zeros(len(self.variables))

        def residual(phi: Array) -> tuple[Array, Array]:
            matrices = self.evaluate(np.concatenate([phi, inputs]), still)
            return matrices.A, matrices.J

        return residual

    def close(self, x: Array) -> tuple[Array, Array, int]:
        """Return the closed state near x with the same inputs, the Jacobian J (2L, TU) there, and the number of Newton steps.

        Raises:
            Stopped: Newton's method does not converge, or J has lost rank at the solution.
        """
        unknowns = len(self.unknown)
        residual = self.with_inputs(x[unknowns:])
        count, last = 0, np.inf  # number of Newton steps, size of the last step

        def has_settled(_: Array, size: Array) -> bool:
            nonlocal count, last
            count, last = count + 1, float(size)
            return not last >= SETTLED  # true for NaN too

        phi = project(x[:unknowns], residual, minimum_norm, NEWTON_STEPS, stop_after=has_settled)
        A, J = residual(phi)
        if last >= SETTLED or not largest(A) < CLOSED:
            raise Stopped("the loops do not close", singular=False)
        self.check_rank(J, FORKED)  # at a fork the loops close, but assemblies cannot be distinguished
        return np.concatenate([phi, x[unknowns:]]), J, count

    def check_rank(self, J: Array, tolerance: float) -> None:
        """Check that every singular value of J (2L, TU) is above `tolerance` times the largest.

        Raises:
            Stopped: J has lost rank, or has fewer rows than columns.
        """
        sizes = np.linalg.svd(J * self.lengths, compute_uv=False) if J.size else np.zeros(0)
        rank = int((sizes > tolerance * sizes.max(initial=0.0)).sum())
        if rank < len(self.unknown):
            raise Stopped(f"the Jacobian has rank {rank} of {len(self.unknown)}", singular=True)

    def rates(self, x: Array, speed: Array, second: Array) -> tuple[Array, Array]:
        """Return the first and second time derivatives (TU + TK,) of a closed state x, from those of the inputs (TK,)."""
        matrices = self.evaluate(x, np.zeros_like(x))
        x_rate = np.concatenate([minimum_norm(matrices.J, -matrices.B @ speed), speed])  # J phi' = -B q'
        matrices = self.evaluate(x, x_rate)  # once more, with the rates: for the time derivatives J' and B'
        # J phi'' = -(B q'' + B' q' + J' phi')
        bias = matrices.B @ second + matrices.B_rate @ speed + matrices.J_rate @ x_rate[: len(self.unknown)]
        return x_rate, np.concatenate([minimum_norm(matrices.J, -bias), second])

    def absolute(self, x: Array, x_rate: Array, x_second: Array) -> Levels:
        """Return q, v, a (k, n) of k states x and their two time derivatives (k, TU + TK)."""
        angles = (x @ self.turning.T + self.phase, x_rate @ self.turning.T, x_second @ self.turning.T)
        slides = {v: (x[:, k], x_rate[:, k], x_second[:, k]) for k, v in enumerate(self.variables) if isinstance(v, str)}
        return absolute_states(self.graph, len(self.mechanism.links), angles, slides)
