"""The questions that every release of an engine is asked.

    accelerations   at states in motion and at rest, the same for every release, in every setting and variant
    motion          over 1 s at steps of 1 ms, with the drift of the loops; steps taken, where the integrator chooses them
    closures        accelerations of small models of the library's own, one for each kind of closure that it has (`probes`)
    defaults        values that the library sets where nobody says anything

Every question is asked again from starts that differ by 1e-14 of their size: what an answer then changes by is rounding.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.reference.build import build_reference, random_states
from gauss_bench.reference.certificate import find_certified
from gauss_bench.runs.offers import Offer
from gauss_bench.runs.questions import shift
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference

FOLDER = Path(__file__).parent / "linkages"
FIRST = str(FOLDER / "wide_four_bar.toml")  # every variant is asked on it, settings alone on the others
SLIDE, REDUNDANT, LARGE = "crank_slider:conservative", "parallelogram:conservative", "eight_bar:conservative"
FURTHER = (SLIDE, REDUNDANT, LARGE)
STATES, SPEED = 6, 5.0  # states of each linkage; largest crank speed [rad/s]
SHIFTS = 3  # how many changed starts are tried
STEP, UNTIL = 1e-3, 1.0  # [s] of the runs
SAMPLES = 0.25 * np.arange(5)  # [s]


@dataclass(frozen=True, eq=False)
class States:
    """States at which accelerations are asked for.

    Attributes:
        t, q, v: (k,) and (k, n), first those of `moving`, then those at rest, then both again from each changed start.
        a: (2 STATES, n) true accelerations of the first two groups.
    """

    t: Array
    q: Array
    v: Array
    a: Array


@dataclass(frozen=True)
class Case:
    """A linkage with a setting.

    Attributes:
        linkage, scenario: which are loaded; settings, integrator, stabilization: as in a Choice.
    """

    linkage: str
    scenario: str
    settings: str
    integrator: str
    stabilization: str

    @property
    def setting(self) -> str:
        """The setting in words."""
        return " ".join(x for x in (self.settings, self.integrator, self.stabilization) if x != "none")


def list_cases(offer: Offer) -> list[Case]:
    """Return the cases of an engine: every variant and setting on the first linkage, every setting on the others."""
    named = {name: (x.integrator, x.stabilization) for name, x in offer.variants.items()}
    plain = dict.fromkeys(offer.settings, (offer.integrators[0], "none"))
    cases = [Case(FIRST, "", name, *chosen) for name, chosen in (plain | named).items()]
    for text in FURTHER:
        linkage, scenario = linkage_of(text)
        cases += [Case(linkage, scenario, name, *chosen) for name, chosen in plain.items()]
    return cases


def linkage_of(text: str) -> tuple[str, str]:
    """Return linkage and scenario of a text LINKAGE:SCENARIO; a linkage of `linkages` may be named without its folder."""
    linkage, _, scenario = text.partition(":")
    own = FOLDER / f"{linkage}.toml"
    return (str(own) if own.is_file() else linkage), scenario


@cache
def find_mechanism(linkage: str, scenario: str) -> Mechanism:
    """Return the mechanism of a case."""
    return load(linkage, scenario or None)


@cache
def states_of(linkage: str, scenario: str) -> States:
    """Return the states of a linkage, in motion and at rest, with the changed starts."""
    mechanism = find_mechanism(linkage, scenario)
    drawn = random_states(mechanism, STATES, speed=SPEED)
    q, v = np.concatenate([drawn.q, drawn.q]), np.concatenate([drawn.v, np.zeros_like(drawn.v)])
    t = np.zeros(len(q))
    a = AbsoluteCoordinates(mechanism).acceleration(t, q, v)
    return with_shifts(q, v, a)


def with_shifts(q: Array, v: Array, a: Array) -> States:
    """Return states q, v (k, n) with their true accelerations, followed by SHIFTS copies that differ by SHIFT."""
    rng = np.random.default_rng(0)
    many_q, many_v = [q], [v]
    for _ in range(SHIFTS):
        many_q.append(shift(q, rng))
        many_v.append(shift(v, rng))
    return States(np.zeros(len(q) * (1 + SHIFTS)), np.concatenate(many_q), np.concatenate(many_v), a)


@cache
def truth_of(linkage: str, scenario: str) -> Reference:
    """Return the reference of a linkage: certified where there is a certificate."""
    mechanism = find_mechanism(linkage, scenario)
    return find_certified(mechanism, UNTIL) or build_reference(mechanism, UNTIL)


@cache
def evaluator_of(linkage: str, scenario: str) -> Evaluator:
    """Return the evaluator of a linkage."""
    return Evaluator(find_mechanism(linkage, scenario))
