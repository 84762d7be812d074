"""A small linkage with pins and a slide; the first step of it compiles Newton's kernels."""

import numpy as np

from gauss_bench.mechanism.model import GROUND, Angle, Link, Measured, Mechanism, Point, Prismatic, Revolute


def sample_linkage() -> Mechanism:
    """Return a crank-slider at rest: a crank of 1 m, upright on the origin, and a rod of 2 m from its tip to the x axis."""
    height, width = 1.0, float(np.sqrt(3.0))
    zero = np.zeros(2)
    ground, block = Point(GROUND, zero, "ground.o"), Point(2, zero, "block.o")
    crank = [Point(0, np.array([x, 0.0]), "crank.end") for x in (-0.5, 0.5)]
    rod = [Point(1, np.array([x, 0.0]), "rod.end") for x in (-1.0, 1.0)]
    pins = (
        Revolute("o", "o", ground, crank[0]),
        Revolute("a", "a", crank[1], rod[0]),
        Revolute("b", "b", rod[1], block),
    )
    return Mechanism(
        name="sample",
        title="crank-slider",
        scenario="rest",
        scenarios=("rest",),
        source="",
        sha256="",
        digest="",
        duration=1.0,
        links=tuple(Link(name, 1.0, 0.1, zero, {}) for name in ("crank", "rod", "block")),
        ground_points={},
        joints=(*pins, Prismatic("slide", ground, block, 0.0, 0.0, 0.0)),
        knife_edges=(),
        forces=(),
        drivers=(),
        gravity=np.array([0.0, -9.81]),
        crank=0,
        observed_points=(),
        observed_links=(),
        measured=Measured("crank", Angle(GROUND, 0)),
        q0=np.array([0.0, 0.5, np.pi / 2, width / 2, height / 2, -np.pi / 6, width, 0.0, 0.0]),
        v0=np.zeros(9),
    )
