"""The questions that every release of an engine is asked.

    accelerations   at states in motion and at rest, in every setting and variant
    motion          over 1 s at steps of 1 ms, the gaps of loops at its end, and the number of steps of adaptive integrators
    closures        accelerations of small models in the library's own terms, one for each kind of closure (`probes`)
    defaults        the library's default values

Every question is asked again from starts that differ by 1e-14 of their size. The change of the answer is an estimate of its
rounding error.
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
FIRST = str(FOLDER / "wide_four_bar.toml")  # linkage on which all variants are asked; the others have only settings
SLIDE, REDUNDANT, LARGE = "crank_slider:conservative", "parallelogram:conservative", "eight_bar:conservative"
FURTHER = (SLIDE, REDUNDANT, LARGE)
STATES, SPEED = 6, 5.0  # number of states in motion of each linkage, and largest crank speed [rad/s]
SHIFTS = 3  # number of changed starts
STEP, UNTIL = 1e-3, 1.0  # [s] step and end of the runs
SAMPLES = 0.25 * np.arange(5)  # [s] times at which runs are compared


@dataclass(frozen=True, eq=False)
class States:
    """The states at which accelerations are asked for.

    Attributes:
        t: (k,) zeros.
        q, v: (k, n) states. First come STATES states in motion, then as many at rest, then both groups once more, slightly changed,
            for each changed start.
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
        linkage, scenario: path or name of the linkage, and scenario; "" is the first one.
        settings, integrator, stabilization: names, as the engine offers them.
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
    """Return linkage and scenario of a text LINKAGE:SCENARIO; the name of a file in `linkages` becomes its path."""
    linkage, _, scenario = text.partition(":")
    own = FOLDER / f"{linkage}.toml"
    return (str(own) if own.is_file() else linkage), scenario


@cache
def find_mechanism(linkage: str, scenario: str) -> Mechanism:
    """Return the mechanism of a case."""
    return load(linkage, scenario or None)


@cache
def states_of(linkage: str, scenario: str) -> States:
    """Return the states of a linkage at which accelerations are asked for: random ones in motion, and the same at rest."""
    mechanism = find_mechanism(linkage, scenario)
    drawn = random_states(mechanism, STATES, speed=SPEED)
    q, v = np.concatenate([drawn.q, drawn.q]), np.concatenate([drawn.v, np.zeros_like(drawn.v)])
    t = np.zeros(len(q))
    a = AbsoluteCoordinates(mechanism).acceleration(t, q, v)
    return with_shifts(q, v, a)


def with_shifts(q: Array, v: Array, a: Array) -> States:
    """Return states with their true accelerations, followed by SHIFTS copies of the states that are slightly changed at random.

    The change is `questions.SHIFT` times the largest number, the size of rounding errors. The copies show how much a release's
    answers change with rounding.

    Args:
        q, v: (k, n) states.
        a: (k, n) true accelerations at these states, but not at the copies.
    """
    rng = np.random.default_rng(0)
    many_q, many_v = [q], [v]
    for _ in range(SHIFTS):
        many_q.append(shift(q, rng))
        many_v.append(shift(v, rng))
    return States(np.zeros(len(q) * (1 + SHIFTS)), np.concatenate(many_q), np.concatenate(many_v), a)


@cache
def truth_of(linkage: str, scenario: str) -> Reference:
    """Return the certified motion of a linkage, or else a computed reference."""
    mechanism = find_mechanism(linkage, scenario)
    return find_certified(mechanism, UNTIL) or build_reference(mechanism, UNTIL)


@cache
def evaluator_of(linkage: str, scenario: str) -> Evaluator:
    """Return the evaluator of a linkage."""
    return Evaluator(find_mechanism(linkage, scenario))
