"""A linkage as a plant (multibody model) of Drake: a tree of joints carries the links, and the other pins are closed by elements.

One of two kinds of element closes each pin that is no joint of the tree:

    ball:       AddBallConstraint, a constraint of discrete plants, for which the solver SAP finds impulses
    bushing:    LinearBushingRollPitchYaw without torques, a stiff spring and damper, for discrete and continuous plants

Drake's coordinates are the tree coordinates y in another order. Frames of links lie at their centres of mass. A force of the
linkage on the left becomes the element or input of Drake on the right; a force without an exact counterpart is refused by name:

    constant generalised force:                    input port of generalised forces
    spring on one hinge or slide:                  RevoluteSpring, PrismaticSpring
    damper on one tree coordinate:                 damping of the coordinate's joint
    spring and damper between points:              LinearSpringDamper, whose free length must be positive
    force at a point, fixed in the world:          input port of spatial forces ("wind")
    force at a point, fixed in the point's link:   Propeller with thrust but no moment

Trap: a constraint on a point of the world ends the process at the first step (Drake 1.51.1, segmentation fault). A constrained
point of the ground is therefore a point of a body that is welded to the world.
"""

from dataclasses import dataclass
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np

from gauss_bench.engines.shared import closing_pins, measure_gaps, open_tree, spatial
from gauss_bench.engines.tree import Branch, Tree, Turning, turning
from gauss_bench.engines.tree_loads import OnJoints, OtherLoad, Steady, TreeLoad, refuse_load, sort_loads, turn_force
from gauss_bench.mechanism.coordinates import velocity
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import GROUND, Distance, Law, Mechanism, PointForce
from gauss_bench.terms import Array

BALL, BUSHING, OPEN = "ball", "bushing", "open"  # kinds of closures; OPEN closes no pin
PointLoad = tuple[int, Array, Array]  # link, point (2,) in its frame [m], and force (2,) [N]


def explain_refusal(mechanism: Mechanism, tree: Tree) -> str | None:
    """Return the reason why Drake's elements cannot express a driver or a force, or None if they can."""
    if mechanism.drivers:
        name = mechanism.drivers[0].name
        return f"Drake has no joint that follows a law ({name}): its actuators are springs, and a locked joint stands still"
    turns = turning(tree)
    refusals = (explain_load_refusal(load, tree, turns) for load in sort_loads(mechanism, tree))
    return next(filter(None, refusals), None)  # the reason for the first load that Drake cannot express


def explain_load_refusal(load: TreeLoad, tree: Tree, turns: Turning) -> str | None:
    """Return the reason why no element of Drake expresses a load, or None if one does."""
    if reason := refuse_load(load, turns, "Drake"):
        return reason
    match load:
        case OnJoints(row, k=k, c=c, name=name):  # spring and damper on the sum row . y of tree coordinates y
            if k < 0 or c < 0:
                return f"Drake has no spring or damper with a negative constant ({name})"
            if k and row.any() and branch_of(tree, int(np.flatnonzero(row)[0])).kind == "free":
                return f"Drake has no spring on a coordinate of a link that no joint carries ({name})"
        case OtherLoad(name, Law() as law):
            if law.bias or law.rest <= 0:  # a constant force `bias` moves the free length
                return f"Drake's spring between points needs a positive free length ({name})"
            if law.k < 0 or law.c < 0:
                return f"Drake has no spring or damper with a negative constant ({name})"
    return None


def branch_of(tree: Tree, at: int) -> Branch:
    """Return the branch that has the tree coordinate with the index `at`."""
    return max((b for b in tree.branches if b.at <= at), key=lambda b: b.at)  # the last branch that begins at or before this index


@dataclass(frozen=True)
class Closure:
    """How the pins that are no joints of the spanning tree are closed.

    Attributes:
        kind: BALL, BUSHING or OPEN.
        period, damping_ratio: of a bushing: shortest undamped period of its vibration [s], and damping relative to critical.
    """

    kind: str = OPEN
    period: float = 0.0
    damping_ratio: float = 0.0

    def constants(self, mass: float) -> tuple[float, float]:
        """Return stiffness [N/m] and damping [N s/m] of a bushing that gives a mass [kg] the `period` and `damping_ratio`."""
        frequency = 2 * np.pi / self.period  # [rad/s]
        return mass * frequency**2, 2 * self.damping_ratio * mass * frequency


MODULES = {  # name in the adapter -> module of pydrake
    "value": "pydrake.common.value",  # without it, ports of forces do not accept values
    "math": "pydrake.math",
    "vectors": "pydrake.multibody.math",
    "plant": "pydrake.multibody.plant",
    "tree": "pydrake.multibody.tree",
    "analysis": "pydrake.systems.analysis",
    "framework": "pydrake.systems.framework",
}


def load_library() -> Any:
    """Return an object with the modules of MODULES as attributes.

    Raises:
        ImportError: Drake is not installed.
    """
    return SimpleNamespace(**{name: import_module(module) for name, module in MODULES.items()})


def in_space(x: Array) -> Array:
    """Return a vector (2,) of the plane as a vector (3,) of space."""
    return np.array(spatial(x))


class Built:
    """A plant of Drake, in which the links of a mechanism hang on a joint tree, and the system that is simulated.

    Attributes:
        drake: Drake's modules (MODULES) as attributes.
        plant: Drake's object MultibodyPlant.
        system: the plant itself, or a diagram of the plant and propellers.
        bodies: link, or GROUND -> Drake's body.
        joints, dampings: index of a branch's first tree coordinate -> its joint, and the damping of each of its coordinates.
        order: (n,) index of each tree coordinate in Drake's coordinates.
        pins: for each closing pin, its two ends: the frame of Drake's body and the point (3,) in it.
        frames: number of the frames that `_add_frame` has added, from which they take their names.
        motors: (n,) constant generalised forces on the tree coordinates.
        winds, thrusts: forces at points whose directions are fixed in the world, and in their links.
        ports: pairs of an input port for forces at points and its values: winds, then thrusts of the propellers [N].
    """

    def __init__(self, drake: Any, mechanism: Mechanism, tree: Tree, step: float, closure: Closure):
        """Build a discrete plant with the given step size [s], or a continuous plant if `step` is 0.

        Drake needs bodies before their joints, joints before loads and closures, and all of them before `Finalize`.
        """
        self.drake, self.mechanism, self.tree = drake, mechanism, tree
        self.plant = drake.plant.MultibodyPlant(step)
        if step:
            # Trap: by default the reported accelerations are those of the last step, and zero before the first step.
            self.plant.SetUseSampledOutputPorts(False)
        self.plant.mutable_gravity_field().set_gravity_vector(spatial(mechanism.gravity))
        self.bodies: dict[int, Any] = {GROUND: self.plant.world_body()}
        self.frames = 0
        for i, link in enumerate(mechanism.links):
            # only the last moment of inertia acts; Drake refuses moments that no body can have, and accepts three equal ones
            self.bodies[i] = self._add_body(f"link{i}", link.mass, link.inertia / link.mass)
        self.joints = {b.at: self._add_joint(b) for b in tree.branches}
        self.dampings = {b.at: np.zeros(len(b.coordinates)) for b in tree.branches}
        self.winds: list[PointLoad] = []
        self.thrusts: list[PointLoad] = []
        self.motors = np.zeros(tree.n)
        turns = turning(tree)
        for load in sort_loads(mechanism, tree):
            self._add_load(load, turns)
        for at, damping in self.dampings.items():
            if damping.any():
                self.joints[at].set_default_damping_vector(damping)
        ends = [[(self.bodies[point.link].body_frame(), in_space(point.local)) for point in pin] for pin in closing_pins(tree)]
        self.pins = [(a, b) for a, b in ends]
        if closure.kind == BALL:
            self._add_balls()
        if closure.kind == BUSHING:
            self._add_bushings(closure)
        self.plant.Finalize()
        self.order = np.array([self.joints[b.at].position_start() + k for b in tree.branches for k in range(len(b.coordinates))])
        self.system, self.ports = self._add_point_forces()

    def connect(self, root: Any) -> Any:
        """Set the constant forces in the context `root` of the system, and return the plant's context in it."""
        context = self.plant.GetMyMutableContextFromRoot(root)
        self.plant.get_applied_generalized_force_input_port().FixValue(context, self._order(self.motors))
        self.set_forces_at_points(root)
        return context

    def set_forces_at_points(self, root: Any) -> None:
        """Set the constant forces at points in the context `root` of the system."""
        for port, values in self.ports:
            if len(values):
                port.FixValue(port.get_system().GetMyMutableContextFromRoot(root), values)

    def _order(self, x: Array) -> Array:
        """Return values (n,) of the tree coordinates in Drake's order."""
        ordered = np.empty_like(x)
        ordered[self.order] = x
        return ordered

    def set_state(self, context: Any, y: Array, dy: Array) -> None:
        """Set the tree state y, dy (n,) in a context of the plant."""
        self.plant.SetPositions(context, self._order(y))
        self.plant.SetVelocities(context, self._order(dy))

    def state(self, context: Any) -> tuple[Array, Array]:
        """Return the tree state y, dy (n,) of a context of the plant."""
        return self.plant.GetPositions(context)[self.order], self.plant.GetVelocities(context)[self.order]

    def gaps(self, context: Any) -> Array:
        """Return point b minus point a of every closing pin (pins, 2) [m], by Drake's own kinematics."""
        world = self.plant.world_frame()
        return measure_gaps(self.pins, lambda end: self.plant.CalcPointsPositions(context, *end, world)[:, 0])

    def _add_point_forces(self) -> tuple[Any, list[tuple[Any, Any]]]:
        """Return values for the attributes `system` and `ports`: the plant, in a diagram with propellers if there are thrusts."""
        parts, math, winds, propellers = self.drake.plant, self.drake.math, [], []
        for link, point, force in self.winds:
            wind = parts.ExternallyAppliedSpatialForce()
            wind.body_index = self.bodies[link].index()
            wind.p_BoBq_B = in_space(point)
            wind.F_Bq_W = self.drake.vectors.SpatialForce(np.zeros(3), in_space(force))
            winds.append(wind)
        port = self.plant.get_applied_spatial_force_input_port()
        if not self.thrusts:
            return self.plant, [(port, winds)]
        builder = self.drake.framework.DiagramBuilder()
        builder.AddSystem(self.plant)
        for link, point, force in self.thrusts:
            # the thrust is along the z axis (index 2) of the propeller's pose; 1 N for an input of 1, and no moment
            pose = math.RigidTransform(math.RotationMatrix.MakeFromOneVector(in_space(force), 2), in_space(point))
            propellers.append(parts.PropellerInfo(self.bodies[link].index(), pose, 1.0, 0.0))
        thrusters = builder.AddSystem(parts.Propeller(propellers))
        builder.Connect(self.plant.get_body_poses_output_port(), thrusters.get_body_poses_input_port())
        sizes = np.array([float(np.linalg.norm(force)) for _, _, force in self.thrusts])
        ports: list[tuple[Any, Any]] = [(thrusters.get_command_input_port(), sizes)]
        pushes = thrusters.get_spatial_forces_output_port()
        if winds:  # a multiplexer joins both kinds of force; without winds it would have an input without values, an error
            multiplexer = builder.AddSystem(parts.ExternallyAppliedSpatialForceMultiplexer(2))
            builder.Connect(pushes, multiplexer.get_input_port(0))
            ports.insert(0, (multiplexer.get_input_port(1), winds))
            pushes = multiplexer.get_output_port()
        builder.Connect(pushes, port)
        return builder.Build(), ports

    def _add_body(self, name: str, mass: float, unit_inertia: float) -> Any:
        """Add a body with equal moments of inertia about all axes, `unit_inertia` [m^2] times the mass [kg], and return it."""
        tree = self.drake.tree
        inertia = tree.SpatialInertia(mass, np.zeros(3), tree.UnitInertia.TriaxiallySymmetric(unit_inertia))
        return self.plant.AddRigidBody(name, inertia)

    def _add_frame(self, link: int, origin: Array, turn: float = 0.0) -> Any:
        """Add a frame fixed in a link, at the point `origin` (2,) [m] and turned by an angle [rad], and return it."""
        math = self.drake.math
        pose = math.RigidTransform(math.RotationMatrix.MakeZRotation(turn), in_space(origin))
        self.frames += 1
        return self.plant.AddFrame(self.drake.tree.FixedOffsetFrame(f"frame{self.frames}", self.bodies[link].body_frame(), pose))

    def _add_joint(self, b: Branch) -> Any:
        """Add the joint of a branch, and return it."""
        tree, name = self.drake.tree, f"joint{b.at}"
        near, far = self._add_frame(b.parent, b.parent_anchor + b.base), self._add_frame(b.link, b.anchor, -b.turn)
        if b.kind == "prismatic":
            return self.plant.AddJoint(tree.PrismaticJoint(name, near, far, in_space(b.axis)))
        if b.kind == "revolute":
            return self.plant.AddJoint(tree.RevoluteJoint(name, near, far, np.array([0.0, 0.0, 1.0])))
        return self.plant.AddJoint(tree.PlanarJoint(name, near, far))

    def _add_load(self, load: TreeLoad, turns: Turning) -> None:
        """Add a load as an element of the plant, or store it for an input port; `explain_load_refusal` has accepted it."""
        tree = self.drake.tree
        match load:
            case Steady():
                self.motors += load.value * load.force
            case OnJoints():  # on L = row . y + constant, where the row has at most one nonzero entry, 1 or -1
                for at in np.flatnonzero(load.row).tolist():
                    branch = branch_of(self.tree, at)
                    self.dampings[branch.at][at - branch.at] += load.c
                    if load.k:
                        rest = float((load.rest - load.constant) * load.row[at])
                        spring = tree.PrismaticSpring if branch.kind == "prismatic" else tree.RevoluteSpring
                        self.plant.AddForceElement(spring(self.joints[branch.at], rest, load.k))
            case OtherLoad(_, PointForce(point=point) as force):
                in_world, value = turn_force(force, turns)
                forces = self.winds if in_world else self.thrusts
                if value.any():
                    forces.append((point.link, point.local, value))
            case OtherLoad(_, Law(coordinate=Distance(a, b)) as law):
                ends = self.bodies[a.link], in_space(a.local), self.bodies[b.link], in_space(b.local)
                self.plant.AddForceElement(tree.LinearSpringDamper(*ends, law.rest, law.k, law.c))

    def _add_balls(self) -> None:
        """Close the pins that are not in the tree by ball constraints; a body that is welded to the world stands for the ground."""
        bodies, pins = dict(self.bodies), closing_pins(self.tree)
        if any(GROUND in (a.link, b.link) for a, b in pins):
            # mass and inertia have no effect, because the body does not move
            bodies[GROUND] = self._add_body("ground", 1.0, 1.0)
            self.plant.WeldFrames(self.plant.world_frame(), bodies[GROUND].body_frame())
        for a, b in pins:
            self.plant.AddBallConstraint(bodies[a.link], in_space(a.local), bodies[b.link], in_space(b.local))

    def _add_bushings(self, closure: Closure) -> None:
        """Close the pins outside the tree by bushings with equal constants in all directions, and without torques.

        The period and damping of a bushing are those of the pin's least effective mass at the start, when the loops are open.
        """
        tree, twist = self.tree, np.zeros(3)
        y, dy = tree.relative(self.mechanism.q0, self.mechanism.v0)
        own = open_tree(Evaluator(self.mechanism), tree, y, dy)
        speeds = tree.unit_speeds(y)  # (n, 3 links)
        q = np.tile(own.q, (tree.n, 1))  # the same positions with each unit speed of a tree coordinate
        for a, b in closing_pins(tree):
            # relative velocity (n, 2) of the pin's ends at the unit speeds: the transposed Jacobian of the gap
            transposed = velocity(q, speeds, b) - velocity(q, speeds, a)
            stiffness, damping = (np.full(3, x) for x in closure.constants(least_mass(transposed.T, own.mass)))
            ends = self._add_frame(a.link, a.local), self._add_frame(b.link, b.local)
            self.plant.AddForceElement(self.drake.tree.LinearBushingRollPitchYaw(*ends, twist, twist, stiffness, damping))


def least_mass(J: Array, M: Array) -> float:
    """Return the least effective mass [kg] of a gap, the vector between the two points that a closing pin joins.

    The effective mass in a direction is the size of two opposite forces, one on each point, divided by the gap's acceleration.
    The inverse of the least effective mass is the largest eigenvalue of J M^-1 J^T.

    Args:
        J: (2, n) Jacobian of the gap with respect to the tree coordinates.
        M: (n, n) mass matrix of the open tree.
    """
    return float(1 / np.linalg.eigvalsh(J @ np.linalg.solve(M, J.T)).max())
