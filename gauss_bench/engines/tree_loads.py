"""The loads of a linkage, sorted into three kinds, for engines whose coordinates are those of a joint tree.

Each kind of load is a class; y are the tree coordinates:

    Steady:      A constant generalised force on tree coordinates: a torque, a force along a slide with its reaction on the guide,
                 or the constant part of a force law.
    OnJoints:    A spring and damper on an angle or a slide displacement, which is a sum of tree coordinates L = row . y + constant.
    OtherLoad:   Every other load: a force at a point, or a force law on a distance or along an axis to which no slide is parallel.
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
from gauss_bench.trajectory import RunFailure, Status

ALIGNED = 1e-12  # [m] largest distance by which rounding moves a point off a line


@dataclass(frozen=True, eq=False)
class Steady:
    """The constant generalised force `value` times `force` (n,) on the tree coordinates.

    Attributes:
        names: names of the linkage's forces that this load replaces.
    """

    force: Array
    value: float = 1.0
    names: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class OnJoints:
    """The force k (rest - L) - c dL/dt on the sum of tree coordinates L = row . y + constant; row (n,) has entries 0, 1 and -1.

    Attributes:
        name: name of the force of the linkage.
    """

    row: Array
    constant: float
    k: float
    c: float
    rest: float
    name: str = ""


@dataclass(frozen=True, eq=False)
class OtherLoad:
    """A load of the force `name` in the linkage; the load cannot be written as a spring and damper on tree coordinates."""

    name: str
    load: PointForce | Law


TreeLoad = Steady | OnJoints | OtherLoad


def sort_loads(mechanism: Mechanism, tree: Tree) -> list[TreeLoad]:
    """Return the forces of a mechanism as loads `Steady`, `OnJoints` and `OtherLoad`.

    Torques, and forces that act only along slides of the tree, become constant forces on tree coordinates (motors). Each of the
    other forces becomes one load or several. Forces that vary with time or with the direction of motion are left out.
    """
    turns = turning(tree)
    steady = [f for f in mechanism.forces if not factor_of(f)]
    # a unit torque has the generalised force 1 on each hinge that turns only the link, -1 on each that turns only the reaction link
    motors = [Steady(turns.rows[f.link] - turns.rows[f.reaction], f.value, (f.name,)) for f in steady if isinstance(f, Torque)]
    motors += slide_motors([f for f in steady if isinstance(f, PointForce)], mechanism, tree, turns)
    motor_names = {name for motor in motors for name in motor.names}
    tree_loads: list[TreeLoad] = [*motors]
    for f in steady:
        if f.name not in motor_names:
            for load in f.to_loads():
                tree_loads += sort_load(f.name, load, mechanism, tree, turns)
    return tree_loads


def slide_motors(forces: Sequence[PointForce], mechanism: Mechanism, tree: Tree, turns: Turning) -> list[Steady]:
    """Return the forces that act only along slides of the tree, as constant forces on the slides' coordinates.

    Such a force acts on the link of a slide's branch, here called the block. If the parent, here called the guide, moves, another
    force in `forces` must be the reaction on the guide. All other forces are left out.
    """
    motors: list[Steady] = []
    done: set[str] = set()  # names of the forces that are already part of a motor
    slides = [b for b in tree.branches if b.kind == "prismatic"]
    for f in forces:
        for b in slides:
            if f.name in done or f.point.link != b.link:  # a force becomes one motor only
                continue
            value = along_slide(f, b, turns)
            reactions = [g.name for g in forces if g.name not in done and is_reaction(g, f, b, mechanism, turns)]
            if value is None or (b.parent != GROUND and not reactions):
                continue
            names = (f.name, *reactions[:1])  # one reaction balances the force; an equal second reaction remains a force of its own
            motors.append(Steady(np.eye(tree.n)[b.at], value, names))  # the unit vector of the slide's coordinate
            done.update(names)
    return motors


def along_slide(f: PointForce, b: Branch, turns: Turning) -> float | None:
    """Return the component [N] of a force along the slide of a branch.

    Return None if the force is zero, is not parallel to the slide, or has a direction that turns relative to the guide.
    """
    if not turns.together(f.frame, b.parent):
        return None
    force = rotate(f.value, turns.constants[f.frame] - turns.constants[b.parent])  # (2,) in the parent's frame
    across = b.axis[0] * force[1] - b.axis[1] * force[0]
    is_parallel = abs(across) <= PARALLEL * np.linalg.norm(force)
    return float(b.axis @ force) if force.any() and is_parallel else None


def is_reaction(g: PointForce, f: PointForce, b: Branch, mechanism: Mechanism, turns: Turning) -> bool:
    """Tell whether g is the reaction to f, a force along slide b on its block: an opposite force on the guide, on the same line."""
    if g.point.link != b.parent or not turns.together(g.frame, b.parent):
        return False
    # (2,) both forces in the guide's frame
    on_block, on_guide = (rotate(x.value, turns.constants[x.frame] - turns.constants[b.parent]) for x in (f, g))
    # distance [m] of the two lines of action across the slide, at any state the same
    offset = value(Along(g.point, f.point, float(np.arctan2(b.axis[1], b.axis[0])), across=True), mechanism.q0)
    return bool(np.abs(on_block + on_guide).max() <= PARALLEL * np.abs(f.value).max() and abs(offset) <= ALIGNED)


def refuse_load(load: TreeLoad, turns: Turning, library: str) -> str | None:
    """Return the reason why a library cannot express a load, or None if it can.

    The library has springs and dampers on single coordinates and between points, and forces at points.
    """
    match load:
        case Steady() | OtherLoad(load=Law(coordinate=Distance())):
            return None
        case OnJoints(row, name=name):
            return f"{library} has no spring or damper on a sum of coordinates ({name})" if np.count_nonzero(row) > 1 else None
        case OtherLoad(name, PointForce() as force):
            is_fixed = turns.together(force.frame, GROUND) or turns.together(force.frame, force.point.link)
            return None if is_fixed else f"{library} cannot turn the force {name} with a third link"
    return f"{library} has no spring or damper along an axis that is not a slide's ({load.name})"


def turn_force(force: PointForce, turns: Turning) -> tuple[bool, Array]:
    """Return whether the direction of a force is fixed in the world, and the force as a vector (2,) [N].

    The vector is given in the world's axes if the direction is fixed in the world, and otherwise in the frame of the link on which
    the force acts; `refuse_load` refuses forces that are fixed in a third link.
    """
    in_world = turns.together(force.frame, GROUND)
    fixed_in = GROUND if in_world else force.point.link
    return in_world, rotate(force.value, turns.constants[force.frame] - turns.constants[fixed_in])


def sort_load(name: str, load: Load, mechanism: Mechanism, tree: Tree, turns: Turning) -> list[TreeLoad]:
    """Return one load of the linkage's force `name` as loads of the three kinds `Steady`, `OnJoints` and `OtherLoad`.

    A force law on an angle, or along a slide of the tree, acts on a sum of tree coordinates. Every other load is an `OtherLoad`.

    Raises:
        RunFailure: the law acts on a sum of coordinates of the linkage, which engines of joint trees do not model.
    """
    if isinstance(load, PointForce):
        return [OtherLoad(name, load)]
    match load.coordinate:
        case Angle(a, b):
            return on_joints(name, turns.rows[b] - turns.rows[a], turns.constants[b] - turns.constants[a], load)
        case Along() as along if sliding := slide_coordinate(along, mechanism, tree):
            return on_joints(name, *sliding, load)
        case Along() | Distance():
            return [OtherLoad(name, load)]
        case Weighted():
            raise RunFailure(Status.SKIP, f"the adapter does not support a law on a sum of coordinates ({name})")
        case _:
            assert_never(load.coordinate)


def on_joints(name: str, row: Array, constant: float, law: Law) -> list[TreeLoad]:
    """Return the constant part (`Steady`) and the spring and damper (`OnJoints`) of a force law on L = row . y + constant."""
    loads: list[TreeLoad] = []
    if law.bias:
        loads.append(Steady(row, law.bias, (name,)))
    if law.k or law.c:
        loads.append(OnJoints(row, constant, law.k, law.c, law.rest, name))
    return loads


def slide_coordinate(along: Along, mechanism: Mechanism, tree: Tree) -> tuple[Array, float] | None:
    """Return row (n,) and constant such that the coordinate along an axis is row . y + constant, where y are the tree coordinates.

    Return None if the tree has no slide between the same two links as the axis, or if the slide is not parallel to the axis.
    """
    pair = {along.point.link, along.origin.link}
    branch = next((b for b in tree.branches if b.kind == "prismatic" and {b.link, b.parent} == pair), None)
    if branch is None:
        return None
    y, _ = tree.relative(mechanism.q0, mechanism.v0)
    sliding = np.eye(tree.n)[branch.at]
    q, v, _ = tree.absolute(y, sliding, np.zeros(tree.n))
    # while the slide moves at unit speed, the rates along and across the axis are cosine and sine of the angle between them
    cosine, sine = rate(along, q, v), rate(replace(along, across=not along.across), q, v)
    if abs(sine) > PARALLEL:
        return None
    sign = float(np.sign(cosine))
    return sign * sliding, float(value(along, q)) - sign * y[branch.at]
