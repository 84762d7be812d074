"""The numbers of a linkage by name, each a constant of the program or one of its inputs.

Links: links.LINK.mass, .inertia, .com.x, .com.y. Points, in the link's own frame: points.LINK.POINT.x, .y; LINK may be "ground".
Forces: forces.NAME.value, .value.x, .value.y, .k, .c, .rest. Slides: joints.NAME.offset. And gravity.x, .y.
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import Graph, Node
from gauss_bench.mechanism.model import (
    AxisSpringDamper,
    Force,
    JointDamping,
    Mechanism,
    PointForce,
    Prismatic,
    RotationalSpringDamper,
    SpringDamper,
    Torque,
)
from gauss_bench.terms import Array


def parameter_values(mechanism: Mechanism) -> dict[str, float]:
    """Name -> value of every number that can be left open."""
    out = {f"gravity.{axis}": float(x) for axis, x in zip("xy", mechanism.gravity, strict=True)}
    for link in mechanism.links:
        out |= {f"links.{link.name}.mass": float(link.mass), f"links.{link.name}.inertia": float(link.inertia)}
        out |= {f"links.{link.name}.com.{axis}": float(x) for axis, x in zip("xy", link.com, strict=True)}
    for owner, points in [("ground", mechanism.ground_points), *((link.name, link.points) for link in mechanism.links)]:
        for name, xy in points.items():
            out |= {f"points.{owner}.{name}.{axis}": float(x) for axis, x in zip("xy", xy, strict=True)}
    for force in mechanism.forces:
        out |= {f"forces.{force.name}.{key}": x for key, x in _force_values(force).items()}
    out |= {f"joints.{j.name}.offset": float(j.offset) for j in mechanism.joints if isinstance(j, Prismatic)}
    return out


def _force_values(force: Force) -> dict[str, float]:
    match force:
        case Torque():
            return {"value": float(force.value)}
        case PointForce():
            return {f"value.{axis}": float(x) for axis, x in zip("xy", force.value, strict=True)}
        case JointDamping():
            return {"c": float(force.c)}
        case SpringDamper() | AxisSpringDamper() | RotationalSpringDamper():
            return {"k": float(force.k), "c": float(force.c), "rest": float(force.rest)}


@dataclass(frozen=True, eq=False)
class Parameters:
    """Names left open, in the order of the input p, and their values in the file."""

    names: tuple[str, ...]
    all: dict[str, float]

    @property
    def values(self) -> Array:
        return np.array([self.all[name] for name in self.names])

    def node(self, graph: Graph, name: str) -> Node:
        """The number `name`: an entry of p, or a constant."""
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
