"""The second of two computations that certify a reference motion: collocation of order 20 in long double, in absolute coordinates.

The unknowns of a step are the accelerations and multipliers x_i = [a_i, lambda_i] at ten Gauss nodes. The accelerations determine
the positions q_i = q + c_i h v + h^2 (A A a)_i and the velocities v_i = v + h (A a)_i at the nodes. At every node the unknowns must
satisfy the equations of motion and the constraints:

    M a_i + J(q_i)^T lambda_i = Q(q_i, v_i),    J(q_i) a_i = gamma(q_i, v_i)

The unknowns are found by corrections x_i += P_i r_i, with the residuals r_i of these equations in long double. P_i is the inverse
of the matrix [M J^T; J 0] in double precision, at the position q_i that the polynomial of the previous step predicts. Each
correction is a step of two iterations at once: the iterative refinement of the linear system, and the fixed-point iteration of the
states at the nodes. The corrections converge as fast as the slower of these two iterations. That is usually the fixed-point
iteration, which reduces the error by a factor of about h times the largest rate of the motion. After every step the state is
projected onto the constraints, so that nothing drifts.

The steps between two samples are equal. They are halved until the ten nodes resolve the accelerations, that is, until the Legendre
coefficients of the accelerations in a step decrease to RESOLVED. The error of Gauss quadrature is about the square of the relative
size of the last coefficients. A step ends wherever a derivative of a motion law jumps.

Sources: Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), sections IV.4 and VIII.6; Hairer and Wanner, Solving
Ordinary Differential Equations II (1996), sections IV.8 (when to stop) and VII.2 (projection); Trefethen, Approximation Theory and
Approximation Practice (2013), chapters 8 (coefficients) and 19 (quadrature).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from gauss_bench.linkage.references import drivers_of
from gauss_bench.reference.collocation import NoConvergence, Tableau, gauss_tableau, step_count
from gauss_bench.reference.extended_linkage import LONG, Linkage, check_platform, start
from gauss_bench.reference.motion import Motion, Progress, find_breaks
from gauss_bench.reference.refinement import EPS, Unsolved, correct
from gauss_bench.terms import Array

STAGES = 10
ITERATIONS = 40  # largest number of corrections in a step
SETTLED = 1e-15  # relative size of corrections that are rounding if they do not shrink
HALVINGS = 8  # largest number of times that steps are halved
RESOLVED = 1e-9  # largest size of the last coefficients relative to the accelerations: the error of a step is below its square
SMOOTH = 1e-13  # size of the last coefficients below which steps twice as long, with coefficients 2^9 times as large, resolve too
MOVED = 1e-2  # relative size of a correction after which the inverse is computed again
HOPELESS = 0.1  # relative size of a correction that is too large after PATIENCE corrections
PATIENCE = 6
NEAR = 1e-3  # relative singular value below which messages say that a singular position is near


def extend_motion(
    document: dict[str, Any], scenario: str, times: Sequence[str], step: float, progress: Progress | None = None
) -> Motion:
    """Integrate the motion in long double; return its states at the sample times.

    If the integration fails after the start, such as at a singular position, the motion ends at the last sample before the failure,
    and its attribute `stopped` has the reason.

    Args:
        document: the linkage file with decimals kept as text (`decimal_document`), after the scenario's changes (`override`) have
            been merged into it.
        scenario: name of the scenario.
        times: sample times as decimal texts [s], ascending from "0".
        step: largest step [s]; steps between two samples are equal, and halved where the motion needs it.
        progress: called with each sample time that is reached.

    Raises:
        ArithmeticError: long double has no more digits than double here, dry friction acts, or the start is singular.
    """
    check_platform()
    linkage, q0, v0 = start(document, scenario)
    samples = {LONG(x) for x in times}
    breaks = {x for driver in drivers_of(document["scenarios"][scenario]) for x in find_breaks(driver, LONG)}
    grid = sorted(samples | {x for x in breaks if 0 < x < max(samples)})
    states: list[tuple[Array, ...]] = []
    stopped = ""
    try:
        for t, (q, v) in zip(grid, collocate_states(linkage, grid, q0, v0, step), strict=True):
            if t in samples:
                states.append((q, v, *linkage.accelerations_and_multipliers(t, q, v)))
                if progress:
                    progress(float(t))
    except ArithmeticError as error:
        if not states:
            raise
        stopped = str(error)
    return _sample(linkage, times, states, stopped, step)


@dataclass(frozen=True, eq=False)
class Step:
    """A step that has been taken.

    Attributes:
        q, v: (n,) state at the end of the step.
        a: (s, n) accelerations at the nodes of the step.
        h: length of the step [s].
        halvings: number of times that the steps of the present interval between two samples were halved.
        tail: largest of the last two Legendre coefficients of the accelerations, relative to the accelerations.
    """

    q: Array
    v: Array
    a: Array
    h: Any
    halvings: int = 0
    tail: float = 0.0


def collocate_states(linkage: Linkage, times: list[Any], q: Array, v: Array, step: float) -> Iterator[tuple[Array, Array]]:
    """Integrate by Gauss collocation from q, v at the first of the times; yield q, v (n,) at each of the times.

    `step` is the longest step [s].
    """
    method = gauss_tableau(STAGES, LONG)
    a, _ = linkage.accelerations_and_multipliers(times[0], q, v)
    # the first guess of the accelerations at all nodes of the first step is the acceleration at the start
    state = Step(q, v, np.tile(a, (STAGES, 1)), LONG(step))
    yield q, v
    for begin, end in pairwise(times):
        state = _interval(linkage, method, begin, end, state, step_count(end - begin, step))
        yield state.q, state.v


def _interval(linkage: Linkage, method: Tableau, begin: Any, end: Any, state: Step, count: int) -> Step:
    """Integrate from one sample to the next in `count` equal steps, which are halved until they resolve the motion."""
    # Very small last coefficients of the accelerations' Legendre expansion, `tail`, show that the steps of the interval before were
    # shorter than necessary: then steps twice as long are tried first.
    first = state.halvings - 1 if state.tail < SMOOTH else state.halvings
    for halvings in range(max(0, first), HALVINGS + 1):
        try:
            h, moved, tail = (end - begin) / (count << halvings), state, 0.0
            for k in range(count << halvings):
                moved = _step(linkage, method, begin + k * h, h, moved)
                tail = max(tail, moved.tail)
            return replace(moved, halvings=halvings, tail=tail)
        except (NoConvergence, Unsolved) as error:
            last_error = error
    raise last_error


def _step(linkage: Linkage, method: Tableau, t: Any, h: Any, state: Step) -> Step:
    """Take a step of length h from the time t, which begins where the previous step `state` ends; return the new step.

    Raises:
        NoConvergence: the accelerations at the nodes are not found, or the nodes do not resolve the accelerations.
        Unsolved: a position is singular, or the state at the end of the step cannot be projected onto the constraints.
    """
    a = _nodes(linkage, method, t, h, state)
    tail = float(np.abs(method.expansion[-2:] @ a).max() / (1.0 + np.abs(a).max()))
    if tail > RESOLVED:
        raise NoConvergence(f"t = {float(t):.6g} s: steps of {float(h):.2g} s resolve the accelerations only to {tail:.1e}")
    q = state.q + h * (state.v + h * (method.bA @ a))
    q, v = linkage.project(t + h, q, state.v + h * (method.b @ a))
    return Step(q, v, a, h, tail=tail)


def _nodes(linkage: Linkage, method: Tableau, t: Any, h: Any, state: Step) -> Array:
    """Return the accelerations (s, n) at the nodes of the step that begins at t and has the length h.

    The first guess of the multipliers is zero. If constraint rows are redundant, the result then has the smallest norm among all
    possible multipliers. Zero costs one more correction than a better guess.

    Raises:
        NoConvergence: the corrections do not shrink to the size of rounding errors.
        Unsolved: the position at a node of the collocation is singular.
    """
    n = len(state.q)
    # drift: positions at the nodes without acceleration; A, AA: coefficients by which velocities and positions follow from a
    drift, times = state.q + np.outer(method.c * h, state.v), t + method.c * h
    A, AA = h * method.A, h * h * method.AA
    x = np.zeros((STAGES, n + linkage.evaluator.constraints.m), dtype=LONG)
    x[:, :n] = method.forecast(h / state.h) @ state.a  # (s, n + m)
    size, solved = np.inf, None  # relative size of the last correction of accelerations, and the inverse in use
    for k in range(ITERATIONS):
        q, v = drift + AA @ x[:, :n], state.v + A @ x[:, :n]
        if solved is None or size > MOVED:  # the positions of the nodes have changed too much for the old inverse
            solved = linkage.inverse(times, linkage.rows(times, q, v).J)
        step = correct(solved.inverse, linkage.residual(times, q, v, x))
        x, before = x + step, size
        size = float(np.abs(step[:, :n]).max() / (1.0 + np.abs(x[:, :n]).max()))
        ratio = size / before if k else 1.0  # by which the corrections shrink: the next one will have about size * ratio
        if size * ratio <= EPS or (k > 1 and size < SETTLED and ratio > 0.5):  # the next correction would be rounding
            return x[:, :n]
        if k >= PATIENCE and not size < HOPELESS:  # also if the size is NaN
            break
    near = ""
    if solved and solved.smallest < NEAR:
        near = f", near a singular position (relative singular value {solved.smallest:.1e})"
    raise NoConvergence(f"t = {float(t):.6g} s: steps of {float(h):.2g} s stall at a relative change of {size:.1e}{near}")


def _sample(linkage: Linkage, times: Sequence[str], states: list[tuple[Array, ...]], stopped: str, step: float) -> Motion:
    """Return the motion with k states (q, v, a, multipliers), which belong to the first k of the times.

    Args:
        times: all requested times, decimal texts [s]; stopped: why the motion ends before the last of them, or empty.
        step: longest step [s].
    """
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
