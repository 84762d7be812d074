"""Engines with a known fault: what the diagnosis must name, and what the suite's own test of itself plants.

Each is one of the suite's formulations with its integrators, sound but for one thing, which is data here: how the fault spoils the
linkage that is modelled, the terms at a state, the accelerations, a state after a step, or the samples that are read. A fault that
was seen in an engine names it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gauss_bench.diagnosis.causes import Cause
from gauss_bench.engines.base import Choice
from gauss_bench.engines.interpreted import Interpreted, InterpretedModel
from gauss_bench.integrate.fixed_step import STEPS, step_counts
from gauss_bench.mechanism.model import Mechanism, Revolute
from gauss_bench.mechanism.tree import spanning_tree
from gauss_bench.terms import Array, Solution, Terms, recover_multipliers
from gauss_bench.trajectory import Trajectory

State = tuple[Array, Array]
FORMULATION = "lagrange"  # the fastest of those that are not compiled
RESET_AT = 0.23  # [s]


def same(item: Any, *_: Any) -> Any:
    """Spoil nothing."""
    return item


@dataclass(frozen=True)
class Fault:
    """One planted fault.

    Attributes:
        name: of the fault; sentence: what is wrong.
        cause: what the diagnosis must say.
        linkage: the mechanism that is modelled.
        terms: (terms, model, t, q, v) -> terms that are solved.
        solved: (solution, terms, model) -> solution.
        stepped: (state, model, t) -> state after the step that ended at t.
        times: (times, step) -> times that are sampled in place of those asked for; of as many.
        read: (trajectory, mechanism) -> what is told.
        where: linkage and scenario in which it shows.
    """

    name: str
    sentence: str
    cause: Cause
    linkage: Callable[[Mechanism], Mechanism] = same
    terms: Callable[[Terms, "FaultyModel", float, Array, Array], Terms] = same
    solved: Callable[[Solution, Terms, "FaultyModel"], Solution] = same
    stepped: Callable[[State, "FaultyModel", float], State] = same
    times: Callable[[Array, float], Array] = same
    read: Callable[[Trajectory, Mechanism], Trajectory] = same
    where: tuple[str, str] = ("four_bar", "torque")


class FaultyModel(InterpretedModel):
    """A sound model but for the fault.

    Attributes:
        recent: constraint rows (J, gamma) at the beginning of the steps so far, the last two of them.
        first: constraint rows at the start.
        running: whether steps are being taken.
        reset: whether it has been set back.
    """

    def __init__(self, fault: Fault, mechanism: Mechanism, choice: Choice):
        super().__init__(FORMULATION, fault.linkage(mechanism), choice)
        self.fault, self.true = fault, mechanism
        rows = self.evaluator.constraints(0.0, self.mechanism.q0, self.mechanism.v0)
        self.first = (rows.J, rows.gamma)
        self.recent = [self.first, self.first]
        self.running = False

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self._solve(t, self.fault.terms(self.evaluator.terms(t, q, v), self, t, q, v)).a

    def stabilized(self, t: float, q: Array, v: Array) -> Array:
        self.evaluations += 1
        return self.acceleration(t, q, v)

    def _solve(self, t: float, terms: Terms) -> Solution:
        return self.fault.solved(super()._solve(t, terms), terms, self)

    def prepare(self, times: Array, native: bool = True) -> None:
        self.asked = times
        self.reset = False
        self.recent = [self.first, self.first]
        super().prepare(self.fault.times(times, self.choice.step), native)

    def run(self) -> None:
        self.running = True
        super().run()
        self.running = False

    def _run_fixed(self) -> None:
        step, before = STEPS[self.choice.integrator], 0.0
        q, v = self.mechanism.q0, self.mechanism.v0
        for k, (count, h) in enumerate(step_counts(self.times, self.choice.step)):
            for i in range(count if self.times[k + 1] > self.times[k] else 0):
                t = float(self.times[k]) + i * h
                rows = self.evaluator.constraints(t, q, v)
                self.recent = [self.recent[1], (rows.J, rows.gamma)]
                q, v = step(self.stabilized, t, q, v, h)
                if self.choice.stabilization == "projection":
                    q, v = self.evaluator.project(t + h, q, v)
                before = t + h
                q, v = self.fault.stepped((q, v), self, before)
                self.steps += 1
            self.x[k + 1], self.dx[k + 1] = q, v

    def read(self) -> Trajectory:
        trajectory = replace(super().read(), t=self.asked)
        return self.fault.read(trajectory, self.true)


class Faulty(Interpreted):
    """An engine with one planted fault."""

    def __init__(self, fault: Fault):
        super().__init__(FORMULATION)
        self.fault, self.name = fault, fault.name

    def build(self, mechanism: Mechanism, choice: Choice) -> FaultyModel:
        return FaultyModel(self.fault, mechanism, choice)


# what is wrong with the linkage that is modelled


def scale(name: str, **factors: float) -> Callable[[Mechanism], Mechanism]:
    """A link's mass or inertia times a factor."""

    def altered(mechanism: Mechanism) -> Mechanism:
        links = [
            replace(x, **{key: getattr(x, key) * factor for key, factor in factors.items()}) if x.name == name else x
            for x in mechanism.links
        ]
        return replace(mechanism, links=tuple(links))

    return altered


def force_scaled(name: str, key: str, factor: float) -> Callable[[Mechanism], Mechanism]:
    """A number of a force times a factor."""

    def altered(mechanism: Mechanism) -> Mechanism:
        forces = [replace(x, **{key: getattr(x, key) * factor}) if x.name == name else x for x in mechanism.forces]
        return replace(mechanism, forces=tuple(forces))

    return altered


def gravity_turned(mechanism: Mechanism) -> Mechanism:
    return replace(mechanism, gravity=-np.asarray(mechanism.gravity))


# what is wrong with the terms


def closing_rows(model: FaultyModel) -> list[int]:
    """Rows of the last pin of the file."""
    at = [k for k, joint in enumerate(model.mechanism.joints) if isinstance(joint, Revolute)][-1]
    return [2 * at, 2 * at + 1]


def soft_loop(terms: Terms, model: FaultyModel, t: float, q: Array, v: Array) -> Terms:
    """The last pin as a spring and damper between its two points."""
    rows = closing_rows(model)
    kept = [k for k in range(len(terms.J)) if k not in rows]
    J, k, c = terms.J[rows], 2e4, 40.0
    Q = terms.Q - J.T @ (k * terms.phi[rows] + c * terms.phi_dot[rows])
    return replace(terms, J=terms.J[kept], gamma=terms.gamma[kept], phi=terms.phi[kept], phi_dot=terms.phi_dot[kept], Q=Q)


def ignore_joint(terms: Terms, model: FaultyModel, t: float, q: Array, v: Array) -> Terms:
    kept = [k for k in range(len(terms.J)) if k not in closing_rows(model)]
    return replace(terms, J=terms.J[kept], gamma=terms.gamma[kept], phi=terms.phi[kept], phi_dot=terms.phi_dot[kept])


def ignore_constraints(terms: Terms, model: FaultyModel, t: float, q: Array, v: Array) -> Terms:
    none = np.zeros(0)
    return replace(terms, J=terms.J[:0], gamma=none, phi=none, phi_dot=none)


def stale(terms: Terms, model: FaultyModel, t: float, q: Array, v: Array) -> Terms:
    """Constraint data of the step before, while steps are taken; samples are told with sound accelerations."""
    J, gamma = model.recent[0] if model.running else (terms.J, terms.gamma)
    return replace(terms, J=J, gamma=gamma)


def frozen(terms: Terms, model: FaultyModel, t: float, q: Array, v: Array) -> Terms:
    """The Jacobian of the start, never updated."""
    return replace(terms, J=model.first[0])


def without_velocity_terms(terms: Terms, model: FaultyModel, t: float, q: Array, v: Array) -> Terms:
    return replace(terms, gamma=0 * terms.gamma)


def without_second_rate(terms: Terms, model: FaultyModel, t: float, q: Array, v: Array) -> Terms:
    """The second time derivative of what drivers prescribe left out."""
    gamma = terms.gamma.copy()
    for row, driver in enumerate(model.mechanism.drivers, model.evaluator.constraints.joint_rows):
        gamma[row] -= float(driver.law(t)[2])
    return replace(terms, gamma=gamma)


def compliant(solution: Solution, terms: Terms, model: FaultyModel) -> Solution:
    """Constraint forces of a solver that regularises: J a = gamma + eps lambda, with Baumgarte's terms against the drift."""
    n, m = len(terms.Q), len(terms.gamma)
    gamma = terms.gamma - 100.0 * terms.phi_dot - 2500.0 * terms.phi
    K = np.block([[terms.M, terms.J.T], [terms.J, -0.5 * np.eye(m)]])
    x = np.linalg.solve(K, np.concatenate([terms.Q, gamma]))
    return Solution(x[:n], x[n:], m)


def half_force(solution: Solution, terms: Terms, model: FaultyModel) -> Solution:
    """Velocities and everything else right, accelerations a third too large: a wrong factor at the end."""
    return Solution(1.3 * solution.a, recover_multipliers(terms, solution.a), solution.rank)


# what is wrong with the steps


def reset(state: State, model: FaultyModel, t: float) -> State:
    """Back to the start and at rest, as an engine does that has met what is no number."""
    if not model.reset and t >= RESET_AT:
        model.reset = True
        return model.mechanism.q0, 0 * model.mechanism.v0
    return state


def single_precision(state: State, model: FaultyModel, t: float) -> State:
    q, v = (x.astype(np.float32).astype(float) for x in state)
    return q, v


# what is wrong with the samples


def one_step_late(times: Array, step: float) -> Array:
    return np.where(times > 0, times + step, times)


def half_a_step_early(times: Array, step: float) -> Array:
    return np.where(times > 0, times - step / 2, times)


def stretch(times: Array, step: float) -> Array:
    return times * 1.01


def standing_still(trajectory: Trajectory, mechanism: Mechanism) -> Trajectory:
    return replace(trajectory, q=0 * trajectory.q + trajectory.q[0], v=0 * trajectory.v, a=0 * trajectory.a)


def within_a_turn(trajectory: Trajectory, mechanism: Mechanism) -> Trajectory:
    q = trajectory.q.copy()
    q[:, 2::3] = (q[:, 2::3] + np.pi) % (2 * np.pi) - np.pi
    return replace(trajectory, q=q)


def backwards(trajectory: Trajectory, mechanism: Mechanism) -> Trajectory:
    return replace(trajectory, v=-trajectory.v)


def links_in_another_order(trajectory: Trajectory, mechanism: Mechanism) -> Trajectory:
    """The first two links change places."""
    order = np.arange(mechanism.n).reshape(-1, 3)
    order[[0, 1]] = order[[1, 0]]
    columns = order.ravel()
    return replace(trajectory, q=trajectory.q[:, columns], v=trajectory.v[:, columns], a=trajectory.a[:, columns])


def breadth_first_joints(trajectory: Trajectory, mechanism: Mechanism) -> Trajectory:
    """Joint coordinates of a library that lists joints level by level, read as if it listed them branch by branch."""
    tree = spanning_tree(mechanism)
    depth = {-1: 0}
    for branch in tree.branches:
        depth[branch.link] = depth[branch.parent] + 1
    order = sorted(range(tree.n), key=lambda k: depth[tree.branches[k].link])
    if order == list(range(tree.n)):
        order = order[::-1]
    y, dy = tree.relative(trajectory.q, trajectory.v)
    q, v, a = tree.absolute(y[:, order], dy[:, order], 0 * dy)
    return replace(trajectory, q=q, v=v, a=a)


CRANK_SLIDER, DRIVEN = ("crank_slider", "paper"), ("four_bar", "cycloid")
ENGINES = (
    Fault("soft_loop", "a pin is a spring and a damper", Cause.SOFTNESS, terms=soft_loop),
    Fault("soft_solver", "the solver regularises its constraint forces", Cause.SOFTNESS, solved=compliant, where=CRANK_SLIDER),
    Fault("inertia", "the crank's inertia is 1 % too large", Cause.INERTIA, linkage=scale("crank", inertia=1.01)),
    Fault(
        "rod_inertia", "the rod's inertia is 1 % too small", Cause.INERTIA, linkage=scale("rod", inertia=0.99), where=CRANK_SLIDER
    ),
    Fault("mass", "the coupler's mass is 1 % too large", Cause.MASS, linkage=scale("coupler", mass=1.01)),
    Fault("gravity", "gravity has the wrong sign", Cause.GRAVITY, linkage=gravity_turned),
    Fault("damping", "a damper is 2 % too strong", Cause.FORCE, linkage=force_scaled("brake", "c", 1.02)),
    Fault("spring", "a spring is 1 % too stiff", Cause.FORCE, linkage=force_scaled("spring", "k", 1.01), where=CRANK_SLIDER),
    Fault("factor", "accelerations are 1.3 times too large", Cause.ACCELERATIONS, solved=half_force),
    Fault("velocity_terms", "the velocity terms of the loops are left out", Cause.VELOCITY_TERMS, terms=without_velocity_terms),
    Fault("ignored_joint", "a joint is left out", Cause.IGNORED, terms=ignore_joint, where=CRANK_SLIDER),
    Fault("ignored", "an explicit solver leaves out all constraints", Cause.IGNORED, terms=ignore_constraints),
    Fault(
        "second_rate", "a driver's second time derivative is left out", Cause.SECOND_RATE, terms=without_second_rate, where=DRIVEN
    ),
    Fault("frozen", "the constraint Jacobian is never updated", Cause.STALE, terms=frozen),
    Fault("stale", "constraint data are those of the step before", Cause.STALE, terms=stale),
    Fault("reset", "the state jumps back to the start", Cause.RESET, stepped=reset),
    Fault("links", "two links change places in the output", Cause.ORDER, read=links_in_another_order),
    Fault("breadth_first", "joints are read in another order", Cause.ORDER, read=breadth_first_joints, where=CRANK_SLIDER),
    Fault("single", "states are rounded to single precision", Cause.ROUND_OFF, stepped=single_precision),
    Fault("late", "samples are those of the step after", Cause.SHIFT, times=one_step_late),
    Fault("early", "samples are half a step early", Cause.SHIFT, times=half_a_step_early, where=CRANK_SLIDER),
    Fault("stretched", "samples are taken 1 % too slowly", Cause.STRETCH, times=stretch),
    Fault("still", "samples stand still", Cause.STATIONARY, read=standing_still),
    Fault("wrapped", "angles are brought back into one turn", Cause.WRAPPED, read=within_a_turn, where=CRANK_SLIDER),
    Fault("backwards", "velocities are told with the wrong sign", Cause.VELOCITIES, read=backwards),
)
CLEAN = Fault("clean", "nothing is wrong", Cause.NONE)
BY_NAME: Mapping[str, Fault] = {x.name: x for x in (CLEAN, *ENGINES)}
