"""States of a linkage that follows its inputs, as loops and points both give them."""

from dataclasses import dataclass

from gauss_bench.terms import Array


@dataclass(frozen=True, eq=False)
class Motion:
    """States at k times.

    Attributes:
        q, v, a: (k, n) absolute positions, velocities, accelerations as in Mechanism; angles unwrapped, continuous from q0.
        iterations: (k,) corrections taken to reach each sample from the one before.
    """

    q: Array
    v: Array
    a: Array
    iterations: Array
