"""Read a linkage file that may be incomplete or faulty, so that the page can show an unfinished drawing.

A part that the loader refuses is reported as a problem at its place in the drawing, and is left out. The functions of the loader
build and place everything else in the file, so that the studio reads it in the same way as all other subcommands.
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

from gauss_bench.kinematics.assembly import find_open_loop, rank_about
from gauss_bench.kinematics.topology import loose_links
from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.closure import close_joints
from gauss_bench.linkage.errors import AssemblyError, BuildError, Fault, LinkageError, NotPlaced
from gauss_bench.linkage.load import document_faults, load_document
from gauss_bench.linkage.references import items, table
from gauss_bench.linkage.schema import SECOND
from gauss_bench.linkage.sketch import sketch
from gauss_bench.mechanism.coordinates import motion_of_links, position
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.studio.document import Document, split_path
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory, in_a_sentence

ROUNDS = 200  # largest number of rounds in which faulty parts are removed
MASS, INERTIA = 1.0, 1e-3  # [kg], [kg m^2] of a link whose table gives none, so that the link can be shown
STILL = {"drawn": {"duration": 1.0}}  # a scenario without drivers, forces or prescribed coordinates
LEFT_OUT = ("expect", "measure", "observe", "crank")  # keys that place no link
TRIED = 6  # largest number of scenarios that are assembled, because each takes time
CLOSED = 1e-9  # [m] largest gap of a pin that counts as closed


@dataclass(frozen=True)
class Problem:
    """An error in a drawing, or something that the drawing still lacks.

    Attributes:
        level: "error", "warning" or "hint".
        text: the message for the user.
        where: ids of the parts of the drawing that the problem concerns.
        loop: names of the links of a loop that does not close; None for any other problem.
        apart: gap of that loop, or of a pin that does not close [m]; None for any other problem.
    """

    level: str
    text: str
    where: tuple[str, ...] = ()
    loop: tuple[str, ...] | None = None
    apart: float | None = None


@dataclass(frozen=True, eq=False)
class Reading:
    """The readable part of a document: its mechanism, the positions of the links, and the problems.

    Attributes:
        document: the document as given.
        rest: the document without its faulty parts, with a single scenario in which nothing acts.
        mechanism: the mechanism of `rest`; None if `rest` has no links or cannot be built.
        q: (n,) positions of the mechanism as drawn; if `closed`, the nearby positions with closed joints.
        closed: whether the joints can be closed from the drawn places.
        unplaced: names of links whose places the drawing does not determine.
        problems: problems of the document, errors first, then warnings and hints.
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
        """The constraints of the joints alone, without drivers and knife edges; None without a mechanism."""
        return None if self.mechanism is None else Constraints(replace(self.mechanism, drivers=(), knife_edges=()))

    @cached_property
    def rank(self) -> int:
        """The number of independent constraints of the joints at a regular position near the drawn one; 0 if unknown."""
        if self.mechanism is None:
            return 0
        with suppress(np.linalg.LinAlgError, ValueError):
            return rank_about(self.mechanism, self.q)
        return 0

    def poses(self, q: Array) -> dict[str, list[float]]:
        """Return link -> [x, y, theta] of the link's own frame at positions q (n,); empty without a mechanism."""
        return {} if self.mechanism is None else poses(self.mechanism, q)


def positions_of_links(mechanism: Mechanism, q: Array) -> Array:
    """Return the positions of all links of the file at positions q (..., n) of the mechanism's bodies."""
    if not mechanism.parts:  # nothing is welded: every link is a body
        return q
    # `motion_of_links` takes a trajectory; its velocities and accelerations, zeros here, do not matter
    return motion_of_links(mechanism, Trajectory(np.zeros(1), q, 0 * q, 0 * q, 0)).q


def poses(mechanism: Mechanism, q: Array) -> dict[str, list[float]]:
    """Return link of the file -> [x, y, theta] of the link's own frame in the world, at positions q (n,)."""
    by_link = {}
    for link, (x, y, theta) in zip(mechanism.whole.links, positions_of_links(mechanism, q).reshape(-1, 3).tolist(), strict=True):
        origin = complex(x, y) - rect(1.0, theta) * complex(*link.com)
        by_link[link.name] = [origin.real, origin.imag, theta]
    return by_link


@np.errstate(all="ignore")
def read(document: Document, starts: bool = True) -> Reading:
    """Read a document, which may be faulty.

    With `starts`, also test whether the scenarios can be assembled at their starts, which takes most of the time.
    """
    problems: list[Problem] = []

    def report(level: str, text: str, *where: str) -> None:
        """Add a problem at the parts with the ids `where`."""
        problems.append(Problem(level, text, where))

    faults = faults_of(document)
    placing = {key: x for key, x in document.items() if key not in LEFT_OUT}
    rest = copy.deepcopy({"name": "drawing"} | placing | {"scenarios": STILL})
    for name in lone_pins(document):
        del rest["assembly"]["sketch"][name]
    mechanism, faults_of_build = _build(rest)
    for fault in (*faults, *(x for x in faults_of_build if x not in faults)):
        report("error", str(fault), *find_part(document, fault.path))
    if mechanism is None and not problems:
        report("hint", "nothing is drawn yet: draw a bar between two places to begin")
    for name in lone_pins(document):
        report("hint", f"pin {name} joins nothing: draw a bar to it, or delete it", f"pins.{name}")
    if mechanism is None:
        return Reading(document, rest, None, np.zeros(0), False, (), tuple(problems))
    q, unplaced = _place_links(mechanism, rest)
    for name in unplaced:
        report("warning", f"{name} is not placed: the drawing does not determine its position", f"links.{name}")
    closed = False
    try:
        q, closed = close_joints(mechanism, Constraints(mechanism), q), True
    except AssemblyError:
        problems.append(_describe_gap(mechanism, q))
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        report("error", f"calculating with the numbers of the file fails: {in_a_sentence(error)}")
    reading = Reading(document, rest, mechanism, q, closed, unplaced)
    for name in map(mechanism.link_name, loose_links(mechanism)):
        report("warning", f"{name} is loose: no joints lead from it to the ground", f"links.{name}")
    if closed and reading.rank == mechanism.n:
        report("hint", "nothing can move: the linkage has no degree of freedom")
    if starts and not any(x.level == "error" for x in problems):
        problems += _check_scenarios(document)
    order = ("error", "warning", "hint")
    return replace(reading, problems=tuple(sorted(problems, key=lambda x: order.index(x.level))))


def find_part(document: Document, path: str) -> tuple[str, ...]:
    """Return (id,) of the part of the drawing to which a path of keys in the file belongs; () if it belongs to none."""
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
    """Return name -> [x, y] of the pins that join nothing.

    They are the entries of `assembly.sketch` whose key is no joint, no cylinder and no point "LINK.POINT".
    """
    named = {*table(document, "joints"), *table(document, "cylinders")}
    sketch = table(table(document, "assembly"), "sketch")
    return {k: x for k, x in sketch.items() if "." not in k and k not in named and is_place(x)}


def is_place(x: Any) -> bool:
    """Tell whether a value is a list [x, y] of two finite numbers."""
    return isinstance(x, list) and len(x) == 2 and all(isinstance(y, (int, float)) and np.isfinite(y) for y in x)


def faults_of(document: Document) -> list[Fault]:
    """Return the faults of a document; pins that join nothing, and missing links or scenarios, are unfinished and no faults."""
    unfinished = {f"assembly.sketch.{name}" for name in lone_pins(document)}
    unfinished |= {group for group in ("links", "scenarios") if not table(document, group)}
    return [x for x in document_faults(document) if x.path not in unfinished]


def new_faults(before: Document, after: Document) -> list[Fault]:
    """Return the faults of the document `after` an edit that the document `before` the edit did not have."""
    known = {(x.path, x.text) for x in document_faults(before)}
    return [x for x in faults_of(after) if (x.path, x.text) not in known]


def _build(document: Document) -> tuple[Mechanism | None, list[Fault]]:
    """Remove faulty parts from a document until the rest can be built.

    Return the mechanism, or None if nothing is left, and the faults that appear only when the mechanism is built.
    """
    faults_of_build: list[Fault] = []
    for _ in range(ROUNDS):
        if not table(document, "links"):
            break
        faults = document_faults(document)
        if not faults:
            try:
                return build_mechanism(document, "drawn", "", ""), faults_of_build
            except BuildError as error:
                faults = [error.fault]
                faults_of_build += faults
            except (ArithmeticError, ValueError, KeyError, TypeError, np.linalg.LinAlgError) as error:
                faults_of_build.append(Fault("", f"calculating with the numbers of the file fails: {in_a_sentence(error)}"))
                break
        for fault in faults:
            leave_out(document, fault)
    return None, faults_of_build


def leave_out(document: Document, fault: Fault) -> None:
    """Remove the part of a document that a fault names; give a missing mass or inertia, or a faulty format or name, a default."""
    keys = split_path(fault.path)
    match keys:
        case ["links", str(name), "mass" | "inertia" as lacking] if isinstance(table(document, "links").get(name), dict):
            link = document["links"][name]
            if lacking not in link:
                link[lacking] = MASS if lacking == "mass" else INERTIA
                return
        case ["format"]:
            document["format"] = SECOND
            return
        case ["name"]:
            document["name"] = "drawing"
            return
    # follow the path as far as the document has it, and delete the innermost entry that was found
    holder: Any = None  # the table or list that has the entry
    last_key: Any = None
    entry: Any = document
    for key in keys:
        in_table = isinstance(entry, dict) and key in entry
        in_list = isinstance(entry, list) and isinstance(key, int) and key < len(entry)
        if not (in_table or in_list):
            break
        holder, last_key, entry = entry, key, entry[key]
    if holder is not None:
        del holder[last_key]


def _place_links(mechanism: Mechanism, document: Document) -> tuple[Array, tuple[str, ...]]:
    """Return the positions q (n,) of the links in the sketch, and the names of the links that the sketch does not place.

    A link that is not placed gets the angle 0. Its position follows from one of its points in the sketch; without such a point its
    frame lies at the origin.
    """
    unplaced: list[str] = []
    document = copy.deepcopy(document)
    assembly = document.setdefault("assembly", {})
    angles, drawing = assembly.setdefault("angles", {}), assembly.setdefault("sketch", {})
    # each failed pass gives one link an angle or one point a place, so that two passes per link suffice
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
            # angles alone do not place these links: put a point of the first link at its coordinates in the link's frame
            body = mechanism.find_body(error.links[0])[0]
            point = next(iter(mechanism.links[body].points))
            reference = f"{error.links[0]}.{point}" if "." not in point else point
            drawing[reference] = [float(x) for x in mechanism.links[body].points[point]]
    return np.zeros(mechanism.n), tuple(unplaced)


def _describe_gap(mechanism: Mechanism, q: Array) -> Problem:
    """Return the problem that describes why a drawing does not assemble at q (n,): its open loop, or else its widest open pin."""
    with suppress(ValueError, ArithmeticError, np.linalg.LinAlgError):
        loop = find_open_loop(replace(mechanism, q0=q, v0=0 * q))
        if loop is not None:
            links = tuple(x for x in loop.links if x != "ground")
            where = (f"pins.{loop.at}", *(f"links.{x}" for x in links))
            return Problem("error", f"this does not assemble: {loop}", where, links, loop.apart)
    gaps = [float(np.hypot(*(position(q, x.b) - position(q, x.a)))) for x in mechanism.pins]  # [m]
    apart = max(gaps, default=0.0)
    if apart <= CLOSED:
        return Problem("error", "this does not assemble: the slides do not close")
    pin = mechanism.pins[gaps.index(apart)].joint
    return Problem("error", f"this does not assemble: pin {pin} stays open by {apart:.4g} m", (f"pins.{pin}",), None, apart)


def _check_scenarios(document: Document) -> Iterator[Problem]:
    """Yield a problem for each of the first TRIED scenarios that cannot be assembled, and for each warning of the loader."""
    reported: set[str] = set()
    for name, _ in [*items(document, "scenarios")][:TRIED]:
        try:
            mechanism = load_document(document, name)
        except LinkageError as error:
            for fault in error.faults:
                if str(fault) not in reported:
                    yield Problem("warning", f"scenario {name} does not start: {fault}", (f"scenarios.{name}",))
                reported.add(str(fault))
            continue
        for sentence in mechanism.warnings:
            if sentence not in reported:
                yield Problem("warning", sentence, find_part(document, sentence.split(":")[0]))
            reported.add(sentence)
