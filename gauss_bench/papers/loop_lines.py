"""The lines of the audit for Wang et al. (2010) but table 1."""

from collections.abc import Callable

import numpy as np

from gauss_bench.mechanism.motion_laws import rise
from gauss_bench.papers import loop_forms as forms
from gauss_bench.papers.line import ROUNDING, SOLVED, WANG, Line, Verdict, right
from gauss_bench.papers.problems import worst
from gauss_bench.papers.six_bar import blocks_off, six_bar_blocks
from gauss_bench.terms import Array

BY_CONDITION = "rounding times the condition of J, some 1e2"
NEAR = "rounding of a few products of order one"
COUNT = "a count"
LAWS = ("sine", "cosine", "poly345")
INSIDE = np.linspace(0.0, 1.0, 101)


def straight() -> dict[str, Callable[[Array], Array]]:
    return dict.fromkeys(LAWS, lambda u: u)


def textbook() -> dict[str, Callable[[Array], Array]]:
    return {
        "sine": lambda u: u - np.sin(2 * np.pi * u) / (2 * np.pi),
        "cosine": lambda u: (1 - np.cos(np.pi * u)) / 2,
        "poly345": lambda u: 10 * u**3 - 15 * u**4 + 6 * u**5,
    }


def laws_off(form: Callable[[], dict[str, Callable[[Array], Array]]]) -> float:
    """Largest difference from the suite's laws over a rise of 1 in 1 s."""
    laws = form()
    return worst([float(np.abs(laws[name](INSIDE) - rise(name, 0.0, 1.0, 1.0)(INSIDE)[0]).max()) for name in LAWS])


def equations() -> tuple[Line, ...]:
    """Eqs. (1) to (5)."""
    return (
        Line(
            WANG,
            "(1)-(3)",
            "as many unknowns as equations",
            "N = 2 L unknowns, so that Newton's method has a square J",
            "N = 2 L minus the redundant constraints; with those, least squares",
            Verdict.LOOSE,
            forms.square,
            forms.with_spare_rows,
            forms.unknowns_off,
            "error of the number of unknowns",
            0.0,
            COUNT,
            "A linkage that moves only by its dimensions, such as the parallelogram with three cranks, has more equations.",
        ),
        right(
            WANG,
            "(4)",
            "velocities",
            "J phi' = -B q'",
            forms.velocities,
            forms.velocities_off,
            "relative error of the velocities of four linkages",
            SOLVED,
            BY_CONDITION,
            "Right.",
        ),
        Line(
            WANG,
            "(5)",
            "accelerations",
            "J phi'' = -B q'' - B' q' - J phi'",
            "J phi'' = -B q'' - B' q' - J' phi'",
            Verdict.MISPRINT,
            forms.accelerations_as_printed,
            forms.accelerations,
            forms.accelerations_off,
            "relative error of the angular accelerations of four linkages",
            SOLVED,
            BY_CONDITION,
            "The dot over the last J is missing in the text that was at hand, which may be the extraction's fault.",
        ),
    )


def matrices() -> tuple[Line, ...]:
    """Eqs. (9) to (15) and the six-bar example."""
    return (
        right(
            WANG,
            "1.2.2",
            "columns of a unit",
            "C = r + p1: one if the link turns, one for each guide on the path",
            forms.columns_of_unit,
            forms.columns_off,
            "error of the number of columns",
            0.0,
            COUNT,
            "Right; blocks do not count.",
        ),
        Line(
            WANG,
            "(9), (10)",
            "one 1 in each row",
            "each row of U and of K has exactly one 1",
            "each row of [U K] has exactly one 1",
            Verdict.LOOSE,
            forms.each_alone,
            forms.side_by_side,
            forms.ones_off,
            "share of rows without exactly one 1",
            0.0,
            COUNT,
            "A variable is either unknown or known, so that its row is zero in the other matrix.",
        ),
        right(
            WANG,
            "(11), (12)",
            "matrices of a loop",
            "J_l = sum J_i U_i, B_l = sum J_i K_i",
            forms.assembled,
            forms.assembly_off,
            "residual of (4) at true rates, relative to its terms",
            ROUNDING,
            NEAR,
            "Right.",
        ),
        Line(
            WANG,
            "(13)-(15)",
            "loops one above the other",
            "J = [J1 J2 ... JL]^T",
            "J = [J1^T J2^T ... JL^T]^T",
            Verdict.MISPRINT,
            forms.row_transposed,
            forms.stacked,
            forms.stack_off,
            "relative error of the velocities, or share of rows and columns by which the matrices do not fit",
            SOLVED,
            BY_CONDITION,
            "Transposing the row transposes every block; what is meant is to write the loops one below the other.",
        ),
        right(
            WANG,
            "1.2.5",
            "six-bar example",
            "J, J', B, B' of loops a-b-c-d and d-e-f-g",
            six_bar_blocks,
            blocks_off,
            "largest difference from the suite's matrices, the sense of each loop left free",
            ROUNDING,
            NEAR,
            "Right in every entry.",
        ),
    )


def topology() -> tuple[Line, ...]:
    """Sections 2.2 and 3.1, the examples' loops and the motion laws."""
    return (
        Line(
            WANG,
            "2.2",
            "incidence matrix",
            "m_ij = 1 or -1 where link i and joint i belong together",
            "m_ij = 1 or -1 where link i and joint j belong together",
            Verdict.MISPRINT,
            forms.ith_with_ith,
            forms.ith_with_jth,
            forms.incidence_off,
            "share of wrong entries, over all linkages",
            0.0,
            COUNT,
            "The next sentence of the paper has j for the joint.",
        ),
        right(
            WANG,
            "3.1",
            "number of independent loops",
            "L = p - n + 1",
            forms.loop_count,
            forms.loop_count_off,
            "error of the number of loops of every built-in linkage",
            0.0,
            COUNT,
            "Right, with a pin through m links counted as m - 1 pairs and the frame as a link.",
        ),
        right(
            WANG,
            "1.2.5, 4",
            "loops of the examples",
            "six-bar a-b-c-d, d-e-f-g; eight-bar 1-2-5-3, 1-2-6-7-9-4, 1-2-6-8-10-4",
            forms.printed_loops,
            forms.loops_off,
            "loops that are not among those found",
            0.0,
            COUNT,
            "The way to find them is not printed; the breadth-first tree from the frame finds the same.",
        ),
        Line(
            WANG,
            "2.1.2",
            "motion laws",
            "names only",
            "s = u - sin(2 pi u)/(2 pi); (1 - cos pi u)/2; 10 u^3 - 15 u^4 + 6 u^5",
            Verdict.NOT_GIVEN,
            straight,
            textbook,
            laws_off,
            "largest difference from the suite's laws over a rise of 1",
            ROUNDING,
            NEAR,
            "Sine and cosine acceleration and the 3-4-5 polynomial are those of textbooks on cams; without a law, a straight line.",
        ),
    )


def lines() -> tuple[Line, ...]:
    return (*equations(), *matrices(), *topology())
