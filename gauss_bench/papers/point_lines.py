"""The lines of the audit for Men et al. (2009)."""

from gauss_bench.papers import point_forms as forms
from gauss_bench.papers.line import MEN, ROUNDING, Line, Verdict, right

NEAR = "rounding of a few products; positions of the linkage file are closed to 1e-15"
QUOTIENT = "(XA - XB)/(YA - YB) = (XO1 - XB)/(YO1 - YB)"
PRODUCT = "(XA - XB)(YO1 - YB) - (YA - YB)(XO1 - XB) = 0"


def equations() -> tuple[Line, ...]:
    """Eqs. (1) and (2) as equations."""
    return (
        right(
            MEN,
            "(1)",
            "loops of the shaper",
            "r1 e(th1) + r2 e(th2) = r3 e(th3), r4 e(th4) + r5 e(th5) = r6 e(th6) + r7 e(th7)",
            forms.sides,
            forms.loops_off,
            "residual at true positions, relative to the lever",
            ROUNDING,
            NEAR,
            "Right with th4 = th3, because the lever is one link.",
        ),
        right(
            MEN,
            "(2)",
            "lengths of lever and rod",
            "(XB - XO1)^2 + (YB - YO1)^2 = L_O1B^2, (XC - XB)^2 + (YC - YB)^2 = L_BC^2",
            forms.lengths,
            forms.lengths_off,
            "residual at true positions, relative to the square of the lever",
            ROUNDING,
            NEAR,
            "Right.",
        ),
        Line(
            MEN,
            "(2)",
            "which coordinate of C is known",
            "O1, O2, A and X_C are basic coordinates",
            "O1, O2, A and Y_C are basic coordinates",
            Verdict.MISPRINT,
            forms.basic_as_printed,
            forms.basic,
            forms.basic_off,
            "range over a turn of the coordinate said to be known, relative to the stroke",
            ROUNDING,
            NEAR,
            "The list below the equations is right: X_C is unknown, and the guide gives Y_C.",
        ),
        Line(
            MEN,
            "(2)",
            "which points are in line",
            "O1, B, C",
            "O1, A, B",
            Verdict.MISPRINT,
            forms.collinear_as_printed,
            forms.collinear,
            forms.collinear_off,
            "largest sine of the angle at the first point, over a turn",
            ROUNDING,
            NEAR,
            "The third equation, rightly, puts O1, A and B in line: the block slides in the lever.",
        ),
    )


def solution() -> tuple[Line, ...]:
    """What the equations are worth in a search."""
    return (
        Line(
            MEN,
            "(2)",
            "line as a quotient",
            QUOTIENT,
            PRODUCT,
            Verdict.LOOSE,
            forms.quotient,
            forms.product,
            forms.line_off,
            "residual that rounding leaves at true positions, down to 1e-6 rad from the axes; the product as a sine",
            ROUNDING,
            NEAR,
            "The quotient grows without bound as the lever comes to lie along x, and is 0/0 there; the product is regular. In the "
            "paper's own posture the lever stays away from the horizontal.",
        ),
        Line(
            MEN,
            "(2)",
            "line as a quotient in a search",
            QUOTIENT,
            PRODUCT,
            Verdict.LOOSE,
            forms.quotient,
            forms.product,
            forms.search_off,
            "share of positions, 5 degrees apart, as drawn and laid on its side, at which Newton's method fails from the last one",
            0.0,
            "a count",
            "The same linkage, turned by a quarter, cannot be followed through its turn with the quotient.",
        ),
        Line(
            MEN,
            "(2)",
            "number of assemblies",
            "1, as no other is mentioned",
            "2 real ones of 4 formal ones, with the dimensions taken here",
            Verdict.LOOSE,
            forms.one_assembly,
            forms.two_assemblies,
            forms.assemblies_off,
            "error of the number of real solutions, at four positions of the crank",
            0.0,
            "a count",
            "B may lie on either side of O1 and C on either side of B; with B below, the rod does not reach the guide. Only the "
            "start of the search tells the two apart.",
        ),
        Line(
            MEN,
            "abstract, 2",
            "insensitive to the start of the search",
            "starts from anywhere in the size of the linkage",
            "starts no farther than the last position, 5 degrees before",
            Verdict.LOOSE,
            forms.from_anywhere,
            forms.from_before,
            forms.starts_off,
            "share of random starts from which the worse of two searches does not find the right assembly",
            0.0,
            "a count of 100 starts",
            "True for starts from the position before, as the paper uses them, and not for others.",
        ),
    )


def lines() -> tuple[Line, ...]:
    return (*equations(), *solution())
