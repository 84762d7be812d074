"""The loops of a linkage as expressions of its loop variables, and the states of its links that follow from them.

A loop l is closed where the vectors of its ways add up to nothing. Links that slides join share one angle, phi_r of their root r;
with E_r = exp(i phi_r), what loop l collects in the frame of r is one vector R_lr, to which slides add s u, and

    A_l = sum_r W_lr,   W_lr = E_r R_lr                        dA_l = sum_r i W_lr dphi_r + sum_s V_ls ds,   V_ls = +-E_r u
    A_l'' = J x'' + bias,   bias_l = sum_r -phi_r'^2 W_lr + sum_s 2 i phi_r' s' V_ls

Links follow by the tree of joints from the frame: an arm w of a link has the velocity i phi' E w + s' E u and the acceleration
(i phi'' - phi'^2) E w + 2 i phi' s' E u + s'' E u.
Source: Wang et al., Automated modeling for kinematic analysis of planar linkages based on link units, Trans. CSAM 41(2), 2010,
eqs. (1)-(15); the same equations as in kinematics/loop_equations.py, there in numbers.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gauss_bench.compiler.equations.links import Parameters
from gauss_bench.compiler.equations.sampling import typical_length
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node, Vector
from gauss_bench.kinematics.link_units import Element
from gauss_bench.kinematics.loop_equations import LoopEquations
from gauss_bench.mechanism.model import GROUND, Mechanism, Point, Revolute
from gauss_bench.terms import Array

AXIS = 1e-14  # of a unit vector: less is rounding of a right angle


@dataclass(frozen=True, eq=False)
class Moving:
    """A vector of the plane with its first and second rate."""

    at: Vector
    rate: Vector
    second: Vector

    def __add__(self, other: "Moving") -> "Moving":
        return Moving(self.at + other.at, self.rate + other.rate, self.second + other.second)

    def __sub__(self, other: "Moving") -> "Moving":
        return Moving(self.at - other.at, self.rate - other.rate, self.second - other.second)


@dataclass(frozen=True, eq=False)
class LoopVectors:
    """The vectors of one loop, by column of x: those that turn, those that slides add, and what is fixed in the frame.

    `sliding` holds V and the column of the angle it turns with, or None; `square` is the sum of the squared lengths of the others.
    """

    fixed: Vector
    turning: dict[int, Vector]
    sliding: dict[int, list[tuple[Vector, int | None]]]
    square: Node

    def residual(self) -> Vector:
        """A."""
        graph, vectors = self.fixed.x.graph, [self.fixed, *self.turning.values()]
        return Vector(graph.total([w.x for w in vectors]), graph.total([w.y for w in vectors]))

    def columns(self) -> dict[int, Vector]:
        """J and B by column of x."""
        columns = {k: w.turned() for k, w in self.turning.items()}
        for k, parts in self.sliding.items():
            columns[k] = parts[0][0] if len(parts) == 1 else parts[0][0] + parts[1][0]
        return columns

    def bias(self, rates: Sequence[Node]) -> Vector:
        """The part of A'' beyond J x''."""
        terms = [w * -(rates[k] * rates[k]) for k, w in self.turning.items()]
        for k, parts in self.sliding.items():
            terms += [v.turned(rates[angle] * rates[k] * 2.0) for v, angle in parts if angle is not None]
        graph = self.fixed.x.graph
        return Vector(graph.total([w.x for w in terms]), graph.total([w.y for w in terms]))


class LoopExpressions:
    """A linkage in its loop variables x, the unknown ones first: input "x", and the known ones: input "u".

    `samples` are states (k, TU + TK) at which the expressions are valued.
    """

    def __init__(self, graph: ExpressionGraph, equations: LoopEquations, parameters: Parameters, samples: Array):
        self.graph, self.equations, self.parameters = graph, equations, parameters
        mechanism, unknown = equations.mechanism, len(equations.unknown)
        sizes = np.where(equations.is_angle, 1.0, typical_length(mechanism))
        self.x = [
            graph.input(*(("x", k) if k < unknown else ("u", k - unknown)), samples[:, k], float(sizes[k]))
            for k in range(len(equations.variables))
        ]
        self.locals = _local_vectors(self, mechanism)
        self.units: dict[int, Vector] = {}

    def fixed(self, z: complex) -> Vector:
        return Vector(self.graph.constant(z.real), self.graph.constant(z.imag))

    def number(self, name: str) -> Node:
        return self.parameters.node(self.graph, name)

    def local(self, point: Point) -> Vector:
        """The point in its link's frame, from the centre of mass; of the ground where it is."""
        owner, name = point.name.split(".", 1)
        if f"points.{owner}.{name}.x" not in self.parameters.all:
            return self.fixed(complex(*point.local))
        at = Vector(*(self.number(f"points.{owner}.{name}.{axis}") for axis in "xy"))
        return at if point.link == GROUND else at - Vector(*(self.number(f"links.{owner}.com.{axis}") for axis in "xy"))

    def angle_column(self, link: int) -> int | None:
        """Column of the angle a link turns with, or None where it cannot turn."""
        root = self.equations.roots[link]
        return None if root == GROUND else self.equations.column[root]

    def in_root(self, link: int, w: Vector) -> Vector:
        """A vector of a link's frame in that of the link it takes its angle from."""
        turn = np.exp(1j * float(self.equations.phase[link]))
        return w * self.fixed(complex(*(0.0 if abs(x) < AXIS else float(x) for x in (turn.real, turn.imag))))

    def turned(self, column: int | None, w: Vector) -> Vector:
        """A vector of a root's frame in world axes."""
        if column is None:
            return w
        if column not in self.units:
            theta = self.x[column]
            self.units[column] = Vector(self.graph.cos(theta), self.graph.sin(theta))
        return w * self.units[column]

    @cached_property
    def loops(self) -> list[LoopVectors]:
        """All loops."""
        return [self._loop(l) for l in range(len(self.equations.ways))]

    def _loop(self, l: int) -> LoopVectors:
        collected: dict[int | None, Vector] = {None: self.fixed(0j)}
        sliding: dict[int, list[tuple[Vector, int | None]]] = {}
        for way in (placed.way for placed in self.equations.ways[l]):
            column = self.angle_column(way.link)
            w = self.locals[way.link, way.leave.pair] - self.locals[way.link, way.enter.pair]
            for sign, element in way.moving:
                k = self.equations.column[element.slide]
                w = w + self.fixed(sign * element.along) * self.x[k]
                along = self.turned(column, self.in_root(way.link, self.fixed(sign * element.along)))
                sliding.setdefault(k, []).append((along, column))
            w = self.in_root(way.link, w)
            collected[column] = collected[column] + w if column in collected else w
        fixed = collected.pop(None)
        turning = {k: w for k, w in collected.items() if k is not None}
        square = self.graph.total(w.dot(w) for w in (fixed, *turning.values()))  # first, so that the rotated ones are known by it
        return LoopVectors(fixed, {k: self.turned(k, w) for k, w in turning.items()}, sliding, square)

    def arm(self, link: int, w: Vector, element: Element | None, rates: Sequence[Node], seconds: Sequence[Node]) -> Moving:
        """The arm w of a link's frame, with what a slide at its end adds, in world axes."""
        column, still = self.angle_column(link), self.fixed(0j)
        slide = element.slide if element is not None else ""
        if slide:
            k, along = self.equations.column[slide], self.fixed(element.along if element is not None else 0j)
            w = w + along * self.x[k]
        at = self.turned(column, self.in_root(link, w))
        moving = Moving(at, still, still)
        if column is not None:
            omega, alpha = rates[column], seconds[column]
            moving = Moving(at, at.turned(omega), at.turned(alpha) - at * (omega * omega))
        if not slide:
            return moving
        u = self.turned(column, self.in_root(link, along))
        rate, second = u * rates[k], u * seconds[k]
        if column is not None:
            second = second + u.turned(rates[column] * rates[k] * 2.0)
        return Moving(moving.at, moving.rate + rate, moving.second + second)

    def centres(self, rates: Sequence[Node], seconds: Sequence[Node]) -> dict[int, Moving]:
        """Centre of mass of every link, the frame's origin included, for rates and second rates of x."""
        still = self.fixed(0j)
        at = {GROUND: Moving(still, still, still)}
        for branch in self.equations.graph.tree:
            ends = [
                self.arm(link, self.locals[link, branch.pair.name], branch.pair.element(link), rates, seconds)
                for link in (branch.parent, branch.link)
            ]
            at[branch.link] = at[branch.parent] + ends[0] - ends[1]
        return at

    def link_angle(self, link: int, values: Sequence[Node], phase: bool = False) -> Node:
        """Angle of a link where `values` are x (then with its constant part), or its rate where they are rates."""
        column = self.angle_column(link)
        angle = self.graph.constant(0.0) if column is None else values[column]
        return angle + float(self.equations.phase[link]) if phase else angle


def _local_vectors(loops: LoopExpressions, mechanism: Mechanism) -> dict[tuple[int, str], Vector]:
    """(link, name of the pair) -> where the pair's element lies in the link's frame, slides at s = 0."""
    vectors: dict[tuple[int, str], Vector] = {}
    for joint in mechanism.joints:
        if isinstance(joint, Revolute):
            vectors |= {(p.link, joint.name): loops.local(p) for p in (joint.a, joint.b)}
        else:
            along = loops.fixed(complex(np.cos(joint.angle), np.sin(joint.angle)))
            aside = along.turned(loops.number(f"joints.{joint.name}.offset"))
            vectors |= {(joint.guide.link, joint.name): loops.local(joint.guide) + aside}
            vectors |= {(joint.block.link, joint.name): loops.local(joint.block)}
    for k, bar in enumerate(loops.equations.bars, start=len(mechanism.links)):
        for p in (bar.a, bar.b):
            name = f"{bar.name} at {p.name}"
            vectors |= {(p.link, name): loops.local(p), (k, name): loops.fixed(0j)}
    return vectors
