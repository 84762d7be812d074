"""Checks the schema cannot make: names that must resolve, points that must be determined, keys that belong together.

Works on the raw document and passes over whatever the schema has already refused, so that all faults of a file come at once.
"""

from collections.abc import Iterator
from decimal import Decimal
from itertools import pairwise
from typing import Any

from gauss_bench.linkage.cylinders import BARREL, ROD, write_out
from gauss_bench.linkage.errors import Fault

Document = dict[str, Any]
RADIAN_PAIRS = ("angle", "phase", "block_angle", "rest", "start", "travel", "crank")


def table(value: Any, key: str) -> dict[str, Any]:
    """The sub-table `key`, or an empty one where there is none or it is not a table."""
    inner = value.get(key) if isinstance(value, dict) else None
    return inner if isinstance(inner, dict) else {}


def items(value: Any, key: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Named sub-tables of `key` that really are tables."""
    return ((name, entry) for name, entry in table(value, key).items() if isinstance(entry, dict))


def sequence(value: Any, key: str) -> list[Any]:
    entries = value.get(key) if isinstance(value, dict) else None
    return entries if isinstance(entries, list) else []


def drivers_of(scenario: dict[str, Any]) -> list[Any]:
    """The tables of a scenario's drivers, be there one `driver`, several `drivers` or none."""
    return [scenario["driver"]] if "driver" in scenario else sequence(scenario, "drivers")


class Names:
    """The names a document defines, and the faults of what refers to them."""

    def __init__(self, document: Document):
        self.document = document
        self.faults: list[Fault] = []
        self.links = table(document, "links")
        self.bodies = {name: _body(document, name) for name in self.links}
        self.joints = table(document, "joints")
        self.points = {name: set(table(link, "points")) for name, link in self.links.items()}
        self.points["ground"] = set(table(table(document, "ground"), "points"))

    def fault(self, path: str, text: str) -> None:
        self.faults.append(Fault(path, text))

    def link(self, path: str, name: Any, ground: bool = True) -> None:
        if isinstance(name, str) and name not in self.links and not (ground and name == "ground"):
            self.fault(path, f"unknown link {name!r}")

    def point(self, path: str, reference: Any, ground: bool = True) -> None:
        if not isinstance(reference, str):
            return
        link, dot, point = reference.partition(".")
        if not dot:
            self.fault(path, f"{reference!r} is not of the form 'link.point'")
        elif link not in self.points:
            self.fault(path, f"unknown link {link!r} in {reference!r}")
        elif link == "ground" and not ground:
            self.fault(path, f"{reference!r} is on the ground; it must be on a link")
        elif point not in self.points[link]:
            self.fault(path, f"unknown point {point!r} of {link!r}")

    def different_links(self, path: str, references: list[Any]) -> None:
        owners = [r.partition(".")[0] for r in references if isinstance(r, str)]
        for name in sorted({x for x in owners if owners.count(x) > 1}):
            self.fault(path, f"the link {name!r} appears twice")
        for a, b in pairwise(sorted({*owners}, key=lambda x: self.bodies.get(x, x))):
            if self.bodies.get(a, a) == self.bodies.get(b, b):
                self.fault(path, f"the links {a!r} and {b!r} are welded together")


def reference_faults(document: Document, stem: str | None) -> list[Fault]:
    """Every fault of names and combinations; `stem` is the file's name without its ending, None where there is no file."""
    if "cylinders" in document and not _are_tables(document):
        return []  # which the schema has refused; whatever else is named may be theirs
    if spoilt := _cylinder_faults(document):
        return spoilt
    document = write_out(document)
    names = Names(document)
    name = document.get("name")
    if stem is not None and isinstance(name, str) and name != stem:
        names.fault("name", f"{name!r} differs from the file's name {stem!r}")
    _check_points(names)
    _check_links(names)
    _check_welds(names)
    _check_joints(names)
    _check_crank(names)
    for key, entry in items(document, "constraints"):
        if "point" in entry:
            names.point(f"constraints.{key}.point", entry["point"], ground=False)
        for i, link in enumerate(sequence(entry, "links")):
            names.link(f"constraints.{key}.links[{i}]", link)
    for key, entry in items(document, "forces"):
        _check_force(names, f"forces.{key}", entry)
    _check_assembly(names)
    observe = table(document, "observe")
    for i, point in enumerate(sequence(observe, "points")):
        names.point(f"observe.points[{i}]", point)
    for i, link in enumerate(sequence(observe, "links")):
        names.link(f"observe.links[{i}]", link, ground=False)
    if "measure" in document:
        _check_measure(names, table(document, "measure"))
    for key, entry in items(document, "scenarios"):
        _check_scenario(names, f"scenarios.{key}", entry)
    for path, entry in _angle_tables(document):
        for key in RADIAN_PAIRS:
            if key in entry and f"{key}_deg" in entry:
                names.fault(f"{path}.{key}", f"given together with {key}_deg")
    return names.faults


def _angle_tables(document: Document) -> Iterator[tuple[str, dict[str, Any]]]:
    yield "measure", table(document, "measure")
    yield from ((f"forces.{key}.over_time", table(entry, "over_time")) for key, entry in items(document, "forces"))
    for group in ("joints", "welds", "constraints", "forces"):
        yield from ((f"{group}.{key}", entry) for key, entry in items(document, group))
    for key, entry in items(document, "scenarios"):
        yield from ((f"scenarios.{key}.{part}", table(entry, part)) for part in ("driver", "start"))
        yield from _driver_list(f"scenarios.{key}", entry)


def _driver_list(path: str, scenario: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    drivers = sequence(scenario, "drivers")
    return ((f"{path}.drivers[{i}]", x) for i, x in enumerate(drivers) if isinstance(x, dict))


def _body(document: Document, name: str) -> str:
    """The link that a link is welded to in the end; its own name where it is not, or in a circle."""
    welds = {weld["link"]: weld.get("to") for _, weld in items(document, "welds") if isinstance(weld.get("link"), str)}
    seen = [name]
    while isinstance(at := welds.get(seen[-1]), str) and at not in seen:
        seen.append(at)
    return seen[-1]


def _are_tables(document: Document) -> bool:
    """Tell whether links, joints and cylinders are tables of tables, with parts that are."""
    groups = [document.get(key, {}) for key in ("links", "joints", "cylinders")]
    if not all(isinstance(x, dict) and all(isinstance(y, dict) for y in x.values()) for x in groups):
        return False
    return all(isinstance(x.get(part, {}), dict) for x in groups[2].values() for part in (BARREL, ROD))


def _cylinder_faults(document: Document) -> list[Fault]:
    """List the faults that keep cylinders from being written out as links and joints, under their own names."""
    names = Names(document)
    for key, cylinder in items(document, "cylinders"):
        path, between = f"cylinders.{key}", sequence(cylinder, "between")
        if len(between) != 2 or not all(isinstance(x, str) for x in between):
            names.fault(f"{path}.between", "must be two points")
            continue
        for i, reference in enumerate(between):
            names.point(f"{path}.between[{i}]", reference)
        names.different_links(f"{path}.between", between)
        for part in (BARREL, ROD):
            given = table(cylinder, part)
            if ("mass" in given) == ("kg_per_m" in given):
                names.fault(f"{path}.{part}.mass", "give either mass or kg_per_m")
            if not isinstance(given.get("length"), (int, float, Decimal)):
                names.fault(f"{path}.{part}.length", "required: a number")
            for group in ("links", "joints"):
                if f"{key}_{part}" in table(document, group):
                    names.fault(path, f"its {part} is called '{key}_{part}', and {group}.{key}_{part} is there already")
        if key in names.joints:
            names.fault(path, f"its slide is called {key!r}, and joints.{key} is there already")
    return names.faults


def _check_points(names: Names) -> None:
    owners = [("ground", table(names.document, "ground")), *((f"links.{k}", v) for k, v in items(names.document, "links"))]
    for path, owner in owners:
        points = table(owner, "points")
        for key, value in points.items():
            if not isinstance(value, dict):
                continue
            if ("r" in value) == ("xy" in value):
                names.fault(f"{path}.points.{key}", "give either r (and deg) or xy")
            if "deg" in value and "r" not in value:
                names.fault(f"{path}.points.{key}.deg", "given without r")
            base = value.get("from")
            if isinstance(base, str) and base not in points:
                names.fault(f"{path}.points.{key}.from", f"unknown point {base!r}")
            elif _is_circular(points, key):
                names.fault(f"{path}.points.{key}.from", "circular: the point refers to itself")


def _is_circular(points: dict[str, Any], key: str) -> bool:
    seen: set[str] = set()
    current: Any = key
    while isinstance(current, str) and isinstance(points.get(current), dict):
        if current in seen:
            return current == key
        seen.add(current)
        current = points[current].get("from")
    return False


def _check_links(names: Names) -> None:
    if "ground" in names.links:
        names.fault("links.ground", "'ground' is a reserved name")
    for key, link in items(names.document, "links"):
        path, bars = f"links.{key}", sequence(link, "bars")
        for i, bar in enumerate(bars):
            for end in bar if isinstance(bar, list) else []:
                if isinstance(end, str) and end not in names.points[key]:
                    names.fault(f"{path}.bars[{i}]", f"unknown point {end!r}")
            if isinstance(bar, list) and len(bar) == 2 and bar[0] == bar[1]:
                names.fault(f"{path}.bars[{i}]", "zero length")
        if "mass" in link and "kg_per_m" in link:
            names.fault(f"{path}.kg_per_m", "given together with mass")
        masses = sequence(link, "point_masses")
        for i, mass in enumerate(masses):
            if isinstance(mass, dict) and isinstance(mass.get("point"), str) and mass["point"] not in names.points[key]:
                names.fault(f"{path}.point_masses[{i}].point", f"unknown point {mass['point']!r} of {key!r}")
        if "mass" not in link and "kg_per_m" not in link and not masses:
            names.fault(f"{path}.mass", "neither mass nor kg_per_m is given")
        if "kg_per_m" in link and not bars:
            names.fault(f"{path}.kg_per_m", "needs bars")
        if "inertia" not in link and not bars and not (masses and "mass" not in link):
            names.fault(f"{path}.inertia", "required where there are no bars")


def _check_welds(names: Names) -> None:
    welded: set[str] = set()
    for key, weld in items(names.document, "welds"):
        path, link, to = f"welds.{key}", weld.get("link"), weld.get("to")
        for side, name in (("link", link), ("to", to)):
            if name == "ground":
                names.fault(f"{path}.{side}", "what is welded to the ground does not move: make its points ground points")
            else:
                names.link(f"{path}.{side}", name)
        if not isinstance(link, str) or not isinstance(to, str):
            continue
        if link in welded:
            names.fault(f"{path}.link", f"link {link!r} is welded twice; it may be what others are welded to")
        elif link == to or (names.bodies.get(link) != names.bodies.get(to) and to in names.links):
            names.fault(path, "welded in a circle")
        welded.add(link)
        pairs = sequence(weld, "points")
        for i, pair in enumerate(pairs):
            owners = [x.partition(".")[0] if isinstance(x, str) else "" for x in pair] if isinstance(pair, list) else []
            if len(owners) == 2 and owners != [to, link]:
                names.fault(f"{path}.points[{i}]", f"must be a point of {to!r} and the point of {link!r} that coincides with it")
            for k, reference in enumerate(pair if isinstance(pair, list) else []):
                names.point(f"{path}.points[{i}][{k}]", reference)
        if pairs and "origin" in weld:
            names.fault(f"{path}.origin", "given together with points")
        if not pairs and "origin" not in weld:
            names.fault(f"{path}.origin", "required where no points are given")
        if len(pairs) == 2 and {"angle", "angle_deg"} & weld.keys():
            names.fault(f"{path}.angle_deg", "given together with two pairs of points, which fix it")


def _check_joints(names: Names) -> None:
    for key, joint in items(names.document, "joints"):
        path = f"joints.{key}"
        references = sequence(joint, "at")
        for i, reference in enumerate(references):
            names.point(f"{path}.at[{i}]", reference)
        names.different_links(f"{path}.at", references)
        if joint.get("type") == "prismatic":
            names.point(f"{path}.guide", joint.get("guide"))
            names.point(f"{path}.block", joint.get("block"))
            names.different_links(f"{path}.block", [joint.get("guide"), joint.get("block")])


def _turns_on_ground(names: Names, link: str) -> bool:
    for _, joint in items(names.document, "joints"):
        owners = {r.partition(".")[0] for r in sequence(joint, "at") if isinstance(r, str)}
        if {"ground", link} <= owners:
            return True
    return False


def _check_crank(names: Names) -> None:
    crank = names.document.get("crank")
    if isinstance(crank, str):
        if crank not in names.links:
            names.fault("crank", f"unknown link {crank!r}")
        elif not _turns_on_ground(names, crank):
            names.fault("crank", f"link {crank!r} has no revolute joint on the ground")


def _check_force(names: Names, path: str, force: dict[str, Any]) -> None:
    for key in ("link", "reaction"):
        names.link(f"{path}.{key}", force.get(key))
    if "link" in force and force.get("link") == force.get("reaction", "ground"):
        names.fault(f"{path}.reaction", "link and reaction are the same")
    if isinstance(link := force.get("link"), str) and isinstance(other := force.get("reaction", "ground"), str) and link != other:
        names.different_links(f"{path}.reaction", [link, other])
    times = [row[0] for row in sequence(table(force, "over_time"), "rows") if isinstance(row, list) and len(row) == 2]
    if all(isinstance(x, (int, float, Decimal)) for x in times) and any(b <= a for a, b in pairwise(times)):
        names.fault(f"{path}.over_time.rows", "times must increase")
    kind = force.get("type")
    if kind in ("force", "axis_spring_damper"):
        names.point(f"{path}.point", force.get("point"), ground=kind != "force")
    if force.get("frame") != "body":
        names.link(f"{path}.frame", force.get("frame"))
    if "origin" in force:
        names.point(f"{path}.origin", force.get("origin"))
    if kind == "axis_spring_damper":
        names.different_links(f"{path}.origin", [force.get("point"), force.get("origin", "ground.")])
    for key in ("between", "links"):
        for i, reference in enumerate(sequence(force, key)):
            (names.point if key == "between" else names.link)(f"{path}.{key}[{i}]", reference)
        names.different_links(f"{path}.{key}", sequence(force, key))
    joint = force.get("joint")
    if isinstance(joint, str) and joint not in names.joints:
        names.fault(f"{path}.joint", f"unknown joint {joint!r}")
    elif isinstance(joint, str) and kind == "coulomb_friction":
        pair = table(names.joints, joint).get("type")
        if pair == "revolute" and "radius" not in force:
            names.fault(f"{path}.radius", f"required: joint {joint!r} is revolute")
        if pair == "prismatic" and "radius" in force:
            names.fault(f"{path}.radius", f"joint {joint!r} is prismatic and has none")


def _check_assembly(names: Names) -> None:
    assembly = table(names.document, "assembly")
    for key in table(assembly, "sketch"):
        if "." in key:
            names.point(f"assembly.sketch.{key}", key)
        elif key not in names.joints:
            names.fault(f"assembly.sketch.{key}", f"unknown joint {key!r}")
    _check_angles(names, "assembly", assembly)


def _check_angles(names: Names, path: str, owner: dict[str, Any]) -> None:
    for group in ("angles_deg", "angles"):
        for link in table(owner, group):
            names.link(f"{path}.{group}.{link}", link, ground=False)
    for link in table(owner, "angles").keys() & table(owner, "angles_deg").keys():
        names.fault(f"{path}.angles.{link}", "given together with angles_deg")


def _check_scenario(names: Names, path: str, scenario: dict[str, Any]) -> None:
    active = sequence(scenario, "forces")
    for i, force in enumerate(active):
        if isinstance(force, str) and force not in table(names.document, "forces"):
            names.fault(f"{path}.forces[{i}]", f"unknown force {force!r}")
        elif isinstance(force, str) and force in active[:i]:
            names.fault(f"{path}.forces[{i}]", f"{force!r} appears twice")
    if "driver" in scenario and "start" in scenario:
        names.fault(
            f"{path}.driver",
            "given together with start: beside a start, what is driven stands in the list `drivers = [{ ... }]`, and the start "
            "holds what they leave free",
        )
    if "driver" in scenario and "drivers" in scenario:
        names.fault(f"{path}.drivers", "given together with driver")
    driver = table(scenario, "driver")
    for where, entry in [*([(f"{path}.driver", driver)] if driver else []), *_driver_list(path, scenario)]:
        _check_driver(names, where, entry)
    _check_start(names, f"{path}.start", table(scenario, "start"))
    for i, held in enumerate(sequence(scenario, "hold")):
        if isinstance(held, str) and held not in names.links and held not in names.joints:
            names.fault(f"{path}.hold[{i}]", f"unknown link or joint {held!r}")


def _check_measure(names: Names, measure: dict[str, Any]) -> None:
    _check_coordinate(names, "measure", measure, ("link", "joint", "between", "point"))
    names.point("measure.point", measure.get("point"), ground=False)
    for key in {"angle", "angle_deg"} & measure.keys():
        if "point" not in measure:
            names.fault(f"measure.{key}", "given without point")


def _check_coordinate(names: Names, path: str, owner: dict[str, Any], keys: tuple[str, ...]) -> None:
    """The one coordinate that a driver or `measure` names by one of these keys."""
    if len(owner.keys() & set(keys)) != 1:
        names.fault(path, f"give exactly one of {', '.join(keys[:-1])} and {keys[-1]}")
    joint, between = owner.get("joint"), sequence(owner, "between")
    names.link(f"{path}.link", owner.get("link"), ground=False)
    if isinstance(joint, str) and joint not in names.joints:
        names.fault(f"{path}.joint", f"unknown joint {joint!r}")
    elif isinstance(joint, str) and table(names.joints, joint).get("type") != "prismatic":
        names.fault(f"{path}.joint", f"joint {joint!r} is not prismatic")
    for i, reference in enumerate(between):
        names.point(f"{path}.between[{i}]", reference)
    names.different_links(f"{path}.between", between)


def _check_driver(names: Names, path: str, driver: dict[str, Any]) -> None:
    link, between = driver.get("link"), sequence(driver, "between")
    _check_coordinate(names, path, driver, ("link", "joint", "between"))
    if isinstance(link, str) and link in names.links and not _turns_on_ground(names, link):
        names.fault(f"{path}.link", f"link {link!r} has no revolute joint on the ground")
    if "link" not in driver:
        for key in ("start_deg", "travel_deg"):
            if key in driver:
                names.fault(f"{path}.{key}", "a length is driven: give metres without _deg")
    if between and "start" not in driver:
        names.fault(f"{path}.start", "required: the length at the start")
    if driver.get("law") in ("sine", "cosine", "poly345") and not {"travel", "travel_deg"} & driver.keys():
        names.fault(f"{path}.{'travel_deg' if 'link' in driver else 'travel'}", "required")
    times = [row[0] for row in sequence(driver, "rows") if isinstance(row, list) and len(row) == 2]
    if all(isinstance(x, (int, float)) for x in times) and any(b <= a for a, b in pairwise(times)):
        names.fault(f"{path}.rows", "times must increase")


def _check_start(names: Names, path: str, start: dict[str, Any]) -> None:
    crank = x if isinstance(x := names.document.get("crank"), str) else ""
    angles = {*table(start, "angles"), *table(start, "angles_deg")}
    by_crank = {"crank", "crank_deg"} & start.keys()
    if ({"speed"} | by_crank) & start.keys() and "crank" not in names.document:
        names.fault(path, "needs a crank, and the file names none")
    if by_crank and crank in angles:
        names.fault(f"{path}.angles.{crank}", "the crank is held twice")
    _check_angles(names, path, start)
    for joint in table(start, "slides"):
        if joint not in names.joints:
            names.fault(f"{path}.slides.{joint}", f"unknown joint {joint!r}")
        elif table(names.joints, joint).get("type") != "prismatic":
            names.fault(f"{path}.slides.{joint}", "not a prismatic joint")
    for point in table(start, "points"):
        names.point(f"{path}.points.{point}", point, ground=False)
    held: dict[str, set[Any]] = {
        "speeds": angles | ({crank} if by_crank else set()),
        "slide_speeds": {*table(start, "slides")},
        "point_velocities": {*table(start, "points")},
    }
    for group, coordinates in held.items():
        for key in table(start, group):
            if key not in coordinates:
                names.fault(f"{path}.{group}.{key}", "a rate without its held coordinate")
    if "speed" in start and not by_crank and crank not in angles:
        names.fault(f"{path}.speed", "a rate without its held coordinate")
