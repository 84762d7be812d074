"""Sums of planar vectors l exp(i theta) at one instant: their values, first-order changes and accelerations.

A vector is the complex number l e, with the length l and the unit vector e = exp(i theta); theta and l are coordinates. The key of
a vector is the pair (index of its theta, index of its l) among the coordinates. NONE in place of the first index means e = 1, and
NONE in place of the second index means l = 1. The change of a vector for small changes of the coordinates, and its second time
derivative, are

    d(l e)  = i l e dtheta + e dl
    (l e)'' = i l e theta'' + e l'' + (2 i l' theta' - l theta'^2) e

The method `variation` evaluates the first formula. It gives virtual displacements, velocities, and that part of an acceleration
which is linear in the accelerations x'' of the coordinates. The method `bias` gives the part of an acceleration that does not
depend on x''. The value of a coordinate is an array over states, or a symbol.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache

from gauss_bench.reference.taylor.arithmetic import NUMBERS, Arithmetic, Value, Vector, plus, product, quarter, scale_by, total
from gauss_bench.reference.taylor.solve import Long, split_columns
from gauss_bench.reference.taylor.vector_sums import NONE, Key, Sum

Vectors = Callable[[Key], Vector]  # key -> vector


class Instant:
    """The vectors l e (length times unit vector) at coordinates x; each vector is computed when it is first needed.

    Attributes:
        x: values of all coordinates, arrays over states or symbols.
        arithmetic: cos, sin and square root of such values.
        known: key -> vector that was computed before.
    """

    def __init__(self, x: Sequence[Value], arithmetic: Arithmetic):
        """Store the coordinates, and the vector of the key (NONE, NONE), which is the constant 1."""
        self.x = x
        self.arithmetic = arithmetic
        self.known: dict[Key, Vector] = {(NONE, NONE): (1, 0)}

    def __call__(self, key: Key) -> Vector:
        """Return the vector l e for the key (index of the angle coordinate, index of the length coordinate), as (x, y)."""
        if key not in self.known:
            angle, length = key
            if length != NONE:
                self.known[key] = scale_by(self.x[length], self((angle, NONE)))
            else:
                self.known[key] = (self.arithmetic.cos(self.x[angle]), self.arithmetic.sin(self.x[angle]))
        return self.known[key]

    def variation(self, dx: Mapping[int, Value]) -> Vectors:
        """Return the function key -> change d(l e) of the vector l e if the coordinates change by dx.

        A key is the pair (index of the angle, index of the length l). dx is a mapping from the index of a coordinate to its change;
        coordinates without an entry in dx do not change.
        """

        @cache
        def change_of(key: Key) -> Vector:
            """Return the differential i l e dtheta + e dl of the vector l e, e = exp(i theta); `quarter` multiplies by i."""
            angle, length = key
            turn = scale_by(dx.get(angle, 0), quarter(self(key)))
            return plus(turn, scale_by(dx.get(length, 0), self((angle, NONE))))

        return change_of

    def bias(self, v: Mapping[int, Value]) -> Vectors:
        """Return the function key -> second time derivative (l e)'' of the vector l e if x'' = 0.

        A key is the pair (index of the angle, index of the length l). v is a mapping from the index of a coordinate to its
        velocity; coordinates without an entry in v are at rest.
        """

        @cache
        def bias_of(key: Key) -> Vector:
            """Return centripetal plus Coriolis acceleration, -l theta'^2 e + 2 i l' theta' e, of the vector l e, e = exp(i theta).

            `quarter` multiplies by i, which turns a vector by 90 degrees.
            """
            angle, length = key
            w = v.get(angle, 0)
            inward = scale_by(-(w * w), self(key))
            return plus(inward, scale_by(2 * (v.get(length, 0) * w), quarter(self((angle, NONE)))))

        return bias_of

    def combine(self, terms: Sum, vectors: Vectors | None = None) -> Vector:
        """Return sum_k c_k vectors(key_k), with the complex constants c_k and the keys key_k of the terms.

        By default `vectors` gives the vectors l e (length times unit vector), and the result is the value of the sum. If `vectors`
        is a result of `variation`, `combine` returns the change of the sum. If `vectors` is a result of `bias`, `combine` returns
        the part of the sum's second time derivative that does not depend on the accelerations x'' of the coordinates.
        """
        vector_of: Vectors = self if vectors is None else vectors
        parts = [product((self.arithmetic.of(t.x), self.arithmetic.of(t.y)), vector_of(t.key)) for t in terms]
        return total(p[0] for p in parts), total(p[1] for p in parts)

    def gradient(self, terms: Sum) -> dict[int, Vector]:
        """Return coordinate -> partial derivative of a sum of vectors l e, for every coordinate on which the sum depends."""
        moving = {index for t in terms for index in t.key if index != NONE}
        return {j: self.combine(tuple(t for t in terms if j in t.key), self.variation({j: 1})) for j in sorted(moving)}


def at_states(x: Long) -> Instant:
    """Return the vectors l e at k states, given the coordinates x (k, n), as arrays of numbers instead of symbols."""
    return Instant(split_columns(x), NUMBERS)
