"""Sums of turned vectors at one instant: their values, how they vary with the coordinates, and what is left of acceleration.

With e = exp(i theta) the vector l e that all terms of one key share changes by

    d(l e) = i l e dtheta + e dl,        (l e)'' = i l e theta'' + e l'' + (2 i l' theta' - l theta'^2) e

so that a velocity, a virtual displacement and the part of an acceleration that is linear in x'' are one formula, `variation`, and
the rest is `bias`. Values are arrays over states or symbols.
"""

from collections.abc import Callable, Mapping, Sequence

from gauss_bench.reference.taylor.arithmetic import NUMBERS, Arithmetic, Value, Vector, plus, product, quarter, scale_by, total
from gauss_bench.reference.taylor.solve import Long, columns
from gauss_bench.reference.taylor.vector_sums import NONE, Key, Sum

Vectors = Callable[[Key], Vector]


class Instant:
    """The turned vectors at coordinates x; each is worked out once, when first asked for."""

    def __init__(self, x: Sequence[Value], arithmetic: Arithmetic):
        self.x = x
        self.arithmetic = arithmetic
        self.known: dict[Key, Vector] = {(NONE, NONE): (1, 0)}

    def __call__(self, key: Key) -> Vector:
        """l e of a key."""
        if key not in self.known:
            angle, length = key
            if length != NONE:
                self.known[key] = scale_by(self.x[length], self((angle, NONE)))
            else:
                self.known[key] = (self.arithmetic.cos(self.x[angle]), self.arithmetic.sin(self.x[angle]))
        return self.known[key]

    def variation(self, dx: Mapping[int, Value]) -> Vectors:
        """d(l e) by key, for changes dx of the coordinates; coordinates left out stand still."""
        known: dict[Key, Vector] = {}

        def of(key: Key) -> Vector:
            if key not in known:
                angle, length = key
                turned = scale_by(dx.get(angle, 0), quarter(self(key)))
                known[key] = plus(turned, scale_by(dx.get(length, 0), self((angle, NONE))))
            return known[key]

        return of

    def bias(self, v: Mapping[int, Value]) -> Vectors:
        """The part of (l e)'' by key that does not depend on x'', for rates v of the coordinates."""
        known: dict[Key, Vector] = {}

        def of(key: Key) -> Vector:
            if key not in known:
                angle, length = key
                w = v.get(angle, 0)
                inward = scale_by(-(w * w), self(key))
                known[key] = plus(inward, scale_by(2 * (v.get(length, 0) * w), quarter(self((angle, NONE)))))
            return known[key]

        return of

    def combined(self, terms: Sum, of: Vectors) -> Vector:
        """sum_k c_k of(key_k)."""
        parts = [product((self.arithmetic.of(t.x), self.arithmetic.of(t.y)), of(t.key)) for t in terms]
        return total(p[0] for p in parts), total(p[1] for p in parts)

    def gradient(self, terms: Sum) -> dict[int, Vector]:
        """Derivative of a sum by every coordinate that moves it."""
        columns = {index for t in terms for index in t.key if index != NONE}
        return {j: self.combined(tuple(t for t in terms if j in t.key), self.variation({j: 1})) for j in sorted(columns)}


def at_states(x: Long) -> Instant:
    """The instant of states (k, n) in numbers."""
    return Instant(columns(x), NUMBERS)
