"""Define the computations ("questions") that are made with every release of an engine's library.

    accelerations:  accelerations at states in motion and at rest, in every setting and variant
    motion:         the motion over 1 s with steps of 1 ms, the gaps of loops at its end, and the number of steps if the integrator
                    chooses them
    closures:       accelerations of small models that are built with the library's own functions, one model for each kind of loop
                    closure (`probes.py`)
    defaults:       the default values of the library's options

Accelerations and motions are computed again from starts that differ by a relative 1e-14. The resulting change is an estimate of the
rounding error.
"""

from functools import cache
from pathlib import Path

import numpy as np

from gauss_bench.bench.measure import mechanism_of
from gauss_bench.engines.base import Choice
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.reference.build import build_reference, random_states
from gauss_bench.reference.certificate import find_certified
from gauss_bench.runs.offers import Offer
from gauss_bench.runs.questions import shift
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Samples

FOLDER = Path(__file__).parent / "linkages"
FIRST = str(FOLDER / "wide_four_bar.toml")  # linkage that is run with all variants; the others are run with the settings only
SLIDE, REDUNDANT, LARGE = "crank_slider:conservative", "parallelogram:conservative", "eight_bar:conservative"
FURTHER = (SLIDE, REDUNDANT, LARGE)
STATES, SPEED = 6, 5.0  # number of states in motion of each linkage, and largest crank speed [rad/s]
SHIFTS = 3  # number of slightly changed starts
STEP, UNTIL = 1e-3, 1.0  # [s] step and end of the runs
SAMPLES = 0.25 * np.arange(5)  # [s] times at which runs are compared

Case = tuple[str, str, Choice]  # path or name of a linkage; its scenario, "" for the first one; and a setting


def list_cases(offer: Offer) -> list[Case]:
    """Return the cases of an engine: every variant and setting on the linkage FIRST, and every setting on the other linkages."""
    # name of a setting or variant -> integrator and stabilization
    variants = {name: (x.integrator, x.stabilization) for name, x in offer.variants.items()}
    settings = dict.fromkeys(offer.settings, (offer.integrators[0], "none"))
    cases = [(FIRST, "", Choice(name, *method, STEP)) for name, method in (settings | variants).items()]
    for text in FURTHER:
        linkage, scenario = linkage_of(text)
        cases += [(linkage, scenario, Choice(name, *method, STEP)) for name, method in settings.items()]
    return cases


def linkage_of(text: str) -> tuple[str, str]:
    """Return linkage and scenario of a text LINKAGE:SCENARIO; the name of a file in `linkages` becomes its path."""
    linkage, _, scenario = text.partition(":")
    own = FOLDER / f"{linkage}.toml"
    return (str(own) if own.is_file() else linkage), scenario


@cache
def states_of(linkage: str, scenario: str) -> Samples:
    """Return the states of a linkage at which accelerations are computed, with their true accelerations.

    They are STATES random states and the same positions at rest, and then slightly changed copies of both (`with_shifts`).
    """
    mechanism = mechanism_of(linkage, scenario)
    moving = random_states(mechanism, STATES, speed=SPEED)
    q, v = np.concatenate([moving.q, moving.q]), np.concatenate([moving.v, np.zeros_like(moving.v)])
    t = np.zeros(len(q))
    a = AbsoluteCoordinates(mechanism).acceleration(t, q, v)
    return with_shifts(q, v, a)


def with_shifts(q: Array, v: Array, a: Array) -> Samples:
    """Return states with their true accelerations, followed by SHIFTS copies of the states that are slightly changed at random.

    The change has the size of rounding errors. The returned `t` (zero), `q` and `v` have (1 + SHIFTS) k rows, and `a` has k.

    Args:
        q, v, a: (k, n) unchanged states, and their true accelerations.
    """
    rng = np.random.default_rng(0)
    copies = [(q, v), *((shift(q, rng), shift(v, rng)) for _ in range(SHIFTS))]
    all_q, all_v = (np.concatenate(x) for x in zip(*copies, strict=True))
    return Samples(np.zeros(len(all_q)), all_q, all_v, a)


@cache
def truth_of(linkage: str, scenario: str) -> Reference:
    """Return the certified motion of a linkage, or else a computed reference."""
    mechanism = mechanism_of(linkage, scenario)
    return find_certified(mechanism, UNTIL) or build_reference(mechanism, UNTIL)
