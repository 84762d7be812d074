"""Kernels of large linkages: code whose length does not grow with the linkage, and whose run time grows in proportion.

    linkage -> rows and forces (workspace) -> elimination in rounds (large_elimination, large_algebra) -> groups of equal operations
    (large_groups) -> loops over lanes (large_loops) -> text of LLVM (large_text, large_steps)

Straight-line code (kernel.py) is the fastest for linkages of a few loops. It outgrows the instruction cache at about a thousand
operations, and takes half a minute to generate and compile at thirty thousand. Here equal operations of different links are lanes
of one loop, found in the expressions themselves, so that no linkage is told to be a chain; one without any repetition merely
gathers its operands.
"""

import time
from collections.abc import Iterator
from functools import cached_property

import numpy as np

from gauss_bench.compiler.chains.program import LargeProgram, generate_large
from gauss_bench.compiler.elimination.check import worst_error
from gauss_bench.compiler.elimination.formulations import Plan
from gauss_bench.compiler.elimination.partition import covering, study
from gauss_bench.compiler.elimination.program import CHECKED, FORMULATIONS
from gauss_bench.compiler.equations.sampling import manifold_states
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.machine import native_code
from gauss_bench.compiler.stepping.library import Library
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

CHECKS = 5  # states, other than those at which pivots were chosen


def large_kernel(mechanism: Mechanism, formulation: str = "gauss", lanes: int = 1, cache: bool = True) -> "LargeKernel":
    """The kernel of a large mechanism.

    Args:
        formulation: "gauss", "lagrange", or "auto" for the one of fewer operations.
        lanes: trajectories in one vector where there are several; 1 for one after the other, each in vectors of its own, which is
            faster where the memory of so many trajectories outgrows the processor's caches.
        cache: whether object code is kept in the user's cache folder.

    Raises:
        KernelError: dry friction, an unknown formulation, no package llvmlite, no usable pivots, or a program that is wrong.
    """
    if formulation not in FORMULATIONS:
        raise KernelError(f"no formulation {formulation}; there are {', '.join(FORMULATIONS)}")
    if mechanism.has_friction:
        raise KernelError(f"{mechanism.name}: no kernel for dry friction, whose force follows from the accelerations it causes")
    if not native_code.available():
        raise KernelError("the kernel of a large linkage needs the package llvmlite")
    return LargeKernel(mechanism, formulation, lanes, cache)


class LargeKernel:
    """Compiled loops of one mechanism. Times in s, states in the absolute coordinates of the mechanism (SI units).

    Attributes:
        formulation: "gauss" or "lagrange", as chosen. lanes: trajectories in one vector. operations: of one acceleration with its
        guards. dropped: names of redundant rows that were left out. generate_seconds: to generate and check the first program.
        switches: changes of program in the last rollout; fallbacks: steps that no program could do; lost: trajectories without an
            end, which are not a number from there on.
    """

    def __init__(self, mechanism: Mechanism, formulation: str, lanes: int, cache: bool):
        start = time.perf_counter()
        self.mechanism, self.lanes, self.cache = mechanism, lanes, cache
        self.study = study(mechanism)
        self.programs: list[LargeProgram] = []
        self._further = self._plans(formulation)
        while not self.programs:
            if not self._generate_next():
                raise KernelError(f"{mechanism.name}: no partition of the coordinates has usable pivots")
        first = self.programs[0]
        self.formulation, self.operations, self.dropped = first.plan.formulation, first.operations, first.dropped
        self.switches = self.fallbacks = self.lost = 0
        self._check()
        self.generate_seconds = time.perf_counter() - start - self.compile_seconds

    @property
    def compile_seconds(self) -> float:
        """To compile or load everything used so far."""
        return sum(code.seconds for program in self.programs for code in program.loaded.values())

    def _plans(self, formulation: str) -> Iterator[Plan]:
        lagrange = Plan("lagrange", ())
        if formulation == "lagrange":
            yield lagrange
        plans = [Plan("gauss", x) for x in covering(self.study)]  # late, since it is slow for many degrees of freedom
        if formulation != "lagrange":
            plans.append(lagrange)
        if formulation == "auto":
            best = min((plans[0], lagrange), key=self._operations)
            plans = [best, *(plan for plan in plans if plan != best)]
        yield from plans

    def _operations(self, plan: Plan) -> float:
        try:
            return generate_large(self.study, plan).operations
        except KernelError:
            return np.inf

    def _generate_next(self) -> bool:
        """One more program; False where there is none."""
        for plan in self._further:
            try:
                self.programs.append(generate_large(self.study, plan, self.cache))
            except KernelError:
                continue  # not every partition can be eliminated everywhere
            return True
        return False

    def _check(self) -> None:
        """Compare the first program with the linkage's own evaluation.

        Raises:
            KernelError: it is off by more than CHECKED, or usable nowhere.
        """
        states = manifold_states(self.mechanism, CHECKS, seed=1)
        a, sound = self.programs[0].accelerations(states.t, np.concatenate([states.q, states.v], axis=1), 1)
        found = [(float(states.t[k]), states.q[k], states.v[k], a[k]) for k in np.flatnonzero(sound)]
        error = worst_error(self.mechanism, found) if found else np.inf
        if not error <= CHECKED:
            raise KernelError(f"{self.mechanism.name}: the {self.formulation} kernel is off by {error:.1e} at {len(found)} states")

    @cached_property
    def library(self) -> Library:
        return Library(self.mechanism)

    def acceleration(self, q: Array, v: Array, t: float | Array = 0.0) -> Array:
        """Accelerations (n,) or (batch, n) at states (n,) or (batch, n); by rank decision where no program serves."""
        q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
        if q.ndim == 1:
            a, good = self.programs[0].acceleration(float(t), q, v)
            if good:
                return a
        states = np.atleast_2d(np.concatenate([q, v], axis=-1))
        times = np.broadcast_to(np.asarray(t, dtype=float), len(states))
        found, sound = self.programs[0].accelerations(times, states, self.lanes)
        for row in np.flatnonzero(~sound):
            k = self._serving(times[row], states[row], {0})
            if k is None:
                q_row, v_row = np.split(states[row], 2)
                found[row] = self.library.acceleration(float(times[row]), q_row, v_row)
            else:
                found[row] = self.programs[k].acceleration(float(times[row]), *np.split(states[row], 2))[0]
        return found[0] if q.ndim == 1 else found

    def _serving(self, t: float, state: Array, without: set[int]) -> int | None:
        """A program whose guards hold at a state, or None."""
        k = 0
        while k < len(self.programs) or self._generate_next():
            if k not in without and self.programs[k].acceleration(t, *np.split(state, 2))[1]:
                return k
            k += 1
        return None

    def rollout(self, q0: Array, v0: Array, dt: float, n: int, t0: float = 0.0, every: int | None = None) -> tuple[Array, Array]:
        """Step n times by dt with the classical method of Runge and Kutta, without stabilization.

        Args:
            q0, v0: (n_q,) or (batch, n_q).
            every: steps between samples; only the last state where None.

        Returns:
            q, v: (n_q,) or (batch, n_q) after the last step; with `every`, (samples, n_q) or (batch, samples, n_q) after `every`,
            2 `every`, ... steps and after the last. A trajectory that cannot go on is not a number from there, and counted in
            `lost`.
        """
        if n < 0 or (every is not None and every < 1):
            raise ValueError(f"cannot take {n} steps with a sample every {every}")
        q0, v0 = np.asarray(q0, dtype=float), np.asarray(v0, dtype=float)
        self.switches = self.fallbacks = self.lost = 0
        if q0.ndim == 1 and every is None:
            q, v, done = self.programs[0].advance_one(q0, v0, t0, dt, n)
            if done == n:
                self.lost = int(not (np.isfinite(q).all() and np.isfinite(v).all()))
                return (q, v) if not self.lost else (np.full_like(q, np.nan), np.full_like(v, np.nan))
        states = np.atleast_2d(np.concatenate([q0, v0], axis=-1))
        samples = []
        for at in range(0, max(n, 1), every or max(n, 1)):
            count = min(every or n, n - at)
            states = self._advance(states, t0 + at * dt, dt, count)
            samples.append(states)
        self.lost = int((~np.isfinite(states).all(axis=1)).sum())
        found = states if every is None else np.stack(samples, axis=1)
        found = found[0] if q0.ndim == 1 else found
        return found[..., : self.mechanism.n], found[..., self.mechanism.n :]

    def _advance(self, states: Array, t: float, h: float, n: int) -> Array:
        after, done = self.programs[0].advance(states, t, h, n, self.lanes)
        for row in np.flatnonzero(done < n):
            after[row] = self._finish(after[row], t, h, int(done[row]), n)
        after[~np.isfinite(after).all(axis=1)] = np.nan
        return after

    def _finish(self, state: Array, t0: float, h: float, at: int, n: int) -> Array:
        """A trajectory that stopped, to its end by whatever serves."""
        tried, used = {0}, 0
        while at < n and np.isfinite(state).all():
            k = self._serving(t0 + at * h, state, tried)
            if k is None:
                state = self._library_step(t0 + at * h, state, h)
                self.fallbacks += 1
                at, tried = at + 1, set()
                continue
            self.switches += k != used
            q, v = np.split(state, 2)
            q, v, done = self.programs[k].advance_one(q, v, t0 + at * h, h, n - at)
            state, at, used = np.concatenate([q, v]), at + done, k
            tried = {k} if done else tried | {k}
        return state

    def _library_step(self, t: float, state: Array, h: float) -> Array:
        """One step by rank decision, projected; not a number where that fails too."""
        q, v = np.split(state, 2)
        try:
            with np.errstate(all="ignore"):
                return np.concatenate(self.library.step("rk4", t, q, v, h))
        except np.linalg.LinAlgError:  # numbers beyond all bounds
            return np.full_like(state, np.nan)
