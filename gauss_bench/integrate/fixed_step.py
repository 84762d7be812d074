"""Integrators with steps of a given size: functions that take one step, from t, q, v (n,) to q, v at t + h.

Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I (1993), sections II.1 and, for DOP853, II.5; the
semi-implicit Euler method as in Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), section I.1.2.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np

from gauss_bench.terms import Array

DIFFERENCE = 1e-7  # [rad, m; rad/s, m/s] step of the finite differences that give a Jacobian: about the square root of rounding
NEWTON_STEPS = 20  # largest number of iterations of Newton's method
CONVERGED = 1e-13  # relative change of velocities at which Newton's method ends
ROUNDING = 4 * np.finfo(float).eps  # relative distance below which two times are the same
Acceleration = Callable[[float, Array, Array], Array]  # t, q, v -> a
Step = Callable[[Acceleration, float, Array, Array, float], tuple[Array, Array]]  # acceleration, t, q, v, h -> q, v
Tableau = tuple[list[float], list[Array], Array]  # nodes, rows of A, weights


def rk4(acceleration: Acceleration, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
    """Take a step of the classical Runge-Kutta method: order 4, four evaluations."""
    a1 = acceleration(t, q, v)
    v2 = v + h / 2 * a1
    a2 = acceleration(t + h / 2, q + h / 2 * v, v2)
    v3 = v + h / 2 * a2
    a3 = acceleration(t + h / 2, q + h / 2 * v2, v3)
    v4 = v + h * a3
    a4 = acceleration(t + h, q + h * v3, v4)
    return q + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


def semi_implicit_euler(acceleration: Acceleration, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
    """Take a step of the semi-implicit Euler method: order 1, one evaluation; positions move with the new velocity."""
    v = v + h * acceleration(t, q, v)
    return q + h * v, v


def dop853_fixed(acceleration: Acceleration, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
    """Take a step with the twelve stages of DOP853, without its error estimate: order 8."""
    return explicit_step(dop853_tableau(), acceleration, t, q, v, h)


def explicit_step(tableau: Tableau, acceleration: Acceleration, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
    """Return the state after a step of h [s] by the explicit Runge-Kutta method with the coefficients `tableau`."""
    nodes, rows, weights = tableau
    n, y = len(q), np.concatenate([q, v])
    rates = np.empty((len(weights), 2 * n))  # v and a of each stage
    for k, (node, row) in enumerate(zip(nodes, rows, strict=True)):
        state = y + h * row.dot(rates[:k]) if k else y
        rates[k, :n], rates[k, n:] = state[n:], acceleration(t + node * h, state[:n], state[n:])
    y = y + h * weights.dot(rates)
    return y[:n], y[n:]


def tableau(name: str) -> Tableau:
    """Return the Butcher tableau of the method rk4 or dop853_fixed: nodes (s,), rows of A (row k has k entries), weights (s,)."""
    if name == "rk4":
        rows = [np.array(row) for row in ([], [0.5], [0.0, 0.5], [0.0, 0.0, 1.0])]
        return [0.0, 0.5, 0.5, 1.0], rows, np.array([1.0, 2.0, 2.0, 1.0]) / 6
    return dop853_tableau()


@cache
def dop853_tableau() -> Tableau:
    """Return scipy's coefficients of DOP853: nodes (s,), rows of A (row k has k entries), and weights (s,)."""
    from scipy.integrate import DOP853  # its import takes longer than most runs

    weights = np.ascontiguousarray(DOP853.B)
    rows = [np.ascontiguousarray(row[:k]) for k, row in enumerate(DOP853.A[: len(weights)])]
    return DOP853.C[: len(weights)].tolist(), rows, weights


@cache
def dop853_estimates() -> tuple[Array, Array]:
    """Return the weights (s,) of two error estimates: the differences from the embedded steps of order 5 and of order 3."""
    from scipy.integrate import DOP853

    s = len(DOP853.B)  # scipy has one more weight, 0, for the first stage of the next step
    return np.ascontiguousarray(DOP853.E5[:s]), np.ascontiguousarray(DOP853.E3[:s])


def gauss_legendre(acceleration: Acceleration, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
    """Take a step of Gauss's collocation with three stages: order 6, implicit, stable with arbitrarily stiff springs and dampers.

    Newton's method finds the accelerations of all stages at once, with derivatives by finite differences at the beginning of the
    step.

    Raises:
        LinAlgError: Newton's method does not converge.
    """
    c, A, b = gauss_tableau()
    n, a = len(q), acceleration(t, q, v)
    differences = DIFFERENCE * np.eye(n)
    stiffness = np.transpose([(acceleration(t, q + d, v) - a) / DIFFERENCE for d in differences])  # K = da/dq (n, n)
    damping = np.transpose([(acceleration(t, q, v + d) - a) / DIFFERENCE for d in differences])  # D = da/dv (n, n)
    # the accelerations z (3, n) of the stages solve z = a(q + c h v + h^2 A A z, v + h A z):
    # Newton's matrix is 1 - h^2 A A x K - h A x D (Kronecker products), Hairer and Wanner (1996), section IV.8
    matrix = np.eye(len(c) * n) - h * h * np.kron(A @ A, stiffness) - h * np.kron(A, damping)
    stages = np.tile(a, (len(c), 1))
    for _ in range(NEWTON_STEPS):
        places, speeds = q + h * np.outer(c, v) + h * h * A @ A @ stages, v + h * A @ stages
        evaluations = [acceleration(t + x * h, place, speed) for x, place, speed in zip(c, places, speeds, strict=True)]
        residual = np.array(evaluations) - stages
        change = np.linalg.solve(matrix, residual.ravel()).reshape(residual.shape)
        stages = stages + change
        if h * np.abs(change).max() <= CONVERGED * (1.0 + np.abs(v).max()):
            return q + h * v + h * h * b @ A @ stages, v + h * b @ stages
    raise np.linalg.LinAlgError("the stages of an implicit step do not converge")


STAGES = 3  # number of stages of an implicit step


@cache
def gauss_tableau(stages: int = STAGES) -> tuple[Array, Array, Array]:
    """Return nodes (s,), matrix A (s, s) and weights b (s,) of Gauss's collocation.

    Source: Hairer and Wanner, Solving Ordinary Differential Equations II (1996), section IV.5.
    """
    c = (1 + np.polynomial.legendre.leggauss(stages)[0]) / 2
    powers = np.arange(1, stages + 1)  # A and b integrate c^(k-1) exactly for these k: A c^(k-1) = c^k / k, b c^(k-1) = 1 / k
    inverse = np.linalg.inv(c[:, None] ** (powers - 1))
    return c, (c[:, None] ** powers / powers) @ inverse, (1 / powers) @ inverse


STEPS: dict[str, Step] = {
    "rk4": rk4,
    "semi_implicit_euler": semi_implicit_euler,
    "dop853_fixed": dop853_fixed,
    "gauss_legendre": gauss_legendre,
}
NATIVE_PASSES = 8  # iterations of Newton's method in an implicit step of native code, which does not test for convergence
EVALUATIONS = {  # number of evaluations of the acceleration in a step, without those for the Jacobian of an implicit step
    "rk4": 4,
    "semi_implicit_euler": 1,
    "dop853_fixed": 12,
    "gauss_legendre": 1 + STAGES * NATIVE_PASSES,
}


def step_counts(times: Array, step: float) -> list[tuple[int, float]]:
    """Return the number and the size of the equal steps between each two consecutive times; no step is longer than `step`.

    If the interval between two times is a multiple of `step`, up to rounding of the times, the size of the steps in this interval
    is exactly `step`; otherwise it is smaller.
    """
    counts = []
    for gap, end in zip(np.diff(times), times[1:], strict=True):
        count = max(1, int(np.ceil(gap / step * (1 - 1e-9))))  # a quotient just above an integer counts as that integer
        is_multiple = abs(gap - count * step) <= ROUNDING * end
        counts.append((count, step if is_multiple else float(gap) / count))
    return counts


class EqualSteps(NamedTuple):
    """Consecutive samples with equal steps between them.

    Attributes:
        row: index of the sample before the first sample of this group.
        steps, size: number of steps between two samples, and size of a step [s].
        samples: number of samples of this group.
    """

    row: int
    steps: int
    size: float
    samples: int


def equal_runs(times: Array, step: float) -> list[EqualSteps]:
    """Group consecutive intervals between samples at `times` (k,) [s] that have the same number and size of steps.

    Every interval is divided into equal steps, none longer than `step` [s].
    """
    groups: list[EqualSteps] = []
    row = 0
    # sizes are rounded to 1e-15 s, so that those of equally long intervals are equal
    for (count, size), group in groupby((count, round(size, 15)) for count, size in step_counts(times, step)):
        samples = len(list(group))
        groups.append(EqualSteps(row, count, size, samples))
        row += samples
    return groups


class Stretch(NamedTuple):
    """Consecutive equal steps up to a sample or a kink; no force has a kink or jumps during the steps.

    Attributes:
        begin: start time of the first step [s].
        last: latest time [s] at which a force may be evaluated during the steps. If a force jumps at the end of the last step,
            `last` is just before the jump, so that the force still has its value from before the jump.
        row: index of the sample at the end of the last step; None if the steps end at a kink between samples.
    """

    begin: float
    steps: int
    size: float
    last: float
    row: int | None


def stretches(times: Array, step: float, kinks: Sequence[float] = ()) -> Iterator[Stretch]:
    """Yield stretches, which are runs of equal steps, from the first to the last of the sample times `times` (k,) [s].

    No step is longer than `step` [s]. A step and a stretch end at each sample time and at each time [s] in `kinks`.
    """
    for row, (begin, end) in enumerate(pairwise(times), start=1):
        near = ROUNDING * max(abs(end), abs(begin))  # [s] a kink this near to a sample counts as being at the sample
        ends = [*(t for t in kinks if begin + near < t < end - near), end]
        kink_at_sample = any(abs(t - end) <= near for t in kinks)
        nodes = np.array([begin, *ends])
        for k, (count, size) in enumerate(step_counts(nodes, step)):
            at_sample = k == len(ends) - 1
            boundary = nodes[k + 1] - (near if at_sample else 0.0)  # a kink at a sample may differ from it by rounding
            # no force is evaluated after `last`, so that only the next stretch uses its value after a jump at the boundary
            last = np.inf if at_sample and not kink_at_sample else np.nextafter(boundary, nodes[k])
            yield Stretch(begin=float(nodes[k]), steps=count, size=size, last=float(last), row=row if at_sample else None)


def held_back(acceleration: Acceleration, last: float) -> Acceleration:
    """Return an acceleration evaluated no later than `last` [s]: a force that jumps later keeps its value before the jump."""
    return acceleration if last == np.inf else lambda t, q, v: acceleration(min(t, last), q, v)
