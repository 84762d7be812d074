"""Applied forces on links in world axes: for each link a force through its centre of mass, and a moment about it.

A force F at a link-fixed point with arm r gives the force F and the moment r x F. A force along an axis of another link has a
reaction on that link, the opposite force on the same line. On purpose the derivation shares nothing with
`mechanism/coordinates.py`: each kind of force is derived here a second time, and motions with other forces cannot be certified. The
forces are

    spring between points:   F = -(k (L - rest) + c L') d / L on the second point, with d the vector from the first point to the
                             second, L its length, and L L' = d . d'
    spring along an axis:    F = (k (rest - x) - c x') u on the point, with u the direction of the axis, d the vector from its
                             origin to the point, x = u . d, x' = u . d' + omega u x d, and omega the angular velocity of the axis
    damping of a slide:      F = -c s' u on the block, with s the displacement along the direction u of the guide
"""

from collections.abc import Mapping
from typing import Any

from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import (
    GROUND,
    AxisSpringDamper,
    Force,
    Joint,
    JointDamping,
    Point,
    PointForce,
    Prismatic,
    RotationalSpringDamper,
    SpringDamper,
    Torque,
)
from gauss_bench.reference.taylor.arithmetic import Value, Vector, cross, dot, plus, scale_by
from gauss_bench.reference.taylor.vector_sums import NONE, Instant, LoopCoordinates, Sum, merge

KNOWN = (Torque, PointForce, SpringDamper, AxisSpringDamper, RotationalSpringDamper, JointDamping)


class Wrench:
    """The forces on all links at one instant, to which forces and torques are added one by one.

    Attributes:
        force: for each link the force through its centre of mass.
        moment: for each link the moment about its centre of mass.
    """

    def __init__(self, coordinates: LoopCoordinates, at: Instant):
        self.coordinates, self.at = coordinates, at
        self.force: list[Vector] = [(0, 0) for _ in coordinates.mechanism.links]
        self.moment: list[Value] = [0 for _ in coordinates.mechanism.links]

    def flat(self) -> list[Value]:
        """Return the components x and y of the force, and the moment, of every link in turn."""
        return [x for force, moment in zip(self.force, self.moment, strict=True) for x in (*force, moment)]

    def turn(self, vector: Any, link: int) -> Vector:
        """Return, in world axes, a vector that is given in the frame of a link."""
        return self.at.combine(self.coordinates.turn_vector(vector, link))

    def gap(self, a: Point, b: Point) -> Sum:
        """Return the vector from point a to point b, as a sum of vectors."""
        return merge(self.coordinates.point(b), less=self.coordinates.point(a))

    def twist(self, b: int, a: int, torque: Value) -> None:
        """Apply a torque to link b and its reaction to link a."""
        for link, moment in ((b, torque), (a, -torque)):
            if link != GROUND:
                self.moment[link] = self.moment[link] + moment

    def push(self, point: Point, force: Vector, link: int | None = None) -> None:
        """Apply a force that acts at a point to `link`, by default the link of the point; nothing is done for the ground."""
        link = point.link if link is None else link
        if link == GROUND:
            return
        if link == point.link:  # arm: the vector from the centre of mass to the point
            arm = self.coordinates.turn_vector(point.local, link)
        else:
            arm = merge(self.coordinates.point(point), less=self.coordinates.centres[link])
        self.force[link] = plus(self.force[link], force)
        self.moment[link] = self.moment[link] + cross(self.at.combine(arm), force)

    def pull(self, b: Point, a: Point, force: Vector) -> None:
        """Apply a force to point b, and the opposite force, its reaction, to point a."""
        self.push(b, force)
        self.push(a, (-force[0], -force[1]))

    def slide(self, point: Point, origin: Point, force: Vector) -> None:
        """Apply a force to a point, and the opposite force on the same line to the link of the point `origin`."""
        self.push(point, force)
        self.push(point, (-force[0], -force[1]), origin.link)


class Loads(Wrench):
    """All applied forces on the links, gravity included, at given coordinates and velocities (coordinate -> velocity)."""

    def __init__(self, coordinates: LoopCoordinates, at: Instant, v: Mapping[int, Value]):
        """Begin with the weights of the links, and apply all forces of the linkage."""
        super().__init__(coordinates, at)
        self.v, self.rate, self.constant = v, at.variation(v), at.arithmetic.constant
        g = coordinates.mechanism.gravity
        self.force = [(self.constant(link.mass * g[0]), self.constant(link.mass * g[1])) for link in coordinates.mechanism.links]
        for f in coordinates.mechanism.forces:
            self._apply(f)

    def _speed(self, link: int) -> Value:
        """Return the angular velocity of a link [rad/s]."""
        return 0 if link == GROUND else self.v.get(self.coordinates.angle[link], 0)

    def _angle(self, link: int) -> Value:
        """Return the angle of a link [rad], including whole turns."""
        if link == GROUND:
            return 0
        index, turn = self.coordinates.angle[link], self.constant(self.coordinates.turn[link])
        return turn if index == NONE else self.at.x[index] + turn

    def _apply(self, f: Force) -> None:
        """Apply a force of the linkage, with its reaction, to the links on which it acts."""
        match f:
            case Torque():
                self.twist(f.link, f.reaction, self.constant(f.value))
            case PointForce():
                self.push(f.point, self.turn(f.value, f.frame))
            case SpringDamper():
                self._spring(f)
            case AxisSpringDamper():
                gap, u = self.gap(f.origin, f.point), self.turn(unit(f.angle), f.origin.link)  # u: direction of the axis
                d = self.at.combine(gap)  # from the origin of the axis to the point; its length along the axis is u . d
                rate = dot(u, self.at.combine(gap, self.rate)) + self._speed(f.origin.link) * cross(u, d)  # (u . d)', as u turns
                self.slide(f.point, f.origin, scale_by(self._linear(f, dot(u, d), rate), u))
            case RotationalSpringDamper():
                angle, speed = self._angle(f.b) - self._angle(f.a), self._speed(f.b) - self._speed(f.a)
                self.twist(f.b, f.a, self._linear(f, angle, speed))
            case JointDamping():
                for pair in f.pairs:
                    self._damp(pair, f.c)
            case _:
                raise TypeError(f"force {f.name}: the kind {type(f).__name__} has no derivation here")

    def _linear(self, f: AxisSpringDamper | RotationalSpringDamper, x: Value, rate: Value) -> Value:
        """Return the force k (rest - x) - c rate of a spring and damper, whose coordinate has the value x and this rate."""
        return self.constant(f.k) * (self.constant(f.rest) - x) - self.constant(f.c) * rate

    def _spring(self, f: SpringDamper) -> None:
        """Apply a spring and damper between two points; terms with a coefficient of zero are left out.

        The force on the point a is `pull` times the vector d from a to b, where pull = k (L - rest) / L + c L' / L.
        """
        gap = self.gap(f.a, f.b)
        d = self.at.combine(gap)
        square = dot(d, d)  # L^2
        pull = self.constant(f.k)
        if f.rest != 0 and f.k != 0:
            pull = pull - self.constant(f.k * f.rest) / self.at.arithmetic.sqrt(square)
        if f.c != 0:
            pull = pull + self.constant(f.c) * dot(d, self.at.combine(gap, self.rate)) / square
        self.pull(f.a, f.b, scale_by(pull, d))

    def _damp(self, joint: Joint, c: Any) -> None:
        """Apply the damping of a joint: a force along a slide, a torque about a pin."""
        if isinstance(joint, Prismatic):
            u, speed = self.turn(unit(joint.angle), joint.guide.link), self.v.get(self.coordinates.slides[joint.name], 0)
            self.slide(joint.block, joint.guide, scale_by(-(self.constant(c) * speed), u))
        else:
            speed = self._speed(joint.b.link) - self._speed(joint.a.link)
            self.twist(joint.b.link, joint.a.link, -(self.constant(c) * speed))
