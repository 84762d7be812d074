"""Study of convergence: how far from the right assembly a first guess may be, for random starts and three root finders.

Men, Feng, He (2009) start from the assembly as drawn and then from the last position, and call the search insensitive to its start.
That depends on the distance: from starts as near as those every search finds the assembly; from starts anywhere within the size of
the linkage none always does.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.kinematics.inputs import Input
from gauss_bench.kinematics.loop_equations import LoopEquations
from gauss_bench.kinematics.point_equations import PointModel
from gauss_bench.kinematics.root_finding import ROOT_FINDERS, ExitFlag, Residual, largest
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

SAME = 1e-6  # [m, rad] far above where searches end, far below any distance of two assemblies

Form = Callable[[Mechanism, tuple[Input, ...]], tuple[Residual, Array]]


@dataclass(frozen=True)
class Basin:
    """Searches from random starts within +-spread of a solution [m; rad in a form with angles].

    Attributes:
        right, other: share that ended at the solution, or at another root; the rest did not converge.
        iterations: mean of those that ended at the solution; NaN where none did.
    """

    method: str
    spread: float
    right: float
    other: float
    iterations: float


def point_form(mechanism: Mechanism, inputs: tuple[Input, ...]) -> tuple[Residual, Array]:
    """Return the point equations in p (2 u,) at the start, and their solution there."""
    model = PointModel(mechanism, inputs)
    return model.residual(model.points.inputs_at(mechanism.q0)), model.points.unknown_at(mechanism.q0)


def loop_form(mechanism: Mechanism, inputs: tuple[Input, ...]) -> tuple[Residual, Array]:
    """Return the loop equations in the unknown angles and slides at the start, and their solution there."""
    equations = LoopEquations(mechanism, inputs)
    start = equations.start()
    unknown, still = len(equations.unknown), np.zeros(len(start))

    def residual(x: Array) -> tuple[Array, Array]:
        system = equations.at(np.concatenate([x, start[unknown:]]), still)
        return system.A, system.J

    return residual, start[:unknown]


def whole_turns_apart(x: Array, y: Array) -> Array:
    """Return the difference of two sets of loop variables modulo whole turns; slides [m] must be shorter than pi."""
    return np.asarray((x - y + np.pi) % (2 * np.pi) - np.pi)


def basins(
    mechanism: Mechanism,
    inputs: tuple[Input, ...],
    spreads: Sequence[float],
    starts: int = 200,
    seed: int = 0,
    form: Form = point_form,
    difference: Callable[[Array, Array], Array] = np.subtract,
) -> tuple[Basin, ...]:
    """Count how often each method finds the assembled start: a row per spread and method, the same random starts for all.

    `form` gives residual and solution in other coordinates; `difference` compares those (angles: but for whole turns).
    """
    residual, solution = form(mechanism, inputs)
    rows = []
    for spread in spreads:
        offsets = np.random.default_rng(seed).uniform(-spread, spread, size=(starts, len(solution)))
        for name, search in ROOT_FINDERS.items():
            ends = [search(residual, solution + offset) for offset in offsets]
            roots = [end for end in ends if end.flag == ExitFlag.CONVERGED]
            right = [end for end in roots if largest(difference(end.x, solution)) < SAME]
            mean = float(np.mean([end.iterations for end in right])) if right else float("nan")
            rows.append(Basin(name, float(spread), len(right) / starts, (len(roots) - len(right)) / starts, mean))
    return tuple(rows)
