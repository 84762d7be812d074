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
from gauss_bench.mechanism.model import GROUND, Prismatic
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

FITS = 0.999  # of the squares of a gap
SAME = 0.05  # of the size of a pin's offset: how well two steps agree on it
TURNS = 1e-2  # relative: how far a link has to turn so that a gap that turns with it is no constant one


@dataclass(frozen=True)
class Misplaced:
    """A pin of a link.

    Attributes:
        joint, link: names; off: [m] in the frame of the link; share: of the squares of the gap that it explains.
    """

    joint: str
    link: str
    off: tuple[float, float]
    share: float

    @property
    def size(self) -> float:
        return float(np.hypot(*self.off))

    @property
    def sentence(self) -> str:
        off = ", ".join(f"{x:.2e}" for x in self.off)
        return f"the pin {self.joint} of {self.link} is elsewhere than the file says, by [{off}] m in the frame of {self.link}"


def misplace(own: OwnMotion, coarse: States, fine: States) -> Misplaced | None:
    """The pin that explains all gaps of two runs alike, whose steps differ; None where none does."""
    one, other = (_explain(own, x) for x in (coarse, fine))
    if one is None or other is None or (one.joint, one.link) != (other.joint, other.link):
        return None
    apart = np.hypot(*(np.array(one.off) - np.array(other.off)))
    return other if apart <= SAME * other.size else None


def _explain(own: OwnMotion, x: States) -> Misplaced | None:
    """The best of all pins, where the gap of its joint is nearly all there is."""
    mechanism, gaps = own.mechanism, own.gaps(x)
    squares = float((gaps**2).sum())
    best: Misplaced | None = None
    for k, joint in enumerate(mechanism.joints):
        if isinstance(joint, Prismatic) or not squares:
            continue
        gap = gaps[:, 2 * k : 2 * k + 2]
        for point, sign in ((joint.a, 1.0), (joint.b, -1.0)):
            if point.link == GROUND:
                continue
            d, left = _turning(gap, x.q[:, 3 * point.link + 2])
            share = 1.0 - (left + squares - float((gap**2).sum())) / squares
            if share >= FITS and (best is None or share > best.share):
                best = Misplaced(joint.name, mechanism.link_name(point.link), (sign * float(d[0]), sign * float(d[1])), share)
    return best


def _turning(gap: Array, theta: Array) -> tuple[Array, float]:
    """d (2,) of gap (k, 2) = +-R(theta) d + c, and the squares that are left; no d where it is no more than c."""
    cosine, sine, one, none = np.cos(theta), np.sin(theta), np.ones_like(theta), np.zeros_like(theta)
    A = np.concatenate([np.stack([cosine, -sine, one, none], axis=1), np.stack([sine, cosine, none, one], axis=1)])
    b = np.concatenate([gap[:, 0], gap[:, 1]])
    if np.ptp(theta) < TURNS:
        return np.zeros(2), float(b @ b)
    solution = np.linalg.lstsq(A, b, rcond=None)[0]
    left = b - A @ solution
    return solution[:2], float(left @ left)
