"""Edit tables by their keys: set, rename and delete entries; add forces; find the part that a message locks."""

import re
from collections.abc import Callable
from typing import Any

from gauss_bench.exchange.toml import GROUPS
from gauss_bench.linkage.references import items, sequence, table
from gauss_bench.linkage.schema import FORCES, FORMAT, SECOND
from gauss_bench.studio import scene
from gauss_bench.studio.document import Document, is_driven
from gauss_bench.studio.edits.drawing import KG_PER_M, NAME, Drawing, owner, pair, round_digits, tail
from gauss_bench.studio.edits.scenarios import RELEASED
from gauss_bench.studio.messages import Message, Refused
from gauss_bench.studio.reading import leave_out, lone_pins, new_faults

# pairs of keys that exclude each other
EITHER = (("mass", "kg_per_m"), ("angle", "angle_deg"), ("rest", "rest_deg"), ("start", "start_deg"), ("travel", "travel_deg"))
USUAL: dict[str, dict[str, Any]] = scene.FORCES["usual"]  # name of a force in the menu -> its type and its default numbers
# group of entries -> keys of a file whose value (a text, or the keys of a table) names an entry of this group
NAMING_KEYS = {
    "links": ("crank", "link", "reaction", "frame", "to", "links", "hold", "angles", "angles_deg", "speeds"),
    "joints": ("joint", "joints", "hold", "slides", "slide_speeds", "sketch"),
    "cylinders": ("joint", "joints", "hold", "slides", "slide_speeds", "sketch"),
}
TEXTS = ("title", "name", "format", "type", "law")  # keys of texts that name no entry


def set_key(d: Drawing, message: Message) -> None:
    """Set the key at a path and remove the key that it excludes; delete the key if the value is null."""
    path, value = message.get("path"), message.get("value")
    if not isinstance(path, str) or not re.fullmatch(r"[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*", path):
        raise Refused("a path consists of keys separated by dots", field="path")
    if path in ("format", "scenarios"):
        raise Refused(f"{path} cannot be set", field=path)
    *keys, last = path.split(".")
    entries: Any = d.document  # the table that has the key
    for key in keys:
        entries = entries.setdefault(key, {}) if isinstance(entries, dict) else None
    if not isinstance(entries, dict):
        raise Refused(f"the file has no {path}", field=path)
    if value is None:
        entries.pop(last, None)
    else:
        entries[last] = value
        for a, b in EITHER:
            if last in (a, b) and a in entries and b in entries:
                del entries[b if last == a else a]
    d.check()


def rewrite(x: Any, change: Callable[[str, str], str], key: str = "") -> Any:
    """Return a copy of a parsed file, or of a value x in it, with `change(text, key)` in place of every text and every key.

    Texts at the keys TEXTS stay, because they name no entry.

    Args:
        change: function (text, key) -> new text, where `key` is the key whose value is the text, or a list or table with the text.
        key: key whose value is x; empty for the whole file, and for entries of groups, such as `links.A`, whose key is a name.
    """
    if isinstance(x, dict):
        has_entries = key in GROUPS  # x is a table of named entries, such as `links`
        return {change(k, key): rewrite(y, change, "" if has_entries else k) for k, y in x.items()}
    if isinstance(x, list):
        return [rewrite(y, change, key) for y in x]
    return change(x, key) if isinstance(x, str) and key not in TEXTS else x


def rename(d: Drawing, message: Message) -> None:
    """Rename the part with the id `what`, and all references to it.

    Ids are those of the page: a slide is a joint of the file, and a cylinder has the id of a force.
    """
    id, to = str(message.get("what")), str(message.get("to"))
    group, name = owner(id), tail(id)
    if not NAME.fullmatch(to) or len(to) > 60:
        raise Refused("a name has letters, digits and underscores", (id,), "to")
    if group == "pins":
        _rename_pin(d, name, to)
        return
    if group == "slides":
        group = "joints"
    elif group == "forces" and name in d.group("cylinders"):
        group = "cylinders"
    if group not in GROUPS or name not in d.group(group):
        raise Refused(f"there is no part {id[:60]}", (id,), "what")
    taken = {*d.group(group)}
    if group == "links":
        taken.add("ground")
    elif group in ("joints", "cylinders"):  # a driver names either by its key `joint`
        taken = {*d.group("joints"), *d.group("cylinders")}
    if to != name and to in taken:
        raise Refused(f"{to} is taken already", (id,), "to")
    _rename_in(d.document, group, name, to)
    if group == "links":
        d.poses = {to if k == name else k: x for k, x in d.poses.items()}


def _rename_in(document: Document, group: str, old: str, new: str) -> None:
    """Rename an entry of a group of the file, such as a link in `links`, and all references to it."""
    keys = (group, *NAMING_KEYS.get(group, ()))

    def change(x: str, key: str) -> str:
        """Return the new text for x, the value of `key` or a key in the table `key`: see `rewrite`."""
        if key in keys and x == old:
            return new
        # a reference to a point, "LINK.POINT", begins with the name of its link
        return f"{new}.{tail(x)}" if group == "links" and x.startswith(f"{old}.") else x

    document.update(rewrite(document, change))


def _rename_pin(d: Drawing, name: str, to: str) -> None:
    """Rename the pin with the id `name`: its joint, and the points at the pin that have the joint's name.

    If a link has a point `to` already, the link's point at the pin keeps its name; for a pin without a joint this is refused. After
    a refusal the caller discards all changes.
    """
    pin = d.pin(name)
    joint, where = d.joint_of(pin), (f"pins.{name}",)
    if to in {*d.group("joints"), *d.group("cylinders"), *lone_pins(d.document)} - {joint}:
        raise Refused(f"{to} is taken already", where, "to")
    if not pin.members:
        sketch = d.group("assembly", "sketch")
        sketch[to] = sketch.pop(name)
        return
    old = joint or tail(pin.members[0])
    for reference in pin.members:
        link, point = owner(reference), tail(reference)
        if d.is_written(link) and point == old:  # a part of a cylinder has no table in the file
            if to not in d.points(link):
                _rename_point(d, link, point, to)
            elif joint is None:
                raise Refused(f"{link} has a point {to} already", where, "to")
    if joint is not None and joint != to:
        _rename_in(d.document, "joints", joint, to)


def _rename_point(d: Drawing, link: str, old: str, new: str) -> None:
    """Rename a point of a link or of the ground, in the table of its owner and in all references."""
    entries = d.group("ground") if link == "ground" else d.link(link)
    keys = ("points", "bars", "point", "from")  # keys of this table whose values name a point without its owner
    entries.update(rewrite(entries, lambda x, key: new if x == old and key in keys else x))
    d.document.update(rewrite(d.document, lambda x, key: f"{link}.{new}" if x == f"{link}.{old}" else x))


def delete(d: Drawing, message: Message) -> None:
    """Delete the parts with the ids `ids`, and all entries that refer to them."""
    ids = message.get("ids")
    if not isinstance(ids, list) or not all(isinstance(x, str) for x in ids):
        raise Refused("ids is a list of the ids of parts", field="ids")
    for id in ids[:1000]:
        group, name = owner(id), tail(id)
        if group in ("slides", "forces") and name in d.group("cylinders"):  # the page shows a cylinder as a slide and as a force
            group = "cylinders"
        if group == "pins" and name in d.pins:
            _delete_pin(d, name)
        elif group == "slides" and name in d.group("joints"):
            block = owner(str(d.group("joints").pop(name).get("block")))
            if len(table(table(d.document, "links").get(block, {}), "points")) == 1:  # a block with this one point is deleted too
                del d.group("links")[block]
        elif group in GROUPS and group != "joints" and name in d.group(group):  # missing if deleted with another part
            del d.group(group)[name]
            removed_links = {"links": {name}, "cylinders": {f"{name}_barrel", f"{name}_rod"}}.get(group, set())
            d.poses = {link: pose for link, pose in d.poses.items() if link not in removed_links}
    prune(d)


def _delete_pin(d: Drawing, name: str) -> None:
    """Delete a pin's points from all its links, and delete links that would have a single point left."""
    pin = d.pins[name]
    if not pin.members:
        d.remove_from_sketch(pin)
    for reference in pin.members:
        link, point = owner(reference), tail(reference)
        if link == "ground":
            d.written_points("ground").pop(point, None)
        elif link in d.group("links"):
            if len(d.link(link)["points"]) > 2:
                _delete_point(d, link, point)
            else:
                del d.group("links")[link], d.poses[link]


def _delete_point(d: Drawing, link: str, point: str) -> None:
    """Delete a point of a link and the bars that end there; in a polygon of bars, a new bar joins the neighbours of the point."""
    entries = d.link(link)
    entries["points"] = {k: pair(x) for k, x in d.points(link).items() if k != point}
    bars: list[list[str]] = []  # bars that do not end at the point
    neighbours: list[str] = []  # other ends of the bars at the point
    for bar in sequence(entries, "bars"):
        if point in bar:
            neighbours += [x for x in bar if x != point]
        else:
            bars.append(bar)
    if len({*neighbours}) == len(neighbours) == 2 and not any({*neighbours} == {*bar} for bar in bars):
        bars.append(neighbours)
    if "bars" in entries:
        entries["bars"] = bars or [[*entries["points"]][:2]]  # at least one bar: between the first two points


def prune(d: Drawing) -> None:
    """Delete all entries that refer to deleted parts, joints with fewer than two points, and scenarios that lost their drivers."""
    before = d.reading.document  # the file as it was read; d.document already lacks the deleted parts
    # each pass removes one entry with a fault that the file did not have before, which may leave other entries with a missing
    # reference; 1000 only bounds the loop
    for _ in range(1000):
        faults = new_faults(before, d.document)
        if not faults:
            break
        leave_out(d.document, faults[0])
    for joint in [k for k, x in items(d.document, "joints") if x.get("type") == "revolute" and len(sequence(x, "at")) < 2]:
        del d.group("joints")[joint]
    sketched = table(table(d.document, "assembly"), "sketch")
    for joint in {*table(before, "joints")} - {*table(d.document, "joints")}:
        sketched.pop(joint, None)  # otherwise its place would be read as a pin that joins nothing
    for name, scenario in [*items(d.document, "scenarios")]:
        if is_driven(table(before, "scenarios").get(name, {})) and not (scenario.get("driver") or scenario.get("drivers")):
            del d.group("scenarios")[name]


def add_force(d: Drawing, message: Message) -> None:
    """Add a force with its default numbers, and let it act in the scenario "released", or else in the first one without drivers."""
    kind = str(message.get("type"))  # name of a force in the menu
    entries = {k: x for k, x in message.items() if k not in ("id", "do", "type", "name", "a", "b")}  # keys of the new table
    if "a" in message or "b" in message:
        entries["between"] = d.find_ends(message.get("a"), message.get("b"))
    if kind == "cylinder":
        _add_cylinder(d, entries)
        return
    if kind not in USUAL:
        raise Refused(f"there is no force {kind[:40]!r}; there are {', '.join(FORCES)}, cylinder", field="type")
    for key in ("point", "origin"):
        if isinstance(entries.get(key), str):
            entries[key] = d.point_on_link(entries[key])
    name = d.new_name(kind.partition("_")[0], "forces")
    d.group("forces")[name] = USUAL[kind] | entries
    d.check()
    d.made.append(f"forces.{name}")
    for scenario_name, scenario in items(d.document, "scenarios"):
        if scenario_name == RELEASED or (RELEASED not in d.group("scenarios") and not is_driven(scenario)):
            scenario["forces"] = [*sequence(scenario, "forces"), name]
            break


def _add_cylinder(d: Drawing, entries: dict[str, Any]) -> None:
    """Add a cylinder between the two points `entries["between"]`, and change the file to the second edition, which has cylinders.

    The cylinder is refused if the file has a damper that would act differently in the second edition.
    """
    if len(sequence(entries, "between")) != 2:
        raise Refused("a cylinder lies between two points", field="a")
    a, b = (d.place(str(x)) for x in entries["between"])
    # barrel and rod, each 0.6 of the distance of the points, overlap by 0.2 of this distance
    part = {"length": round_digits(max(0.6 * abs(b - a), 1e-3)), "kg_per_m": KG_PER_M}
    name = d.new_name("cylinder", "cylinders", "joints")
    if d.document.get("format") == FORMAT:
        # the second edition damps a pin of three or more links in another way than the first
        for damper, force in items(d.document, "forces"):
            joint = table(d.document, "joints").get(str(force.get("joint")), {})
            if force.get("type") == "joint_damping" and len(sequence(joint, "at")) > 2:
                text = f"cylinders need the second edition of the format, in which the damper {damper} would act differently"
                raise Refused(text, (f"forces.{damper}",))
    d.document["format"] = SECOND
    d.group("cylinders")[name] = {"between": entries["between"], "barrel": dict(part), "rod": dict(part)}
    d.check()
    d.made.append(f"forces.{name}")


def lock_of(d: Drawing, message: Message) -> str:
    """Return the id of the pin, slide, length or angle that a message locks or frees."""
    if "pin" in message:
        return f"pins.{d.pin(message.get('pin')).id}"
    if "joint" in message:
        joint = d.joint_of(d.pin(message["joint"]))
        if joint is None:
            raise Refused("only the angle between links that a pin joins can be locked", field="joint")
        return f"joints.{joint}"
    if "slide" in message:
        return f"slides.{message['slide']}"
    if "a" in message:
        a, b = str(message["a"]), str(message.get("b"))
        if {a, b} <= d.points(str(message.get("link"))).keys():
            return f"links.{message['link']}:{a}-{b}"
        raise Refused("there is no such length", field="a")
    d.link(message.get("link"))
    return f"links.{message['link']}"


KEYS = {"set": set_key, "rename": rename, "delete": delete, "add_force": add_force}
