"""References and reference accelerations of a mechanism in its scenario, in double precision.

Two integrators that share no code run the same equations, and their largest disagreement up to each time is the error bar. The
motion of a driven linkage is geometry: it needs no integration, and the error bar is the rounding of the loop closure.
"""

from collections.abc import Callable, Iterable
from functools import partial
from itertools import pairwise

import numpy as np

from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.reference.collocation import BatchAcceleration, gauss_legendre
from gauss_bench.reference.minimal import Levels, MinimalCoordinate
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Samples

Integrator = Callable[[BatchAcceleration, Array, Array, Array], tuple[Array, Array]]  # (a, times, q0, v0) -> q, v (k, n)

INTERVAL = 1e-2  # [s] between samples; both integrators stop there, so that nothing is interpolated
RTOL, ATOL = 1e-13, 1e-14  # tolerances of DOP853
COLLOCATION_STEP = 1.25e-3  # [s] the error after 1 s of the six-bar is 2e-14 rad; with steps of 2.5e-3 s it is 5e-10 rad
ROUNDING = 4 * np.finfo(float).eps  # relative size of the smallest error bar


def sample_times(t_end: float) -> Array:
    """Return the multiples of INTERVAL up to t_end, and t_end itself as the last."""
    count = int(np.floor(t_end / INTERVAL * (1 + 1e-12)))
    times = np.arange(count + 1) * INTERVAL  # products, because sums accumulate rounding
    return times if t_end - times[-1] < 1e-9 else np.append(times, t_end)


def is_minimal(mechanism: Mechanism) -> bool:
    """Tell whether one angle, of the crank or of the driven link, describes the motion."""
    has_angle = mechanism.driver is not None if mechanism.drivers else mechanism.crank is not None
    return has_angle and mechanism.dof == 1 and not mechanism.knife_edges and not mechanism.varying


def build_reference(mechanism: Mechanism, t_end: float) -> Reference:
    """Build the reference from 0 to t_end [s].

    Raises:
        ArithmeticError: an integrator cannot pass a limit of motion or a singular position, or the loads of friction are not
            unique or do not converge.
    """
    times, minimal = sample_times(t_end), is_minimal(mechanism)
    if minimal and mechanism.driver is not None:
        return build_driven(mechanism, times)
    Evaluator(mechanism).check_loads()
    return integrate_twice(mechanism, times, minimal)


def build_driven(mechanism: Mechanism, times: Array) -> Reference:
    """Build the reference of a linkage with a driven angle at times (k,) [s] from its geometry."""
    motion = MinimalCoordinate(mechanism)
    levels = _join(motion.state_at(t) for t in times)  # q, v, a (k, n)
    bar_q, bar_v, bar_a = (ROUNDING * (1 + np.abs(x).max(axis=-1)) for x in levels)
    return _with_bars(times, levels, (bar_q, bar_v, bar_a), "closure of the driven loop by Newton's method")


def _with_bars(times: Array, levels: Levels, bars: Levels, method: str) -> Reference:
    """Return a reference with q, v, a (k, n) and error bars (k,); its floor (`sensitivity`) is unknown, and stored as zero."""
    no_floor = np.zeros(len(times))
    return Reference(times, *levels, *bars, no_floor, no_floor, no_floor, method)


def _join(parts: Iterable[Levels]) -> Levels:
    """Join k triples of q, v, a, each of the shape (1, n), to three arrays q, v, a (k, n)."""
    q, v, a = (np.concatenate(level) for level in zip(*parts, strict=True))
    return q, v, a


def integrate_twice(mechanism: Mechanism, times: Array, minimal: bool) -> Reference:
    """Build a reference by two integrators, DOP853 and Gauss-Legendre collocation, whose difference is the error bar.

    With `minimal` both integrate the crank angle alone, instead of all absolute coordinates.
    """
    motion, coordinates = (minimal_motion, "crank angle") if minimal else (absolute_motion, "absolute coordinates")
    # both integrators restart at every kink of a force; only the samples are returned
    grid = np.union1d(times, [x for x in mechanism.kinks if x < times[-1]])
    sampled = np.searchsorted(grid, times)  # indices of the samples in `grid`
    first, second = motion(mechanism, grid), motion(mechanism, grid, partial(gauss_legendre, step=COLLOCATION_STEP))

    def bar(x: Array, y: Array) -> Array:
        """Return the error bar (k,) at the samples, from two computations x and y (times, n) of q, v or a."""
        gap = np.abs(x - y).max(axis=-1) + ROUNDING * (1 + np.abs(x).max(axis=-1))
        # a bar never shrinks with time: an earlier error persists even at an instant at which the two motions agree by chance
        return np.asarray(np.maximum.accumulate(gap)[sampled])

    q, v, a = (x[sampled] for x in second)
    bar_q, bar_v, bar_a = map(bar, first, second)
    method = f"{coordinates}; DOP853 at 1e-13 against Gauss-Legendre of order 16"
    return _with_bars(times, (q, v, a), (bar_q, bar_v, bar_a), method)


def _adaptive(acceleration: BatchAcceleration, times: Array, q0: Array, v0: Array) -> tuple[Array, Array]:
    """Integrate with scipy's DOP853, which stops at every sample; return q, v (k, n).

    Raises:
        ArithmeticError: the integrator fails, because the motion is singular.
    """
    from scipy.integrate import DOP853  # imported here because the import takes long, and a driven linkage does not need it

    n, just_before_end = len(q0), np.inf  # the loop below sets `just_before_end` for each interval between samples

    def rate(t: float, y: Array) -> Array:
        """Return v and a (2n,); if a force jumps at the end of an interval, its value before the jump is used."""
        return np.concatenate([y[n:], acceleration(np.array([min(t, just_before_end)]), y[None, :n], y[None, n:])[0]])

    y, states, step = np.concatenate([q0, v0]), [np.concatenate([q0, v0])], None
    for start, end in pairwise(times):
        first_step = None if step is None else min(step, end - start)
        just_before_end = np.nextafter(end, start)
        solver = DOP853(rate, start, y, end, first_step=first_step, rtol=RTOL, atol=ATOL)
        while solver.status == "running":
            solver.step()
        if solver.status == "failed":
            raise ArithmeticError(f"DOP853 cannot pass t = {solver.t:.6g} s: the motion is singular there")
        y, step = solver.y, solver.h_abs
        states.append(y)
    rows = np.array(states)
    return rows[:, :n], rows[:, n:]


def minimal_motion(mechanism: Mechanism, times: Array, integrate: Integrator = _adaptive) -> Levels:
    """Return q, v, a (k, n) at the times, integrated in the crank angle from the mechanism's start at times[0]."""
    # two objects, because each starts its search for a closed position at the last one that it found, and integration and
    # sampling visit different positions
    for_integration, for_samples = MinimalCoordinate(mechanism), MinimalCoordinate(mechanism)
    k = for_samples.crank

    def rate(t: Array, q: Array, v: Array) -> Array:
        """Return the crank acceleration (k, 1) at crank angles and speeds (k, 1)."""
        return for_integration.acceleration(q[:, 0], v[:, 0])[:, None]

    theta, w = integrate(rate, times, mechanism.q0[k : k + 1], mechanism.v0[k : k + 1])
    return _join(for_samples.free_state(x, u) for x, u in zip(theta, w, strict=True))


def absolute_motion(mechanism: Mechanism, times: Array, integrate: Integrator = _adaptive) -> Levels:
    """Return q, v, a (k, n) at the times, integrated in absolute coordinates and projected at the samples."""
    motion = AbsoluteCoordinates(mechanism)
    q, v = integrate(motion.acceleration, times, mechanism.q0, mechanism.v0)
    states = [motion.evaluator.project(t, *state) for t, *state in zip(times, q, v, strict=True)]
    q, v = (np.array(x) for x in zip(*states, strict=True))
    return q, v, motion.acceleration(times, q, v)


def random_states(mechanism: Mechanism, count: int = 200, *, speed: float = 30.0) -> Samples:
    """Draw random states on the constraints, with their reference accelerations.

    If one angle describes the linkage, this angle is random, and its speed is uniform in -`speed`..`speed` [rad/s]; if the angle is
    driven, the times are random instead. Any other linkage moves by a random walk, at random times if it has drivers, with
    velocities whose components along a basis of the allowed velocities are random in -3..3.
    """
    rng, minimal = np.random.default_rng(20160315), is_minimal(mechanism)

    def random_times() -> Array:
        """Return increasing random times (count,) [s] within the scenario's duration."""
        return np.sort(rng.uniform(0.0, max(mechanism.duration, INTERVAL), count))

    if minimal and mechanism.driver is not None:
        driven = build_driven(mechanism, random_times())
        return Samples(driven.t, driven.q, driven.v, driven.a)
    Evaluator(mechanism).check_loads()  # with joint friction, redundant constraints would leave the accelerations undetermined
    if minimal:
        motion = MinimalCoordinate(mechanism)
        theta = np.sort(rng.uniform(*motion.angles_reached(), count))
        w = rng.uniform(-speed, speed, count)
        states = (motion.free_state(x, u) for x, u in zip(theta[:, None], w[:, None], strict=True))
        return Samples(np.zeros(count), *_join(states))
    coordinates = AbsoluteCoordinates(mechanism)
    times = random_times() if mechanism.drivers else np.zeros(count)
    q, walk = mechanism.q0, []
    for t in times:  # each position is a small random step away from the last
        basis = coordinates.null_space(q)
        q, _ = coordinates.evaluator.project(t, q + basis @ rng.normal(0.0, 0.05, basis.shape[1]), np.zeros_like(q))
        v = coordinates.null_space(q) @ rng.uniform(-3.0, 3.0, basis.shape[1])
        walk.append(coordinates.evaluator.project(t, q, v) if mechanism.drivers else (q, v))
    q, v = (np.array(x) for x in zip(*walk, strict=True))
    return Samples(times, q, v, coordinates.acceleration(times, q, v))
