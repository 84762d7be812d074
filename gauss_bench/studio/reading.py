"""A linkage file read as far as it goes: half a drawing is a drawing too.

What the loader refuses is told as a problem, with the place in the drawing that it is about, and left out; what is left is built
and placed by the loader's own functions. So nothing is read here in another way than the suite reads it.
"""

import copy
import re
from cmath import rect
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from gauss_bench.kinematics.assembly import put_together, rank_about
from gauss_bench.kinematics.topology import find_graph, held_coordinates, loose_links
from gauss_bench.linkage.bodies import write_out
from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.closure import close_joints, sketch
from gauss_bench.linkage.errors import AssemblyError, BuildError, Fault, LinkageError, NotPlaced
from gauss_bench.linkage.load import document_faults, load_document
from gauss_bench.linkage.references import items, sequence, table
from gauss_bench.mechanism.coordinates import position, spread
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import GROUND, Mechanism, Revolute
from gauss_bench.studio.document import Document, split_path
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory, in_a_sentence

ROUNDS = 200  # of leaving out what is at fault; each leaves out something
MASS, INERTIA = 1.0, 1e-3  # [kg], [kg m^2] of a link that says nothing of either, so that it can be shown
STILL = {"drawn": {"duration": 1.0}}  # a scenario in which nothing is held, driven or pushed
TRIED = 6  # scenarios that are looked at whether they start


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong or missing: `level` is error, warning or hint, `where` what of the drawing it is about."""

    level: str
    text: str
    where: tuple[str, ...] = ()
    loop: tuple[str, ...] | None = None
    apart: float | None = None


@dataclass(frozen=True, eq=False)
class Reading:
    """The readable part of a document.

    Attributes:
        document: as it was given.
        rest: what is left of it, which has no faults but those of its scenarios.
        mechanism: that, without forces and drivers; None where there are no links.
        q: (n,) where the links are drawn; closed, where the joints close from there.
        unplaced: links of which the drawing does not say where they are.
        problems: what is wrong, errors first.
    """

    document: Document
    rest: Document
    mechanism: Mechanism | None
    q: Array
    closed: bool
    unplaced: tuple[str, ...]
    problems: tuple[Problem, ...] = field(default=())

    @cached_property
    def joints(self) -> Constraints | None:
        """The rows of the joints alone."""
        return None if self.mechanism is None else Constraints(replace(self.mechanism, drivers=(), knife_edges=()))

    @cached_property
    def rank(self) -> int:
        """The number of independent rows of the joints, the drawing being of no special kind."""
        if self.mechanism is None:
            return 0
        with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError, ValueError):
            return rank_about(self.mechanism, self.q)
        return 0

    def poses(self, q: Array) -> dict[str, list[float]]:
        """Link -> [x, y, theta] of its own frame at a state q (n,)."""
        return {} if self.mechanism is None else poses(self.mechanism, q)


def of_links(mechanism: Mechanism, q: Array) -> Array:
    """States (..., n) of the bodies of a mechanism as those of the links of its file."""
    if not mechanism.parts:
        return q
    return spread(mechanism, Trajectory(np.zeros(1), q, 0 * q, 0 * q, 0)).q


def poses(mechanism: Mechanism, q: Array) -> dict[str, list[float]]:
    """Link of the file -> [x, y, theta] of its own frame in the world, at a state q (n,)."""
    by_link = {}
    for link, (x, y, theta) in zip(mechanism.whole.links, of_links(mechanism, q).reshape(-1, 3).tolist(), strict=True):
        origin = complex(x, y) - rect(1.0, theta) * complex(*link.com)
        by_link[link.name] = [origin.real, origin.imag, theta]
    return by_link


def read(document: Document, starts: bool = True) -> Reading:
    """Read a document, whatever is wrong with it; whether its scenarios start is most of the work."""
    problems: list[Problem] = []

    def tell(level: str, text: str, *where: str) -> None:
        problems.append(Problem(level, text, where))

    faults, rest = [f for f in document_faults(document) if not _is_told_otherwise(document, f)], _still(copy.deepcopy(document))
    mechanism, more = _build(rest)
    for fault in (*faults, *(f for f in more if f not in faults)):
        tell("error", str(fault), *place(document, fault.path))
    if mechanism is None and not problems:
        tell("hint", "nothing is drawn yet: a bar between two places is a beginning")
    for name in lone_pins(document):
        tell("hint", f"pin {name} holds nothing: draw a bar to it, or delete it", f"pins.{name}")
    if mechanism is None:
        return Reading(document, rest, None, np.zeros(0), False, (), tuple(problems))
    q, unplaced = _place(mechanism, rest)
    for name in unplaced:
        tell("warning", f"{name} is not placed: the drawing says too little of where it lies", f"links.{name}")
    closed = False
    try:
        with np.errstate(all="ignore"):
            q, closed = close_joints(mechanism, Constraints(mechanism), q), True
    except AssemblyError:
        problems.append(_open(mechanism, q))
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        tell("error", f"its numbers cannot be computed with: {in_a_sentence(error)}")
    reading = Reading(document, rest, mechanism, q, closed, unplaced)
    for name in map(mechanism.link_name, loose_links(mechanism)):
        tell("warning", f"{name} hangs on nothing: no joints lead from it to the ground", f"links.{name}")
    if closed and reading.rank == mechanism.n:
        tell("hint", "nothing can move: the links hold each other fast, with no degree of freedom")
    if starts and not any(x.level == "error" for x in problems):
        problems += _scenarios(document)
    order = ("error", "warning", "hint")
    return replace(reading, problems=tuple(sorted(problems, key=lambda x: order.index(x.level))))


def place(document: Document, path: str) -> tuple[str, ...]:
    """The part of the drawing that the path of a fault is about."""
    parts = path.split(".")
    if len(parts) < 2:
        return ()
    group, name = parts[0], re.sub(r"\[.*", "", parts[1])
    match group:
        case "links" | "forces" | "scenarios" | "welds" | "cylinders" | "constraints":
            return (f"{group}.{name}",)
        case "joints":
            joint = table(table(document, "joints"), name)
            return (f"{'slides' if joint.get('type') == 'prismatic' else 'pins'}.{name}",)
        case "assembly" if len(parts) > 2:
            return (f"pins.{'.'.join(parts[2:])}",)
        case "ground" if len(parts) > 2:
            return (f"pins.ground.{parts[2]}",)
    return ()


def lone_pins(document: Document) -> dict[str, list[float]]:
    """Pins that nothing holds: places of the drawing that bear the name of no joint and no point."""
    named = {*table(document, "joints"), *table(document, "cylinders")}
    sketch = table(table(document, "assembly"), "sketch")
    return {k: x for k, x in sketch.items() if "." not in k and k not in named and is_place(x)}


def is_place(x: Any) -> bool:
    return isinstance(x, list) and len(x) == 2 and all(isinstance(y, (int, float)) and np.isfinite(y) for y in x)


def _is_told_otherwise(document: Document, fault: Fault) -> bool:
    """Tell whether a fault only says that a drawing is not finished, which is told in the words of a drawing."""
    lone = {f"assembly.sketch.{name}" for name in lone_pins(document)}
    return fault.path in lone or (fault.path in ("links", "scenarios") and not table(document, fault.path))


def new_faults(before: Document, after: Document) -> list[Fault]:
    """The faults of a document that it did not have before."""
    known = {(x.path, x.text) for x in document_faults(before)}
    lone = {f"assembly.sketch.{x}" for x in lone_pins(after)}
    return [x for x in document_faults(after) if (x.path, x.text) not in known and x.path not in lone]


def _still(document: Document) -> Document:
    """The document without what moves it: one scenario in which nothing acts; and without pins that hold nothing."""
    for name in lone_pins(document):
        del document["assembly"]["sketch"][name]
    still = {key: x for key, x in document.items() if key not in ("expect", "measure", "observe", "crank")}
    return {"name": "drawing"} | still | {"scenarios": copy.deepcopy(STILL)}


def _build(document: Document) -> tuple[Mechanism | None, list[Fault]]:
    """The mechanism of what is left of a document once all that is at fault is left out of it, and what only building showed."""
    more: list[Fault] = []
    for _ in range(ROUNDS):
        if not table(document, "links"):
            return None, more
        faults = document_faults(document)
        if not faults:
            try:
                with np.errstate(all="ignore"):
                    return build_mechanism(document, "drawn", "", ""), more
            except BuildError as error:
                faults = [error.fault]
                more += faults
            except (ArithmeticError, ValueError, KeyError, TypeError, np.linalg.LinAlgError) as error:
                more.append(Fault("", f"its numbers cannot be computed with: {in_a_sentence(error)}"))
                return None, more
        for fault in faults:
            leave_out(document, fault)
    return None, more


def leave_out(document: Document, fault: Fault) -> None:
    """Take out what a fault is about; of a link that lacks a mass or an inertia, give it one instead."""
    keys = split_path(fault.path)
    match keys:
        case ["links", str(name), "mass" | "inertia" as lacking] if isinstance(table(document, "links").get(name), dict):
            if lacking not in (link := document["links"][name]):
                link[lacking] = MASS if lacking == "mass" else INERTIA
                return
        case ["format"]:
            document["format"] = "planar-linkage/2"
            return
        case ["name"]:
            document["name"] = "drawing"
            return
    holder: Any = None
    last: Any = None
    owner: Any = document
    for key in keys:
        inside = key in owner if isinstance(owner, dict) else isinstance(owner, list) and isinstance(key, int) and key < len(owner)
        if not inside:
            break
        holder, last, owner = owner, key, owner[key]
    if holder is not None:
        del holder[last]


def _place(mechanism: Mechanism, document: Document) -> tuple[Array, tuple[str, ...]]:
    """Places of the links by the sketch; those that it does not place stand at the origin, or hang from the one point known."""
    unplaced: list[str] = []
    document = copy.deepcopy(document)
    assembly = document.setdefault("assembly", {})
    angles, drawing = assembly.setdefault("angles", {}), assembly.setdefault("sketch", {})
    for _ in range(2 * len(mechanism.links) + 1):
        try:
            return np.nan_to_num(sketch(mechanism, document)), tuple(unplaced)
        except NotPlaced as error:
            name = next((x for x in error.links if x not in unplaced), None)
            if name is not None:
                unplaced.append(name)
                if name not in assembly.get("angles_deg", {}):
                    angles[name] = 0.0
                continue
            body = mechanism.placed(error.links[0])[0]
            point = next(iter(mechanism.links[body].points))
            owner = f"{error.links[0]}.{point}" if "." not in point else point
            drawing[owner] = [float(x) for x in mechanism.links[body].points[point]]
    return np.zeros(mechanism.n), tuple(unplaced)


def _open(mechanism: Mechanism, q: Array) -> Problem:
    """The pair that does not assemble, with how far its ends are apart in the drawing."""
    with suppress(ValueError, ArithmeticError, np.linalg.LinAlgError):
        with np.errstate(all="ignore"):
            loop = put_together(replace(mechanism, q0=q, v0=0 * q)).open
        if loop is not None:
            links = tuple(x for x in loop.links if x != "ground")
            where = (f"pins.{loop.at}", *(f"links.{x}" for x in links))
            return Problem("error", f"this does not assemble: {loop}", where, links, loop.apart)
    pins = [x for x in mechanism.joints if isinstance(x, Revolute)]
    apart, pin = max(((float(np.hypot(*(position(q, x.b) - position(q, x.a)))), x.joint) for x in pins), default=(0.0, ""))
    if apart <= 1e-9:
        return Problem("error", "this does not assemble: the slides do not close")
    return Problem("error", f"this does not assemble: pin {pin} stays open by {apart:.4g} m", (f"pins.{pin}",), None, apart)


def _scenarios(document: Document) -> Iterator[Problem]:
    """Scenarios that do not start, and what the loader warns of."""
    told: set[str] = set()
    for name, _ in [*items(document, "scenarios")][:TRIED]:
        try:
            mechanism = load_document(document, name)
        except LinkageError as error:
            for fault in error.faults:
                if str(fault) not in told:
                    yield Problem("warning", f"scenario {name} does not start: {fault}", (f"scenarios.{name}",))
                told.add(str(fault))
            continue
        for sentence in mechanism.warnings:
            if sentence not in told:
                yield Problem("warning", sentence, place(document, sentence.split(":")[0]))
            told.add(sentence)


def loops_of(mechanism: Mechanism) -> list[list[str]]:
    """The links of every independent loop, without the ground, whatever hangs on nothing."""
    return [
        [mechanism.link_name(p.link) for p in loop.passages if p.link != GROUND]
        for loop in find_graph(held_coordinates(mechanism)).loops
    ]


def pins_of(document: Document) -> list[tuple[str, list[str]]]:
    """Joint -> references of every pin joint, those of cylinders too."""
    return [
        (name, sequence(joint, "at")) for name, joint in items(write_out(document), "joints") if joint.get("type") == "revolute"
    ]
