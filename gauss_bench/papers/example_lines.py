"""The lines of the audit for Yuan & Ge (2016), eqs. (17) to (24)."""

from gauss_bench.papers import crank_slider
from gauss_bench.papers import example_forms as forms
from gauss_bench.papers.line import ROUNDING, YUAN_GE, Example, Line, Verdict, right
from gauss_bench.papers.method_forms import AT_START, true_crank_at_start

NEAR = "rounding of a few products; positions of the linkage file are closed to 1e-15"


def system() -> tuple[Line, ...]:
    """Eqs. (17) to (21)."""
    return (
        right(
            YUAN_GE,
            "(17)",
            "mass matrix",
            "M = diag(m1, m1, I1, m2, m2, I2, m3)",
            crank_slider.mass,
            forms.mass_off,
            "relative difference from the masses of the linkage file",
            ROUNDING,
            NEAR,
            "Right; the slider's height and angle are left out, which are constant.",
        ),
        right(
            YUAN_GE,
            "(18)",
            "velocity forces",
            "f = 0",
            forms.no_bias,
            forms.bias_off,
            "power of M a + f - Q along true motions, relative to its terms",
            ROUNDING,
            NEAR,
            "Right: in the coordinates of the centres of mass the mass matrix is constant.",
        ),
        right(
            YUAN_GE,
            "(19)",
            "applied forces",
            "Q = [0, -m1 g, tau, 0, -m2 g, 0, k (l1 + l2 - x3) - c x3']",
            crank_slider.forces,
            forms.forces_off,
            "difference from the forces of the linkage file, relative to the largest",
            ROUNDING,
            NEAR,
            "Right.",
        ),
        right(
            YUAN_GE,
            "(20)",
            "order of the accelerations",
            "a = [x1'', y1'', theta1'', x2'', y2'', theta2'', x3'']",
            forms.in_order,
            forms.order_off,
            "power of M a - Q along true motions, relative to its terms",
            ROUNDING,
            NEAR,
            "Right.",
        ),
        right(
            YUAN_GE,
            "(21)",
            "constraints",
            "x1 - l1/2 cos th1, y1 - l1/2 sin th1, l1 cos th1 - x2 + l2/2 cos th2, l1 sin th1 - y2 + l2/2 sin th2, "
            "x2 + l2/2 cos th2 - x3, y2 + l2/2 sin th2, all zero",
            crank_slider.residual,
            forms.positions_off,
            "residual at true positions, relative to l1 + l2",
            ROUNDING,
            NEAR,
            "Right: seven coordinates, six constraints, one degree of freedom.",
        ),
    )


def derivatives() -> tuple[Line, ...]:
    """Eqs. (22) and (23)."""
    printed = {3: forms.row_3_as_printed, 5: forms.row_5_as_printed, 6: forms.row_6_as_printed}
    texts = {
        3: ("l1 cos th1 th1''^2 + l2/2 cos th2 th2''^2", "l1 cos th1 th1'^2 + l2/2 cos th2 th2'^2"),
        5: ("l2/2 cos th2 th2''^2", "l2/2 cos th2 th2'^2"),
        6: ("l2/2 sin th2 th2''^2", "l2/2 sin th2 th2'^2"),
    }
    rows = tuple(
        Line(
            YUAN_GE,
            "(23)",
            f"row {k} of g",
            texts[k][0],
            texts[k][1],
            Verdict.MISPRINT,
            printed[k],
            forms.corrected(k),
            forms.row_off(k),
            "residual of the row of J a = g at true motions, relative to the largest acceleration",
            ROUNDING,
            NEAR,
            "The square is of the angular velocity; with the acceleration, the equations would not even be linear in it.",
        )
        for k in printed
    )
    return (
        right(
            YUAN_GE,
            "(22)",
            "Jacobian but for one entry",
            "J as printed, all entries but (6, 6)",
            crank_slider.jacobian,
            forms.jacobian_off,
            "largest difference from the derivatives of (21)",
            ROUNDING,
            NEAR,
            "Right.",
        ),
        Line(
            YUAN_GE,
            "(22)",
            "entry (6, 6) of the Jacobian",
            "l2/2 sin th2",
            "l2/2 cos th2",
            Verdict.MISPRINT,
            forms.entry_as_printed,
            forms.entry,
            forms.entry_off,
            "difference from the derivative of (21), relative to l2/2",
            ROUNDING,
            NEAR,
            "At the start, where th2 = 0, the printed entry vanishes: the rod's end would not be held in the guide.",
            Example(AT_START, forms.crank_with_entry, true_crank_at_start),
        ),
        right(
            YUAN_GE,
            "(23)",
            "rows 1, 2 and 4 of g",
            "-l1/2 cos th1 th1'^2, -l1/2 sin th1 th1'^2, l1 sin th1 th1'^2 + l2/2 sin th2 th2'^2",
            forms.rows_1_2_4,
            forms.row_off(1, 2, 4),
            "residual of these rows of J a = g at true motions, relative to the largest acceleration",
            ROUNDING,
            NEAR,
            "Right, signs included.",
        ),
        *rows,
    )


def course() -> tuple[Line, ...]:
    """The start and the figures."""
    return (
        right(
            YUAN_GE,
            "(24)",
            "start",
            "q = [0.075, 0, 0, 0.43, 0, 0, 0.71], q' = 0",
            forms.start,
            forms.start_off,
            "residual of (21) and distance from the linkage file's start, relative to l1 + l2",
            1e-15,
            "a few roundings of decimal fractions",
            "It satisfies (21) to the last digit.",
        ),
        Line(
            YUAN_GE,
            "section 4",
            "figures of the crank's centre",
            "figures 1 to 5",
            "figures 2 to 5",
            Verdict.MISPRINT,
            forms.figures_as_printed,
            forms.figures,
            forms.figures_off,
            "figures too many or too few",
            0.0,
            "a count",
            "Figure 1 is the drawing; displacement and velocity in x and y are four figures.",
        ),
    )


def lines() -> tuple[Line, ...]:
    return (*system(), *derivatives(), *course())
