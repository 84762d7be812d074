"""The axes of the atlas: each axis is a family of linkages that become harder to simulate as one number, its value, changes.

`axes.toml` has the names and values of the axes, and this module makes the linkage for a value. Most linkages are variants of the
four-bar in `mechanisms/`, under gravity, without motor and brake, with a given crank speed at the start. Each axis varies:

    singular:    the smallest transmission angle [deg] of a crank-rocker; at 0 the linkage passes through a singular position
    redundancy:  the number of cranks beyond two in a hanging parallelogram; each adds a redundant constraint row
    mass:        the mass per metre of the coupler divided by that of crank and rocker
    stiffness:   the stiffness [N/m] of a spring from the ground to the coupler, compressed by a twentieth of its length
    speed:       the speed of the crank at the start [rad/s]
    step:        the integration step [s]
    size:        the number of loops of a hanging N-four-bar, whose cranks move like one pendulum for every number of loops
"""

import copy
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.linkage.generate import LENGTH, MASS, n_four_bar
from gauss_bench.linkage.load import document_of, load_document
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.spaces import angles, places
from gauss_bench.terms import Array

SCENARIO = "run"
STEP = 1e-3  # [s] integration step, except on axes with steps of their own
TURN = 2 * np.pi  # [rad/s] crank speed at the start, one turn per second, except on the axis "speed"
DENSITY = 0.8  # [kg/m] mass of bars per length
SQUEEZED = 1.05  # relaxed length of the spring divided by its length at the start: the spring starts compressed
RELEASE = -60.0  # [deg] angle at which hanging linkages are released
G = 9.81  # [m/s^2]

Document = dict[str, Any]
Truth = Callable[[float, Array, float], Array]


@dataclass(frozen=True)
class Axis:
    """A family of linkages that become harder to simulate as one number, the value, changes.

    Attributes:
        name: key of the axis; title, meaning, unit: texts for users.
        values: values of the number, from the easiest to the hardest.
        document: function of the value that returns the content of a linkage file, with the scenario SCENARIO.
        step: function of the value that returns the integration step [s].
        truth: function of (value, times (k,) [s], relative tolerance) that returns the true q, v, a (3, k, n) from a simpler
            equation with the same motion; None if there is none, so that DOP853 computes the reference.
    """

    name: str
    title: str
    meaning: str
    unit: str
    values: tuple[float, ...]
    document: Callable[[float], Document]
    step: Callable[[float], float]
    truth: Truth | None = None


def scenario(duration: float, crank_deg: float, speed: float) -> Document:
    """Return the scenario SCENARIO of a linkage file: duration [s], and the crank's angle [deg] and speed [rad/s] at the start."""
    return {SCENARIO: {"duration": duration, "start": {"crank_deg": crank_deg, "speed": speed}}}


def four_bar(speed: float = TURN, duration: float = 0.5) -> Document:
    """Return the four-bar of `mechanisms/` without forces, with a crank speed [rad/s] at the start and a duration [s]."""
    document = {key: x for key, x in copy.deepcopy(document_of("four_bar")[0]).items() if key not in ("forces", "measure")}
    return document | {"scenarios": scenario(duration, 60.0, speed)}


def singular(angle: float) -> Document:
    """Return a crank-rocker whose smallest transmission angle is `angle` [deg]; at 0 it passes through a singular position.

    Ground and coupler have the length 1, the rocker 1/2. The angle between coupler and rocker is smallest when the crank lies on
    the line of the ground pins. In the triangle of coupler, rocker and the distance 1 - crank, the law of cosines gives (1 -
    crank)^2 = 1 + 1/4 - cos(angle).
    """
    crank = 1.0 - float(np.sqrt(1.25 - np.cos(np.radians(angle))))
    document, turn = four_bar(), np.radians(60.0)
    document["ground"]["points"] = {"A": [0.0, 0.0], "D": [1.0, 0.0]}
    document["links"] = {
        name: {"points": {ends[0]: [0.0, 0.0], ends[1]: [x, 0.0]}, "bars": [list(ends)], "kg_per_m": DENSITY}
        for name, ends, x in (("crank", "AB", crank), ("coupler", "BC", 1.0), ("rocker", "DC", 0.5))
    }
    document["observe"] = {"points": ["coupler.C"]}
    document["assembly"] = {"sketch": {"B": [float(crank * np.cos(turn)), float(crank * np.sin(turn))], "C": [1.2, 0.45]}}
    return document


def redundancy(count: float) -> Document:
    """Return a coupler that hangs on 2 + count equal parallel cranks, and is released at rest at the angle RELEASE."""
    cranks = [f"crank{i}" for i in range(2 + round(count))]
    bar = {"points": {"A": [0.0, 0.0], "B": [LENGTH, 0.0]}, "bars": [["A", "B"]], "mass": MASS}
    points = {f"B{i}": [0.5 * i, 0.0] for i in range(len(cranks))}
    coupler = {"points": points, "bars": [[a, b] for a, b in zip(points, list(points)[1:], strict=False)], "mass": MASS}
    joints = {f"A{i}": {"type": "revolute", "at": [f"ground.A{i}", f"{x}.A"]} for i, x in enumerate(cranks)}
    joints |= {f"B{i}": {"type": "revolute", "at": [f"{x}.B", f"coupler.B{i}"]} for i, x in enumerate(cranks)}
    return {
        "format": "planar-linkage/1",
        "name": "cranks",
        "crank": cranks[0],
        "ground": {"points": {f"A{i}": xy for i, xy in enumerate(points.values())}},
        "links": dict.fromkeys(cranks, bar) | {"coupler": coupler},
        "joints": joints,
        "assembly": {"angles_deg": dict.fromkeys(cranks, RELEASE) | {"coupler": 0.0}},
        "scenarios": scenario(duration=0.5, crank_deg=RELEASE, speed=0.0),
    }


def mass(ratio: float) -> Document:
    """Return the four-bar whose crank and rocker have 1 / ratio of the coupler's mass per length."""
    document = four_bar()
    for name in ("crank", "rocker"):
        document["links"][name]["kg_per_m"] = DENSITY / ratio
    return document


def stiffness(k: float) -> Document:
    """Return the four-bar, at rest at the start, with a spring of stiffness k [N/m] from the ground to the coupler's point P."""
    document = four_bar(speed=0.0, duration=0.2)
    document["ground"]["points"]["S"] = [-0.4, 0.3]
    assembled = load_document(copy.deepcopy(document), SCENARIO)
    along = position(assembled.q0, assembled.find_point("coupler.P")) - document["ground"]["points"]["S"]  # spring from S to P [m]
    spring = {"type": "spring_damper", "between": ["ground.S", "coupler.P"], "k": k, "rest": SQUEEZED * float(np.hypot(*along))}
    document["scenarios"][SCENARIO]["forces"] = ["spring"]
    return document | {"forces": {"spring": spring}}


def size(count: float) -> Document:
    """Return the N-four-bar with N = count, released at rest at the angle RELEASE [deg]."""
    document = n_four_bar(round(count))  # the N + 1 cranks are named v0, v1, ...; the N couplers stay horizontal
    document["assembly"] = {"angles_deg": {x: RELEASE if x.startswith("v") else 0.0 for x in document["links"]}}
    return document | {"scenarios": scenario(duration=0.1, crank_deg=RELEASE, speed=0.0)}


def pendulum(count: float, t: Array, tolerance: float) -> Array:
    """Return the motion q, v, a (3, k, n) of the N-four-bar of `size(count)` at times t (k,) [s].

    The linkage moves like one pendulum. Its N + 1 cranks turn by the same angle, and its N couplers move without turning; all bars
    have the mass m and the length l. Reduced to the crank angle, the inertia of the whole linkage is ((N + 1) / 3 + N) m l^2, and
    the moment of gravity is -((N + 1) / 2 + N) m g l cos(angle). In the linkage file, cranks come before couplers.
    """
    from scipy.integrate import solve_ivp

    n = round(count)
    k = G / LENGTH * ((n + 1) / 2 + n) / ((n + 1) / 3 + n)
    start, tolerances = [np.radians(RELEASE), 0.0], {"rtol": tolerance, "atol": tolerance / 100}
    angle, rate = solve_ivp(lambda _, y: [y[1], -k * np.cos(y[0])], (0.0, t[-1]), start, "DOP853", t, **tolerances).y
    second, crank = -k * np.cos(angle), LENGTH * np.exp(1j * angle)  # second rate; crank from ground pin to tip as complex numbers
    is_crank = np.arange(2 * n + 1) <= n
    share = np.where(is_crank, 0.5, 1.0)  # displacement of a bar's middle divided by that of the crank tips
    rest = LENGTH * np.where(is_crank, np.arange(2 * n + 1), np.arange(2 * n + 1) - n - 0.5)  # x of pins, and of midpoints
    states = np.zeros((3, len(t), load_document(size(count), SCENARIO).n))
    tips = (crank, 1j * rate * crank, (1j * second - rate**2) * crank)  # displacement of the tips, and its two time derivatives
    for x, tip, turn, offset in zip(states, tips, (angle, rate, second), (rest, 0.0, 0.0), strict=True):
        middles = offset + share * tip[:, None]  # (k, bars) of the bars
        places(x)[..., 0], places(x)[..., 1] = middles.real, middles.imag
        angles(x)[...] = is_crank * turn[:, None]
    return states


def read_axis(name: str, title: str, meaning: str, values: Sequence[float], step: float = STEP, unit: str = "") -> Axis:
    """Return the axis that a table of `axes.toml` describes; the arguments are its name and keys.

    The linkages are made by the function of this module that has the name of the axis, and on the axes "speed" and "step" by
    `four_bar`. On the axis "step" the value itself is the step [s]. On the axis "size" the motion follows from a simpler equation.
    """
    four_bars: dict[str, Callable[[float], Document]] = {"speed": four_bar, "step": lambda _: four_bar()}
    document = four_bars.get(name) or globals()[name]
    steps = (lambda value: value) if name == "step" else lambda _: step
    return Axis(name, title, meaning, unit, tuple(values), document, steps, pendulum if name == "size" else None)


TABLES = tomllib.loads(Path(__file__).with_name("axes.toml").read_text(encoding="utf-8"))
FAMILIES = {name: read_axis(name, **table) for name, table in TABLES.items()}
