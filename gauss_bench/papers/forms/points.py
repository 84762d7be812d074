"""Men et al. (2009), section 1: equations of the shaper linkage, tested at true positions of the linkage file.

The paper describes the shaper by two loop equations (1) between vectors r e(th), and by three equations (2) between its points:

    r1 e(th1) + r2 e(th2) = r3 e(th3),   r4 e(th4) + r5 e(th5) = r6 e(th6) + r7 e(th7)                                (1)
    |B - O1| = L_O1B,   |C - B| = L_BC,   (X_A - X_B)/(Y_A - Y_B) = (X_O1 - X_B)/(Y_O1 - Y_B)                         (2)

The lever turns about O1 on the frame and carries the pin B. The block A slides on the lever and is driven by the crank about O2.
The rod joins B to C on the ram. Points are complex numbers here. Vectors 3 and 4 lie along the lever, from O1 to A and to B, so
that th4 = th3; th6 and th7 are the directions of the frame and of the slide. The argument `form` of a measure is the equation, the
data or the number that is tested.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from gauss_bench.kinematics.basins import basins
from gauss_bench.kinematics.point_equations import PointModel
from gauss_bench.kinematics.root_finding import newton_raphson
from gauss_bench.kinematics.synthesis import cross
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.papers.audit import worst
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.terms import Array

POSITIONS = 72  # number of positions of the linkage in a turn of the crank, 5 degrees of crank angle apart
SEED, STARTS = 2009, 100  # seed and number of random starts
NEAREST = 1e-6  # [rad] least angle from the direction in which the quotient is undefined; at smaller angles rounding prevails
SAME = 1e-6  # [m] distance up to which points count as equal, far below the distance of two assemblies


@dataclass(frozen=True)
class Shaper:
    """The shaper in one position: its points in the plane as complex numbers [m], and the lengths of lever and rod [m]."""

    O1: complex
    O2: complex
    A: complex
    B: complex
    C: complex
    lever: float
    rod: float

    def turn(self, angle: float) -> "Shaper":
        """Return the shaper turned about O1 by an angle [rad]."""
        rotation = np.exp(1j * angle)
        O2, A, B, C = (self.O1 + complex(rotation * (point - self.O1)) for point in (self.O2, self.A, self.B, self.C))
        return replace(self, O2=O2, A=A, B=B, C=C)


@cache
def load_shaper() -> Mechanism:
    """Load the linkage file of the shaper in its driven scenario."""
    return load("shaper", "driven")


@cache
def positions_of_turn() -> Array:
    """Return the positions q (POSITIONS, n) of the shaper at equally spaced angles of one turn of its driven crank."""
    motion, angles = MinimalCoordinate(load_shaper()), 2 * np.pi * np.arange(POSITIONS) / POSITIONS
    return np.concatenate([motion.geometry(np.array([angle]))[0] for angle in angles])


@cache
def shapers() -> tuple[Shaper, ...]:
    """Return the shaper in POSITIONS positions of one turn of its driven crank."""
    shaper, q = load_shaper(), positions_of_turn()
    O1, O2 = (complex(*shaper.ground_points[name]) for name in ("O1", "O2"))
    points = {link.name: link.points for link in shaper.links}
    lever = float(np.linalg.norm(points["lever"]["B"] - points["lever"]["O1"]))
    rod = float(np.linalg.norm(points["rod"]["C"] - points["rod"]["B"]))
    # x + i y of each point, (POSITIONS,) each
    A, B, C = (position(q, shaper.find_point(name)) @ [1, 1j] for name in ("block.A", "lever.B", "ram.C"))
    return tuple(Shaper(O1, O2, complex(a), complex(b), complex(c), lever, rod) for a, b, c in zip(A, B, C, strict=True))


def sides(x: Shaper) -> tuple[complex, complex]:
    """Return the residuals of both loop equations (1) with th4 = th3; angles and lengths are those at the position x."""
    r1, r2 = x.O2 - x.O1, x.A - x.O2
    r3 = x.A - x.O1
    e3 = r3 / abs(r3)
    frame, slide = 1j * (x.C - x.O1).imag, (x.C - x.O1).real
    return r1 + r2 - r3, x.lever * e3 + (x.C - x.B) - frame - slide


def loops_off(form: Callable[[Shaper], tuple[complex, complex]], x: Shaper) -> float:
    """Return the larger residual of the two loop equations (1), which `form` computes, relative to the length of the lever."""
    return max(map(abs, form(x))) / x.lever


def lengths(x: Shaper) -> tuple[float, float]:
    """Return |B - O1|^2 - L_O1B^2 and |C - B|^2 - L_BC^2 [m^2], the residuals of the first two of eqs. (2) with squared lengths."""
    B, C, O1 = x.B, x.C, x.O1
    lever = (B.real - O1.real) ** 2 + (B.imag - O1.imag) ** 2 - x.lever**2
    return lever, (C.real - B.real) ** 2 + (C.imag - B.imag) ** 2 - x.rod**2


def lengths_off(form: Callable[[Shaper], tuple[float, float]], x: Shaper) -> float:
    """Return the larger of the two residuals form(x), as in `lengths`, divided by the square of the lever's length."""
    return max(map(abs, form(x))) / x.lever**2


def basic_off(form: list[str]) -> float:
    """Return the range, over a turn of the crank, of a coordinate that is said to be constant, divided by the stroke of the ram.

    `form` has the name of the point, and "real" for its x coordinate or "imag" for its y coordinate.
    """
    point, axis = form
    values = [getattr(getattr(x, point), axis) for x in shapers()]
    return float(np.ptp(values) / np.ptp([x.C.real for x in shapers()]))


def collinear_off(form: list[str], x: Shaper) -> float:
    """Return the sine of the angle at the first of the three points named in `form`, which are claimed to lie on one line."""
    a, b, c = (getattr(x, name) for name in form)
    return float(abs(cross(b - a, c - a)) / (abs(b - a) * abs(c - a)))


# function of O1, A and B that returns the residual of the third of eqs. (2), which states that the three points are collinear
LineEquation = Callable[[complex, complex, complex], float]


def quotient(O1: complex, A: complex, B: complex) -> float:
    """Return the residual of the third of eqs. (2) as printed; it divides by zero if the lever is horizontal."""
    return (A.real - B.real) / (A.imag - B.imag) - (O1.real - B.real) / (O1.imag - B.imag)


def product(O1: complex, A: complex, B: complex) -> float:
    """Return the residual of the third of eqs. (2) as a cross product of unit vectors, defined in every position."""
    return cross(A - B, O1 - B) / (abs(A - B) * abs(O1 - B))


def line_off(form: LineEquation) -> float:
    """Return the largest residual `form` of the third of eqs. (2) at true positions with the lever nearly parallel to an axis.

    The whole linkage is rotated, at four positions of its turn, so that the lever has angles from NEAREST to 0.5 rad to either side
    of each axis.
    """
    offsets = np.geomspace(NEAREST, 0.5, 12)  # [rad] from an axis
    errors = []
    for x in shapers()[:: POSITIONS // 4]:
        lever = float(np.angle(x.B - x.O1))
        for axis in np.arange(4) * np.pi / 2:
            for angle in (*(axis + offsets), *(axis - offsets)):
                turned = x.turn(float(angle) - lever)
                errors.append(abs(form(turned.O1, turned.A, turned.B)))
    return worst(errors)


def find_pin(form: LineEquation, x: Shaper, start: complex) -> complex:
    """Return the position of the pin B that Newton's method finds from `start`, the solution of |B - O1| = L_O1B and `form` = 0."""

    def residuals(place: Array) -> Array:
        """Return the residuals (2,) of the lever's length and of `form` with B at a position (2,)."""
        B = complex(place[0], place[1])
        return np.array([(abs(B - x.O1) / x.lever) ** 2 - 1, form(x.O1, x.A, B)])

    def equations(place: Array) -> tuple[Array, Array]:
        """Return the residuals (2,) and their Jacobian (2, 2) by central differences."""
        steps = 1e-7 * np.eye(2)  # [m]
        return residuals(place), np.stack([(residuals(place + h) - residuals(place - h)) / 2e-7 for h in steps], axis=1)

    with np.errstate(all="ignore"):
        return complex(*newton_raphson(equations, np.array([start.real, start.imag]), 1e-10).x)


def search_off(form: LineEquation) -> float:
    """Return the share of positions at which `find_pin`, started at the previous position, does not find the pin B within SAME.

    The shaper is tested as it is drawn, with its lever near the vertical, and rotated by 90 degrees.
    """
    missed = 0
    for angle in (0.0, np.pi / 2):
        turned = [x.turn(angle) for x in shapers()]
        for previous, x in zip(turned, [*turned[1:], turned[0]], strict=True):
            missed += not abs(find_pin(form, x, previous.B) - x.B) < SAME  # also if the result is NaN
    return missed / (2 * POSITIONS)


def change_between_positions() -> float:
    """Return the largest change [m] of an unknown coordinate of the point equations between two of the POSITIONS."""
    model = PointModel(load_shaper())
    unknown = np.array([model.points.unknown_at(q) for q in positions_of_turn()])
    return float(np.abs(unknown - np.roll(unknown, 1, axis=0)).max())


def starts_off(form: Callable[[], float]) -> float:
    """Return the larger share of random starts from which Gauss-Newton or Levenberg-Marquardt misses the assembled position.

    form() is the largest distance [m] of the starts from it.
    """
    searches = basins(load_shaper(), [form()], STARTS, SEED)
    return worst([1 - basin.right for basin in searches if basin.method != "newton_raphson"])
