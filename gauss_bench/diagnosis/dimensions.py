"""Detect a pin that an engine has at another place in its link than the linkage file: the gap of this pin turns with the link.

Suppose that in an engine a pin of link a is displaced by the vector d (2,) in the frame of that link, and that the engine closes
its loops with the displaced pin. If the gap of this pin is computed from the engine's states with the dimensions of the file, the
gap is

    phi(t) = R(theta_a(t)) d + c

Here R is the rotation by the angle theta_a of link a, and c (2,) is a constant vector. If the engine closes its loops at the start
too, the vector c is 0. If the engine starts from the state of the file and keeps the error of closure that it has there, c is
-R(theta_a(0)) d. Neither the vector d nor the vector c depends on the step or on a force. A displaced pin of the ground causes a
constant gap, which is not detected here.
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.diagnosis.motion import OwnMotion
from gauss_bench.mechanism.model import GROUND
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

FITS = 0.999  # share of the squared gaps that a displaced pin must explain
SAME = 0.05  # relative difference of a pin's displacement between two runs
TURNS = 1e-2  # [rad] least turn of a link that distinguishes a turning gap from a constant one


@dataclass(frozen=True)
class Misplaced:
    """A displaced pin of a link.

    Attributes:
        joint, link: names of the pin and of the link.
        off: displacement (2,) [m] of the pin in the frame of the link.
        share: share of the sum of all squared gaps that this displacement explains.
    """

    joint: str
    link: str
    off: Array
    share: float

    @property
    def sentence(self) -> str:
        """The displaced pin in words."""
        off = ", ".join(f"{x:.2e}" for x in self.off)
        return f"the pin {self.joint} of {self.link} is elsewhere than the file says, by [{off}] m in the frame of {self.link}"


def find_displaced_pin(own: OwnMotion, coarse: States, fine: States) -> Misplaced | None:
    """Return the one pin whose displacement accounts for all gaps of the joints in two runs with different steps, or None.

    The gaps at the states `coarse` and `fine` of the two runs must be explained by the same pin and by about the same displacement
    (up to the relative difference SAME), because a wrong dimension does not depend on the step.
    """
    first, second = (_explain(own, x) for x in (coarse, fine))
    if first is None or second is None or (first.joint, first.link) != (second.joint, second.link):
        return None
    return second if np.hypot(*(first.off - second.off)) <= SAME * np.hypot(*second.off) else None


def _explain(own: OwnMotion, x: States) -> Misplaced | None:
    """Return the pin whose displacement best explains the gaps of the joints at states x.

    Return None if no displaced pin explains the share FITS of the sum of all squared gaps.
    """
    mechanism, gaps = own.mechanism, own.gaps(x)  # (k, rows)
    squares = float((gaps**2).sum())
    found: list[Misplaced] = []
    row = 0
    for joint in mechanism.joints:
        gap = gaps[:, row : row + len(joint.held)]
        row += len(joint.held)
        if joint.slides or not squares:
            continue
        others = squares - float((gap**2).sum())  # squared gaps of other joints, which this pin does not explain
        for point, sign in zip(joint.ends, (1.0, -1.0), strict=True):
            if point.link != GROUND:
                # d: displacement (2,) fitted to the gap of this pin; left: squared gap of this pin that the fit leaves
                d, left = _fit_turning(gap, angle_at(x.q, point.link))
                share = 1.0 - (left + others) / squares
                found.append(Misplaced(joint.name, mechanism.link_name(point.link), sign * d, share))
    best = max(found, key=lambda x: x.share, default=None)
    return best if best is not None and best.share >= FITS else None


def _fit_turning(gap: Array, theta: Array) -> tuple[Array, float]:
    """Fit gap (k, 2) = R(theta) d + c at angles theta (k,) [rad]; return d (2,) [m] and the squared residual [m^2].

    The vector d turns with the link, and the vector c is constant. If the link turns by less than TURNS, the two vectors cannot be
    told apart; then d = 0 and the sum of the squared gaps are returned without a fit.
    """
    cosine, sine, one, none = np.cos(theta), np.sin(theta), np.ones_like(theta), np.zeros_like(theta)
    # (2 k, 4): first the rows of x, then those of y, with the unknowns d_x, d_y, c_x, c_y
    A = np.concatenate([np.stack([cosine, -sine, one, none], axis=1), np.stack([sine, cosine, none, one], axis=1)])
    b = gap.T.ravel()
    if np.ptp(theta) < TURNS:
        return np.zeros(2), float(b @ b)
    solution = np.linalg.lstsq(A, b, rcond=None)[0]
    residual = b - A @ solution
    return solution[:2], float(residual @ residual)
