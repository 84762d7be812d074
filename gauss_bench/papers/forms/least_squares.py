"""Yuan & Ge (2016), sections 1 to 3 up to eq. (14): Gauss's function, its constraints and its least-squares form.

    G(a) = 1/2 (M a + f - Q)^T M^-1 (M a + f - Q)                                                                 (1)
    a = J^- g + N h,    N = I - J^- J                                                                             (8)
    G = 1/2 |A h - b|^2,    A = M^(1/2) N,    b = -(M^(1/2) J^- g + M^(-1/2) (f - Q))                       (9)-(11)
    h = A^- b + (I - A^- A) w,    a = J^- g + N A^- b                                                      (12)-(14)

M a + f = Q - J^T lambda and J a = g are the equations of motion and of the constraints. J^- is any generalised inverse, a matrix
with J J^- J = J, such as the Moore-Penrose inverse J^+; h and w are arbitrary vectors (n,).

Equation numbers are those of Yuan & Ge (2016). The argument `form` of a measure is the formula, exponent or inverse that is tested,
either as printed or as corrected. The exponents of M that are tested are those in A and in the first term of b; eqs. (10) and (11)
print -1/2 for both instead of 1/2.
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
    """Return the Moore-Penrose inverse; singular values below RCOND times the largest count as zero."""
    return np.linalg.pinv(A, rcond=RCOND)


def some_inverse(A: Array, rng: np.random.Generator) -> Array:
    """Return a random generalised inverse X, A X A = A, for which neither A X nor X A is symmetric."""
    X = pinv(A)
    U, V = rng.normal(size=X.shape), rng.normal(size=X.shape)
    return X + (np.eye(len(X)) - X @ A) @ U + V @ (np.eye(len(A)) - A @ X)


def moore_penrose(A: Array, rng: np.random.Generator) -> Array:
    """Return the Moore-Penrose inverse; `rng` is not used, and makes the arguments those of `some_inverse`."""
    return pinv(A)


def projector(p: Problem) -> Array:
    """Return N = I - J^+ J, which projects accelerations on those with J a = 0."""
    return np.eye(p.n) - pinv(p.J) @ p.J


def gauss_function(p: Problem, a: Number) -> Number:
    """Return Gauss's function G at accelerations a, eq. (1)."""
    r = p.M @ a + p.f - p.Q
    return np.asarray(r @ np.linalg.solve(p.M, r) / 2)


def root_function(p: Problem, a: Number, extra: Array | float = 0.0) -> Number:
    """Return Gauss's function by eq. (2), or by eq. (3) with constraint forces `extra` that do work."""
    r = power(p.M, -0.5) @ (p.M @ a + p.f - p.Q - extra)
    return np.asarray(r @ r / 2)


def slope(p: Problem, G: Callable[[Number], Number], a: Array) -> float:
    """Return how far a function G of the accelerations is from an extremum at a, among accelerations that the constraints allow.

    The result is the largest component of the gradient of G projected on the directions that the constraints allow, divided by the
    largest component of the full gradient.
    """
    full = gradient(G, a)
    return float(np.abs(projector(p) @ full).max() / np.abs(full).max())


def stationary(form: Callable[[Problem, Number], Number], p: Problem) -> float:
    """Return the projected gradient (`slope`) of a formula for Gauss's function at the true accelerations, where it should be 0.

    `form(p, a)` is the formula, for the problem p and the accelerations a.
    """
    return slope(p, lambda a: form(p, a), p.a)


def same_function(form: Callable[[Problem, Number], Number], x: Trial) -> float:
    """Compare a formula for Gauss's function with eq. (1) at random accelerations."""
    a = x.rng.normal(size=x.p.n)
    return abs(float(form(x.p, a) / gauss_function(x.p, a)) - 1)


def stationary_with(form: Callable[[Problem, Number, Array], Number], x: Trial) -> float:
    """Return the projected gradient (`slope`) of Gauss's function, eq. (3), at the true accelerations, where it should be 0.

    The constraint forces in eq. (3) do work; here they are random, (n,). `form(p, a, extra)` is Gauss's function with these
    constraint forces as `extra`. In the true motion, constraint forces that do work act like applied forces, and are added to Q.
    """
    p, extra = x.p, x.rng.normal(size=x.p.n)
    true = solve_problem(p.M, p.f, p.Q + extra, p.J, p.g, p.rank).a
    return slope(p, lambda a: form(p, a, extra), true)


Rate = Callable[[Number, Number], Number]  # function of q and v: the rates J v of the constraints, which a motion keeps at zero


def differentiate(rate: Rate, q: Array, v: Array) -> Array:
    """Return g of J a = g: minus the time derivative of rate(q, v) = J v at constant v."""
    return -derivative(lambda x: rate(x, v), q, v)


def list_motions() -> list[tuple[Rate, Array, Array, Array]]:
    """Return states of reference motions of the crank-slider, and of a knife edge that moves on a circle.

    Each state has four items: the rates of the constraints as a function of q and v, and q, v, a at one instant.
    """

    def slider(q: Number, v: Number) -> Number:
        """Return the constraint rates (6,) of the crank-slider."""
        return np.asarray(crank_slider.jacobian(q) @ v)

    def blade(q: Number, v: Number) -> Number:
        """Return the velocity (1,) of the knife edge, which is at x, y with the angle theta, across its direction."""
        return np.array([np.cos(q[2]) * v[1] - np.sin(q[2]) * v[0]])

    radius, omega, theta = 0.7, 3.0, 0.4  # [m], [rad/s], [rad] of the circular motion
    along, across = np.array([np.cos(theta), np.sin(theta)]), np.array([-np.sin(theta), np.cos(theta)])
    # at this instant the knife edge is at the origin, and the centre of the circle is at the distance `radius` across its direction
    on_circle = np.array([0.0, 0.0, theta]), np.append(radius * omega * along, omega), np.append(radius * omega**2 * across, 0.0)
    moving = crank_slider.states()[1:]  # without the start, which is at rest
    return [(slider, s.q, s.v, s.a) for s in moving] + [(blade, *on_circle)]


def bias_left(form: Callable[[Rate, Array, Array], Array], motion: tuple[Rate, Array, Array, Array]) -> float:
    """Return the relative difference of the right-hand side g of J a = g from J a at a state of a motion (`list_motions`).

    `form` is a formula that computes g from the function rate(q, v) = J v and from q and v. J is the derivative of rate by v.
    """
    rate, q, v, a = motion
    return relative(form(rate, q, v), gradient(lambda x: rate(q, x), v) @ a)


def general_solution(p: Problem, J_inverse: Array, h: Array) -> Array:
    """Return the accelerations a = J^- g + (I - J^- J) h, eq. (8), for a generalised inverse J^- of J and a vector h (n,)."""
    return J_inverse @ p.g + (np.eye(p.n) - J_inverse @ p.J) @ h


def every_solution(form: Callable[[Problem, Array, Array], Array], x: Trial) -> float:
    """Return the larger of the errors of two statements about a formula for eq. (8), a = X g + (I - X J) h.

    First, for any h, here a random vector, the result a satisfies J a = g. Second, for h = p.a, the true accelerations, the result
    is p.a itself. `form(p, X, h)` returns accelerations; X is a random generalised inverse of J.
    """
    p, X = x.p, some_inverse(x.p.J, x.rng)
    a = form(p, X, x.rng.normal(size=p.n))
    return worst([np.abs(p.J @ a - p.g).max() / np.abs(p.J @ p.a).max(), relative(form(p, X, p.a), p.a)])


Inverse = Callable[[Array, np.random.Generator], Array]  # returns a generalised inverse of a matrix


def least_squares_residual(A: Array, x: Array, b: Array) -> float:
    """Return |A^T (A x - b)| relative to its terms; it is zero where x minimises |A x - b|."""
    return float(np.abs(A.T @ (A @ x - b)).max() / np.abs(A.T @ b).max())


def contradicting_rows(form: Inverse, x: Trial) -> float:
    """Return the least-squares residual of contradicting redundant rows J a = g for accelerations a by eq. (8) of the paper.

    The problem has redundant rows of J. Random numbers, about a tenth of the largest right-hand side, are added to the right-hand
    sides g, so that J a = g has no solution. `form` computes the generalised inverse in eq. (8).
    """
    p, rng = x.p, x.rng
    noisy = replace(p, g=p.g + 0.1 * np.abs(p.g).max() * rng.normal(size=len(p.g)))
    a = general_solution(noisy, form(p.J, rng), rng.normal(size=p.n))
    return least_squares_residual(p.J, a, noisy.g)


def matrix(p: Problem, exponent: float = 0.5) -> Array:
    """Return A = M^exponent N, eq. (10) of the paper if the exponent is 1/2."""
    return power(p.M, exponent) @ projector(p)


def vector(p: Problem, exponent: float = 0.5) -> Array:
    """Return b = -(M^exponent J^+ g + M^(-1/2) (f - Q)), eq. (11) of the paper if the exponent is 1/2."""
    return -(power(p.M, exponent) @ pinv(p.J) @ p.g + power(p.M, -0.5) @ (p.f - p.Q))


def matrix_off(exponent: float, p: Problem) -> float:
    """Return the relative error of A = M^exponent N against M^(-1/2) M N, the true A in G = 1/2 |A h - b|^2.

    The true A is the factor of h that results if a by eq. (8) is inserted in G by eq. (2) of the paper.
    """
    return relative(matrix(p, exponent), power(p.M, -0.5) @ p.M @ projector(p))


def vector_off(exponent: float, p: Problem) -> float:
    """Return the relative error of the vector b (`vector`) with the given exponent of M in its first term.

    If a by eq. (8) is inserted in G by eq. (2) of the paper, the terms without h are M^(-1/2) (M J^- g + f - Q), and the true b is
    minus these terms.
    """
    return relative(vector(p, exponent), power(p.M, -0.5) @ (p.Q - p.f - p.M @ pinv(p.J) @ p.g))


def acceleration(p: Problem, exponents: tuple[float, float] = (0.5, 0.5)) -> Array:
    """Return the accelerations by the paper's eq. (14) with w = 0; exponents of the mass matrix M as in `accelerations_with_w`."""
    return accelerations_with_w(p, np.zeros(p.n), exponents)


def pair_off(exponents: tuple[float, float], p: Problem) -> float:
    """Return the relative error of the accelerations by eq. (14) with w = 0; exponents of M as in `accelerations_with_w`."""
    return relative(acceleration(p, exponents), p.a)


def half_square(A: Array, b: Array, h: Array) -> float:
    """Return |A h - b|^2 / 2."""
    r = A @ h - b
    return float(r @ r / 2)


def square_off(form: Callable[[Array, Array, Array], float], x: Trial) -> float:
    """Return the relative difference of form(A, b, h) = |A h - b|^2 / 2 from Gauss's function, for a random vector h (n,).

    A and b are those of `matrix` and `vector`. Gauss's function is evaluated at the accelerations that eq. (8) gives for h.
    """
    p, h = x.p, x.rng.normal(size=x.p.n)
    G = gauss_function(p, general_solution(p, pinv(p.J), h))
    return abs(form(matrix(p), vector(p), h) / float(G) - 1)


def unit_dependence(acceleration_of: Callable[[Problem], Array], p: Problem) -> float:
    """Return the relative change of the crank's acceleration if lengths are given in millimetres."""
    return float(abs(acceleration_of(in_millimetres(p))[CRANK] / acceleration_of(p)[CRANK] - 1))


def pair_unit_dependence(exponents: tuple[float, float], p: Problem) -> float:
    """Return the relative change of the crank's acceleration by eq. (14) of the paper if lengths are in millimetres.

    `exponents` are the powers of the mass matrix M in the matrix A and in the first term of the vector b.
    """
    return unit_dependence(lambda x: acceleration(x, exponents), p)


def sides(A: Array, b: Array, h: Array) -> AB:
    """Return both sides of A h = b, which is eq. (12) of the paper as printed."""
    return A @ h, b


def normal_sides(A: Array, b: Array, h: Array) -> AB:
    """Return both sides of the normal equations A^T A h = A^T b, which is eq. (12) of the paper as the authors intended it."""
    return A.T @ A @ h, A.T @ b


def sides_off(form: Callable[[Array, Array, Array], AB], p: Problem) -> float:
    """Return the relative difference of the two sides of an equation for h, such as `normal_sides`, at the minimum of |A h - b|.

    The true accelerations p.a, taken as h, are such a minimum.
    """
    return relative(*form(matrix(p), vector(p), p.a))


def minimum_missed(form: Inverse, x: Trial) -> float:
    """Return the relative least-squares residual |A^T (A h - b)| for the vector h = A^- b + (I - A^- A) w of eq. (13).

    w is a random vector, and `form` computes the generalised inverse A^- of A.
    """
    p, A, b = x.p, matrix(x.p), vector(x.p)
    X = form(A, x.rng)
    h = X @ b + (np.eye(p.n) - X @ A) @ x.rng.normal(size=p.n)
    return least_squares_residual(A, h, b)


def expand(p: Problem, w: Array) -> Array:
    """Return the accelerations of eq. (14) for a vector w (n,), computed with the brackets of the equation multiplied out."""
    A, b = matrix(p), vector(p)
    N, X = projector(p), pinv(A)
    return np.asarray(pinv(p.J) @ p.g + N @ X @ b + N @ w - N @ X @ A @ w)


def last_member_alone(p: Problem, w: Array) -> Array:
    """Return the last term of eq. (14) alone; as the equation is printed, the accelerations are equal to this term."""
    A = matrix(p)
    return np.asarray(projector(p) @ pinv(A) @ A @ w)


def accelerations_with_w(p: Problem, w: Array, exponents: tuple[float, float] = (0.5, 0.5)) -> Array:
    """Return the accelerations a = J^+ g + N (A^+ b + (I - A^+ A) w) of eq. (14) of the paper.

    Args:
        w: (n,) any vector.
        exponents: e and k in A = M^e N and b = -(M^k J^+ g + M^(-1/2) (f - Q)); both are 1/2 if the equations are right.
    """
    A, b = matrix(p, exponents[0]), vector(p, exponents[1])
    X = pinv(A)
    return np.asarray(pinv(p.J) @ p.g + projector(p) @ (X @ b + (np.eye(p.n) - X @ A) @ w))


def with_any_w(form: Callable[[Problem, Array], Array], x: Trial) -> float:
    """Return the relative error of the accelerations form(p, w) for a random vector w, ten times as large as the accelerations."""
    return relative(form(x.p, 10 * np.abs(x.p.a).max() * x.rng.normal(size=x.p.n)), x.p.a)


def crank_at_start(acceleration_of: Callable[[Problem], Array]) -> float:
    """Return the crank's initial acceleration [rad/s^2] in the paper's example, by a formula for accelerations."""
    return float(acceleration_of(crank_problems()[0])[CRANK])


def true_crank_at_start() -> float:
    """Return the crank's true initial acceleration [rad/s^2] in the paper's example."""
    return float(crank_slider.states()[0].a[CRANK])


def crank_by_pair(exponents: tuple[float, float]) -> float:
    """Return the crank's initial acceleration [rad/s^2] by eq. (14); exponents of M in A and b as in `accelerations_with_w`."""
    return crank_at_start(lambda p: acceleration(p, exponents))
