"""The links of a linkage as expressions: their numbers, and positions and velocities of link-fixed points.

Each number of a linkage is a constant of the program or, where it is left open, one of its inputs:
links.LINK.mass, .inertia, .com.x, .com.y; points.LINK.POINT.x, .y, in the link's own frame, where LINK may be "ground";
forces.NAME.value, .value.x, .value.y, .k, .c, .rest; joints.NAME.offset of slides; gravity.x, .y.

There is one sine and cosine per link at most. An arm r = exp(i theta) s has constant components s in the link's frame. Slides tie
the angles of links together, theta_b = theta_g + turn, and the constant part is folded into s:

    r = exp(i theta_b) s = exp(i theta_g) (exp(i turn) s)

Tied links share one sine and cosine, and one that is tied to the ground has none: on the constraints nothing changes, and the
motion never leaves these rows, which are linear. Sines and cosines are those of coordinates as they stand, so that a loop over
steps can carry them on. (Frames turned until most points lie on an axis were tried: they save one operation in a hundred.)
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from gauss_bench.compiler.equations.laws import law_of_time
from gauss_bench.compiler.equations.sampling import SPEED, scales
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node
from gauss_bench.mechanism.equations import Given, Motion
from gauss_bench.mechanism.frames import Direction, End, Frame, unit
from gauss_bench.mechanism.model import GROUND, Force, Load, Mechanism, Point, PointForce, Torque, factor_of, loads
from gauss_bench.mechanism.motion_laws import Factor, MotionLaw
from gauss_bench.mechanism.spaces import Vec, angle_slot, rotate_vec, slots
from gauss_bench.terms import Array


def parameter_values(mechanism: Mechanism) -> dict[str, float]:
    """Name -> value of every number that can be left open.

    Raises:
        KernelError: a force of a kind that does not say what it comes to.
    """
    try:
        loads(f for f in mechanism.forces if not factor_of(f))
    except TypeError as error:
        raise KernelError(str(error)) from None
    out = {f"gravity.{axis}": float(x) for axis, x in zip("xy", mechanism.gravity, strict=True)}
    for link in mechanism.links:
        out |= {f"links.{link.name}.mass": float(link.mass), f"links.{link.name}.inertia": float(link.inertia)}
        out |= {f"links.{link.name}.com.{axis}": float(x) for axis, x in zip("xy", link.com, strict=True)}
    for owner, points in [("ground", mechanism.ground_points), *((link.name, link.points) for link in mechanism.links)]:
        for name, xy in points.items():
            out |= {f"points.{owner}.{name}.{axis}": float(x) for axis, x in zip("xy", xy, strict=True)}
    for force in mechanism.forces:
        for key, x in force_numbers(force).items():
            axes = [""] if np.ndim(x) == 0 else [".x", ".y"]
            numbers = np.ravel(x).tolist()
            out |= {f"forces.{force.name}.{key}{axis}": float(number) for axis, number in zip(axes, numbers, strict=True)}
    out |= {f"joints.{j.name}.offset": float(j.offset) for j in mechanism.slides}
    return out


def force_numbers(force: Force) -> dict[str, float | Array]:
    """Return the fields of a force that are numbers or vectors (2,), except angles of axes, which are geometry."""
    return {x.name: getattr(force, x.name) for x in fields(force) if x.type in (float, Array) and x.name != "angle"}


def with_parameters(mechanism: Mechanism, numbers: Mapping[str, Any]) -> Mechanism:
    """The mechanism with other numbers, by the names of `parameter_values`; arrays (k,) are those of as many linkages."""
    if not numbers:
        return mechanism
    many, known = 0.0 * next(iter(numbers.values())), parameter_values(mechanism)

    def at(name: str, old: Any) -> Any:
        """The number or pair of this name."""
        if np.ndim(old) == 0:
            return numbers.get(name, old + many)
        return np.stack([at(f"{name}.{axis}", x) for axis, x in zip("xy", old, strict=True)])

    ground = {name: at(f"points.ground.{name}", xy) for name, xy in mechanism.ground_points.items()}
    links = tuple(
        replace(
            link,
            points={name: at(f"points.{link.name}.{name}", xy) for name, xy in link.points.items()},
            **{key: at(f"links.{link.name}.{key}", getattr(link, key)) for key in ("mass", "inertia", "com")},
        )
        for link in mechanism.links
    )

    def change(x: Any) -> Any:
        """Replace named numbers and points in a value, and recursively in everything that contains such values."""
        if isinstance(x, tuple):
            return tuple(map(change, x))
        if isinstance(x, Point):
            own, centre = (ground, 0.0) if x.link == GROUND else (links[x.link].points, links[x.link].com)
            name = x.name.partition(".")[2]
            return replace(x, local=own[name] - centre) if name in own else x
        if not is_dataclass(x) or isinstance(x, (type, MotionLaw, Factor)):
            return x
        changes = {}
        for key, old in ((f.name, getattr(x, f.name)) for f in fields(x)):
            label = getattr(x, "name", "")
            candidates = (f"forces.{label}.{key}", f"joints.{label}.{key}")
            names = [name for name in candidates if name in known or f"{name}.x" in known]
            changes[key] = at(names[0], old) if names else change(old)
        return replace(x, **changes)

    parts = ("joints", "forces", "drivers", "observed_points", "measured")
    changed = {part: change(getattr(mechanism, part)) for part in parts}
    return replace(mechanism, links=links, ground_points=ground, gravity=at("gravity", mechanism.gravity), **changed)


@dataclass(frozen=True, eq=False)
class Parameters:
    """Names left open, in the order of the input p, and their values in the file."""

    names: tuple[str, ...]
    all: dict[str, float]

    @property
    def values(self) -> Array:
        return np.array([self.all[name] for name in self.names])

    def node(self, graph: ExpressionGraph, name: str) -> Node:
        """Return the number `name` as a node: an entry of p, or a constant."""
        value = self.all[name]
        if name not in self.names:
            return graph.constant(value)
        return graph.input("p", self.names.index(name), np.full(graph.samples, value), abs(value) or 1.0)


def open_parameters(mechanism: Mechanism, names: tuple[str, ...]) -> Parameters:
    """The parameters of a mechanism with some left open.

    Raises:
        KernelError: a name the mechanism does not have in this scenario, or one named twice.
    """
    values = parameter_values(mechanism)
    unknown = [name for name in names if name not in values]
    if unknown:
        raise KernelError(f"{mechanism.name} has no number named {', '.join(unknown)}; there are {', '.join(values)}")
    if len(set(names)) < len(names):
        raise KernelError(f"a parameter is named twice in {', '.join(names)}")
    return Parameters(names, values)


AXIS = 1e-14  # of a vector's length: less is rounding of a right angle


@dataclass(frozen=True)
class Tie:
    """The angle of a link: that of `root` plus `offset` [rad]; the ground's angle is 0."""

    root: int
    offset: float


def tie_angles(mechanism: Mechanism) -> tuple[Tie, ...]:
    """Return for every link the `Tie` of its angle through slides."""
    ties = list(free_angles(mechanism))
    for slide in mechanism.slides:
        guide, block = (Tie(GROUND, 0.0) if p.link == GROUND else ties[p.link] for p in (slide.guide, slide.block))
        old, new, offset = block.root, guide.root, guide.offset + slide.turn - block.offset
        if old == GROUND:
            old, new, offset = new, old, -offset
        if old != new:
            ties = [Tie(new, x.offset + offset) if x.root == old else x for x in ties]
    return tuple(ties)


def free_angles(mechanism: Mechanism) -> tuple[Tie, ...]:
    """Return ties in which every link keeps its own angle: expressions are then valid off the constraints too."""
    return tuple(Tie(i, 0.0) for i in range(len(mechanism.links)))


@dataclass(frozen=True, eq=False)
class State:
    """Names of the inputs that hold time, positions and velocities, and their values at the samples (k,), (k, n), (k, n)."""

    t: str
    q: str
    v: str
    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray


class Links(Given):
    """The links of one mechanism at one state; `exact` where expressions must hold off the constraints too.

    They are a `Given` of `mechanism/equations.py`, whose real numbers are nodes.
    """

    def __init__(self, graph: ExpressionGraph, mechanism: Mechanism, parameters: Parameters, state: State, exact: bool = False):
        self.graph, self.mechanism, self.parameters, self.state, self.exact = graph, mechanism, parameters, state, exact
        self.ties = free_angles(mechanism) if exact else tie_angles(mechanism)
        self.scale = [float(x) for x in scales(mechanism)]
        self.arithmetic, self.zero = graph, graph.constant(0.0)
        self._frames: dict[int, Frame] = {}
        self._ends: dict[tuple[object, ...], End] = {}

    @property
    def time(self) -> Node:
        return self.graph.input(self.state.t, 0, self.state.times, 1.0)

    def coordinate(self, k: int) -> Node:
        return self.graph.input(self.state.q, k, self.state.positions[:, k], self.scale[k])

    def rate(self, k: int) -> Node:
        return self.graph.input(self.state.v, k, self.state.velocities[:, k], SPEED * self.scale[k])

    def omega(self, link: int) -> Node:
        """Angular speed; a tied link has that of its root."""
        root = GROUND if link == GROUND else self.ties[link].root
        return self.zero if root == GROUND else self.rate(angle_slot(root))

    def frame(self, link: int) -> Frame:
        if link not in self._frames:
            if link == GROUND:
                still = Vec(self.zero, self.zero)
                self._frames[link] = Frame(link, still, still, self.zero, self.zero, True)
            else:
                own = range(self.mechanism.n)[slots(link)]
                *place, angle = map(self.coordinate, own)
                self._frames[link] = Frame(link, Vec(*place), Vec(*map(self.rate, own[:-1])), self.omega(link), angle)
        return self._frames[link]

    def number(self, name: str) -> Node:
        return self.parameters.node(self.graph, name)

    def held(self, joint: str, place: int, value: float) -> Node:
        name = f"joints.{joint}.offset"
        return self.number(name) if place == 0 and name in self.parameters.all else self.graph.constant(float(value))

    def law(self, law: MotionLaw) -> Motion:
        try:
            return law_of_time(law, self.graph, self.time)
        except ValueError as error:
            raise KernelError(str(error)) from None

    def local(self, point: Point) -> Vec:
        """The point in its link's frame, from the centre of mass."""
        owner, name = point.name.split(".", 1)
        if f"points.{owner}.{name}.x" not in self.parameters.all:
            return self.fixed(*point.local)
        place = Vec(*(self.number(f"points.{owner}.{name}.{axis}") for axis in "xy"))
        return place if point.link == GROUND else place - Vec(*(self.number(f"links.{owner}.com.{axis}") for axis in "xy"))

    def fixed(self, x: float, y: float) -> Vec:
        return Vec(self.graph.constant(float(x)), self.graph.constant(float(y)))

    def rotate(self, link: int, s: Vec) -> Vec:
        """A link-fixed vector in world axes."""
        tie = Tie(GROUND, 0.0) if link == GROUND else self.ties[link]
        s = rotate_vec(self._unit(tie.offset), s)
        if tie.root == GROUND:
            return s
        theta = self.coordinate(angle_slot(tie.root))
        return rotate_vec(Vec(self.graph.cos(theta), self.graph.sin(theta)), s)

    def _unit(self, theta: float, across: bool = False) -> Vec:
        return self.fixed(*(0.0 if abs(x) < AXIS else x for x in unit(theta, across)))

    def direction(self, link: int, angle: float, across: bool = False) -> Direction:
        return Direction(self.frame(link), self.rotate(link, self._unit(angle, across)))

    def vector(self, link: int, value: Vec) -> Direction:
        return Direction(self.frame(link), self.rotate(link, value))

    def end(self, point: Point) -> End:
        key = (point.name, *point.local.tolist())
        if key not in self._ends:
            self._ends[key] = End(self.frame(point.link), self.rotate(point.link, self.local(point)))
        return self._ends[key]

    def loads(self) -> tuple[Load, ...]:
        """Lower the steady forces to loads whose numbers are nodes."""
        return loads([replace(force, **self._numbers(force)) for force in self.mechanism.forces if not factor_of(force)])

    def varying(self) -> list[tuple[Torque | PointForce, Factor]]:
        """The forces that vary, as steady ones whose numbers are nodes, and what they are multiplied by."""
        forces = [(f, f.factor) for f in self.mechanism.forces if isinstance(f, (Torque, PointForce)) and f.factor]
        return [(replace(force, factor=None, **self._numbers(force)), factor) for force, factor in forces]

    def _numbers(self, force: Force) -> dict[str, Any]:
        name = f"forces.{force.name}"
        return {
            key: self.number(f"{name}.{key}")
            if np.ndim(x) == 0
            else Vec(self.number(f"{name}.{key}.x"), self.number(f"{name}.{key}.y"))
            for key, x in force_numbers(force).items()
        }
