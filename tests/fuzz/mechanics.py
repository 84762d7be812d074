"""Compute motions of linkages by other equations than the suite's: those of `second_derivation`, and one linear system.

    M a + J^T lambda = Q,    J a = gamma

with rows and columns scaled by the masses, integrated by scipy's DOP853 at two tolerances. Only the numbers of the linkage and its
start come from the suite, and a start that does not close in these equations is refused.
"""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from gauss_bench.linkage.load import load_document
from gauss_bench.mechanism.model import Torque
from tests.second_derivation import equations

Array = NDArray[np.float64]
TOLERANCES = (1e-11, 1e-9)
MOST = 5_000  # evaluations of the equations: what needs more is too stiff to be known here
CLOSED = 1e-7  # [m, rad, m/s, rad/s] of a start


class NoMotion(Exception):
    """The motion cannot be computed; the message says why."""


class Mechanics:
    """The equations of a document's linkage, in x, y of each centre of mass and the angle of each link, in the file's order."""

    def __init__(self, document: dict[str, Any], scenario: str):
        mechanism = load_document(document, scenario)
        self.mass, self.evaluations = mechanism.mass, 0
        e = equations(mechanism)
        self._equations = ca.Function("equations", [e.q, e.v], [e.phi, e.J, e.gamma, e.Q])
        self._power = ca.Function("power", [e.q, e.v], [e.power])
        still = equations(replace(mechanism, forces=tuple(f for f in mechanism.forces if not isinstance(f, Torque))))
        self._potential = ca.Function("potential", [still.q], [still.potential])
        self._of_torques = ca.Function("of_torques", [e.q], [ca.substitute(still.potential, still.q, e.q) - e.potential])

    def rows(self, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return the gaps of the joints (m,), their Jacobian (m, n), and gamma (m,) of J a = gamma."""
        phi, J, gamma, _ = (np.array(x) for x in self._equations(q, v))
        return phi[:, 0], J, gamma[:, 0]

    def potential(self, q: Array) -> float:
        """Return the energy [J] of weights and springs."""
        return float(self._potential(q))

    def torque_work(self, q: Array) -> float:
        """Return the work [J] of constant torques from angle zero."""
        return float(self._of_torques(q))

    def power(self, q: Array, v: Array) -> float:
        """Return the power [W] of dampers, which is negative."""
        return float(self._power(q, v))

    def acceleration(self, q: Array, v: Array) -> Array:
        self.evaluations += 1
        if self.evaluations > MOST:
            raise NoMotion(f"more than {MOST} evaluations")
        _, J, gamma, Q = (np.array(x) for x in self._equations(q, v))
        root = np.sqrt(self.mass)
        scaled = J / root
        size = np.linalg.norm(scaled, axis=1)
        scaled, right = scaled / size[:, None], gamma[:, 0] / size
        n, m = len(q), len(right)
        whole = np.block([[np.eye(n), scaled.T], [scaled, np.zeros((m, m))]])
        found = np.linalg.solve(whole, np.concatenate([Q[:, 0] / root, right]))
        return np.asarray(found[:n] / root)

    def motion(self, q: Array, v: Array, until: float, tolerance: float) -> Array:
        """Return q (n,) at the end from q and v at the start."""
        n, self.evaluations = len(q), 0

        def rate(t: float, y: Array) -> Array:
            return np.concatenate([y[n:], self.acceleration(y[:n], y[n:])])

        found = solve_ivp(rate, (0.0, until), np.concatenate([q, v]), method="DOP853", rtol=tolerance, atol=tolerance)
        if not found.success:
            raise NoMotion(found.message)
        return np.asarray(found.y[:n, -1])


def true_end(document: dict[str, Any], scenario: str, q: Array, v: Array, until: float) -> tuple[Array, float]:
    """Return the positions at the end (n,) and their error bar.

    Raises:
        NoMotion: it is not known, or the start does not close.
    """
    mechanics = Mechanics(document, scenario)
    gap, J, _ = mechanics.rows(q, v)
    opened = max(np.abs(gap).max(), np.abs(J @ v).max())
    if opened > CLOSED:
        raise NoMotion(f"the start is open by {opened:.1e}")
    try:
        with np.errstate(all="ignore"):
            one, other = (mechanics.motion(q, v, until, x) for x in TOLERANCES)
    except (np.linalg.LinAlgError, ValueError, ArithmeticError) as error:
        raise NoMotion(str(error)) from error
    return one, float(np.abs(one - other).max())
