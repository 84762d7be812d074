"""The example of Yuan & Ge (2016), section 4, run again: whether the crank-slider "finally stops in an equilibrium".

Everything is computed from the linkage file and the closed form of `crank_motion`; no number is kept here but the torques that are
asked about. Where it can rest, and with which data it comes to rest, is computed in `rest`, the steady turning in `running`. The
paper's figures are computed from a reference. Inertias and gravity, which the paper does not give, are assumed throughout.
"""

from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.interpolate import BPoly

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.papers.crank_motion import EQ_16, EQS_10_11, RTOL, TRUE, CrankMotion, motion_of
from gauss_bench.papers.crank_slider import GRAVITY, KEPT, linkage
from gauss_bench.papers.rest import Bound, equilibria, find_bound, settles, torque_range
from gauss_bench.papers.running import balance_speed, regime, swept
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference

COARSE = 1e2  # of the tolerance: what a run with it differs by is more than what the finer one is off
ASKED = (-0.2, 0.2, 0.5)  # [N m] torques that let it settle; the last is the printed one the other way round
STATIC_WIDTH = 1e-6  # relative: below it the first swing sinks into the integrator's absolute tolerance
CORNER_WIDTH = 1e-6  # relative: the bounds of other inertias are quoted to six digits
INERTIAS = (0.0, 1.0, 2.0, 3.0)  # of a uniform bar's, centre of mass in the middle: 0 all of it there, 3 half at either end
CORNERS = ((0.0, 0.0), (0.0, 3.0), (3.0, 0.0), (3.0, 3.0))  # of crank and rod
SAME = 1e-6  # relative: far above rounding, far below any difference of formulas
WATCHED = 2.0  # [s] as long as the linkage file's scenario
ROWS = 601  # of the table of the paper's figures
SPAN = 4.0  # [s] drawn at most: on a longer axis the turns would run together
COLUMNS = {"x1": 0, "y1": 1, "theta1": 2, "x3": 6}  # of the paper's seven coordinates


@dataclass(frozen=True)
class Quantity:
    """One row of the reproduction: a number with its unit and uncertainty, or a claim with its verdict, and a sentence.

    Attributes:
        group: chapter of the table; key: short name by which the report finds the row, unique.
        quantity: in words; value: None for a claim or an omission; unit.
        bracket: what the value is uncertain by, None where it is exact to rounding.
        verdict: of a claim: "refuted", "holds" or "not shown".
    """

    group: str
    key: str
    quantity: str
    value: float | None = None
    unit: str = ""
    bracket: float | None = None
    verdict: str = ""
    statement: str = ""

    def row(self) -> dict[str, Any]:
        return asdict(self)


def reproduction() -> dict[str, Any]:
    """{"reproduction": rows}: see `Quantity` for their columns."""
    motion = motion_of(linkage())
    rows = [
        *list_given(motion),
        *running(motion),
        *statics(motion),
        *settling(motion),
        *formulas(motion),
        *claims(motion),
        *list_gaps(),
    ]
    return {"reproduction": [quantity.row() for quantity in rows]}


def list_given(motion: CrankMotion) -> list[Quantity]:
    """The data that the paper gives and everything below is about."""
    return [
        Quantity("given", "torque", "torque on the crank", motion.torque, "N m"),
        Quantity("given", "damper", "damper at the slider", motion.c, "N s/m"),
        Quantity("given", "watched", "time at which formulas are compared", WATCHED, "s"),
    ]


def running(motion: CrankMotion) -> list[Quantity]:
    """The regime that the printed data lead to."""
    fine, coarse = regime(motion), regime(motion, COARSE * RTOL)
    named = {
        "first_time": ("time of the first turn from rest", "s"),
        "first_speed": ("crank speed after the first turn", "rad/s"),
        "steady_after": ("time until turns start within 1 % of the steady speed", "s"),
        "mean": ("mean crank speed, steady", "rad/s"),
        "slowest": ("slowest crank speed within a turn, steady", "rad/s"),
        "fastest": ("fastest crank speed within a turn, steady", "rad/s"),
        "period": ("time of a turn, steady", "s"),
        "taken": ("energy from the torque in a turn", "J"),
        "lost": ("energy lost in the damper in a turn, steady", "J"),
    }
    quantities = []
    for key, (quantity, unit) in named.items():
        value = float(getattr(fine, key))
        bracket = abs(value - getattr(coarse, key)) if key != "taken" else None
        quantities.append(Quantity("running", key, quantity, value, unit, bracket))
    area = Quantity("running", "swept", "integral of (dx3/dtheta)^2 over a turn", swept(motion), "m^2")
    balance = Quantity("running", "balance", "constant speed at which the damper would take it all", balance_speed(motion), "rad/s")
    return [*quantities, area, balance]


def statics(motion: CrankMotion) -> list[Quantity]:
    """Torque of weight and spring, and where the crank can rest."""
    low, high = torque_range(motion)
    quantities = [
        Quantity("static", "force_least", "least static torque of weight and spring", low.torque, "N m"),
        Quantity("static", "force_least_at", "its crank angle", low.theta, "rad", 1e-8),
        Quantity("static", "force_most", "largest static torque of weight and spring", high.torque, "N m"),
        Quantity("static", "force_most_at", "its crank angle", high.theta, "rad", 1e-8),
    ]
    for torque in (motion.torque, 0.0):
        tag = "printed" if torque else "idle"
        for place in equilibria(replace(motion, torque=torque)):
            kind = "stable" if place.stable else "unstable"
            words = f"{kind} equilibrium at {torque:g} N m"
            quantities.append(Quantity("equilibria", f"{kind}_{tag}", words, place.theta, "rad"))
    return quantities


def settling(motion: CrankMotion) -> list[Quantity]:
    """Torques and dampers that let it come to rest from the printed start."""

    def twisted(torque: float) -> CrankMotion:
        return replace(motion, torque=torque)

    def damped(c: float) -> CrankMotion:
        return replace(motion, c=c)

    low, high = torque_range(motion)
    lower = find_bound(twisted, 0.0, 2 * -high.torque)
    upper = find_bound(twisted, 0.0, 2 * -low.torque, STATIC_WIDTH)
    least = find_bound(damped, 32.0, motion.c)
    quantities = [
        limit("settles_above", "settles from rest at theta = 0 for torques above", lower, "N m"),
        limit("settles_below", "settles from rest at theta = 0 for torques below", upper, "N m"),
        limit("damping", f"settles at {motion.torque:g} N m for dampers above", least, "N s/m"),
    ]
    others = [find_bound(partial(heavier, motion, *corner), 0.0, 2 * -high.torque, CORNER_WIDTH) for corner in CORNERS]
    for word, chosen in (("lowest", min), ("highest", max)):
        words = f"the {word} of these bounds with the least or the most inertia of crank and rod"
        quantities.append(limit(f"settles_above_{word}", words, chosen(others, key=lambda x: x.value), "N m"))
    return [*quantities, *(resting(twisted(torque)) for torque in ASKED)]


def limit(key: str, quantity: str, at: Bound, unit: str) -> Quantity:
    return Quantity("settling", key, quantity, at.value, unit, at.bracket)


def heavier(motion: CrankMotion, crank: float, rod: float, torque: float) -> CrankMotion:
    """Crank and rod with these multiples of a uniform bar's inertia, and another torque."""
    factors = (1.0, 1.0, crank, 1.0, 1.0, rod, 1.0)
    return replace(motion, mass=tuple(m * k for m, k in zip(motion.mass, factors, strict=True)), torque=torque)


def resting(motion: CrankMotion) -> Quantity:
    """The crank angle at which it comes to rest: the only stable equilibrium.

    Raises:
        ArithmeticError: it does not come to rest there, or there are several to choose from.
    """
    places = [place.theta for place in equilibria(motion) if place.stable]
    if not settles(motion) or len(places) != 1:
        raise ArithmeticError(f"at {motion.torque:g} N m the crank has no single place to rest")
    return Quantity("settling", f"rest_at_{motion.torque:g}", f"comes to rest at {motion.torque:g} N m", places[0], "rad")


def formulas(motion: CrankMotion) -> list[Quantity]:
    """The example as the wrong formulas would have it."""
    quantities = []
    for key, formula in (("true", TRUE), ("eq16", EQ_16), ("eqs10_11", EQS_10_11)):
        other = replace(motion, formula=formula)
        ends = [other.run(WATCHED, rtol=rtol) for rtol in (RTOL, COARSE * RTOL)]
        start = float(other.acceleration(0.0, 0.0))
        w, bracket = float(ends[0].w[-1]), abs(float(ends[0].w[-1] - ends[1].w[-1]))
        quantities += [
            Quantity("formulas", f"start_{key}", f"crank acceleration at the start, {formula}", start, "rad/s^2"),
            Quantity("formulas", f"speed_{key}", f"crank speed after {WATCHED:g} s, {formula}", w, "rad/s", bracket),
        ]
    return quantities


def claims(motion: CrankMotion) -> list[Quantity]:
    """Claims of the paper on its example, held against the computation."""
    stops = settles(motion)
    wrong, true = (replace(motion, formula=formula).acceleration(0.0, 0.0) for formula in (EQ_16, TRUE))
    any_inertia = not any(settles(heavier(motion, i, k, motion.torque)) for i in INERTIAS for k in INERTIAS)
    turn = "The crank {} its first turn from rest, which decides."
    decided = turn.format("does not complete" if stops else "completes")
    return [
        claim("stops", "the mechanism finally stops in an equilibrium", stops, decided),
        claim("decreases", "the slider's amplitude and speed decrease with time", stops, decided),
        claim(
            "formula",
            "eq. (16) gives the true accelerations",
            bool(abs(wrong / true - 1) < SAME),
            "Compared at the printed start; see the audit.",
        ),
        claim(
            "dissipative",
            "with its damper the mechanism is dissipative",
            settles(replace(motion, torque=0.0)),
            "Tried without the torque, which feeds it for ever.",
        ),
        claim(
            "rests",
            "there is an equilibrium to stop in",
            any(place.stable for place in equilibria(motion)),
            "At the printed torque, whether the printed start leads to it or not.",
        ),
        claim(
            "any_inertia",
            "(of this report) it never stops, whatever the inertias that are not given",
            any_inertia,
            f"Tried with {len(INERTIAS) ** 2} pairs of inertias between all mass in the middle and all mass at the ends.",
        ),
        Quantity(
            "claims",
            "efficient",
            "the method has a higher efficiency",
            verdict="not shown",
            statement="No time and no comparison is printed; what it costs is measured in the tables of this report.",
        ),
        Quantity(
            "claims",
            "other_way",
            "(of this report, a guess) the figures show the torque turned the other way",
            verdict="not shown",
            statement="With the other sign the same torque does settle; the figures would have to be compared.",
        ),
    ]


def claim(key: str, words: str, holds: bool, statement: str) -> Quantity:
    return Quantity("claims", key, words, verdict="holds" if holds else "refuted", statement=statement)


LEFT_OUT = {
    "inertias": (
        "inertias of crank and rod",
        "uniform bars are taken; the bounds are given for the least and the most inertia as well",
    ),
    "gravity": ("acceleration of gravity", f"{GRAVITY:g} m/s^2 is taken"),
    "integrator": ("integrator, step and tolerance", "two integrators of high order are taken, which agree"),
    "span": ("time span of the figures", "the first seconds are drawn, and the regime they lead to is computed"),
    "values": ("numbers of any result", "nothing can be compared but the words about the figures"),
}


def list_gaps() -> list[Quantity]:
    """Data that the paper does not give, and what is taken here."""
    return [Quantity("left out", key, words, statement=taken) for key, (words, taken) in LEFT_OUT.items()]


def paper_motion(mechanism: Mechanism, reference: Reference) -> dict[str, Any]:
    """The paper's figures 2 to 9, positions and speeds of crank and slider, from a reference: {"paper_motion": rows}.

    Columns t, x1, x1_rate, y1, y1_rate, theta1, theta1_rate, x3, x3_rate [s, m, rad].

    Between samples the motion is the polynomial that has their positions, velocities and accelerations at both ends.

    Raises:
        ValueError: the mechanism is not the crank-slider, or the reference not of this mechanism.
    """
    if mechanism.name != "crank_slider" or reference.q.shape[1] != mechanism.n:
        raise ValueError(f"{mechanism.name}: not the crank-slider with its reference")
    t = np.linspace(0.0, min(SPAN, float(reference.t[-1])), ROWS)
    kept = np.array(KEPT)[list(COLUMNS.values())]
    levels = np.stack([reference.q[:, kept], reference.v[:, kept], reference.a[:, kept]], axis=1)
    curve = BPoly.from_derivatives(reference.t, levels)
    return {"paper_motion": [motion_row(*x) for x in zip(t, curve(t), curve.derivative()(t), strict=True)]}


def motion_row(t: float, place: Array, rate: Array) -> dict[str, float]:
    """One row."""
    row = {"t": float(t)}
    for name, x, x_rate in zip(COLUMNS, place, rate, strict=True):
        row |= {name: float(x), f"{name}_rate": float(x_rate)}
    return row
