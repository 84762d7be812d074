"""Integration of a second-order system q'' = acceleration(t, q, v) in any number of coordinates.

Methods with steps of a given size are in `fixed_step`. Methods that choose their own steps are imported when they are first used.
"""

ADAPTIVE = {"dop853": "gauss_bench.integrate.adaptive:dop853"}  # name -> function
STABILIZATIONS = ("none", "baumgarte", "projection")  # methods that keep a trajectory on its constraints
BAUMGARTE_RATE = 20.0  # [1/s] alpha = beta: gaps close twice as fast as a linkage of 10 rad/s moves; RK4 is stable up to h = 0.1 s


class StepFailure(ArithmeticError):
    """An integrator that chooses its own steps cannot continue."""
