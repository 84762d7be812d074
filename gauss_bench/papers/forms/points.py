"""Men et al. (2009), section 1: the shaper by its loops and by its points, at true positions of the linkage file.

    r1 e(th1) + r2 e(th2) = r3 e(th3),   r4 e(th4) + r5 e(th5) = r6 e(th6) + r7 e(th7)                                (1)
    |B - O1| = L_O1B,   |C - B| = L_BC,   (X_A - X_B)/(Y_A - Y_B) = (X_O1 - X_B)/(Y_O1 - Y_B)                         (2)

Points are complex numbers. Link 4 is link 3 as far as B, so that th4 = th3; th6 and th7 are the frame's and the slide's directions.
The lever turns about O1 and carries B; the block A slides on it and is driven by the crank about O2; the rod joins B to the ram C.
The argument `form` of a measure is the equation, the data or the number that is tested, as printed or as corrected.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from gauss_bench.kinematics.basins import basins
from gauss_bench.kinematics.point_equations import PointModel
from gauss_bench.kinematics.root_finding import newton_raphson
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.papers.audit import worst
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.terms import Array

POSITIONS = 72  # number of positions of a turn, 5 degrees apart
SEED, STARTS = 2009, 100  # seed and number of random starts
NEAREST = 1e-6  # [rad] least angle from the direction in which the quotient is undefined; nearer, positions show rounding
SAME = 1e-6  # [m] largest distance of equal points, far below the distance of two assemblies


@dataclass(frozen=True)
class Shaper:
    """Positions of the points in the plane as complex numbers [m], and lengths of lever and rod [m]."""

    O1: complex
    O2: complex
    A: complex
    B: complex
    C: complex
    lever: float
    rod: float

    def turn(self, angle: float) -> "Shaper":
        """Return the whole drawing turned about O1."""
        rotation = np.exp(1j * angle)
        O2, A, B, C = (self.O1 + complex(rotation * (point - self.O1)) for point in (self.O2, self.A, self.B, self.C))
        return replace(self, O2=O2, A=A, B=B, C=C)


@cache
def load_shaper() -> Mechanism:
    """Load the linkage file of the shaper in its driven scenario."""
    return load("shaper", "driven")


@cache
def turn_states() -> Array:
    """Return q (POSITIONS, n) over a driven turn."""
    mechanism = load_shaper()
    motion, angles = MinimalCoordinate(mechanism), 2 * np.pi * np.arange(POSITIONS) / POSITIONS
    return np.concatenate([motion.geometry(np.array([angle]))[0] for angle in angles])


@cache
def shapers() -> tuple[Shaper, ...]:
    """Return the shaper at POSITIONS angles of a driven turn."""
    shaper, q = load_shaper(), turn_states()
    O1, O2 = (complex(*shaper.ground_points[name]) for name in ("O1", "O2"))
    points = {link.name: link.points for link in shaper.links}
    lever = float(np.linalg.norm(points["lever"]["B"] - points["lever"]["O1"]))
    rod = float(np.linalg.norm(points["rod"]["C"] - points["rod"]["B"]))
    # x + i y of each point, (POSITIONS,) each
    A, B, C = (position(q, shaper.find_point(name)) @ [1, 1j] for name in ("block.A", "lever.B", "ram.C"))
    return tuple(Shaper(O1, O2, complex(a), complex(b), complex(c), lever, rod) for a, b, c in zip(A, B, C, strict=True))


def cross(a: complex, b: complex) -> float:
    """Return the cross product of two vectors, a_x b_y - a_y b_x."""
    return (a.conjugate() * b).imag


def sides(x: Shaper) -> tuple[complex, complex]:
    """Return the residuals of both loops (1) with th4 = th3, the angles and lengths taken from the positions."""
    r1, r2 = x.O2 - x.O1, x.A - x.O2
    r3 = x.A - x.O1
    e3 = r3 / abs(r3)
    frame, slide = 1j * (x.C - x.O1).imag, (x.C - x.O1).real
    return r1 + r2 - r3, x.lever * e3 + (x.C - x.B) - frame - slide


def loops_off(form: Callable[[Shaper], tuple[complex, complex]], x: Shaper) -> float:
    """Return the largest residual of the loops (1), relative to the length of the lever."""
    return max(map(abs, form(x))) / x.lever


def lengths(x: Shaper) -> tuple[float, float]:
    """Return the residuals of the first two equations (2)."""
    B, C, O1 = x.B, x.C, x.O1
    return (
        (B.real - O1.real) ** 2 + (B.imag - O1.imag) ** 2 - x.lever**2,
        (C.real - B.real) ** 2 + (C.imag - B.imag) ** 2 - x.rod**2,
    )


def lengths_off(form: Callable[[Shaper], tuple[float, float]], x: Shaper) -> float:
    """Return the largest residual of the first two equations (2), relative to the square of the lever's length."""
    return max(map(abs, form(x))) / x.lever**2


def basic_off(form: list[str]) -> float:
    """Return the range, relative to the stroke, that a coordinate has over a turn of the crank; it is claimed to be constant.

    Args:
        form: name of the point, and "real" for its x or "imag" for its y.
    """
    point, axis = form
    values = [getattr(getattr(x, point), axis) for x in shapers()]
    return float(np.ptp(values) / np.ptp([x.C.real for x in shapers()]))


def collinear_off(form: list[str], x: Shaper) -> float:
    """Return the sine of the angle at the first of the three points named in `form`, which are claimed to lie on one line."""
    a, b, c = (getattr(x, name) for name in form)
    return float(abs(cross(b - a, c - a)) / (abs(b - a) * abs(c - a)))


def quotient(O1: complex, A: complex, B: complex) -> float:
    """Return the residual of the third equation (2) as printed: it divides by zero if the lever is horizontal."""
    return (A.real - B.real) / (A.imag - B.imag) - (O1.real - B.real) / (O1.imag - B.imag)


def product(O1: complex, A: complex, B: complex) -> float:
    """Return the residual of the third equation (2) as a cross product of unit vectors, which is defined in every position."""
    return cross(A - B, O1 - B) / (abs(A - B) * abs(O1 - B))


Line3 = Callable[[complex, complex, complex], float]  # residual of the third equation (2), O1, A and B on one line


def line_off(form: Line3) -> float:
    """Return the largest residual of the third equation (2) at true positions with the lever nearly parallel to an axis.

    There the quotient as printed is ill-conditioned. At four positions of the turn, the whole drawing is turned until the lever is
    NEAREST to 0.5 rad from each axis.
    """
    near = np.geomspace(NEAREST, 0.5, 12)
    errors = []
    for x in shapers()[:: POSITIONS // 4]:
        lever = float(np.angle(x.B - x.O1))
        for axis in np.arange(4) * np.pi / 2:
            for angle in (*(axis + near), *(axis - near)):
                y = x.turn(float(angle) - lever)
                errors.append(abs(form(y.O1, y.A, y.B)))
    return worst(errors)


def search_off(form: Line3) -> float:
    """Return the share of positions at which Newton's method, started at the position before, does not find B.

    `form` is the third equation (2). Positions are 5 degrees of the crank apart. The shaper is tested as drawn, with its lever near
    the vertical, and turned onto its side, with its lever near the horizontal.
    """
    return sum(count_lost(form, [x.turn(angle) for x in shapers()]) for angle in (0.0, np.pi / 2)) / (2 * POSITIONS)


def count_lost(form: Line3, places: Sequence[Shaper]) -> int:
    """Count the positions of a turn at which Newton's method, started at the position before, does not find B.

    It solves |B - O1| = lever and the third equation (2) as `form` for the two coordinates of B.
    """
    failed = 0
    for before, x in zip(places, [*places[1:], places[0]], strict=True):

        def residual(p: Array, x: Shaper = x) -> tuple[Array, Array]:  # the default keeps the x of this iteration
            """Return the residuals (2,) and their Jacobian (2, 2), by central differences, at the coordinates p (2,) of B."""

            def equations(place: Array) -> Array:
                """Return the residuals of both equations with B at a place (2,)."""
                B = complex(place[0], place[1])
                return np.array([(abs(B - x.O1) / x.lever) ** 2 - 1, form(x.O1, x.A, B)])

            steps = 1e-7 * np.eye(2)
            return equations(p), np.stack([(equations(p + h) - equations(p - h)) / 2e-7 for h in steps], axis=1)

        with np.errstate(all="ignore"):
            root = newton_raphson(residual, np.array([before.B.real, before.B.imag]), 1e-10)
        failed += not abs(complex(*root.x) - x.B) < SAME
    return failed


def from_before() -> float:
    """Return the largest distance [m] that an unknown point moves between two positions 5 degrees apart."""
    model = PointModel(load_shaper())
    unknown = np.array([model.points.unknown_at(q) for q in turn_states()])
    return float(np.abs(unknown - np.roll(unknown, 1, axis=0)).max())


def starts_off(form: Callable[[], float]) -> float:
    """Return the share of random starts from which the worse of Gauss-Newton and Levenberg-Marquardt misses the assembly.

    `form` returns the largest distance [m] of the random starts from the assembly.
    """
    radius = form()
    searches = basins(load_shaper(), [radius], STARTS, SEED)
    return worst([1 - basin.right for basin in searches if basin.method != "newton_raphson"])
