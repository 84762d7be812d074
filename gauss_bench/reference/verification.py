"""Verification of a certificate in double precision, which is cheap, and independent of the code that made the certificate.

Several short intervals of the motion (windows) are integrated again by DOP853, each from a certified state to a later one, so that
errors do not grow over the whole motion. All samples must satisfy the constraints, and the equations of motion M a + J^T lambda = Q
with the certified multipliers.
"""

from dataclasses import dataclass, replace

import numpy as np

from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import absolute_motion, is_minimal, minimal_motion
from gauss_bench.reference.certificate import Certificate

WINDOWS = 12  # number of windows, spread over the motion
WINDOW = 0.05  # [s] longest window: a small part of a turn, over which DOP853 at 1e-13 keeps errors near 1e-12
STATE_LIMIT = 1e-10  # largest relative error: a hundred times that of DOP853; parameters wrong by 1e-8 give more
BALANCE_LIMIT = 1e-10  # largest relative residual: rounding of accelerations, times the condition of the terms


@dataclass(frozen=True)
class Verification:
    """The result of verifying one certificate.

    Attributes:
        mechanism, scenario: names of the linkage and the scenario.
        until: end of the certified motion [s].
        digits: number of certified digits.
        windows: number of short time intervals that were integrated again, each from a certified state.
        state_error: largest error of positions or velocities at the end of such an interval, relative to the largest position or
            velocity of the motion, or to 1 if that is larger.
        balance_error: largest residual of the constraints and of the equations of motion, relative to the size of their terms.
    """

    mechanism: str
    scenario: str
    until: float
    digits: int
    windows: int
    state_error: float
    balance_error: float

    @property
    def passed(self) -> bool:
        """Whether both errors are below their limits."""
        return self.state_error < STATE_LIMIT and self.balance_error < BALANCE_LIMIT


def verify(certificate: Certificate, mechanism: Mechanism) -> Verification:
    """Integrate parts of a certified motion again, evaluate its equations, and return the largest errors of both checks.

    Raises:
        ArithmeticError: a window cannot be integrated.
    """
    x = certificate
    errors = *_integrate_windows(x, mechanism), _largest_residual(x, mechanism)
    return Verification(x.name, x.scenario, x.until, x.digits, *errors)


def _integrate_windows(certificate: Certificate, mechanism: Mechanism) -> tuple[int, float]:
    """Integrate the motion again over short windows, each from a sample of the certificate.

    Return the number of windows, and the largest difference from the certified state at the end of a window, relative to the
    largest position or velocity (or 1).
    """
    t = certificate.t
    starts = np.unique(np.linspace(0, max(len(t) - 2, 0), WINDOWS).astype(int))  # indices of samples
    integrate = minimal_motion if is_minimal(mechanism) and not mechanism.drivers else absolute_motion
    worst, count = 0.0, 0
    for k in starts:
        length = min(WINDOW, t[-1] - t[k])
        end = int(np.searchsorted(t, t[k] + length * (1 + 1e-9), side="right")) - 1
        if end <= k:  # samples are farther apart than a window: it ends at the next sample
            end = min(k + 1, len(t) - 1)
        if end == k:  # the motion has a single sample
            continue
        started = replace(mechanism, q0=certificate.q[k], v0=certificate.v[k])
        # only drivers depend on time; without them every window begins at time 0
        q, v, _ = integrate(started, t[[k, end]] - (0.0 if mechanism.drivers else t[k]))
        for computed, certified in ((q, certificate.q), (v, certificate.v)):
            error = np.abs(computed[-1] - certified[end]).max()
            worst = max(worst, float(error / max(1.0, np.abs(certified).max())))
        count += 1
    return count, worst


def _largest_residual(certificate: Certificate, mechanism: Mechanism) -> float:
    """Return the largest relative residual of constraints and equations of motion over all samples of a certificate.

    The forces are left out if the certificate has no multipliers, because redundant constraint rows leave them undetermined.
    """
    evaluator = Evaluator(mechanism)
    t, q, v, a = certificate.t, certificate.q, certificate.v, certificate.a
    rows = evaluator.constraints(t, q, v)
    abs_J = np.abs(rows.J)
    pairs = [  # each residual, and the size of its terms; 1 is added, so that residuals of small terms are judged absolutely
        (rows.phi[:, : evaluator.constraints.holonomic], 1.0 + np.abs(q).max()),
        ((rows.J @ v[..., None])[..., 0] + rows.phi_t, 1.0 + (abs_J @ np.abs(v)[..., None]).max(initial=0.0)),
        ((rows.J @ a[..., None])[..., 0] - rows.gamma, 1.0 + (abs_J @ np.abs(a)[..., None]).max(initial=0.0)),
    ]
    if certificate.multipliers.shape[1]:
        Q = evaluator.applied.generalised(q, v)
        force = (np.swapaxes(rows.J, -1, -2) @ certificate.multipliers[..., None])[..., 0]
        imbalance = a * evaluator.mass + force - Q
        pairs.append((imbalance, 1.0 + np.abs(a * evaluator.mass).max() + np.abs(force).max() + np.abs(Q).max()))
    return max(float(np.abs(x).max(initial=0.0) / scale) for x, scale in pairs)
