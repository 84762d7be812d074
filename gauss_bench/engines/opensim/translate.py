"""A linkage as an OpenSim model: links hang on a tree of joints, and a PointConstraint closes each pin that the tree leaves open.

OpenSim's coordinates are the tree coordinates y. Frames of links lie at their centres of mass. A force or driver of the linkage on
the left becomes the element of OpenSim on the right; one without an exact counterpart is refused by name:

    constant generalised force:                     CoordinateActuator, whose actuation is overridden by the force
    spring and damper on one tree coordinate:       SpringGeneralizedForce
    spring between points:                          PointToPointSpring
    damper or constant force between points:        ExpressionBasedPointToPointForce
    force at a point, fixed in the world or link:   PrescribedForce
    prescribed angle or slide at constant speed:    prescribed coordinate, with a LinearFunction
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.shared import closing_pins, drivers_by_coordinate, measure_gaps, spatial, undriven
from gauss_bench.engines.tree import Branch, Tree, Turning, turning
from gauss_bench.engines.tree_loads import OnJoints, OtherLoad, Steady, TreeLoad, refuse_load, sort_loads, turn_force
from gauss_bench.mechanism.model import GROUND, Distance, Law, Mechanism, Point, PointForce
from gauss_bench.terms import Array

ADAPTIVE = "_adaptive"  # ending of the integrators that choose their steps
METHODS = {"rk_merson": "RungeKuttaMerson", "rk3": "RungeKutta3", "verlet": "Verlet", "semi_explicit_euler2": "SemiExplicitEuler2"}
METHODS |= {f"rk_merson{ADAPTIVE}": "RungeKuttaMerson", f"rk3{ADAPTIVE}": "RungeKutta3"}
FAR = 1e9  # [rad, m] ends of a coordinate's range; by default the range ends after some turns


def explain_refusal(mechanism: Mechanism, tree: Tree) -> str | None:
    """Return the reason why OpenSim's elements cannot express a driver or a force, or None if they can."""
    if reason := undriven(mechanism, tree, "OpenSim", any_law=False):
        return reason
    turns = turning(tree)
    refusals = (refuse_load(load, turns, "OpenSim") for load in sort_loads(mechanism, tree))
    return next(filter(None, refusals), None)  # the reason for the first load that OpenSim cannot express


def make_manager(opensim: Any, model: Any, choice: Choice, options: Mapping[str, Any], step: Any, recorded: bool = False) -> Any:
    """Return OpenSim's manager, which integrates a model as a setting says, in steps of the size `step` [s] if they are fixed.

    If `recorded`, the manager stores the state after every step.
    """
    method, accuracy = choice.integrator or next(iter(METHODS)), options["accuracy"]
    manager = opensim.Manager(model)
    manager.setWriteToStorage(recorded)
    manager.setPerformAnalyses(False)
    manager.setIntegratorMethod(getattr(opensim.Manager, f"IntegratorMethod_{METHODS[method]}"))
    if method.endswith(ADAPTIVE):
        accuracy, _ = choice.tolerances(accuracy, 0.0)  # OpenSim has one accuracy and no absolute tolerance
    else:
        manager.setIntegratorFixedStepSize(step)  # then the accuracy decides when states are projected
    manager.setIntegratorAccuracy(accuracy)
    if tolerance := options["constraint_tolerance"]:
        manager.setIntegratorConstraintTolerance(tolerance)
    return manager


class Built:
    """An OpenSim model of a mechanism, whose links hang on a tree of joints.

    Attributes:
        bodies: link, or GROUND -> OpenSim's body.
        coordinates: OpenSim's coordinates, in the order of the tree coordinates.
        joint_coordinates: index of a tree coordinate -> OpenSim's coordinate, taken from its joint before the model is complete.
        start: a state of the model, from which other states are copied.
        pins: for each closing pin, its two ends: OpenSim's body and the point in its frame.
        elements: references to the Python objects of joints and forces, so that Python does not delete these objects.
        motors: constant forces on coordinates: pairs of OpenSim's actuator and its force [N] or torque [N m].
    """

    def __init__(self, opensim: Any, mechanism: Mechanism, tree: Tree, constrained: bool = True):
        """Build the model; unless `constrained`, it is the open tree without drivers."""
        self.opensim = opensim
        self.model = opensim.Model()
        self.model.setUseVisualizer(False)
        self.model.setGravity(self._make_vector(mechanism.gravity))
        self.bodies: dict[int, Any] = {GROUND: self.model.getGround()}
        self.joint_coordinates: dict[int, Any] = {}
        self.elements: list[Any] = []
        self.motors: list[tuple[Any, float]] = []
        for i, link in enumerate(mechanism.links):
            inertia = opensim.Inertia(*[link.inertia] * 3)  # only the last moment of inertia acts
            self.bodies[i] = opensim.Body(f"link{i}", link.mass, opensim.Vec3(0), inertia)
            self.model.addBody(self.bodies[i])
        for branch in tree.branches:
            self._add_joint(branch)
        self.pins = [(self._locate(a), self._locate(b)) for a, b in closing_pins(tree)]
        turns = turning(tree)
        for load in sort_loads(mechanism, tree):
            self._add_load(load, turns)
        if constrained:
            for a, b in self.pins:
                self.model.addConstraint(opensim.PointConstraint(*a, *b))
            for index, driver in drivers_by_coordinate(mechanism, tree).items():
                speed, start = (float(driver.law.numbers[x]) for x in ("speed", "start"))
                self.joint_coordinates[index].setPrescribedFunction(opensim.LinearFunction(speed, start))
                self.joint_coordinates[index].setDefaultIsPrescribed(True)
        self.model.finalizeConnections()
        self.start = self.model.initSystem()
        for motor, force in self.motors:
            motor.overrideActuation(self.start, True)
            motor.setOverrideActuation(self.start, force)
        self.coordinates = [self.model.getCoordinateSet().get(f"y{k}") for k in range(tree.n)]

    def gaps(self, state: Any) -> Array:
        """Return point b minus point a of every closing pin (pins, 2) [m], by OpenSim's own kinematics."""

        def place(end: tuple[Any, Any]) -> Array:
            """Return the place (2,) [m] in the world of a point of a body."""
            body, point = end
            location = body.findStationLocationInGround(state, point)
            return np.array([location.get(0), location.get(1)])

        return measure_gaps(self.pins, place)

    def _make_vector(self, x: Any) -> Any:
        """Return a planar vector (2,) as OpenSim's `Vec3`."""
        return self.opensim.Vec3(*spatial(x))

    def _locate(self, point: Point) -> tuple[Any, Any]:
        """Return the OpenSim body to which a point belongs, and the point in the body's frame."""
        return self.bodies[point.link], self._make_vector(point.local)

    def _add_joint(self, b: Branch) -> None:
        """Add the joint of a branch of the tree (a link with its joint to the parent), and name the joint's coordinates."""
        opensim = self.opensim
        # angle [rad] of the x axis of both joint frames in the parent's frame: OpenSim slides along x of both
        direction = float(np.arctan2(b.axis[1], b.axis[0])) if b.kind == "prismatic" else 0.0
        # a slide's line is at the offset `base` from the parent's point, and the link is turned by the constant angle `turn`
        near = self.bodies[b.parent], self._make_vector(b.parent_anchor + b.base), opensim.Vec3(0, 0, direction)
        far = self.bodies[b.link], self._make_vector(b.anchor), opensim.Vec3(0, 0, direction - b.turn)
        kinds = {"prismatic": opensim.SliderJoint, "revolute": opensim.PinJoint, "free": opensim.PlanarJoint}
        joint = kinds[b.kind](f"joint{b.at}", *near, *far)
        if b.kind == "free":
            kinds_of_coordinates = (joint.Coord_TranslationX, joint.Coord_TranslationY, joint.Coord_RotationZ)
            coordinates = [joint.updCoordinate(kind) for kind in kinds_of_coordinates]
        else:
            coordinates = [joint.updCoordinate()]
        self.model.addJoint(joint)
        self.elements.append(joint)
        for k, coordinate in enumerate(coordinates, start=b.at):
            coordinate.setName(f"y{k}")
            coordinate.set_clamped(False)
            coordinate.set_range(0, -FAR)
            coordinate.set_range(1, FAR)
            self.joint_coordinates[k] = coordinate

    def _add_load(self, load: TreeLoad, turns: Turning) -> None:
        """Add OpenSim's elements for a load; `__init__` sets the forces of actuators later."""
        opensim = self.opensim
        match load:
            case Steady():
                for index in np.flatnonzero(load.force):
                    motor = self._add_force(opensim.CoordinateActuator(f"y{index}"))
                    motor.setOptimalForce(1.0)
                    self.motors.append((motor, load.value * float(load.force[index])))
            case OnJoints():  # on L = row . y + constant, where the row has at most one nonzero entry, 1 or -1
                for index in np.flatnonzero(load.row):
                    spring = self._add_force(opensim.SpringGeneralizedForce(f"y{index}"))
                    spring.setStiffness(float(load.k))
                    spring.setViscosity(float(load.c))
                    spring.setRestLength(float((load.rest - load.constant) * load.row[index]))
            case OtherLoad(_, PointForce() as force):
                in_world, value = turn_force(force, turns)
                element = self._add_force(opensim.PrescribedForce("", self.bodies[force.point.link]))
                element.setForceFunctions(*map(opensim.Constant, spatial(value)))
                element.setForceIsInGlobalFrame(in_world)
                element.setPointFunctions(*map(opensim.Constant, spatial(force.point.local)))
                element.setPointIsInGlobalFrame(False)
            case OtherLoad(_, Law() as law):
                k, c, rest, bias, distance = law.k, law.c, law.rest, law.bias, law.coordinate
                assert isinstance(distance, Distance)  # `skip` refuses laws along other coordinates
                (body_a, point_a), (body_b, point_b) = self._locate(distance.a), self._locate(distance.b)
                if c or bias:
                    # in OpenSim a positive force pulls the points together, in a law it pushes them apart; ddot is the rate of d
                    text = f"{float(k)!r}*(d-({float(rest)!r}))+{float(c)!r}*ddot-({float(bias)!r})"
                    names = body_a.getName(), body_b.getName()
                    self._add_force(opensim.ExpressionBasedPointToPointForce(names[0], point_a, names[1], point_b, text))
                else:
                    self._add_force(opensim.PointToPointSpring(body_a, point_a, body_b, point_b, float(k), float(rest)))

    def _add_force(self, element: Any) -> Any:
        """Add a force element to the model under a name of its own, and return it."""
        element.setName(f"force{len(self.elements)}")
        self.model.addForce(element)
        self.elements.append(element)
        return element
