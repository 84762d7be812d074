"""The engine `minimal`: the equation of motion of a linkage with one degree of freedom, in one independent coordinate.

The positions of the links follow from the coordinate, one pair of links (dyad) after the other. Each dyad can be assembled in two
positions, which a sign distinguishes; the signs of all dyads are the branch of the linkage. The opening of a dyad measures how far
it is from its dead centre, where the coordinate no longer determines the motion. The equation is generated for the cheapest
coordinate whose dyads stay away from their dead centres during the whole motion. If there is none, the coordinate changes during a
run: when the opening of a dyad falls below `least`, the coordinate whose smallest opening is largest replaces the present one.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.equations.sampling import manifold_states, typical_length
from gauss_bench.engines.base import Choice, sample_arrays
from gauss_bench.engines.compiled import compiler_version
from gauss_bench.engines.following import follow, wind
from gauss_bench.engines.minimal.equation import Equation, write_equation
from gauss_bench.engines.minimal.machine import Machine
from gauss_bench.engines.minimal.structure import DyadSequence, Links, NoSequence, find_sequences
from gauss_bench.engines.shared import LibraryEngine, finite_acceleration, require_agreement, size, unsteady
from gauss_bench.formulations.gauss import gauss
from gauss_bench.integrate.fixed_step import EVALUATIONS, EqualSteps, equal_runs
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Angle, Law, Load, Mechanism, Weighted, loads
from gauss_bench.mechanism.spaces import angle_at, angles, places
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

ADAPTIVE = "dop853"
# The opening of a dyad is the sine or cosine of an angle, or a length relative to its largest value; it is 0 at the dead centre.
STATES = 64  # number of states of the motion at which the openings of the dyads are evaluated
STEADY = 0.15  # least opening, about 9 degrees from a dead centre, of a coordinate that is used over the whole motion
CHANGE = 0.35  # largest opening at which another coordinate replaces the present one: nearer to dead centres, steps must be smaller
NARROW = 0.02  # opening below which no coordinate is used: the run ends if no coordinate has a larger opening
AGREEMENT = 1e-8  # relative, of accelerations: rounding and the closure of the states cause about 1e-10, a wrong term about 1
CHECKED = 4  # number of states at which a generated equation is compared with the linkage


class Key(NamedTuple):
    """The key of an equation of motion: the index of its dyad sequence in `MinimalModel.sequences`, and the signs of its branch."""

    sequence: int
    signs: tuple[float, ...]


class Minimal(LibraryEngine, beside=__file__):
    """The equation of motion in one coordinate, generated and compiled."""

    name = "minimal"
    integrators = ("rk4", ADAPTIVE, "dop853_fixed", "semi_implicit_euler")
    resizable = True  # a built model can run with another step or tolerance
    native_loop = True
    python_loop = False

    def version(self) -> str:
        return compiler_version()

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if reason := unsteady(mechanism, "the equation in one coordinate"):
            return reason
        for force in mechanism.forces:
            if any(is_spring_on_sum_of_angles(x) for x in loads([force])):
                return f"the equation in one coordinate does not support a spring on a sum of angles ({force.name})"
        try:  # only the exception matters
            find_sequences(mechanism)
        except NoSequence as reason:
            return str(reason)
        return None

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return "changes of coordinate near dead centres"

    def build(self, mechanism: Mechanism, choice: Choice) -> "MinimalModel":
        compiler_version()  # raises if llvmlite is missing
        return MinimalModel(mechanism, choice)


@dataclass(frozen=True, eq=False)
class Segment:
    """The part of a run that was integrated by one equation, with states (2n,) at its start and end, and (k, 2n) at its samples.

    The first of these samples has the index `row` in the run.
    """

    equation: Equation
    row: int
    start: Array
    states: Array
    end: Array


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """Poses, velocities and accelerations of the links at k states that are given in the variables of one equation of motion.

    Attributes:
        places: (k, links, 2) centres of mass [m].
        raw_angles: (k, links) angles [rad], up to whole turns.
        v, a: (k, n) velocities and accelerations in absolute coordinates.
    """

    places: Array
    raw_angles: Array
    v: Array
    a: Array

    @staticmethod
    def at(equation: Equation, state: Array) -> "LinkMotion":
        """Return the motion of the links at states (k, 2n) in the variables of an equation of motion."""
        n, zero = equation.program.n, np.zeros((len(state), 1))
        # (k, 4 links) x, y, cos, sin of each link; (k, n) first and second derivatives p', p'' by the coordinate q; (k, 1) q''
        pose, first, second, acceleration = equation.motion(zero, state[:, :n], state[:, n:], zero[:, :0])
        x, y, c, s = np.moveaxis(pose.reshape(len(pose), -1, 4), -1, 0)  # (k, links) each
        w = state[:, n : n + 1]  # q'
        v, a = first * w, first * acceleration + second * (w * w)  # v = p' q',  a = p' q'' + p'' q'^2
        return LinkMotion(np.stack([x, y], axis=-1), np.arctan2(s, c), v, a)

    def unwrap(self, near: Array) -> Array:
        """Return q (k, n), with whole turns added to the angles so that they are nearest to `near` (k, links)."""
        q = np.empty_like(self.v)
        places(q)[:], angles(q)[:] = self.places, wind(self.raw_angles, near)
        return q


class MinimalModel:
    """The model of a linkage with one independent coordinate, which another coordinate may replace during a run.

    Attributes:
        sequences: the dyad sequences, one for each possible choice of the independent coordinate.
        sampled: sampled states of the linkage's motion.
        scales: for each sequence an array (dyads,) by which openings are divided: the largest length of an RPR dyad, else 1.
        signs: for each sequence the signs (states, dyads) of the openings at the sampled states.
        smallest_openings: (sequences, states) smallest opening of the dyads, after division by `scales`, at each sampled state.
        steady: indices of the sequences whose openings stay above STEADY at all sampled states; each serves for the whole motion.
        least: smallest opening with which a sequence is used.
        first, present: keys of the equation with which a run starts, and of the equation that is integrated at present.
        y: (2n,) present state in the variables of the present equation: its coordinates q (n,), the independent one first, and
            their rates v (n,).
        tried: keys of the equations that cannot continue from the present state.
        failure: the reason why the run ended early, or an empty text.
    """

    def __init__(self, mechanism: Mechanism, choice: Choice):
        """Measure the openings of all dyad sequences along the motion, and write and check the equation for the start."""
        self.mechanism, self.choice, self.sequences = mechanism, choice, find_sequences(mechanism)
        self.sampled, self.start_angles = manifold_states(mechanism, STATES), angles(mechanism.q0)
        links = Links.of(self.sampled.q, self.sampled.v)
        openings = [sequence.openings(links) for sequence in self.sequences]  # (states, dyads) of each sequence
        # Openings of RRR and RRP are sines and cosines. Those of RPR are lengths, and are divided by their largest value.
        self.scales = [
            np.where([dyad.opening_is_length for dyad in sequence.dyads], np.abs(opening).max(axis=0), 1.0)
            for sequence, opening in zip(self.sequences, openings, strict=True)
        ]
        self.signs = [np.sign(x) for x in openings]
        self.smallest_openings = np.array([_smallest(x, scale) for x, scale in zip(openings, self.scales, strict=True)])
        self.steady = [k for k in range(len(self.sequences)) if self.smallest_openings[k].min() > STEADY]
        # `best_opening`: smallest opening during the motion if the best coordinate is used at each state. `least` is half of it,
        # within NARROW and CHANGE, so that where one coordinate falls to `least`, another has larger openings
        best_opening = float(self.smallest_openings.max(axis=0).min())
        self.least = STEADY / 2 if self.steady else min(CHANGE, max(best_opening / 2, NARROW))
        self.equations: dict[Key, Equation] = {}
        self.machines: dict[Key, Machine] = {}
        start = int(np.abs(self.sampled.q - mechanism.q0).max(axis=1).argmin())  # index of the sampled state nearest to the start
        # the cheapest coordinate that serves for the whole motion, or the one with the largest openings at the start
        candidates = self.steady or [int(self.smallest_openings[:, start].argmax())]
        keys = [Key(k, tuple(self.signs[k][start].tolist())) for k in candidates]
        self.first = min(keys, key=lambda key: self._equation(key).program.acceleration.costs.single)
        self._verify()

    def _states_on_branch(self, key: Key) -> NDArray[np.intp]:
        """Return the indices of the sampled states on the branch of a key at which all openings of dyads are above `least`."""
        is_on_branch = (self.signs[key.sequence] == key.signs).all(axis=1)
        return np.flatnonzero(is_on_branch & (self.smallest_openings[key.sequence] > self.least))

    def _equation(self, key: Key, q: Array | None = None) -> Equation:
        """Return the equation of motion for a key (coordinate and branch); it is derived at the first call and then stored.

        Expressions are tested for equality at sampled positions on the branch, far from dead centres, and at q (n,) if it is given.
        """
        if key not in self.equations:
            on_branch = self._states_on_branch(key)
            widest_first = np.argsort(-self.smallest_openings[key.sequence][on_branch], kind="stable")
            # the half of the states with the largest openings, but at least three, in the order of the motion
            best = sorted(on_branch[widest_first][: max(3, len(on_branch) // 2)])
            positions = self.sampled.q[best] if q is None else np.vstack([self.sampled.q[best], q])
            least = self.least * self.scales[key.sequence]
            self.equations[key] = write_equation(self.mechanism, self.sequences[key.sequence], key.signs, positions, least)
        return self.equations[key]

    def _machine(self, key: Key) -> Machine:
        """Return the machine code that integrates the equation of a key, compiled once."""
        if key not in self.machines:
            self.machines[key] = Machine(self._equation(key), self.choice.integrator)
        return self.machines[key]

    def _measure_openings(self, at: Links) -> dict[Key, float]:
        """Return key -> smallest opening of the dyads at one state, for every sequence; a key has the signs at this state."""
        smallest = {}
        for k, (sequence, scale) in enumerate(zip(self.sequences, self.scales, strict=True)):
            openings = sequence.openings(at)
            smallest[Key(k, tuple(np.sign(openings).tolist()))] = float(_smallest(openings, scale))
        return smallest

    def _verify(self) -> None:
        """Compare q, v, a by the first equation with the linkage's q, v, and a by Gauss's principle, at a few sampled states.

        Raises:
            RunFailure: positions, speeds or accelerations differ.
        """
        evaluator, rows = Evaluator(self.mechanism), self._states_on_branch(self.first)
        for row in rows[:: max(1, len(rows) // CHECKED)]:
            q, v = self.sampled.q[row], self.sampled.v[row]
            a = gauss(evaluator.terms(0.0, q, v)).a
            own_q, own_v, own_a = self._derive(self.first, q, v)
            pairs = {"places": (own_q, q, size(q)), "speeds": (own_v, v, size(v)), "accelerations": (own_a, a, size(a))}
            require_agreement(pairs, AGREEMENT)

    def _convert_state(self, equation: Equation, q: Array, v: Array) -> Array:
        """Convert a state q, v (n,) of the linkage to the state (2n,) in the variables of an equation of motion."""
        return equation.state(Links.of(q, v), {link: float(angle_at(q, link)) for link in equation.angles})

    def _derive(self, key: Key, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return q, v, a (n,) of all links by a key's equation, which takes only the coordinate and its rate from q, v (n,)."""
        equation = self._equation(key, q)
        motion = LinkMotion.at(equation, self._convert_state(equation, q, v)[None])
        return motion.unwrap(angles(q))[0], motion.v[0], motion.a[0]

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        openings = self._measure_openings(Links.of(q, v))
        chosen = max(openings, key=lambda key: openings[key])
        for key, opening in openings.items():
            # the equation in the first coordinate is written already; it is used unless a dyad is too near to a dead centre
            if key.sequence == self.first.sequence and opening > self.least:
                chosen = key
        _, _, a = self._derive(chosen, q, v)
        return finite_acceleration(t, a, "the equation in one coordinate")

    def prepare(self, times: Array, native: bool = True) -> None:
        """Compile the code for a run with samples at the times (k,) [s], and reset to the start."""
        self.times = times
        self.start = self._convert_state(self._equation(self.first), self.mechanism.q0, self.mechanism.v0)
        self.parts = equal_runs(times, self.choice.step)
        machine = self._machine(self.first)
        if not machine.is_adaptive:
            for part in self.parts:
                machine.memory_for(part.samples)  # allocated here, not in a timed run
        self._reset()
        if not self.steady:  # the coordinate changes: a run now compiles the code that this needs
            self.run()
            self._reset()

    def _reset(self) -> None:
        self.y, self.present, self.tried = self.start, self.first, set[Key]()
        self.steps, self.evaluations, self.changes, self.failure = 0, 0, 0, ""
        self.segments: list[Segment] = []

    def run(self) -> None:
        """Integrate the run, and store each result as a `Segment`; if it ends early, `failure` becomes the reason."""
        if self.choice.integrator == ADAPTIVE:
            self._run_adaptive()
        else:
            for part in self.parts:
                self._run_fixed(part)

    def _run_fixed(self, part: EqualSteps) -> None:
        """Take the steps of one part of the run, with a constant step size and a constant number of steps between samples."""
        begin, h, total, done = float(self.times[part.row]), part.size, part.steps * part.samples, 0
        while done < total and not self.failure:
            machine, start = self._machine(self.present), self.y
            count, interval = total - done, part.steps
            if done % interval:  # the coordinate has changed between two samples: one call goes to the next sample only
                count = interval = interval - done % interval
            # samples (k, 2n), number of steps taken before a dyad came too near to its dead centre, and the state after them
            states, steps_taken, end = machine.steps(start, begin + done * h, h, count, interval)
            end = end.copy()  # the next call overwrites the machine's memory
            # a machine that stops early does not return its last state as a sample, even if a sample is due there
            stopped_at_sample = 0 < steps_taken < count and steps_taken % interval == 0
            states = np.vstack([states, end]) if stopped_at_sample else states.copy()
            self.segments.append(Segment(machine.equation, part.row + 1 + done // part.steps, start, states, end))
            done, self.y, self.steps = done + steps_taken, end, self.steps + steps_taken
            if steps_taken < count:  # a dyad came too near to its dead centre
                self._change(begin + done * h, steps_taken)
        self.evaluations = EVALUATIONS[self.choice.integrator] * self.steps

    def _run_adaptive(self) -> None:
        """Take adaptive steps; where the coordinate can no longer be used, store a `Segment` and go on in another coordinate."""
        times, row, t = self.times, 0, float(self.times[0])
        options = Minimal.file.options(self.choice.settings)
        tolerances = self.choice.tolerances(options["dop853_rtol"], options["dop853_atol"])
        while row < len(times) - 1 and not self.failure:
            machine = self._machine(self.present)
            course = machine.course(self.y, np.append(t, times[row + 1 :]), tolerances)
            states = course.samples[1:]  # without the start of this segment
            # `course.state` is the state at which the integrator stopped, possibly between two samples
            end = course.state if row + len(states) < len(times) - 1 else states[-1]
            self.segments.append(Segment(machine.equation, row + 1, self.y, states, end))
            row, self.y, t = row + len(states), end, course.t
            self.steps += course.taken
            self.evaluations += EVALUATIONS["dop853_fixed"] * course.tried
            if row < len(times) - 1:
                self._change(t, course.taken)

    def _change(self, t: float, steps_taken: int) -> None:
        """Replace the coordinate at time t [s] by the one farthest from dead centres, among those that have not failed there.

        Args:
            steps_taken: number of steps since the last change; if it is 0, coordinates that failed at this state remain excluded.
        """
        machine = self._machine(self.present)
        self.tried = {self.present} if steps_taken else self.tried | {self.present}
        if not np.isfinite(self.y).all():
            self.failure = f"t = {t:.6g} s: not finite; a smaller step may help"
            return
        # Poses and velocities of the links; machine code evaluates them, because changing the coordinate is part of the timed run.
        pose, first, *_ = machine.motion(self.y)
        x, y, c, s = pose.reshape(-1, 4).T  # (links,) each
        dx, dy, spin = first.reshape(-1, 3).T * self.y[machine.n]  # derivatives by the coordinate times the coordinate's rate
        here = Links.with_ground((x + 1j * y).tolist(), (c + 1j * s).tolist(), (dx + 1j * dy).tolist(), spin.tolist())
        usable = {key: x for key, x in self._measure_openings(here).items() if key not in self.tried and x > self.least}
        if not usable:
            self.failure = f"t = {t:.6g} s: every coordinate comes too near to a dead centre in a step; a smaller step may help"
            return
        best = max(usable, key=lambda key: usable[key])
        if best not in self.equations:  # its expressions are tested at the present position, where whole turns do not matter
            self._equation(best, LinkMotion.at(machine.equation, self.y[None]).unwrap(0.0 * self.start_angles)[0])
        spring_angles = machine.equation.spring_angles(self.y[: machine.n])
        self.y = self._machine(best).equation.state(here, spring_angles)
        self.present, self.changes = best, self.changes + 1

    def _name_coordinate(self, sequence: DyadSequence) -> str:
        """Return the name of the independent coordinate of a sequence, for the note of a run."""
        joint = sequence.joint
        return f"slide {joint.name}" if joint.motion.unit == "m" else f"angle of {self.mechanism.link_name(sequence.link)}"

    def _follow(self, segment: Segment, values: Array, angles_at_start: Array) -> Array:
        """Return approximate unwrapped angles (k, links) [rad] at values (k,) of a segment's independent coordinate."""
        equation = segment.equation

        def link_angles(x: Array) -> Array:
            """Return the angles (k, links) [rad], without whole turns, at values x (k,) of the coordinate."""
            states = np.zeros((len(x), 2 * equation.program.n))  # poses do not depend on the other entries
            states[:, 0] = x
            return LinkMotion.at(equation, states).raw_angles

        length = typical_length(self.mechanism) if equation.sequence.joint.motion.unit == "m" else None
        return follow(link_angles, float(segment.start[0]), values, angles_at_start, length)

    def read(self) -> Trajectory:
        """Return the samples, with whole turns of angles counted from one segment to the next.

        Raises:
            RunFailure: at some time no coordinate was usable; the exception holds the earlier samples.
        """
        q, v, a = sample_arrays(self.times, *self._derive(self.first, self.mechanism.q0, self.mechanism.v0))
        unwrapped = self.start_angles
        for segment in self.segments:
            rows, states = slice(segment.row, segment.row + len(segment.states)), np.vstack([segment.states, segment.end])
            motion = LinkMotion.at(segment.equation, states)
            positions = motion.unwrap(self._follow(segment, states[:, 0], unwrapped))
            q[rows], v[rows], a[rows] = positions[:-1], motion.v[:-1], motion.a[:-1]
            unwrapped = angles(positions[-1])  # at the end of this segment, where the next one starts
        coordinates = ", ".join(dict.fromkeys(self._name_coordinate(x.equation.sequence) for x in self.segments))
        note = f"in one coordinate: {coordinates}" + (f", changed {self.changes} times" if self.changes else "")
        trajectory = Trajectory(self.times, q, v, a, self.steps, self.evaluations, note)
        if self.failure:
            raise RunFailure(Status.NOT_CONVERGED, self.failure, trajectory)
        return trajectory


def _smallest(openings: Array, scale: Array) -> Array:
    """Return the smallest opening (...) of all dyads, from openings (..., dyads) and their scales (dyads,); 1 without dyads."""
    return np.asarray((np.abs(openings) / scale).min(axis=-1, initial=1.0))


def is_spring_on_sum_of_angles(load: Load) -> bool:
    """Tell whether a load is a spring on a weighted sum that includes an angle; whole turns of such sums are not counted here."""
    if not (isinstance(load, Law) and load.k and isinstance(load.coordinate, Weighted)):
        return False
    return any(isinstance(x, Angle) for x, _ in load.coordinate.terms)
