"""A linkage as a plant of Drake: links hang in a tree of joints, and each pin that the tree leaves open is closed by one element.

    ball       AddBallConstraint: a constraint of discrete plants, for which the solver SAP finds impulses
    bushing    LinearBushingRollPitchYaw without torques: a stiff spring and damper, for plants of either kind

The tree coordinates y are also Drake's, in another order. Frames of links lie at their centres of mass. Only what Drake's elements
express exactly is translated; anything else is refused by name:

    constant generalised force                     input port of generalised forces
    spring on one hinge or slide                   RevoluteSpring, PrismaticSpring
    damper on one tree coordinate                  damping of its joint
    spring and damper between points               LinearSpringDamper, whose free length must be positive
    force at a point, fixed in the world           input port of spatial forces
    force at a point, fixed in its own link        Propeller without a moment

Trap: a constraint with a point of the world ends the process at the first step (Drake 1.51.1, segmentation fault). A link welded to
the world holds those points instead.
"""

from dataclasses import dataclass
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np

from gauss_bench.engines.shared import closing_pins, open_tree, spatial
from gauss_bench.engines.tree import Branch, Tree, Turning, turning
from gauss_bench.engines.tree_loads import OnJoints, OtherLoad, Steady, TreeLoad, sort_loads
from gauss_bench.mechanism.coordinates import rotate, velocity
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import GROUND, Distance, Law, Mechanism, Point, PointForce
from gauss_bench.terms import Array

BALL, BUSHING, OPEN = "ball", "bushing", "open"  # how a plant's pins are closed; OPEN leaves them out


def refusal(mechanism: Mechanism, tree: Tree) -> str | None:
    """Return the reason why Drake's elements cannot express a driver or a force, or None if they can."""
    if mechanism.drivers:
        name = mechanism.drivers[0].name
        return f"Drake has no joint that follows a law ({name}): its actuators are springs, and a locked joint stands still"
    turns = turning(tree)
    refusals = (load_refusal(load, tree, turns) for load in sort_loads(mechanism, tree))
    return next(filter(None, refusals), None)


def load_refusal(load: TreeLoad, tree: Tree, turns: Turning) -> str | None:
    """Return the reason why no element of Drake expresses a load, or None if one does."""
    match load:
        case Steady():
            return None
        case OnJoints(row, k=k, c=c, name=name):
            if np.count_nonzero(row) > 1:
                return f"Drake has no spring or damper on a sum of coordinates ({name})"
            if k < 0 or c < 0:
                return f"Drake has no spring or damper with a negative constant ({name})"
            if k and row.any() and branch_of(tree, int(np.flatnonzero(row)[0])).kind == "free":
                return f"Drake has no spring on a coordinate of a link that no joint carries ({name})"
            return None
        case OtherLoad(name, PointForce(frame=frame, point=point)):
            fixed = turns.together(frame, GROUND) or turns.together(frame, point.link)
            return None if fixed else f"Drake cannot turn the force {name} with a third link"
        case OtherLoad(name, Law(coordinate=Distance()) as law):
            if law.bias or law.rest <= 0:
                return f"Drake has a spring between points with a positive free length alone ({name})"
            return f"Drake has no spring or damper with a negative constant ({name})" if law.k < 0 or law.c < 0 else None
    return f"Drake has no spring or damper along an axis that is not a slide's ({load.name})"


def branch_of(tree: Tree, at: int) -> Branch:
    """Return the branch to which the tree coordinate with an index belongs."""
    return max((b for b in tree.branches if b.at <= at), key=lambda b: b.at)


@dataclass(frozen=True)
class Closure:
    """How the pins that the tree leaves open are closed.

    Attributes:
        kind: BALL, BUSHING or OPEN.
        period, damping_ratio: of a bushing's vibration: its shortest undamped period [s], and the share of critical damping.
    """

    kind: str = OPEN
    period: float = 0.0
    damping_ratio: float = 0.0

    def constants(self, mass: float) -> tuple[float, float]:
        """Return stiffness [N/m] and damping [N s/m] of a bushing that moves a mass [kg]."""
        frequency = 2 * np.pi / self.period  # [rad/s]
        return mass * frequency**2, 2 * self.damping_ratio * mass * frequency


MODULES = {  # the parts of pydrake that are used here; all of it takes some seconds to import
    "value": "pydrake.common.value",  # without it ports of forces take no values
    "math": "pydrake.math",
    "vectors": "pydrake.multibody.math",
    "plant": "pydrake.multibody.plant",
    "tree": "pydrake.multibody.tree",
    "analysis": "pydrake.systems.analysis",
    "framework": "pydrake.systems.framework",
}


def load_library() -> Any:
    """Return Drake: an object with the modules of MODULES.

    Raises:
        ImportError: it is not installed.
    """
    return SimpleNamespace(**{name: import_module(module) for name, module in MODULES.items()})


@dataclass(eq=False)
class Built:
    """A plant of Drake and the system that is simulated.

    Attributes:
        plant: Drake's MultibodyPlant; system: the plant itself, or a diagram that also holds propellers.
        bodies: of Drake, in the order of the links.
        order: (n,) index in Drake's coordinates of each tree coordinate.
        pins: for each closing pin the frame of Drake's body and the point in it, of both sides.
        motors: (n,) constant generalised forces on the tree coordinates.
        winds: constant forces at points, as Drake's ExternallyAppliedSpatialForce; they enter at `wind_port`.
        thrusts: (propellers,) forces of the propellers [N]; they enter at `thrust_port`.
    """

    plant: Any
    system: Any
    bodies: list[Any]
    order: Any
    pins: list[tuple[tuple[Any, Array], tuple[Any, Array]]]
    motors: Array
    winds: list[Any]
    thrusts: Array
    wind_port: Any = None
    thrust_port: Any = None

    def connect(self, root: Any) -> Any:
        """Set the constant forces in a context of the system, and return the plant's context in it."""
        context = self.plant.GetMyMutableContextFromRoot(root)
        self.plant.get_applied_generalized_force_input_port().FixValue(context, self._ordered(self.motors))
        self.set_forces_at_points(root)
        return context

    def set_forces_at_points(self, root: Any) -> None:
        """Set the constant forces at points in a context of the system."""
        if self.winds:
            owner = self.wind_port.get_system()
            self.wind_port.FixValue(owner.GetMyMutableContextFromRoot(root), self.winds)
        if len(self.thrusts):
            owner = self.thrust_port.get_system()
            self.thrust_port.FixValue(owner.GetMyMutableContextFromRoot(root), self.thrusts)

    def _ordered(self, x: Array) -> Array:
        """Return values (n,) of the tree coordinates in Drake's order."""
        ordered = np.empty_like(x)
        ordered[self.order] = x
        return ordered

    def set_state(self, context: Any, y: Array, dy: Array) -> None:
        """Set the tree state y, dy (n,) in a context of the plant."""
        self.plant.SetPositions(context, self._ordered(y))
        self.plant.SetVelocities(context, self._ordered(dy))

    def state(self, context: Any) -> tuple[Array, Array]:
        """Return the tree state y, dy (n,) of a context of the plant."""
        return self.plant.GetPositions(context)[self.order], self.plant.GetVelocities(context)[self.order]

    def reported_acceleration(self, context: Any) -> Array:
        """Return y'' (n,) of Drake's output port: for a discrete plant the change of speeds in the next step, over its length."""
        accelerations: Array = np.array(self.plant.get_generalized_acceleration_output_port().Eval(context))[self.order]
        return accelerations


class Builder:
    """Builds plants of a mechanism."""

    def __init__(self, drake: Any, mechanism: Mechanism, tree: Tree):
        self.drake, self.mechanism, self.tree = drake, mechanism, tree

    def build(self, step: float, closure: Closure) -> Built:
        """Return a plant that takes steps of a length [s], or a continuous plant if it is 0."""
        self.plant = self.drake.plant.MultibodyPlant(step)
        if step:
            # Trap: by default accelerations are those of the step before, and zero before the first step.
            self.plant.SetUseSampledOutputPorts(False)
        self.plant.mutable_gravity_field().set_gravity_vector(spatial(self.mechanism.gravity))
        self.bodies: dict[int, Any] = {GROUND: self.plant.world_body()}
        self.frames = 0
        for i, link in enumerate(self.mechanism.links):
            # only the last moment of inertia acts; three equal ones are those of a possible body
            inertia = self.drake.tree.UnitInertia.TriaxiallySymmetric(link.inertia / link.mass)
            self.bodies[i] = self._add_body(f"link{i}", self.drake.tree.SpatialInertia(link.mass, np.zeros(3), inertia))
        self.joints = {b.at: self._add_joint(b) for b in self.tree.branches}
        self.dampings = {b.at: np.zeros(3 if b.kind == "free" else 1) for b in self.tree.branches}
        self.winds: list[tuple[int, Array, Array]] = []
        self.thrusts: list[tuple[int, Array, Array]] = []
        self.forces = np.zeros(self.tree.n)
        turns = turning(self.tree)
        for load in sort_loads(self.mechanism, self.tree):
            self._add_load(load, turns)
        for at, damping in self.dampings.items():
            if damping.any():
                self.joints[at].set_default_damping_vector(damping)
        pins = [((self._frame(a), self._vector(a)), (self._frame(b), self._vector(b))) for a, b in closing_pins(self.tree)]
        if closure.kind == BALL:
            self._add_balls()
        if closure.kind == BUSHING:
            self._add_bushings(closure)
        self.plant.Finalize()
        return self._connect(pins)

    def _connect(self, pins: list[tuple[tuple[Any, Array], tuple[Any, Array]]]) -> Built:
        """Return the finalised plant with the systems around it that its forces need."""
        order = np.array(
            [self.joints[at].position_start() + k for at in sorted(self.joints) for k in range(len(self.dampings[at]))]
        )
        bodies = [self.bodies[i] for i in range(len(self.mechanism.links))]
        winds = [self._spatial_force(*wind) for wind in self.winds]
        thrusts = np.array([float(np.linalg.norm(force)) for _, _, force in self.thrusts])
        port = self.plant.get_applied_spatial_force_input_port()
        if not self.thrusts:
            return Built(self.plant, self.plant, bodies, order, pins, self.forces, winds, thrusts, port)
        builder = self.drake.framework.DiagramBuilder()
        builder.AddSystem(self.plant)
        propellers = builder.AddSystem(self.drake.plant.Propeller([self._propeller(*thrust) for thrust in self.thrusts]))
        builder.Connect(self.plant.get_body_poses_output_port(), propellers.get_body_poses_input_port())
        both = builder.AddSystem(self.drake.plant.ExternallyAppliedSpatialForceMultiplexer(2))
        builder.Connect(propellers.get_spatial_forces_output_port(), both.get_input_port(0))
        builder.Connect(both.get_output_port(), port)
        system, thrust_port = builder.Build(), propellers.get_command_input_port()
        return Built(self.plant, system, bodies, order, pins, self.forces, winds, thrusts, both.get_input_port(1), thrust_port)

    def _add_body(self, name: str, inertia: Any) -> Any:
        return self.plant.AddRigidBody(name, inertia)

    def _vector(self, point: Point) -> Array:
        """Return a point (3,) in the frame of its body."""
        return np.array(spatial(point.local))

    def _frame(self, point: Point) -> Any:
        return self.bodies[point.link].body_frame()

    def _offset(self, link: int, at: Array, turn: float = 0.0) -> Any:
        """Return a frame fixed in a link at a point (2,) [m], turned by an angle [rad]."""
        pose = self._pose(at, turn)
        self.frames += 1
        return self.plant.AddFrame(self.drake.tree.FixedOffsetFrame(f"frame{self.frames}", self.bodies[link].body_frame(), pose))

    def _pose(self, at: Array, turn: float) -> Any:
        math = self.drake.math
        return math.RigidTransform(math.RotationMatrix.MakeZRotation(turn), np.array(spatial(at)))

    def _add_joint(self, b: Branch) -> Any:
        """Add the joint of a branch."""
        tree, name = self.drake.tree, f"joint{b.at}"
        near, far = self._offset(b.parent, b.parent_anchor + b.base), self._offset(b.link, b.anchor, -b.turn)
        if b.kind == "prismatic":
            return self.plant.AddJoint(tree.PrismaticJoint(name, near, far, np.array(spatial(b.axis))))
        if b.kind == "revolute":
            return self.plant.AddJoint(tree.RevoluteJoint(name, near, far, np.array([0.0, 0.0, 1.0])))
        return self.plant.AddJoint(tree.PlanarJoint(name, near, far))

    def _add_load(self, load: TreeLoad, turns: Turning) -> None:
        """Add the elements of a load, or keep it for an input port."""
        match load:
            case Steady():
                self.forces += load.value * load.force
            case OnJoints():
                self._add_joint_spring(load)
            case OtherLoad(_, PointForce() as force):
                self._add_point_force(force, turns)
            case OtherLoad(_, Law(coordinate=Distance(a, b)) as law):
                ends = self.bodies[a.link], self._vector(a), self.bodies[b.link], self._vector(b)
                self.plant.AddForceElement(self.drake.tree.LinearSpringDamper(*ends, law.rest, law.k, law.c))

    def _add_joint_spring(self, load: OnJoints) -> None:
        """Add a spring and damper on L = row . y + constant, where the row has at most one entry, 1 or -1."""
        tree = self.drake.tree
        for at in np.flatnonzero(load.row).tolist():
            branch = branch_of(self.tree, at)
            joint = self.joints[branch.at]
            self.dampings[branch.at][at - branch.at] += load.c
            if load.k:
                rest = float((load.rest - load.constant) * load.row[at])
                spring = tree.PrismaticSpring if branch.kind == "prismatic" else tree.RevoluteSpring
                self.plant.AddForceElement(spring(joint, rest, load.k))

    def _add_point_force(self, force: PointForce, turns: Turning) -> None:
        """Keep a force that is fixed in the world or in the link of its point, turned into the frame in which it is fixed."""
        in_world = turns.together(force.frame, GROUND)
        value = rotate(force.value, turns.constants[force.frame] - turns.constants[GROUND if in_world else force.point.link])
        if value.any():
            (self.winds if in_world else self.thrusts).append((force.point.link, force.point.local, value))

    def _spatial_force(self, link: int, at: Array, force: Array) -> Any:
        """Return a force (2,) in the world's directions at a point of a link."""
        applied = self.drake.plant.ExternallyAppliedSpatialForce()
        applied.body_index = self.bodies[link].index()
        applied.p_BoBq_B = np.array(spatial(at))
        applied.F_Bq_W = self.drake.vectors.SpatialForce(np.zeros(3), np.array(spatial(force)))
        return applied

    def _propeller(self, link: int, at: Array, force: Array) -> Any:
        """Return a propeller that pushes along z of its frame, which is turned into the direction of a force (2,) of a link."""
        direction = self.drake.math.RotationMatrix.MakeFromOneVector(np.array(spatial(force)), 2)
        pose = self.drake.math.RigidTransform(direction, np.array(spatial(at)))
        return self.drake.plant.PropellerInfo(self.bodies[link].index(), pose, 1.0, 0.0)

    def _add_balls(self) -> None:
        """Close the open pins by ball constraints; a link welded to the world stands for the ground."""
        tree, holders = self.drake.tree, dict(self.bodies)
        pairs = closing_pins(self.tree)
        if any(point.link == GROUND for pair in pairs for point in pair):
            inertia = tree.SpatialInertia(1.0, np.zeros(3), tree.UnitInertia.TriaxiallySymmetric(1.0))
            holders[GROUND] = self._add_body("ground", inertia)
            self.plant.WeldFrames(self.plant.world_frame(), holders[GROUND].body_frame())
        for a, b in pairs:
            self.plant.AddBallConstraint(holders[a.link], self._vector(a), holders[b.link], self._vector(b))

    def _add_bushings(self, closure: Closure) -> None:
        """Close the open pins by bushings that push and pull alike in all directions, and do not twist."""
        twist = np.zeros(3)
        for (a, b), mass in zip(closing_pins(self.tree), self._pin_masses(), strict=True):
            ends = self._offset(a.link, a.local), self._offset(b.link, b.local)
            stiffness, damping = (np.full(3, x) for x in closure.constants(mass))
            self.plant.AddForceElement(self.drake.tree.LinearBushingRollPitchYaw(*ends, twist, twist, stiffness, damping))

    def _pin_masses(self) -> list[float]:
        """List for each closing pin the mass [kg] that its gap moves at the start, in the direction in which it is least."""
        tree, count = self.tree, self.tree.n
        y, dy = tree.relative(self.mechanism.q0, self.mechanism.v0)
        own = open_tree(Evaluator(self.mechanism), tree, y, dy)
        # the links' speeds (n, 3 links) if one tree rate is 1 and all others are 0
        speeds = tree.absolute(np.tile(y, (count, 1)), np.eye(count), np.zeros((count, count)))[1]
        q = np.tile(own.q, (count, 1))
        rows = [velocity(q, speeds, b) - velocity(q, speeds, a) for a, b in closing_pins(tree)]  # each (n, 2)
        return [least_mass(J.T, own.mass) for J in rows]


def least_mass(J: Array, M: Array) -> float:
    """Return the mass [kg] that a force on a gap moves in the direction in which it is least.

    Args:
        J: (2, n) rows of the gap; M: (n, n) mass matrix. The inverse of that mass is the largest eigenvalue of J M^-1 J^T.
    """
    return float(1 / np.linalg.eigvalsh(J @ np.linalg.solve(M, J.T)).max())


def gaps(built: Built, context: Any) -> Array:
    """Return point b minus point a of every closing pin (pins, 2) [m], by Drake's own kinematics."""
    world = built.plant.world_frame()
    places = [[built.plant.CalcPointsPositions(context, frame, point, world)[:2, 0] for frame, point in pin] for pin in built.pins]
    return np.array([b - a for a, b in places]).reshape(-1, 2)
