"""Problems with known solutions, on which the formulas of Yuan & Ge (2016), section 3, are tested.

    M a + f = Q - J^T lambda,   J a = g

f are forces that the paper puts on the left side, Q the applied forces; many books have the opposite sign of lambda. Random
problems are solved as the saddle-point system of both equations. The accelerations of the crank-slider come from its motion in the
crank angle, without J and lambda.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from gauss_bench.formulations.lagrange import lagrange
from gauss_bench.papers import crank_slider
from gauss_bench.terms import Array, Terms

SEED = 2016
SIZES = ((7, 4, 0), (5, 1, 0), (9, 6, 0), (7, 4, 2), (6, 3, 1))  # numbers of coordinates, independent rows and dependent rows
EACH = 6  # random problems of each size
CRANK = 2  # index of the crank angle in the example's coordinates
MILLIMETRES = np.array([1e3, 1e3, 1.0, 1e3, 1e3, 1.0, 1e3])  # factors on the example's coordinates: 1 for angles


@dataclass(frozen=True, eq=False)
class Problem:
    """The terms M, f, Q, J, g of a system, its accelerations a (n,), and the multipliers lambda (m,) of least norm."""

    M: Array
    f: Array
    Q: Array
    J: Array
    g: Array
    a: Array
    multipliers: Array

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return len(self.M)

    @property
    def rank(self) -> int:
        """The number of independent constraint rows."""
        return int(np.linalg.matrix_rank(self.J))

    @property
    def terms(self) -> Terms:
        """The problem as the suite's formulations solve it, M a + J^T lambda = Q, J a = gamma: their Q is Q - f, gamma is g."""
        zero = np.zeros(len(self.J))
        return Terms(self.M, self.J, self.Q - self.f, self.g, zero, zero)


def add_multipliers(M: Array, f: Array, Q: Array, J: Array, g: Array, a: Array) -> Problem:
    """Return the problem with the accelerations a and the least-norm solution of J^T lambda = Q - f - M a."""
    return Problem(M, f, Q, J, g, a, np.asarray(np.linalg.lstsq(J.T, Q - f - M @ a, rcond=1e-10)[0]))


def solve_problem(M: Array, f: Array, Q: Array, J: Array, g: Array, independent: int) -> Problem:
    """Return the problem with its solution; the first `independent` rows of J are independent, the others combinations of them."""
    zero = np.zeros(independent)
    a = lagrange(Terms(M, J[:independent], Q - f, g[:independent], zero, zero)).a
    return add_multipliers(M, f, Q, J, g, a)


def random_problem(rng: np.random.Generator, n: int, m: int, repeated: int = 0) -> Problem:
    """Return a problem with a full M (n, n), m independent rows of J, and `repeated` combinations of these rows."""
    root = rng.normal(size=(n, n))
    M = root @ root.T + 0.1 * n * np.eye(n)
    mix = np.vstack([np.eye(m), rng.normal(size=(repeated, m))])
    J, g = mix @ rng.normal(size=(m, n)), mix @ rng.normal(size=m)
    return solve_problem(M, rng.normal(size=n), rng.normal(size=n), J, g, m)


@cache
def random_problems() -> tuple[Problem, ...]:
    """Return EACH random problems for every entry of SIZES; some have redundant but consistent rows."""
    rng = np.random.default_rng(SEED)
    return tuple(random_problem(rng, *size) for size in SIZES for _ in range(EACH))


@cache
def crank_problems() -> tuple[Problem, ...]:
    """Return the crank-slider, the paper's example, in its initial state and in random states."""
    M, f, problems = np.diag(crank_slider.mass()), np.zeros(7), []
    for s in crank_slider.states():
        J, g, Q = crank_slider.jacobian(s.q), crank_slider.bias(s.q, s.v), crank_slider.forces(s.q, s.v)
        problems.append(add_multipliers(M, f, Q, J, g, s.a))
    return tuple(problems)


def all_problems() -> tuple[Problem, ...]:
    """Return the random problems, then those of the crank-slider."""
    return (*random_problems(), *crank_problems())


def redundant_problems() -> list[Problem]:
    """Return the random problems with redundant rows."""
    return [p for p in random_problems() if len(p.J) > p.rank]


def draw() -> np.random.Generator:
    """Return a new generator of the random vectors and inverses with which forms are tested on a problem."""
    return np.random.default_rng(SEED + 2)  # another seed than that of the problems


@cache
def special_problems(kind: str) -> tuple[Problem, ...]:
    """Return random problems of a kind for which a projection in the Euclidean metric gives the right accelerations.

    The kinds are "even": M = mu I; "full": as many constraint rows as coordinates; "idle": no constraint forces; "aligned": M maps
    range(J^T) to itself.
    """
    rng = np.random.default_rng(SEED + 1)
    problems: list[Problem] = []
    for n, m, _ in SIZES[:3] * EACH:
        p = random_problem(rng, n, n if kind == "full" else m)
        M, J, g = p.M, p.J, p.g
        if kind == "even":
            M = rng.uniform(0.5, 2.0) * np.eye(n)
        elif kind == "full":
            J = J + 2 * np.sqrt(n) * np.eye(n)  # a square random matrix alone may be nearly singular
        elif kind == "idle":
            g = J @ np.linalg.solve(M, p.Q - p.f)
        elif kind == "aligned":
            J = rng.normal(size=(m, m)) @ np.linalg.eigh(M)[1][:, :m].T
        problems.append(solve_problem(M, p.f, p.Q, J, g, len(J)))
    return tuple(problems)


def in_millimetres(p: Problem) -> Problem:
    """Return a problem of the crank-slider in millimetres: coordinates q' = s q, with s = 1000 for lengths and 1 for angles.

    Energies stay in J, so that forces are in kN and masses in 1e6 kg.
    """
    s = MILLIMETRES
    return replace(
        p, M=p.M / np.outer(s, s), f=p.f / s, Q=p.Q / s, J=1e3 * p.J / s, g=1e3 * p.g, a=p.a * s, multipliers=p.multipliers / 1e3
    )


def relative(x: Array, true: Array) -> float:
    """Return the largest difference of x from `true`, divided by the largest entry of `true`."""
    return float(np.abs(x - true).max() / np.abs(true).max())


def count_off(factors: Sequence[int], numbers: Sequence[int], true: int) -> float:
    """Return the error of a claimed count, the sum of the products of `factors` and `numbers`; the right count is `true`."""
    return float(abs(sum(k * x for k, x in zip(factors, numbers, strict=True)) - true))
