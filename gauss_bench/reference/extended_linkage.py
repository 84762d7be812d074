"""A linkage in long double: its start, and at any state its accelerations, multipliers and the nearest state on the constraints.

All numbers are converted directly from the decimal texts of the file to long double, without rounding to double. The assembly in
double precision is only the first guess. `refinement.py` solves all systems, with an inverse in double precision at the same
position or near it.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.closure import list_held
from gauss_bench.mechanism.evaluate import Constraints, Evaluator, Rows
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.motion import assemble_doubles
from gauss_bench.reference.refinement import SaddleInverse, Unsolved, invert_saddle, pseudo_inverse, saddle_residual, solve_by_chord
from gauss_bench.terms import Array

MANTISSA = 60  # least number of bits; on some platforms long double has no more than double
SINGULAR = 1e-9  # least relative singular value: its inverse square, the condition of the multipliers, exceeds a double's digits
LONG = np.longdouble


def check_platform() -> None:
    """Refuse a platform whose long double has no more digits than double.

    Raises:
        ArithmeticError: the mantissa is too short.
    """
    bits = np.finfo(LONG).nmant
    if bits <= MANTISSA:
        raise ArithmeticError(f"long double has {bits} bits of mantissa on this platform, and needs more than {MANTISSA} here")


@dataclass(eq=False)
class Linkage:
    """A mechanism in long double, with the data for its linear systems.

    Attributes:
        mechanism: the mechanism, with numbers in long double.
        evaluator: object that evaluates the terms of its equations of motion.
        rank: rank of the constraint Jacobian J M^(-1/2); all further singular values differ from zero only by rounding.
        nearest: smallest relative singular value so far, and the time [s] at which it occurred.
    """

    mechanism: Mechanism
    evaluator: Evaluator
    rank: int
    nearest: tuple[float, float] = (1.0, 0.0)

    def rows(self, t: Any, q: Array, v: Array) -> Rows:
        """Return the constraint rows at one state or several."""
        return self.evaluator.constraints(t, q, v)

    def inverse(self, t: Any, J: Array) -> SaddleInverse:
        """Return the inverse, in double precision, of the matrix [M J^T; J 0] of the equations of motion.

        J (..., m, n) are the constraint Jacobians at one or several times t [s]; messages and `nearest` have the first of these
        times.

        Raises:
            Unsolved: the position is singular.
        """
        solved, when = invert_saddle(self.evaluator.mass, J, self.rank), float(np.ravel(t)[0])
        if not solved.smallest > SINGULAR:
            raise Unsolved(f"t = {when:.6g} s: singular position (relative singular value {solved.smallest:.1e})")
        self.nearest = min(self.nearest, (solved.smallest, when))
        return solved

    def residual(self, t: Any, q: Array, v: Array, x: Array) -> Array:
        """Return the residual (..., n + m) of the equations of motion for x = [a, lambda] at one state or several."""
        rows = self.rows(t, q, v)
        return saddle_residual(self.evaluator.mass, rows.J, self.evaluator.applied.generalised(q, v), rows.gamma, x)

    def accelerations_and_multipliers(self, t: Any, q: Array, v: Array) -> tuple[Array, Array]:
        """Return accelerations (n,) and multipliers (m,) at one state, the solution of [M J^T; J 0] x = [Q; gamma].

        Raises:
            Unsolved: the position is singular.
        """
        rows = self.rows(t, q, v)
        mass, Q = self.evaluator.mass, self.evaluator.applied.generalised(q, v)

        def residual(x: Array) -> Array:
            """Return the residual [M J^T; J 0] x - [Q; gamma] of x = [a, lambda], in long double."""
            return -saddle_residual(mass, rows.J, Q, rows.gamma, x)

        zero = np.zeros(len(q) + len(rows.phi), dtype=LONG)
        x = solve_by_chord(residual, self.inverse(t, rows.J).inverse, zero)
        return x[: len(q)], x[len(q) :]

    def project(self, t: Any, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the nearest positions to q, and then the nearest velocities to v, that satisfy the constraints at time t.

        Raises:
            Unsolved: no state nearby satisfies the constraints, or the position is singular.
        """
        holonomic, edges = self.evaluator.constraints.holonomic, len(self.mechanism.knife_edges)
        rows = self.rows(t, q, v)
        # matrices (n, rows) that give the smallest correction of q or v, in the mass metric, for an error of the constraints; they
        # are computed once, at the first state, and serve for all iterations (chord iteration)
        for_velocities = for_positions = self.inverse(t, rows.J).lift
        if edges:  # knife edges restrict velocities, but no positions
            for_positions = invert_saddle(self.evaluator.mass, rows.J[:holonomic], self.rank - edges).lift
        try:
            q = solve_by_chord(lambda x: self.rows(t, x, v).phi[:holonomic], for_positions, q)
            rows = self.rows(t, q, v)
            return q, solve_by_chord(lambda x: rows.J @ x + rows.phi_t, for_velocities, v)
        except Unsolved as error:
            raise Unsolved(f"t = {float(t):.6g} s: the constraints cannot be met ({error})") from error


def start(document: dict[str, Any], scenario: str) -> tuple[Linkage, Array, Array]:
    """Return the linkage in long double, and q and v (n,) at its start.

    The positions satisfy the loops and the values of coordinates that the scenario prescribes; the velocities satisfy the loops,
    the knife edges and the prescribed rates.

    Raises:
        ArithmeticError: dry friction acts, or the start is singular.
    """
    guess = assemble_doubles(document, scenario)
    mechanism = build_mechanism(document, scenario, "", "", LONG)
    if mechanism.has_friction:
        raise ArithmeticError("dry friction in joints: the collocation in long double has no equations for it")
    free = replace(mechanism, drivers=())  # the scenario's prescribed values, `held`, stand for the drivers at the start
    close = Constraints(replace(free, knife_edges=())).residual  # knife edges restrict no positions
    held = list_held(mechanism, document["scenarios"][scenario], LONG)  # prescribed coordinates, with target values and rates

    def gap(q: Array) -> Array:
        """Return the residuals of the loops, and the distances from the values that the start prescribes."""
        return np.concatenate([close(q)[0], held.of(q)[0] - held.target])

    # positions: close the loops by chord iteration from the assembly in double precision
    q = guess.q0.astype(LONG)
    q = solve_by_chord(gap, pseudo_inverse(np.vstack([close(q)[1], held.of(q)[1]])), q)
    # velocities: the linear system A v = b has the rows of loops and knife edges with b = 0, and the prescribed rates. It is solved
    # by iteration, because the pseudo-inverse has only double precision
    A = np.vstack([Constraints(free)(0.0, q, np.zeros_like(q)).J, held.of(q)[1]])
    b = np.concatenate([np.zeros(len(A) - len(held.rate)), held.rate])
    v = solve_by_chord(lambda v: A @ v - b, pseudo_inverse(A), guess.v0.astype(LONG))
    # the number of independent rows: n - dof of the joints, since `dof` does not count drivers and knife edges, and one for each
    # driver and knife edge
    rank = mechanism.n - guess.dof + len(mechanism.drivers) + len(mechanism.knife_edges)
    return Linkage(mechanism, Evaluator(mechanism), rank), q, v
