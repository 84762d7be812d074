"""Give the judge random motions with one thing wrong: a motion beyond the documented limits must not be "ok".

A sound motion of a random linkage is changed in one of KINDS, by a log-uniform size of a tenth to a hundred times a limit.
`limits` computes, without the judge, how far the motion is beyond each row of the documentation's table. The evidence for a motion
is random too: a repetition with the same fault, a sound repetition, the same motion again, or the truth.
"""

import copy
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.judge import judge
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.one_run import Run, sampling
from gauss_bench.runs.scrutiny import as_truth, evidence_of
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory
from tests.drawn_linkages import random_linkage
from tests.engine_runs import moved
from tests.fuzz.files import toml
from tests.fuzz.limits import Motion, parts, shares
from tests.fuzz.mechanics import Mechanics

UNTIL, STEP, SAMPLES = 0.1, 1e-3, 101
SIZES = (0.1, 100.0)  # of a limit
NEAR = 1.05  # of a share: integrals by other sums differ by less
MOTIONS = 100_000  # of one seed
WITNESSES = ("the same fault", "the same fault", "the same fault", "a sound repetition", "the same bits", "the truth")
FAILURES = (RunFailure, ArithmeticError, np.linalg.LinAlgError)
TIMES = np.linspace(0.0, UNTIL, SAMPLES)
AFTER = (TIMES > 0)[:, None]  # of the start, which has a row of its own


@dataclass(frozen=True)
class Drawn:
    """A random linkage, its file, its compiled model, and its motion."""

    document: dict[str, Any]
    folder: Path
    mechanism: Mechanism
    model: Any
    sound: Motion

    @property
    def speed(self) -> float:
        return float(max(np.abs(part).max() for part in parts(self.sound.v))) or 1.0

    def run(self, step: float, times: Array = TIMES, document: dict[str, Any] | None = None) -> Motion:
        """Return a motion at times (k,) from 0 on, of this linkage or of another document."""
        choice = Choice("default", "rk4", step=step)
        model = self.model if document is None else get("gauss").build(read(document, self.folder), choice)
        model.choice = choice
        x = moved(model, times)
        return Motion(x.t, x.q, x.v, x.a)


def read(document: dict[str, Any], folder: Path) -> Mechanism:
    path = folder / f"{document['name']}.toml"
    path.write_bytes(toml(document))
    return load(str(path))


# a fault: (drawn linkage, size relative to a limit, random numbers, step) -> the wrong motion

Wrong = Callable[[Drawn, float, np.random.Generator, float], Motion]


def frozen(x: Drawn, share: float, lot: np.random.Generator, step: float) -> Motion:
    """Return a motion in which the links stand still from some time on."""
    y, still = x.run(step), UNTIL * (1 - min(1.0, share / 100)) <= TIMES
    first = int(np.argmax(still)) if still.any() else SAMPLES - 1
    q, v, a = y.q.copy(), y.v.copy(), y.a.copy()
    q[first:], v[first:], a[first:] = q[first], 0.0, 0.0
    return Motion(TIMES, q, v, a)


def shifted(x: Drawn, share: float, lot: np.random.Generator, step: float) -> Motion:
    """Return the motion of a later time."""
    late = share * (1e-5, 1e-2)[int(lot.integers(2))] * min(1.0, x.mechanism.size) / x.speed
    y = x.run(step, np.concatenate([[0.0], min(late, UNTIL) + TIMES]))
    return Motion(TIMES, y.q[1:], y.v[1:], y.a[1:])


def aliased(x: Drawn, share: float, lot: np.random.Generator, step: float) -> Motion:
    """Return velocities with a ripple whose period is that of the samples, so that positions do not show it."""
    y = x.run(step)
    ripple = share * 0.025 * x.mechanism.size / UNTIL * lot.normal(size=y.v.shape[1])
    return Motion(TIMES, y.q, y.v + AFTER * ripple, y.a)


def noisy(level: str, unit: float) -> Wrong:
    def wrong(x: Drawn, share: float, lot: np.random.Generator, step: float) -> Motion:
        y = x.run(step)
        levels = {"q": y.q, "v": y.v, "a": y.a}
        size = x.mechanism.size if level == "q" else float(np.abs(levels[level]).max())
        levels[level] = levels[level] + AFTER * share * unit * size * lot.normal(size=y.q.shape)
        return Motion(TIMES, levels["q"], levels["v"], levels["a"])

    return wrong


def other_linkage(*keys: str, unit: float) -> Wrong:
    """Return a fault: the motion of a linkage with another mass or inertia of a link, or another gravity."""

    def wrong(x: Drawn, share: float, lot: np.random.Generator, step: float) -> Motion:
        document = copy.deepcopy(x.document)
        if keys == ("gravity",):
            document["gravity"] = [y * (1 + unit * share) for y in document.get("gravity", [0.0, -9.81])]
        else:
            table = list(document["links"].values())[int(lot.integers(len(document["links"])))]
            table[keys[0]] *= 1 + unit * share
        return x.run(step, document=document)

    return wrong


def drifted(x: Drawn, share: float, lot: np.random.Generator, step: float) -> Motion:
    """Return a motion in which links leave their positions ever faster, with consistent rates."""
    y, part = x.run(step), TIMES[:, None] / UNTIL
    way = share * 0.01 * min(1.0, x.mechanism.size) * lot.normal(size=y.q.shape[1])
    return Motion(TIMES, y.q + part**2 * way, y.v + 2 * part * way / UNTIL, y.a + 2 * way / UNTIL**2)


def mirrored(x: Drawn, share: float, lot: np.random.Generator, step: float) -> Motion:
    """Return a motion in which one link suddenly turns about its centre of mass and stays so."""
    y = x.run(step)
    link = int(lot.integers(y.q.shape[1] // 3))
    q = y.q.copy()
    q[:, 3 * link + 2] += np.where(UNTIL * float(lot.uniform(0.1, 0.9)) <= TIMES, 0.05 * share, 0.0)
    return Motion(TIMES, q, y.v, y.a)


KINDS: dict[str, Wrong] = {
    "frozen": frozen,
    "shifted": shifted,
    "aliased": aliased,
    "noisy positions": noisy("q", 0.01),
    "noisy velocities": noisy("v", 0.05),
    "noisy accelerations": noisy("a", 0.02),
    "one mass": other_linkage("mass", unit=0.2),
    "one inertia": other_linkage("inertia", unit=0.5),
    "gravity": other_linkage("gravity", unit=0.05),
    "turned": mirrored,
    "drifted": drifted,
}


def draw(seed: int, folder: Path) -> Drawn | None:
    """Return a random linkage whose motion is sound by the rows of the table, or None."""
    document = random_linkage(seed)
    try:
        mechanism = read(document, folder)
        model = get("gauss-native").build(mechanism, Choice("default", "rk4", step=STEP))
        one = Drawn(document, folder, mechanism, model, Motion(TIMES, *np.zeros((3, SAMPLES, mechanism.n))))
        sound = one.run(STEP)
        mechanics = Mechanics(document, "run")
        start = Motion(TIMES[:1], mechanism.q0[None], mechanism.v0[None], mechanism.v0[None])
        with np.errstate(all="ignore"):
            off = shares(mechanics, mechanism.size, start, sound, one.run(STEP / 2), None)
    except (LinkageError, *FAILURES):
        return None
    return replace(one, sound=sound) if max(off.values()) < SIZES[0] else None


def ending(number: int, kind: str, x: Drawn) -> tuple[str, str]:
    """Return the judge's verdict on the motion of this number in a word, and a sentence if it is beyond a limit and yet ok."""
    lot = np.random.default_rng([number, 25])
    share, witness = float(np.exp(lot.uniform(*np.log(SIZES)))), WITNESSES[int(lot.integers(len(WITNESSES)))]
    mechanics, lots = Mechanics(x.document, "run"), np.random.default_rng([number, 26]).spawn(1)
    try:
        with np.errstate(all="ignore"):
            told = KINDS[kind](x, share, copy.deepcopy(lots[0]), STEP)
            again = {
                "the same fault": lambda: KINDS[kind](x, share, copy.deepcopy(lots[0]), STEP / 2),
                "a sound repetition": lambda: x.run(STEP / 2),
                "the same bits": lambda: told,
                "the truth": lambda: None,
            }[witness]()
            truth = x.run(STEP / 4) if again is None else None
            start = Motion(TIMES[:1], x.mechanism.q0[None], x.mechanism.v0[None], x.mechanism.v0[None])
            off = shares(mechanics, x.mechanism.size, start, told, again, truth)
            ok = judged(x.mechanism, told, again, truth)
    except (LinkageError, *FAILURES) as error:
        return f"{kind}: no motion ({type(error).__name__})", ""
    row, worst = max(off.items(), key=lambda pair: pair[1])
    beyond = not worst <= NEAR
    word = f"{kind}: {'beyond' if beyond else 'within'}, {'ok' if ok else 'not ok'}"
    said = f"{number} {kind}, {share:.3g} of a limit, {witness}: {row} at {worst:.3g} of what is allowed, and ok"
    return word, said if beyond and ok else ""


def judged(mechanism: Mechanism, told: Motion, again: Motion | None, truth: Motion | None) -> bool:
    """Tell whether the judge accepts a motion as a run by equal steps."""
    trajectory = Trajectory(told.t, told.q, told.v, told.a, SAMPLES - 1)
    finer = None
    if again is not None:
        finer = Run(
            Status.OK, "", Trajectory(again.t, again.q, again.v, again.a, 2 * (SAMPLES - 1)), None, sampling(STEP / 2, UNTIL)
        )
    known = as_truth(Trajectory(truth.t, truth.q, truth.v, truth.a, 0)) if truth is not None else None
    evidence, _ = evidence_of(mechanism, Choice("default", "rk4", step=STEP), trajectory, known, finer)
    return judge(evidence).valid


def over_judged(seed: int, count: int) -> Iterator[tuple[int, str, str]]:
    """Yield number, word and sentence of each of `count` motions; every linkage has one of each kind."""
    with tempfile.TemporaryDirectory() as folder:
        linkages = (x for k in range(MOTIONS) if (x := draw(MOTIONS * seed + k, Path(folder))) is not None)
        for k in range(count):
            if k % len(KINDS) == 0:
                x = next(linkages)
            number = MOTIONS * seed + k
            yield (number, *ending(number, [*KINDS][k % len(KINDS)], x))
