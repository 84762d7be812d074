"""Build a linkage from Exudyn's items; explain why a force has no exact counterpart among them.

Exudyn takes the normal n of a slide from its second marker. Therefore the first marker is on the block b and the second on the
guide g, and both constraint rows of the slide have the opposite sign of the linkage's rows:

    (p_g + offset n - p_b) . n = 0,    (R_b u_b) . n = 0        p: points on the line, R_b u_b: direction of the line

Trap: if the axis of a force moves with a link, Exudyn applies the reaction at the marker of the axis' origin. The link with the
axis then lacks a torque, unless the force acts along the axis through the origin. If a slide between this link and the link of the
force's point keeps the point at a fixed distance from the axis, the adapter moves the marker sideways by this distance; otherwise
the mechanism is refused.

Drivers and varying forces are user functions, which Exudyn calls at every evaluation. A varying torque is a connector between two
angles; its user function receives their relative speed.
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
from gauss_bench.trajectory import RunFailure, Status

COINCIDENT = 1e-12  # [m] points at a smaller distance coincide


def explain_refusal(mechanism: Mechanism, force: Force) -> str | None:
    """Return the reason why a force has no exact counterpart among Exudyn's items, or None if it has one."""
    if factor := factor_of(force):  # its `share` is the fraction of the force that acts if the point moves against the force
        if isinstance(force, PointForce) and factor.share != 1.0:
            return f"force {force.name} depends on the direction of its point's motion, which Exudyn does not pass to loads"
        if isinstance(force, PointForce) and force.frame not in (GROUND, force.point.link):
            return f"force {force.name} varies and is fixed in a third link, for which Exudyn has no load"
        return None
    for load in loads([force]):
        match load:
            case Law(Along() as axis) if axis.origin.link != GROUND and not slides_along(mechanism, axis):
                return (
                    f"force {force.name} acts along an axis of a moving link, and no slide keeps its point on that axis; "
                    "Exudyn's connectors leave out its torque on that link"
                )
            case Law(Distance()) if load.c != 0 and value(load.coordinate, mechanism.q0) < COINCIDENT:
                return f"damper {force.name} joins points that coincide at the start, where its direction is undefined"
    return None


def slides_along(mechanism: Mechanism, axis: Along) -> bool:
    """Tell whether a slide parallel to an axis joins the link of the axis to the link of the force's point."""
    link = axis.origin.link
    between = [slide for slide in mechanism.slides if {*ends(slide)} == {link, axis.point.link}]
    lines = [slide.angle if slide.guide.link == link else slide.angle - slide.turn for slide in between]
    return any(abs(np.sin(line - axis.angle)) < PARALLEL for line in lines)


class System:
    """A mechanism as Exudyn items, built with the modules `exu` and `items`.

    Attributes:
        container: owner of the system, which must live as long as the system.
        mbs: Exudyn's system.
        bodies, nodes: link -> Exudyn's number of its body and of its node.
        last: time [s] after which varying forces keep their value, so that a jump at the end of a stretch does not act in it.
    """

    def __init__(self, exu: Any, items: Any, mechanism: Mechanism):
        self.exu, self.items, self.mechanism = exu, items, mechanism
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.bodies = {GROUND: self._add("ObjectGround")}
        self.nodes = {GROUND: self._add("NodePointGround")}
        for i in range(len(mechanism.links)):
            self._add_link(i)
        for joint in mechanism.joints:
            self._add_joint(joint)
        for driver in mechanism.drivers:
            self._add_driver(driver)
        for force in (f for f in mechanism.forces if not factor_of(f)):
            for load in loads([force]):
                if isinstance(load, PointForce):
                    self._add_point_force(load)
                else:
                    self._add_law(force.name, load)
        self.last = np.inf  # [s] latest time at which forces are evaluated; the adapter sets it for every stretch of a run
        for force in mechanism.varying:
            self._add_varying_force(force)
        self.mbs.Assemble()

    def _add(self, kind: str, **fields: Any) -> Any:
        """Add an item of one of Exudyn's classes, such as "MarkerBodyRigid", to the system, and return its number."""
        group = next(x for x in ("Node", "Object", "Marker", "Load") if kind.startswith(x))
        return getattr(self.mbs, f"Add{group}")(getattr(self.items, kind)(**fields))

    def _add_link(self, i: int) -> None:
        link = self.mechanism.links[i]
        self.nodes[i] = self._add("NodeRigidBody2D", referenceCoordinates=list(self.mechanism.q0[3 * i : 3 * i + 3]))
        self.bodies[i] = self.mbs.AddObject(rigid_body(self.items.ObjectRigidBody2D, link.mass, link.inertia, self.nodes[i]))
        marker = self._add("MarkerBodyMass", bodyNumber=self.bodies[i])
        self._add("LoadMassProportional", markerNumber=marker, loadVector=spatial(self.mechanism.gravity))

    def _mark_point(self, point: Point) -> Any:
        """Add a marker of position at a point, and return its number."""
        return self._add("MarkerBodyPosition", bodyNumber=self.bodies[point.link], localPosition=spatial(point.local))

    def _mark_frame(self, link: int, local: Array) -> Any:
        """Add a marker of position and orientation at the point `local` (2,) of a link, and return its number."""
        return self._add("MarkerBodyRigid", bodyNumber=self.bodies[link], localPosition=spatial(local))

    def _mark_angle(self, link: int) -> Any:
        """Add a marker of a link's angle relative to the start, and return its number."""
        coordinate = 0 if link == GROUND else 2  # the ground has no angle, but its coordinates always stay zero
        return self._add("MarkerNodeCoordinate", nodeNumber=self.nodes[link], coordinate=coordinate)

    def _add_joint(self, joint: Joint) -> None:
        """Add a pin or a slide; for the order of a slide's markers see the head of this file."""
        if not isinstance(joint, Prismatic):
            self._add("ObjectJointRevolute2D", markerNumbers=[self._mark_point(joint.a), self._mark_point(joint.b)])
            return
        normal = unit(joint.angle, across=True)
        foot = self._mark_frame(joint.guide.link, joint.guide.local + joint.offset * normal)
        self._add(
            "ObjectJointPrismatic2D",
            markerNumbers=[self._mark_frame(joint.block.link, joint.block.local), foot],
            axisMarker0=spatial(unit(joint.angle - joint.turn)),
            normalMarker1=spatial(normal),
            constrainRotation=True,
        )

    def _add_driver(self, driver: Driver) -> None:
        """Add the constraint x(q) = law(t) of a driven angle, slide or length."""
        if isinstance(driver, AngleDriver):
            # Exudyn's angle is the displacement u = theta - theta0 from the start, so the law is shifted by theta0
            start = float(value(driver.coordinate, self.mechanism.q0))
            self._add(
                "ObjectConnectorCoordinate",
                markerNumbers=[self._mark_angle(GROUND), self._mark_angle(driver.link)],
                offsetUserFunction=self._make_offset(driver.law, 0, start),
                offsetUserFunction_t=self._make_offset(driver.law, 1, 0.0),
            )
            return
        nodes = [self._add("MarkerNodeCoordinates", nodeNumber=self.nodes[point.link]) for point in span(driver)]
        equation, jacobian = self._make_equation(driver)
        self._add(
            "ObjectConnectorCoordinateVector",
            markerNumbers=nodes,
            scalingMarker0=np.zeros((1, 1)),  # Exudyn takes the number of equations from this shape
            constraintUserFunction=equation,
            jacobianUserFunction=jacobian,
        )

    def _make_equation(self, driver: SlideDriver | LengthDriver) -> tuple[Any, Any]:
        """Return the user functions of the constraint x(q) - law(t) = 0 and of its Jacobian.

        Exudyn calls each user function with one list of the coordinates of both links that the driver joins; the ground has none.
        """
        coordinate, law = driver.coordinate, driver.law
        links = [point.link for point in span(driver) if point.link != GROUND]
        columns = [3 * link + axis for link in links for axis in range(3)]  # indices of these coordinates in q

        def whole(entries: Any) -> Array:
            """Return an array (n,) with the given entries of the two links (one link for a driver on the ground), and zeros."""
            state = np.zeros(self.mechanism.n)
            state[columns] = np.array(entries)
            return state

        def equation(mbs: Any, t: float, item: int, q: Any, v: Any, velocity: bool) -> list[float]:
            """Return the residual x(q) - law(t), or its rate if Exudyn asks for the velocity level."""
            if velocity:
                return [float(rate(coordinate, whole(q), whole(v))) - float(law(t)[1])]
            return [float(value(coordinate, whole(q))) - float(law(t)[0])]

        def jacobian(mbs: Any, t: float, item: int, q: Any, v: Any, velocity: bool) -> Array:
            """Return the derivatives (1, columns) of x with respect to the coordinates of the driver's links."""
            return np.array(gradient(coordinate, whole(q))[None, columns])

        return equation, jacobian

    def _make_offset(self, law: MotionLaw, rate: int, start: float) -> Any:
        """Return a user function of time: the law's value (`rate` 0) or its first derivative (`rate` 1), minus `start`."""
        return lambda mbs, t, item, offset: float(law(t)[rate]) - start

    def _add_varying_force(self, force: Force) -> None:
        """Add a varying force or torque by a user function of the time.

        The time is limited to `last`, so a step that ends at a jump of the force uses the value before the jump.
        """
        factor = factor_of(force)
        assert factor is not None
        match force:
            case Torque(_, link, reaction, value):

                def torque(mbs: Any, t: float, item: int, angle: float, angle_rate: float, *numbers: float) -> float:
                    """Return the torque [N m], positive if it reduces the angle between the markers.

                    The factor depends on the rate of the angle [rad/s], counted positive in the direction of the torque.
                    """
                    return -value * float(factor(min(t, self.last), np.sign(value) * angle_rate))

                markers = [self._mark_angle(reaction), self._mark_angle(link)]
                self._add("ObjectConnectorCoordinateSpringDamper", markerNumbers=markers, springForceUserFunction=torque)
            case PointForce(_, point) if point.link != GROUND:  # a force on the ground has no effect

                def scale(mbs: Any, t: float, load: Any) -> list[float]:
                    """Return the force vector `load` times the factor at time t [s]."""
                    return [float(x) for x in factor.of_time(min(t, self.last)) * np.array(load)]

                marker = self._mark_frame(point.link, point.local)
                fields = {"loadVector": spatial(force.value), "bodyFixed": force.frame != GROUND}
                self._add("LoadForceVector", markerNumber=marker, **fields, loadVectorUserFunction=scale)

    def _add_law(self, name: str, law: Law) -> None:
        """Add the items for a force law, a load of the force `name`."""
        match law.coordinate:
            case Angle(a, b):
                for link, torque in ((b, law.bias), (a, -law.bias)):
                    if link != GROUND and torque:  # Exudyn evaluates a load on an angle faster than a torque vector
                        self._add("LoadCoordinate", markerNumber=self._mark_angle(link), load=torque)
                if law.k or law.c:
                    start = float(value(law.coordinate, self.mechanism.q0))
                    markers = [self._mark_angle(a), self._mark_angle(b)]
                    numbers = {"stiffness": law.k, "damping": law.c, "offset": law.rest - start}
                    self._add("ObjectConnectorCoordinateSpringDamper", markerNumbers=markers, **numbers)
            case Along():
                self._add_spring_along(law.coordinate, law)
            case Distance(a, b):
                markers = [self._mark_point(a), self._mark_point(b)]
                if law.rest == law.c == law.bias == 0:
                    # the force is k times the gap, and needs no direction if the points coincide
                    stiffness = [law.k, law.k, 0.0]
                    self._add("ObjectConnectorCartesianSpringDamper", markerNumbers=markers, stiffness=stiffness)
                else:
                    numbers = {"referenceLength": law.rest, "stiffness": law.k, "damping": law.c, "force": -law.bias}
                    self._add("ObjectConnectorSpringDamper", markerNumbers=markers, **numbers)
            case Weighted():
                raise RunFailure(Status.SKIP, f"the adapter of Exudyn does not support a law on a sum of coordinates ({name})")
            case _:
                assert_never(law.coordinate)

    def _add_point_force(self, f: PointForce) -> None:
        """Add a constant force.

        A force whose direction is fixed in a third link becomes a connector between the third link and the point on which the force
        acts. The connector also exerts the reaction of the force on the third link, which an additional load cancels.
        """
        size = float(np.linalg.norm(f.value))
        if f.point.link == GROUND or size == 0:
            return
        marker, vector = self._mark_frame(f.point.link, f.point.local), spatial(f.value)
        if f.frame in (GROUND, f.point.link):
            self._add("LoadForceVector", markerNumber=marker, loadVector=vector, bodyFixed=f.frame != GROUND)
            return
        base = self._mark_frame(f.frame, np.zeros(2))
        pulling = {"axisMarker0": spatial(f.value / size), "force": -size}  # positive force pulls the markers together
        self._add("ObjectConnectorLinearSpringDamper", markerNumbers=[base, marker], **pulling)
        self._add("LoadForceVector", markerNumber=base, loadVector=vector, bodyFixed=True)

    def _add_spring_along(self, along: Along, law: Law) -> None:
        """Add a force law along an axis.

        A law along x or y of the world becomes a Cartesian spring, which is cheaper but has no constant force. The stiffness of
        this spring across the axis is zero. A law along any other axis, or with a constant force, becomes a linear spring.
        """
        origin, point, u = along.origin, along.point, unit(along.angle, along.across)
        along_x_or_y = origin.link == GROUND and np.abs(u).min() < PARALLEL
        if along_x_or_y and law.bias == 0:
            axis = np.abs(u).round()
            self._add(
                "ObjectConnectorCartesianSpringDamper",
                markerNumbers=[self._mark_point(origin), self._mark_point(point)],
                stiffness=spatial(law.k * axis),
                damping=spatial(law.c * axis),
                offset=spatial(law.rest * u.round()),
            )
            return
        # the reaction acts at the foot of the perpendicular from the origin to the line through `point` parallel to the axis; the
        # distance [m] of this line to the left is that at the start: if the axis moves with a link, a slide keeps it constant
        left = along.angle + (np.pi if along.across else np.pi / 2)
        distance = float(value(Along(origin, point, left), self.mechanism.q0))
        foot = origin.local + distance * np.array([-u[1], u[0]])
        self._add(
            "ObjectConnectorLinearSpringDamper",
            markerNumbers=[self._mark_frame(origin.link, foot), self._mark_frame(point.link, point.local)],
            axisMarker0=spatial(u),
            stiffness=law.k,
            damping=law.c,
            offset=law.rest,
            force=-law.bias,  # positive force pulls the markers together
        )


def span(driver: SlideDriver | LengthDriver) -> tuple[Point, Point]:
    """Return the two points between which a driver prescribes the displacement along a slide, or the distance."""
    return driver.joint.ends if isinstance(driver, SlideDriver) else (driver.a, driver.b)
