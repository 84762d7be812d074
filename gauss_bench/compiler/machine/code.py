"""The functions of a program that a time step with a given stabilisation needs, independent of the machine."""

from gauss_bench.compiler.elimination.program import Function, Program

__all__ = ["Code", "Program"]


class Code:
    """The functions of one program that a time step with one stabilisation needs.

    Attributes:
        acceleration: the acceleration that is integrated, with Baumgarte's terms under "baumgarte".
        angles: indices of the coordinates whose sines and cosines are needed by the acceleration and the corrections of the state.
    """

    def __init__(self, program: Program, stabilization: str):
        """Select the functions of a program.

        Raises:
            ValueError: Baumgarte's terms are needed, and the program was generated without them.
        """
        self.program, self.stabilization = program, stabilization
        acceleration = program.stabilized if stabilization == "baumgarte" else program.acceleration
        if acceleration is None:
            raise ValueError(f"{program.name} was generated without Baumgarte's terms")
        self.acceleration: Function = acceleration
        angles = acceleration.angles(1)  # argument 1 has the positions, argument 3 of a correction the positions to be corrected
        # states are projected in each step, or, if redundant rows are left out, after every `SETTLED` steps
        if stabilization == "projection" or program.dropped:
            position = program.position_correction
            angles |= position.angles(1) | position.angles(3) | program.nearest_velocity.angles(1)
        self.angles = tuple(sorted(angles))

    @property
    def projected(self) -> bool:
        """True if each step projects the state onto the constraints."""
        return self.stabilization == "projection"

    @property
    def settles(self) -> bool:
        """True if rows are redundant and no stabilisation acts: the state is then projected after every `SETTLED` steps."""
        return self.stabilization == "none" and bool(self.program.dropped)
