"""Pinocchio: a tree of joints in relative coordinates, closed by rigid point constraints and integrated by the suite.

The tree coordinates y are Pinocchio's own vectors, so `Tree` alone maps them to absolute states. With A_k the placement of the
centre of mass of link k in the frame of the joint that carries it, and all placements turned about z only:

    revolute    A_parent T(anchor on the parent),                  RZ,    A = T(-anchor)
    prismatic   A_parent T(anchor + base) R(axis),                 PX,    A = R(turn - axis) T(-anchor)
    free        PX, PY, RZ from the ground at the centre of mass,         A = 1

Each pin the tree leaves open becomes a CONTACT_3D constraint: two rows in the plane and a third that is identically zero. Its
proximal iterations solve

    M y'' + h = tau + J^T f,    J y'' + mu (f - f_before) = gamma

so that mu times the last change of the forces f is what the constraints are still missed by. f itself is never read: its sign and
frame do not matter here.

Pinocchio has no springs and dampers, and no integrator for constrained systems: forces other than gravity reach it as tau, and the
steps are the suite's, in tree coordinates. Baumgarte's terms are Pinocchio's own. Projection is the suite's, in absolute
coordinates; mapped back to the tree it closes the open pins. Redundant rows that have drifted apart contradict each other: the
iterations then do not settle, and the run is given up rather than followed. Projection keeps them together.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.integrate.adaptive import StepFailure, dop853
from gauss_bench.integrate.fixed_step import STEPS, step_counts
from gauss_bench.integrate.stabilization import BAUMGARTE_RATE, STABILIZATIONS
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import GROUND, Force, Mechanism, Point, Prismatic, Revolute
from gauss_bench.mechanism.tree import Branch, Tree, spanning_tree
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

COMMON = {
    "baumgarte_Kp_per_s2": BAUMGARTE_RATE**2,
    "baumgarte_Kd_per_s": 2 * BAUMGARTE_RATE,
    "dop853_rtol": 1e-10,
    "dop853_atol": 1e-12,
}
SETTINGS: Mapping[str, Mapping[str, float]] = {
    "default": {"absolute_accuracy": 1e-14, "relative_accuracy": 1e-14, "mu": 1e-8, "max_iter": 20, **COMMON},
    "one_iteration": {"absolute_accuracy": 1e-14, "relative_accuracy": 1e-14, "mu": 1e-14, "max_iter": 1, **COMMON},
}
AGREEMENT = 1e-10  # relative: rounding of both sides leaves about 1e-14, a wrong sign or lever about 1
AFFINE = 1e-10  # relative: rounding leaves about 1e-14; a force that is affine only this far may as well be affine
SOLVED = 1e-6  # of the largest acceleration: independent rows are met to 1e-13; redundant ones that part pass this on their way


class Pinocchio:
    """The engine."""

    name = "pinocchio"
    integrators = ("rk4", "semi_implicit_euler", "dop853")
    stabilizations = STABILIZATIONS
    settings = SETTINGS
    native_loop = False
    python_loop = True

    def version(self) -> str:
        import pinocchio

        return f"Pinocchio {pinocchio.__version__}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if mechanism.drivers:
            return "a prescribed motion is not modelled in Pinocchio here"
        if mechanism.knife_edges:
            return "Pinocchio has no constraint on velocities alone (knife edge)"
        for joint in spanning_tree(mechanism).closures:
            if isinstance(joint, Prismatic):
                return f"the slide {joint.name} closes a loop of slides, for which Pinocchio has no constraint"
        if choice.integrator == "dop853" and choice.stabilization == "projection":
            return "projection between steps needs a fixed-step integrator"
        return None

    def build(self, mechanism: Mechanism, choice: Choice) -> "PinocchioModel":
        return PinocchioModel(mechanism, choice)


# The model --------------------------------------------------------------------------------------------------------------


class Multibody:
    """The mechanism in Pinocchio: a model of its tree and the constraints that close it.

    Attributes:
        carriers: joint and placement of the centre of mass in that joint's frame, of every link and the ground.
    """

    def __init__(self, mechanism: Mechanism, tree: Tree):
        import pinocchio

        self.pin: Any = pinocchio
        self.model: Any = pinocchio.Model()
        self.model.gravity.linear = np.array([*mechanism.gravity, 0.0])
        self.carriers: dict[int, tuple[int, Any]] = {GROUND: (0, pinocchio.SE3.Identity())}
        for b in tree.branches:
            self._add_link(mechanism, b)
        self.pins = [(j.a, j.b) for j in tree.closures if isinstance(j, Revolute)]
        if not self.model.check(self.model.createData()):
            raise RunFailure(Status.ERROR, "Pinocchio refuses the generated tree: its own check of the model fails")

    def _add_link(self, mechanism: Mechanism, b: Branch) -> None:
        pin, link = self.pin, mechanism.links[b.link]
        parent, centre = self.carriers[b.parent]
        match b.kind:
            case "revolute":
                joint = self._joint(parent, pin.JointModelRZ(), centre * self.planar(b.parent_anchor))
                own = self.planar(-b.anchor)
            case "prismatic":
                direction = float(np.arctan2(b.axis[1], b.axis[0]))
                joint = self._joint(parent, pin.JointModelPX(), centre * self.planar(b.parent_anchor + b.base, direction))
                own = self.planar(np.zeros(2), b.turn - direction) * self.planar(-b.anchor)
            case _:
                joint, own = 0, pin.SE3.Identity()
                for kind in (pin.JointModelPX(), pin.JointModelPY(), pin.JointModelRZ()):
                    joint = self._joint(joint, kind, pin.SE3.Identity())
        lamina = np.diag([link.inertia / 2, link.inertia / 2, link.inertia])  # only the last acts in the plane
        self.model.appendBodyToJoint(joint, pin.Inertia(link.mass, np.zeros(3), lamina), own)
        self.carriers[b.link] = joint, own

    def _joint(self, parent: int, kind: Any, placement: Any) -> int:
        return int(self.model.addJoint(parent, kind, placement, f"joint{self.model.njoints}"))

    def planar(self, origin: Array, angle: float = 0.0) -> Any:
        """SE3 of a planar displacement (2,) and rotation [rad]; without a rotation, free of rounding."""
        c, s = np.cos(angle), np.sin(angle)
        return self.pin.SE3(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([*origin, 0.0]))

    def placed(self, point: Point) -> tuple[int, Any]:
        """Joint that carries a point, and the point's placement in its frame."""
        joint, centre = self.carriers[point.link]
        return joint, centre * self.planar(point.local)

    def constraints(self, gains: tuple[float, float]) -> Any:
        """One point constraint per open pin, with Baumgarte gains Kp, Kd; its rows are world axes, as those of the suite."""
        pin = self.pin
        rows = pin.StdVec_RigidConstraintModel()
        for a, b in self.pins:
            frame = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            row = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, self.model, *self.placed(a), *self.placed(b), frame)
            row.m_baumgarte_parameters.Kp, row.m_baumgarte_parameters.Kd = gains
            rows.append(row)
        return rows

    def inverse_dynamics(self, y: Array, dy: Array, ddy: Array) -> Array:
        """tau (n,) that gives the tree, opened, the accelerations ddy."""
        return np.array(self.pin.rnea(self.model, self.model.createData(), y, dy, ddy))

    def gaps(self, y: Array) -> Array:
        """Point b minus point a of every open pin (2 pins,) [m], from Pinocchio's own kinematics."""
        data = self.model.createData()
        self.pin.forwardKinematics(self.model, data, y)

        def world(point: Point) -> Array:
            joint, placement = self.placed(point)
            return np.array((data.oMi[joint] * placement).translation)[:2]

        return np.concatenate([np.zeros(0), *(world(b) - world(a) for a, b in self.pins)])


def verify(body: Multibody, mechanism: Mechanism, tree: Tree) -> None:
    """Compare the generated model with the linkage at the start and at random tree states, closed or not.

    rnea = tree forces of (M a - gravity) checks masses, inertias, placements, axes and gravity at once; the gaps of the open pins
    check the points they join. What is left is Pinocchio's solver.

    Raises:
        RunFailure: they differ.
    """
    evaluator, rng = Evaluator(replace(mechanism, forces=())), np.random.default_rng(0)
    open_rows = [2 * k + axis for j in tree.closures for k, x in enumerate(mechanism.joints) if x is j for axis in (0, 1)]
    start = tree.relative(mechanism.q0, mechanism.v0)
    for y, dy in [start, *((start[0] + rng.standard_normal(tree.n), rng.standard_normal(tree.n)) for _ in range(3))]:
        ddy = rng.standard_normal(tree.n)
        q, v, a = tree.absolute(y, dy, ddy)
        terms = evaluator.terms(0.0, q, v)
        pairs = {
            "inverse dynamics": (body.inverse_dynamics(y, dy, ddy), tree.forces(q, terms.M @ a - terms.Q)),
            "open pins": (body.gaps(y), terms.phi[open_rows]),
        }
        for what, (found, expected) in pairs.items():
            error = np.abs(found - expected).max(initial=0.0) / max(np.abs(expected).max(initial=0.0), 1.0)
            if not error <= AGREEMENT:
                raise RunFailure(Status.ERROR, f"the generated model differs from the linkage: {what} by {error:.1e} (relative)")


# Forces -----------------------------------------------------------------------------------------------------------------


class TreeForces:
    """Applied forces without gravity as tau (n,) of a tree state.

    What is affine in the tree state (torques, dampers of joints, springs along slides) is tabulated once, as a user of Pinocchio
    would write it by hand; the others are evaluated each time, with v = T dy from Pinocchio's joint Jacobians:

        tau = constant + stiffness y + damping dy + T^T Q_others(q, v)

    Attributes:
        others: the forces that are not affine.
    """

    def __init__(self, mechanism: Mechanism, tree: Tree, body: Multibody):
        self.tree, self.weightless = tree, replace(mechanism, gravity=np.zeros(2))
        self.constant, slope = np.zeros(tree.n), np.zeros((tree.n, 2 * tree.n))
        self.others: tuple[Force, ...] = ()
        for f in mechanism.forces:
            found = self._tabulated(f)
            if found is None:
                self.others += (f,)
            else:
                self.constant, slope = self.constant + found[0], slope + found[1]
        self.stiffness, self.damping = slope[:, : tree.n].copy(), slope[:, tree.n :].copy()
        self.has_stiffness, self.has_damping = bool(self.stiffness.any()), bool(self.damping.any())
        self.applied = AppliedForces(replace(self.weightless, forces=self.others))
        self.motion = Motion(tree, body)

    def _tabulated(self, f: Force) -> tuple[Array, Array] | None:
        """Constant (n,) and slope (n, 2n) of one force, read off unit states; None if random states contradict them."""
        n, applied = self.tree.n, AppliedForces(replace(self.weightless, forces=(f,)))
        states = np.vstack([np.zeros(2 * n), np.eye(2 * n), np.random.default_rng(0).uniform(-3.0, 3.0, (8, 2 * n))])
        q, v, _ = self.tree.absolute(states[:, :n], states[:, n:], np.zeros((len(states), n)))
        tau = self.tree.forces(q, applied.generalised(q, v))
        constant, slope = tau[0], (tau[1 : 2 * n + 1] - tau[0]).T
        error = np.abs(constant + states @ slope.T - tau).max()
        return (constant, slope) if error <= AFFINE * np.abs(tau).max() else None

    def __call__(self, y: Array, dy: Array) -> Array:
        tau = self.constant
        if self.has_damping:
            tau = tau + self.damping.dot(dy)
        if self.has_stiffness:
            tau = tau + self.stiffness.dot(y)
        if self.others:
            q, T = self.motion(y)
            tau = tau + self.applied.generalised(q, T.dot(dy)).dot(T)
        return tau


class Motion:
    """Absolute positions q (3 links,) and T (3 links, n), with v = T dy, by Pinocchio's kinematics: a tenth of the time of `Tree`.

    A column of a world Jacobian is the velocity [u, w] at the origin and the angular speed omega, for every link that the joint
    carries: the centre of mass at [x, y] moves with [u - omega y, w + omega x].
    """

    def __init__(self, tree: Tree, body: Multibody):
        self.model, self.data, self.jacobians = body.model, body.model.createData(), body.pin.computeJointJacobians
        self.centres = [(joint, np.array(own.translation)) for joint, own in (body.carriers[i] for i in range(tree.links))]
        states = np.vstack([np.zeros(tree.n), np.eye(tree.n)])
        theta = tree.absolute(states, states, states)[0][:, 2::3]
        self.theta0, self.turns = theta[0], (theta[1:] - theta[0]).T
        self.carried = np.zeros((tree.links + 1, tree.n))  # the last row is the ground
        for b in tree.branches:
            self.carried[b.link] = self.carried[b.parent]
            self.carried[b.link, b.at : b.at + (3 if b.kind == "free" else 1)] = 1.0
        self.carried = self.carried[:-1]

    def __call__(self, y: Array) -> tuple[Array, Array]:
        J = self.jacobians(self.model, self.data, y)
        placements = self.data.oMi
        centres = np.array([placements[joint].act(own) for joint, own in self.centres])
        q, T = np.empty(3 * len(centres)), np.empty((3 * len(centres), len(y)))
        q[0::3], q[1::3], q[2::3] = centres[:, 0], centres[:, 1], self.theta0 + self.turns.dot(y)
        T[0::3] = self.carried * (J[0] - centres[:, 1, None] * J[5])
        T[1::3] = self.carried * (J[1] + centres[:, 0, None] * J[5])
        T[2::3] = self.turns
        return q, T


# Accelerations and steps ------------------------------------------------------------------------------------------------


class ConstrainedDynamics:
    """Tree accelerations (n,) of a tree state, as the integrators of the suite call them; `evaluations` counts the calls."""

    def __init__(self, body: Multibody, forces: TreeForces, settings: Mapping[str, float], gains: tuple[float, float]):
        pin = body.pin
        self.model, self.forces, self.solve = body.model, forces, pin.constraintDynamics
        self.data: Any = body.model.createData()
        self.rows: Any = body.constraints(gains)
        self.row_data: Any = pin.StdVec_RigidConstraintData()
        for row in self.rows:
            self.row_data.append(row.createData())
        pin.initConstraintDynamics(self.model, self.data, self.rows, self.row_data)
        accuracies = settings["absolute_accuracy"], settings["relative_accuracy"]
        self.prox: Any = pin.ProximalSettings(*accuracies, settings["mu"], int(settings["max_iter"]))
        self.limit = SOLVED / settings["mu"]
        self.evaluations = 0

    def __call__(self, t: float, y: Array, dy: Array) -> Array:
        self.evaluations += 1
        a: Array = self.solve(self.model, self.data, y, dy, self.forces(y, dy), self.rows, self.row_data, self.prox)
        if not self.prox.relative_residual <= self.limit:
            self._doubt(t, a)
        return a

    def _doubt(self, t: float, a: Array) -> None:
        """Second look, relative to the accelerations.

        `relative_residual` is the last change of the forces f. `absolute_residual` is no help: at exact accelerations it is as
        large as they are (4.1). `iter` is none either: with redundant rows f wanders along directions that move nothing.

        Raises:
            RunFailure: not finite, or the constraints are missed.
        """
        if not np.isfinite(a).all():
            raise RunFailure(Status.NAN, f"not finite at t = {t:.6g} s; a smaller step may help")
        missed, size = self.prox.mu * self.prox.relative_residual, max(1.0, float(np.abs(a).max()))
        if not missed <= SOLVED * size:
            raise RunFailure(
                Status.NOT_CONVERGED,
                f"t = {t:.6g} s: proximal iteration {self.prox.iter} still misses the constraints by {missed:.1e} m/s^2 where "
                f"accelerations are {size:.1e}; redundant rows that have drifted apart do this: try projection or a smaller step",
            )


class PinocchioModel:
    """A mechanism in Pinocchio under one integrator and stabilisation of the suite."""

    def __init__(self, mechanism: Mechanism, choice: Choice):
        self.mechanism, self.choice = mechanism, choice
        self.tree, self.evaluator = spanning_tree(mechanism), Evaluator(mechanism)
        body = Multibody(mechanism, self.tree)
        verify(body, mechanism, self.tree)
        self.forces, settings = TreeForces(mechanism, self.tree, body), SETTINGS[choice.settings]
        gains = (BAUMGARTE_RATE**2, 2 * BAUMGARTE_RATE) if choice.stabilization == "baumgarte" else (0.0, 0.0)
        self.plain = ConstrainedDynamics(body, self.forces, settings, (0.0, 0.0))  # what is reported has no Baumgarte terms
        self.stabilized = ConstrainedDynamics(body, self.forces, settings, gains)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        with np.errstate(all="ignore"):
            y, dy = self.tree.relative(q, v)
            a = self.tree.absolute(y, dy, self.plain(t, y, dy))[2]
        if not np.isfinite(a).all():
            raise RunFailure(Status.NAN, f"t = {t:.6g} s: Pinocchio's acceleration is not finite")
        return a

    def prepare(self, times: Array, native: bool = True) -> None:
        """There is only the suite's own loop, whatever `native` says."""
        self.times, self.steps, self.stabilized.evaluations = times, 0, 0
        start = self.tree.relative(self.mechanism.q0, self.mechanism.v0)
        self.y, self.dy = (np.tile(x, (len(times), 1)) for x in start)

    def run(self) -> None:
        with np.errstate(all="ignore"):  # what is not finite is found afterwards
            if self.choice.integrator == "dop853":
                self._adaptive()
            else:
                self._fixed()

    def _adaptive(self) -> None:
        if self.times[-1] == self.times[0]:
            return
        options = SETTINGS[self.choice.settings]
        try:
            found = dop853(self.stabilized, self.times, self.y[0], self.dy[0], options["dop853_rtol"], options["dop853_atol"])
        except StepFailure as error:
            raise RunFailure(Status.NOT_CONVERGED, f"DOP853 could not continue: {error}") from error
        self.y, self.dy, self.steps, _ = found

    def _fixed(self) -> None:
        step, dynamics = STEPS[self.choice.integrator], self.stabilized
        projected = self.choice.stabilization == "projection"
        y, dy = self.y[0], self.dy[0]
        for k, (count, h) in enumerate(step_counts(self.times, self.choice.step)):
            for i in range(count):
                t = float(self.times[k]) + i * h
                y, dy = step(dynamics, t, y, dy, h)
                if projected:
                    y, dy = self._projected(t + h, y, dy)
            if not (np.isfinite(y).all() and np.isfinite(dy).all()):
                raise RunFailure(Status.NAN, f"not finite at t = {self.times[k + 1]:.6g} s; a smaller step may help")
            self.y[k + 1], self.dy[k + 1] = y, dy
            self.steps += count

    def _projected(self, t: float, y: Array, dy: Array) -> tuple[Array, Array]:
        q, v, _ = self.tree.absolute(y, dy, dy)
        try:
            return self.tree.relative(*self.evaluator.project(t, q, v))
        except np.linalg.LinAlgError as error:
            raise RunFailure(Status.NAN, f"t = {t:.6g} s: nothing finite left to project; a smaller step may help") from error

    def read(self) -> Trajectory:
        ddy = np.array([self.plain(t, y, dy) for t, y, dy in zip(self.times, self.y, self.dy, strict=True)])
        q, v, a = self.tree.absolute(self.y, self.dy, ddy)
        self._check(q, v, a)
        slow = ", ".join(f.name for f in self.forces.others)
        note = f"forces evaluated in Python at every step, which takes longer than Pinocchio does: {slow}" if slow else ""
        return Trajectory(self.times, q, v, a, self.steps, self.stabilized.evaluations, note)

    def _check(self, q: Array, v: Array, a: Array) -> None:
        """The samples are finite, and their accelerations satisfy the suite's own constraint rows.

        Raises:
            RunFailure: they do not.
        """
        finite = np.isfinite(np.hstack([q, v, a])).all(axis=1)
        if not finite.all():
            raise RunFailure(Status.NAN, f"not finite at t = {self.times[int(np.argmin(finite))]:.6g} s; a smaller step may help")
        rows = self.evaluator.constraints(self.times, q, v)
        missed = np.abs(np.einsum("kij,kj->ki", rows.J, a) - rows.gamma).max(axis=1, initial=0.0)
        missed /= np.maximum(1.0, np.abs(a).max(axis=1))
        if (missed > SOLVED).any():
            k = int(np.argmax(missed > SOLVED))
            text = f"t = {self.times[k]:.6g} s: the accelerations miss the constraints by {missed[k]:.1e} of their size"
            raise RunFailure(Status.NOT_CONVERGED, text)
