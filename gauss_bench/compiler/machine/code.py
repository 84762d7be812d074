"""The part of a program that is stepped under one stabilisation, for whatever machine."""

from dataclasses import dataclass

from gauss_bench.compiler.elimination.program import Function, Program

__all__ = ["Code", "Program", "read_code"]


@dataclass(frozen=True, eq=False)
class Code:
    """The functions of one program under one stabilisation ("none", "baumgarte" or "projection").

    Attributes:
        acceleration: with Baumgarte's terms where they are wanted.
        position: correction. velocity: the nearest.
        angles: coordinates whose sines and cosines are needed.
    """

    program: Program
    stabilization: str
    acceleration: Function
    position: Function
    velocity: Function
    angles: tuple[int, ...]

    @property
    def projected(self) -> bool:
        return self.stabilization == "projection"

    @property
    def settles(self) -> bool:
        """True if rows are redundant and nothing takes away what they are off: then now and then a step does."""
        return self.stabilization == "none" and bool(self.program.dropped)


def read_code(program: Program, stabilization: str) -> Code:
    """Read the part of a program that is stepped; its `stabilized` acceleration for Baumgarte."""
    acceleration = program.stabilized if stabilization == "baumgarte" else program.acceleration
    if acceleration is None:
        raise ValueError(f"{program.name} was generated without Baumgarte's terms")
    position, velocity = program.position_correction, program.nearest_velocity
    angles = acceleration.angles(1)
    if stabilization == "projection" or program.dropped:
        angles |= position.angles(1) | position.angles(3) | velocity.angles(1)
    return Code(program, stabilization, acceleration, position, velocity, tuple(sorted(angles)))
