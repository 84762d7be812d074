"""Inputs of a linkage: prescribed angles of links, coordinates along slides, and lengths of active bars."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gauss_bench.mechanism.model import GROUND, Angle, AngleDriver, Coordinate, LengthDriver, Mechanism
from gauss_bench.mechanism.motion_laws import MotionLaw


@dataclass(frozen=True, eq=False)
class Input:
    """One prescribed coordinate: the angle of the link `link` [rad], or the coordinate of the slide or active bar `joint` [m]."""

    law: MotionLaw
    link: int | None = None
    joint: str | None = None

    def coordinate(self, mechanism: Mechanism) -> Coordinate:
        """Return the coordinate of a mechanism that this input prescribes."""
        if self.link is not None:
            return Angle(GROUND, self.link)
        along = {j.name: j.motion for j in mechanism.slides}
        return along[self.joint] if self.joint in along else active_bars(mechanism)[str(self.joint)].coordinate


def describe_inputs(inputs: Sequence[Input], values: Mapping[str, float]) -> str:
    """Return inputs in words, with the values [rad, m] that they have, by name in the same order."""
    units = ["m" if given.link is None else "rad" for given in inputs]
    return ", ".join(f"{name} = {x:.10g} {unit}" for (name, x), unit in zip(values.items(), units, strict=True))


def active_bars(mechanism: Mechanism) -> dict[str, LengthDriver]:
    """Return the drivers that prescribe the distance of two points, by name."""
    return {d.name: d for d in mechanism.drivers if isinstance(d, LengthDriver)}


def inputs_of(mechanism: Mechanism) -> tuple[Input, ...]:
    """Return the drivers of the mechanism's scenario as inputs."""
    return tuple(Input(d.law, link=d.link) if isinstance(d, AngleDriver) else Input(d.law, joint=d.name) for d in mechanism.drivers)
