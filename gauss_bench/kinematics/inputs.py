"""What drives a linkage: prescribed angles of links, coordinates along slides, and lengths of active bars."""

from dataclasses import dataclass

from gauss_bench.mechanism.model import AngleDriver, Mechanism
from gauss_bench.mechanism.motion_laws import MotionLaw


@dataclass(frozen=True, eq=False)
class Input:
    """One prescribed coordinate: the angle of a link [rad], or by name the place along a slide or the length of a bar [m]."""

    law: MotionLaw
    link: int | None = None
    joint: str | None = None


def inputs_of(mechanism: Mechanism) -> tuple[Input, ...]:
    """The drivers of the mechanism's scenario as inputs."""
    return tuple(Input(d.law, link=d.link) if isinstance(d, AngleDriver) else Input(d.law, joint=d.name) for d in mechanism.drivers)
