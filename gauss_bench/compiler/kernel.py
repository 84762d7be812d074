"""A linkage compiled for this machine: accelerations, forces, and whole trajectories of one state or of thousands.

kernel = compile_kernel(mechanism, stabilization="projection")
q, v = kernel.rollout(q0, v0, 1e-4, 10_000)

This file combines the rooms: programs are generated (elimination), compiled to machine code (machine) and stepped (stepping).
"""

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from gauss_bench.compiler.elimination.partition import study
from gauss_bench.compiler.elimination.program import KernelError, Program, known_program, partitions
from gauss_bench.compiler.elimination.rank import RankDecision
from gauss_bench.compiler.machine.native_code import Flags, Target, choose_target
from gauss_bench.compiler.stepping.driver import INTEGRATORS, Driver, Tally
from gauss_bench.compiler.stepping.programs import Batch, Outcome, Programs, Stop
from gauss_bench.integrate.fixed_step import EVALUATIONS
from gauss_bench.integrate.legs import Leg, legs
from gauss_bench.mechanism.lines import list_lines, with_lines
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

__all__ = ["Kernel", "KernelError", "compile_kernel"]

STABILIZATIONS = ("none", "baumgarte", "projection")
BAUMGARTE = (20.0, 20.0)  # [1/s] alpha = beta, as elsewhere in the suite


@dataclass(frozen=True)
class Options:
    """Options by which a mechanism becomes code; see compile_kernel."""

    formulation: str
    stabilization: str
    open_parameters: tuple[str, ...]
    independent: tuple[int, ...] | None
    baumgarte: tuple[float, float]
    target: Target


def compile_kernel(
    mechanism: Mechanism,
    formulation: str = "auto",
    stabilization: str = "none",
    open_parameters: tuple[str, ...] = (),
    lanes: int | None = None,
    cache: bool = True,
    backend: str | None = None,
    independent: tuple[int, ...] | None = None,
    baumgarte: tuple[float, float] = BAUMGARTE,
    form: str | None = None,
) -> "Kernel":
    """Compile the kernel of a mechanism.

    Args:
        formulation: "gauss", "lagrange", or "auto" for the one that costs less.
        stabilization: "none", "baumgarte", or "projection" of positions and velocities at each step.
        open_parameters: names of numbers of the file that stay open, such as "links.crank.mass"; given with each call.
        lanes: trajectories in one vector, a power of 2; where None, as many as the host's vectors hold.
        cache: whether search results and object code are kept in the user's cache folder.
        backend: "llvm", or "numpy" without a compiler; None for the first that is installed.
        independent: coordinates of the first partition; chosen where None.
        baumgarte: alpha, beta [1/s].
        form: deprecated, has no effect: all code is straight-line code. Any value gives a warning.

    Raises:
        KernelError: dry friction, an unknown name, or a backend that is not there.
    """
    start = time.perf_counter()
    if stabilization not in STABILIZATIONS:
        raise KernelError(f"no stabilization {stabilization}; there are {', '.join(STABILIZATIONS)}")
    if form is not None:
        warnings.warn("compile_kernel(form=...) has no effect: all code is straight-line code", DeprecationWarning, stacklevel=2)
    target = choose_target(backend, lanes, cache)
    options = Options(formulation, stabilization, tuple(open_parameters), independent, baumgarte, target)
    return Kernel(mechanism, options, "straight line", start)


def _straight_line(mechanism: Mechanism, o: Options) -> Iterator[Program]:
    damping = o.baumgarte if o.stabilization == "baumgarte" else None
    program = partial(known_program, mechanism, open_parameters=o.open_parameters, baumgarte=damping, remembered=o.target.cache)
    first = program(o.formulation, independent=o.independent)
    yield first
    ways: list[tuple[str, tuple[int, ...] | None]] = [(o.formulation, o.independent)]
    ways += [("gauss", p) for p in partitions(mechanism) if ("gauss", p) != (first.formulation, first.independent)]
    ways += [("lagrange", None)] if first.formulation != "lagrange" else []
    for k, ((formulation, independent), drop) in enumerate(product(ways, range(len(study(mechanism).drops)))):
        try:
            if k:
                yield program(formulation, independent=independent, drop=drop)
        except KernelError:
            continue  # not every partition can be eliminated everywhere; the first one could


@dataclass(frozen=True, eq=False)
class Integrated:
    """States at the requested times: q, v (k, n_q), NaN where lost; accepted steps; evaluations of the accelerations."""

    q: Array
    v: Array
    steps: int
    evaluations: int


class Kernel:
    """Compiled code of one mechanism. Times in s, states in the absolute coordinates of the mechanism (SI units).

    Attributes:
        mechanism: what was compiled.
        form: "straight line": there is no other.
        formulation: "gauss" or "lagrange", as chosen.
        parameters: names of the open numbers, in the order of every `parameters` argument.
        backend: "llvm" or "numpy". lanes: trajectories in one vector.
        operations: of one acceleration with its guards.
        dropped: names of redundant rows that were left out.
        generate_seconds: to generate and check the first program.
    """

    def __init__(self, mechanism: Mechanism, options: Options, form: str, start: float):
        self.mechanism, self.options, self.form = mechanism, options, form
        self.backend, self.lanes, self.parameters = options.target.backend, options.target.lanes, options.open_parameters
        self._programs = Programs(_straight_line(mechanism, options), options.stabilization, options.target)
        first = self._programs.codes[0].program
        self.formulation, self.operations = first.formulation, first.acceleration.operations
        self.dropped, self._values, self._n = self._programs.dropped, self._programs.values, mechanism.n
        damping = options.baumgarte if options.stabilization == "baumgarte" else None
        self._rank = RankDecision(mechanism, damping)
        self._driver = Driver(self._programs, self._rank, options.stabilization == "projection", len(self.parameters))
        self._kinks = tuple(sorted({t for _, factor in list_lines(mechanism) for t in factor.kinks}))
        self._programs.prepare("rk4", many=False, extended=False)
        self.generate_seconds = time.perf_counter() - start - self.compile_seconds

    @property
    def compile_seconds(self) -> float:
        """Seconds to compile or load all machine code used so far."""
        return sum(seconds for seconds, _ in self._programs.loaded())

    @property
    def from_cache(self) -> bool:
        """True if all machine code so far was in the cache."""
        return bool(self._programs.loaded()) and all(cached for _, cached in self._programs.loaded())

    @property
    def switches(self) -> int:
        """Changes of partition in the last rollout."""
        return self._driver.tally.switches

    @property
    def fallbacks(self) -> int:
        """Steps of the last rollout by rank decision, because no partition was usable."""
        return self._driver.tally.fallbacks

    @property
    def lost(self) -> int:
        """Trajectories of the last rollout that could not be continued; their states are NaN from there on."""
        return self._driver.tally.lost

    def prepare(self, integrator: str = "rk4", many: bool = False) -> None:
        """Compile ahead all code that rollouts of one state, or of many, may need."""
        self._programs.prepare(integrator, many)

    @property
    def directions(self) -> int:
        """Number of free motions along which the Jacobian of an implicit step is computed."""
        return len(self._programs.partitions[0])

    @property
    def partitions(self) -> tuple[tuple[int, ...], ...]:
        """Independent coordinates of every program generated so far."""
        return self._programs.partitions

    def rollout(
        self,
        q0: Array,
        v0: Array,
        dt: float,
        n: int,
        t0: float = 0.0,
        parameters: Array | None = None,
        every: int | None = None,
        threads: int = 1,
        integrator: str = "rk4",
    ) -> tuple[Array, Array]:
        """Take n steps of dt; a step in which a time-dependent force has a kink or a jump is split there.

        Args:
            q0, v0: (n_q,) or (batch, n_q).
            parameters: (n_parameters,) or (batch, n_parameters); those of the file where None.
            every: steps between samples; only the last state where None.
            threads: that share a batch.
            integrator: "rk4", "semi_implicit_euler", "dop853_fixed", or "gauss_legendre", which is implicit, of order 6, for stiff
                forces along free motions.

        Returns:
            q, v: (n_q,) or (batch, n_q) after the last step; with `every`, (samples, n_q) or (batch, samples, n_q) after `every`,
            2 `every`, ... steps and after the last. A trajectory that cannot go on is not a number from there, and counted in
            `lost`.
        """
        if n < 0 or (every is not None and every < 1) or integrator not in INTEGRATORS:
            raise ValueError(f"cannot take {n} steps of {integrator} with a sample every {every}")
        if self._kinks and n and not dt > 0:
            raise ValueError("a force has kinks in time, and steps over them go forward")
        q = q0 if isinstance(q0, np.ndarray) else np.asarray(q0)  # a conversion costs as much as steps
        v = v0 if isinstance(v0, np.ndarray) else np.asarray(v0)
        self._driver.tally = Tally()
        parts = self.legs(t0, dt, n) if self._kinks else ()
        p = self._values if parameters is None else np.asarray(parameters, dtype=float)
        if q.ndim == 1 and every is None and p.ndim == 1 and len(parts) <= 1:
            if self._kinks or p.shape != self._values.shape:
                p = self._numbers(parameters, 1, _middle(t0, parts))[0]
            state = self._one(q, v, p, t0, dt, n, integrator)
            return state[: self._n], state[self._n :]
        states = np.atleast_2d(np.concatenate([q, v], axis=-1, dtype=float))
        given = self._numbers(parameters, len(states), _middle(t0, parts))
        batch = Batch(states, given, float(t0), float(dt), int(n), max(1, every or n))
        if len(parts) <= 1:
            outcome = self._driver.advance(batch, integrator, threads)
        else:
            by_time = partial(self._numbers, parameters, len(states))
            outcome = self._driver.advance_over(batch, by_time, self._kinks, integrator, threads)
        samples = outcome.samples[:, -1] if every is None else outcome.samples
        samples = samples[0] if q.ndim == 1 else samples
        return samples[..., : self._n], samples[..., self._n :]

    def legs(self, t0: float, dt: float, n: int) -> tuple[Leg, ...]:
        """The steps that a rollout takes: those in which a force has a kink or jumps in parts."""
        return tuple(legs(float(t0), float(dt), int(n), max(1, n), self._kinks))

    def integrate(
        self, q0: Array, v0: Array, times: Array, rtol: float, atol: float, parameters: Array | None = None
    ) -> "Integrated":
        """One state along its motion by DOP853, whose steps keep the estimated error at the tolerances and end at each time.

        Args:
            q0, v0: (n_q,) at the first time.
            times: (k,) at least two, in order.
            rtol, atol: of each component of q and v, whose errors are relative to atol + rtol |component|.

        Raises:
            ValueError: times that are not in order.
        """
        if len(times) < 2 or not (np.diff(times) > 0).all():
            raise ValueError("times must be at least two, in order")
        numbers, at = partial(self._numbers, parameters, 1), np.asarray(times, dtype=float)
        state = np.concatenate([np.asarray(q0, dtype=float), np.asarray(v0, dtype=float)])
        self._driver.tally = Tally()
        samples, taken, tried = self._driver.integrate_over(state, numbers, at, (rtol, atol), self._kinks)
        return Integrated(samples[:, : self._n], samples[:, self._n :], taken, EVALUATIONS["dop853_fixed"] * tried)

    def alone(self, q0: Array, v0: Array, dt: float, n: int, integrator: str = "rk4") -> bool:
        """Tell whether the first program does n steps of one state from t = 0 by itself: no other is generated."""
        q, v, runner = q0, v0, self._programs.runner(0, integrator)
        for leg in self.legs(0.0, dt, n):
            done = runner.run_one(q, v, self._numbers(None, 1, leg.middle)[0], leg.t, leg.h, leg.n)
            if isinstance(done, Stop):
                return False
            q, v = done[: self._n], done[self._n :]
        return True

    def pivots(self, t: Array, q: Array, v: Array) -> Array:
        """Return (k, pivots) the pivots of the first program at k states: between two in which one changes its sign it is zero."""
        numbers = self._numbers(None, len(q), t)
        return self._programs.codes[0].program.acceleration(t[:, None], q, v, numbers)[1]

    def _one(self, q: Array, v: Array, p: Array, t0: float, dt: float, n: int, integrator: str) -> Array:
        """The last state (2 n_q,) of a single trajectory, by the shortest way."""
        end = self._programs.runner(0, integrator).run_one(q, v, p, t0, dt, n)
        if not isinstance(end, Stop):
            return end
        batch = Batch(np.concatenate([q, v], dtype=float)[None], p[None], float(t0), float(dt), int(n), max(1, n))
        stopped = Outcome(end.state[None], np.full((1, 1, 2 * self._n), np.nan), np.array([end.done]), np.zeros(1, bool))
        return np.asarray(self._driver.resume(batch, stopped, integrator).samples[0, -1])

    def _numbers(self, parameters: Array | None, count: int, t: float | Array) -> Array:
        """All open numbers (count, n_p) of states at times () or (count,): those given, or the file's, then those by time."""
        size = len(self.parameters)
        given = self._values[:size] if parameters is None else np.asarray(parameters, dtype=float)
        if given.shape[-1] != size:
            raise ValueError(f"{given.shape[-1]} parameters given, {size} are open: {', '.join(self.parameters)}")
        numbers = np.array(np.broadcast_to(with_lines(self.mechanism, self._values, t), (count, len(self._values))))
        numbers[:, :size] = given
        return numbers

    def acceleration(self, q: Array, v: Array, t: float | Array = 0.0, parameters: Array | None = None) -> Array:
        """Accelerations (n_q,) or (batch, n_q) of one state or of many; where no partition serves, by rank decision.

        They are the linkage's own, without Baumgarte's terms.
        """
        if np.ndim(q) == 1 and parameters is None:
            p = self._numbers(None, 1, t)[0] if self._kinks else self._values
            quick = self._programs.acceleration(float(t), q, v, p)
            if quick is not None:
                return quick
        return self._at_states(self._programs.accelerations, self._rank.acceleration, q, v, t, parameters)

    def forces(self, q: Array, v: Array, t: float | Array = 0.0, parameters: Array | None = None) -> Array:
        """Multipliers (rows,) or (batch, rows) of M a + J^T lambda = Q; what is left out as redundant carries nothing."""
        return self._at_states(self._programs.multipliers, self._rank.multipliers, q, v, t, parameters)

    def energy(self, q: Array, v: Array, parameters: Array | None = None) -> Array:
        """Kinetic plus potential energy [J], () or (batch,)."""
        rows, single = self._rows(q, v, 0.0, parameters)
        energies = self._programs.codes[0].program.energy(*rows[1:])[0][:, 0]
        return np.asarray(energies[0] if single else energies)

    def c_source(self, integrator: str = "rk4") -> str:
        """The first program in plain C: functions `accelerate` and `rollout`."""
        return self._programs.c_source(integrator)

    def _rows(self, q: Array, v: Array, t: float | Array, parameters: Array | None) -> tuple[tuple[Array, ...], bool]:
        single = np.ndim(q) == 1
        q, v = np.atleast_2d(np.asarray(q, dtype=float)), np.atleast_2d(np.asarray(v, dtype=float))
        at = np.broadcast_to(np.asarray(t, dtype=float), len(q))
        return (at, q, v, self._numbers(parameters, len(q), at)), single

    def _at_states(
        self,
        evaluate: Callable[..., tuple[Array, Flags]],
        by_rank: Callable[..., Array],
        q: Array,
        v: Array,
        t: float | Array,
        parameters: Array | None,
    ) -> Array:
        """Evaluate by the first program, and where its pivots fail by another, or by rank decision."""
        at, single = self._rows(q, v, t, parameters)
        values, sound = evaluate(0, *at)
        for row in np.flatnonzero(~sound):
            one = [x[row : row + 1] for x in at]
            k = self._driver.best(float(one[0][0]), np.concatenate([one[1][0], one[2][0]]), one[3][0], {0})
            other, good = evaluate(k, *one) if k is not None else (values[row : row + 1], np.zeros(1, dtype=bool))
            if good[0]:
                values[row] = other[0]
            elif self._driver.nominal(one[3][0]):
                values[row] = by_rank(float(one[0][0]), one[1][0], one[2][0])
            else:
                values[row] = np.nan
        return np.asarray(values[0] if single else values)


def _middle(t: float, parts: Sequence[Leg]) -> float:
    """Return a time at which the open parameters have the values that hold for the only leg, or for the time itself."""
    return parts[0].middle if parts else float(t)
