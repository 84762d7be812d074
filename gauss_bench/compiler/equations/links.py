"""The links of a linkage as expressions: their numbers, and positions and velocities of link-fixed points.

Each number of a linkage is a constant of the program or, if the caller names it as an open parameter, an input that is set at run
time. The names are links.LINK.mass, .inertia, .com.x, .com.y; points.LINK.POINT.x, .y, in the link's own frame, where LINK may be
"ground"; forces.NAME.value, .value.x, .value.y, .k, .c, .rest; joints.NAME.offset of slides; gravity.x, .y.

For each link, the sine and cosine of its angle theta are computed at most once. An arm r, the vector in world axes from the centre
of mass of a link to one of its points, has constant components s in the link's frame: as complex numbers, r = exp(i theta) s. A
slide keeps the angle between its two links, block b and guide g, constant: theta_b = theta_g + turn. A vector s on the block is
therefore rotated by the constant angle `turn` when code is generated:

    r = exp(i theta_b) s = exp(i theta_g) (exp(i turn) s)

So links that slides connect share one sine and cosine, and a link that slides connect with the ground needs none. Using theta_g +
turn instead of theta_b changes nothing where the two are equal, and motions never violate this constraint because it is linear. The
argument of a sine is always a coordinate itself, so that a loop over steps can update the sine by a rotation.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from gauss_bench.compiler.equations.laws import law_of_time
from gauss_bench.compiler.equations.sampling import SPEED, scales
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node
from gauss_bench.mechanism.equations import ConstraintPlacement
from gauss_bench.mechanism.frames import Direction, End, unit
from gauss_bench.mechanism.model import GROUND, Force, Link, Load, Mechanism, Point, PointForce, Torque, factor_of, loads
from gauss_bench.mechanism.motion_laws import Factor, Motion, MotionLaw
from gauss_bench.mechanism.spaces import Vec, angle_slot, rotate_vec, slots
from gauss_bench.terms import Array
from gauss_bench.trajectory import States


def named_numbers(mechanism: Mechanism) -> dict[str, float | Array]:
    """Return name -> number or vector (2,), for every number of the linkage that can be a parameter of a program."""
    numbers: dict[str, float | Array] = {"gravity": mechanism.gravity}
    for link in mechanism.links:
        numbers |= {f"links.{link.name}.{key}": getattr(link, key) for key in ("mass", "inertia", "com")}
    points_of = [("ground", mechanism.ground_points), *((link.name, link.points) for link in mechanism.links)]
    for owner, points in points_of:
        numbers |= {f"points.{owner}.{name}": xy for name, xy in points.items()}
    for force in mechanism.forces:
        numbers |= {f"forces.{force.name}.{key}": x for key, x in force_numbers(force).items()}
    return numbers | {f"joints.{j.name}.{key}": getattr(j, key) for j in mechanism.joints for key in j.numbers}


def parameter_values(mechanism: Mechanism) -> dict[str, float]:
    """Return name -> value of every number that can be a parameter of a program; a vector counts as two numbers, .x and .y."""
    return split_vectors(named_numbers(mechanism))


def split_vectors(numbers: Mapping[str, Any]) -> dict[str, float]:
    """Return name -> number for numbers and vectors (2,); a vector NAME gives the two numbers NAME.x and NAME.y."""
    values: dict[str, float] = {}
    for name, number in numbers.items():
        labels = [f"{name}.x", f"{name}.y"] if np.ndim(number) else [name]
        values |= dict(zip(labels, np.ravel(number).astype(float).tolist(), strict=True))
    return values


def force_numbers(force: Force) -> dict[str, float | Array]:
    """Return name -> value of a force's fields that are numbers or vectors (2,), except angles of axes, which are geometry."""
    return {x.name: getattr(force, x.name) for x in fields(force) if x.type in (float, Array) and x.name != "angle"}


def with_parameters(mechanism: Mechanism, numbers: Mapping[str, Any]) -> Mechanism:
    """Return the mechanism with some of its numbers replaced; arrays (k,) of numbers describe k linkages at once.

    `numbers` maps names such as "links.crank.mass" (see `parameter_values`) to new values.
    """
    return _Replacement(mechanism, numbers).mechanism() if numbers else mechanism


class _Replacement:
    """Replaces numbers of a mechanism by the new values in `numbers`.

    Attributes:
        zeros: 0 or zeros (k,), added to a number that is not replaced, to give it the shape of the new ones.
        ground: name -> new position of the points of the ground.
        links: the links with new numbers.
    """

    def __init__(self, mechanism: Mechanism, numbers: Mapping[str, Any]):
        """Replace the numbers of points and links; the method `mechanism` replaces all other numbers."""
        self.old, self.numbers, self.named = mechanism, numbers, named_numbers(mechanism)
        self.zeros = 0.0 * next(iter(numbers.values()))
        self.ground = self._points("ground", mechanism.ground_points)
        self.links = tuple(self._link(x) for x in mechanism.links)

    def mechanism(self) -> Mechanism:
        """Return the mechanism with the new numbers."""
        keys = ("joints", "couplings", "forces", "drivers", "observed_points", "measured")
        changed = {key: self._change(getattr(self.old, key)) for key in keys}
        gravity = self._find("gravity", self.old.gravity)
        return replace(self.old, links=self.links, ground_points=self.ground, gravity=gravity, **changed)

    def _find(self, name: str, old: Any) -> Any:
        """Return the new value of the number or vector (2, ...) `name`; a component without a new value keeps its old value."""
        if np.ndim(old) == 0:
            return self.numbers.get(name, old + self.zeros)
        return np.stack([self._find(f"{name}.{axis}", x) for axis, x in zip("xy", old, strict=True)])

    def _points(self, owner: str, points: Mapping[str, Array]) -> dict[str, Array]:
        """Return name -> new position for the points of a link or of the ground."""
        return {name: self._find(f"points.{owner}.{name}", xy) for name, xy in points.items()}

    def _link(self, link: Link) -> Link:
        """Return a link with its new masses and points."""
        masses = {key: self._find(f"links.{link.name}.{key}", getattr(link, key)) for key in ("mass", "inertia", "com")}
        return replace(link, points=self._points(link.name, link.points), **masses)

    def _change(self, x: Any) -> Any:
        """Return a copy of a component of the mechanism, such as a joint, force or point, with its new numbers.

        Motion laws and factors of forces have no named numbers, and are returned as they are.
        """
        if isinstance(x, tuple):
            return tuple(map(self._change, x))
        if isinstance(x, Point):
            # named points are given from the origin of the link's frame, `local` from the link's centre of mass
            points, centre = (self.ground, 0.0) if x.link == GROUND else (self.links[x.link].points, self.links[x.link].com)
            name = x.name.partition(".")[2]
            return replace(x, local=points[name] - centre) if name in points else x
        if not is_dataclass(x) or isinstance(x, (type, MotionLaw, Factor)):
            return x
        changes = {}
        for field in fields(x):
            old, label = getattr(x, field.name), f"{getattr(x, 'name', '')}.{field.name}"
            names = [name for name in (f"forces.{label}", f"joints.{label}") if name in self.named]
            changes[field.name] = self._find(names[0], old) if names else self._change(old)
        return replace(x, **changes)


class Parameters:
    """The numbers of a mechanism, of which some are parameters: inputs of the program instead of constants.

    Attributes:
        names: the parameters in the order of the input p (n_p,).
        all: name -> value in the file, for all numbers.
        values: (n_p,) values of the parameters in the file.
    """

    def __init__(self, mechanism: Mechanism, opened: tuple[str, ...], lines: Mapping[str, float] | None = None):
        """Set up the numbers of a mechanism; those that are not `opened` are constants.

        The `lines` (name -> value) of `mechanism/lines.py`, which are not numbers of the file, are parameters too.

        Raises:
            KernelError: the mechanism has no number of one of these names in this scenario, or a name is given twice.
        """
        numbers = parameter_values(mechanism)
        unknown = [name for name in opened if name not in numbers]
        if unknown:
            raise KernelError(f"{mechanism.name} has no number named {', '.join(unknown)}; there are {', '.join(numbers)}")
        if len(set(opened)) < len(opened):
            raise KernelError(f"a parameter is named twice in {', '.join(opened)}")
        self.names, self.all = (*opened, *(lines or {})), numbers | dict(lines or {})
        self.values = np.array([self.all[name] for name in self.names])


AXIS = 1e-14  # relative to a vector's length: a smaller component is the rounding error of a right angle


@dataclass(frozen=True)
class Tie:
    """The angle of a link, as the angle of the link `root` plus the constant `offset` [rad]; the ground's angle is 0."""

    root: int
    offset: float


def tie_angles(mechanism: Mechanism) -> tuple[Tie, ...]:
    """Return for every link its root, a link to which slides connect it, and the constant difference of the two angles.

    The root is the ground if slides connect the link with the ground. A link without slides is its own root.
    """
    ties = list(free_angles(mechanism))
    for angle, turn in mechanism.held_angles:
        guide, block = (Tie(GROUND, 0.0) if link == GROUND else ties[link] for link in (angle.a, angle.b))
        # angle of the block = angle of the guide + turn, and therefore angle of the old root = angle of the new root + offset
        old, new, offset = block.root, guide.root, guide.offset + turn - block.offset
        if old == GROUND:  # the ground remains a root
            old, new, offset = new, old, -offset
        if old != new:
            ties = [Tie(new, x.offset + offset) if x.root == old else x for x in ties]
    return tuple(ties)


def free_angles(mechanism: Mechanism) -> tuple[Tie, ...]:
    """Return a `Tie` of every link to itself: expressions are then valid also where the constraints of slides are violated."""
    return tuple(Tie(i, 0.0) for i in range(len(mechanism.links)))


class Links(ConstraintPlacement):
    """The links of one mechanism at one state, with nodes in place of numbers, in the form that `mechanism/equations.py` needs.

    Attributes:
        states: sampled states: the values of the graph's inputs for time, positions and velocities.
        exact: whether expressions must be valid also where constraints are violated, so that no angle is replaced by that of
            another link.
        suffix: text appended to the names t, q and v of these inputs.
    """

    suffix = ""

    def __init__(self, graph: ExpressionGraph, mechanism: Mechanism, parameters: Parameters, states: States, exact: bool = False):
        """Set up the links; nodes are made when a method first needs them."""
        self.graph, self.mechanism, self.parameters, self.states, self.exact = graph, mechanism, parameters, states, exact
        self.ties = free_angles(mechanism) if exact else tie_angles(mechanism)
        self.scale = [float(x) for x in scales(mechanism)]
        self.arithmetic, self.zero = graph, graph.constant(0.0)
        # joint and index of a held coordinate -> name of the number at which it is held
        self._held = {(x.name, k): f"joints.{x.name}.{key}" for x in mechanism.joints for k, key in enumerate(x.numbers)}

    @property
    def time(self) -> Node:
        """The time t [s], an input of the graph."""
        return self.graph.input(f"t{self.suffix}", 0, self.states.t, 1.0)

    def coordinate(self, k: int) -> Node:
        """Return coordinate k as a node, an input of the graph."""
        return self.graph.input(f"q{self.suffix}", k, self.states.q[:, k], self.scale[k])

    def rate(self, k: int) -> Node:
        """Return the rate of coordinate k as a node, an input of the graph."""
        return self.graph.input(f"v{self.suffix}", k, self.states.v[:, k], SPEED * self.scale[k])

    def omega(self, link: int) -> Node:
        """Return the angular speed of a link: the speed of its root, the link to which slides tie its angle."""
        root = GROUND if link == GROUND else self.ties[link].root
        return self.zero if root == GROUND else self.rate(angle_slot(root))

    def body(self, body: int) -> tuple[list[Node], list[Node]]:
        """Return x, y and angle of a link, and their rates; the last rate is the angular speed of the link's root."""
        indices = range(self.mechanism.n)[slots(body)]  # of the link's x, y and angle
        return [*map(self.coordinate, indices)], [*map(self.rate, indices[:-1]), self.omega(body)]

    def number(self, name: str) -> Node:
        """Return the linkage's number `name` as a node: a constant, or an input if the number is a parameter."""
        value, names = self.parameters.all[name], self.parameters.names
        if name not in names:
            return self.graph.constant(value)
        # the last argument is a typical size: at random points, the graph changes the value by a fraction of it
        return self.graph.input("p", names.index(name), np.full(self.graph.samples, value), abs(value) or 1.0)

    def held(self, joint: str, index: int, value: float) -> Node:
        """Return the constant value at which a joint holds coordinate `index`; a slide's offset may be a parameter."""
        name = self._held.get((joint, index))
        return self.number(name) if name else self.graph.constant(float(value))

    def law(self, law: MotionLaw) -> Motion:
        """Return value, first and second time derivative of a law as expressions of time.

        Raises:
            KernelError: a law of an unknown kind.
        """
        try:
            return law_of_time(law, self.graph, self.time)
        except ValueError as error:
            raise KernelError(str(error)) from None

    def quantity(self, name: str) -> Any:
        """Return the number `name` as a node, or the vector `name` as a `Vec` of nodes."""
        if name in self.parameters.all:
            return self.number(name)
        return Vec(self.number(f"{name}.x"), self.number(f"{name}.y"))

    def local(self, point: Point) -> Vec:
        """Return the vector from the centre of mass of a point's link to the point, in the link's frame."""
        if f"points.{point.name}.x" not in self.parameters.all:  # no named coordinates: for example the world's origin
            return self.constant_vector(*point.local)
        # named coordinates are given from the origin of the link's frame, and not from its centre of mass
        owner = point.name.split(".", 1)[0]
        place: Vec = self.quantity(f"points.{point.name}")
        return place if point.link == GROUND else place - self.quantity(f"links.{owner}.com")

    def constant_vector(self, x: float, y: float) -> Vec:
        """Return the vector (x, y) of two constants as a vector of nodes."""
        return Vec(self.graph.constant(float(x)), self.graph.constant(float(y)))

    def rotate(self, link: int, s: Vec) -> Vec:
        """Convert a vector s that is fixed in a link from the link's axes to world axes."""
        tie = Tie(GROUND, 0.0) if link == GROUND else self.ties[link]  # the link's angle is that of its root plus tie.offset
        s = rotate_vec(self._unit(tie.offset), s)
        if tie.root == GROUND:
            return s
        theta = self.coordinate(angle_slot(tie.root))
        return rotate_vec(Vec(self.graph.cos(theta), self.graph.sin(theta)), s)

    def _unit(self, theta: float, across: bool = False) -> Vec:
        """Return the constant unit vector at an angle [rad]; with `across`, the vector a quarter turn further."""
        return self.constant_vector(*(0.0 if abs(x) < AXIS else x for x in unit(theta, across)))

    def direction(self, link: int, angle: float, across: bool = False) -> Direction:
        """Return, in world axes, the unit vector at an angle [rad] in a link's frame; with `across`, a quarter turn further."""
        return Direction(self.frame(link), self.rotate(link, self._unit(angle, across)))

    def vector(self, link: int, value: Vec | Array) -> Direction:
        """Convert a vector that is fixed in a link from the link's axes to world axes; return it with the link's frame.

        `value` is a `Vec` of nodes, or an array of nodes and numbers that a load has computed from those of its force.
        """
        local = value if isinstance(value, Vec) else Vec(*map(self.graph.node, value))
        return Direction(self.frame(link), self.rotate(link, local))

    def end(self, point: Point) -> End:
        """Return the frame of a point's link, and the arm from its centre of mass to the point in world axes."""
        return End(self.frame(point.link), self.rotate(point.link, self.local(point)))

    def loads(self) -> tuple[Load, ...]:
        """Convert the steady forces to loads (laws on coordinates, forces at points) whose numbers are nodes of the graph."""
        return loads([replace(force, **self._numbers(force)) for force in self.mechanism.forces if not factor_of(force)])

    def varying(self) -> list[tuple[Torque | PointForce, Factor]]:
        """Return, for every varying force, the steady force with nodes for its numbers, and the factor that multiplies it."""
        return [(replace(force, factor=None, **self._numbers(force)), factor) for force, factor in self.mechanism.factors]

    def _numbers(self, force: Force) -> dict[str, Any]:
        """Return field name -> node or `Vec` of nodes, for the fields of a force that are numbers or vectors."""
        return {key: self.quantity(f"forces.{force.name}.{key}") for key in force_numbers(force)}
