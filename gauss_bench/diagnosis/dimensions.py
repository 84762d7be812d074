"""A pin that is elsewhere in its link than the linkage file says: the gap that it leaves turns with the link.

With a pin of link a off by d (2,) in the frame of that link, an engine that closes its own loops leaves, by the dimensions of the
file, the gap

    phi(t) = R(theta_a(t)) d + c

where c is 0 once the engine's loops are closed, and -R(theta_a(0)) d where its start was that of the file and nothing closes them.
Neither depends on the step or on any force. The file's own dimensions are all that is asked; c alone is a pin of the ground.
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.diagnosis.motion import OwnMotion
from gauss_bench.mechanism.model import GROUND
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

FITS = 0.999  # of the squares of a gap
SAME = 0.05  # of the size of a pin's offset: how well two steps agree on it
TURNS = 1e-2  # relative: how far a link has to turn so that a gap that turns with it is no constant one


@dataclass(frozen=True)
class Misplaced:
    """A pin of a link.

    Attributes:
        joint, link: names; off: (2,) [m] in the frame of the link; share: of the squares of the gap that it explains.
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
    """The pin that explains all gaps of two runs alike, whose steps differ; None where none does."""
    one, other = (_explain(own, x) for x in (coarse, fine))
    if one is None or other is None or (one.joint, one.link) != (other.joint, other.link):
        return None
    return other if np.hypot(*(one.off - other.off)) <= SAME * np.hypot(*other.off) else None


def _explain(own: OwnMotion, x: States) -> Misplaced | None:
    """The best of all pins, where the gap of its joint is nearly all there is."""
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
    """d (2,) of gap (k, 2) = +-R(theta) d + c, and the squares that are left; no d where it is no more than c."""
    cosine, sine, one, none = np.cos(theta), np.sin(theta), np.ones_like(theta), np.zeros_like(theta)
    A = np.concatenate([np.stack([cosine, -sine, one, none], axis=1), np.stack([sine, cosine, none, one], axis=1)])
    b = gap.T.ravel()
    if np.ptp(theta) < TURNS:
        return np.zeros(2), float(b @ b)
    solution = np.linalg.lstsq(A, b, rcond=None)[0]
    left = b - A @ solution
    return solution[:2], float(left @ left)
