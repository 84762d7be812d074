"""Sums of turned vectors at one instant: their values, variations and accelerations.

A turned vector is l e, with the length l and the direction e = exp(i theta). Its key is (index of the coordinate theta, index of
the coordinate l); with NONE in the place of an index e is 1 or l is 1. The vector changes by

    d(l e) = i l e dtheta + e dl,        (l e)'' = i l e theta'' + e l'' + (2 i l' theta' - l theta'^2) e

Velocities, virtual displacements and the part of an acceleration that is linear in x'' have the same formula, `variation`. The rest
of the acceleration is `bias`. Values are arrays over states, or symbols.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache

from gauss_bench.reference.taylor.arithmetic import NUMBERS, Arithmetic, Value, Vector, plus, product, quarter, scale_by, total
from gauss_bench.reference.taylor.solve import Long, split_columns
from gauss_bench.reference.taylor.vector_sums import NONE, Key, Sum

Vectors = Callable[[Key], Vector]  # key -> vector


class Instant:
    """The turned vectors l e at coordinates x, each of which is computed when it is first needed.

    Attributes:
        x: values of all coordinates, arrays over states or symbols; arithmetic: functions of such values.
        known: key -> vector computed so far.
    """

    def __init__(self, x: Sequence[Value], arithmetic: Arithmetic):
        """Begin with the constant vector 1 alone."""
        self.x = x
        self.arithmetic = arithmetic
        self.known: dict[Key, Vector] = {(NONE, NONE): (1, 0)}

    def __call__(self, key: Key) -> Vector:
        """Return the vector l e for the key (index of the angle, index of the length)."""
        if key not in self.known:
            angle, length = key
            if length != NONE:
                self.known[key] = scale_by(self.x[length], self((angle, NONE)))
            else:
                self.known[key] = (self.arithmetic.cos(self.x[angle]), self.arithmetic.sin(self.x[angle]))
        return self.known[key]

    def variation(self, dx: Mapping[int, Value]) -> Vectors:
        """Return the function key -> d(l e), the change of the vector l e for changes dx (index -> change) of the coordinates.

        Coordinates that dx does not contain do not change.
        """

        @cache
        def change_of(key: Key) -> Vector:
            """Return i l e dtheta + e dl."""
            angle, length = key
            turn = scale_by(dx.get(angle, 0), quarter(self(key)))
            return plus(turn, scale_by(dx.get(length, 0), self((angle, NONE))))

        return change_of

    def bias(self, v: Mapping[int, Value]) -> Vectors:
        """Return the function key -> (l e)'' for x'' = 0, at the rates v (index -> rate) of the coordinates."""

        @cache
        def bias_of(key: Key) -> Vector:
            """Return the centripetal acceleration -l theta'^2 e plus Coriolis's, 2 i l' theta' e."""
            angle, length = key
            w = v.get(angle, 0)
            inward = scale_by(-(w * w), self(key))
            return plus(inward, scale_by(2 * (v.get(length, 0) * w), quarter(self((angle, NONE)))))

        return bias_of

    def combine(self, terms: Sum, vectors: Vectors | None = None) -> Vector:
        """Return sum_k c_k vectors(key_k), with the complex constants c_k of the terms.

        By default the vectors are l e themselves, so that this is the value of the sum; with those of `variation` or `bias` it is
        its change or the part of its acceleration that is independent of x''.
        """
        vector_of: Vectors = self if vectors is None else vectors
        parts = [product((self.arithmetic.of(t.x), self.arithmetic.of(t.y)), vector_of(t.key)) for t in terms]
        return total(p[0] for p in parts), total(p[1] for p in parts)

    def gradient(self, terms: Sum) -> dict[int, Vector]:
        """Return coordinate -> partial derivative of a sum, for every coordinate on which the sum depends."""
        moving = {index for t in terms for index in t.key if index != NONE}
        return {j: self.combine(tuple(t for t in terms if j in t.key), self.variation({j: 1})) for j in sorted(moving)}


def at_states(x: Long) -> Instant:
    """Return the turned vectors at k states x (k, n), as arrays of numbers instead of symbols."""
    return Instant(split_columns(x), NUMBERS)
