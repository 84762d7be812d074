"""Checks beyond the schema: names must exist, points must be determined, and some keys exclude or need each other.

`schema.py` has replaced every value that it rejected by None, which the checks of this module skip, so that all other faults of the
file are reported at once. `grammar.toml` lists the places of names and faulty combinations of keys.
"""

from collections.abc import Callable, Collection, Iterator
from itertools import pairwise
from typing import Any

from gauss_bench.linkage.bodies import BARREL, ROD, expand_cylinders
from gauss_bench.linkage.errors import Fault
from gauss_bench.linkage.limits import follow
from gauss_bench.linkage.schema import GRAMMAR

Document = dict[str, Any]
Place = tuple[str, Any]  # path, value

IN_DEGREES = ("angle", "phase", "block_angle", "rest", "start", "travel", "crank")  # keys that may also be given as KEY_deg


def table(value: Any, key: str) -> dict[str, Any]:
    """Return the table at `key` of a table, or an empty table if there is none."""
    inner = value.get(key) if isinstance(value, dict) else None
    return inner if isinstance(inner, dict) else {}


def items(value: Any, key: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield (name, entry) for each entry of the table at `key` that is itself a table."""
    return ((name, entry) for name, entry in table(value, key).items() if isinstance(entry, dict))


def sequence(value: Any, key: str) -> list[Any]:
    """Return the list at `key` of a table, or an empty list if there is none."""
    entries = value.get(key) if isinstance(value, dict) else None
    return entries if isinstance(entries, list) else []


def drivers_of(scenario: dict[str, Any]) -> list[Any]:
    """Return the tables of a scenario's drivers, from its key `driver` or its list `drivers`."""
    return [scenario["driver"]] if "driver" in scenario else sequence(scenario, "drivers")


def places(document: Document, *patterns: str) -> Iterator[Place]:
    """Yield path and value of the places in a document that match one of the patterns; places with None are left out.

    In a pattern such as `scenarios.*.hold[*]`, * stands for any key, [*] for any entry of a list, and ~ for the keys themselves.
    """
    for pattern in patterns:
        matches: list[Place] = [("", document)]  # places that match the components so far
        for component in pattern.replace("[*]", ".[*]").split("."):
            matches = [inner for path, value in matches for inner in _match_entries(path, value, component)]
        yield from ((path, value) for path, value in matches if value is not None)


def _match_entries(path: str, x: Any, component: str) -> Iterator[Place]:
    """Yield path and value of each entry of x, the table or list at `path`, whose key matches a component of a pattern.

    "[*]" is all entries of a list; "*" all values of a table; "~" all keys of a table as values; anything else one key.
    """
    if component == "[*]":
        for i, entry in enumerate(x if isinstance(x, list) else ()):
            yield f"{path}[{i}]", entry
    elif isinstance(x, dict):
        for key, entry in x.items():
            if component in ("*", "~", key):
                yield f"{path}.{key}".lstrip("."), key if component == "~" else entry


class Names:
    """The names that a document defines, and the faults that the checks have found so far.

    Attributes:
        bodies: link -> the last link of its chain of welds, the same for all links of a body; itself if it is not welded.
        points: link, or "ground" -> names of its points.
    """

    def __init__(self, document: Document):
        self.document = document
        self.faults: list[Fault] = []
        self.links, self.joints, self.forces = (table(document, key) for key in ("links", "joints", "forces"))
        # welds in the form of points given relative to each other ({"from": ...}), so that `follow` finds chains of welds
        welds: dict[Any, Any] = {weld.get("link"): {"from": weld.get("to")} for _, weld in items(document, "welds")}
        self.bodies = {name: follow(welds, name)[0][-1] for name in self.links}
        self.points = {name: set(table(link, "points")) for name, link in self.links.items()}
        self.points["ground"] = set(table(table(document, "ground"), "points"))

    def fault(self, path: str, text: str) -> None:
        """Add a fault at the path `path` of keys in the document."""
        self.faults.append(Fault(path, text))

    def check(self, path: str, name: str, kind: str) -> None:
        """Add a fault unless the document defines an item `name` of a kind of `grammar.toml`, such as "link"."""
        if kind in ("point", "own point"):
            self.check_point(path, name, ground=kind == "point")
            return
        known: dict[str, Collection[str]] = {
            "link": {*self.links, "ground"},
            "own link": self.links,
            "joint": self.joints,
            "force": self.forces,
            "link or joint": {*self.links, *self.joints},
        }
        item = "joint" if kind in ("slide", "start slide") else kind
        if name not in known[item]:
            self.fault(path, f"unknown {item.removeprefix('own ')} {name!r}")
        elif kind in ("slide", "start slide") and table(self.joints, name).get("type") != "prismatic":
            self.fault(path, "not a prismatic joint" if kind == "start slide" else f"joint {name!r} is not prismatic")

    def check_point(self, path: str, reference: str, ground: bool = True) -> None:
        """Add a fault unless the point "link.point" exists; with ground=False, a point on the ground is a fault too."""
        link, dot, point = reference.partition(".")
        if not dot:
            self.fault(path, f"{reference!r} is not of the form 'link.point'")
        elif link not in self.points:
            self.fault(path, f"unknown link {link!r} in {reference!r}")
        elif link == "ground" and not ground:
            self.fault(path, f"{reference!r} is on the ground; it must be on a link")
        elif point not in self.points[link]:
            self.fault(path, f"unknown point {point!r} of {link!r}")

    def check_different_links(self, path: str, references: list[Any]) -> None:
        """Add a fault if two of the references, "link" or "link.point", are to one link or to links that are welded together."""
        owners = [r.partition(".")[0] for r in references if r is not None]
        for name in sorted({x for x in owners if owners.count(x) > 1}):
            self.fault(path, f"the link {name!r} appears twice")
        body_of = {name: self.bodies.get(name, name) for name in owners}
        for a, b in pairwise(sorted(body_of, key=lambda name: body_of[name])):  # links of one body are neighbours
            if body_of[a] == body_of[b]:
                self.fault(path, f"the links {a!r} and {b!r} are welded together")

    def check_turns_on_ground(self, path: str, link: str) -> None:
        """Add a fault if the link has no revolute joint on the ground, unless the schema has rejected a joint."""
        # only revolute joints have `at`; None stands for a joint or point that the schema rejected: it may be the missing one
        points_of_joints = [joint and joint.get("at", ()) for joint in self.joints.values()]
        if link not in self.links or any(points is None or None in points for points in points_of_joints):
            return
        links_of_joints = [{reference.partition(".")[0] for reference in points} for points in points_of_joints]
        if not any({"ground", link} <= links for links in links_of_joints):
            self.fault(path, f"link {link!r} has no revolute joint on the ground")


def reference_faults(document: Document, stem: str | None) -> list[Fault]:
    """Return all faults in names and combinations of keys; `stem` is the file's name without suffix, if there is a file."""
    cylinder_faults = _cylinder_faults(document)  # first, because `expand_cylinders` needs faultless cylinders
    if cylinder_faults:
        return cylinder_faults
    document = expand_cylinders(document)
    names = Names(document)
    if stem is not None and document.get("name") not in (None, stem):
        names.fault("name", f"{document['name']!r} differs from the file's name {stem!r}")
    if "ground" in names.links:
        names.fault("links.ground", "'ground' is a reserved name")
    # the rules of grammar.toml: names must exist, entries of lists must be on different links, keys exclude or need each other
    for pattern, kind in GRAMMAR["named"].items():
        for path, name in places(document, pattern):
            names.check(path, name, kind)
    for path, references in places(document, *GRAMMAR["lists"]["apart"]):
        names.check_different_links(path, references)
    for rule in GRAMMAR["fault"]:  # a table is faulty if it has all keys of `with` and none of `without`
        for path, entry in places(document, *rule["tables"]):
            if not isinstance(entry, dict):
                continue  # a point that is given as a list
            keys = {key for key, value in entry.items() if value != []}
            if {*rule.get("with", ())} <= keys and not keys & {*rule.get("without", ())}:
                names.fault(f"{path}.{rule.get('at', '')}".removesuffix("."), rule["text"])
    for rule in GRAMMAR["one_of"]:
        for path, entry in places(document, *rule["tables"]):
            if len(entry.keys() & {*rule["keys"]}) != 1:
                names.fault(path, f"give exactly one of {', '.join(rule['keys'][:-1])} and {rule['keys'][-1]}")
    for path, entry in places(document, *GRAMMAR["tables"]["angles"]):
        for key in IN_DEGREES:
            if {key, f"{key}_deg"} <= entry.keys():
                names.fault(f"{path}.{key}", f"given together with {key}_deg")
    # the rules that only a function can express
    for pattern, check in CHECKS.items():
        for path, entry in places(document, pattern):
            check(names, path, entry)
    return names.faults


def _cylinder_faults(document: Document) -> list[Fault]:
    """List the faults of cylinders; a faulty cylinder cannot be expanded into links and joints."""
    names = Names(document)
    for path, between in places(document, "cylinders.*.between"):
        for i, reference in enumerate(between):
            names.check_point(f"{path}[{i}]", reference)
        names.check_different_links(path, between)
    for key, cylinder in items(document, "cylinders"):
        path = f"cylinders.{key}"
        for part in (BARREL, ROD):
            if ("mass" in cylinder[part]) == ("kg_per_m" in cylinder[part]):
                names.fault(f"{path}.{part}.mass", "give either mass or kg_per_m")
            for group in ("links", "joints"):
                if f"{key}_{part}" in table(document, group):
                    names.fault(path, f"its {part} is called '{key}_{part}', and {group}.{key}_{part} is there already")
        if key in names.joints:
            names.fault(path, f"its slide is called {key!r}, and joints.{key} is there already")
    return names.faults


def _check_points(names: Names, path: str, points: dict[str, Any]) -> None:
    """Check that `from` of each point names another point of the link, and that no chain of points closes on itself."""
    for key, value in points.items():
        base = value.get("from") if isinstance(value, dict) else None
        if base is not None and base not in points:
            names.fault(f"{path}.{key}.from", f"unknown point {base!r}")
        elif base is not None and follow(points, key)[1] == key:  # the chain of points comes back to its first point
            names.fault(f"{path}.{key}.from", "circular: the point refers to itself")


def _check_link(names: Names, path: str, link: dict[str, Any]) -> None:
    """Check that bars and point masses name points of their link, and that no bar has the same point at both ends."""
    points = table(link, "points")
    for place, bar in places(link, "bars[*]"):
        ends = [end for end in bar if end is not None]  # None stands for a value that the grammar has refused
        for end in ends:
            if end not in points:
                names.fault(f"{path}.{place}", f"unknown point {end!r}")
        if len(ends) == 2 and ends[0] == ends[1]:
            names.fault(f"{path}.{place}", "zero length")
    for place, point in places(link, "point_masses[*].point"):
        if point not in points:
            names.fault(f"{path}.{place}", f"unknown point {point!r} of {path.partition('.')[2]!r}")


def _check_welds(names: Names, path: str, welds: dict[str, Any]) -> None:
    """Check that welds attach existing links, each once and not in a circle, at their own points, and give no angle twice."""
    welded: set[str] = set()  # links that the welds so far attach
    for key, weld in items(names.document, path):
        place, link, to, pairs = f"{path}.{key}", weld.get("link"), weld.get("to"), sequence(weld, "points")
        for side, name in (("link", link), ("to", to)):
            if name == "ground":
                names.fault(f"{place}.{side}", "a link that is welded to the ground does not move: make its points ground points")
            elif name is not None:
                names.check(f"{place}.{side}", name, "link")
        if link is None or to is None:
            continue
        if link in welded:
            names.fault(f"{place}.link", f"link {link!r} is welded twice; weld the other link to it instead")
        elif link == to or (names.bodies.get(link) != names.bodies.get(to) and to in names.links):
            # the weld puts `to` into the chain of `link`, so that both chains have the same end, unless they form a circle
            names.fault(place, "welded in a circle")
        welded.add(link)
        for i, pair in enumerate(pairs):
            if pair and None not in pair and [x.partition(".")[0] for x in pair] != [to, link]:
                names.fault(f"{place}.points[{i}]", f"must be a point of {to!r} and the point of {link!r} that coincides with it")
        if len(pairs) == 2 and {"angle", "angle_deg"} & weld.keys():
            names.fault(f"{place}.angle_deg", "given together with two pairs of points, which fix it")


def _check_joint(names: Names, path: str, joint: dict[str, Any]) -> None:
    """Check that guide and block of a slide are different links."""
    if joint.get("type") == "prismatic":
        names.check_different_links(f"{path}.block", [joint.get("guide"), joint.get("block")])


def _check_force(names: Names, path: str, force: dict[str, Any]) -> None:
    """Check the names in a force, that it acts between different links, and that friction has a radius in a pin, not in a slide."""
    kind, joint, frame = (force.get(key) for key in ("type", "joint", "frame"))
    if "link" in force:
        ends = [force["link"], force.get("reaction", "ground")]
        if ends[0] is not None and ends[0] == ends[1]:
            names.fault(f"{path}.reaction", "link and reaction are the same")
        else:
            names.check_different_links(f"{path}.reaction", ends)
    if force.get("point") is not None:
        names.check_point(f"{path}.point", force["point"], ground=kind != "force")
    if frame not in (None, "body"):
        names.check(f"{path}.frame", frame, "link")
    if kind == "axis_spring_damper":
        names.check_different_links(f"{path}.origin", [force.get("point"), force.get("origin", "ground.")])
    if kind == "coulomb_friction" and joint in names.joints:
        joint_type = table(names.joints, joint).get("type")
        if joint_type == "revolute" and "radius" not in force:
            names.fault(f"{path}.radius", f"required: joint {joint!r} is revolute")
        if joint_type == "prismatic" and "radius" in force:
            names.fault(f"{path}.radius", f"joint {joint!r} is prismatic and has none")


def _check_times(names: Names, path: str, rows: list[Any]) -> None:
    """Check that the times in the rows of a table of values over time increase."""
    times = [row[0] for row in rows if row and row[0] is not None]
    if any(b <= a for a, b in pairwise(times)):
        names.fault(path, "times must increase")


def _check_sketch(names: Names, path: str, name: str) -> None:
    """Check that `name`, a key of the sketch, is an existing joint or point "link.point"."""
    names.check(path, name, "point" if "." in name else "joint")


def _check_driver(names: Names, path: str, driver: dict[str, Any]) -> None:
    """Check that a driver has a travel if its law needs one."""
    if driver.get("law") in ("sine", "cosine", "poly345") and not {"travel", "travel_deg"} & driver.keys():
        names.fault(f"{path}.{'travel_deg' if 'link' in driver else 'travel'}", "required")


def _check_scenario(names: Names, path: str, scenario: dict[str, Any]) -> None:
    """Check that a scenario names no force twice."""
    active = sequence(scenario, "forces")
    for i, force in enumerate(active):
        if force in names.forces and force in active[:i]:
            names.fault(f"{path}.forces[{i}]", f"{force!r} appears twice")


def _check_angles(names: Names, path: str, owner: dict[str, Any]) -> None:
    """Check that no link's angle is given both in radians and in degrees."""
    for link in table(owner, "angles").keys() & table(owner, "angles_deg").keys():
        names.fault(f"{path}.angles.{link}", "given together with angles_deg")


def _check_start(names: Names, path: str, start: dict[str, Any]) -> None:
    """Check that the start holds the crank's angle only once, and gives rates only of coordinates that it holds."""
    crank = names.document.get("crank") or ""
    angles = {*table(start, "angles"), *table(start, "angles_deg")}  # links whose angles are prescribed
    holds_crank = bool({"crank", "crank_deg"} & start.keys())
    if (holds_crank or "speed" in start) and "crank" not in names.document:
        names.fault(path, "needs a crank, and the file names none")
    if holds_crank and crank in angles:
        names.fault(f"{path}.angles.{crank}", "the crank is held twice")
    _check_angles(names, path, start)
    if holds_crank:
        angles.add(crank)
    held = {"speeds": angles, "slide_speeds": table(start, "slides"), "point_velocities": table(start, "points")}
    unheld = ["speed"] if "speed" in start and crank not in angles else []  # paths of rates whose coordinate is not held
    for rates, coordinates in held.items():
        unheld += [f"{rates}.{key}" for key in table(start, rates) if key not in coordinates]
    for place in unheld:
        names.fault(f"{path}.{place}", "a rate without its held coordinate")


CHECKS: dict[str, Callable[[Names, str, Any], None]] = {  # pattern -> the check of the values that it matches
    "ground.points": _check_points,
    "links.*.points": _check_points,
    "links.*": _check_link,
    "welds": _check_welds,
    "joints.*": _check_joint,
    "crank": Names.check_turns_on_ground,
    "forces.*": _check_force,
    "forces.*.over_time.rows": _check_times,
    "assembly": _check_angles,
    "assembly.sketch.~": _check_sketch,
    "scenarios.*": _check_scenario,
    "scenarios.*.start": _check_start,
    **dict.fromkeys(GRAMMAR["tables"]["driver"], _check_driver),
    **{f"{driver}.rows": _check_times for driver in GRAMMAR["tables"]["driver"]},
    **{f"{driver}.link": Names.check_turns_on_ground for driver in GRAMMAR["tables"]["driver"]},
}
