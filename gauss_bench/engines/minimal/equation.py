"""The equation of motion of a linkage in one coordinate q, as expressions.

Primes denote derivatives by q. Vectors of the plane are also complex numbers. A link has the direction e = exp(i theta), omega =
theta' and alpha = theta''. If the point p of a link is at the vector r from a point p0 of the same link,

    p' = p0' + i omega r,    p'' = p0'' + i alpha r - omega^2 r

Only for q itself, primes denote derivatives by time: the velocity of p is p' q', its acceleration p' q'' + p'' q'^2. The kinetic
energy is m(q) q'^2 / 2, and Lagrange's equation is

    m q'' + h q'^2 = Q,    m = sum M |p'|^2 + I omega^2,    h = m' / 2 = sum M p' . p'' + I omega alpha

with the mass M, moment of inertia I and centre of mass p of each link, and the power Q of the loads at q' = 1.

The positions of the two links of a dyad follow from elementary geometry, with one square root. Their derivatives by q follow from
two linear equations whose determinant is proportional to the same root, so the root also measures how far the dyad is from its dead
centre.

A torsion spring needs the angle of a link with whole turns counted, which positions do not give: the angle is integrated together
with q, at the rate omega q', unless it is q itself, or slides keep it constant or at a constant difference from q.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gauss_bench.compiler.elimination.function import Function, Inputs, function, uses
from gauss_bench.compiler.elimination.program import Program
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node
from gauss_bench.engines.minimal.structure import Dyad, DyadSequence, Links, OuterJoint
from gauss_bench.mechanism.coordinates import DistanceState, state, strength
from gauss_bench.mechanism.frames import Direction, End, Frame, Placement
from gauss_bench.mechanism.model import GROUND, Angle, Law, Mechanism, Point, Prismatic, loads
from gauss_bench.mechanism.spaces import Vec, angle_at, cross, dot, rotate_vec
from gauss_bench.terms import Array

NEAR = 0.02  # [rad, m] largest distance of the expressions' random test points from the samples
AXIS = 1e-14  # relative to a vector's length: a smaller component is the rounding error of a right angle


@dataclass(frozen=True, eq=False)
class Equation:
    """The equation of motion for one independent coordinate on one branch of the linkage.

    Attributes:
        sequence: the input link, whose motion is the coordinate, and the dyads of the other links.
        signs: for each dyad the sign that selects one of its two solutions; all signs together are the branch.
        integrated: links whose angles are integrated together with the coordinate.
        angles: link whose angle a spring needs -> index of an entry of the program's q, and the constant [rad] that is added to it.
        program: the acceleration for the compiler's integrators; its q are the coordinate and the angles of `integrated`.
        motion: function (t, q, v, p) -> x, y, cos, sin of every link; x', y', omega of every link; x'', y'', alpha; and q''.
    """

    sequence: DyadSequence
    signs: tuple[float, ...]
    integrated: tuple[int, ...]
    angles: Mapping[int, tuple[int, float]]
    program: Program
    motion: Function

    def state(self, at: Links, link_angles: Mapping[int, float]) -> Array:
        """Return the program's state (2n,), q then v, at a state of the links.

        Args:
            link_angles: link -> its angle [rad], with whole turns counted, for the links whose angles springs need.
        """
        value, rate = self.sequence.state(at)
        # every entry is the coordinate at first; the loop replaces integrated angles, and the coordinate if its whole turns matter
        q, v = np.full(self.program.n, value), np.full(self.program.n, rate)
        for link, (k, turn) in self.angles.items():
            q[k], v[k] = link_angles[link] - turn, at.w[link]
        return np.concatenate([q, v])

    def spring_angles(self, q: Array) -> dict[int, float]:
        """Return link -> angle [rad], for the angles that springs need, at the program's q (n,)."""
        return {link: float(q[k]) + turn for link, (k, turn) in self.angles.items()}


def write_equation(mechanism: Mechanism, sequence: DyadSequence, signs: Sequence[float], q: Array, least: Array) -> Equation:
    """Write the equation of motion of a linkage.

    Args:
        q: (k, n) positions of the linkage on this branch, away from dead centres, in absolute coordinates.
        least: (dyads,) for each dyad the smallest opening at which the equation may be used.
    """
    torsion = [x.coordinate for x in loads(mechanism.forces) if isinstance(x, Law) and x.k and isinstance(x.coordinate, Angle)]
    needed = {link for angle in torsion for link in (angle.a, angle.b)}  # links whose angles torsion springs need
    # a link whose root is the ground has a constant angle
    roots = {link: root for link, root in _roots(sequence).items() if link in needed and root.link != GROUND}
    integrated = tuple(sorted({root.link for root in roots.values()} - {sequence.link}))
    indices = {link: k for k, link in enumerate((sequence.link, *integrated))}  # root -> index of its angle in the program's q
    angles = {link: (indices[roots[link].link], roots[link].turn) for link in sorted(roots)}
    value, _ = sequence.state(Links.of(q, np.zeros_like(q)))
    states = np.column_stack([value, *(angle_at(q, link) for link in integrated)])
    motion = _Motion(mechanism, sequence, signs, integrated, states)
    a, openings = motion.acceleration(), motion.openings
    square_roots = [node for node, _ in openings]
    n = 1 + len(integrated)
    inputs: Inputs = (("t", 1), ("q", n), ("v", n), ("p", 0))
    program = Program(
        name=mechanism.name,
        formulation="minimal",
        n=n,
        m=0,
        independent=(0,),
        parameters=(),
        values=np.zeros(0),
        dropped=(),
        thresholds=np.array([full * x for (_, full), x in zip(openings, least, strict=True)]),  # of the square roots
        acceleration=function(inputs, [a, square_roots], uses([*a, *square_roots])),
    )
    # a[0] is q''; the others are the second derivatives of the integrated angles
    of_links = function(inputs, [*motion.links(), a[:1]], None)
    return Equation(sequence, tuple(signs), integrated, angles, program, of_links)


class Root(NamedTuple):
    """The root of a link: the link to which slides fix its angle. The angle is that of `link` plus the constant `turn` [rad]."""

    link: int
    turn: float


def _roots(sequence: DyadSequence) -> dict[int, Root]:
    """Return link -> root for every link; a link is its own root if no slide joins it to a link placed before."""
    roots = {GROUND: Root(GROUND, 0.0), sequence.link: Root(sequence.link, 0.0)}
    joint = sequence.joint
    if isinstance(joint, Prismatic):  # `turn` is the block's angle minus the guide's; either may be the ground
        roots[sequence.link] = Root(GROUND, joint.turn if joint.guide.link == GROUND else -joint.turn)
    for dyad in sequence.dyads:
        first, second = dyad.links
        roots[first] = Root(first, 0.0)
        if dyad.kind == "RRR":
            roots[second] = Root(second, 0.0)
        else:
            fixed_to = roots[dyad.second.other.link if dyad.kind == "RRP" else first]
            roots[second] = Root(fixed_to.link, fixed_to.turn + dyad.turn)
    return roots


@dataclass(frozen=True, eq=False)
class Place:
    """A point: its position p [m], and the first derivative d and second derivative b of p with respect to the coordinate q."""

    p: Vec
    d: Vec
    b: Vec

    def __sub__(self, other: "Place") -> "Place":
        return Place(self.p - other.p, self.d - other.d, self.b - other.b)


class Body:
    """The pose of a link as a function of the independent coordinate q.

    Attributes:
        e: direction exp(i angle) of the link.
        omega, alpha: first and second derivative of the angle with respect to q.
        at, place: (2,) a point of the link in its own frame [m], and the motion of this point.
        pin: (2,) a second pin of the link in its own frame [m], or None: with two pins, masses at both replace the link's mass.
    """

    def __init__(self, e: Vec, omega: Node, alpha: Node, at: Array, place: Place, pin: Array | None = None):
        self.e, self.omega, self.alpha, self.at, self.place, self.pin = e, omega, alpha, at, place, pin
        self.omega_squared, self.omega_alpha = omega * omega, omega * alpha

    def arm(self, to: Array) -> Vec:
        """Return the vector from the point `at` to another point of the link, in world axes."""
        return _product(self.e, _constant(self.omega.graph, *(to - self.at)))

    def point(self, local: Array) -> Place:
        """Return the motion of a point of the link: p' = p0' + i omega r,  p'' = p0'' + i alpha r - omega^2 r."""
        r, o = self.arm(local), self.place
        return Place(o.p + r, o.d + cross(self.omega, r), o.b + cross(self.alpha, r) - r * self.omega_squared)


def _constant(graph: ExpressionGraph, x: float, y: float) -> Vec:
    """Return a constant vector; a component that is only a rounding error becomes an exact zero, so that its terms vanish."""
    size = AXIS * max(abs(x), abs(y))
    return Vec(*(graph.constant(0.0 if abs(z) < size else float(z)) for z in (x, y)))


def _product(a: Vec, b: Vec) -> Vec:
    """Return the product of two vectors as complex numbers."""
    return rotate_vec(b, a)


def _unit(graph: ExpressionGraph, angle: float) -> Vec:
    """Return the constant vector exp(i angle)."""
    return _constant(graph, float(np.cos(angle)), float(np.sin(angle)))


class _Motion:
    """The poses of all links as functions of the independent coordinate, as nodes (expressions) of a graph.

    Attributes:
        roots: link -> its `Root`.
        q: nodes of the coordinate and of the angles that are integrated together with it.
        v: node of the coordinate's rate q'.
        still: zero vector, the derivative of a point at rest.
        bodies: link -> its `Body`; the ground is included.
        openings: for each dyad the node of the square root in its solution, which is zero at the dead centre, and the value of this
            root at which the dyad's opening is 1.
    """

    def __init__(self, mechanism: Mechanism, sequence: DyadSequence, signs: Sequence[float], integrated: tuple[int, ...], q: Array):
        """Compute the pose of the input link, and then those of the other links, dyad after dyad.

        Args:
            q: (k, n) sampled values of the coordinate and of the integrated angles, at which expressions are tested for equality.
        """
        self.mechanism, self.integrated, self.roots = mechanism, integrated, _roots(sequence)
        self.graph = graph = ExpressionGraph(len(q))
        self.q = [graph.input("q", k, q[:, k], NEAR) for k in range(q.shape[1])]
        self.v = graph.input("v", 0, np.linspace(1.0, 3.0, len(q)), 1.0)  # samples of q': any speeds except zero will do
        self.zero, self.one = graph.constant(0.0), graph.constant(1.0)
        self.still = Vec(self.zero, self.zero)
        rest = Place(self.still, self.still, self.still)  # the ground's origin
        self.bodies: dict[int, Body] = {GROUND: Body(_unit(graph, 0.0), self.zero, self.zero, np.zeros(2), rest)}
        self.bodies[sequence.link] = self._place_input_link(sequence)
        self.openings: list[tuple[Node, float]] = []
        close = {"RRR": self._close_rrr, "RRP": self._close_rrp, "RPR": self._close_rpr}
        for dyad, sign in zip(sequence.dyads, signs, strict=True):
            close[dyad.kind](dyad, sign)

    def _place_input_link(self, sequence: DyadSequence) -> Body:
        """Return the motion of the input link, whose angle or displacement is the coordinate q.

        A slide moves the link from `sequence.fixed` by q along the guide, at the distance `offset` to the left of the guide's line.
        """
        graph, joint, q = self.graph, sequence.joint, self.q[0]
        if not isinstance(joint, Prismatic):
            pin = Place(_constant(graph, *sequence.fixed.local), self.still, self.still)
            return Body(Vec(graph.cos(q), graph.sin(q)), omega=self.one, alpha=self.zero, at=sequence.moved.local, place=pin)
        if joint.guide.link == GROUND:
            turn, along = joint.turn, _unit(graph, joint.angle)
        else:  # the guide moves opposite to the motion of the block relative to the guide
            turn = -joint.turn
            along = _unit(graph, joint.angle + turn) * -1.0
        position = _constant(graph, *sequence.fixed.local) + along * q + cross(joint.offset, along)
        place = Place(position, along, self.still)  # the derivative of the position by q is `along`
        return Body(_unit(graph, turn), omega=self.zero, alpha=self.zero, at=sequence.moved.local, place=place)

    def at(self, point: Point) -> Place:
        """Return the motion of a point of a placed link."""
        return self.bodies[point.link].point(point.local)

    def _close_rrr(self, dyad: Dyad, sign: float) -> None:
        """Solve an RRR dyad: two links are pinned at A and at C, and their common pin B lies on circles about A and C.

        The radii are r1 and r2. `base` = C - A has the fields p, d and b: its value and its first and second derivative by q. Let a
        = B - A and c = B - C, so that a - c = C - A. The links with A and C turn at omega1 and omega2, so a' = i omega1 a and c' =
        i omega2 c. The scalar products of the first and second derivative of a - c = C - A with c and with a give

            omega1 a x c = c . (C - A)',    alpha1 a x c = c . (C - A)'' + omega1^2 a . c - omega2^2 r2^2
            omega2 a x c = a . (C - A)',    alpha2 a x c = a . (C - A)'' + omega1^2 r1^2 - omega2^2 a . c

        The cross product a x c is root / 2 or -root / 2, according to the branch.
        """
        A, C = self.at(dyad.first.other), self.at(dyad.second.other)
        r1, r2 = dyad.lengths
        base = C - A
        s, s_squared = base.p, dot(base.p, base.p)
        # |a| = r1 and |a - s| = r2 give a . s; then a = ((a . s) s + sign root / 2 (s turned by a quarter to the left)) / s^2
        twice_a_dot_s = s_squared + (r1 * r1 - r2 * r2)
        root_squared = s_squared * (4 * r1 * r1) - twice_a_dot_s * twice_a_dot_s
        root = self.graph.sqrt(root_squared)
        a = (s * twice_a_dot_s + cross(root * sign, s)) * (self.graph.inverse(s_squared) * 0.5)
        c = a - s
        # inverse: 1 / (a x c)
        a_dot_c, inverse = (r1 * r1 + r2 * r2 - s_squared) * 0.5, root * self.graph.inverse(root_squared) * (2 * sign)
        omega1, omega2 = dot(base.d, c) * inverse, dot(base.d, a) * inverse
        square1, square2 = omega1 * omega1, omega2 * omega2
        alpha1 = (dot(base.b, c) + square1 * a_dot_c - square2 * (r2 * r2)) * inverse
        alpha2 = (dot(base.b, a) + square1 * (r1 * r1) - square2 * a_dot_c) * inverse
        pin1, pin2 = (pin.local for pin in dyad.middle)
        self._add_rod(dyad.first, a, omega1, alpha1, A, pin1)
        self._add_rod(dyad.second, c, omega2, alpha2, C, pin2)
        self.openings.append((root, 2 * r1 * r2))

    def _add_rod(self, outer: OuterJoint, arm: Vec, omega: Node, alpha: Node, place: Place, pin: Array) -> None:
        """Add a link of a dyad that is pinned to a placed link at its outer joint, whose motion is `place`.

        The link's direction is e = arm / s, with `arm` from the outer joint to the link's point `pin`, in world axes, and s the
        same in the link's frame. `omega` and `alpha` are derivatives of the angle by q.
        """
        s = pin - outer.own.local
        # 1 / s as a complex number
        inverse = _constant(self.graph, float(s[0] / (s @ s)), float(-s[1] / (s @ s)))
        self.bodies[outer.link] = Body(_product(arm, inverse), omega, alpha, outer.own.local, place, pin)

    def _close_rrp(self, dyad: Dyad, sign: float) -> None:
        """Solve an RRP dyad: a rod is pinned at A and, at its other end B, to a slider that moves along a line.

        R is a point of the line. B lies on a circle of radius r about A, at the distance `height` to the left of the line. Let u be
        the unit vector along the line, and n a quarter turn to its left. Both turn with the link of the line. With coordinates x, y
        measured from A, and s from R, B is at

            B = A + x u + y n = R + s u + height n

        The first and second derivative of this equation, along n, give omega and alpha of the rod; the first derivative along u
        gives `slip` = s'. `base` = R - A has the fields p, d and b: its value and its first and second derivative by q.
        """
        guide, A, R = self.bodies[dyad.line.link], self.at(dyad.first.other), self.at(dyad.line)
        u = _product(guide.e, _unit(self.graph, dyad.angle))
        n, base, height, r = cross(1.0, u), R - A, dyad.height, dyad.lengths[0]
        y = dot(n, base.p) + height
        root_squared = r * r - y * y
        root = self.graph.sqrt(root_squared)
        x = root * sign
        # inverse: 1 / x = x / x^2, so that one division serves the root and its reciprocal; a = B - A
        inverse, a, s = x * self.graph.inverse(root_squared), u * x + n * y, x - dot(u, base.p)
        omega = (dot(n, base.d) + guide.omega * s) * inverse
        slip = -(omega * y) - (dot(u, base.d) - guide.omega * height)
        # component along n of the second derivative of s u + height n
        turning = guide.alpha * s - guide.omega_squared * height + guide.omega * slip * 2.0
        alpha = (dot(n, base.b) + turning + omega * omega * y) * inverse
        on_rod, on_slider = (pin.local for pin in dyad.middle)
        self._add_rod(dyad.first, a, omega, alpha, A, on_rod)
        B = self.bodies[dyad.first.link].point(on_rod)
        e = _product(guide.e, _unit(self.graph, dyad.turn))
        self.bodies[dyad.second.link] = Body(e, guide.omega, guide.alpha, on_slider, Place(A.p + a, B.d, B.b))
        self.openings.append((root, r))

    def _close_rpr(self, dyad: Dyad, sign: float) -> None:
        """Solve an RPR dyad: a guide (the first link) is pinned at C, and the block that slides on it is pinned at A.

        A has the coordinates x along the guide and `height` across it, to the left. Let u be the unit vector along the guide, n a
        quarter turn to its left, and omega the derivative of the guide's angle by q. Then, with complex numbers,

            A - C = (x + i height) u,    (A - C)' = (x' - omega height) u + omega x n

        The first derivative, along n and along u, gives omega and `slip` = x'; the second derivative along n gives alpha.
        `base` = A - C has the fields p, d and b: its value and its first and second derivative by q.
        """
        C, A = self.at(dyad.first.other), self.at(dyad.second.other)
        base, height = A - C, dyad.height
        D = dot(base.p, base.p)
        root_squared = D - height * height
        root = self.graph.sqrt(root_squared)
        x = root * sign
        inverse = x * self.graph.inverse(root_squared)  # 1 / x
        u = base.p * inverse if height == 0 else (base.p * x - cross(height, base.p)) * self.graph.inverse(D)
        n = cross(1.0, u)
        omega = dot(n, base.d) * inverse
        slip = dot(u, base.d) + omega * height
        alpha = (dot(n, base.b) + omega * omega * height - omega * slip * 2.0) * inverse
        e = _product(u, _unit(self.graph, -dyad.angle))
        self.bodies[dyad.first.link] = Body(e, omega, alpha, dyad.first.own.local, C)
        turned = _product(e, _unit(self.graph, dyad.turn))
        self.bodies[dyad.second.link] = Body(turned, omega, alpha, dyad.second.own.local, A)
        self.openings.append((root, 1.0))

    def acceleration(self) -> list[Node]:
        """Return q'' = (Q - h q'^2) / m, and the second time derivatives of the angles that are integrated together with q."""
        m, h, Q = list[Node](), list[Node](), list[Node]()  # the summands of each
        for k, link in enumerate(self.mechanism.links):
            terms_of_m, terms_of_h, momentum = _inertia(self.bodies[k], link.mass, link.inertia)
            m, h = [*m, *terms_of_m], [*h, *terms_of_h]
            Q.append(dot(_constant(self.graph, *self.mechanism.gravity), momentum))  # power of the weight at q' = 1
        for load in loads(self.mechanism.forces):
            if isinstance(load, Law):
                Q.append(self._power_of_law(load))
            else:
                force = _product(self.bodies[load.frame].e, _constant(self.graph, *load.value))
                Q.append(dot(force, self.at(load.point).d))
        total, square = self.graph.total, self.v * self.v
        a = (total(Q) - total(h) * square) / total(m)
        return [a, *(self.bodies[k].omega * a + self.bodies[k].alpha * square for k in self.integrated)]

    def _power_of_law(self, law: Law) -> Node:
        """Return the power of a force law at q' = 1, that is, its generalised force: strength times the rate of its coordinate.

        For a distance, `strength` returns the force divided by the distance, so it is multiplied by half the rate of the squared
        distance.
        """
        unit = state(law.coordinate, _Rates(self, self.one))
        rate = unit.half_square_rate if isinstance(unit, DistanceState) else unit.rate
        unit_rate = self.graph.node(rate)
        # not used here: once the graph has this product, the rate at q' = v is recognised as the same product
        self.graph.mul(unit_rate, self.v)
        return self.graph.node(strength(state(law.coordinate, _Rates(self, self.v)), law, self.graph)) * unit_rate

    def angle(self, link: int) -> Node:
        """Return a link's angle [rad], including whole turns: the angle of its root plus a constant."""
        root, turn = self.roots[link]
        if root == GROUND:
            return self.graph.constant(turn)
        # q[0] is the coordinate, q[1:] are the integrated angles; the angle of a root that is not integrated is the coordinate
        k = 1 + self.integrated.index(root) if root in self.integrated else 0
        return self.q[k] + turn

    def links(self) -> list[list[Node]]:
        """Return, with entries for each link, (x, y, cos, sin), (x', y', omega) and (x'', y'', alpha) of the centres of mass."""
        places, first, second = list[Node](), list[Node](), list[Node]()
        for k in range(len(self.mechanism.links)):
            body = self.bodies[k]
            centre = body.point(np.zeros(2))
            places += [*centre.p.parts, *body.e.parts]
            first += [*centre.d.parts, body.omega]
            second += [*centre.b.parts, body.alpha]
        return [places, first, second]


def _inertia(body: Body, mass: float, inertia: float) -> tuple[list[Node], list[Node], Vec]:
    """Return the summands of one link in m and in h of m q'' + h q'^2 = Q, and the link's momentum at q' = 1.

    The mass M of a link with two pins A and B is replaced by masses at the pins and a moment of inertia J, because neighbouring
    links share the pins. Let s = B - A, and let the centre of mass be at A + (k + i j) s in complex notation. Then

        m = M (1 - k) |A'|^2 + M k |B'|^2 + J omega^2 - 2 M j omega A' . s,    h = m' / 2
    """
    if body.pin is None:
        centre = body.point(np.zeros(2))
        m = [dot(centre.d, centre.d) * mass, body.omega_squared * inertia]
        h = [dot(centre.d, centre.b) * mass, body.omega_alpha * inertia]
        return m, h, centre.d * mass
    s = body.pin - body.at
    kappa = complex(*-body.at) / complex(*s)
    k, j = kappa.real, (0.0 if abs(kappa.imag) < AXIS else kappa.imag)
    A, B, J = body.place, body.point(body.pin), inertia + mass * float(s @ s) * (abs(kappa) ** 2 - k)
    m = [dot(A.d, A.d) * (mass * (1 - k)), dot(B.d, B.d) * (mass * k), body.omega_squared * J]
    h = [dot(A.d, A.b) * (mass * (1 - k)), dot(B.d, B.b) * (mass * k), body.omega_alpha * J]
    momentum = A.d * (mass * (1 - k)) + B.d * (mass * k)
    if j:  # the centre lies beside the line of the pins
        arm = body.arm(body.pin)
        aside = dot(A.d, arm)
        m.append(body.omega * aside * (-2 * mass * j))
        derivative = dot(A.b, arm) + dot(A.d, cross(body.omega, arm))  # of A' . s
        h.append((body.alpha * aside + body.omega * derivative) * (-mass * j))
        momentum = momentum - arm * (body.omega * (mass * j))  # (i j s)' = -j omega s
    return m, h, momentum


class _Rates(Placement):
    """Poses and velocities of the links at a rate q', as `mechanism/frames.py` needs them for the coordinates of force laws.

    Every point is the origin of a frame of its own, so that no arm from the centre of mass is needed.
    """

    def __init__(self, motion: _Motion, speed: Node):
        self.motion, self.speed, self.arithmetic = motion, speed, motion.graph

    def frame(self, link: int) -> Frame:
        """Return a frame that turns with a link and whose origin is at rest; only its directions are used."""
        return self._frame(link, self.motion.still, self.motion.still)

    def _frame(self, link: int, place: Vec, velocity: Vec) -> Frame:
        """Return a frame that turns with a link, and whose origin has a given position and velocity."""
        omega = self.motion.bodies[link].omega * self.speed
        return Frame(link, place, velocity, omega, self.motion.angle(link))

    def end(self, point: Point) -> End:
        """Return a point as the origin of a frame of its own."""
        place = self.motion.at(point)
        return End(self._frame(point.link, place.p, place.d * self.speed), self.motion.still)

    def vector(self, link: int, value: Array) -> Direction:
        return Direction(self.frame(link), _product(self.motion.bodies[link].e, _constant(self.motion.graph, *value)))
