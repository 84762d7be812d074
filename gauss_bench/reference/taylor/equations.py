"""Equations of motion in loop coordinates, reduced to as many unknowns as there are degrees of freedom.

The constraint rows A x' = rate, A x'' = gamma leave some coordinates free, whose speeds are u. All velocities and accelerations are

    x' = n0 + N u,        x'' = a0 + N u'

Here n0 and a0 are solutions of the rows for u = 0 and u' = 0, and the columns of N solve A N = 0.

Let z_b be the position of the centre of mass and the angle of link b, J_b the Jacobian of z_b with respect to x, m_b the mass or
inertia of the link, F_b the force or moment on it, and bias_b the part of z_b'' that does not depend on x''. By Gauss's principle
of least constraint, u' minimises sum_b |m_b z_b'' - F_b|^2 / m_b. Hence u' solves

    T u' = r,    T = sum_b m_b (J_b N)^T J_b N,    r = sum_b (J_b N)^T (F_b - m_b (J_b a0 + bias_b))

The integrated state is (x, u), so that only positions can drift. Source: Yuan and Ge, Multibody System Dynamics 37 (2016), and
Udwadia and Kalaba, Analytical Dynamics (1996), for Gauss's principle; Nikravesh, Computer-Aided Analysis of Mechanical Systems
(1988), section 12.6, for the reduction to free coordinates.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gauss_bench.reference.taylor.arithmetic import Value, dot, plus, scale_by, to_dense, total, vanishes
from gauss_bench.reference.taylor.elimination import Order, Pivots, choose_pivots, factorise, null_space, particular
from gauss_bench.reference.taylor.forces import Loads
from gauss_bench.reference.taylor.rows import Law, LoopRows
from gauss_bench.reference.taylor.vector_sums import NONE, Instant
from gauss_bench.terms import Array

REDUNDANT = 1e-9  # largest size of an entry that counts as zero: far above rounding in double precision, far below a usable pivot


@dataclass(frozen=True)
class Chart:
    """A choice of free (independent) coordinates, whose speeds determine the speeds of all other coordinates.

    Attributes:
        order: (row, column) of the pivots by which the other coordinates are eliminated.
        scale: (n,) change of the loop closures per unit change of each coordinate [m or 1]; pivots are divided by it before they
            are compared.
    """

    order: Order
    free: tuple[int, ...]
    scale: Array


class Rates(NamedTuple):
    """The rates of the coordinates at a state.

    Attributes:
        velocity: coordinate -> its velocity x'; acceleration: coordinate -> its acceleration x''.
        free: accelerations u' of the free coordinates, in the order of `Chart.free`.
    """

    velocity: dict[int, Value]
    acceleration: dict[int, Value]
    free: list[Value]


def choose_chart(rows: LoopRows, at: Instant, scale: Array | None = None) -> tuple[Chart, Pivots]:
    """Choose the free coordinates at one state; return this chart, and the pivots of the elimination.

    Args:
        at: the vectors at a single state.
        scale: (n,) scales of the coordinates as in `Chart`; by default the largest entry of each column of A at this state, or 1 if
            that is at most REDUNDANT.
    """
    n = rows.coordinates.n
    entries = rows.entries(at)
    A = to_dense(entries, 1, n)[0]
    pattern = np.zeros(A.shape, dtype=bool)
    for r, row in enumerate(entries):
        pattern[r, list(row)] = True
    if scale is None:
        loops = 2 * len(rows.closures)  # number of rows of the loops, alternating between the equations in x and in y
        vectors = np.hypot(A[0:loops:2], A[1:loops:2])  # lengths of the loops' vectors, which do not change as a loop turns
        largest = np.maximum(vectors.max(axis=0, initial=0.0), np.abs(A[loops:]).max(axis=0, initial=0.0))
        scale = np.where(largest > REDUNDANT, largest, 1.0)
    pivots = choose_pivots(A / scale, pattern, REDUNDANT)
    bound = {c for _, c in pivots.order}
    return Chart(pivots.order, tuple(j for j in range(n) if j not in bound), scale), pivots


def rates(rows: LoopRows, chart: Chart, at: Instant, u: Sequence[Value], laws: Sequence[Law]) -> Rates:
    """Return velocities and accelerations of all coordinates, and the accelerations of the free ones, at a state (x, u).

    Args:
        at: the vectors at x.
        u: speeds of the free coordinates, in the order of `chart.free`.
        laws: value, rate and second rate that every driver prescribes.
    """
    factors = factorise(rows.entries(at), chart.order)
    N = null_space(factors, rows.coordinates.n)
    prescribed = rows.rates(laws)
    n0 = particular(factors, prescribed) if any(not vanishes(x) for x in prescribed) else {}
    velocity = _combine(n0, N, dict(zip(chart.free, u, strict=True)))
    a0 = particular(factors, rows.biases(at, velocity, laws))
    if not chart.free:  # the linkage is driven completely
        return Rates(velocity, a0, [])
    T, r = _reduce(rows, at, velocity, N, a0)
    order = tuple((k, k) for k in range(len(r)))  # any order is good, because T is positive definite
    solved = particular(factorise([dict(enumerate(row)) for row in T], order), r)
    free = [solved[k] for k in range(len(r))]
    return Rates(velocity, _combine(a0, N, dict(zip(chart.free, free, strict=True))), free)


def _combine(x0: dict[int, Value], N: dict[int, dict[int, Value]], u: dict[int, Value]) -> dict[int, Value]:
    """Return x0 + N u."""
    combined = dict(x0)
    for j, column in N.items():
        for k, value in column.items():
            combined[k] = combined.get(k, 0) + value * u[j]
    return combined


def _reduce(
    rows: LoopRows, at: Instant, v: dict[int, Value], N: dict[int, dict[int, Value]], a0: dict[int, Value]
) -> tuple[list[list[Value]], list[Value]]:
    """Return T (f, f) and r (f,) of T u' = r, with f the number of free coordinates.

    Args:
        v, a0: coordinate -> its velocity, and its acceleration if u' = 0.
        N: free coordinate -> its column of the null-space matrix, as coordinate -> value.
    """
    coordinates = rows.coordinates
    loads = Loads(coordinates, at, v)
    columns = [N[j] for j in sorted(N)]
    moves = [at.variation(column) for column in columns]
    linear, bias = at.variation(a0), at.bias(v)  # both parts of the accelerations for u' = 0
    f = len(columns)
    T: list[list[list[Value]]] = [[[] for _ in range(f)] for _ in range(f)]
    r: list[list[Value]] = [[] for _ in range(f)]
    for i, link in enumerate(coordinates.mechanism.links):
        centre, angle = coordinates.centres[i], coordinates.angle[i]
        mass, inertia = at.arithmetic.constant(link.mass), at.arithmetic.constant(link.inertia)
        # z, w: velocity of the centre of mass and angular velocity of the link for a unit speed of each free coordinate
        z, w = [at.combine(centre, move) for move in moves], [column.get(angle, 0) for column in columns]
        b = plus(at.combine(centre, linear), at.combine(centre, bias))  # acceleration of the centre of mass if u' = 0
        force = plus(loads.force[i], scale_by(-mass, b))
        moment = loads.moment[i] - inertia * (0 if angle == NONE else a0.get(angle, 0))
        for j in range(f):
            r[j] += [dot(z[j], force), w[j] * moment]
            for k in range(j + 1):  # T is symmetric
                T[j][k] += [mass * dot(z[j], z[k]), inertia * (w[j] * w[k])]
    return [[total(T[max(j, k)][min(j, k)]) for k in range(f)] for j in range(f)], [total(x) for x in r]
