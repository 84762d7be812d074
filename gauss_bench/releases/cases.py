"""The computations that are made with every release of an engine's library, called questions.

They are:

    accelerations:  accelerations at states in motion and at rest, in every setting and variant
    motion:         the motion over 1 s at steps of 1 ms, the gaps of loops at its end, and the number of steps if the integrator
                    chooses them
    closures:       accelerations of small models that are built with the library's own functions, one model for each kind of loop
                    closure (`probes.py`)
    defaults:       the default values of the library's options

Every computation is repeated from starts that differ by a relative 1e-14. The resulting change of the result is an estimate of the
rounding error of the result.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.reference.build import build_reference, random_states
from gauss_bench.reference.certificate import find_certified
from gauss_bench.runs.offers import Offer
from gauss_bench.runs.questions import shift
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference

FOLDER = Path(__file__).parent / "linkages"
FIRST = str(FOLDER / "wide_four_bar.toml")  # linkage that is run with all variants; the others are run with the settings only
SLIDE, REDUNDANT, LARGE = "crank_slider:conservative", "parallelogram:conservative", "eight_bar:conservative"
FURTHER = (SLIDE, REDUNDANT, LARGE)
STATES, SPEED = 6, 5.0  # number of states in motion of each linkage, and largest crank speed [rad/s]
SHIFTS = 3  # number of slightly changed starts
STEP, UNTIL = 1e-3, 1.0  # [s] step and end of the runs
SAMPLES = 0.25 * np.arange(5)  # [s] times at which runs are compared


@dataclass(frozen=True, eq=False)
class States:
    """The k = 2 STATES (1 + SHIFTS) states of a linkage at which each release of a library computes accelerations.

    Attributes:
        t: (k,) times of the states, which are all zero.
        q, v: (k, n) positions and velocities. First come STATES states in motion, then STATES states at rest. Then come SHIFTS
            copies of these 2 STATES states, with slightly changed numbers.
        a: (2 STATES, n) true accelerations at the unchanged states.
    """

    t: Array
    q: Array
    v: Array
    a: Array


@dataclass(frozen=True)
class Case:
    """A linkage with a setting.

    Attributes:
        linkage, scenario: path or name of the linkage, and scenario; "" is the first one.
        settings, integrator, stabilization: names as the engine offers them.
    """

    linkage: str
    scenario: str
    settings: str
    integrator: str
    stabilization: str

    @property
    def setting(self) -> str:
        """The setting as a text."""
        return " ".join(x for x in (self.settings, self.integrator, self.stabilization) if x != "none")


def list_cases(offer: Offer) -> list[Case]:
    """Return the cases of an engine: every variant and setting on the linkage FIRST, and every setting on the other linkages."""
    # name of a setting or variant -> integrator and stabilization
    variants = {name: (x.integrator, x.stabilization) for name, x in offer.variants.items()}
    plain = dict.fromkeys(offer.settings, (offer.integrators[0], "none"))
    cases = [Case(FIRST, "", name, *chosen) for name, chosen in (plain | variants).items()]  # "": the first scenario
    for text in FURTHER:
        linkage, scenario = linkage_of(text)
        cases += [Case(linkage, scenario, name, *chosen) for name, chosen in plain.items()]
    return cases


def linkage_of(text: str) -> tuple[str, str]:
    """Return linkage and scenario of a text LINKAGE:SCENARIO; the name of a file in `linkages` becomes its path."""
    linkage, _, scenario = text.partition(":")
    own = FOLDER / f"{linkage}.toml"
    return (str(own) if own.is_file() else linkage), scenario


@cache
def find_mechanism(linkage: str, scenario: str) -> Mechanism:
    """Return the mechanism of a linkage in a scenario, "" for the first; it is loaded only once."""
    return load(linkage, scenario or None)


@cache
def states_of(linkage: str, scenario: str) -> States:
    """Return the states of a linkage at which accelerations are computed: random states, and the same positions at rest."""
    mechanism = find_mechanism(linkage, scenario)
    drawn = random_states(mechanism, STATES, speed=SPEED)
    q, v = np.concatenate([drawn.q, drawn.q]), np.concatenate([drawn.v, np.zeros_like(drawn.v)])
    t = np.zeros(len(q))
    a = AbsoluteCoordinates(mechanism).acceleration(t, q, v)
    return with_shifts(q, v, a)


def with_shifts(q: Array, v: Array, a: Array) -> States:
    """Return states with their true accelerations, followed by SHIFTS copies of the states that are slightly changed at random.

    The change has the size of rounding errors. The returned `q` and `v` have (1 + SHIFTS) k rows.

    Args:
        q, v, a: (k, n) unchanged states, and their true accelerations.
    """
    rng = np.random.default_rng(0)
    many = [(q, v), *((shift(q, rng), shift(v, rng)) for _ in range(SHIFTS))]
    many_q, many_v = (np.concatenate(x) for x in zip(*many, strict=True))
    return States(np.zeros(len(many_q)), many_q, many_v, a)


@cache
def truth_of(linkage: str, scenario: str) -> Reference:
    """Return the certified motion of a linkage, or else a computed reference."""
    mechanism = find_mechanism(linkage, scenario)
    return find_certified(mechanism, UNTIL) or build_reference(mechanism, UNTIL)
