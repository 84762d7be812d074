"""How much the kernel suite does: the whole of it, or enough to see that it runs."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """Sizes of the measurements.

    Attributes:
        rounds: of an interleaved run.
        cap: [s] a run of a ladder of steps may take; the next halving would take twice as long.
        lead: [s] of a run that is timed when times to solution are compared; longer ones are cut and scaled.
        states: at which accelerations are compared.
        batch: trajectories stepped together.
        long: [s] of the run whose drift and energy are watched.
        chains: links of the pendulums.
        sizes: windows of the chains on which growth is measured.
    """

    rounds: int
    cap: float
    lead: float
    states: int
    batch: int
    long: float
    chains: tuple[int, ...]
    sizes: tuple[int, ...]


FULL = Effort(rounds=30, cap=2.0, lead=0.03, states=1000, batch=4096, long=100.0, chains=(2, 4, 8, 16), sizes=(1, 4, 16, 64, 256))
REDUCED = Effort(rounds=5, cap=0.05, lead=0.005, states=50, batch=64, long=2.0, chains=(2,), sizes=(1, 2))
