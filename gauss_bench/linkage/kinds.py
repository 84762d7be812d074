"""The kinds of forces and constraints that a file names by `type`: a new one is a file, its keys in `schema.py` and a line here."""

from collections.abc import Callable, Mapping
from typing import Any

from gauss_bench.mechanism.model import (
    AxisSpringDamper,
    CoulombFriction,
    Coupling,
    Force,
    JointDamping,
    KnifeEdge,
    Names,
    PointForce,
    RotationalSpringDamper,
    SpringDamper,
    Torque,
)

FORCES: Mapping[str, Callable[[str, Mapping[str, Any], Names], Force | CoulombFriction]] = {
    "torque": Torque.read,
    "force": PointForce.read,
    "spring_damper": SpringDamper.read,
    "axis_spring_damper": AxisSpringDamper.read,
    "rotational_spring_damper": RotationalSpringDamper.read,
    "joint_damping": JointDamping.read,
    "coulomb_friction": CoulombFriction.read,
}
CONSTRAINTS: Mapping[str, Callable[[str, Mapping[str, Any], Names], KnifeEdge | Coupling]] = {
    "knife_edge": KnifeEdge.read,
}
