"""Stepping a second-order system q'' = acceleration(t, q, v), for any number of coordinates.

Steps of a given size are functions of `fixed_step`; integrators that choose their own steps are imported when they are first used.
"""

ADAPTIVE = {"dop853": "gauss_bench.integrate.adaptive:dop853"}
STABILIZATIONS = ("none", "baumgarte", "projection")  # ways to keep a trajectory on its constraints
BAUMGARTE_RATE = 20.0  # [1/s] alpha = beta: twice the decay of a 10 rad/s linkage, and stable under RK4 up to h = 0.1 s


class StepFailure(ArithmeticError):
    """The step size control could not continue."""
