"""Yuan & Ge (2016), sections 1 to 3: Gauss's function, its least-squares form, and the inverse of a projector.

    G(a) = 1/2 (M a + f - Q)^T M^-1 (M a + f - Q)                                                                 (1)
    a = J^- g + N h,    N = I - J^- J                                                                             (8)
    G = 1/2 |A h - b|^2,    A = M^(1/2) N,    b = -(M^(1/2) J^- g + M^(-1/2) (f - Q))                       (9)-(11)
    h = A^- b + (I - A^- A) w,    a = J^- g + N A^- b                                                      (12)-(14)
    A^- = N^-1 M^(-1/2),    a = J^- g - N N^-1 {J^- g + M^-1 (f - Q)}                                     (15), (16)

M a + f = Q - J^T lambda and J a = g are the equations of motion and of the constraints. J^- is any generalised inverse, a matrix
with J J^- J = J, such as the Moore-Penrose inverse J^+; h and w are arbitrary vectors (n,). Eqs. (10) and (11) print the exponent
-1/2 for both powers 1/2 of M.

N has the rank n - rank J, so that it has no inverse if there are constraints. With Moore-Penrose inverses, N N^- = N, and eq. (16)
projects M^-1 (Q - f) on J a = g in the Euclidean metric instead of the metric of M:

    a_true - a_(16) = N (a_true - M^-1 (Q - f)) = -N M^-1 J^T lambda
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gauss_bench.formulations.gauss_pinv import gauss_pinv
from gauss_bench.formulations.yuan_ge_eq16 import yuan_ge_eq16
from gauss_bench.papers import crank_slider
from gauss_bench.papers.audit import worst
from gauss_bench.papers.crank_slider import Number, derivative, gradient
from gauss_bench.papers.forms import problems
from gauss_bench.papers.forms.problems import CRANK, Problem, count_off, draw, relative
from gauss_bench.terms import Array

RCOND = 1e-10  # relative to the largest singular value: rounding leaves 1e-15, and the smallest that count are 1e-4 or more
Form = Callable[..., Array]
Rate = Callable[[Number, Number], Number]  # function of q and v: the rates J v of the constraints, which a motion keeps at zero


def power(M: Array, exponent: float) -> Array:
    """Return the symmetric power M^exponent of a positive definite M."""
    values, vectors = np.linalg.eigh(M)
    return np.asarray((vectors * values**exponent) @ vectors.T)


def pinv(A: Array, rng: np.random.Generator | None = None) -> Array:
    """Return the Moore-Penrose inverse; the unused `rng` makes the arguments those of `some_inverse`."""
    return np.linalg.pinv(A, rcond=RCOND)


def some_inverse(A: Array, rng: np.random.Generator) -> Array:
    """Return a random generalised inverse X, A X A = A, for which neither A X nor X A is symmetric."""
    X = pinv(A)
    U, V = rng.normal(size=X.shape), rng.normal(size=X.shape)
    return X + (np.eye(len(X)) - X @ A) @ U + V @ (np.eye(len(A)) - A @ X)


def projector(p: Problem) -> Array:
    """Return N = I - J^+ J, which projects accelerations on those with J a = 0."""
    return np.eye(p.n) - pinv(p.J) @ p.J


def gauss_function(p: Problem, a: Number) -> Number:
    """Return Gauss's function G at accelerations a, eq. (1)."""
    r = p.M @ a + p.f - p.Q
    return np.asarray(r @ np.linalg.solve(p.M, r) / 2)


def root_function(p: Problem, a: Number, extra: Array | float = 0.0) -> Number:
    """Return Gauss's function at accelerations a by eq. (2), or by eq. (3) with constraint forces `extra` (n,) that do work."""
    r = power(p.M, -0.5) @ (p.M @ a + p.f - p.Q - extra)
    return np.asarray(r @ r / 2)


def slope_off(form: Form, p: Problem, a: Array | None = None) -> float:
    """Return the slope of form(p, a), a formula for Gauss's function, along the constraints at a (by default p.a).

    It is the largest component of the gradient projected on J a = 0, divided by the largest component of the whole gradient.
    """
    slopes = gradient(lambda x: form(p, x), p.a if a is None else a)  # (n,)
    return float(np.abs(projector(p) @ slopes).max() / np.abs(slopes).max())


def function_off(form: Form, p: Problem) -> float:
    """Return the relative difference of form(p, a), a formula for Gauss's function, from eq. (1) at random accelerations a."""
    a = draw().normal(size=p.n)
    return abs(float(form(p, a) / gauss_function(p, a)) - 1)


def work_off(form: Form, p: Problem) -> float:
    """Return the slope (`slope_off`) of form(p, a, extra), eq. (3), at the true motion under random forces `extra` (n,).

    Constraint forces that do work act like applied forces: the true motion is that with Q + extra.
    """
    extra = draw().normal(size=p.n)
    true = problems.solve_problem(p.M, p.f, p.Q + extra, p.J, p.g, p.rank).a
    return slope_off(lambda p, a: form(p, a, extra), p, true)


def differentiate(rate: Rate, q: Array, v: Array) -> Array:
    """Return g of J a = g (m,): minus the time derivative of rate(q, v) = J v at constant v, which leaves -J' v."""
    return -derivative(lambda x: rate(x, v), q, v)


def list_motions() -> list[tuple[Rate, Array, Array, Array]]:
    """Return (function J v of q and v, q, v, a) at instants of motions of the crank-slider and of a knife edge on a circle."""
    radius, omega, theta = 0.7, 3.0, 0.4  # [m], [rad/s], [rad] of the circular motion
    along, across = np.array([np.cos(theta), np.sin(theta)]), np.array([-np.sin(theta), np.cos(theta)])
    # the knife edge is at the origin, and the centre of the circle is at the distance `radius` across the edge
    on_circle = np.array([0.0, 0.0, theta]), np.append(radius * omega * along, omega), np.append(radius * omega**2 * across, 0.0)
    return [
        *((lambda q, v: np.asarray(crank_slider.jacobian(q) @ v), s.q, s.v, s.a) for s in crank_slider.moving_states()),
        (lambda q, v: np.array([np.cos(q[2]) * v[1] - np.sin(q[2]) * v[0]]), *on_circle),  # velocity across the knife edge
    ]


def bias_off(form: Form, motion: tuple[Rate, Array, Array, Array]) -> float:
    """Return the relative difference of form(rate, q, v), a formula for g of J a = g, from J a at an instant of a true motion."""
    rate, q, v, a = motion
    return relative(form(rate, q, v), gradient(lambda x: rate(q, x), v) @ a)


def general_solution(p: Problem, J_inverse: Array, h: Array) -> Array:
    """Return the accelerations a = J^- g + (I - J^- J) h, eq. (8), for a generalised inverse J^- of J and a vector h (n,)."""
    return J_inverse @ p.g + (np.eye(p.n) - J_inverse @ p.J) @ h


def solution_off(form: Form, p: Problem) -> float:
    """Return the larger error of two statements on form(p, X, h), a formula for eq. (8) with a random generalised inverse X of J.

    For a random h the result satisfies J a = g, and for the true accelerations h = p.a it is p.a itself.
    """
    rng = draw()
    X = some_inverse(p.J, rng)
    a = form(p, X, rng.normal(size=p.n))
    return worst([np.abs(p.J @ a - p.g).max() / np.abs(p.J @ p.a).max(), relative(form(p, X, p.a), p.a)])


def least_squares_residual(A: Array, x: Array, b: Array) -> float:
    """Return the largest entry of A^T (A x - b), relative to that of A^T b; it is zero where x minimises |A x - b|."""
    return float(np.abs(A.T @ (A @ x - b)).max() / np.abs(A.T @ b).max())


def contradiction_off(form: Form, p: Problem) -> float:
    """Return the least-squares residual of redundant rows J a = g that contradict each other, for the accelerations of eq. (8).

    Random numbers of a tenth of the largest g are added to g. `form` computes the generalised inverse.
    """
    rng = draw()
    contradicting = replace(p, g=p.g + 0.1 * np.abs(p.g).max() * rng.normal(size=len(p.g)))
    a = general_solution(contradicting, form(p.J, rng), rng.normal(size=p.n))
    return least_squares_residual(p.J, a, contradicting.g)


def matrix(p: Problem, exponent: float = 0.5) -> Array:
    """Return A = M^exponent N (n, n), eq. (10) if the exponent is 1/2."""
    return power(p.M, exponent) @ projector(p)


def vector(p: Problem, exponent: float = 0.5) -> Array:
    """Return b = -(M^exponent J^+ g + M^(-1/2) (f - Q)) (n,), eq. (11) if the exponent is 1/2."""
    return -(power(p.M, exponent) @ pinv(p.J) @ p.g + power(p.M, -0.5) @ (p.f - p.Q))


def matrix_off(exponent: float, p: Problem) -> float:
    """Return the relative error of A = M^exponent N against M^(-1/2) M N, the factor of h if eq. (8) is put into eq. (2)."""
    return relative(matrix(p, exponent), power(p.M, -0.5) @ p.M @ projector(p))


def vector_off(exponent: float, p: Problem) -> float:
    """Return the relative error of `vector` against minus the terms without h if eq. (8) is put into eq. (2)."""
    return relative(vector(p, exponent), power(p.M, -0.5) @ (p.Q - p.f - p.M @ pinv(p.J) @ p.g))


def acceleration(p: Problem, w: Array | None = None, exponents: tuple[float, float] = (0.5, 0.5)) -> Array:
    """Return the accelerations a = J^+ g + N (A^+ b + (I - A^+ A) w) of eq. (14), by default with w = 0.

    `exponents` are those of M in A and in the first term of b.
    """
    w = np.zeros(p.n) if w is None else w
    A, b = matrix(p, exponents[0]), vector(p, exponents[1])
    X = pinv(A)
    return np.asarray(pinv(p.J) @ p.g + projector(p) @ (X @ b + (np.eye(p.n) - X @ A) @ w))


def printed_exponents(p: Problem) -> Array:
    """Return the accelerations of eq. (14) with the exponents of eqs. (10) and (11) as printed."""
    return acceleration(p, exponents=(-0.5, -0.5))


def acceleration_off(form: Form, p: Problem) -> float:
    """Return the relative error of form(p), a formula for the accelerations."""
    return relative(form(p), p.a)


def half_square(A: Array, b: Array, h: Array) -> float:
    """Return |A h - b|^2 / 2."""
    r = A @ h - b
    return float(r @ r / 2)


def square_off(form: Callable[[Array, Array, Array], float], p: Problem) -> float:
    """Return the relative difference of form(A, b, h) = |A h - b|^2 / 2 from Gauss's function, for a random vector h (n,)."""
    h = draw().normal(size=p.n)
    G = gauss_function(p, general_solution(p, pinv(p.J), h))
    return abs(form(matrix(p), vector(p), h) / float(G) - 1)


def unit_off(form: Form, p: Problem) -> float:
    """Return the relative change of the crank's acceleration by form(p) if lengths are in millimetres instead of metres."""
    return float(abs(form(problems.in_millimetres(p))[CRANK] / form(p)[CRANK] - 1))


def sides(A: Array, b: Array, h: Array) -> tuple[Array, Array]:
    """Return both sides of A h = b, which is eq. (12) as printed."""
    return A @ h, b


def normal_sides(A: Array, b: Array, h: Array) -> tuple[Array, Array]:
    """Return both sides of the normal equations A^T A h = A^T b, which is eq. (12) as intended."""
    return A.T @ A @ h, A.T @ b


def sides_off(form: Callable[[Array, Array, Array], tuple[Array, Array]], p: Problem) -> float:
    """Return the relative difference of the sides form(A, b, h) at the true accelerations, which minimise |A h - b|."""
    return relative(*form(matrix(p), vector(p), p.a))


def minimum_off(form: Form, p: Problem) -> float:
    """Return the least-squares residual of h = A^- b + (I - A^- A) w, eq. (13), with A^- by `form` and a random w."""
    A, b, rng = matrix(p), vector(p), draw()
    X = form(A, rng)
    h = X @ b + (np.eye(p.n) - X @ A) @ rng.normal(size=p.n)
    return least_squares_residual(A, h, b)


def expand(p: Problem, w: Array) -> Array:
    """Return the accelerations of eq. (14) for a vector w (n,), with the brackets of the equation multiplied out."""
    A, b = matrix(p), vector(p)
    N, X = projector(p), pinv(A)
    return np.asarray(pinv(p.J) @ p.g + N @ X @ b + N @ w - N @ X @ A @ w)


def last_member_alone(p: Problem, w: Array) -> Array:
    """Return the last term of eq. (14), to which the accelerations are equal as the equation is printed."""
    A = matrix(p)
    return np.asarray(projector(p) @ pinv(A) @ A @ w)


def free_vector_off(form: Form, p: Problem) -> float:
    """Return the relative error of the accelerations form(p, w) for a random vector w, ten times as large as the accelerations."""
    return relative(form(p, 10 * np.abs(p.a).max() * draw().normal(size=p.n)), p.a)


def crank_at_start(form: Form) -> float:
    """Return the crank's initial acceleration [rad/s^2] in the paper's example by form(p), a formula for accelerations."""
    return float(form(problems.crank_problems()[0])[CRANK])


def true_crank_at_start() -> float:
    """Return the crank's true initial acceleration [rad/s^2] in the paper's example."""
    return float(crank_slider.states()[0].a[CRANK])


# eqs. (15) and (16)


def rank_off(form: list[int], p: Problem) -> float:
    """Return the error of a claimed rank of N, form[0] n + form[1] m + form[2] r, where r of the m rows of J are independent."""
    sizes = np.linalg.svd(projector(p), compute_uv=False)  # a projector's singular values are 0 or at least 1
    return count_off(form, (p.n, len(p.J), p.rank), int((sizes > 0.5).sum()))


def reverse_order(p: Problem) -> Array:
    """Return the inverse of A = M^(1/2) N by eq. (15) as printed, N^+ M^(-1/2)."""
    return pinv(projector(p)) @ power(p.M, -0.5)


def normal_inverse(p: Problem) -> Array:
    """Return the Moore-Penrose inverse of A = M^(1/2) N from the normal equations: (N M N)^+ M^(1/2)."""
    N = projector(p)
    return pinv(N @ p.M @ N) @ power(p.M, 0.5)


def inverse_off(form: Form, p: Problem) -> float:
    """Return the relative error of form(p), an inverse of A = M^(1/2) N, against the Moore-Penrose inverse by singular values."""
    return relative(form(p), pinv(power(p.M, 0.5) @ projector(p)))


def free_motion(p: Problem) -> Array:
    """Return the accelerations M^-1 (Q - f) without constraints, which are those of eq. (16) if N N^-1 is the unit matrix."""
    return np.asarray(np.linalg.solve(p.M, p.Q - p.f))


def euclidean(p: Problem) -> Array:
    """Return the accelerations by eq. (16), with Moore-Penrose inverses in place of J^- and N^-1."""
    return yuan_ge_eq16(p.terms).a


def final_of_14(p: Problem) -> Array:
    """Return the accelerations by eq. (14) with corrected exponents of M."""
    return gauss_pinv(p.terms).a


def accelerations_off(form: Form, on: str = "") -> float:
    """Return the largest relative error of form(p) on all problems, or on those of the kind `on` (`special_problems`)."""
    cases = problems.special_problems(on) if on else problems.all_problems()
    return worst([acceleration_off(form, p) for p in cases])


def constraints_off(form: Form, p: Problem) -> float:
    """Return the residual of the constraints J a = g, eq. (6), for the accelerations a = form(p), relative to the terms of J a."""
    return float(np.abs(p.J @ form(p) - p.g).max() / (np.abs(p.J) @ np.abs(form(p))).max())


def difference_off(factor: float, p: Problem) -> float:
    """Return the difference of `factor` times -N M^-1 J^T lambda from a_true - a_(16), relative to the accelerations."""
    wrong = euclidean(p)
    predicted = -projector(p) @ np.linalg.solve(p.M, p.J.T @ p.multipliers)
    scale = max(np.abs(wrong).max(), np.abs(p.a).max(), np.abs(free_motion(p)).max())
    return float(np.abs(factor * predicted - (p.a - wrong)).max() / scale)
