"""A linkage compiled for this machine: accelerations, forces, and whole trajectories of one state or of thousands.

kernel = compile(mechanism, stabilization="projection")
q, v = kernel.rollout(q0, v0, 1e-4, 10_000)
"""

import time
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from gauss_bench.compiler.chains.kernel import large_kernel
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.stepping.arrays import on_arrays
from gauss_bench.compiler.stepping.driver import Driver, Options
from gauss_bench.compiler.stepping.runners import Batch, Flags, NativeEvaluator, NativeRunner, Outcome
from gauss_bench.compiler.stepping.steps import REACHES, STEPS, read_code
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

CELLS = 130  # links: some 10,000 operations, from where straight-line code takes tens of seconds to generate and compile
STEADY = 100.0  # thresholds: any fixed choice of rows to drop is singular somewhere, and digits go long before its pivots do
STABILIZATIONS = ("none", "baumgarte", "projection")
BACKENDS = ("llvm", "numpy")
BAUMGARTE = (20.0, 20.0)  # [1/s] alpha = beta, as elsewhere in the suite


def compile(
    mechanism: Mechanism,
    formulation: str = "auto",
    stabilization: str = "none",
    open_parameters: tuple[str, ...] = (),
    lanes: int | None = None,
    cache: bool = True,
    backend: str | None = None,
    independent: tuple[int, ...] | None = None,
    baumgarte: tuple[float, float] = BAUMGARTE,
) -> Any:
    """The Kernel of a mechanism; beyond CELLS links, without stabilisation, the LargeKernel, whose code does not grow with it.

    Args:
        formulation: "gauss", "lagrange", or "auto" for the one that costs less.
        stabilization: "none", "baumgarte", or "projection" of positions and velocities at each step.
        open_parameters: names of numbers of the file that stay open, such as "links.crank.mass"; given with each call.
        lanes: trajectories in one vector; chosen for the host where None.
        cache: whether object code is kept in the user's cache folder.
        backend: "llvm", or "numpy" without a compiler; None for the first that is installed.
        independent: coordinates of the first partition; chosen where None.
        baumgarte: alpha, beta [1/s].

    Raises:
        KernelError: dry friction, an unknown name, or a backend that is not there.
    """
    start = time.perf_counter()
    if stabilization not in STABILIZATIONS:
        raise KernelError(f"no stabilization {stabilization}; there are {', '.join(STABILIZATIONS)}")
    if backend not in (None, *BACKENDS):
        raise KernelError(f"no backend {backend}; there are {', '.join(BACKENDS)}")
    if backend == "llvm" and not native_code.available():
        raise KernelError("the backend llvm needs the package llvmlite")
    chosen = backend or ("llvm" if native_code.available() else "numpy")
    width = native_code.best_lanes() if lanes is None else lanes
    plain = stabilization == "none" and not open_parameters and independent is None and chosen == "llvm"
    if plain and len(mechanism.links) > CELLS:
        return large_kernel(mechanism, formulation, cache=cache)
    options = Options(formulation, stabilization, tuple(open_parameters), independent, baumgarte, chosen, width, cache)
    return Kernel(mechanism, options, start)


class Kernel:
    """Compiled code of one mechanism. Times in s, states in the absolute coordinates of the mechanism (SI units).

    Attributes:
        mechanism: what was compiled. formulation: "gauss" or "lagrange", as chosen. parameters: names of the open numbers, in the
        order of every `parameters` argument. backend: "llvm" or "numpy". lanes: trajectories in one vector. operations,
        divisions: of one acceleration with its guards. dropped: names of redundant rows that were left out. switches: changes of
        partition in the last rollout; fallbacks: steps that no partition could do; lost: trajectories without an
            end, which are not a number from there on.
    """

    def __init__(self, mechanism: Mechanism, options: Options, start: float):
        self.mechanism, self.options = mechanism, options
        self._driver = Driver(mechanism, options)
        code = self._driver.choices.codes[0]
        program = code.program
        self.formulation, self.parameters, self.dropped = program.formulation, program.parameters, program.dropped
        self.backend, self.lanes = options.backend, options.lanes
        self.operations, self.divisions = program.acceleration.operations, program.acceleration.divisions
        self._values, self._n = program.values, program.n
        self.switches = self.fallbacks = self.lost = 0
        first = self._driver.runner(0, "rk4", 0)
        if isinstance(first, NativeRunner):
            first.native(1)
        self._built = time.perf_counter() - start - sum(x.seconds for x in self._loaded())

    def _loaded(self) -> list[native_code.NativeCode]:
        native = [self.__dict__[name] for name in ("_native",) if name in self.__dict__]
        native += [r for r in self._driver.runners.values() if isinstance(r, NativeRunner)]
        return [code for runner in native for code in runner.loaded.values()]

    def prepare(self, integrator: str = "rk4", many: bool = False) -> None:
        """Compile what rollouts of one state, or of many, may need, so that none of them waits for it."""
        for level in range(len(REACHES[integrator])):
            runner = self._driver.runner(0, integrator, level)
            if isinstance(runner, NativeRunner):
                runner.native(self.lanes if many else 1)

    @property
    def partitions(self) -> tuple[tuple[int, ...], ...]:
        """Independent coordinates of every program generated so far; () for Lagrange's."""
        return tuple(code.program.independent for code in self._driver.choices.codes)

    @property
    def compile_seconds(self) -> float:
        """To generate the first program, and to compile or load everything used so far."""
        return self._built + sum(code.seconds for code in self._loaded())

    @property
    def from_cache(self) -> bool:
        """Whether all machine code so far was in the cache."""
        return bool(self._loaded()) and all(code.from_cache for code in self._loaded())

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
        """Step n times by dt.

        Args:
            q0, v0: (n_q,) or (batch, n_q).
            parameters: (n_parameters,) or (batch, n_parameters); those of the file where None.
            every: steps between samples; only the last state where None.
            threads: that share a batch.
            integrator: "rk4" or "semi_implicit_euler".

        Returns:
            q, v: (n_q,) or (batch, n_q) after the last step; with `every`, (samples, n_q) or (batch, samples, n_q) after `every`,
            2 `every`, ... steps and after the last. A trajectory that cannot go on is not a number from there, and counted in
            `lost`.
        """
        if n < 0 or (every is not None and every < 1) or integrator not in STEPS:
            raise ValueError(f"cannot take {n} steps of {integrator} with a sample every {every}")
        q, v = np.asarray(q0, dtype=float), np.asarray(v0, dtype=float)
        p = self._values if parameters is None else np.asarray(parameters, dtype=float)
        if q.ndim == 1 and every is None and self.backend == "llvm" and p.shape == self._values.shape:
            state = self._one(q, v, p, t0, dt, n, integrator)
            return state[: self._n], state[self._n :]
        states = np.atleast_2d(np.concatenate([q, v], axis=-1))
        batch = Batch(states, self._spread(p, len(states)), float(t0), float(dt), int(n), max(1, every or n))
        found = self._counted(self._driver.advance(batch, integrator, threads))
        samples = found.samples[:, -1] if every is None else found.samples
        samples = samples[0] if q.ndim == 1 else samples
        return samples[..., : self._n], samples[..., self._n :]

    def _one(self, q: Array, v: Array, p: Array, t0: float, dt: float, n: int, integrator: str) -> Array:
        """The last state (2 n_q,) of a single trajectory, by the shortest way."""
        self.switches = self.fallbacks = self.lost = 0
        level = self._driver.level(integrator, dt, v)
        runner = self._driver.runner(0, integrator, level)
        assert isinstance(runner, NativeRunner)
        found = runner.run_one(q, v, p, t0, dt, n)
        if isinstance(found, Outcome):
            batch = Batch(np.concatenate([q, v])[None], p[None], float(t0), float(dt), int(n), max(1, n))
            return np.asarray(self._counted(self._driver.resume(batch, found, integrator, level)).samples[0, -1])
        return found

    def _counted(self, found: Outcome) -> Outcome:
        tally = self._driver.tally
        self.switches, self.fallbacks, self.lost = tally.switches, tally.fallbacks, tally.lost
        return found

    def _spread(self, p: Array, count: int) -> Array:
        """One row of parameters for each state."""
        if p.shape[-1] != len(self.parameters):
            raise ValueError(f"{p.shape[-1]} parameters given, {len(self.parameters)} are open: {', '.join(self.parameters)}")
        return np.ascontiguousarray(np.broadcast_to(p, (count, len(self.parameters))))

    def acceleration(self, q: Array, v: Array, t: float | Array = 0.0, parameters: Array | None = None) -> Array:
        """Accelerations (n_q,) or (batch, n_q) of one state or of many; where no partition serves, by rank decision.

        They are the linkage's own, without Baumgarte's terms.
        """
        if self.backend == "llvm" and np.ndim(q) == 1 and parameters is None and not self.dropped:
            quick = self._native.one(float(t), q, v, self._values)
            if quick is not None:
                return quick
        return self._at_states(self._accelerations, "acceleration", q, v, t, parameters)

    def forces(self, q: Array, v: Array, t: float | Array = 0.0, parameters: Array | None = None) -> Array:
        """Multipliers (rows,) or (batch, rows) of M a + J^T lambda = Q, 0 for rows that are left out as redundant."""
        return self._at_states(self._multipliers, "multipliers", q, v, t, parameters)

    def energy(self, q: Array, v: Array, parameters: Array | None = None) -> Array:
        """Kinetic plus potential energy [J], () or (batch,)."""
        rows, single = self._rows(q, v, 0.0, parameters)
        found = self._energy(rows[1], rows[2], rows[3])[0][:, 0]
        return np.asarray(found[0] if single else found)

    @cached_property
    def _energy(self) -> Callable[..., list[Array]]:
        return on_arrays(self._driver.choices.codes[0].program.energy)

    @cached_property
    def _native(self) -> NativeEvaluator:
        return NativeEvaluator(read_code(self._driver.choices.codes[0].program, "none"), self.lanes, self.options.cache)

    def _accelerations(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Flags]:
        """Of one program, and whether its pivots serve."""
        if k == 0 and self.backend == "llvm" and not self.dropped:
            return self._native.accelerations(t, np.concatenate([q, v], axis=1), p)
        a, margin = self._driver.choices.accelerations(k, t, q, v, p)
        return a, margin >= (STEADY if self.dropped else 1.0)

    def _multipliers(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Flags]:
        choices = self._driver.choices
        if k not in self._forces:
            self._forces[k] = on_arrays(choices.codes[k].program.multipliers)
        return self._forces[k](t[:, None], q, v, p)[0], choices.accelerations(k, t, q, v, p)[1] >= 1.0

    @cached_property
    def _forces(self) -> dict[int, Callable[..., list[Array]]]:
        return {}

    def _rows(self, q: Array, v: Array, t: float | Array, parameters: Array | None) -> tuple[tuple[Array, ...], bool]:
        single = np.ndim(q) == 1
        q, v = np.atleast_2d(np.asarray(q, dtype=float)), np.atleast_2d(np.asarray(v, dtype=float))
        p = self._spread(self._values if parameters is None else np.asarray(parameters, dtype=float), len(q))
        return (np.broadcast_to(np.asarray(t, dtype=float), len(q)), q, v, p), single

    def _at_states(self, evaluate: Any, by_rank: str, q: Array, v: Array, t: float | Array, parameters: Array | None) -> Array:
        """Evaluate by the first program, and where its pivots fail by another, or by rank decision."""
        at, single = self._rows(q, v, t, parameters)
        found, sound = evaluate(0, *at)
        for row in np.flatnonzero(~sound):
            one = [x[row : row + 1] for x in at]
            k = self._driver.choices.best(float(one[0][0]), np.concatenate([one[1][0], one[2][0]]), one[3][0], {0})
            other, good = evaluate(k, *one) if k is not None else (found[row : row + 1], np.zeros(1, dtype=bool))
            if good[0]:
                found[row] = other[0]
            elif self._driver.nominal(one[3][0]):
                found[row] = getattr(self._driver.library, by_rank)(float(one[0][0]), one[1][0], one[2][0])
            else:
                found[row] = np.nan
        return np.asarray(found[0] if single else found)
