"""The tables of a file by their keys: setting, renaming, deleting, forces and locks."""

import copy
import math
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gauss_bench.linkage.references import items, sequence, table
from gauss_bench.linkage.schema import FORCES, FORMAT, SECOND
from gauss_bench.studio.document import GROUPS, Document
from gauss_bench.studio.edits.drawing import KG_PER_M, NAME, Drawing, owner, pair, round_digits
from gauss_bench.studio.edits.scenarios import RELEASED
from gauss_bench.studio.errors import Refused
from gauss_bench.studio.messages import Message
from gauss_bench.studio.reading import leave_out, lone_pins, new_faults

EITHER = (("mass", "kg_per_m"), ("angle", "angle_deg"), ("rest", "rest_deg"), ("start", "start_deg"), ("travel", "travel_deg"))
USUAL: dict[str, dict[str, Any]] = {  # numbers of a force that is drawn without any
    "torque": {"value": 1.0},
    "force": {"value": [0.0, -10.0]},
    "spring_damper": {"k": 100.0, "c": 0.0},
    "axis_spring_damper": {"k": 100.0},
    "rotational_spring_damper": {"k": 1.0},
    "joint_damping": {"c": 0.05},
    "coulomb_friction": {"mu": 0.1, "speed": 0.01},
}
LINKS = ("crank", "link", "reaction", "frame", "to", "links", "hold", "angles", "angles_deg", "speeds")  # keys that name links
JOINTS = ("joint", "joints", "hold", "slides", "slide_speeds", "sketch")


def set_key(d: Drawing, message: Message) -> None:
    """Set the key that a path names, or delete it where the value is null."""
    path, given = message.get("path"), message.get("value")
    if not isinstance(path, str) or not re.fullmatch(r"[A-Za-z0-9_]+(\.[A-Za-z0-9_]+|\[\d{1,4}\])*", path):
        raise Refused("a path is keys with dots between them", field="path")
    keys = [int(x[1:-1]) if x[0] == "[" else x for x in re.findall(r"\[\d+\]|[^.\[\]]+", path)]
    if keys[0] in ("format", "scenarios") and len(keys) == 1:
        raise Refused(f"{path} cannot be set", field=path)
    before = copy.deepcopy(d.document)
    at: Any = d.document
    for key in keys[:-1]:
        if isinstance(at, list):
            at = at[key] if isinstance(key, int) and key < len(at) else None
        elif isinstance(at, dict):
            at = at.setdefault(key, {})
        if not isinstance(at, (dict, list)):
            raise Refused(f"there is no {path}", field=path)
    last = keys[-1]
    if isinstance(at, list):
        if not isinstance(last, int) or last >= len(at):
            raise Refused(f"there is no {path}", field=path)
        at[last] = given
    elif given is None:
        at.pop(last, None)
    else:
        at[last] = given
        for a, b in EITHER:
            if last in (a, b) and a in at and b in at:
                del at[b if last == a else a]
    if faults := new_faults(before, d.document):
        raise Refused("; ".join(str(x) for x in faults[:3]), (), faults[0].path)


def rename(d: Drawing, message: Message) -> None:
    id, to = str(message.get("what", message.get("id"))), str(message.get("to"))  # pages of before called it id, as the message is
    group, _, name = id.partition(".")
    if not NAME.fullmatch(to) or len(to) > 60:
        raise Refused("a name has letters, digits and underscores", (id,), "to")
    if id == "name":
        d.document["name"] = to
        return
    if group == "pins":
        _rename_pin(d, name, to)
        return
    at = {"slides": "joints"}.get(group, group)
    if at not in GROUPS or name not in d.group(at):
        raise Refused(f"there is no {id[:60]}", (id,), "id")
    if to == name:
        return
    taken = {"links": (*d.group("links"), "ground"), "joints": (*d.group("joints"), *d.group("cylinders"))}.get(at, (*d.group(at),))
    if to in taken:
        raise Refused(f"{to} is taken already", (id,), "to")
    if at == "forces" and name in d.group("cylinders"):
        at = "cylinders"
    _rename_in(d.document, at, name, to)
    if at == "links":
        d.poses[to] = d.poses.pop(name, np.zeros(3))


def _rename_in(document: Document, group: str, old: str, new: str) -> None:
    """Rename an entry of a group and all that refers to it, in its place."""
    document[group] = {new if k == old else k: x for k, x in document[group].items()}
    words = {"links": LINKS, "joints": JOINTS, "cylinders": JOINTS, "forces": ("forces",)}.get(group, ())

    def renamed(x: Any, key: str) -> Any:
        if isinstance(x, dict):
            return {_name(k, key): renamed(y, k if isinstance(k, str) else key) for k, y in x.items()}
        if isinstance(x, list):
            return [renamed(y, key) for y in x]
        return _name(x, key) if isinstance(x, str) and key not in ("title", "name", "format", "type", "law") else x

    def _name(x: Any, key: str) -> Any:
        if key in words and x == old:
            return new
        if group == "links" and isinstance(x, str) and x.startswith(f"{old}."):
            return f"{new}.{x.partition('.')[2]}"
        return x

    for key, x in [*document.items()]:
        if not (key == group and group in ("links", "forces", "joints")):
            document[key] = renamed(x, key)
        else:
            document[key] = {k: renamed(y, "") for k, y in x.items()}


def _rename_pin(d: Drawing, name: str, to: str) -> None:
    """A pin's joint gets the name, and its points where theirs was the same and the new one is free."""
    pin = d.pin(name)
    joint = d.joint_of(pin)
    where = (f"pins.{name}",)
    if to in {*d.group("joints"), *d.group("cylinders"), *lone_pins(d.document)} - {joint}:
        raise Refused(f"{to} is taken already", where, "to")
    if not pin.members:
        sketch = d.sub("assembly", "sketch")
        sketch[to] = sketch.pop(name)
        return
    old = joint or pin.members[0].partition(".")[2]
    for reference in pin.members:
        link, _, point = reference.partition(".")
        if link == "ground" or link in d.group("links"):
            if point == old and to not in d.points(link):
                _rename_point(d.document, link, point, to)
            elif joint is None and point == old:
                raise Refused(f"{link} has a point {to} already", where, "to")
    if joint is not None and joint != to:
        _rename_in(d.document, "joints", joint, to)


def _rename_point(document: Document, link: str, old: str, new: str) -> None:
    given = document["ground"] if link == "ground" else document["links"][link]
    given["points"] = {new if k == old else k: x for k, x in given["points"].items()}
    for value_of in given["points"].values():
        if isinstance(value_of, dict) and value_of.get("from") == old:
            value_of["from"] = new
    if "bars" in given:
        given["bars"] = [[new if x == old else x for x in bar] for bar in given["bars"]]
    for mass in given.get("point_masses", []):
        mass["point"] = new if mass.get("point") == old else mass.get("point")

    def renamed(x: Any) -> Any:
        if isinstance(x, dict):
            return {renamed(k): renamed(y) for k, y in x.items()}
        if isinstance(x, list):
            return [renamed(y) for y in x]
        return f"{link}.{new}" if x == f"{link}.{old}" else x

    for key, x in [*document.items()]:
        document[key] = renamed(x)


def delete(d: Drawing, message: Message) -> None:
    """Delete what ids name, and what cannot be without it."""
    ids = message.get("ids")
    if not isinstance(ids, list) or not all(isinstance(x, str) for x in ids):
        raise Refused("ids is a list of what to delete", field="ids")
    before = copy.deepcopy(d.document)
    for id in ids[:1000]:
        group, _, name = id.partition(".")
        match group:
            case "pins" if name in d.pins:
                _delete_pin(d, name)
            case "slides" if name in d.group("joints"):
                block = owner(str(d.group("joints").pop(name).get("block")))
                if len(table(table(d.document, "links").get(block, {}), "points")) == 1:
                    del d.group("links")[block]
            case "slides" | "forces" if name in d.group("cylinders"):
                del d.group("cylinders")[name]
            case "links" | "forces" | "scenarios" | "welds" | "cylinders" | "constraints" if name in d.group(group):
                del d.group(group)[name]
                ends = (f"{name}_barrel", f"{name}_rod")
                d.poses = {k: x for k, x in d.poses.items() if k not in (*ends, *([name] if group == "links" else []))}
            case _:
                continue  # it went with something else
    prune(d, before)


def _delete_pin(d: Drawing, name: str) -> None:
    """Take a pin's points from all that is on it; bars that are left with one end go too."""
    pin = d.pins[name]
    if not pin.members:
        d.sub("assembly", "sketch").pop(name, None)
    for reference in pin.members:
        link, _, point = reference.partition(".")
        if link == "ground":
            d.sub("ground", "points").pop(point, None)
        elif link in d.group("links"):
            given = d.link(link)
            if len(given["points"]) <= 2:
                del d.group("links")[link]
                d.poses.pop(link, None)
                continue
            given["points"] = {k: pair(x) for k, x in d.points(link).items() if k != point}
            kept = [bar for bar in sequence(given, "bars") if point not in bar]
            ends = [bar for bar in sequence(given, "bars") if point in bar]
            if len(ends) == 2:  # of a polygon: its neighbours are joined
                a, b = (next(x for x in bar if x != point) for bar in ends)
                kept += [[a, b]] if a != b and not any({a, b} == {*bar} for bar in kept) else []
            if "bars" in given:
                given["bars"] = kept or [[*given["points"]][:2]]


def prune(d: Drawing, before: Document) -> None:
    """Leave out what refers to what is no more."""
    for _ in range(1000):
        faults = [x for x in new_faults(before, d.document) if x.path not in ("links", "scenarios")]
        if not faults:
            break
        leave_out(d.document, faults[0])
    for joint in [k for k, x in items(d.document, "joints") if x.get("type") == "revolute" and len(sequence(x, "at")) < 2]:
        del d.group("joints")[joint]
    sketched = table(table(d.document, "assembly"), "sketch")
    for joint in {*table(before, "joints")} - {*table(d.document, "joints")}:
        sketched.pop(joint, None)  # its place is that of no pin any more
    gone = [
        k
        for k, x in items(d.document, "scenarios")
        if "driver" in table(d.reading.document, "scenarios").get(k, {}) and not (x.get("driver") or x.get("drivers"))
    ]
    for name in gone:
        del d.group("scenarios")[name]


def add_force(d: Drawing, message: Message) -> None:
    kind = str(message.get("type"))
    given = {k: x for k, x in message.items() if k not in ("id", "do", "type", "name", "a", "b")}
    if "a" in message or "b" in message:
        ends = d.ends(*(d.pin(x).id if isinstance(x, dict) else x for x in (message.get("a"), message.get("b"))))
        given["between"] = [*ends]
    if kind == "cylinder":
        _add_cylinder(d, message, given)
        return
    kind = {"spring": "spring_damper", "damper": "spring_damper"}.get(kind, kind)
    if kind not in FORCES:
        raise Refused(f"there is no force {kind[:40]!r}; there are {', '.join(FORCES)}, cylinder", field="type")
    for key in ("point", "origin"):
        if isinstance(given.get(key), str):
            given[key] = d.on_link(given[key])
    if isinstance(given.get("joint"), str):
        given["joint"] = d.joint_of(d.pins[given["joint"]]) if given["joint"] in d.pins else given["joint"]
    usual = {"k": 0.0, "c": 10.0} if message.get("type") == "damper" else USUAL[kind]
    if kind == "spring_damper" and "rest" not in given and message.get("type") != "damper" and len(given.get("between", [])) == 2:
        a, b = (d.place(x) for x in given["between"])
        usual = usual | {"rest": round_digits(math.dist(a, b))}
    if kind == "coulomb_friction" and table(table(d.document, "joints"), str(given.get("joint"))).get("type") == "revolute":
        usual = usual | {"radius": 0.01}
    name = message.get("name")
    if not (isinstance(name, str) and NAME.fullmatch(name) and name not in d.group("forces")):
        word = {"damper": "damper", "spring_damper": "spring"}.get(str(message.get("type")), kind.partition("_")[0])
        name = d.fresh(word, "forces")
    before = copy.deepcopy(d.document)
    d.group("forces")[name] = {"type": kind} | usual | given
    if faults := new_faults(before, d.document):
        raise Refused("; ".join(str(x) for x in faults[:3]), (), faults[0].path.rpartition(".")[2])
    d.made.append(f"forces.{name}")
    for key, scenario in items(d.document, "scenarios"):
        if key == RELEASED or (RELEASED not in d.group("scenarios") and not {"driver", "drivers"} & scenario.keys()):
            scenario["forces"] = [*sequence(scenario, "forces"), name]
            break


def _add_cylinder(d: Drawing, message: Message, given: dict[str, Any]) -> None:
    if len(sequence(given, "between")) != 2:
        raise Refused("a cylinder lies between two points", field="a")
    apart = math.dist(*(d.place(str(x)) for x in given["between"]))
    part = {"length": round_digits(max(0.6 * apart, 1e-3)), "kg_per_m": KG_PER_M}
    name = d.fresh("cylinder", "cylinders", "joints")
    before = copy.deepcopy(d.document)
    _second_edition(d)
    d.group("cylinders")[name] = {"between": given["between"], "barrel": dict(part), "rod": dict(part)}
    if faults := new_faults(before, d.document):
        raise Refused("; ".join(str(x) for x in faults[:3]), (), faults[0].path)
    d.made.append(f"forces.{name}")


def _second_edition(d: Drawing) -> None:
    """The edition of the grammar that has cylinders; the damping of a pin through three links means something else there."""
    if d.document.get("format") == FORMAT:
        joints = table(d.document, "joints")
        for name, force in items(d.document, "forces"):
            if force.get("type") == "joint_damping" and len(sequence(joints.get(str(force.get("joint")), {}), "at")) > 2:
                said = f"a file of the first edition has no cylinders, and in the second {name} would damp otherwise"
                raise Refused(said, (f"forces.{name}",))
    d.document["format"] = SECOND


def lock_of(d: Drawing, message: Message) -> str:
    """The id of what is to be locked."""
    if "pin" in message:
        return f"pins.{d.pin(message.get('pin')).id}"
    if "joint" in message:
        joint = d.joint_of(d.pin(message["joint"]))
        if joint is None:
            raise Refused("nothing turns here: an angle is between links that a pin joins", field="joint")
        return f"joints.{joint}"
    if "slide" in message:
        return f"slides.{message['slide']}"
    length = message.get("length", message if "a" in message else None)
    if isinstance(length, Mapping):
        a, b = str(length.get("a")), str(length.get("b"))
        points = d.points(str(length.get("link")))
        if a in points and b in points:
            return f"links.{length['link']}:{a}-{b}"
        raise Refused("there is no such length", field="length")
    d.link(message.get("link"))
    return f"links.{message['link']}"


KEYS: dict[str, Callable[[Drawing, Message], None]] = {
    "set": set_key,
    "rename": rename,
    "delete": delete,
    "add_force": add_force,
}
