"""The motion of a linkage that follows its inputs, the common result of loop closure and point equations."""

from dataclasses import dataclass

from gauss_bench.terms import Array


@dataclass(frozen=True, eq=False)
class Motion:
    """States at k times.

    Attributes:
        q, v, a: (k, n) absolute positions, velocities, accelerations as in Mechanism; angles are unwrapped, continuous from q0.
        iterations: (k,) corrections of the solver on the way from the sample before.
    """

    q: Array
    v: Array
    a: Array
    iterations: Array
