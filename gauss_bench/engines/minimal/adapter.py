"""A linkage of one degree of freedom in one coordinate, which is changed before its dead centres.

The equation is generated for the cheapest coordinate whose dyads stay open over the whole motion. If there is none, a coordinate is
stepped until one of its dyads opens by less than `least`; then the coordinate whose dyads are open widest takes over, on the branch
that the linkage is on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.equations.sampling import manifold_states, typical_length
from gauss_bench.engines import require
from gauss_bench.engines.base import Choice
from gauss_bench.engines.following import follow, wind
from gauss_bench.engines.minimal.equation import Equation, write_equation
from gauss_bench.engines.minimal.machine import Machine, compile_machine
from gauss_bench.engines.minimal.structure import Links, NoWay, ways
from gauss_bench.engines.shared import finite_acceleration, require_agreement, size, unsteady
from gauss_bench.engines.variants import read_variants
from gauss_bench.formulations.gauss import gauss
from gauss_bench.integrate.fixed_step import EVALUATIONS, equal_runs
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import GROUND, Mechanism
from gauss_bench.mechanism.spaces import angle_at, angles, places
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

VARIANTS = read_variants(Path(__file__).parent)
ADAPTIVE = "dop853"
# The opening of a dyad is the sine or cosine of an angle, which is zero at a dead centre.
STATES = 64  # states of the motion at which the openings of the dyads are evaluated
STEADY = 0.15  # a coordinate whose dyads never open by less needs no change: about 9 degrees from a dead centre
CHANGE = 0.35  # other coordinates are changed at this opening: nearer, their motion needs smaller steps than the linkage's
NARROW = 0.02  # no coordinate is used below this opening: the run ends if none is open wider
AGREEMENT = 1e-8  # relative, of accelerations: rounding and the closure of the states leave 1e-10, a wrong term about 1
CHECKED = 4  # states at which a generated equation is compared with the linkage

Key = tuple[int, tuple[float, ...]]  # one equation: the index of its way, and the signs of its dyads (the branch)


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


@dataclass(frozen=True, eq=False)
class Stretch:
    """The part of a run that was stepped in one equation.

    Attributes:
        rows: index of the sample that the first state is; the others follow.
        start: (2n,) first state, at which the stretch before ended.
        states: (k, 2n) the samples.
        end: (2n,) last state.
    """

    equation: Equation
    rows: int
    start: Array
    states: Array
    end: Array


@dataclass(frozen=True, eq=False)
class Motion:
    """The linkage at k states of one equation.

    Attributes:
        places: (k, links, 2) centres of mass [m].
        lines: (k, links) angles [rad], up to whole turns.
        v, a: (k, n) velocities and accelerations in absolute coordinates.
    """

    places: Array
    lines: Array
    v: Array
    a: Array

    @staticmethod
    def of(rate: Array, results: Sequence[Array]) -> "Motion":
        """Build it from the results (k, ...) of `Equation.told` at rates (k,) of the coordinate."""
        place, slope, bend, second = results
        x, y, c, s = np.moveaxis(place.reshape(len(place), -1, 4), -1, 0)
        w = rate[:, None]
        # v = p' q',  a = p' q'' + p'' q'^2
        return Motion(np.stack([x, y], axis=-1), np.arctan2(s, c), slope * w, slope * second + bend * (w * w))

    @staticmethod
    def at(equation: Equation, y: Array) -> "Motion":
        """Evaluate an equation at its states y (k, 2n)."""
        n, none = equation.program.n, np.zeros((len(y), 1))
        return Motion.of(y[:, n], equation.told(none, y[:, :n], y[:, n:], none[:, :0]))

    def near(self, known: Array) -> Array:
        """Return q (k, n), with whole turns added to the angles so that they are nearest to `known` (k, links)."""
        q = np.empty_like(self.v)
        places(q)[:], angles(q)[:] = self.places, wind(self.lines, known)
        return q


class MinimalModel:
    """A linkage in one coordinate at a time."""

    def __init__(self, mechanism: Mechanism, choice: Choice):
        self.mechanism, self.choice, self.ways = mechanism, choice, ways(mechanism)
        self.walk, self.start_angles = manifold_states(mechanism, STATES), angles(mechanism.q0)
        at, count = Links.of(self.walk.q, self.walk.v), len(self.walk.q)
        openings = [np.array(way.openings(at)).reshape(-1, count).T for way in self.ways]  # (states, dyads)
        # Openings of RRR and RRP are sines and cosines. That of RPR is a length, which is scaled by its largest value.
        self.scales = [
            np.array([np.abs(x).max() if dyad.kind == "RPR" else 1.0 for dyad, x in zip(way.dyads, opening.T, strict=True)])
            for way, opening in zip(self.ways, openings, strict=True)
        ]
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
        """Return the cheapest coordinate that never needs a change, else the one whose dyads are open widest at the start."""
        start = int(np.abs(self.walk.q - self.mechanism.q0).max(axis=1).argmin())
        ways = self.steady or [int(self.open[:, start].argmax())]
        keys = [(k, tuple(self.signs[k][start].tolist())) for k in ways]
        return min(keys, key=lambda key: self._equation(key).program.acceleration.costs.single)

    def _on_branch(self, key: Key) -> NDArray[np.intp]:
        """Return the indices of the sampled states on the equation's branch at which its dyads are open wide enough."""
        k, signs = key
        return np.flatnonzero((self.signs[k] == signs).all(axis=1) & (self.open[k] > self.least))

    def _equation(self, key: Key, q: Array | None = None) -> Equation:
        """Return the equation of a way and branch, written once, from sampled states on that branch and from q (n,) if given."""
        if key not in self.equations:
            k, signs = key
            on = self._on_branch(key)
            # The half of the states that is farthest from dead centres, in the order of the walk.
            best = sorted(on[np.argsort(-self.open[k][on], kind="stable")][: max(3, len(on) // 2)])
            states = self.walk.q[best] if q is None else np.vstack([self.walk.q[best], q])
            self.equations[key] = write_equation(self.mechanism, self.ways[k], signs, states, self.least * self.scales[k])
        return self.equations[key]

    @cached_property
    def _quick(self) -> Callable[[Array], list[Array]]:
        """The first equation's `told` as machine code: state (2n,) -> its results."""
        return compile_machine(self._equation(self.first).told)

    def _choices(self, at: Links) -> dict[Key, float]:
        """Return every coordinate, on the branch that the links are on, with the smallest opening of its dyads there."""
        openings = [np.array(way.openings(at)) for way in self.ways]
        keys = [(k, tuple(np.sign(x).tolist())) for k, x in enumerate(openings)]
        return {key: float(_least(x, scale)) for key, x, scale in zip(keys, openings, self.scales, strict=True)}

    def _verify(self) -> None:
        """Compare the first equation's motion with the linkage and Gauss's principle at a few states.

        Raises:
            RunFailure: places, speeds or accelerations differ.
        """
        evaluator, on = Evaluator(self.mechanism), self._on_branch(self.first)
        for row in on[:: max(1, len(on) // CHECKED)]:
            q, v = self.walk.q[row], self.walk.v[row]
            derived = self._derived(self.first, q, v)
            expected = gauss(evaluator.terms(0.0, q, v)).a
            quantities = zip(("places", "speeds", "accelerations"), derived, (q, v, expected), strict=True)
            require_agreement({name: (own, other, size(other)) for name, own, other in quantities}, AGREEMENT)

    def _state(self, equation: Equation, q: Array, v: Array) -> Array:
        """Translate a state of the linkage to the equation's state (2n,)."""
        return equation.state(Links.of(q, v), {link: float(angle_at(q, link)) for link in equation.angles})

    def _derived(self, key: Key, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return q, v, a (n,) as an equation computes them from its own coordinate at a state of the linkage."""
        equation = self._equation(key, q)
        y = self._state(equation, q, v)
        if key == self.first:
            motion = Motion.of(y[len(y) // 2 :][:1], [x[None] for x in self._quick(y)])
        else:
            motion = Motion.at(equation, y[None])
        return motion.near(angles(q))[0], motion.v[0], motion.a[0]

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        choices = self._choices(Links.of(q, v))
        # The first coordinate if it is regular here, for its equation is compiled already; else the one that is open widest.
        best = max(choices, key=lambda key: choices[key])
        key = next((key for key, least in choices.items() if key[0] == self.first[0] and least > self.least), best)
        return finite_acceleration(t, self._derived(key, q, v)[2], "the equation in one coordinate")

    def prepare(self, times: Array, native: bool = True) -> None:
        """Reset to the start; a motion that changes its coordinate is rehearsed once, so that no timed run compiles.

        Steps are always taken by the compiled loop, whatever `native` says.
        """
        self.times = times
        self.start = self._state(self._equation(self.first), self.mechanism.q0, self.mechanism.v0)
        self.runs = equal_runs(times, self.choice.step)
        machine = self._machine(self.first)
        if not machine.adaptive:
            for *_, samples in self.runs:
                machine.room(samples)
        self._reset()
        if not self.steady:
            self.run()
            self._reset()

    def _reset(self) -> None:
        """Go back to the start and forget the last run."""
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
        for row, every, h, samples in self.runs:
            if not self.lost:
                self._equal(row, h, every, samples)

    def _equal(self, row: int, h: float, every: int, samples: int) -> None:
        """Take equal steps of h [s] from the sample `row` to `samples` further ones, `every` steps apart."""
        done, t, total = 0, float(self.times[row]), every * samples
        while done < total and not self.lost:
            due = every - done % every  # steps to the next sample
            # After a change of coordinate between two samples, one call goes to the next sample only.
            count, each = (total - done, every) if due == every else (due, due)
            machine, start = self.machines[self.now], self.y
            states, moved, y = machine.steps(start, t + done * h, h, count, each)
            y = y.copy()  # the machine's memory is used again by the next call
            # A machine that stops early does not count the state where it stopped, even if a sample is due there.
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
        """Continue at time t [s] in the coordinate whose dyads are open widest, except those that have failed at this state.

        `moved` counts the steps since the last change: without any, the present coordinate has failed here.
        """
        machine = self.machines[self.now]
        self.tried = {self.now} if moved else self.tried | {self.now}
        if not np.isfinite(self.y).all():
            self.lost = f"t = {t:.6g} s: not finite; a smaller step may help"
            return
        here, q = self._links(machine), self.y[: machine.n]
        choices = {key: least for key, least in self._choices(here).items() if key not in self.tried and np.isfinite(least)}
        best = max(choices, key=lambda key: choices[key], default=None)
        if best is None or choices[best] <= self.least:
            self.lost = f"t = {t:.6g} s: no coordinate is regular over a whole step; a smaller step may help"
            return
        place = None if best in self.machines else Motion.at(machine.equation, self.y[None]).near(0.0 * self.start_angles)[0]
        new, known = self._machine(best, place).equation, machine.equation.known(q)
        self.y, self.now, self.changes = new.state(here, known), best, self.changes + 1

    def _links(self, machine: Machine) -> Links:
        """Return the links at the state where steps stopped, evaluated by machine code."""
        place, slope, *_ = machine.told(self.y)
        (x, y, c, s), (u, w, spin) = place.reshape(-1, 4).T, slope.reshape(-1, 3).T * self.y[machine.n]
        numbers = (x + 1j * y, c + 1j * s, u + 1j * w, spin)
        z, e, speeds, spins = (dict(enumerate(row.tolist())) for row in numbers)
        return Links(z | {GROUND: 0j}, e | {GROUND: 1.0 + 0j}, speeds | {GROUND: 0j}, spins | {GROUND: 0.0})

    def _name(self, equation: Equation) -> str:
        way = equation.way
        return f"slide {way.joint.name}" if way.joint.slides else f"angle of {self.mechanism.link_name(way.link)}"

    def _follow(self, stretch: Stretch, at: Array, turned: Array) -> Array:
        """Return approximate, unwrapped angles (k, links) at values (k,) of the coordinate, given those at its start."""
        equation = stretch.equation

        def lines(x: Array) -> Array:
            states = np.zeros((len(x), 2 * equation.program.n))
            states[:, 0] = x
            return Motion.at(equation, states).lines

        length = typical_length(self.mechanism) if equation.way.joint.slides else None
        return follow(lines, float(stretch.start[0]), at, turned, length)

    def read(self) -> Trajectory:
        """Return the samples.

        Raises:
            RunFailure: no coordinate was regular at some time; it carries the samples before.
        """
        q, v, a = np.full((3, len(self.times), self.mechanism.n), np.nan)
        q[0], v[0], a[0] = self._derived(self.first, self.mechanism.q0, self.mechanism.v0)
        turned = self.start_angles
        for stretch in self.stretches:
            rows, states = slice(stretch.rows, stretch.rows + len(stretch.states)), np.vstack([stretch.states, stretch.end])
            motion = Motion.at(stretch.equation, states)
            positions = motion.near(self._follow(stretch, states[:, 0], turned))
            q[rows], v[rows], a[rows], turned = positions[:-1], motion.v[:-1], motion.a[:-1], angles(positions[-1])
        coordinates = ", ".join(dict.fromkeys(self._name(s.equation) for s in self.stretches))
        note = f"in one coordinate: {coordinates}" + (f", changed {self.changes} times" if self.changes else "")
        trajectory = Trajectory(self.times, q, v, a, self.steps, self.evaluations, note)
        if self.lost:
            raise RunFailure(Status.NOT_CONVERGED, self.lost, trajectory)
        return trajectory


def _least(openings: Array, scale: Array) -> Array:
    """Return the smallest opening (...) of dyads (..., dyads), each divided by its scale; 1 if there are no dyads."""
    return np.asarray((np.abs(openings) / scale).min(axis=-1, initial=1.0))
