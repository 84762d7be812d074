"""The second of two computations that certify a reference motion: collocation of order 20 in long double, in absolute coordinates.

The unknowns of a step are the accelerations and multipliers x_i = [a_i, lambda_i] at ten Gauss nodes. With the positions q_i = q +
c_i h v + h^2 (A A a)_i and the velocities v_i = v + h (A a)_i, they must satisfy at every node

    M a_i + J(q_i)^T lambda_i = Q(q_i, v_i),    J(q_i) a_i = gamma(q_i, v_i)

The unknowns are found by corrections x_i += P_i r_i, with the residuals r_i of these equations in long double, and the inverse P_i
of [M J^T; J 0] in double precision. Each correction refines the solution of the linear system, and is also a fixed-point iteration
of the states at the nodes. After every step the state is projected onto the constraints, so that nothing drifts.

The steps between two samples are equal. They are halved until the Legendre coefficients of the accelerations in a step decrease to
RESOLVED; the error of Gauss quadrature is about the square of the last ones. A step ends wherever a derivative of a motion law
jumps.

Sources: Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), sections IV.4 and VIII.6; Hairer and Wanner, Solving
Ordinary Differential Equations II (1996), sections IV.8 (when to stop) and VII.2 (projection); Trefethen, Approximation Theory and
Approximation Practice (2013), chapters 8 (coefficients) and 19 (quadrature).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.closure import list_held
from gauss_bench.linkage.references import drivers_of
from gauss_bench.mechanism.evaluate import Constraints, Evaluator, Rows
from gauss_bench.reference.collocation import NoConvergence, Tableau, gauss_tableau, step_count
from gauss_bench.reference.motion import Motion, Progress, assemble_doubles, find_breaks
from gauss_bench.reference.refinement import EPS, SaddleInverse, Unsolved, correct, pseudo_inverse, saddle_residual, solve_by_chord
from gauss_bench.terms import Array

LONG = np.longdouble
MANTISSA = 60  # long double needs more bits than this; on some platforms it has no more than double
SINGULAR = 1e-9  # least relative singular value: its inverse square, the condition of the multipliers, exceeds a double's digits
STAGES = 10
ITERATIONS = 40  # largest number of corrections in a step
SETTLED = 1e-15  # relative size of corrections that are rounding if they do not shrink
HALVINGS = 8  # largest number of times that steps are halved
RESOLVED = 1e-9  # largest size of the last coefficients relative to the accelerations: the error of a step is below the square
SMOOTH = 1e-13  # size of the last coefficients below which steps twice as long suffice: their coefficients are 2^9 times as large
MOVED = 1e-2  # relative size of a correction after which the inverse is computed again
HOPELESS = 0.1  # relative size of a correction that is too large after PATIENCE corrections
PATIENCE = 6
NEAR = 1e-3  # relative singular value below which messages say that a singular position is near


def extend_motion(
    document: dict[str, Any], scenario: str, times: Sequence[str], step: float, progress: Progress | None = None
) -> Motion:
    """Integrate the motion in long double; return its states at the sample times.

    If the integration fails after the start, such as at a singular position, the motion ends at the last sample before the failure.

    Args:
        document: the linkage file with decimals kept as text, after the scenario's `override` has been merged into it.
        times: sample times as decimal texts [s], ascending from "0".
        step: largest step [s]; steps between two samples are equal, and halved until they resolve the motion.
        progress: function that is called with each sample time that is reached.

    Raises:
        ArithmeticError: long double has no more digits than double here, dry friction acts, or the start is singular.
    """
    bits = np.finfo(LONG).nmant
    if bits <= MANTISSA:
        raise ArithmeticError(f"long double has {bits} bits of mantissa on this platform; more than {MANTISSA} are needed")
    linkage = Linkage(document, scenario)
    samples = {LONG(x) for x in times}
    breaks = {x for driver in drivers_of(document["scenarios"][scenario]) for x in find_breaks(driver, LONG)}
    grid = sorted(samples | {x for x in breaks if 0 < x < max(samples)})
    states: list[tuple[Array, ...]] = []
    stopped = ""
    try:
        for t, (q, v) in zip(grid, collocate_states(linkage, grid, step), strict=True):
            if t in samples:
                states.append((q, v, *linkage.accelerations_and_multipliers(t, q, v)))
                if progress:
                    progress(float(t))
    except ArithmeticError as error:
        if not states:
            raise
        stopped = str(error)
    q, v, a, multipliers = (np.array([state[k] for state in states]) for k in range(4))
    rows = linkage.rows(np.array([LONG(x) for x in times[: len(q)]]), q, v)
    rate = (rows.J @ v[..., None])[..., 0] + rows.phi_t
    value, when = linkage.nearest  # the nearest approach to a singular position
    near = f"; nearest to a singular position at {when:.4g} s (relative singular value {value:.1e})" if value < NEAR else ""
    return Motion(
        times=tuple(times[: len(q)]),
        q=q,
        v=v,
        a=a,
        multipliers=None if linkage.rank < rows.phi.shape[-1] else multipliers,
        drift=(float(np.abs(rows.phi).max(initial=0.0)), float(np.abs(rate).max(initial=0.0))),
        stopped=stopped,
        method=f"absolute coordinates in long double ({np.finfo(LONG).nmant + 1} bits); Gauss-Legendre collocation of order 20 "
        f"with projection, steps of at most {step:g} s; numpy {np.__version__}{near}",
    )


class Linkage:
    """A mechanism in long double, with the data for its linear systems.

    Attributes:
        rank: rank of the constraint Jacobian J M^(-1/2); all further singular values differ from zero only by rounding.
        nearest: smallest relative singular value so far, and the time [s] at which it occurred.
        q0, v0: (n,) the start, which satisfies the loops, the knife edges, and the values and rates of coordinates that the
            scenario prescribes.
    """

    def __init__(self, document: dict[str, Any], scenario: str):
        """Build the mechanism, and find its start from the assembly in double precision as the first guess.

        Raises:
            ArithmeticError: dry friction acts, or the start is singular.
        """
        guess = assemble_doubles(document, scenario)
        mechanism = self.mechanism = build_mechanism(document, scenario, "", "", LONG)
        if mechanism.has_friction:
            raise ArithmeticError("the collocation in long double does not support dry friction in joints")
        free = replace(mechanism, drivers=())  # at the start, the scenario's prescribed values `held` take the place of the drivers
        close = Constraints(replace(free, knife_edges=())).residual  # knife edges restrict no positions
        held = list_held(mechanism, document["scenarios"][scenario], LONG)  # prescribed coordinates, with target values and rates

        def gap(q: Array) -> Array:
            """Return the residuals of the loops, and the distances from the values that the start prescribes."""
            return np.concatenate([close(q)[0], held.evaluate(q)[0] - held.target])

        q = guess.q0.astype(LONG)
        q = self.q0 = solve_by_chord(gap, pseudo_inverse(np.vstack([close(q)[1], held.evaluate(q)[1]])), q)
        # velocities: A v = b has the rows of loops and knife edges with b = 0, and the prescribed rates
        A = np.vstack([Constraints(free)(0.0, q, np.zeros_like(q)).J, held.evaluate(q)[1]])
        b = np.concatenate([np.zeros(len(A) - len(held.rate)), held.rate])
        self.v0 = solve_by_chord(lambda v: A @ v - b, pseudo_inverse(A), guess.v0.astype(LONG))
        # independent rows: n - dof of the joints, since `dof` counts no drivers and knife edges, and one for each of these
        self.rank = mechanism.n - guess.dof + len(mechanism.drivers) + len(mechanism.knife_edges)
        self.evaluator, self.nearest = Evaluator(mechanism), (1.0, 0.0)

    def rows(self, t: Any, q: Array, v: Array) -> Rows:
        """Return the constraint rows at one state or several."""
        return self.evaluator.constraints(t, q, v)

    def inverse(self, t: Any, J: Array) -> SaddleInverse:
        """Return the inverse, in double precision, of [M J^T; J 0] for Jacobians J (..., m, n) at one or several times t [s].

        Raises:
            Unsolved: the position is singular.
        """
        solved, when = SaddleInverse(self.evaluator.mass, J, self.rank), float(np.ravel(t)[0])
        if not solved.smallest > SINGULAR:
            raise Unsolved(f"t = {when:.6g} s: singular position (relative singular value {solved.smallest:.1e})")
        self.nearest = min(self.nearest, (solved.smallest, when))
        return solved

    def residual(self, t: Any, q: Array, v: Array, x: Array) -> Array:
        """Return the residual (..., n + m) of the equations of motion for x = [a, lambda] at one state or several."""
        rows = self.rows(t, q, v)
        return saddle_residual(self.evaluator.mass, rows.J, self.evaluator.applied.generalised(q, v), rows.gamma, x)

    def accelerations_and_multipliers(self, t: Any, q: Array, v: Array) -> tuple[Array, Array]:
        """Return accelerations (n,) and multipliers (m,) at one state.

        Raises:
            Unsolved: the position is singular.
        """
        rows = self.rows(t, q, v)
        mass, Q = self.evaluator.mass, self.evaluator.applied.generalised(q, v)
        x = np.zeros(len(q) + len(rows.phi), dtype=LONG)  # [a, lambda]
        x = solve_by_chord(lambda x: -saddle_residual(mass, rows.J, Q, rows.gamma, x), self.inverse(t, rows.J).inverse, x)
        return x[: len(q)], x[len(q) :]

    def project(self, t: Any, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the nearest positions to q, and then the nearest velocities to v, that satisfy the constraints at time t.

        Raises:
            Unsolved: no state nearby satisfies the constraints, or the position is singular.
        """
        holonomic, edges = self.evaluator.constraints.holonomic, len(self.mechanism.knife_edges)
        rows = self.rows(t, q, v)
        # computed once, at the first state, for all iterations (chord iteration)
        for_velocities = for_positions = self.inverse(t, rows.J).lift
        if edges:  # knife edges restrict velocities, but no positions
            for_positions = SaddleInverse(self.evaluator.mass, rows.J[:holonomic], self.rank - edges).lift
        try:
            q = solve_by_chord(lambda x: self.rows(t, x, v).phi[:holonomic], for_positions, q)
            rows = self.rows(t, q, v)
            return q, solve_by_chord(lambda x: rows.J @ x + rows.phi_t, for_velocities, v)
        except Unsolved as error:
            raise Unsolved(f"t = {float(t):.6g} s: the constraints cannot be met ({error})") from error


@dataclass(frozen=True, eq=False)
class Step:
    """A step that has been taken.

    Attributes:
        q, v: (n,) state at the end of the step.
        a: (s, n) accelerations at the nodes of the step.
        h: length of the step [s].
        halvings: number of times that the steps of the present interval between two samples were halved.
        tail: largest of the last two Legendre coefficients of the accelerations, relative to these.
    """

    q: Array
    v: Array
    a: Array
    h: Any
    halvings: int = 0
    tail: float = 0.0


def collocate_states(linkage: Linkage, times: list[Any], step: float) -> Iterator[tuple[Array, Array]]:
    """Integrate from the start at the first time by steps of at most `step` [s]; yield q, v (n,) at each of the times."""
    method, q, v = gauss_tableau(STAGES, LONG), linkage.q0, linkage.v0
    a, _ = linkage.accelerations_and_multipliers(times[0], q, v)
    state = Step(q, v, np.tile(a, (STAGES, 1)), LONG(step))
    yield q, v
    for begin, end in pairwise(times):
        state = _integrate_interval(linkage, method, begin, end, state, step_count(end - begin, step))
        yield state.q, state.v


def _integrate_interval(linkage: Linkage, method: Tableau, begin: Any, end: Any, state: Step, count: int) -> Step:
    """Integrate from one sample to the next in `count` equal steps, which are halved until they resolve the motion.

    Return the last step, with the number of halvings and the largest `tail` of all steps.

    Raises:
        NoConvergence, Unsolved: the steps do not resolve the motion after HALVINGS halvings.
    """
    # a very small `tail` shows that the steps of the interval before were shorter than necessary
    first = state.halvings - 1 if state.tail < SMOOTH else state.halvings
    for halvings in range(max(0, first), HALVINGS + 1):
        steps = count << halvings  # count times 2^halvings
        try:
            h, latest, tail = (end - begin) / steps, state, 0.0
            for k in range(steps):
                latest = _take_step(linkage, method, begin + k * h, h, latest)
                tail = max(tail, latest.tail)
            return replace(latest, halvings=halvings, tail=tail)
        except (NoConvergence, Unsolved) as error:
            last_error = error
    raise last_error


def _take_step(linkage: Linkage, method: Tableau, t: Any, h: Any, state: Step) -> Step:
    """Take a step of length h from the time t, which begins where the previous step `state` ends; return the new step.

    Raises:
        NoConvergence: the accelerations at the nodes are not found, or the nodes do not resolve the accelerations.
        Unsolved: a position is singular, or the end of the step cannot be projected onto the constraints.
    """
    a = _solve_nodes(linkage, method, t, h, state)
    tail = float(np.abs(method.expansion[-2:] @ a).max() / (1.0 + np.abs(a).max()))
    if tail > RESOLVED:
        raise NoConvergence(f"t = {float(t):.6g} s: steps of {float(h):.2g} s resolve the accelerations only to {tail:.1e}")
    q = state.q + h * (state.v + h * (method.bA @ a))
    q, v = linkage.project(t + h, q, state.v + h * (method.b @ a))
    return Step(q, v, a, h, tail=tail)


def _solve_nodes(linkage: Linkage, method: Tableau, t: Any, h: Any, state: Step) -> Array:
    """Return the accelerations (s, n) at the nodes of the step that begins at t and has the length h.

    The first guess of the multipliers is zero, so that redundant constraint rows give multipliers of the smallest norm.

    Raises:
        NoConvergence: the corrections do not shrink to the size of rounding errors.
        Unsolved: the position at a node of the collocation is singular.
    """
    n = len(state.q)
    drift, times = state.q + np.outer(method.c * h, state.v), t + method.c * h
    A, AA = h * method.A, h * h * method.AA
    x = np.zeros((STAGES, n + linkage.evaluator.constraints.m), dtype=LONG)  # [a, lambda] (s, n + m) at the nodes
    x[:, :n] = method.forecast(h / state.h) @ state.a
    size, solved = np.inf, None  # relative size of the last correction of accelerations, and the inverse in use
    for k in range(ITERATIONS):
        q, v = drift + AA @ x[:, :n], state.v + A @ x[:, :n]
        if solved is None or size > MOVED:  # the positions of the nodes have changed too much for the old inverse
            solved = linkage.inverse(times, linkage.rows(times, q, v).J)
        step = correct(solved.inverse, linkage.residual(times, q, v, x))
        x, before = x + step, size
        size = float(np.abs(step[:, :n]).max() / (1.0 + np.abs(x[:, :n]).max()))
        ratio = size / before if k else 1.0  # factor by which corrections shrink: the next one has about size * ratio
        if size * ratio <= EPS or (k > 1 and size < SETTLED and ratio > 0.5):  # the next correction would be rounding
            return x[:, :n]
        if k >= PATIENCE and not size < HOPELESS:  # also if the size is NaN
            break
    near = ""
    if solved and solved.smallest < NEAR:
        near = f", near a singular position (relative singular value {solved.smallest:.1e})"
    raise NoConvergence(f"t = {float(t):.6g} s: steps of {float(h):.2g} s stall at a relative change of {size:.1e}{near}")
