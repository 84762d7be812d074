"""Sums of turned vectors at one instant: their values, variations and accelerations.

Terms with the same key share the vector l e, e = exp(i theta), which changes by

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
    """The turned vectors at coordinates x, each of which is computed when it is first needed."""

    def __init__(self, x: Sequence[Value], arithmetic: Arithmetic):
        self.x = x
        self.arithmetic = arithmetic
        self.known: dict[Key, Vector] = {(NONE, NONE): (1, 0)}

    def __call__(self, key: Key) -> Vector:
        """Return the vector l e of a key."""
        if key not in self.known:
            angle, length = key
            if length != NONE:
                self.known[key] = scale_by(self.x[length], self((angle, NONE)))
            else:
                self.known[key] = (self.arithmetic.cos(self.x[angle]), self.arithmetic.sin(self.x[angle]))
        return self.known[key]

    def variation(self, dx: Mapping[int, Value]) -> Vectors:
        """Return d(l e) as a function of the key, for changes dx of the coordinates; missing entries are zero."""

        @cache
        def of(key: Key) -> Vector:
            angle, length = key
            turn = scale_by(dx.get(angle, 0), quarter(self(key)))
            return plus(turn, scale_by(dx.get(length, 0), self((angle, NONE))))

        return of

    def bias(self, v: Mapping[int, Value]) -> Vectors:
        """Return the part of (l e)'' that does not depend on x'', as a function of the key, for rates v of the coordinates."""

        @cache
        def of(key: Key) -> Vector:
            angle, length = key
            w = v.get(angle, 0)
            inward = scale_by(-(w * w), self(key))
            return plus(inward, scale_by(2 * (v.get(length, 0) * w), quarter(self((angle, NONE)))))

        return of

    def combine(self, terms: Sum, of: Vectors) -> Vector:
        """Return the sum of the terms c_k of(key_k)."""
        parts = [product((self.arithmetic.of(t.x), self.arithmetic.of(t.y)), of(t.key)) for t in terms]
        return total(p[0] for p in parts), total(p[1] for p in parts)

    def gradient(self, terms: Sum) -> dict[int, Vector]:
        """Return coordinate -> derivative of a sum, for every coordinate that moves it."""
        moving = {index for t in terms for index in t.key if index != NONE}
        return {j: self.combine(tuple(t for t in terms if j in t.key), self.variation({j: 1})) for j in sorted(moving)}


def at_states(x: Long) -> Instant:
    """Return the instant of states (k, n) in numbers."""
    return Instant(split_columns(x), NUMBERS)
