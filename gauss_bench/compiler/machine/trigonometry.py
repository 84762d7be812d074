"""Sine and cosine without branches: from the angle, or from sine and cosine of a neighbouring angle.

From the angle x: the nearest multiple k pi/2 is subtracted in three parts, and two short polynomials S and C give sine and cosine
of the remainder r. The two lowest bits of k tell which of sin r and cos r is the sine of x, and with which sign.

    k = round(2 x / pi),   r = ((x - k P1) - k P2) - k P3,   P1 + P2 + P3 = pi/2
    sin r = r + r z S(z),   cos r = 1 - z/2 + z^2 C(z),   z = r^2

P1 and P2 have 33 bits, so that k P1 and k P2 are exact while k < 2^20. To round 2 x / pi to the integer k, 1.5 * 2^52 is added and
then subtracted: the lowest bits of the sum hold k. No compiler may remove this addition and subtraction.

From a neighbouring angle: with d small, sin d = d + d z P(z) and 1 - cos d = z Q(z), z = d^2, and

    sin(x + d) = sin x + (cos x sin d - sin x (1 - cos d)),   cos(x + d) = cos x - (sin x sin d + cos x (1 - cos d))

The polynomials P and Q interpolate the series of sin and cos at Chebyshev nodes. They are made for |d| up to a largest rotation
[rad], called the reach, and have as few terms as keep the error below an eighth of a rounding unit.
Source: Cody and Waite, Software Manual for the Elementary Functions (1980), chapter 8.
"""

from fractions import Fraction
from functools import cache
from math import cos, factorial, pi

import numpy as np
from numpy.polynomial import polynomial as polynomials

from gauss_bench.compiler.machine.graph import Graph, Pair

LARGEST = 2.0**20  # [rad] largest angle: k is then below 2^20
TWO_OVER_PI = 0.6366197723675814
HALF_PI = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)  # P1, P2, P3
MAGIC = 1.5 * 2.0**52  # its last bit has the value 1, so that a number added to it is rounded to an integer
# coefficients of S and C, for |r| <= pi/4
SINE = (-0.16666666666666666, 0.008333333333330946, -0.0001984126983675497, 2.755731610068303e-06, -2.5051131455427946e-08,
        1.591810123027412e-10)  # fmt: skip
COSINE = (0.041666666666666664, -0.0013888888888887395, 2.4801587298763433e-05, -2.7557317270560326e-07, 2.0876146024689747e-09,
          -1.1382614868556325e-11)  # fmt: skip
TOLERANCE = 2.0**-56  # an eighth of the rounding 2^-53 of a number near 1
SERIES_TERMS = 8  # number of terms of the power series; P and Q have fewer coefficients


def polynomial(g: Graph, coefficients: tuple[float, ...], z: int) -> int:
    """Return the value of the polynomial of z with the given coefficients, the lowest degree first, by Estrin's scheme.

    Terms are added in pairs, so that the chain of operations is as long as the logarithm of the degree.
    """
    level = [g.const(c) for c in coefficients]
    while len(level) > 1:  # each round halves the degree of the polynomial and squares its argument
        odd = level[-1:] if len(level) % 2 else []
        level = [g.fma(high, z, low) for low, high in zip(level[::2], level[1::2], strict=False)] + odd
        z = g.mul(z, z)
    return level[0]


def sincos(g: Graph, x: int) -> Pair:
    """Write sine and cosine of a value x [rad] into the graph, and return them; they are valid for |x| <= LARGEST."""
    # adding 1.5 * 2^52 rounds 2 x / pi to the integer k, which is in the low bits of the sum; r = x - k pi/2
    shifted = g.fma(x, g.const(TWO_OVER_PI), g.const(MAGIC))
    k = g.make("bits", shifted)
    minus_k = g.neg(g.make("sub", shifted, g.const(MAGIC)))  # as a real number
    r = x
    for part in HALF_PI:
        r = g.fma(minus_k, g.const(part), r)
    z = g.mul(r, r)
    s = g.fma(g.mul(r, z), polynomial(g, SINE, z), r)
    c = g.fma(g.mul(z, z), polynomial(g, COSINE, z), g.fma(z, g.const(-0.5), g.const(1.0)))
    # each quarter turn exchanges sine and cosine; two of them change both signs
    odd = g.make("nonzero", g.make("and", k, payload=1))
    return _select_by_quarter(g, odd, c, s, k), _select_by_quarter(g, odd, s, c, g.make("plus", k, payload=1))


def _select_by_quarter(g: Graph, odd: int, if_odd: int, if_even: int, k: int) -> int:
    """Return `if_odd` where the mask `odd` is true, else `if_even`, negated where bit 1 of the number k of quarter turns is 1.

    This bit is shifted left by 62 to the sign bit of a double, and negates the double by an exclusive or.
    """
    sign = g.make("shl", g.make("and", k, payload=2), payload=62)
    chosen = g.make("bits", g.make("select", odd, if_odd, if_even))
    return g.make("real", g.make("xor", chosen, sign))


def rotate(g: Graph, pair: Pair, d: int, reach: float) -> Pair:
    """Return sine and cosine of x + d from `pair`, the sine and cosine of x; they are valid for |d| <= reach [rad]."""
    s, c = pair
    # sin d = d + d z P(z), 1 - cos d = z Q(z); P or Q is empty if its term is below rounding for |d| <= reach
    P, Q = short_series(reach)
    z = g.mul(d, d)
    sine = g.fma(g.mul(d, z), polynomial(g, P, z), d) if P else d
    if not Q:
        return g.fma(c, sine, s), g.fma(g.neg(s), sine, c)
    versine = g.mul(z, polynomial(g, Q, z))  # 1 - cos d
    return (
        g.add(s, g.fma(c, sine, g.neg(g.mul(s, versine)))),
        g.sub(c, g.fma(s, sine, g.mul(c, versine))),
    )


@cache
def short_series(reach: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the shortest polynomials P and Q that give sine and cosine of a rotation |d| <= reach [rad] exact to rounding.

    sin d = d + d^3 P(d^2) and 1 - cos d = d^2 Q(d^2); coefficients begin with the lowest degree.

    Raises:
        ValueError: SERIES_TERMS - 1 coefficients are not enough.
    """
    P = [Fraction((-1) ** (k + 1), factorial(2 * k + 3)) for k in range(SERIES_TERMS)]
    Q = [Fraction((-1) ** k, factorial(2 * k + 2)) for k in range(SERIES_TERMS)]
    return _economise(P, reach, reach**3), _economise(Q, reach, reach**2)


def _economise(series: list[Fraction], reach: float, factor: float) -> tuple[float, ...]:
    """Interpolate a power series in z = d^2 at Chebyshev nodes of [0, reach^2]; return coefficients, the lowest degree first.

    The polynomial is the shortest one whose error times `factor` is at most TOLERANCE, for |d| <= reach [rad].
    """
    width = reach * reach
    for terms in range(SERIES_TERMS):
        # error estimate: the coefficient of the first omitted term, times the size width^terms / 2^(2 terms - 1) of the Chebyshev
        # polynomial of this degree on [0, width]
        error = abs(float(series[terms])) * width**terms / (2.0 ** (2 * terms - 1) if terms else 1.0)
        if error * factor <= TOLERANCE:
            nodes = [Fraction(width * (1 + cos(pi * (k + 0.5) / terms)) / 2) for k in range(terms)]
            return _interpolate(nodes, [sum(c * z**k for k, c in enumerate(series)) for z in nodes])
    raise ValueError(f"a reach of {reach} rad is too far for a short series")


def _interpolate(nodes: list[Fraction], values: list[Fraction | int]) -> tuple[float, ...]:
    """Return the coefficients of the polynomial through the values, by Newton's divided differences in exact arithmetic."""
    x, differences = np.array(nodes, dtype=object), np.array(values, dtype=object)
    for order in range(1, len(nodes)):
        differences[order:] = (differences[order:] - differences[order - 1 : -1]) / (x[order:] - x[:-order])
    coefficients = np.array([Fraction(0)])
    for node, difference in zip(reversed(nodes), reversed(differences), strict=True):
        coefficients = polynomials.polyadd(polynomials.polymul(coefficients, [-node, Fraction(1)]), [difference])
    return tuple(float(c) for c in coefficients[: len(nodes)])  # () without nodes
