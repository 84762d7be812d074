"""What is asked where native code cannot close a sample: the closure of the library, which halves its way as far as it must.

It knows a linkage by its numbers alone, so that open parameters are put into a mechanism first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gauss_bench.compiler.equations.links import Parameters
from gauss_bench.compiler.errors import KernelError
from gauss_bench.kinematics.errors import MotionError, SingularPosition
from gauss_bench.kinematics.inputs import Input
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.mechanism import forces
from gauss_bench.mechanism.model import AngleDriver, Driver, Joint, LengthDriver, Link, Mechanism, Point, Prismatic, Revolute
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.terms import Array


class Lost(ArithmeticError):
    """The inputs cannot be followed to a sample.

    Attributes:
        kind: "limit of motion", "singular position" or "not assembled".
        inputs: the last ones that were reached [rad, m].
    """

    def __init__(self, text: str, kind: str, inputs: Mapping[str, float]):
        self.kind, self.inputs = kind, inputs
        super().__init__(text)


@dataclass(frozen=True, eq=False)
class Step:
    """From a closed state q (n,) to inputs u with rates w and second rates b (K,), known variables as the loops count them."""

    q: Array
    u: Array
    w: Array
    b: Array


class Judge:
    """The library's closure for one linkage and the open numbers p."""

    def __init__(
        self, mechanism: Mechanism, inputs: Sequence[Input], phases: Array, parameters: Parameters, points: Sequence[Point]
    ):
        self.mechanism, self.inputs, self.phases, self.parameters, self.points = mechanism, inputs, phases, parameters, points

    def mechanism_with(self, p: Array) -> Mechanism:
        """The mechanism with the open numbers p (n_p,)."""
        return with_numbers(self.mechanism, dict(zip(self.parameters.names, p.tolist(), strict=True)))

    def step(self, step: Step, p: Array) -> Array:
        """The row of numbers of a sample.

        Raises:
            Lost: the library cannot get there either.
        """
        mechanism = replace(self.mechanism_with(p), q0=step.q)
        levels = zip(step.u + self.phases, step.w, step.b, strict=True)
        given = [replace(x, law=_held(*level)) for x, level in zip(self.inputs, levels, strict=True)]
        try:
            motion = loop_motion(mechanism, given, np.array([1.0]))
        except MotionError as error:
            kind = "singular position" if isinstance(error, SingularPosition) else "limit of motion"
            raise Lost(str(error).rpartition(": ")[2], kind, error.inputs) from error
        q, v, a = motion.q[0], motion.v[0], motion.a[0]
        return np.concatenate([q, v, a, *(_point(mechanism, point, q, v, a) for point in self.points)])


def _held(*levels: Any) -> MotionLaw:
    return MotionLaw("held", lambda t: levels)


def _point(mechanism: Mechanism, point: Point, q: Array, v: Array, a: Array) -> Array:
    """Position, velocity and acceleration (6,) of a point."""
    moved = _moved(mechanism, point)
    return np.concatenate([forces.position(q, moved), forces.velocity(q, v, moved), forces.acceleration(q, v, a, moved)])


def with_numbers(mechanism: Mechanism, numbers: Mapping[str, float]) -> Mechanism:
    """A mechanism with other dimensions: points and centres of mass of links, points of the ground, offsets of slides.

    Raises:
        KernelError: a number that is no dimension.
    """
    if not numbers:
        return mechanism
    tables = {"ground": {k: np.array(x, dtype=float) for k, x in mechanism.ground_points.items()}}
    tables |= {link.name: {k: np.array(x, dtype=float) for k, x in link.points.items()} for link in mechanism.links}
    centres = {link.name: np.array(link.com, dtype=float) for link in mechanism.links}
    offsets: dict[str, float] = {}
    for name, value in numbers.items():
        match name.split("."):
            case ["points", owner, point, axis]:
                tables[owner][point]["xy".index(axis)] = value
            case ["links", owner, "com", axis]:
                centres[owner]["xy".index(axis)] = value
            case ["joints", joint, "offset"]:
                offsets[joint] = value
            case _:
                raise KernelError(f"{name} is no dimension of {mechanism.name}: kinematics does not depend on it")
    links = tuple(_link(link, tables[link.name], centres[link.name]) for link in mechanism.links)
    made = replace(mechanism, links=links, ground_points=tables["ground"])
    joints = tuple(_joint(made, joint, offsets) for joint in mechanism.joints)
    return replace(made, joints=joints, drivers=tuple(_driver(made, driver, joints) for driver in mechanism.drivers))


def _link(link: Link, points: Mapping[str, Array], com: Array) -> Link:
    return replace(link, points=points, com=com)


def _moved(mechanism: Mechanism, point: Point) -> Point:
    """The point where the mechanism has it; one that no table names stays."""
    name = point.name.partition(".")[2]
    known = mechanism.ground_points if point.link < 0 else mechanism.links[point.link].points
    return mechanism.point(point.link, name) if name in known else point


def _joint(mechanism: Mechanism, joint: Joint, offsets: Mapping[str, float]) -> Joint:
    if isinstance(joint, Revolute):
        return replace(joint, a=_moved(mechanism, joint.a), b=_moved(mechanism, joint.b))
    guide, block = _moved(mechanism, joint.guide), _moved(mechanism, joint.block)
    return replace(joint, guide=guide, block=block, offset=offsets.get(joint.name, joint.offset))


def _driver(mechanism: Mechanism, driver: Driver, joints: Sequence[Joint]) -> Driver:
    if isinstance(driver, AngleDriver):
        return driver
    if isinstance(driver, LengthDriver):
        return replace(driver, a=_moved(mechanism, driver.a), b=_moved(mechanism, driver.b))
    slide = next(j for j in joints if isinstance(j, Prismatic) and j.name == driver.joint.name)
    return replace(driver, joint=slide)
