"""Verification of a certificate in double precision: cheap, and independent of the code that made it.

Windows spread over the whole motion are integrated again by DOP853, each from the certified state at its beginning to the certified
state at its end, so that errors cannot grow over the run. All samples must lie on the constraints and obey M a + J^T lambda = Q
with the certified forces.
"""

from dataclasses import dataclass, replace

import numpy as np

from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import absolute_motion, is_minimal, minimal_motion
from gauss_bench.reference.certificate import Certificate
from gauss_bench.terms import Array

WINDOWS = 12
WINDOW = 0.05  # [s] at most: some turns of nothing, so that DOP853 at 1e-13 stays near 1e-12
STATE_LIMIT = 1e-10  # relative: a hundred times what DOP853 leaves in a window; a parameter off by 1e-8 shows
BALANCE_LIMIT = 1e-10  # relative: rounding of accelerations, times the condition of the terms


@dataclass(frozen=True)
class Verification:
    """The findings of verifying one certificate.

    Attributes:
        mechanism, scenario: what it holds for.
        until, digits: as the certificate says.
        windows: how many were integrated again.
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
        return self.state_error < STATE_LIMIT and self.balance_error < BALANCE_LIMIT


def verify(certificate: Certificate, mechanism: Mechanism) -> Verification:
    """Check a certificate that holds for the mechanism.

    Raises:
        ArithmeticError: a window cannot be integrated.
    """
    count, state = _windows(certificate, mechanism)
    balance = _balance(certificate, mechanism)
    return Verification(
        certificate.name, certificate.scenario, certificate.until, certificate.digits, count, float(state), float(balance)
    )


def _windows(certificate: Certificate, mechanism: Mechanism) -> tuple[int, float]:
    t = certificate.t
    starts = np.unique(np.linspace(0, max(len(t) - 2, 0), WINDOWS).astype(int))
    integrate = minimal_motion if is_minimal(mechanism) and not mechanism.drivers else absolute_motion
    worst, done = 0.0, 0
    for k in starts:
        length = min(WINDOW, t[-1] - t[k])
        end = int(np.searchsorted(t, t[k] + length * (1 + 1e-9), side="right")) - 1
        if end <= k:
            end = min(k + 1, len(t) - 1)
        if end == k:
            continue
        here = replace(mechanism, q0=certificate.q[k], v0=certificate.v[k])
        q, v, _ = integrate(here, t[[k, end]] - (0.0 if mechanism.drivers else t[k]))
        worst = max(worst, _off(q[-1:], certificate.q[[end]], certificate.q), _off(v[-1:], certificate.v[[end]], certificate.v))
        done += 1
    return done, worst


def _off(computed: Array, stated: Array, scale: Array | None = None) -> float:
    return float(np.abs(computed - stated).max() / max(1.0, float(np.abs(stated if scale is None else scale).max())))


def _balance(certificate: Certificate, mechanism: Mechanism) -> float:
    """Return the largest relative residual of phi, J v + phi_t, J a - gamma and M a + J^T lambda - Q over all samples."""
    evaluator = Evaluator(mechanism)
    t, q, v, a = certificate.t, certificate.q, certificate.v, certificate.a
    rows = evaluator.constraints(t, q, v)
    size = np.abs(rows.J)
    pairs = [
        (rows.phi[:, : evaluator.constraints.holonomic], 1.0 + np.abs(q).max()),
        ((rows.J @ v[..., None])[..., 0] + rows.phi_t, 1.0 + (size @ np.abs(v)[..., None]).max(initial=0.0)),
        ((rows.J @ a[..., None])[..., 0] - rows.gamma, 1.0 + (size @ np.abs(a)[..., None]).max(initial=0.0)),
    ]
    if certificate.multipliers.shape[1]:
        Q = evaluator.applied.generalised(q, v)
        force = (np.swapaxes(rows.J, -1, -2) @ certificate.multipliers[..., None])[..., 0]
        left = a * evaluator.mass + force - Q
        pairs.append((left, 1.0 + np.abs(a * evaluator.mass).max() + np.abs(force).max() + np.abs(Q).max()))
    return max(float(np.abs(x).max(initial=0.0) / scale) for x, scale in pairs)
