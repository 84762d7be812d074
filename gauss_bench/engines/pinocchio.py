"""Pinocchio: a tree of joints in relative coordinates, closed by rigid point constraints and integrated by the suite.

The tree coordinates y are Pinocchio's own, so its plain vectors are mapped to absolute states by `Tree` alone. With A_k the placement
of the centre of mass of link k in the frame of the joint that carries it, and all placements turned about z only:

    revolute    A_parent T(anchor on the parent),                  RZ,    A = T(-anchor)
    prismatic   A_parent T(anchor + base) R(axis),                 PX,    A = R(turn - axis) T(-anchor)
    free        PX, PY, RZ from the ground at the centre of mass,         A = 1

Each pin the tree leaves open becomes a CONTACT_3D constraint: two rows in the plane and one that is identically zero. The
accelerations solve, in proximal iterations (the same result for any sign convention of the forces f, which are not read),

    M y'' + h = tau + J^T f,    J y'' + mu (f_new - f_old) = gamma

Pinocchio has no springs, dampers or integrator for constrained systems: forces other than gravity reach it as tau, and the
steps are the suite's. It has no projection either; that of the suite closes the open pins.
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
SOLVED = 1e-6  # of the largest acceleration: far above rounding, far below what shows in a trajectory


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
        if mechanism.driver is not None:
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
    would write it by hand:  tau = constant + stiffness y + damping dy.  Other forces go through absolute coordinates each time.

    Attributes:
        others: the forces that are not affine.
    """

    def __init__(self, mechanism: Mechanism, tree: Tree):
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

    def _tabulated(self, f: Force) -> tuple[Array, Array] | None:
        """Constant (n,) and slope (n, 2n) of one force, read off unit states; None if random states contradict them."""
        n, applied = self.tree.n, AppliedForces(replace(self.weightless, forces=(f,)))
        states = np.vstack([np.zeros(2 * n), np.eye(2 * n), np.random.default_rng(0).uniform(-3.0, 3.0, (8, 2 * n))])
        tau = self._through_absolute(applied, states[:, :n], states[:, n:])
        constant, slope = tau[0], (tau[1 : 2 * n + 1] - tau[0]).T
        error = np.abs(constant + states @ slope.T - tau).max()
        return (constant, slope) if error <= AFFINE * np.abs(tau).max() else None

    def _through_absolute(self, applied: AppliedForces, y: Array, dy: Array) -> Array:
        q, v, _ = self.tree.absolute(y, dy, np.zeros_like(y))
        return self.tree.forces(q, applied.generalised(q, v))

    def __call__(self, y: Array, dy: Array) -> Array:
        tau = self.constant
        if self.has_damping:
            tau = tau + self.damping.dot(dy)
        if self.has_stiffness:
            tau = tau + self.stiffness.dot(y)
        return tau + self._through_absolute(self.applied, y, dy) if self.others else tau


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
        self.evaluations = 0
        self.worst = 0.0
        self.caps = 0

    def __call__(self, t: float, y: Array, dy: Array) -> Array:
        self.evaluations += 1
        a: Array = self.solve(self.model, self.data, y, dy, self.forces(y, dy), self.rows, self.row_data, self.prox)
        self.worst = max(self.worst, self.prox.mu * self.prox.relative_residual / max(1, abs(a).max()))
        self.caps += self.prox.iter == self.prox.max_iter
        return a


class PinocchioModel:
    """A mechanism in Pinocchio under one integrator and stabilisation of the suite."""

    def __init__(self, mechanism: Mechanism, choice: Choice):
        self.mechanism, self.choice = mechanism, choice
        self.tree, self.evaluator = spanning_tree(mechanism), Evaluator(mechanism)
        body = Multibody(mechanism, self.tree)
        verify(body, mechanism, self.tree)
        self.forces, settings = TreeForces(mechanism, self.tree), SETTINGS[choice.settings]
        gains = (BAUMGARTE_RATE**2, 2 * BAUMGARTE_RATE) if choice.stabilization == "baumgarte" else (0.0, 0.0)
        self.plain = ConstrainedDynamics(body, self.forces, settings, (0.0, 0.0))  # reports accelerations without Baumgarte's terms
        self.stabilized = ConstrainedDynamics(body, self.forces, settings, gains)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        y, dy = self.tree.relative(q, v)
        return self.tree.absolute(y, dy, self.plain(t, y, dy))[2]

    def prepare(self, times: Array, native: bool = True) -> None:
        """There is only the suite's own loop, whatever `native` says."""
        self.times, self.steps, self.stabilized.evaluations = times, 0, 0
        start = self.tree.relative(self.mechanism.q0, self.mechanism.v0)
        self.y, self.dy = (np.tile(x, (len(times), 1)) for x in start)

    def run(self) -> None:
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
        return self.tree.relative(*self.evaluator.project(t, q, v))

    def read(self) -> Trajectory:
        ddy = np.array([self.plain(t, y, dy) for t, y, dy in zip(self.times, self.y, self.dy, strict=True)])
        q, v, a = self.tree.absolute(self.y, self.dy, ddy)
        return Trajectory(self.times, q, v, a, self.steps, self.stabilized.evaluations, "")
