"""Verification of a certificate in double precision, which is cheap, and independent of the code that made the certificate.

DOP853 integrates windows of the motion again, each from the certified state at its beginning, so that errors do not grow over the
whole motion. The result must be the certified state at the end of the window. All samples must satisfy the constraints and
M a + J^T lambda = Q with the certified multipliers.
"""

from dataclasses import dataclass, replace

import numpy as np

from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import absolute_motion, is_minimal, minimal_motion
from gauss_bench.reference.certificate import Certificate

WINDOWS = 12  # number of windows, spread over the motion
WINDOW = 0.05  # [s] longest window: a small part of a turn, over which DOP853 at 1e-13 keeps errors near 1e-12
STATE_LIMIT = (
    1e-10  # largest relative error: a hundred times that of DOP853 in a window, and less than parameters wrong by 1e-8 give
)
BALANCE_LIMIT = 1e-10  # largest relative residual: rounding of accelerations, times the condition of the terms


@dataclass(frozen=True)
class Verification:
    """The result of verifying one certificate.

    Attributes:
        mechanism, scenario: names of the linkage and the scenario.
        until: end of the certified motion [s].
        digits: number of certified digits.
        windows: number of windows that were integrated again.
        state_error: largest error at the end of a window, relative to the largest value of each level.
        balance_error: largest residual of constraints and of the equations of motion, relative to their terms.
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
        """True if both errors are below their limits."""
        return self.state_error < STATE_LIMIT and self.balance_error < BALANCE_LIMIT


def verify(certificate: Certificate, mechanism: Mechanism) -> Verification:
    """Verify a certificate of the mechanism.

    Raises:
        ArithmeticError: a window cannot be integrated.
    """
    count, state = _integrate_windows(certificate, mechanism)
    balance = _balance(certificate, mechanism)
    return Verification(
        certificate.name, certificate.scenario, certificate.until, certificate.digits, count, float(state), float(balance)
    )


def _integrate_windows(certificate: Certificate, mechanism: Mechanism) -> tuple[int, float]:
    """Integrate again from samples of the certificate, over short intervals of time (windows).

    Return the number of windows, and the largest difference from the certificate at the end of a window, relative to the largest
    value of the positions or velocities.
    """
    t = certificate.t
    starts = np.unique(np.linspace(0, max(len(t) - 2, 0), WINDOWS).astype(int))  # indices of samples
    integrate = minimal_motion if is_minimal(mechanism) and not mechanism.drivers else absolute_motion
    worst, done = 0.0, 0
    for k in starts:
        length = min(WINDOW, t[-1] - t[k])
        end = int(np.searchsorted(t, t[k] + length * (1 + 1e-9), side="right")) - 1
        if end <= k:  # samples are farther apart than a window: it ends at the next sample
            end = min(k + 1, len(t) - 1)
        if end == k:
            continue
        here = replace(mechanism, q0=certificate.q[k], v0=certificate.v[k])
        # only drivers depend on time; without them every window begins at time 0
        q, v, _ = integrate(here, t[[k, end]] - (0.0 if mechanism.drivers else t[k]))
        for found, level in ((q, certificate.q), (v, certificate.v)):
            worst = max(worst, float(np.abs(found[-1] - level[end]).max() / max(1.0, np.abs(level).max())))
        done += 1
    return done, worst


def _balance(certificate: Certificate, mechanism: Mechanism) -> float:
    """Return the largest relative residual of phi, J v + phi_t, J a - gamma and M a + J^T lambda - Q over all samples."""
    evaluator = Evaluator(mechanism)
    t, q, v, a = certificate.t, certificate.q, certificate.v, certificate.a
    rows = evaluator.constraints(t, q, v)
    size = np.abs(rows.J)
    pairs = [  # each residual, and the size of its terms
        (rows.phi[:, : evaluator.constraints.holonomic], 1.0 + np.abs(q).max()),
        ((rows.J @ v[..., None])[..., 0] + rows.phi_t, 1.0 + (size @ np.abs(v)[..., None]).max(initial=0.0)),
        ((rows.J @ a[..., None])[..., 0] - rows.gamma, 1.0 + (size @ np.abs(a)[..., None]).max(initial=0.0)),
    ]
    if certificate.multipliers.shape[1]:
        Q = evaluator.applied.generalised(q, v)
        force = (np.swapaxes(rows.J, -1, -2) @ certificate.multipliers[..., None])[..., 0]
        imbalance = a * evaluator.mass + force - Q
        pairs.append((imbalance, 1.0 + np.abs(a * evaluator.mass).max() + np.abs(force).max() + np.abs(Q).max()))
    return max(float(np.abs(x).max(initial=0.0) / scale) for x, scale in pairs)
