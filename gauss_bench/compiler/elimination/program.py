"""The program of a linkage: straight-line functions, ready for any machine.

    linkage -> rows and forces (equations) -> factors (lu) -> accelerations (formulations) -> functions (function)

The functions share their expressions: where several are evaluated at the same state, sines, Jacobian and factors are the same.
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.compiler.elimination.check import off_constraints_error, worst_error
from gauss_bench.compiler.elimination.formulations import Workspace, moved_links, plain_links, vector
from gauss_bench.compiler.elimination.function import Costs, Function, Inputs, function, uses
from gauss_bench.compiler.elimination.partition import Study, covering, study
from gauss_bench.compiler.elimination.search import Best, cheapest
from gauss_bench.compiler.equations.constraints import Row, rate_of, rows_of
from gauss_bench.compiler.equations.forces import energy as energy_of
from gauss_bench.compiler.equations.links import open_parameters as named_parameters
from gauss_bench.compiler.equations.sampling import DENSE, manifold_states, scales
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import Node
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

__all__ = ["Costs", "KernelError", "Program", "costs", "generate", "partitions"]

FORMULATIONS = ("auto", "gauss", "lagrange")
AIMS = ("single", "batch")
OFF = 0.1  # [rad, lengths] from the constraints, where residuals and energy are checked
CHECKED = 1e-9  # relative; sound programs reach 1e-12, and a wrong sign or a lost term is nowhere near


@dataclass(frozen=True, eq=False)
class Program:
    """Straight-line functions of one mechanism under one formulation and one partition.

    Attributes:
        name: of the mechanism.
        formulation: "gauss" or "lagrange".
        n, m: coordinates, and constraint rows that are kept.
        independent: coordinates of the partition; () for lagrange.
        parameters: names of the numbers left open, such as "links.crank.mass" or "points.rod.A.x", in the order of p.
        values: (n_p,) their values in the linkage file.
        dropped: names of the redundant rows that were dropped.
        acceleration: (t, q, v, p) -> a (n,), guard (k,).
        thresholds: (k,) the state is usable where abs(guard) >= thresholds.
        position_correction: (t_at, q_at, t, q, p) -> dq (n,), Newton's with the Jacobian at q_at and the residual at q.
        velocity_correction: (t, q, v, p) -> dv (n,).
        multipliers: (t, q, v, p) -> lambda (all rows in the file's order; 0 where dropped) of M a + J^T lambda = Q.
        energy: (q, v, p) -> (1,) kinetic plus potential energy [J].
        residual: (t, q, v, p) -> phi (all holonomic rows), phi_dot (all rows).
        stabilized: as acceleration, with gamma - 2 alpha phi_dot - beta^2 phi in place of gamma; None unless asked for.
    """

    name: str
    formulation: str
    n: int
    m: int
    independent: tuple[int, ...]
    parameters: tuple[str, ...]
    values: Array
    dropped: tuple[str, ...]
    thresholds: Array
    acceleration: Function
    position_correction: Function
    velocity_correction: Function
    multipliers: Function
    energy: Function
    residual: Function
    stabilized: Function | None

    @property
    def n_parameters(self) -> int:
        """Length of the input p."""
        return len(self.parameters)


def generate(
    mechanism: Mechanism,
    formulation: str = "auto",
    open_parameters: tuple[str, ...] = (),
    independent: tuple[int, ...] | None = None,
    baumgarte: tuple[float, float] | None = None,
    aim: str = "single",
) -> Program:
    """The program of a mechanism.

    Args:
        formulation: "gauss", "lagrange", or "auto" for the one that costs less.
        open_parameters: names of numbers of the file that stay inputs.
        independent: coordinates of the partition (gauss); chosen where None.
        baumgarte: alpha, beta [1/s] of the stabilised variant.
        aim: "single" for a short chain of operations, "batch" for few operations.

    Raises:
        KernelError: dry friction, an unknown parameter, no usable partition, or a program that fails its own check.
    """
    if formulation not in FORMULATIONS:
        raise KernelError(f"no formulation {formulation}; there are {', '.join(FORMULATIONS)}")
    if aim not in AIMS:
        raise KernelError(f"no aim {aim}; there are {', '.join(AIMS)}")
    if mechanism.has_friction:
        raise KernelError(f"{mechanism.name}: no kernel for dry friction, whose force follows from the accelerations it causes")
    parameters = named_parameters(mechanism, open_parameters)
    found = study(mechanism)
    if independent is not None and (len(set(independent)) != found.free or not set(independent) <= set(range(mechanism.n))):
        raise KernelError(f"{mechanism.name} has {found.free} independent coordinates among {mechanism.n}, not {independent}")
    program = _written(found, cheapest(found, parameters, formulation, independent, aim), baumgarte)
    check(program, mechanism)
    return program


def partitions(mechanism: Mechanism) -> list[tuple[int, ...]]:
    """Independent coordinates, a few choices of which at least one is usable at every position met; the first is usable at most."""
    return covering(study(mechanism))


def costs(program: Program) -> Costs:
    """Operations, divisions and critical path of an acceleration with its guards."""
    return program.acceleration.costs


def _written(found: Study, best: Best, baumgarte: tuple[float, float] | None) -> Program:
    """All functions of the plan that was found best."""
    work, algebra = best.work, best.work.algebra(best.search)
    mechanism, links, graph = found.mechanism, work.links, work.terms.graph
    n = mechanism.n
    guards = algebra.guards
    a = vector(graph, algebra.acceleration(work.terms.gamma), n)
    dq = vector(graph, algebra.correction(_residuals(work)), n)
    dv = vector(graph, algebra.correction(_rates(work)), n)
    stabilized = vector(graph, algebra.acceleration(_damped(work, *baumgarte)), n) if baumgarte else []
    multipliers = {work.kept[k]: x for k, x in algebra.multipliers(work.terms.gamma).items()}
    plain = plain_links(work)
    rows = rows_of(plain)
    phi = [row.phi for row in rows if row.phi is not None]
    shared = uses([*a, *(x for x, _ in guards), *dq, *dv, *stabilized])
    size = len(links.parameters.names)
    at: Inputs = (("t", 1), ("q", n), ("v", n), ("p", size))
    moved: Inputs = (("t", 1), ("q", n), ("t_new", 1), ("q_new", n), ("p", size))
    pivots = [x for x, _ in guards]
    return Program(
        name=mechanism.name,
        formulation=work.plan.formulation,
        n=n,
        m=len(work.kept),
        independent=work.plan.independent,
        parameters=links.parameters.names,
        values=links.parameters.values,
        dropped=found.dropped,
        thresholds=np.array([x for _, x in guards]),
        acceleration=function(at, [a, pivots], shared),
        position_correction=function(moved, [dq], shared),
        velocity_correction=function(at, [dv], shared),
        multipliers=function(at, [vector(graph, multipliers, len(rows))], shared),
        energy=function(at[1:], [[energy_of(plain)]], shared),
        residual=function(at, [phi, [rate_of(plain, row) for row in rows]], shared),
        stabilized=function(at, [stabilized, pivots], shared) if baumgarte else None,
    )


def _residuals(work: Workspace) -> dict[int, Node]:
    """phi by kept row at the position to be corrected; a knife edge has none, and its row keeps the correction along the edge."""
    moved = rows_of(moved_links(work))
    kept = [moved[k] for k in work.kept]
    return {k: row.phi for k, row in enumerate(kept) if row.phi is not None and not row.phi.zero}


def _rates(work: Workspace) -> dict[int, Node]:
    """phi' by kept row."""
    rates = {k: rate_of(work.links, row) for k, row in enumerate(work.terms.rows)}
    return {k: x for k, x in rates.items() if not x.zero}


def _damped(work: Workspace, alpha: float, beta: float) -> dict[int, Node]:
    """gamma - 2 alpha phi' - beta^2 phi by kept row."""

    def bias(row: Row) -> Node:
        bent = row.gamma - rate_of(work.links, row) * (2 * alpha)
        return bent if row.phi is None else bent - row.phi * beta**2

    return {k: x for k, row in enumerate(work.terms.rows) if not (x := bias(row)).zero}


def check(program: Program, mechanism: Mechanism) -> None:
    """Compare with the linkage's own evaluation at states other than those the pivots were chosen at, and off the constraints.

    Raises:
        KernelError: the program is off by more than CHECKED, or usable at none of these states.
    """
    states = manifold_states(mechanism, 9 if mechanism.n <= DENSE else 2, seed=1)
    found = []
    for t, q, v in zip(states.t, states.q, states.v, strict=True):
        a, guard = program.acceleration([t], q, v, program.values)
        if (np.abs(guard) >= program.thresholds).all():
            found.append((float(t), q, v, a))
    if not found:
        raise KernelError(f"{program.name}: the {program.formulation} kernel is usable at none of {len(states)} positions")
    error = worst_error(mechanism, found)
    t, q, v, _ = found[-1]
    q = q + OFF * scales(mechanism) * np.random.default_rng(0).normal(size=len(q))
    phi, phi_dot = program.residual([t], q, v, program.values)
    energy = float(program.energy(q, v, program.values)[0][0])
    error = max(error, off_constraints_error(mechanism, t, q, v, phi, phi_dot, energy))
    if not error <= CHECKED:
        raise KernelError(f"{program.name}: the {program.formulation} kernel is off by {error:.1e}, which its condition explains")
