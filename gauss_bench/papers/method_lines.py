"""The lines of the audit for Yuan & Ge (2016), eqs. (1) to (14)."""

from gauss_bench.papers import method_forms as forms
from gauss_bench.papers.line import ROUNDING, SOLVED, YUAN_GE, Line, Verdict, right

BY_ROUNDING = "rounding of products of full matrices of order one, two decades of room"
BY_CONDITION = "rounding times the condition of the systems solved, up to 1e4, two decades of room"
OF_ACCELERATION = "relative error of the accelerations"


def statement() -> tuple[Line, ...]:
    """Sections 1 and 2: what is minimised, and subject to what."""
    return (
        right(
            YUAN_GE,
            "(1)",
            "Gauss's function",
            "G = 1/2 (M a + f - Q)^T M^-1 (M a + f - Q)",
            forms.gauss_function,
            forms.stationary,
            "slope of G at the true accelerations along the constraints, relative to its whole slope",
            SOLVED,
            BY_CONDITION,
            "The true accelerations make it stationary among those that the constraints allow.",
        ),
        right(
            YUAN_GE,
            "(2)",
            "Gauss's function by the root of M",
            "G = 1/2 |M^(-1/2) (M a + f - Q)|^2",
            forms.root_function,
            forms.same_function,
            "relative difference from (1) at random accelerations",
            ROUNDING,
            BY_ROUNDING,
            "With the symmetric root it is the same function.",
        ),
        right(
            YUAN_GE,
            "(3)",
            "constraint forces that do work",
            "G = 1/2 |M^(-1/2) (M a + f - Q - Q^c)|^2",
            forms.function_with,
            forms.stationary_with,
            "slope of G at the true accelerations along the constraints, relative to its whole slope",
            SOLVED,
            BY_CONDITION,
            "A constraint force that does work, such as friction, counts with the applied forces.",
        ),
        right(
            YUAN_GE,
            "(4)-(6)",
            "constraints in accelerations",
            "J a = g: (4) differentiated twice, (5) once",
            forms.differentiated,
            forms.bias_left,
            "relative residual of J a = g at true motions, one of them nonholonomic",
            ROUNDING,
            BY_ROUNDING,
            "The letter g stands for a number of constraints, for this right-hand side and for gravity; here the side is gamma.",
        ),
    )


def solution() -> tuple[Line, ...]:
    """Section 3 as far as (9): all accelerations that the constraints allow."""
    return (
        right(
            YUAN_GE,
            "(7), (8)",
            "general solution",
            "a = J^- g + (I - J^- J) h, h free, J^- any matrix with J J^- J = J",
            forms.general_solution,
            forms.every_solution,
            "relative residual of J a = g, and relative error of the solution that h = a must give",
            SOLVED,
            BY_CONDITION,
            "It gives every solution and nothing else, redundant rows included, as long as the rows agree with each other.",
        ),
        Line(
            YUAN_GE,
            "(7), (8)",
            "rows that disagree",
            "J^- any matrix with J J^- J = J",
            "J^- with J J^- symmetric as well, such as the Moore-Penrose inverse",
            Verdict.LOOSE,
            forms.some_inverse,
            forms.moore_penrose,
            forms.contradicting_rows,
            "residual of the normal equations J^T (J a - g), relative to its terms",
            SOLVED,
            BY_CONDITION,
            "Redundant rows whose g disagrees, by drift or by its correction, have no solution; only some inverses then give the "
            "nearest one.",
        ),
        right(
            YUAN_GE,
            "(9)",
            "least-squares form",
            "G = 1/2 |A h - b|^2",
            forms.half_square,
            forms.square_off,
            "relative difference from (1) at random h, with A and b as they should be",
            SOLVED,
            BY_CONDITION,
            "Right with the exponents of (10) and (11) corrected.",
        ),
    )


def exponents() -> tuple[Line, ...]:
    """Eqs. (10) and (11): A and b."""
    return (
        Line(
            YUAN_GE,
            "(10)",
            "exponent of M in A",
            "A = M^(-1/2) (I - J^- J)",
            "A = M^(1/2) (I - J^- J)",
            Verdict.MISPRINT,
            forms.matrix_as_printed,
            forms.matrix,
            forms.matrix_off,
            "relative difference from what (8) put into (2) leaves before h",
            ROUNDING,
            BY_ROUNDING,
            "Only the positive exponent follows from (2) and (8), and only it leads to (15) and (16).",
        ),
        Line(
            YUAN_GE,
            "(11)",
            "exponent of M in b",
            "b = -{M^(-1/2) J^- g + M^(-1/2) (f - Q)}",
            "b = -{M^(1/2) J^- g + M^(-1/2) (f - Q)}",
            Verdict.MISPRINT,
            forms.vector_as_printed,
            forms.vector,
            forms.vector_off,
            "relative difference from what (8) put into (2) leaves without h",
            SOLVED,
            BY_CONDITION,
            "The first exponent is positive, the second negative.",
        ),
        Line(
            YUAN_GE,
            "(10), (11)",
            "motion from A and b",
            "both as printed",
            "both corrected",
            Verdict.MISPRINT,
            forms.pair_as_printed,
            forms.pair,
            forms.pair_off,
            f"{OF_ACCELERATION} of the crank-slider",
            SOLVED,
            BY_CONDITION,
            "Taken literally, with Moore-Penrose inverses, the printed pair gives another motion.",
            forms.PAIR_AT_START,
        ),
        Line(
            YUAN_GE,
            "(10), (11)",
            "unit of length",
            "both as printed",
            "both corrected",
            Verdict.MISPRINT,
            forms.pair_as_printed,
            forms.pair,
            forms.pair_unit_dependence,
            "relative change of the crank's acceleration from metres to millimetres",
            1e-8,
            "a change of unit by 1e3 worsens the condition by its square, 1e6, times rounding; two decades of room",
            "As printed the terms have different dimensions, so that the motion depends on the unit of length.",
        ),
    )


def minimum() -> tuple[Line, ...]:
    """Eqs. (12) to (14): the least-squares solution."""
    return (
        Line(
            YUAN_GE,
            "(12)",
            "condition of the minimum",
            "A h = b",
            "A^T A h = A^T b",
            Verdict.LOOSE,
            forms.sides,
            forms.normal_sides,
            forms.sides_off,
            "relative difference of both sides at the true minimum",
            SOLVED,
            BY_CONDITION,
            "A is singular and b in general not in its range; what is meant is least squares.",
        ),
        Line(
            YUAN_GE,
            "(13)",
            "inverse in the minimum",
            "h = A^- b + (I - A^- A) w, A^- any matrix with A A^- A = A",
            "the same, with A A^- symmetric as well, such as the Moore-Penrose inverse",
            Verdict.LOOSE,
            forms.some_inverse,
            forms.moore_penrose,
            forms.minimum_missed,
            "residual of the normal equations A^T (A h - b), relative to its terms",
            SOLVED,
            BY_CONDITION,
            "An inverse that solves consistent equations does not minimise inconsistent ones.",
        ),
        Line(
            YUAN_GE,
            "(14)",
            "sign before the last term",
            "= (I - J^- J) A^- A w",
            "- (I - J^- J) A^- A w",
            Verdict.MISPRINT,
            forms.last_member_alone,
            forms.expanded,
            forms.with_any_w,
            f"{OF_ACCELERATION} for random w ten times as large",
            SOLVED,
            BY_CONDITION,
            "A minus at the end of one line and an equals sign at the start of the next, in the text that was at hand.",
        ),
        right(
            YUAN_GE,
            "(14)",
            "the free vector w",
            "a = J^- g + (I - J^- J) {A^- b + (I - A^- A) w}",
            forms.bracketed,
            forms.with_any_w,
            f"{OF_ACCELERATION} for random w ten times as large",
            SOLVED,
            BY_CONDITION,
            "Right for every w, because (I - J^- J)(I - A^- A) = 0: w drops out by itself, and with the exponents corrected "
            "a = J^- g + (I - J^- J) A^- b is final. The step to (15) and (16) was not needed.",
        ),
    )


def lines() -> tuple[Line, ...]:
    return (*statement(), *solution(), *exponents(), *minimum())
