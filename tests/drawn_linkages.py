"""Linkages as hypothesis strategies: every joint, guide, force and driver of the grammar, in pieces that shrink one by one.

A linkage is a list of parts, each of which is added where it is regular: a dyad whose apex lies off its base, a block whose bar
lies along its guide, a cylinder between two points that are apart, a bar that swings, a block that slides, a sled. Then come what
is welded on, forces, and laws for the freedoms. Pieces name each other by numbers that are counted round what is there, so that a
shorter list is a linkage too; a part that finds no place swings instead, a force that finds none is left out.
"""

import os
from collections import namedtuple
from collections.abc import Sequence
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st

from gauss_bench.api.telling import plain
from gauss_bench.linkage.schema import FORMAT, SECOND
from gauss_bench.mechanism.numbers import turn_vector
from gauss_bench.terms import Array

ASKED = int(os.environ.get("PROPERTIES", "0"))  # examples of each property; 0 asks for the few of the tests
MOST = 9  # bodies
FEWEST, MANY = 2, 8  # links of a random linkage
APART = 0.05  # [m] between points that span a line
PARTS = ("swing", "two bars", "bar and block", "slide", "cylinder", "sled")
FORCES = ("torque", "force", "spring", "axis", "coil", "damping", "friction")
SMOOTH = ("constant", "sine", "cosine", "poly345", "table")


# How a link's mass is told, and its third point, in lengths of its bar.
Body = namedtuple("Body", "told mass along aside point_mass")
# What is added: between the points `on` and `to`, of a length [m], at angles [deg]; `shared`: on the pin that is there.
Part = namedtuple("Part", "kind on to length turn bend shared speed body")
# By what a torque or force is multiplied.
Varying = namedtuple("Varying", "law time share")
# A force on or between the things of numbers i and j; x, y, z are its numbers, of the order of 1.
Load = namedtuple("Load", "kind i j frame x y z turn varying")
# How a freedom is driven.
Law = namedtuple("Law", "kind travel time")
# A coordinate that a start holds: of the group `angles` or `slides`, with its value and rate, and what drives it.
Freedom = namedtuple("Freedom", "group name value rate driven")


class Draft:
    """A linkage in the making, in the pose of its start: world positions of points, angles of links."""

    def __init__(self) -> None:
        self.tables: dict[str, dict[str, Any]] = {k: {} for k in TABLES}
        self.ground = {k: np.array(x) for k, x in GROUND.items()}
        self.points = {f"ground.{k}": np.array(x) for k, x in GROUND.items()}
        self.angles, self.body = {"ground": 0.0}, {"ground": "ground"}
        self.pinned: dict[str, str] = {}  # point -> the joint there
        self.freedoms: list[Freedom] = []
        self.held: dict[str, dict[str, Any]] = {k: {} for k in HELD}
        self.bodies, self.second = 0, False

    def at(self, number: int, other_than: str = "") -> tuple[str, Array]:
        """A point by its number, on another body than that of a point."""
        names = [x for x in self.points if not other_than or self.owner(x) != self.owner(other_than)]
        name = names[number % len(names)]
        return name, self.points[name]

    def owner(self, point: str) -> str:
        return self.body[point.partition(".")[0]]

    def link(self, kind: str, start: Array, end: Array, body: Body) -> str:
        """A bar from A to B, with a third point C."""
        name, length = f"{kind}{len(self.tables['links'])}", float(np.hypot(*(end - start)))
        angle = float(np.arctan2(*(end - start)[::-1]))
        local = {"A": [0.0, 0.0], "B": [length, 0.0], "C": [body.along * length, body.aside * length]}
        table: dict[str, Any] = {"points": local}
        if body.told == "own":
            table |= {"mass": body.mass, "com": [body.along * length, 0.0], "inertia": body.mass * length**2 / 10}
        elif body.told == "polar":
            way = {"from": "B", "r": body.aside * length, "deg": 90.0 + 90.0 * body.along}
            local["C"] = np.array(local["B"]) + way["r"] * direction(np.radians(way["deg"]))
            table |= {"points": {**local, "C": way}, "bars": [["A", "B"]], "mass": body.mass}
        else:
            table |= {"bars": [["A", "B"], ["B", "C"]], "kg_per_m": body.mass / length}
        if body.point_mass:
            table["point_masses"], self.second = [{"point": "C", "mass": body.point_mass}], True
        self.tables["links"][name], self.angles[name], self.body[name] = table, angle, name
        self.points |= {f"{name}.{p}": start + turn_vector(x, angle) for p, x in local.items()}
        self.bodies += 1
        return name

    def pin(self, on: str, *points: str, shared: bool = False) -> None:
        if shared and on in self.pinned:
            self.tables["joints"][self.pinned[on]]["at"] += points
            return
        name = f"j{len(self.tables['joints'])}"
        self.tables["joints"][name] = {"type": "revolute", "at": [on, *points]}
        self.pinned |= dict.fromkeys((on, *points), name)

    def free_angle(self, link: str, rate: float, on_ground: bool) -> None:
        end = self.points[f"{link}.B"]
        driven: dict[str, Any] = {"link": link, "start": self.angles[link]}
        if not on_ground:  # an active bar, square to the link
            at = end + 0.3 * direction(self.angles[link] + np.pi / 2)
            name = f"D{len(self.ground)}"
            self.ground[name] = at
            driven = {"between": [f"ground.{name}", f"{link}.B"], "start": float(np.hypot(*(end - at)))}
        self.freedoms.append(Freedom("angles", link, self.angles[link], rate, driven))


HELD = ("points", "point_velocities", "angles", "speeds")
TABLES = ("links", "welds", "cylinders", "joints", "constraints", "forces")
GROUND = {"O": [0.0, 0.0], "P": [0.6, 0.1], "Q": [-0.4, 0.3], "R": [0.2, -0.5]}


def direction(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])


def swing(draft: Draft, part: Part) -> None:
    at, place = draft.at(part.on)
    name = draft.link("p", place, place + part.length * direction(np.radians(part.turn)), part.body)
    draft.pin(at, f"{name}.A", shared=part.shared)
    draft.free_angle(name, part.speed, on_ground=at.startswith("ground") and not part.shared)


def two_bars(draft: Draft, part: Part) -> bool:
    (first, a), (second, b) = _two(draft, part)
    base = float(np.hypot(*(b - a)))
    if base < APART:
        return False
    left = turn_vector((b - a) / base, np.pi / 2)
    apex = a + (0.5 + part.turn / 400) * (b - a) + np.sign(part.bend or 1) * max(part.length, base / 2) * left
    one, other = draft.link("u", a, apex, part.body), draft.link("w", b, apex, part.body)
    draft.pin(first, f"{one}.A", shared=part.shared)
    draft.pin(second, f"{other}.A")
    draft.pin(f"{one}.B", f"{other}.B")
    return True


def bar_and_block(draft: Draft, part: Part) -> bool:
    (first, a), (guide, g) = _two(draft, part)
    way = np.radians(part.turn)
    end, line = a + part.length * direction(way), way + np.radians(part.bend)
    one = draft.link("u", a, end, part.body)
    block = draft.link("s", end, end + 0.1 * direction(line + np.radians(part.turn)), part.body)
    draft.pin(first, f"{one}.A", shared=part.shared)
    draft.pin(f"{one}.B", f"{block}.A")
    _guided(draft, guide, f"{block}.A", line, end - g)
    return True


def slide(draft: Draft, part: Part) -> bool:
    guide, g = draft.at(part.on)
    line = np.radians(part.turn)
    away = part.length * direction(line + np.radians(part.bend))
    block = draft.link("s", g + away, g + away + 0.1 * direction(line), part.body)
    name = _guided(draft, guide, f"{block}.A", line, away)
    place = float(direction(line) @ away)
    draft.freedoms.append(Freedom("slides", name, place, part.speed / 10, {"joint": name, "start": place}))
    return True


def cylinder(draft: Draft, part: Part) -> bool:
    (first, a), (second, b) = _two(draft, part)
    length = float(np.hypot(*(b - a)))
    if length < APART or draft.owner(first) == draft.owner(second):
        return False
    name, mass = f"z{len(draft.tables['cylinders'])}", part.body.mass
    sizes = {"barrel": {"length": 0.6 * length, "mass": mass}, "rod": {"length": 0.7 * length, "kg_per_m": mass / length}}
    draft.tables["cylinders"][name] = {"between": [first, second], **sizes}
    draft.bodies, draft.second = draft.bodies + 2, True
    return True


def sled(draft: Draft, part: Part) -> bool:
    """A free body, with a knife edge at its point A, or none."""
    start, angle = np.array([part.length, 1.0]), np.radians(part.turn)
    name = draft.link("k", start, start + part.length * direction(angle), part.body)
    point = f"{name}.A"
    edge = angle + np.radians(part.bend)
    if part.shared:
        draft.tables["constraints"][f"e{name}"] = {"type": "knife_edge", "point": point, "angle_deg": float(part.bend)}
    for group, value in (("points", start), ("point_velocities", part.speed / 10 * direction(edge))):
        draft.held[group][point] = value
    draft.held["angles"][name], draft.held["speeds"][name] = angle, part.speed
    return True


PLACED = {"two bars": two_bars, "bar and block": bar_and_block, "slide": slide, "cylinder": cylinder, "sled": sled}
TAKES = {"two bars": 2, "bar and block": 2, "cylinder": 2}  # bodies; the others one


def _two(draft: Draft, part: Part) -> tuple[tuple[str, Array], tuple[str, Array]]:
    first = draft.at(part.on)
    return first, draft.at(part.to, first[0])


def _guided(draft: Draft, guide: str, block: str, line: float, away: Array) -> str:
    """A slide of a block at a place `away` from the guide's point, along a line of the world."""
    name, (on, of) = f"j{len(draft.tables['joints'])}", (x.partition(".")[0] for x in (guide, block))
    turns = {"angle": float(line - draft.angles[on]), "block_angle": float(line - draft.angles[of])}
    offset = float(turn_vector(direction(line), np.pi / 2) @ away)
    draft.tables["joints"][name] = {"type": "prismatic", "guide": guide, "block": block, "offset": offset, **turns}
    return name


def weld(draft: Draft, part: Part) -> None:
    """A link on a point of another, at an angle."""
    names = [x for x in draft.points if not x.startswith("ground")]
    on = names[part.on % len(names)]
    to, angle = on.partition(".")[0], np.radians(part.turn)
    name = draft.link("f", draft.points[on], draft.points[on] + part.length * direction(draft.angles[to] + angle), part.body)
    draft.tables["welds"][name] = {"link": name, "to": to, "points": [[on, f"{name}.A"]], "angle_deg": float(part.turn)}
    draft.body[name], draft.second, draft.bodies = draft.body[to], True, draft.bodies - 1
    draft.angles[name] = draft.angles[to] + angle


def load(draft: Draft, x: Load) -> dict[str, Any] | None:
    """The table of a force, or None where there is no place for it."""
    links = list(draft.tables["links"])
    moving = [p for p in draft.points if not p.startswith("ground")]
    link, joints = links[x.i % len(links)], list(draft.tables["joints"])
    others = ["ground", *(y for y in links if draft.body[y] != draft.body[link])]
    other = others[x.j % len(others)]
    point = moving[x.i % len(moving)]
    partner, there = draft.at(x.j, point)
    distance = float(np.hypot(*(there - draft.points[point])))
    stiff = {"k": 50.0 * abs(x.x), "c": abs(x.y)}
    factor = varied(draft, x.varying)
    match x.kind:
        case "torque":
            return {"type": "torque", "link": link, "reaction": other, "value": x.x, **factor}
        case "force":
            frame = ("ground", "body", link)[x.frame]
            return {"type": "force", "point": point, "value": [x.x, x.y], "frame": frame, **factor}
        case "spring" if distance > APART:
            return {"type": "spring_damper", "between": [partner, point], **stiff, "rest": (1 + x.z) * distance}
        case "axis":
            origin = {"origin": partner} if x.frame else {}
            return {"type": "axis_spring_damper", "point": point, **origin, "angle_deg": float(x.turn), **stiff, "rest": x.z}
        case "coil":
            return {"type": "rotational_spring_damper", "links": [other, link], "k": abs(x.x), "c": abs(x.y) / 10, "rest": x.z}
        case "damping":
            return {"type": "joint_damping", "joint": joints[x.i % len(joints)], "c": abs(x.y)}
        case "friction":
            joint = joints[x.i % len(joints)]
            radius = {"radius": 0.01 + abs(x.y) / 50} if draft.tables["joints"][joint]["type"] == "revolute" else {}
            return {"type": "coulomb_friction", "joint": joint, "mu": abs(x.x) / 20, "speed": 0.1 + abs(x.z), **radius}
    return None


def varied(draft: Draft, x: Varying | None) -> dict[str, Any]:
    if x is None:
        return {}
    draft.second = True
    of_time: dict[str, dict[str, Any]] = {
        "table": {"rows": [[0.0, 1.0], [x.time, 0.5], [2 * x.time, 1.5]]},
        "ramp": {"start": x.time / 10, "time": x.time},
        "step": {"start": x.time / 10},
        "sine": {"frequency": 1 / x.time, "phase_deg": 30.0},
    }
    against = {} if x.share is None else {"against": {"share": x.share, "speed": x.time}}
    return ({"over_time": {"law": x.law, **of_time[x.law]}} if x.law else {}) | (against if against or x.law else {})


def driver(freedom: Freedom, law: Law) -> dict[str, Any]:
    """The table of a driver from the freedom's value on."""
    travel = law.travel if freedom.group == "angles" and "link" in freedom.driven else law.travel / 10
    match law.kind:
        case "constant":
            numbers: dict[str, Any] = {"speed": travel / law.time}
        case "table":
            degrees = float(np.degrees(travel)) if "link" in freedom.driven else travel
            numbers = {"rows": [[0.0, 0.0], [law.time / 3, degrees / 2], [law.time, degrees]]}
        case _:
            numbers = {"travel": travel, "time": law.time}
    return {**freedom.driven, "law": law.kind, **numbers}


def document_of(
    parts: Sequence[Part],
    welds: Sequence[Part],
    loads: Sequence[Load],
    laws: Sequence[Law | None],
    twice: int | None,
    gravity: list[float],
) -> dict[str, Any]:
    """The document of a linkage of these pieces; `twice` is the number of a joint that is entered a second time."""
    draft = Draft()
    for k, part in enumerate(parts):
        if draft.bodies + TAKES.get(part.kind, 1) > MOST:
            continue
        if k == 0 or part.kind not in PLACED or not PLACED[part.kind](draft, part):
            swing(draft, part)
    for part in welds:
        weld(draft, part)
    if twice is not None and not any(x.kind == "friction" for x in loads):  # whose loads redundant rows leave open
        joints = draft.tables["joints"]
        joints["again"] = joints[list(joints)[twice % len(joints)]]
    for k, x in enumerate(loads):
        if table := load(draft, x):
            draft.tables["forces"][f"f{k}"] = table
    laws = [*laws[: len(draft.freedoms)], *[None] * (len(draft.freedoms) - len(laws))]
    start: dict[str, dict[str, Any]] = {"slides": {}, "slide_speeds": {}, **draft.held}
    for freedom, law in zip(draft.freedoms, laws, strict=True):
        if law is None:
            start[freedom.group][freedom.name] = freedom.value
            start["speeds" if freedom.group == "angles" else "slide_speeds"][freedom.name] = freedom.rate
    drivers = [driver(f, law) for f, law in zip(draft.freedoms, laws, strict=True) if law]
    scenario: dict[str, Any] = {"duration": 0.2, "forces": list(draft.tables["forces"])}
    scenario |= {"drivers": drivers} if drivers else {}
    held = {k: x for k, x in start.items() if x}
    scenario |= {"start": held} if held or not drivers else {}
    found: dict[str, Any] = {
        "format": SECOND if draft.second else FORMAT,
        "name": "drawn",
        "gravity": gravity,
        "ground": {"points": draft.ground},
        **{k: x for k, x in draft.tables.items() if x},
        "assembly": {
            "sketch": {f"{x}.A": draft.points[f"{x}.A"] for x in draft.tables["links"]},
            "angles": {x: draft.angles[x] for x in draft.tables["links"]},
        },
        "scenarios": {"run": scenario},
    }
    return dict(plain(found))


def tenths(low: int, high: int) -> st.SearchStrategy[float]:
    return st.integers(low, high).map(lambda k: k / 10)


def linkages(
    parts: Sequence[str] = PARTS,
    forces: Sequence[str] = FORCES,
    laws: st.SearchStrategy[list[Law | None]] | None = None,
    varying: bool = True,
    welded: bool = True,
    twice: bool = True,
    bodies: int = MOST,
) -> st.SearchStrategy[dict[str, Any]]:
    """Documents of these parts and forces, and of so many bodies about; `laws` of the freedoms, by default of some of them."""
    few = st.integers(0, 30)
    body = st.builds(
        Body, st.sampled_from(["own", "bars", "polar"]), tenths(1, 40), tenths(1, 9), tenths(1, 6),
        st.just(0.0) | tenths(1, 9) if welded else st.just(0.0),
    )  # fmt: skip
    turn = st.integers(-180, 180)
    part = st.builds(
        Part, st.sampled_from([x for x in PARTS if x in parts]), few, few, tenths(1, 5), turn, st.integers(-60, 60), st.booleans(),
        tenths(-50, 50), body,
    )  # fmt: skip
    factor = st.builds(Varying, st.sampled_from(["", "table", "ramp", "step", "sine"]), tenths(1, 20), st.none() | tenths(-10, 10))
    one = tenths(-20, 20)
    force = st.builds(
        Load, st.sampled_from(forces), few, few, st.integers(0, 2), one, one, tenths(-4, 4), turn,
        st.none() | factor if varying else st.none(),
    )  # fmt: skip
    return st.builds(
        document_of,
        parts=st.lists(part, min_size=2, max_size=bodies),
        welds=st.lists(part, max_size=2) if welded else st.just([]),
        loads=st.lists(force, max_size=5),
        laws=st.lists(st.none() | law(), max_size=3) if laws is None else laws,
        twice=st.none() | few if twice else st.none(),
        gravity=st.sampled_from([[0.0, -9.81], [0.5, -9.81], [0.0, 0.0]]),
    )


def random_linkage(seed: int) -> dict[str, Any]:
    """A linkage of two to eight links by lot, of pins, slides, springs and torques alone; the same seed gives the same one."""
    rng = np.random.default_rng([seed, 10])
    wanted, parts, bodies = int(rng.integers(FEWEST, MANY + 1)), list[Part](), 0
    while bodies < wanted:
        kinds = ["two bars", "bar and block", "swing"] if 0 < bodies < wanted - 1 else ["swing"]
        kind = kinds[int(rng.integers(len(kinds)))]
        bodies += TAKES.get(kind, 1)
        mass, along, aside = 10 ** rng.uniform(-1, 1), rng.uniform(0.3, 0.7), rng.uniform(0.1, 0.4)
        on, to = (int(x) for x in rng.integers(31, size=2))
        turn, bend, speed = rng.uniform(-180, 180), rng.uniform(-60, 60), rng.uniform(-5, 5)
        parts.append(Part(kind, on, to, rng.uniform(0.15, 0.6), turn, bend, False, speed, Body("own", mass, along, aside, 0.0)))
    numbers = rng.uniform(-1, 1, (2, 3))
    loads = [
        Load(kind, *map(int, rng.integers(31, size=2)), 0, *x, 0.0, None)
        for kind, x in zip(("spring", "torque"), numbers, strict=True)
    ]
    return document_of(parts, [], loads, [], None, [rng.uniform(-1, 1), -9.81]) | {"name": f"random_{seed}"}


def law() -> st.SearchStrategy[Law]:
    return st.builds(Law, st.sampled_from(SMOOTH), tenths(-5, 5), tenths(2, 9))


UNDRIVEN: st.SearchStrategy[list[Law | None]] = st.just([])


def every_freedom() -> st.SearchStrategy[list[Law | None]]:
    """Laws for more freedoms than there are bodies."""
    return st.lists(law(), min_size=MOST, max_size=MOST)


def examples(few, share=1.0):
    """Return settings for `few` examples, always the same ones, or for a share of the number in PROPERTIES."""
    slow = [HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large]
    phases = set(Phase) - {Phase.reuse, Phase.explain}
    return settings(
        max_examples=max(few, round(ASKED * share)) if ASKED else few,
        derandomize=not ASKED,
        deadline=None,
        database=None,
        print_blob=True,
        suppress_health_check=slow,
        phases=phases,
    )
