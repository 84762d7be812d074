"""The equations of motion of a linkage in CasADi's symbols: `mechanism/equations.py`, evaluated with symbols instead of numbers.

CasADi differentiates the motion laws. It could differentiate the constraints too, but the Jacobian and the bias of
`mechanism/equations.py` take fewer instructions.
"""

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from gauss_bench.mechanism.equations import ConstraintPlacement, energies, generalise, rows
from gauss_bench.mechanism.model import Mechanism, loads
from gauss_bench.mechanism.motion_laws import Motion, MotionLaw
from gauss_bench.mechanism.spaces import slots

Symbol = Any  # casadi.SX, which has no types


@dataclass(frozen=True, eq=False)
class Equations:
    """Expressions of M a + J^T lambda = Q subject to J a = gamma, in the symbols t, q (n,) and v (n,).

    Attributes:
        phi: (h,) residuals of the holonomic rows [m, rad], for joints, couplings and drivers.
        c: (m,) d phi/dt, then one row for each knife edge [m/s, rad/s].
        mass: (n,) diagonal of M [kg, kg m^2].
        J: (m, n); gamma: (m,).
        Q: (n,) applied forces [N, N m].
        potential: potential energy [J].
        power: power of the forces that have no potential [W].
    """

    t: Symbol
    q: Symbol
    v: Symbol
    phi: Symbol
    c: Symbol
    mass: Symbol
    J: Symbol
    gamma: Symbol
    Q: Symbol
    potential: Symbol
    power: Symbol


class Symbols(ConstraintPlacement):
    """The state of all bodies as symbols t, q (n,) and v (n,), in the form that `mechanism/equations.py` takes."""

    def __init__(self, t: Symbol, q: Symbol, v: Symbol):
        self.t, self.q, self.v = t, q, v
        self.arithmetic = _Arithmetic()

    def body(self, body: int) -> tuple[list[Symbol], list[Symbol]]:
        """Return x, y and angle of a body, and their rates."""
        q, v = ([x[k] for k in range(x.shape[0])[slots(body)]] for x in (self.q, self.v))
        return q, v

    def law(self, law: MotionLaw) -> Motion:
        """Return the value of a motion law at time t and its first two derivatives."""
        x = write_law(law, self.t)
        rate = ca.jacobian(x, self.t)
        return x, rate, ca.jacobian(rate, self.t)


class _Arithmetic:
    """CasADi's functions under the names that `mechanism/equations.py` uses."""

    sqrt, sin, cos = staticmethod(ca.sqrt), staticmethod(ca.sin), staticmethod(ca.cos)

    @staticmethod
    def inverse(x: Symbol) -> Symbol:
        return 1.0 / x


def equations(mechanism: Mechanism) -> Equations:
    """Return the equations of a mechanism without dry friction; the mechanism's numbers may be symbols too."""
    n = mechanism.n
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", n), ca.SX.sym("v", n)
    symbols = Symbols(t, q, v)
    constraint_rows = list(rows(mechanism, symbols))  # m of them
    J, gamma = ca.SX(len(constraint_rows), n), stack([row.gamma for row in constraint_rows])
    for i, row in enumerate(constraint_rows):
        for k, x in row.entries.items():
            J[i, k] = x
    J = ca.sparsify(J)
    Q, potential, power = ca.SX(n, 1), ca.SX(0), ca.SX(0)
    for i, link in enumerate(mechanism.links):
        # the slots of a link are x, y and angle; gravity has no entry for the angle
        for k, g in zip(range(n)[slots(i)], mechanism.gravity, strict=False):
            Q[k] = link.mass * g
            potential -= link.mass * g * q[k]
    for load in loads(mechanism.forces):
        for k, x in generalise(symbols, load).items():
            Q[k] += x
        load_potential, load_power = energies(symbols, load)
        potential, power = potential + load_potential, power + load_power
    mass = stack([x for link in mechanism.links for x in (link.mass, link.mass, link.inertia)])
    phi = stack([row.phi for row in constraint_rows if row.phi is not None])
    c = J @ v + stack([row.phi_t for row in constraint_rows])
    return Equations(t, q, v, phi, c, mass, J, gamma, Q, potential, power)


def stabilize(e: Equations, rate: float) -> Equations:
    """Return the equations with Baumgarte's terms: gamma - 2 alpha c - beta^2 phi, where alpha = beta = rate [1/s]."""
    phi = ca.vertcat(e.phi, ca.SX(e.c.shape[0] - e.phi.shape[0], 1))  # (m,): rows of knife edges have no phi
    return replace(e, gamma=e.gamma - 2 * rate * e.c - rate**2 * phi)


def solution(e: Equations) -> tuple[Symbol, Symbol]:
    """Return accelerations (n,) and multipliers (m,) in closed form, by an L D L^T decomposition of J M^-1 J^T."""
    weighted = e.J / ca.repmat(e.mass.T, e.J.shape[0], 1)
    D, L, order = ca.ldl(weighted @ e.J.T)
    multipliers = ca.ldl_solve(weighted @ e.Q - e.gamma, D, L, order)
    return (e.Q - e.J.T @ multipliers) / e.mass, multipliers


def stack(entries: list[Symbol]) -> Symbol:
    """Return symbols as one column; an empty list gives an empty column."""
    return ca.vertcat(ca.SX(0, 1), *entries)


def write_law(law: MotionLaw, t: Symbol) -> Symbol:
    """Return the value of a motion law at time t as an expression, which CasADi can differentiate."""
    numbers = law.numbers
    if law.name == "constant":
        return numbers["start"] + numbers["speed"] * t
    if law.name == "table":
        return numbers["start"] + cubic_spline(numbers["times"], numbers["angles"], t)
    s = t / numbers["time"]
    rises = {  # as in `mechanism/motion_laws.py`, with CasADi's functions, because those of numpy warn about symbols
        "sine": s - ca.sin(2 * np.pi * s) / (2 * np.pi),
        "cosine": (1 - ca.cos(np.pi * s)) / 2,
        "poly345": 10 * s**3 - 15 * s**4 + 6 * s**5,
    }
    return numbers["start"] + numbers["travel"] * ca.if_else(s < 0, 0, ca.if_else(s > 1, 1, rises[law.name]))


def cubic_spline(times: Any, values: Any, t: Symbol) -> Symbol:
    """Return the value at t of the cubic spline through `values` at `times`, with zero slope at both ends; constant beyond them."""
    from scipy.interpolate import CubicSpline  # imported late: the import takes longer than most runs

    spline = CubicSpline(times, values, bc_type="clamped")
    inner = spline.x[1:-1]  # the times at which two pieces meet
    # four coefficients of the piece at t, the highest power first, and the time at which the piece begins
    a, b, c, d, begin = (ca.pw_const(t, inner, ca.DM(x)) if len(inner) else ca.SX(x[0]) for x in (*spline.c, spline.x[:-1]))
    s = t - begin
    inside = ((a * s + b) * s + c) * s + d
    return ca.if_else(t < times[0], values[0], ca.if_else(t > times[-1], values[-1], inside))
