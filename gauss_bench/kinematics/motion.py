"""The motion of a linkage that follows its inputs, computed either from loop equations or from point equations."""

from dataclasses import dataclass

from gauss_bench.terms import Array


@dataclass(frozen=True, eq=False)
class Motion:
    """The states at k times.

    Attributes:
        q, v, a: (k, n) absolute positions, velocities, accelerations as in Mechanism; angles are continuous from q0 on.
        iterations: (k,) iterations of the solver since the previous sample.
    """

    q: Array
    v: Array
    a: Array
    iterations: Array
