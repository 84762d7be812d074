"""The loads of a linkage for engines in coordinates of a joint tree, sorted by what they act on.

Steady      constant generalised force on tree coordinates: a torque, or a force along a slide with its reaction on the guide
OnJoints    spring and damper on an angle or a slide, which is a sum of tree coordinates L = e . y + const
OtherLoad   a force at a point, or a law on a distance or along an axis that is no slide's: the engine translates it or refuses it
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import assert_never

import numpy as np

from gauss_bench.engines.shared import PARALLEL
from gauss_bench.engines.tree import Branch, Tree, Turning, turning
from gauss_bench.mechanism.coordinates import rate, rotate, value
from gauss_bench.mechanism.model import (
    GROUND,
    Along,
    Angle,
    Distance,
    Law,
    Load,
    Mechanism,
    PointForce,
    Torque,
    Weighted,
    factor_of,
)
from gauss_bench.terms import Array

ALIGNED = 1e-12  # [m] by which rounding may move two points off one line


@dataclass(frozen=True, eq=False)
class Steady:
    """The constant generalised force `value` times `force` (n,) on the tree coordinates.

    Attributes:
        names: forces of the linkage that make it: a force along a slide and its reaction are two.
    """

    force: Array
    value: float = 1.0
    names: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class OnJoints:
    """Force k (rest - L) - c dL/dt on L = row . y + constant, where row (n,) has entries of 0 and +-1.

    Attributes:
        name: force of the linkage that makes it.
    """

    row: Array
    constant: float
    k: float
    c: float
    rest: float
    name: str = ""


@dataclass(frozen=True, eq=False)
class OtherLoad:
    """A load of the force `name` that is no law on tree coordinates."""

    name: str
    load: PointForce | Law


TreeLoad = Steady | OnJoints | OtherLoad


def sort_loads(mechanism: Mechanism, tree: Tree) -> list[TreeLoad]:
    """Return all forces that do not vary with time, as loads on a tree."""
    turns = turning(tree)
    steady = [f for f in mechanism.forces if not factor_of(f)]
    motors = [Steady(turns.rows[f.link] - turns.rows[f.reaction], f.value, (f.name,)) for f in steady if isinstance(f, Torque)]
    motors += slide_motors([f for f in steady if isinstance(f, PointForce)], mechanism, tree, turns)
    done = {name for motor in motors for name in motor.names}
    others = [(f.name, load) for f in steady if f.name not in done for load in f.to_loads()]
    return [*motors, *(x for name, load in others for x in sort_load(name, load, mechanism, tree, turns))]


def slide_motors(forces: Sequence[PointForce], mechanism: Mechanism, tree: Tree, turns: Turning) -> list[Steady]:
    """Return the forces that act along a slide of the tree alone: on the block, and the opposite one on a guide that moves."""
    motors: list[Steady] = []
    done: set[str] = set()
    slides = [b for b in tree.branches if b.kind == "prismatic"]
    for f in forces:
        for b in (b for b in slides if f.name not in done and f.point.link == b.link):
            value = along_slide(f, b, turns)
            if value is None:
                continue
            reactions = [g.name for g in forces if g.name not in done and is_reaction(g, f, b, mechanism, turns)]
            if b.parent != GROUND and not reactions:
                continue
            names = (f.name, *reactions[:1])
            sliding = np.zeros(tree.n)
            sliding[b.at] = 1.0
            motors.append(Steady(sliding, value, names))
            done.update(names)
    return motors


def along_slide(f: PointForce, b: Branch, turns: Turning) -> float | None:
    """Return a force's component along the axis of a slide; None if it is zero or has another direction."""
    if not turns.together(f.frame, b.parent):
        return None
    force = rotate(f.value, turns.constants[f.frame] - turns.constants[b.parent])
    across = b.axis[0] * force[1] - b.axis[1] * force[0]
    return float(b.axis @ force) if force.any() and abs(across) <= PARALLEL * np.linalg.norm(force) else None


def is_reaction(g: PointForce, f: PointForce, b: Branch, mechanism: Mechanism, turns: Turning) -> bool:
    """Tell whether g on the guide of a slide is opposite to f on its block, on the same line: else they also turn the links."""
    if g.point.link != b.parent or not turns.together(g.frame, b.parent):
        return False
    forces = (rotate(x.value, turns.constants[x.frame] - turns.constants[b.parent]) for x in (f, g))
    offset = value(Along(g.point, f.point, float(np.arctan2(b.axis[1], b.axis[0])), across=True), mechanism.q0)
    return bool(np.abs(sum(forces)).max() <= PARALLEL * np.abs(f.value).max() and abs(offset) <= ALIGNED)


def sort_load(name: str, load: Load, mechanism: Mechanism, tree: Tree, turns: Turning) -> list[TreeLoad]:
    """Return one load of the force `name` as loads on a tree."""
    match load:
        case PointForce():
            return [OtherLoad(name, load)]
        case Law():
            pass
        case _:
            assert_never(load)
    match load.coordinate:
        case Angle(a, b):
            return on_joints(name, turns.rows[b] - turns.rows[a], turns.constants[b] - turns.constants[a], load)
        case Along():
            sliding = slide_coordinate(load.coordinate, mechanism, tree)
            return [OtherLoad(name, load)] if sliding is None else on_joints(name, *sliding, load)
        case Distance():
            return [OtherLoad(name, load)]
        case Weighted():
            raise TypeError(f"force {name}: a law on a sum of coordinates is not given to engines of joint trees here")
        case _:
            assert_never(load.coordinate)


def on_joints(name: str, row: Array, constant: float, law: Law) -> list[TreeLoad]:
    """Return the loads of a law on L = row . y + constant; the constant part of the law is a generalised force."""
    found: list[TreeLoad] = []
    if law.bias:
        found.append(Steady(row, law.bias, (name,)))
    if law.k or law.c:
        found.append(OnJoints(row, constant, law.k, law.c, law.rest, name))
    return found


def slide_coordinate(along: Along, mechanism: Mechanism, tree: Tree) -> tuple[Array, float] | None:
    """Return the row and constant that express a coordinate along an axis by that of a slide between the same two links.

    None if there is no such slide in the tree, or its axis is not parallel to this one.
    """
    pair = {along.point.link, along.origin.link}
    branch = next((b for b in tree.branches if b.kind == "prismatic" and {b.link, b.parent} == pair), None)
    if branch is None:
        return None
    y, _ = tree.relative(mechanism.q0, mechanism.v0)
    sliding = np.zeros(tree.n)
    sliding[branch.at] = 1.0
    q, v, _ = tree.absolute(y, sliding, np.zeros(tree.n))
    # as the slide moves at unit speed, the rates along and across the axis are cosine and sine of the angle between both
    cosine, sine = rate(along, q, v), rate(replace(along, across=not along.across), q, v)
    if abs(sine) > PARALLEL:
        return None
    sign = float(np.sign(cosine))
    return sign * sliding, float(value(along, q)) - sign * y[branch.at]
