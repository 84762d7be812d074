"""A linkage of one degree of freedom in one coordinate, which is changed before its dead centres.

The equation is generated for the cheapest coordinate whose dyads stay open. Where there is none, one is stepped until one of its
dyads opens by less than `least`; there the coordinate whose dyads are open widest takes over, on the branch that the linkage is on.
"""

from collections.abc import Callable
from functools import cached_property
from pathlib import Path

import numpy as np

from gauss_bench.compiler.equations.sampling import manifold_states
from gauss_bench.engines.base import Choice
from gauss_bench.engines.extras import require
from gauss_bench.engines.minimal.absolute import Stretch, absolute
from gauss_bench.engines.minimal.equation import Equation, write_equation
from gauss_bench.engines.minimal.machine import Machine, compile_machine
from gauss_bench.engines.minimal.structure import NoWay, ways
from gauss_bench.engines.shared import finite_acceleration, require_agreement, size, unsteady
from gauss_bench.engines.variants import read_variants
from gauss_bench.formulations.gauss import gauss
from gauss_bench.integrate.fixed_step import EVALUATIONS, step_counts
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Angle, Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

VARIANTS = read_variants(Path(__file__).parent)
ADAPTIVE = "dop853"
STATES = 64  # of the motion, at which the openings of the dyads are looked at
STEADY = 0.15  # opening of dyads, everywhere, of a coordinate that needs no change: about 9 degrees from a dead centre
CHANGE = 0.35  # opening at which it is changed otherwise: nearer, the coordinate's motion needs smaller steps than the linkage's
NARROW = 0.02  # opening below which none is used: a run ends where no coordinate has as much
AGREEMENT = 1e-8  # relative, of accelerations: rounding and the closure of the states leave 1e-10, a wrong term about 1
CHECKED = 4  # states
ON_BRANCH = 1e-3  # [m] from where the equation puts the links: the other branch puts them far off

Key = tuple[int, tuple[float, ...]]  # a way, by number, and the signs of its dyads


class Minimal:
    """The engine."""

    name = "minimal"
    integrators = ("rk4", ADAPTIVE, "dop853_fixed", "semi_implicit_euler")
    stabilizations = ("none",)
    settings = VARIANTS.settings
    variants, knobs, first = VARIANTS.space, VARIANTS.knobs, VARIANTS.first
    resizable = True  # a model takes another step or tolerance
    adaptive = (ADAPTIVE,)
    native_loop = True
    python_loop = False

    def version(self) -> str:
        from importlib.metadata import version

        from gauss_bench import __version__

        require("llvmlite")
        return f"gauss-bench {__version__}, llvmlite {version('llvmlite')}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if reason := unsteady(mechanism, "the equation in one coordinate"):
            return reason
        try:
            ways(mechanism)
        except NoWay as reason:
            return str(reason)
        return None

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return "changes of coordinate near dead centres"

    def build(self, mechanism: Mechanism, choice: Choice) -> "MinimalModel":
        self.version()
        return MinimalModel(mechanism, choice)


class MinimalModel:
    """A linkage in one coordinate at a time."""

    def __init__(self, mechanism: Mechanism, choice: Choice):
        self.mechanism, self.choice, self.ways = mechanism, choice, ways(mechanism)
        self.walk = manifold_states(mechanism, STATES)
        openings = [way.opening(self.walk.q) for way in self.ways]
        self.scales = [way.scales(self.walk.q) for way in self.ways]
        self.signs = [np.sign(x) for x in openings]
        self.open = np.array([_least(x, scale) for x, scale in zip(openings, self.scales, strict=True)])
        self.steady = [k for k in range(len(self.ways)) if self.open[k].min() > STEADY]
        widest = float(self.open.max(axis=0).min())
        self.least = STEADY / 2 if self.steady else min(CHANGE, max(widest / 2, NARROW))
        self.equations: dict[Key, Equation] = {}
        self.machines: dict[Key, Machine] = {}
        self.first = self._first()
        self._verify()

    def _first(self) -> Key:
        """The cheapest coordinate that never needs a change, else the one that is farthest from its dead centres at the start."""
        keys = [self._key(k, self._start) for k in self.steady or [int(self.open[:, self._start].argmax())]]
        return min(keys, key=lambda key: self._equation(key).program.acceleration.costs.single)

    @property
    def _start(self) -> int:
        """The number of the state of the walk that is the start of the motion, or next to it."""
        return int(np.abs(self.walk.q - self.mechanism.q0).max(axis=1).argmin())

    def _key(self, k: int, row: int) -> Key:
        return k, tuple(self.signs[k][row].tolist())

    def _equation(self, key: Key, q: Array | None = None) -> Equation:
        """The equation of a way and branch, at states of the walk that lie on it, and at q (n,) if that is given."""
        if key not in self.equations:
            k, signs = key
            on = np.flatnonzero((self.signs[k] == signs).all(axis=1) & (self.open[k] > self.least))
            best = sorted(on[np.argsort(-self.open[k][on], kind="stable")][: max(3, len(on) // 2)])
            states = self.walk.q[best] if q is None else np.vstack([self.walk.q[best], q])
            least = self.least * self.scales[k]
            self.equations[key] = write_equation(self.mechanism, self.ways[k], signs, states, least, self.ways)
        return self.equations[key]

    def _verify(self) -> None:
        """Compare with the linkage: nothing that was derived is believed.

        Raises:
            RunFailure: they differ.
        """
        evaluator, (k, signs) = Evaluator(self.mechanism), self.first
        on = np.flatnonzero((self.signs[k] == signs).all(axis=1) & (self.open[k] > self.least))
        for row in on[:: max(1, len(on) // CHECKED)]:
            q, v = self.walk.q[row], self.walk.v[row]
            terms = evaluator.terms(0.0, q, v)
            derived, expected = self._stretch(self._equation(self.first), q, v), gauss(terms).a
            pairs = {
                name: (own, other, size(other))
                for name, own, other in zip(("places", "speeds", "accelerations"), derived, (q, v, expected), strict=True)
            }
            require_agreement(pairs, AGREEMENT)

    def _state(self, equation: Equation, q: Array, v: Array) -> Array:
        """The equation's state (2n,) at a state of the linkage."""
        value, rate = equation.way.state(q, v)
        known = {link: (float(q[3 * link + 2]), float(v[3 * link + 2])) for link in equation.angles}
        return equation.state(float(value), float(rate), known)

    def _stretch(self, equation: Equation, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """q, v, a (n,) that an equation makes of a state of the linkage."""
        y = self._state(equation, q, v)
        motion = absolute(self.mechanism, Stretch(equation, 0, y, y[None], y), q[2::3])
        return motion[0][0], motion[1][0], motion[2][0]

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        quick = self._native(q, v)
        if quick is not None:
            return quick
        openings = [way.opening(q) for way in self.ways]
        least = [float(_least(x, scale)) for x, scale in zip(openings, self.scales, strict=True)]
        k = self.first[0] if least[self.first[0]] > self.least else int(np.argmax(least))
        equation = self._equation((k, tuple(np.sign(openings[k]).tolist())), q)
        return finite_acceleration(t, self._stretch(equation, q, v)[2], "the equation in one coordinate")

    def _native(self, q: Array, v: Array) -> Array | None:
        """The acceleration (n,) by the first equation in machine code, or None where the state is not on its branch."""
        y = self._state(self._equation(self.first), q, v)
        place, slope, bend, (w_dot,) = np.split(self._evaluate(y), self._cuts)
        x, w = place.reshape(-1, 4), y[len(y) // 2]
        near = np.abs(x[:, :2] - q.reshape(-1, 3)[:, :2]).max() < ON_BRANCH
        return np.asarray(slope * w_dot + bend * (w * w)) if near and np.isfinite(w_dot) else None

    @cached_property
    def _evaluate(self) -> Callable[[Array], Array]:
        return compile_machine(self._equation(self.first).told)

    @cached_property
    def _cuts(self) -> list[int]:
        return [k * len(self.mechanism.links) for k in (4, 7, 10)]

    def prepare(self, times: Array, native: bool = True) -> None:
        """There is only the compiled loop, whatever `native` says; a rehearsal compiles what changes of coordinate need."""
        self.times = times
        self.start = self._state(self._equation(self.first), self.mechanism.q0, self.mechanism.v0)
        self.runs: list[tuple[int, float, int, int]] = []  # first row, step, steps between samples, samples
        for row, (count, h) in enumerate(step_counts(times, self.choice.step)):
            before = self.runs[-1] if self.runs else (0, 0.0, 0, 0)
            if before[2] == count and round(before[1], 15) == round(h, 15):
                self.runs[-1] = (*before[:3], before[3] + 1)
            else:
                self.runs.append((row, h, count, 1))
        machine = self._machine(self.first)
        if not machine.adaptive:
            for *_, samples in self.runs:
                machine.room(samples)
        self._reset()
        if not self.steady:
            self.run()
            self._reset()

    def _reset(self) -> None:
        """To the start."""
        self.y, self.now, self.tried = self.start, self.first, set[Key]()
        self.steps, self.evaluations, self.changes, self.lost = 0, 0, 0, ""
        self.stretches: list[Stretch] = []

    def _machine(self, key: Key, q: Array | None = None) -> Machine:
        if key not in self.machines:
            self.machines[key] = Machine(self._equation(key, q), self.choice.integrator)
        return self.machines[key]

    def run(self) -> None:
        if self.choice.integrator == ADAPTIVE:
            self._adaptive()
            return
        for row, h, every, samples in self.runs:
            if not self.lost:
                self._equal(row, h, every, samples)

    def _equal(self, row: int, h: float, every: int, samples: int) -> None:
        """Equal steps from the sample `row` to `samples` further ones."""
        done, t, total = 0, float(self.times[row]), every * samples
        while done < total and not self.lost:
            due = every - done % every  # steps to the next sample
            count, each = (total - done, every) if due == every else (due, due)
            machine, start = self.machines[self.now], self.y
            states, moved, y = machine.steps(start, t + done * h, h, count, each)
            y = y.copy()
            states = np.vstack([states, y]) if moved < count and moved and moved % each == 0 else states.copy()
            self.stretches.append(Stretch(machine.equation, row + 1 + done // every, start, states, y))
            done, self.y, self.steps = done + moved, y, self.steps + moved
            if moved < count:
                self._change(t + done * h, moved)
        self.evaluations = EVALUATIONS[self.choice.integrator] * self.steps

    def _adaptive(self) -> None:
        times, row, t = self.times, 0, float(self.times[0])
        options = VARIANTS.options(self.choice.settings)
        tolerances = self.choice.tolerances(options["dop853_rtol"], options["dop853_atol"])
        while row < len(times) - 1 and not self.lost:
            machine = self.machines[self.now]
            course = machine.course(self.y, np.append(t, times[row + 1 :]), tolerances)
            states = course.samples[1:]
            end = course.state if row + len(states) < len(times) - 1 else states[-1]
            self.stretches.append(Stretch(machine.equation, row + 1, self.y, states, end))
            row, self.y, t = row + len(states), end, course.t
            self.steps += course.taken
            self.evaluations += EVALUATIONS["dop853_fixed"] * course.tried
            if row < len(times) - 1:
                self._change(t, course.taken)

    def _change(self, t: float, moved: int) -> None:
        """Go on in the coordinate whose dyads are open widest, of those that have not failed here."""
        machine = self.machines[self.now]
        self.tried = {self.now} if moved else self.tried | {self.now}
        if not np.isfinite(self.y).all():
            self.lost = f"t = {t:.6g} s: not finite; a smaller step may help"
            return
        *seen, turning = machine.seen(self.y)
        choices = {}
        for k, (x, scale) in enumerate(zip(seen, self.scales, strict=True)):
            key = k, tuple(np.sign(x[3:]).tolist())
            if key not in self.tried and np.isfinite(x).all():
                choices[key] = float(_least(x[3:], scale))
        best = max(choices, key=lambda key: choices[key], default=None)
        if best is None or choices[best] <= self.least:
            self.lost = f"t = {t:.6g} s: no coordinate is regular over a whole step; a smaller step may help"
            return
        w = self.y[machine.n]
        angles = machine.equation.known(self.y[: machine.n])
        known = {link: (angle, rate * w) for (link, angle), rate in zip(angles.items(), turning, strict=True)}
        x, y, rate = seen[best[0]][:3]
        new = self._machine(best, None if best in self.machines else self._place(machine)).equation
        value = float(np.arctan2(y, x)) if isinstance(new.way.coordinate, Angle) else float(x)
        self.y, self.now, self.changes = new.state(value, rate * w, known), best, self.changes + 1

    def _place(self, machine: Machine) -> Array:
        """The linkage's q (n,), angles but for whole turns."""
        q, v = self.y[: machine.n], self.y[machine.n :]
        x, y, c, s = machine.equation.told(np.zeros(1), q, v, np.zeros(0))[0].reshape(-1, 4).T
        return np.column_stack([x, y, np.arctan2(s, c)]).ravel()

    def _name(self, equation: Equation) -> str:
        way = equation.way
        return f"angle of {self.mechanism.link_name(way.link)}" if isinstance(way.coordinate, Angle) else f"slide {way.joint.name}"

    def read(self) -> Trajectory:
        """The samples.

        Raises:
            RunFailure: no coordinate served; with the samples before.
        """
        q, v, a = np.full((3, len(self.times), self.mechanism.n), np.nan)
        first = self._stretch(self._equation(self.first), self.mechanism.q0, self.mechanism.v0)
        q[0], v[0], a[0] = first
        angles = self.mechanism.q0[2::3]
        for stretch in self.stretches:
            rows = slice(stretch.rows, stretch.rows + len(stretch.states))
            q[rows], v[rows], a[rows], angles = absolute(self.mechanism, stretch, angles)
        coordinates = ", ".join(dict.fromkeys(self._name(s.equation) for s in self.stretches))
        note = f"in one coordinate: {coordinates}" + (f", changed {self.changes} times" if self.changes else "")
        trajectory = Trajectory(self.times, q, v, a, self.steps, self.evaluations, note)
        if self.lost:
            raise RunFailure(Status.NOT_CONVERGED, self.lost, trajectory)
        return trajectory


def _least(openings: Array, scale: Array) -> Array:
    """The smallest opening (...) of dyads (..., dyads), each by its scale; 1 without dyads."""
    return np.asarray((np.abs(openings) / scale).min(axis=-1, initial=1.0))
