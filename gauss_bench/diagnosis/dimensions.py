"""Detection of a pin at another place in its link than in the linkage file: its gap turns with the link.

If an engine has a pin of link a displaced by d (2,) in the frame of that link, and closes its own loops, its states leave a gap
with the dimensions of the file:

    phi(t) = R(theta_a(t)) d + c

R is the rotation by the link's angle. c is 0 if the engine closes its loops, and -R(theta_a(0)) d if it starts from the state of
the file and does not close them. Neither depends on the step or on a force. A constant gap c alone belongs to a pin of the ground.
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
        joint, link: names; off: displacement (2,) [m] in the frame of the link; share: share of the squared gaps that it explains.
    """

    joint: str
    link: str
    off: Array
    share: float

    @property
    def sentence(self) -> str:
        off = ", ".join(f"{x:.2e}" for x in self.off)
        return f"the pin {self.joint} of {self.link} is elsewhere than the file says, by [{off}] m in the frame of {self.link}"


def misplace(own: OwnMotion, coarse: States, fine: States) -> Misplaced | None:
    """Return the displaced pin that explains all gaps of two runs with different steps; None if there is none."""
    one, other = (_explain(own, x) for x in (coarse, fine))
    if one is None or other is None or (one.joint, one.link) != (other.joint, other.link):
        return None
    return other if np.hypot(*(one.off - other.off)) <= SAME * np.hypot(*other.off) else None


def _explain(own: OwnMotion, x: States) -> Misplaced | None:
    """Return the pin that explains the gaps best, if it explains at least FITS of their squares."""
    mechanism, gaps = own.mechanism, own.gaps(x)
    squares, at = float((gaps**2).sum()), 0
    found: list[Misplaced] = []
    for joint in mechanism.joints:
        gap, at = gaps[:, at : at + len(joint.held)], at + len(joint.held)
        if joint.slides or not squares:
            continue
        for point, sign in zip(joint.ends, (1.0, -1.0), strict=True):
            if point.link != GROUND:
                d, left = _turning(gap, angle_at(x.q, point.link))
                share = 1.0 - (left + squares - float((gap**2).sum())) / squares
                found.append(Misplaced(joint.name, mechanism.link_name(point.link), sign * d, share))
    best = max(found, key=lambda x: x.share, default=None)
    return best if best is not None and best.share >= FITS else None


def _turning(gap: Array, theta: Array) -> tuple[Array, float]:
    """Fit gap (k, 2) = R(theta) d + c; return d (2,) and the squared residual. If the link hardly turns, d is zero."""
    cosine, sine, one, none = np.cos(theta), np.sin(theta), np.ones_like(theta), np.zeros_like(theta)
    A = np.concatenate([np.stack([cosine, -sine, one, none], axis=1), np.stack([sine, cosine, none, one], axis=1)])
    b = gap.T.ravel()
    if np.ptp(theta) < TURNS:
        return np.zeros(2), float(b @ b)
    solution = np.linalg.lstsq(A, b, rcond=None)[0]
    left = b - A @ solution
    return solution[:2], float(left @ left)
