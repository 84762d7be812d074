"""Yuan & Ge (2016), sections 1 to 3 up to eq. (14): Gauss's function, its constraints and its least-squares form.

    G(a) = 1/2 (M a + f - Q)^T M^-1 (M a + f - Q)                                                                 (1)
    a = J^- g + N h,    N = I - J^- J                                                                             (8)
    G = 1/2 |A h - b|^2,    A = M^(1/2) N,    b = -(M^(1/2) J^- g + M^(-1/2) (f - Q))                       (9)-(11)
    h = A^- b + (I - A^- A) w,    a = J^- g + N A^- b                                                      (12)-(14)

J^- is any matrix with J J^- J = J unless another inverse is named; the Moore-Penrose inverse is one of them.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gauss_bench.papers import crank_slider
from gauss_bench.papers.audit import worst
from gauss_bench.papers.crank_slider import Number, derivative, gradient
from gauss_bench.papers.forms.problems import CRANK, Problem, Trial, crank_problems, in_millimetres, relative, solve_problem
from gauss_bench.terms import Array

RCOND = 1e-10  # relative to the largest singular value: rounding leaves 1e-15, the problems have 1e-4 or more
AB = tuple[Array, Array]


def power(M: Array, exponent: float) -> Array:
    """Return the symmetric power M^exponent of a positive definite M."""
    values, vectors = np.linalg.eigh(M)
    return np.asarray((vectors * values**exponent) @ vectors.T)


def pinv(A: Array) -> Array:
    return np.linalg.pinv(A, rcond=RCOND)


def some_inverse(A: Array, rng: np.random.Generator) -> Array:
    """Return a random generalised inverse X, A X A = A, for which neither A X nor X A is symmetric."""
    X = pinv(A)
    U, V = rng.normal(size=X.shape), rng.normal(size=X.shape)
    return X + (np.eye(len(X)) - X @ A) @ U + V @ (np.eye(len(A)) - A @ X)


def moore_penrose(A: Array, rng: np.random.Generator) -> Array:
    return pinv(A)


def projector(p: Problem) -> Array:
    """N = I - J^+ J."""
    return np.eye(p.n) - pinv(p.J) @ p.J


def gauss_function(p: Problem, a: Number) -> Number:
    r = p.M @ a + p.f - p.Q
    return np.asarray(r @ np.linalg.solve(p.M, r) / 2)


def root_function(p: Problem, a: Number, extra: Array | float = 0.0) -> Number:
    """Return Gauss's function by eq. (2), or by eq. (3) with constraint forces `extra` that do work."""
    r = power(p.M, -0.5) @ (p.M @ a + p.f - p.Q - extra)
    return np.asarray(r @ r / 2)


def slope(p: Problem, G: Callable[[Number], Number], a: Array) -> float:
    """Return the slope of G at a along the accelerations that the constraints allow, relative to the full gradient."""
    full = gradient(G, a)
    return float(np.abs(projector(p) @ full).max() / np.abs(full).max())


def stationary(form: Callable[[Problem, Number], Number], p: Problem) -> float:
    """Return the slope of a form of Gauss's function at the true accelerations."""
    return slope(p, lambda a: form(p, a), p.a)


def same_function(form: Callable[[Problem, Number], Number], x: Trial) -> float:
    """Compare a form with Gauss's function at random accelerations."""
    a = x.rng.normal(size=x.p.n)
    return abs(float(form(x.p, a) / gauss_function(x.p, a)) - 1)


def stationary_with(form: Callable[[Problem, Number, Array], Number], x: Trial) -> float:
    """Return the slope of a form at the true accelerations, with random constraint forces that do work."""
    p, extra = x.p, x.rng.normal(size=x.p.n)
    true = solve_problem(p.M, p.f, p.Q + extra, p.J, p.g, p.rank).a
    return slope(p, lambda a: form(p, a, extra), true)


Rate = Callable[[Number, Number], Number]


def differentiate(rate: Rate, q: Array, v: Array) -> Array:
    """Return g of J a = g: minus the derivative of rate(q, v) in time at constant v."""
    return -derivative(lambda x: rate(x, v), q, v)


def list_motions() -> list[tuple[Rate, Array, Array, Array]]:
    """Return constraint rates (function, q, v, a) at reference motions: of the crank-slider, and of a knife edge on a circle."""

    def slider(q: Number, v: Number) -> Number:
        return np.asarray(crank_slider.jacobian(q) @ v)

    def blade(q: Number, v: Number) -> Number:
        return np.array([np.cos(q[2]) * v[1] - np.sin(q[2]) * v[0]])

    radius, speed, theta = 0.7, 3.0, 0.4
    along, across = np.array([np.cos(theta), np.sin(theta)]), np.array([-np.sin(theta), np.cos(theta)])
    turn = np.array([0.0, 0.0, theta]), np.append(radius * speed * along, speed), np.append(radius * speed**2 * across, 0.0)
    return [(slider, s.q, s.v, s.a) for s in crank_slider.states()[1:]] + [(blade, *turn)]


def bias_left(form: Callable[[Rate, Array, Array], Array], motion: tuple[Rate, Array, Array, Array]) -> float:
    """Compare a form of the right-hand side g with J a of a reference motion from `list_motions`."""
    rate, q, v, a = motion
    return relative(form(rate, q, v), gradient(lambda x: rate(q, x), v) @ a)


def general_solution(p: Problem, J_inverse: Array, h: Array) -> Array:
    """Return the accelerations of eq. (8)."""
    return J_inverse @ p.g + (np.eye(p.n) - J_inverse @ p.J) @ h


def every_solution(form: Callable[[Problem, Array, Array], Array], x: Trial) -> float:
    """Measure whether a form gives only solutions of J a = g, and gives the solution a for h = a."""
    p, X = x.p, some_inverse(x.p.J, x.rng)
    a = form(p, X, x.rng.normal(size=p.n))
    return worst([np.abs(p.J @ a - p.g).max() / np.abs(p.J @ p.a).max(), relative(form(p, X, p.a), p.a)])


Inverse = Callable[[Array, np.random.Generator], Array]


def least_squares_residual(A: Array, x: Array, b: Array) -> float:
    """Return |A^T (A x - b)| relative to its terms; it is zero where x minimises |A x - b|."""
    return float(np.abs(A.T @ (A @ x - b)).max() / np.abs(A.T @ b).max())


def contradicting_rows(form: Inverse, x: Trial) -> float:
    """Return the least-squares residual of (8) for redundant rows whose right-hand sides contradict each other by a tenth."""
    p, rng = x.p, x.rng
    noisy = replace(p, g=p.g + 0.1 * np.abs(p.g).max() * rng.normal(size=len(p.g)))
    a = general_solution(noisy, form(p.J, rng), rng.normal(size=p.n))
    return least_squares_residual(p.J, a, noisy.g)


def matrix(p: Problem, exponent: float = 0.5) -> Array:
    """Return A of eq. (10) with this exponent of M."""
    return power(p.M, exponent) @ projector(p)


def vector(p: Problem, exponent: float = 0.5) -> Array:
    """Return b of eq. (11) with this exponent of M in its first term."""
    return -(power(p.M, exponent) @ pinv(p.J) @ p.g + power(p.M, -0.5) @ (p.f - p.Q))


def matrix_off(exponent: float, p: Problem) -> float:
    """Compare A with the factor of h in (2) after inserting (8): M^(-1/2) M N."""
    return relative(matrix(p, exponent), power(p.M, -0.5) @ p.M @ projector(p))


def vector_off(exponent: float, p: Problem) -> float:
    """Compare b with minus the terms without h in (2) after inserting (8): M^(-1/2) (M J^- g + f - Q)."""
    return relative(vector(p, exponent), power(p.M, -0.5) @ (p.Q - p.f - p.M @ pinv(p.J) @ p.g))


def acceleration(p: Problem, exponents: tuple[float, float] = (0.5, 0.5)) -> Array:
    """Return the accelerations of eq. (14) without w, with these exponents of M in A and b."""
    return bracket(p, np.zeros(p.n), exponents)


def pair_off(exponents: tuple[float, float], p: Problem) -> float:
    return relative(acceleration(p, exponents), p.a)


def half_square(A: Array, b: Array, h: Array) -> float:
    r = A @ h - b
    return float(r @ r / 2)


def square_off(form: Callable[[Array, Array, Array], float], x: Trial) -> float:
    """Compare a form of |A h - b|^2 / 2 with Gauss's function of the accelerations that h gives."""
    p, h = x.p, x.rng.normal(size=x.p.n)
    G = gauss_function(p, general_solution(p, pinv(p.J), h))
    return abs(form(matrix(p), vector(p), h) / float(G) - 1)


def unit_dependence(acceleration_of: Callable[[Problem], Array], p: Problem) -> float:
    """Return the relative change of the crank's acceleration if lengths are given in millimetres."""
    return float(abs(acceleration_of(in_millimetres(p))[CRANK] / acceleration_of(p)[CRANK] - 1))


def pair_unit_dependence(exponents: tuple[float, float], p: Problem) -> float:
    return unit_dependence(lambda x: acceleration(x, exponents), p)


def sides(A: Array, b: Array, h: Array) -> AB:
    return A @ h, b


def normal_sides(A: Array, b: Array, h: Array) -> AB:
    return A.T @ A @ h, A.T @ b


def sides_off(form: Callable[[Array, Array, Array], AB], p: Problem) -> float:
    """Return the difference of both sides of an equation at the minimum h = a."""
    return relative(*form(matrix(p), vector(p), p.a))


def minimum_missed(form: Inverse, x: Trial) -> float:
    """Return the least-squares residual |A^T (A h - b)| of (12), with a form of the inverse of A and a random w."""
    p, A, b = x.p, matrix(x.p), vector(x.p)
    X = form(A, x.rng)
    h = X @ b + (np.eye(p.n) - X @ A) @ x.rng.normal(size=p.n)
    return least_squares_residual(A, h, b)


def expand(p: Problem, w: Array) -> Array:
    """Return the accelerations of eq. (14), its bracket multiplied out."""
    A, b = matrix(p), vector(p)
    N, X = projector(p), pinv(A)
    return np.asarray(pinv(p.J) @ p.g + N @ X @ b + N @ w - N @ X @ A @ w)


def last_member_alone(p: Problem, w: Array) -> Array:
    A = matrix(p)
    return np.asarray(projector(p) @ pinv(A) @ A @ w)


def bracket(p: Problem, w: Array, exponents: tuple[float, float] = (0.5, 0.5)) -> Array:
    """Return the accelerations of eq. (14) with w, with these exponents of M in A and b."""
    A, b = matrix(p, exponents[0]), vector(p, exponents[1])
    X = pinv(A)
    return np.asarray(pinv(p.J) @ p.g + projector(p) @ (X @ b + (np.eye(p.n) - X @ A) @ w))


def with_any_w(form: Callable[[Problem, Array], Array], x: Trial) -> float:
    """Compare the accelerations of a form with the reference, for a random w ten times as large."""
    return relative(form(x.p, 10 * np.abs(x.p.a).max() * x.rng.normal(size=x.p.n)), x.p.a)


def crank_at_start(acceleration_of: Callable[[Problem], Array]) -> float:
    return float(acceleration_of(crank_problems()[0])[CRANK])


def true_crank_at_start() -> float:
    return float(crank_slider.states()[0].a[CRANK])


def crank_by_pair(exponents: tuple[float, float]) -> float:
    return crank_at_start(lambda p: acceleration(p, exponents))
