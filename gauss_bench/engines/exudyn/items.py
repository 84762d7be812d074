"""A linkage as Exudyn items, and the reasons why some forces have no exact counterpart among them.

Links are ObjectRigidBody2D with the centre of mass as reference point, so M is diagonal and constant. Pins and slides are
ObjectJointRevolute2D and ObjectJointPrismatic2D. Exudyn takes the normal n of a slide from its second marker. Therefore the first
marker is on the block b and the second on the guide g, and both constraint rows of the slide have the opposite sign of the
linkage's rows:

    (p_g + offset n - p_b) . n = 0,    (R_b u_b) . n = 0        p: points on the line, R_b u_b: direction of the line

Trap: if the axis of a force moves with a link, Exudyn applies the reaction, the opposite force, at the marker of the axis' origin.
The link with the axis then lacks a torque, unless the force acts along the axis through the origin. If a slide between
the two links keeps the point at a fixed distance from the axis, the adapter moves the marker sideways by this distance, and the
force law is exact. Otherwise the mechanism is refused.

A prescribed rotation is a CoordinateConstraint on the link's angle, with the law as the offset u = law(t) - theta0. A prescribed
slide or length is a CoordinateVectorConstraint; user functions give its equation x(q) - law(t) = 0 and its Jacobian.

User functions are Python functions that Exudyn calls at every evaluation. A force that varies with time becomes an Exudyn load
whose value is a user function. A torque that varies becomes a connector between two angles whose torque is a user function. Exudyn
passes the relative speed of the two angles to the user function of a torque, so the torque may depend on the direction of motion.
Exudyn approximates the derivatives of user functions by finite differences.
"""

from typing import Any, assert_never

import numpy as np

from gauss_bench.engines.exudyn.across_releases import rigid_body
from gauss_bench.engines.shared import PARALLEL, spatial
from gauss_bench.engines.tree import ends
from gauss_bench.mechanism.coordinates import gradient, rate, value
from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import (
    GROUND,
    Along,
    Angle,
    AngleDriver,
    Distance,
    Driver,
    Force,
    Joint,
    Law,
    LengthDriver,
    Mechanism,
    Point,
    PointForce,
    Prismatic,
    SlideDriver,
    Torque,
    Weighted,
    factor_of,
    loads,
)
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.terms import Array

COINCIDENT = 1e-12  # [m] points at a smaller distance coincide


def reason_to_refuse(mechanism: Mechanism, force: Force) -> str | None:
    """Return the reason why a force has no exact counterpart among Exudyn's items, or None if it has one."""
    if factor := factor_of(force):  # a varying force; share: fraction of it that acts on a point that moves against the force
        if isinstance(force, PointForce) and factor.share != 1.0:
            return f"force {force.name} varies with the direction of its point's motion, and Exudyn's loads are not given the speed"
        if isinstance(force, PointForce) and force.frame not in (GROUND, force.point.link):
            return f"force {force.name} varies and is fixed in a third link, for which Exudyn has no load"
        return None
    for load in loads([force]):
        match load:
            case Law(Along(origin, point, angle)) if origin.link != GROUND:
                if not slides_along(mechanism, origin.link, point.link, angle):
                    return (
                        f"force {force.name} acts along an axis of a moving link, and no slide keeps its point on that axis; "
                        "Exudyn's connectors leave out its torque on that link"
                    )
            case Law(Distance()) if load.c != 0 and value(load.coordinate, mechanism.q0) < COINCIDENT:
                return f"damper {force.name} joins points that coincide at the start, where its direction is undefined"
    return None


def slides_along(mechanism: Mechanism, origin: int, other: int, theta: float) -> bool:
    """Tell whether a slide between two links is parallel to the axis at the angle `theta` [rad] in the link `origin`."""
    between = [slide for slide in mechanism.slides if {*ends(slide)} == {origin, other}]
    lines = [slide.angle if slide.guide.link == origin else slide.angle - slide.turn for slide in between]
    return any(abs(np.sin(line - theta)) < PARALLEL for line in lines)


class System:
    """A mechanism as Exudyn items, built with the modules `exu` and `items`.

    Attributes:
        container: owner of the system, which must live as long as the system.
        mbs: Exudyn's system.
        bodies, nodes: link -> Exudyn's number of its body and of its node.
        last: time [s] from which on varying forces keep their value, so that a jump at the end of a run does not act in the run.
    """

    def __init__(self, exu: Any, items: Any, mechanism: Mechanism):
        """Add all links, joints, drivers and forces of a mechanism to a new system of Exudyn."""
        self.exu, self.items, self.mechanism = exu, items, mechanism
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.bodies = {GROUND: self.mbs.AddObject(self.items.ObjectGround())}
        self.nodes = {GROUND: self.mbs.AddNode(self.items.NodePointGround())}
        for i in range(len(mechanism.links)):
            self._add_link(i)
        for joint in mechanism.joints:
            self._add_joint(joint)
        for driver in mechanism.drivers:
            self._add_driver(driver)
        for load in loads(f for f in mechanism.forces if not factor_of(f)):
            if isinstance(load, PointForce):
                self._add_point_force(load)
            else:
                self._add_law(load)
        self.last = np.inf  # latest time [s] at which forces are evaluated; every part of a run sets this time
        for force in mechanism.varying:
            self._add_varying_force(force)
        self.mbs.Assemble()

    def _add_link(self, i: int) -> None:
        """Add the node and the body of a link, and its weight."""
        add, items, link = self.mbs, self.items, self.mechanism.links[i]
        self.nodes[i] = add.AddNode(items.NodeRigidBody2D(referenceCoordinates=list(self.mechanism.q0[3 * i : 3 * i + 3])))
        self.bodies[i] = add.AddObject(rigid_body(items.ObjectRigidBody2D, link.mass, link.inertia, self.nodes[i]))
        marker = add.AddMarker(items.MarkerBodyMass(bodyNumber=self.bodies[i]))
        add.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=spatial(self.mechanism.gravity)))

    def _mark_point(self, point: Point) -> Any:
        """Add a marker with a position at a point, and return it."""
        marker = self.items.MarkerBodyPosition(bodyNumber=self.bodies[point.link], localPosition=spatial(point.local))
        return self.mbs.AddMarker(marker)

    def _mark_frame(self, link: int, local: Array) -> Any:
        """Add a marker with a position and an orientation at the place `local` (2,) of a link, and return it."""
        return self.mbs.AddMarker(self.items.MarkerBodyRigid(bodyNumber=self.bodies[link], localPosition=spatial(local)))

    def _mark_angle(self, link: int) -> Any:
        """Add a marker of a link's angle relative to its start, and return it.

        The ground has no angle: for the ground, the marker refers to a coordinate of the ground's node, which always stays zero.
        """
        coordinate = 0 if link == GROUND else 2
        return self.mbs.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=self.nodes[link], coordinate=coordinate))

    def _add_joint(self, joint: Joint) -> None:
        """Add a pin or a slide."""
        if not isinstance(joint, Prismatic):
            markers = [self._mark_point(joint.a), self._mark_point(joint.b)]
            self.mbs.AddObject(self.items.ObjectJointRevolute2D(markerNumbers=markers))
            return
        # Exudyn measures along the normal at the second marker. The guide has the second marker, so that Exudyn's constraint rows
        # are the linkage's rows times -1. `turn` is the constant angle between guide and block.
        normal = unit(joint.angle, across=True)
        foot = self._mark_frame(joint.guide.link, joint.guide.local + joint.offset * normal)
        slide = self.items.ObjectJointPrismatic2D(
            markerNumbers=[self._mark_frame(joint.block.link, joint.block.local), foot],
            axisMarker0=spatial(unit(joint.angle - joint.turn)),
            normalMarker1=spatial(normal),
            constrainRotation=True,
        )
        self.mbs.AddObject(slide)

    def _add_driver(self, driver: Driver) -> None:
        """Add the constraint of a driven angle, slide or length."""
        if not isinstance(driver, AngleDriver):
            self._add_driven_distance(driver)
            return
        # Exudyn's angle is the displacement u = theta - theta0 from the start, so the law is shifted by theta0
        start = float(value(driver.coordinate, self.mechanism.q0))
        drive = self.items.ObjectConnectorCoordinate(
            markerNumbers=[self._mark_angle(GROUND), self._mark_angle(driver.link)],
            offsetUserFunction=self._offset(driver.law, 0, start),
            offsetUserFunction_t=self._offset(driver.law, 1, 0.0),
        )
        self.mbs.AddObject(drive)

    def _add_driven_distance(self, driver: SlideDriver | LengthDriver) -> None:
        """Add the constraint x(q) = law(t) of a driven slide or length."""
        pair = span(driver)
        nodes = [self.mbs.AddMarker(self.items.MarkerNodeCoordinates(nodeNumber=self.nodes[point.link])) for point in pair]
        equation, jacobian = self._equation(driver)
        drive = self.items.ObjectConnectorCoordinateVector(
            markerNumbers=nodes,
            scalingMarker0=np.zeros((1, 1)),  # Exudyn takes the number of equations from its shape
            constraintUserFunction=equation,
            jacobianUserFunction=jacobian,
        )
        self.mbs.AddObject(drive)

    def _equation(self, driver: SlideDriver | LengthDriver) -> tuple[Any, Any]:
        """Return the user functions of the constraint x(q) - law(t) = 0 and of its Jacobian.

        Exudyn calls each user function with one list of the coordinates of both links that the driver joins; the ground has none.
        """
        coordinate, law = driver.coordinate, driver.law
        links = [point.link for point in span(driver) if point.link != GROUND]
        columns = [3 * link + axis for link in links for axis in range(3)]  # their entries in q

        def full(of_both_links: Any) -> Array:
            """Expand Exudyn's list for the driver's links to a vector (n,) for all links, with zeros for the other links."""
            state = np.zeros(self.mechanism.n)
            state[columns] = np.array(of_both_links)
            return state

        def equation(mbs: Any, t: float, item: int, q: Any, v: Any, velocity: bool) -> list[float]:
            """Return the residual x(q) - law(t), or its rate if Exudyn asks for the velocity level."""
            if velocity:
                return [float(rate(coordinate, full(q), full(v))) - float(law(t)[1])]
            return [float(value(coordinate, full(q))) - float(law(t)[0])]

        def jacobian(mbs: Any, t: float, item: int, q: Any, v: Any, velocity: bool) -> Array:
            """Return the derivatives (1, columns) of x with respect to the coordinates of the driver's links."""
            return np.array(gradient(coordinate, full(q))[None, columns])

        return equation, jacobian

    def _offset(self, law: MotionLaw, rate: int, start: float) -> Any:
        """Return a user function of time: the law's value (`rate` 0) or its first derivative (`rate` 1), minus `start`."""
        return lambda mbs, t, item, offset: float(law(t)[rate]) - start

    def _add_varying_force(self, force: Force) -> None:
        """Add a force or torque that varies, with a user function, which Exudyn calls at every evaluation.

        Time is limited to `self.last`, so that in a step that ends at a jump of the force, the force has the value before the jump.
        A force at a point of the ground has no effect, and is left out.
        """
        factor = factor_of(force)
        assert factor is not None
        match force:
            case Torque(_, link, reaction, value):

                def torque(mbs: Any, t: float, item: int, turned: float, turning: float, *numbers: float) -> float:
                    """Return the torque [N m] with Exudyn's sign: a positive torque reduces the angle between the markers.

                    Exudyn passes the angle `turned` [rad] between the markers, and its rate `turning` [rad/s]. The torque is
                    `value` times a factor that depends on the time, and on the rate, counted positive in the direction of the
                    torque. The other arguments are not used.
                    """
                    return -value * float(factor(min(t, self.last), np.sign(value) * turning))

                markers = [self._mark_angle(reaction), self._mark_angle(link)]
                self.mbs.AddObject(
                    self.items.ObjectConnectorCoordinateSpringDamper(markerNumbers=markers, springForceUserFunction=torque)
                )
            case PointForce(_, point) if point.link != GROUND:

                def scale(mbs: Any, t: float, load: Any) -> list[float]:
                    """Return the force vector `load` times the factor at time t [s]."""
                    return [float(x) for x in factor.of_time(min(t, self.last)) * np.array(load)]

                marker, vector, fixed = self._mark_frame(point.link, point.local), spatial(force.value), force.frame != GROUND
                load = self.items.LoadForceVector(
                    markerNumber=marker, loadVector=vector, bodyFixed=fixed, loadVectorUserFunction=scale
                )
                self.mbs.AddLoad(load)

    def _add_law(self, law: Law) -> None:
        """Add a spring, damper or constant force on a coordinate."""
        match law.coordinate:
            case Angle(a, b):
                self._add_torque(b, law.bias)
                self._add_torque(a, -law.bias)
                if law.k or law.c:
                    self._add_torsion_spring(a, b, law)
            case Along():
                self._add_spring_along(law.coordinate, law)
            case Distance(a, b):
                self._add_spring(a, b, law)
            case Weighted():
                raise TypeError("the adapter of Exudyn does not support a law on a sum of coordinates")
            case _:
                assert_never(law.coordinate)

    def _add_torque(self, link: int, value: float) -> None:
        """Add a constant torque [N m] on a link: a load on its angle, which Exudyn evaluates faster than a vector."""
        if link != GROUND and value:
            self.mbs.AddLoad(self.items.LoadCoordinate(markerNumber=self._mark_angle(link), load=value))

    def _add_point_force(self, f: PointForce) -> None:
        """Add a constant force.

        A force whose direction is fixed in a third link becomes a connector between the third link and the point on which the force
        acts. The connector also exerts the reaction of the force on the third link, which an additional load cancels.
        """
        size, items = float(np.linalg.norm(f.value)), self.items
        if f.point.link == GROUND or size == 0:
            return
        marker, value = self._mark_frame(f.point.link, f.point.local), spatial(f.value)
        if f.frame in (GROUND, f.point.link):
            self.mbs.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=value, bodyFixed=f.frame != GROUND))
            return
        base = self._mark_frame(f.frame, np.zeros(2))
        push = items.ObjectConnectorLinearSpringDamper(
            markerNumbers=[base, marker],
            axisMarker0=spatial(f.value / size),
            force=-size,  # positive force pulls the markers together
        )
        self.mbs.AddObject(push)
        self.mbs.AddLoad(items.LoadForceVector(markerNumber=base, loadVector=value, bodyFixed=True))

    def _add_spring(self, a: Point, b: Point, law: Law) -> None:
        """Add a force law (spring, damper and constant force) on the distance between two points."""
        markers = [self._mark_point(a), self._mark_point(b)]
        if law.rest == law.c == law.bias == 0:  # the force is k times the gap, and needs no direction if the points coincide
            spring = self.items.ObjectConnectorCartesianSpringDamper(markerNumbers=markers, stiffness=[law.k, law.k, 0.0])
        else:
            spring = self.items.ObjectConnectorSpringDamper(
                markerNumbers=markers, referenceLength=law.rest, stiffness=law.k, damping=law.c, force=-law.bias
            )
        self.mbs.AddObject(spring)

    def _add_torsion_spring(self, a: int, b: int, law: Law) -> None:
        """Add the spring and damper of a law on the angle between two links."""
        start = float(value(Angle(a, b), self.mechanism.q0))
        spring = self.items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=[self._mark_angle(a), self._mark_angle(b)], stiffness=law.k, damping=law.c, offset=law.rest - start
        )
        self.mbs.AddObject(spring)

    def _add_spring_along(self, along: Along, law: Law) -> None:
        """Add a force law along an axis.

        A law along x or y of the world becomes a Cartesian spring, which is cheaper but has no constant force. The stiffness of
        this spring across the axis is zero. A law along any other axis, or with a constant force, becomes a linear spring.
        """
        origin, point, u, items = along.origin, along.point, unit(along.angle, along.across), self.items
        along_x_or_y = origin.link == GROUND and np.abs(u).min() < PARALLEL
        if along_x_or_y and law.bias == 0:
            axis = np.abs(u).round()
            spring = items.ObjectConnectorCartesianSpringDamper(
                markerNumbers=[self._mark_point(origin), self._mark_point(point)],
                stiffness=spatial(law.k * axis),
                damping=spatial(law.c * axis),
                offset=spatial(law.rest * u.round()),
            )
        else:
            # the reaction acts at the foot of the perpendicular from the origin to the line through `point` parallel to the axis
            foot = origin.local + self._lateral_distance(along) * np.array([-u[1], u[0]])
            spring = items.ObjectConnectorLinearSpringDamper(
                markerNumbers=[self._mark_frame(origin.link, foot), self._mark_frame(point.link, point.local)],
                axisMarker0=spatial(u),
                stiffness=law.k,
                damping=law.c,
                offset=law.rest,
                force=-law.bias,  # positive force pulls the markers together
            )
        self.mbs.AddObject(spring)

    def _lateral_distance(self, along: Along) -> float:
        """Return the signed distance [m] of the point from the axis at the start, positive to the left of the axis.

        If the axis moves with a link, a slide joint keeps the distance of the point from the axis constant. The direction of the
        axis is `along.angle`, plus a quarter turn if `along.across`.
        """
        left = along.angle + (np.pi if along.across else np.pi / 2)
        return float(value(Along(along.origin, along.point, left), self.mechanism.q0))


def span(driver: SlideDriver | LengthDriver) -> tuple[Point, Point]:
    """Return the two points between which a driver prescribes the displacement along a slide, or the distance."""
    return driver.joint.ends if isinstance(driver, SlideDriver) else (driver.a, driver.b)
