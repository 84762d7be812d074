"""What drives a linkage: prescribed angles of links and prescribed coordinates along slides."""

from dataclasses import dataclass

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.motion_laws import MotionLaw


@dataclass(frozen=True, eq=False)
class Input:
    """One prescribed coordinate: the angle of a link [rad], or the coordinate along a slide [m] where `joint` is given."""

    law: MotionLaw
    link: int | None = None
    joint: str | None = None


def inputs_of(mechanism: Mechanism) -> tuple[Input, ...]:
    """The driver of the mechanism's scenario as an input; none where it has no driver."""
    if mechanism.driver is None:
        return ()
    return (Input(mechanism.driver.law, link=mechanism.driver.link),)
