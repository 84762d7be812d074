"""The dynamics of a linkage as native code: accelerations, forces, and trajectories from one state or from thousands.

    kernel = compile_kernel(mechanism, stabilization="projection")
    q, v = kernel.rollout(q0, v0, 1e-4, 10_000)

This file uses the subpackages of the compiler: `elimination` generates programs, `machine` turns them into machine code, and
`stepping` runs their steps.
"""

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import numpy as np

from gauss_bench.compiler.elimination.partition import study
from gauss_bench.compiler.elimination.program import KernelError, Program, known_program, partitions
from gauss_bench.compiler.elimination.rank import RankDecision
from gauss_bench.compiler.machine.code import Code
from gauss_bench.compiler.machine.native_code import Flags, Target, choose_target
from gauss_bench.compiler.machine.source import C_HEADER, write_c
from gauss_bench.compiler.stepping.driver import INTEGRATORS, Driver, Tally
from gauss_bench.compiler.stepping.programs import Batch, Outcome, Programs, Stop
from gauss_bench.compiler.stepping.rollout import acceleration, plain_body, rollout
from gauss_bench.integrate import BAUMGARTE_RATE, STABILIZATIONS
from gauss_bench.integrate.fixed_step import EVALUATIONS
from gauss_bench.integrate.legs import Leg, legs
from gauss_bench.mechanism.lines import list_lines, with_lines
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

__all__ = ["Kernel", "KernelError", "compile_kernel"]

BAUMGARTE = (BAUMGARTE_RATE, BAUMGARTE_RATE)  # [1/s] alpha, beta


@dataclass(frozen=True)
class Options:
    """The options of `compile_kernel`, which explains them."""

    formulation: str
    stabilization: str
    open_parameters: tuple[str, ...]
    independent: tuple[int, ...] | None
    damping: tuple[float, float] | None  # alpha and beta [1/s] under Baumgarte's stabilisation
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
        open_parameters: names of numbers of the linkage file whose values are given with each call, such as "links.crank.mass".
        lanes: number of trajectories in one SIMD vector, a power of 2; if None, the number of doubles in the widest vector register
            of this machine.
        cache: whether object code and the result of the search for a cheap elimination are kept in the user's cache folder.
        backend: "llvm", or "numpy", which needs no compiler; if None, llvm is used if it is installed, else numpy.
        independent: indices of the independent coordinates of the first program; if None, the search for a cheap elimination
            chooses the independent coordinates. Further programs with other independent coordinates are generated on demand.
        baumgarte: alpha and beta [1/s] of Baumgarte's stabilisation.
        form: deprecated and without effect, because all generated code is straight-line code; any value but None gives a warning.

    Raises:
        KernelError: dry friction, an unknown name, no usable pivots, a failed check of the code, or a backend not installed.
    """
    start = time.perf_counter()
    if stabilization not in STABILIZATIONS:
        raise KernelError(f"no stabilization {stabilization}; there are {', '.join(STABILIZATIONS)}")
    if form is not None:
        warnings.warn("compile_kernel(form=...) has no effect: all code is straight-line code", DeprecationWarning, stacklevel=2)
    target = choose_target(backend, lanes, cache)
    damping = baumgarte if stabilization == "baumgarte" else None
    options = Options(formulation, stabilization, tuple(open_parameters), independent, damping, target)
    return Kernel(mechanism, options, "straight line", start)


def _generate_programs(mechanism: Mechanism, o: Options) -> Iterator[Program]:
    """Yield the requested program, then alternative programs for states at which a pivot of the requested program is too small."""

    def generate(formulation: str, independent: tuple[int, ...] | None, drop: int) -> Program:
        """Return a program that leaves out the redundant constraint rows with the index `drop` in `Study.drops`."""
        return known_program(mechanism, formulation, o.open_parameters, independent, o.damping, drop, o.target.cache)

    first = generate(o.formulation, o.independent, 0)
    yield first
    # formulation and independent coordinates of each program
    choices: list[tuple[str, tuple[int, ...] | None]] = [(o.formulation, o.independent)]
    choices += [("gauss", p) for p in partitions(mechanism) if ("gauss", p) != (first.formulation, first.independent)]
    if first.formulation != "lagrange":
        choices.append(("lagrange", None))
    for choice in choices:
        for drop in range(len(study(mechanism).drops)):
            if choice == choices[0] and drop == 0:
                continue  # this is the first program
            with suppress(KernelError):  # there is no program for this choice
                yield generate(*choice, drop)


@dataclass(frozen=True, eq=False)
class Integrated:
    """A trajectory with step size control.

    Attributes:
        q, v: (k, n_q) states at the requested times, NaN where the trajectory is lost.
        steps: number of accepted steps.
        evaluations: number of evaluations of the acceleration, including those of rejected steps.
    """

    q: Array
    v: Array
    steps: int
    evaluations: int


class Kernel:
    """Compiled code of one mechanism. Times are in s, states in the absolute coordinates of the mechanism (SI units).

    Attributes:
        mechanism: the mechanism that was compiled.
        form: always "straight line".
        formulation: "gauss" or "lagrange", as chosen.
        parameters: names of the open parameters, in the order of every argument `parameters`. Open parameters are numbers of the
            linkage file for which each call may give new values, because they are not constants in the code.
        backend: "llvm" or "numpy".
        lanes: number of trajectories in one SIMD vector.
        operations: number of operations in one evaluation of the acceleration with its guards (tests of the pivots).
        dropped: names of redundant constraint rows that the first program leaves out.
        generate_seconds: time [s] to generate and check the first program.
    """

    def __init__(self, mechanism: Mechanism, options: Options, form: str, start: float):
        """Generate the first program and compile its step; `start` is the time of `perf_counter` when `compile_kernel` began."""
        self.mechanism, self.options, self.form = mechanism, options, form
        self.backend, self.lanes, self.parameters = options.target.backend, options.target.lanes, options.open_parameters
        self._programs = Programs(_generate_programs(mechanism, options), options.stabilization, options.target)
        first = self._programs.codes[0].program
        self.formulation, self.operations = first.formulation, first.acceleration.operations
        self.dropped, self._values, self._n = self._programs.dropped, self._programs.values, mechanism.n
        self._rank = RankDecision(mechanism, options.damping)
        self._driver = Driver(self._programs, self._rank, options.stabilization == "projection", len(self.parameters))
        # times [s] at which a force or its derivative jumps: steps are split there
        self._kinks = tuple(sorted({t for _, factor in list_lines(mechanism) for t in factor.kinks}))
        # the usual step is compiled now; code for other integrators, for many states or for larger rotations follows on demand
        self._programs.runner(0, "rk4").loaded.call(1)
        self.generate_seconds = time.perf_counter() - start - self.compile_seconds

    @property
    def compile_seconds(self) -> float:
        """Time [s] to compile or load all machine code used so far."""
        return sum(seconds for seconds, _ in self._programs.loaded())

    @property
    def from_cache(self) -> bool:
        """True if all machine code used so far was in the cache."""
        return bool(self._programs.loaded()) and all(cached for _, cached in self._programs.loaded())

    @property
    def switches(self) -> int:
        """Number of times that the last rollout continued with another program, whose independent coordinates may differ."""
        return self._driver.tally.switches

    @property
    def fallbacks(self) -> int:
        """Number of steps of the last rollout (run of many steps) at states where every program had a pivot that was too small.

        These steps were computed by dense linear algebra, which decides the rank of the constraint rows.
        """
        return self._driver.tally.fallbacks

    @property
    def lost(self) -> int:
        """Number of trajectories of the last rollout that could not be continued to the end; their later states are NaN."""
        return self._driver.tally.lost

    def prepare(self, integrator: str = "rk4", many: bool = False) -> None:
        """Compile all code of the first program for rollouts from a single state or, if `many`, from a batch of states."""
        if integrator == "dop853":
            self._programs.adaptive(0).call(1)
            return
        runner = self._programs.runner(0, integrator)
        runner.extend()
        runner.loaded.call(self.lanes if many else 1)  # compiles; the function itself is not needed here

    @property
    def directions(self) -> int:
        """Number of independent coordinates of the first program; an implicit step needs derivatives along one motion for each."""
        return len(self.partitions[0])

    @property
    def partitions(self) -> tuple[tuple[int, ...], ...]:
        """Independent coordinates of every program generated so far."""
        return tuple(code.program.independent for code in self._programs.codes)

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
        """Take n steps of dt from one state or from a batch of states.

        A step in which a time-dependent force has a kink or a jump is split at that time.

        Args:
            q0, v0: positions and velocities at the start, (n_q,) or (batch, n_q).
            dt: step size [s].
            n: number of steps.
            t0: time [s] of q0, v0.
            parameters: values of the open parameters (see the class), (n_parameters,) or (batch, n_parameters); if None, the values
                of the linkage file are used.
            every: number of steps between two states that are returned; None returns only the last state.
            threads: number of threads that share a batch.
            integrator: "rk4", "semi_implicit_euler", "dop853_fixed", or "gauss_legendre", which is implicit and of order 6, for
                forces that are stiff along the free motions of the linkage.

        Returns:
            q, v: (n_q,) or (batch, n_q) after the last step; with `every`, (samples, n_q) or (batch, samples, n_q) after `every`,
            2 `every`, ... steps and after the last. If a trajectory cannot be continued, its later states are NaN, and `lost`
            counts it.

        Raises:
            ValueError: the number of steps is negative, `every` is below 1, the integrator is unknown, or steps go backwards in
                time although a force has kinks or jumps in time.
        """
        if n < 0 or (every is not None and every < 1) or integrator not in INTEGRATORS:
            raise ValueError(f"cannot take {n} steps of {integrator} with a sample every {every}")
        if self._kinks and n and not dt > 0:
            raise ValueError(f"a force has kinks in time: the step must be positive, not {dt:g} s")
        q = q0 if isinstance(q0, np.ndarray) else np.asarray(q0)  # a conversion takes as long as several steps
        v = v0 if isinstance(v0, np.ndarray) else np.asarray(v0)
        self._driver.tally = Tally()
        legs = self.legs(t0, dt, n) if self._kinks else ()  # runs of equal steps; with at most one, no step is split
        p = self._values if parameters is None else np.asarray(parameters, dtype=float)
        if q.ndim == 1 and every is None and p.ndim == 1 and len(legs) <= 1:
            # a single trajectory of which only the last state is returned is stepped with the least overhead
            # with kinks, the number arguments include coefficients of forces for this leg; `_numbers` refuses a wrong shape
            if self._kinks or p.shape != self._values.shape:
                p = self._numbers(parameters, 1, _middle(t0, legs))[0]
            state = self._roll_one(q, v, p, t0, dt, n, integrator)
            return state[: self._n], state[self._n :]
        states = np.atleast_2d(np.concatenate([q, v], axis=-1, dtype=float))
        # arguments that depend on time are evaluated in the middle of a run of equal steps
        numbers = self._numbers(parameters, len(states), _middle(t0, legs))
        batch = Batch(states, numbers, float(t0), float(dt), int(n), max(1, every or n))
        if len(legs) <= 1:
            outcome = self._driver.advance(batch, integrator, threads)
        else:
            numbers_at = partial(self._numbers, parameters, len(states))  # function of the time
            outcome = self._driver.advance_over(batch, numbers_at, self._kinks, integrator, threads)
        samples = outcome.samples[:, -1] if every is None else outcome.samples
        samples = samples[0] if q.ndim == 1 else samples
        return samples[..., : self._n], samples[..., self._n :]

    def legs(self, t0: float, dt: float, n: int) -> tuple[Leg, ...]:
        """Return the n steps of a rollout as legs: runs of equal steps during which no force has a kink or a jump in time.

        A step with a kink or a jump is divided there.
        """
        # max(1, n): the only sample is after the last step
        return tuple(legs(float(t0), float(dt), int(n), max(1, n), self._kinks))

    def integrate(
        self, q0: Array, v0: Array, times: Array, rtol: float, atol: float, parameters: Array | None = None
    ) -> "Integrated":
        """Integrate one trajectory by DOP853, which chooses its steps by the tolerances, and ends a step at each of `times`.

        Args:
            q0, v0: (n_q,) positions and velocities at the first time.
            times: (k,) times [s] of the states that are returned: at least two, ascending.
            rtol, atol: tolerances; the allowed error of each component of q and v is atol + rtol |component|.
            parameters: values of the open parameters (see the class); if None, the values of the linkage file are used.

        Raises:
            ValueError: there are fewer than two times, or they do not ascend.
        """
        if len(times) < 2 or not (np.diff(times) > 0).all():
            raise ValueError("`times` must be at least two ascending times")
        numbers_at, ends = partial(self._numbers, parameters, 1), np.asarray(times, dtype=float)
        state = np.concatenate([np.asarray(q0, dtype=float), np.asarray(v0, dtype=float)])
        self._driver.tally = Tally()
        samples, taken, tried = self._driver.integrate_over(state, numbers_at, ends, (rtol, atol), self._kinks)
        # every step, accepted or not, has as many evaluations as a step of fixed size
        return Integrated(samples[:, : self._n], samples[:, self._n :], taken, EVALUATIONS["dop853_fixed"] * tried)

    def alone(self, q0: Array, v0: Array, dt: float, n: int, t0: float = 0.0, integrator: str = "rk4") -> bool:
        """Tell whether the first program alone can take n steps of dt from the state q0, v0 at the time t0.

        Exported C source, which has no other program, can then take these steps too.
        """
        q, v, runner = q0, v0, self._programs.runner(0, integrator)
        for leg in self.legs(t0, dt, n):  # the number arguments at the middle of a leg are valid for all of its steps
            end = runner.run_one(q, v, self._numbers(None, 1, leg.middle)[0], leg.t, leg.h, leg.n)
            if isinstance(end, Stop):
                return False
            q, v = end[: self._n], end[self._n :]
        return True

    def pivots(self, t: Array, q: Array, v: Array) -> Array:
        """Return the pivots (k, pivots) of the first program's elimination at k states with the times t (k,).

        A pivot whose sign differs between two states on a motion is zero at a state between them, where the program fails.
        """
        numbers = self._numbers(None, len(q), t)
        return self._programs.codes[0].program.acceleration(t[:, None], q, v, numbers)[1]

    def _roll_one(self, q: Array, v: Array, p: Array, t0: float, dt: float, n: int, integrator: str) -> Array:
        """Return the last state (2 n_q,) of a single trajectory after n steps of dt, with the least overhead."""
        end = self._programs.runner(0, integrator).run_one(q, v, p, t0, dt, n)  # 0 is the index of the first program
        if not isinstance(end, Stop):
            return end
        # a guard stopped the first program: the driver continues with other programs from the state that was reached
        batch = Batch(np.concatenate([q, v], dtype=float)[None], p[None], float(t0), float(dt), int(n), max(1, n))
        no_sample = np.full((1, 1, 2 * self._n), np.nan)
        stopped = Outcome(states=end.state[None], samples=no_sample, done=np.array([end.done]), complete=np.zeros(1, bool))
        return np.asarray(self._driver.resume(batch, stopped, integrator).samples[0, -1])

    def _numbers(self, parameters: Array | None, count: int, t: float | Array) -> Array:
        """Return the number arguments (count, n_p) of the code for `count` states: the numbers that are not constants in the code.

        The first columns are the open parameters, with the values `parameters`, or with those of the linkage file if `parameters`
        is None. The other columns are coefficients of time-dependent forces at the time t, one for all states or (count,).
        """
        size = len(self.parameters)
        open_values = self._values[:size] if parameters is None else np.asarray(parameters, dtype=float)
        if open_values.shape[-1] != size:
            raise ValueError(f"{open_values.shape[-1]} parameters given, {size} are open: {', '.join(self.parameters)}")
        numbers = np.array(np.broadcast_to(with_lines(self.mechanism, self._values, t), (count, len(self._values))))
        numbers[:, :size] = open_values
        return numbers

    def acceleration(self, q: Array, v: Array, t: float | Array = 0.0, parameters: Array | None = None) -> Array:
        """Return accelerations (n_q,) or (batch, n_q) at one state or at many, without Baumgarte's terms.

        At a state where every generated program has a pivot that is too small, the acceleration is computed by dense linear
        algebra, which decides the rank of the constraint rows.
        """
        # a single state is evaluated without the overhead of a batch; with kinks the number arguments depend on t
        if np.ndim(q) == 1 and parameters is None:
            p = self._numbers(None, 1, t)[0] if self._kinks else self._values
            a = self._programs.acceleration(float(t), q, v, p)
            if a is not None:  # all pivots of the first program are large enough
                return a
        return self._at_states(self._programs.accelerations, self._rank.acceleration, q, v, t, parameters)

    def forces(self, q: Array, v: Array, t: float | Array = 0.0, parameters: Array | None = None) -> Array:
        """Return the multipliers (rows,) or (batch, rows) of M a + J^T lambda = Q.

        The multiplier of a redundant row that is left out is 0 or a combination of others (`Program.multipliers`).
        """
        return self._at_states(self._programs.multipliers, self._rank.multipliers, q, v, t, parameters)

    def energy(self, q: Array, v: Array, parameters: Array | None = None) -> Array:
        """Return kinetic plus potential energy [J], () or (batch,)."""
        (_, *arrays), is_single = self._as_batch(q, v, 0.0, parameters)  # the energy does not depend on the time
        (energies,) = self._programs.codes[0].program.energy(*arrays)  # (k, 1)
        return np.asarray(energies[0, 0] if is_single else energies[:, 0])

    def c_source(self, integrator: str = "rk4") -> str:
        """Return the first program as C source, with the functions `accelerate` and `rollout`.

        Other programs, for states at which a pivot of the first one is too small, are not included.
        """
        first = self._programs.codes[0]
        steps = rollout([plain_body(first, integrator)], many=False)
        # "none": `accelerate` has no terms of Baumgarte; `rollout` has them if the kernel is stabilised by them
        return C_HEADER + write_c(acceleration(Code(first.program, "none"), plain=True)) + "\n" + write_c(steps)

    def _as_batch(self, q: Array, v: Array, t: float | Array, parameters: Array | None) -> tuple[tuple[Array, ...], bool]:
        """Return the arrays t (k,), q, v (k, n_q) and number arguments (k, n_p), and whether the arguments are a single state."""
        is_single = np.ndim(q) == 1
        q, v = np.atleast_2d(np.asarray(q, dtype=float)), np.atleast_2d(np.asarray(v, dtype=float))
        times = np.broadcast_to(np.asarray(t, dtype=float), len(q))
        return (times, q, v, self._numbers(parameters, len(q), times)), is_single

    def _at_states(
        self,
        evaluate: Callable[..., tuple[Array, Flags]],
        by_rank: Callable[..., Array],
        q: Array,
        v: Array,
        t: float | Array,
        parameters: Array | None,
    ) -> Array:
        """Return a quantity, such as the accelerations, at one state or at many, evaluated by the first program where it is usable.

        At a state where a pivot of the first program is too small, another program, with other pivots, is evaluated. At a state
        where no program is usable, `by_rank` is evaluated. `by_rank` needs the parameter values of the linkage file; with other
        values the result is NaN.

        Args:
            evaluate: function of the index of a program and the four arrays of `_as_batch`; returns values (k, ...) and flags (k,),
                True at states where all pivots were large enough.
            by_rank: function of t, q, v of one state, which decides on the rank of the constraint rows by dense linear algebra.
        """
        arrays, is_single = self._as_batch(q, v, t, parameters)
        values, sound = evaluate(0, *arrays)
        for row in np.flatnonzero(~sound):
            time, q_row, v_row, p = (x[row] for x in arrays)
            # index of the best program for this state except program 0, None if there is none
            k = self._driver.best(float(time), np.concatenate([q_row, v_row]), p, {0})
            if k is not None:
                by_program_k, is_sound = evaluate(k, *(x[row : row + 1] for x in arrays))
                if is_sound[0]:
                    values[row] = by_program_k[0]
                    continue
            values[row] = by_rank(float(time), q_row, v_row) if self._driver.has_nominal_values(p) else np.nan
        return np.asarray(values[0] if is_single else values)


def _middle(t: float, legs: Sequence[Leg]) -> float:
    """Return the time [s] in the middle of the first leg (run of equal steps) of a rollout, or t if `legs` is empty.

    No force has a kink inside a leg, so that number arguments at its middle are valid for all of its steps.
    """
    return legs[0].middle if legs else float(t)
