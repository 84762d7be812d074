"""The axes of the atlas: for each a family of linkages that becomes harder with one number, everything else as it was.

Most are the four-bar of `mechanisms/`, started at a given crank speed without motor and brake, under gravity.

    singular     crank-rocker whose smallest transmission angle [deg] shrinks: it passes its dead centres ever closer
    redundancy   parallelogram on more cranks than it needs, hanging: redundant constraint rows
    mass         coupler heavier than crank and rocker by this factor
    stiffness    spring [N/m] from the ground to the coupler, squeezed by a twentieth of its length
    speed        of the crank at the start [rad/s]
    step         of the integration [s]
    size         windows of the N-four-bar, hanging, which is one pendulum whatever their number
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.linkage.generate import LENGTH, MASS, n_four_bar
from gauss_bench.linkage.load import document_of, load_document
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import SpringDamper
from gauss_bench.terms import Array

SCENARIO = "run"
STEP = 1e-3  # [s] of all axes but those that say otherwise
TURN = 2 * np.pi  # [rad/s] of the crank, where speed is not the axis
DENSITY = 0.8  # [kg/m] of bars
SQUEEZED = 1.05  # rest length of the spring, of its length at the start
RELEASE = -60.0  # [deg] of what hangs
G = 9.81  # [m/s^2]

Truth = Callable[[float, Array, float], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class Family:
    """One axis.

    Attributes:
        title, meaning, unit: for people.
        values: from easy to hard.
        document: the linkage file of a value, whose scenario is SCENARIO.
        step: integration step [s] of a value.
        truth: q, v, a (k, n) of a value at times (k,) to a relative tolerance, where a simpler equation has the same motion; else
            None, and the suite's own DOP853 says it.
    """

    name: str
    title: str
    meaning: str
    unit: str
    values: tuple[float, ...]
    document: Callable[[float], dict[str, Any]]
    step: Callable[[float], float] = lambda value: STEP
    truth: Truth | None = None


def ladder(first: float, last: float, each: tuple[float, ...] = (1.0, 3.0)) -> tuple[float, ...]:
    """Numbers from first to last, up or down, with these leading digits in every decade."""
    low, high = sorted((first, last))
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    rungs = [float(f"{digit:g}e{power}") for power in powers for digit in each]
    kept = [x for x in rungs if low * (1 - 1e-9) <= x <= high * (1 + 1e-9)]
    return tuple(kept if first < last else reversed(kept))


def four_bar(speed: float = TURN, duration: float = 0.5, crank_deg: float = 60.0) -> dict[str, Any]:
    """The four-bar of `mechanisms/`, let go with a crank speed."""
    document = copy.deepcopy(document_of("four_bar")[0])
    for key in ("forces", "measure"):
        document.pop(key, None)
    document["scenarios"] = {SCENARIO: {"duration": duration, "start": {"crank_deg": crank_deg, "speed": speed}}}
    return document


def singular(angle: float) -> dict[str, Any]:
    """A crank-rocker with the lengths 1/2 - d, 1, 1/2, 1, whose transmission angle is `angle` [deg] where it is smallest."""
    d = float(np.sqrt(1.25 - np.cos(np.radians(angle)))) - 0.5
    document = four_bar()
    lengths = {"crank": 0.5 - d, "coupler": 1.0, "rocker": 0.5}
    ends = {"crank": "AB", "coupler": "BC", "rocker": "DC"}
    document["ground"]["points"] = {"A": [0.0, 0.0], "D": [1.0, 0.0]}
    document["links"] = {
        name: {"points": {ends[name][0]: [0.0, 0.0], ends[name][1]: [x, 0.0]}, "bars": [list(ends[name])], "kg_per_m": DENSITY}
        for name, x in lengths.items()
    }
    document["observe"] = {"points": ["coupler.C"]}
    turn = np.radians(60.0)
    document["assembly"] = {"sketch": {"B": [float((0.5 - d) * np.cos(turn)), float((0.5 - d) * np.sin(turn))], "C": [1.2, 0.45]}}
    return document


def redundancy(count: float) -> dict[str, Any]:
    """A coupler on 2 + count equal cranks."""
    cranks = [f"crank{i}" for i in range(2 + round(count))]
    bar = {"points": {"A": [0.0, 0.0], "B": [LENGTH, 0.0]}, "bars": [["A", "B"]], "mass": MASS}
    points = {f"B{i}": [0.5 * i, 0.0] for i in range(len(cranks))}
    coupler = {"points": points, "bars": [[a, b] for a, b in zip(points, list(points)[1:], strict=False)], "mass": MASS}
    joints = {f"A{i}": {"type": "revolute", "at": [f"ground.A{i}", f"{x}.A"]} for i, x in enumerate(cranks)}
    joints |= {f"B{i}": {"type": "revolute", "at": [f"{x}.B", f"coupler.B{i}"]} for i, x in enumerate(cranks)}
    angles = dict.fromkeys(cranks, RELEASE) | {"coupler": 0.0}
    return {
        "format": "planar-linkage/1",
        "name": "cranks",
        "crank": cranks[0],
        "ground": {"points": {f"A{i}": [0.5 * i, 0.0] for i in range(len(cranks))}},
        "links": dict.fromkeys(cranks, bar) | {"coupler": coupler},
        "joints": joints,
        "assembly": {"angles_deg": angles},
        "scenarios": {SCENARIO: {"duration": 0.5, "start": {"crank_deg": RELEASE, "speed": 0.0}}},
    }


def mass(ratio: float) -> dict[str, Any]:
    """The four-bar with crank and rocker lighter than they are, by this factor."""
    document = four_bar()
    for name in ("crank", "rocker"):
        document["links"][name]["kg_per_m"] = DENSITY / ratio
    return document


def stiffness(k: float) -> dict[str, Any]:
    """The four-bar held by a spring at the coupler's point P, without a speed at the start."""
    document = four_bar(speed=0.0, duration=0.2)
    document["ground"]["points"]["S"] = [-0.4, 0.3]
    document["forces"] = {"spring": {"type": "spring_damper", "between": ["ground.S", "coupler.P"], "k": k, "rest": 0.0}}
    document["scenarios"][SCENARIO]["forces"] = ["spring"]
    assembled = load_document(copy.deepcopy(document), SCENARIO)
    (held,) = (x for x in assembled.forces if isinstance(x, SpringDamper))
    way = position(assembled.q0, held.b) - position(assembled.q0, held.a)
    document["forces"]["spring"]["rest"] = SQUEEZED * float(np.hypot(*way))
    return document


def size(count: float) -> dict[str, Any]:
    """The N-four-bar, hanging at an angle."""
    document = n_four_bar(round(count))
    document["assembly"] = {"angles_deg": {x: RELEASE if x.startswith("v") else 0.0 for x in document["links"]}}
    document["scenarios"] = {SCENARIO: {"duration": 0.1, "start": {"crank_deg": RELEASE, "speed": 0.0}}}
    return document


def pendulum(count: float, t: Array, tolerance: float) -> tuple[Array, Array, Array]:
    """The motion of `size`: N + 1 bars that turn and N that are carried are one pendulum.

    (N + 1) / 3 + N times m l^2 of inertia about the pivots, and (N + 1) / 2 + N times m g l of moment.
    """
    from scipy.integrate import solve_ivp

    n = round(count)
    k = G / LENGTH * ((n + 1) / 2 + n) / ((n + 1) / 3 + n)
    solution = solve_ivp(
        lambda _, y: [y[1], -k * np.cos(y[0])],
        (0.0, float(t[-1])),
        [np.radians(RELEASE), 0.0],
        "DOP853",
        t,
        rtol=tolerance,
        atol=tolerance / 100,
    )
    angle, rate = solution.y
    second = -k * np.cos(angle)
    along = LENGTH * np.exp(1j * angle)
    speed, push = 1j * rate * along, (1j * second - rate**2) * along
    q, v, a = (np.zeros((len(t), 3 * (2 * n + 1))) for _ in range(3))
    for i in range(2 * n + 1):
        upright = i <= n
        share, place = (0.5, i * LENGTH) if upright else (1.0, (i - n - 0.5) * LENGTH)
        for level, way, turn in ((q, place + share * along, angle), (v, share * speed, rate), (a, share * push, second)):
            level[:, 3 * i], level[:, 3 * i + 1], level[:, 3 * i + 2] = way.real, way.imag, turn * upright
    return q, v, a


FAMILIES = {
    x.name: x
    for x in (
        Family(
            "singular",
            "distance to a dead centre",
            "smallest transmission angle",
            "deg",
            ladder(20.0, 0.01, (1.0, 2.0, 5.0)),
            singular,
        ),
        Family("redundancy", "redundancy", "redundant constraint rows", "", (0.0, 1.0, 2.0, 3.0), redundancy),
        Family("mass", "mass ratio", "coupler against crank and rocker", "", ladder(1.0, 1e6), mass),
        Family("stiffness", "stiffness", "spring squeezed at the coupler, at a step of 1 ms", "N/m", ladder(1e2, 1e7), stiffness),
        Family("speed", "speed", "of the crank, at a step of 1 ms", "rad/s", ladder(3.0, 1e3), four_bar),
        Family(
            "step",
            "step",
            "of the integration, at one turn a second",
            "s",
            ladder(5e-4, 0.1, (1.0, 2.0, 5.0)),
            lambda x: four_bar(),
            lambda x: x,
        ),
        Family(
            "size",
            "size",
            "windows of the N-four-bar, 10 steps",
            "",
            (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0),
            size,
            lambda x: 1e-2,
            pendulum,
        ),
    )
}
