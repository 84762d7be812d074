"""Applied forces of a linkage: generalised force Q, potential energy, and the power of forces without a potential.

Each force is lowered to loads (`lowered` in model.py): laws on scalar coordinates (formulas in `coordinates.py`) and constant
forces at points. One function is generated for all of them, for a state, q (n,), or a batch, q (..., n). Power without a potential
(dampers, forces that turn with a link) is what the energy balance of a trajectory integrates.

Dry friction stands apart, because it depends on the loads of the joints and with them on the accelerations. With N_k the load that
pair k carries and s its relative speed, the constraint force counts with the active forces (Yuan and Ge, 2016, eq. 3):

    M a + J^T lambda = Q + W N(lambda),    W_k = -mu_k r_k tanh(s_k / speed_k) ds_k/dv        (r_k = 1 for a slide)
    N = |(lambda_x, lambda_y)| of a pin,   N = |lambda_normal| of a slide

W is known from the state, N from lambda, and lambda from a: a fixed point, found by iteration from the motion without friction. It
contracts unless mu is so large that friction feeds the loads that cause it.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from gauss_bench.mechanism import equations
from gauss_bench.mechanism.coordinates import columns, state
from gauss_bench.mechanism.equations import Symbols
from gauss_bench.mechanism.model import Force, Mechanism, factor_of, loads, steady_part
from gauss_bench.mechanism.spaces import Real, places
from gauss_bench.terms import Array


class AppliedForces:
    """Gravity and the active forces of one mechanism.

    Raises:
        TypeError: a force has no `lowered` method.
    """

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        self.gravity = np.zeros(mechanism.n, dtype=mechanism.gravity.dtype)
        for place, link in zip(places(self.gravity), mechanism.links, strict=True):
            place[:] = link.mass * mechanism.gravity
        self.varying = [_Varying(mechanism, f) for f in mechanism.varying]
        self.loads = loads(f for f in mechanism.forces if not factor_of(f))

    def steady(self, at: Symbols) -> list[Real]:
        """Return Q (n,) of all steady forces, as symbols."""
        Q: list[Real] = [at.program.symbol(x) for x in self.gravity]
        for load in self.loads:
            for k, x in equations.generalise(at, load).items():
                Q[k] = Q[k] + x
        return Q

    @cached_property
    def _steady(self) -> Callable[..., list[Array]]:
        at = Symbols(self.mechanism.n)
        return at.written(self.steady(at))

    @cached_property
    def _energies(self) -> Callable[..., list[Array]]:
        """Generate the function for potential energy and power of all steady forces."""
        at = Symbols(self.mechanism.n)
        potential, power = at.program.symbol(0.0), at.program.symbol(0.0)
        for load in self.loads:
            held, gained = equations.energies(at, load)
            potential, power = potential + held, power + gained
        return at.written([potential], [power])

    def generalised(self, q: Array, v: Array, t: float | Array | None = None) -> Array:
        """Q (..., n) [N, N m] at states q, v (..., n) and times t (...) [s], which only forces that vary need.

        Raises:
            TypeError: a force varies with time, and none is given.
        """
        (Q,) = self._steady(0.0, q, v)
        for force in self.varying:
            Q = Q + force(q, v, t)
        return Q

    def potential(self, q: Array) -> Array:
        """Potential energy (...) [J]; constant torques and world-fixed forces have one too, in unwrapped angles."""
        held, _ = self._energies(0.0, q, np.zeros_like(q))
        return np.asarray(held[..., 0] - q @ self.gravity)

    def power(self, q: Array, v: Array, t: float | Array | None = None) -> Array:
        """Return the power (...) [W] of all forces without a potential."""
        _, gained = self._energies(0.0, q, v)
        return np.asarray(gained[..., 0] + sum((force(q, v, t) * v).sum(-1) for force in self.varying))


class _Varying:
    """A varying force: a factor of time or direction times a steady force."""

    def __init__(self, mechanism: Mechanism, force: Force):
        factor = factor_of(force)
        assert factor is not None
        self.name, self.factor, of = force.name, factor, steady_part(force)
        self.size = float(np.linalg.norm(np.atleast_1d(of.value).astype(float))) or 1.0
        self.steady = AppliedForces(replace(mechanism, forces=(of,), gravity=0.0 * mechanism.gravity))

    def __call__(self, q: Array, v: Array, t: float | Array | None) -> Array:
        """Return the contribution of this force to Q (..., n)."""
        if t is None:
            raise TypeError(f"force {self.name} varies with time, and no time is given")
        Q = self.steady.generalised(q, v)
        along = (Q * v).sum(-1) / self.size
        return np.asarray(Q * self.factor(t, along)[..., None])


JAMMED = "the friction does not settle in {} iterations: mu is too large for these joints, or they jam"


class Jammed(ArithmeticError):
    """The loads of joints with friction do not settle: each increases the other, as in a slide that jams."""


class JointFriction:
    """Dry friction in the joints of one mechanism; p counts the pairs with mu > 0, others are left out.

    Attributes:
        acting: (p,) the friction of the file and the pair in which it acts.
        rows: (p,) first multiplier of each pair.
        pins: (p,) 1 where the second multiplier is a force too, 0 for a slide, where it is a moment.
    """

    ITERATIONS = 200  # settles wherever each iteration takes off a sixth of the error; usual joints take off nine tenths
    TOLERANCE = 1e-13  # of the largest multiplier
    STALLED = 1e-11  # the same, where solving for lambda anew each time leaves rounding times the condition of J

    def __init__(self, mechanism: Mechanism):
        first = {joint.name: 2 * k for k, joint in enumerate(mechanism.joints)}
        self.acting = [(f, pair) for f in mechanism.frictions if f.mu > 0 for pair in f.pairs]
        self.rows = np.array([first[pair.name] for _, pair in self.acting], dtype=int)
        self.pins = np.array([not pair.slides for _, pair in self.acting], dtype=float)
        self.lever = np.array([f.mu * f.radius for f, _ in self.acting])
        self.speed = np.array([f.speed for f, _ in self.acting])
        at = Symbols(mechanism.n)
        motions = [state(pair.motion, at) for _, pair in self.acting]
        entries = [columns(x.entries) for x in motions]
        self.places = [(k, p) for p, some in enumerate(entries) for k in some]
        self._written = at.written([x.rate for x in motions], [x for some in entries for x in some.values()])

    def __bool__(self) -> bool:
        return len(self.rows) > 0

    def directions(self, q: Array, v: Array) -> Array:
        """W (..., n, p): generalised friction for unit loads at state(s) (..., n)."""
        W = np.zeros((*q.shape, len(self.rows)), dtype=q.dtype)
        rates, entries = self._written(0.0, q, v)
        law = -self.lever * np.tanh(rates / self.speed)
        for i, (k, p) in enumerate(self.places):
            W[..., k, p] = entries[..., i] * law[..., p]
        return W

    def loads(self, multipliers: Array) -> Array:
        """N (..., p) [N] of multipliers (..., m)."""
        return np.hypot(multipliers[..., self.rows], self.pins * multipliers[..., self.rows + 1])

    def generalised(self, q: Array, v: Array, multipliers: Array) -> Array:
        """Friction W N(lambda), (..., n) [N, N m]."""
        return np.asarray((self.directions(q, v) @ self.loads(multipliers)[..., None])[..., 0])

    def consistent(self, base: Array, gain: Array) -> Array:
        """Solve lambda = base + gain N(lambda) for the multipliers (..., m), with base (..., m) and gain (..., m, p).

        Raises:
            Jammed: the iteration does not settle.
        """
        multipliers = base
        with np.errstate(over="ignore", invalid="ignore"):  # what grows beyond bounds has not settled
            for _ in range(self.ITERATIONS):
                before, multipliers = multipliers, base + (gain @ self.loads(multipliers)[..., None])[..., 0]
                change, scale = np.abs(multipliers - before).max(-1, initial=0.0), np.abs(multipliers).max(-1, initial=0.0)
                if (change <= self.TOLERANCE * scale).all():
                    return np.asarray(multipliers)
        raise Jammed(JAMMED.format(self.ITERATIONS))
