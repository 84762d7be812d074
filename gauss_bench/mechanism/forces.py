"""Applied forces of a linkage: generalised force Q, potential energy, and the power of forces without a potential.

Each force is a sum of loads (`to_loads` in model.py): laws on scalar coordinates and constant forces at points. One function is
generated for the sum of all loads, for a state q (n,) or a batch q (..., n). Dampers and forces that turn with a link have no
potential; the energy balance of a trajectory integrates their power instead.

Dry friction depends on the loads of the joints and so on the accelerations. With N_k the load that pair k (a pin or slide between
two links) carries and s_k the relative speed of the two links, the friction is one more active force (Yuan and Ge, 2016, eq. 3):

    M a + J^T lambda = Q + W N(lambda),    W_k = -mu_k r_k tanh(s_k / speed_k) ds_k/dv        (r_k = 1 for a slide)
    N = |(lambda_x, lambda_y)| of a pin,   N = |lambda_normal| of a slide

mu_k is the coefficient of friction, r_k the radius of the pin, and speed_k the width of the regularisation. lambda is found by
an iteration, which begins without friction, and converges unless mu is so large that load and friction increase each other.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from gauss_bench.mechanism import equations
from gauss_bench.mechanism.coordinates import columns, state
from gauss_bench.mechanism.equations import Symbols
from gauss_bench.mechanism.model import Coordinate, Mechanism, PointForce, Torque, factor_of, loads
from gauss_bench.mechanism.motion_laws import Factor
from gauss_bench.mechanism.spaces import Real, places
from gauss_bench.terms import Array


class AppliedForces:
    """Gravity and the active forces of one mechanism. Steady forces are those without a time or direction factor.

    Attributes:
        gravity: (n,) the generalised force of gravity.
        varying: the forces that vary with time or direction; loads: the loads of all other forces.
    """

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        self.gravity = np.zeros(mechanism.n, dtype=mechanism.gravity.dtype)
        for place, link in zip(places(self.gravity), mechanism.links, strict=True):
            place[:] = link.mass * mechanism.gravity
        self.varying = [_VaryingForce(mechanism, force, factor) for force, factor in mechanism.factors]
        self.loads = loads(f for f in mechanism.forces if not factor_of(f))

    def add_steady(self, symbols: Symbols) -> list[Real]:
        """Return the sum Q (n,) of gravity and all steady forces, as symbols."""
        Q: list[Real] = [symbols.program.symbol(x) for x in self.gravity]
        for load in self.loads:
            for k, x in equations.generalise(symbols, load).items():
                Q[k] = Q[k] + x
        return Q

    @cached_property
    def _steady_force(self) -> Callable[..., list[Array]]:
        """The generated function for the generalised force Q (..., n) of gravity and all steady forces."""
        symbols = Symbols(self.mechanism.n)
        return symbols.generate(self.add_steady(symbols))

    @cached_property
    def _energies(self) -> Callable[..., list[Array]]:
        """The generated function of the potential energy and the power of all steady forces."""
        symbols = Symbols(self.mechanism.n)
        potential, power = symbols.program.symbol(0.0), symbols.program.symbol(0.0)
        for load in self.loads:
            load_potential, load_power = equations.energies(symbols, load)
            potential, power = potential + load_potential, power + load_power
        return symbols.generate([potential], [power])

    def generalised(self, q: Array, v: Array, t: float | Array | None = None) -> Array:
        """Return the generalised force Q (..., n) [N, N m] of all forces at states q, v (..., n) and times t (...) [s].

        Only forces that vary need t.

        Raises:
            TypeError: a force varies, and t is missing.
        """
        (Q,) = self._steady_force(0.0, q, v)  # steady forces do not depend on the time, here 0
        for force in self.varying:
            Q = Q + force(q, v, t)
        return Q

    def potential(self, q: Array) -> Array:
        """Return the potential energy (...) [J] at q (..., n), with that of constant torques and forces of constant direction."""
        potential, _ = self._energies(0.0, q, np.zeros_like(q))  # (..., 1), of all forces but gravity
        return np.asarray(potential[..., 0] - q @ self.gravity)

    def power(self, q: Array, v: Array, t: float | Array | None = None) -> Array:
        """Return the power (...) [W] of all forces without a potential."""
        _, power = self._energies(0.0, q, v)
        return np.asarray(power[..., 0] + sum((force(q, v, t) * v).sum(-1) for force in self.varying))


class _VaryingForce:
    """A force that varies: a steady force times a factor that depends on time and on the direction of motion."""

    def __init__(self, mechanism: Mechanism, force: Torque | PointForce, factor: Factor):
        """Make the force without its factor the only force of a copy of the mechanism, without gravity."""
        steady = replace(force, factor=None)
        self.name, self.factor = force.name, factor
        # magnitude [N or N m] of the steady force, by which the power is divided; 1 if it is 0
        self.size = float(np.linalg.norm(np.atleast_1d(steady.value).astype(float))) or 1.0
        self.steady = AppliedForces(replace(mechanism, forces=(steady,), gravity=0.0 * mechanism.gravity))

    def __call__(self, q: Array, v: Array, t: float | Array | None) -> Array:
        """Return the contribution of this force to Q (..., n)."""
        if t is None:
            raise TypeError(f"force {self.name} varies with time, and no time is given")
        Q = self.steady.generalised(q, v)
        speed = (Q * v).sum(-1) / self.size  # along the force: power over magnitude
        return np.asarray(Q * self.factor(t, speed)[..., None])


JAMMED = "the friction does not converge in {} iterations: mu is too large for these joints, or they jam"


class Jammed(ArithmeticError):
    """The loads of joints with friction do not converge, because load and friction increase each other."""


class JointFriction:
    """Dry friction in the p pairs (pins or slides) of one mechanism that have mu > 0; the object is false if there are none.

    Attributes:
        acting: each friction with the pair in which it acts.
        places: row and column of each nonzero entry of W (n, p), whose column k is the generalised friction per load of pair k.
        first, last: (p,) indices of the first and the last multiplier of each pair that is a force [N]; the others are moments.
        both: (p,) 1 if these are two multipliers, as of a pin; 0 if they are one, as of a slide.
        lever: (p,) mu times radius [m] of a pin; mu [-] of a slide.
        speed: (p,) speed of the regularisation [rad/s or m/s].
    """

    ITERATIONS = 200  # enough if each iteration reduces the error by a sixth; usual joints reduce it by nine tenths
    TOLERANCE = 1e-13  # last change of a multiplier, as a share of the largest one
    STALLED = 1e-11  # the same for engines that solve for lambda anew in each iteration, with an error that grows with cond(J)

    def __init__(self, mechanism: Mechanism):
        """Find the pairs with friction; generate the function for their relative speeds and the gradients of these."""
        self.acting = [(f, pair) for f in mechanism.frictions if f.mu > 0 for pair in f.pairs]
        force_rows = []  # for each pair the indices of the multipliers that are forces: those of held lengths
        for _, pair in self.acting:
            held: tuple[tuple[Coordinate, float], ...] = pair.held
            first = mechanism.held_names.index(pair.name)
            force_rows.append([row for row, (x, _) in enumerate(held, first) if x.unit == "m"])
        self.first, self.last = (np.array([rows[end] for rows in force_rows], dtype=int) for end in (0, -1))
        self.both = np.array(self.first != self.last, dtype=float)
        self.lever = np.array([f.mu * f.radius for f, _ in self.acting])
        self.speed = np.array([f.speed for f, _ in self.acting])
        symbols = Symbols(mechanism.n)
        motions = [state(pair.motion, symbols) for _, pair in self.acting]
        gradients = [columns(x.entries) for x in motions]  # of the relative motions
        self.places = [(k, p) for p, gradient in enumerate(gradients) for k in gradient]
        entries = [x for gradient in gradients for x in gradient.values()]  # in the order of `places`
        # returns the relative speeds (..., p), and the entries of all gradients
        self._function = symbols.generate([x.rate for x in motions], entries)

    def __bool__(self) -> bool:
        """Tell whether any pair of the mechanism has friction."""
        return bool(self.acting)

    def directions(self, q: Array, v: Array) -> Array:
        """Return W (..., n, p) at state(s) q, v (..., n): column k is the generalised friction under a load of 1 N of pair k."""
        W = np.zeros((*q.shape, len(self.acting)), dtype=q.dtype)
        rates, entries = self._function(0.0, q, v)
        friction = -self.lever * np.tanh(rates / self.speed)  # (..., p) along the relative motion, per load of the pair
        for i, (k, p) in enumerate(self.places):
            W[..., k, p] = entries[..., i] * friction[..., p]
        return W

    def loads(self, multipliers: Array) -> Array:
        """Return the loads N (..., p) [N] that the pairs carry, from multipliers (..., m)."""
        return np.hypot(multipliers[..., self.first], self.both * multipliers[..., self.last])

    def generalised(self, q: Array, v: Array, multipliers: Array) -> Array:
        """Return the generalised force W N(lambda) of friction (..., n) [N, N m]."""
        return np.asarray((self.directions(q, v) @ self.loads(multipliers)[..., None])[..., 0])

    def solve_multipliers(self, base: Array, gain: Array) -> Array:
        """Solve lambda = base + gain N(lambda) for the multipliers lambda (..., m).

        `base` (..., m) are the multipliers without friction, `gain` (..., m, p) their change per load of a pair.

        Raises:
            Jammed: the iteration does not converge.
        """
        multipliers = base
        with np.errstate(over="ignore", invalid="ignore"):  # an overflow never passes the test below
            for _ in range(self.ITERATIONS):
                before = multipliers
                multipliers = base + (gain @ self.loads(multipliers)[..., None])[..., 0]
                change = np.abs(multipliers - before).max(-1, initial=0.0)
                scale = np.abs(multipliers).max(-1, initial=0.0)
                if (change <= self.TOLERANCE * scale).all():
                    return np.asarray(multipliers)
        raise Jammed(JAMMED.format(self.ITERATIONS))
