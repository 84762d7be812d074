"""Compare how three root finders converge from random starts at different distances from the right assembly.

Men, Feng, He (2009) start a search from the assembly as drawn or from the previous position, and call it insensitive to the start.
From starts as near as these, every root finder finds the right assembly. From starts anywhere within the size of the linkage, each
root finder sometimes misses it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.kinematics.loop_equations import LoopEquations
from gauss_bench.kinematics.point_equations import PointModel
from gauss_bench.kinematics.root_finding import ROOT_FINDERS, ExitFlag
from gauss_bench.mechanism.close import Residual
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array, largest

SAME = 1e-6  # [m, rad] largest distance of a root from the right assembly: far above rounding, far below other assemblies

Form = tuple[Residual, Array, Callable[[Array, Array], Array]]  # equations, their solution, difference of two solutions


@dataclass(frozen=True)
class Basin:
    """The results of one root finder from random starts.

    Attributes:
        spread: largest distance of a start from the solution in any coordinate [m, or rad for angles].
        right, other: shares of the starts from which the search ended at the solution, or at another root.
        iterations: mean number of iterations to the solution; NaN if no search ended there.
    """

    method: str
    spread: float
    right: float
    other: float
    iterations: float


def point_form(mechanism: Mechanism) -> Form:
    """Return the `Form` of the point equations, functions of p (2 u,), with the inputs as in q0."""
    model = PointModel(mechanism)
    return model.residual(model.points.inputs_at(mechanism.q0)), model.points.unknown_at(mechanism.q0), np.subtract


def loop_form(mechanism: Mechanism) -> Form:
    """Return the `Form` of the loop equations, functions of the unknown variables, with the inputs as in q0.

    Whole turns are removed from all differences, which is right for slides if they differ by less than pi metres.
    """
    equations = LoopEquations(mechanism)
    start = equations.start()  # unknown variables, then inputs
    unknown = len(equations.unknown)
    return equations.with_inputs(start[unknown:]), start[:unknown], lambda x, y: np.asarray((x - y + np.pi) % (2 * np.pi) - np.pi)


def basins(
    mechanism: Mechanism,
    spreads: Sequence[float],
    starts: int = 200,
    seed: int = 0,
    form: Callable[[Mechanism], Form] = point_form,
) -> tuple[Basin, ...]:
    """Count how often each root finder finds the assembled start q0 from the same random guesses, by spread and root finder.

    `spreads` are the largest distances of a guess from the solution in any coordinate [m, or rad for angles].
    """
    residual, solution, difference = form(mechanism)
    results = []
    for spread in spreads:
        offsets = np.random.default_rng(seed).uniform(-spread, spread, size=(starts, len(solution)))
        for name, search in ROOT_FINDERS.items():
            ends = [search(residual, solution + offset) for offset in offsets]
            roots = [end for end in ends if end.flag == ExitFlag.CONVERGED]
            right = [end for end in roots if largest(difference(end.x, solution)) < SAME]
            mean = float(np.mean([end.iterations for end in right])) if right else float("nan")
            other = len(roots) - len(right)
            results.append(Basin(name, float(spread), len(right) / starts, other / starts, mean))
    return tuple(results)
