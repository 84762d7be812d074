"""Drawing: pins, bars, larger links, slides; joining, grounding, moving them, and their lengths and angles as numbers."""

import math
from typing import Any

import numpy as np

from gauss_bench.linkage.closure import CLOSED, gauss_newton, joint_residual
from gauss_bench.linkage.references import items, sequence, table
from gauss_bench.studio.edits.drawing import BLOCK, DIGITS, KG_PER_M, SAME, Drawing, Pin, owner, pair, round_digits
from gauss_bench.studio.errors import Refused
from gauss_bench.studio.messages import Message, number, place
from gauss_bench.terms import Array


def add_pin(d: Drawing, message: Message) -> None:
    d.pin({"at": message.get("at"), "ground": message.get("ground", False)})


def add_bar(d: Drawing, message: Message) -> None:
    a, b = d.pin(message.get("from")), d.pin(message.get("to"))
    _connect(d, [a, b], "bar")


def add_link(d: Drawing, message: Message) -> None:
    given = message.get("points")
    if not isinstance(given, list) or not 3 <= len(given) <= 20:
        raise Refused("a link has three points or more, at most 20", field="points")
    _connect(d, [d.pin(x) for x in given], "plate")


def _connect(d: Drawing, pins: list[Pin], word: str) -> None:
    """A new rigid link through pins."""
    for k, a in enumerate(pins):
        for b in pins[:k]:
            if a.id == b.id or math.dist(a.at, b.at) < 1e-6:
                raise Refused("a bar between two pins at one place has no length", (f"pins.{a.id}",))
            both = [x for x in map(owner, a.members) if x in map(owner, b.members)]
            if both:
                fixed = "fixed to the ground" if both[0] == "ground" else f"on {both[0]}"
                where = (f"pins.{a.id}", f"pins.{b.id}")
                raise Refused(f"pins {b.id} and {a.id} are both {fixed} already: no bar is needed between them", where)
    theta = math.atan2(pins[1].at[1] - pins[0].at[1], pins[1].at[0] - pins[0].at[0])
    name = d.fresh(word, "links")
    d.add_link(name, pins[0].at, theta, {"bars": [], "kg_per_m": KG_PER_M})
    ends = []
    for pin in pins:
        held = d.attach(pin, name)
        ends.append(next(x for x in reversed(held.members) if owner(x) == name).partition(".")[2])
    around = [[a, b] for a, b in zip(ends, [*ends[1:], ends[0]], strict=True)]
    d.link(name)["bars"] = around if len(ends) > 2 else around[:1]


def add_point(d: Drawing, message: Message) -> None:
    link, at = message.get("link"), place(message.get("at"))
    if link == "ground":
        d.pin({"at": message.get("at"), "ground": True})
        return
    table_of = d.link(link)
    name = d.letter(str(link))
    table_of["points"][name] = pair(d.local(str(link), at))
    d.made.append(f"pins.{link}.{name}")
    if message.get("observe"):
        _observe(d).append(f"{link}.{name}")


def _observe(d: Drawing) -> list[Any]:
    observe = d.group("observe")
    points = observe.get("points")
    if not isinstance(points, list):
        observe["points"] = points = []
    return points


def observe(d: Drawing, message: Message) -> None:
    point, on = d.on_link(str(message.get("point"))), bool(message.get("on", True))
    listed = _observe(d)
    if on and point not in listed:
        listed.append(point)
    if not on:
        d.group("observe")["points"] = [x for x in listed if x != point]


def add_slide(d: Drawing, message: Message) -> None:
    guide = message.get("guide", "ground")
    pin = d.pin(message["pin"] if "pin" in message else {"at": message.get("at")})
    if guide != "ground":
        d.link(guide)
    if guide in map(owner, pin.members):
        fixed = "the ground" if guide == "ground" else guide
        raise Refused(f"pin {pin.id} is on {fixed} itself, and cannot slide along it", (f"pins.{pin.id}",))
    through = place(message["through"], "through") if "through" in message else None
    angle = _direction(d, message, guide, pin, through)
    point = _guide_point(d, guide, through, pin)
    offset = float(np.array([-math.sin(angle), math.cos(angle)]) @ (np.array(pin.at) - d.place(f"{guide}.{point}")))
    block, name = d.fresh("block", "links"), d.fresh("slide", "joints", "cylinders")
    d.add_link(block, pin.at, angle, {**BLOCK})
    held = d.attach(pin, block)
    turn = 0.0 if guide == "ground" else float(d.poses[guide][2])
    degrees = round_digits(math.degrees(math.remainder(angle - turn, 2 * math.pi)), DIGITS)
    at = next(x for x in held.members if owner(x) == block)
    d.group("joints")[name] = {"type": "prismatic", "guide": f"{guide}.{point}", "angle_deg": degrees, "block": at}
    if abs(offset) > SAME:
        d.group("joints")[name]["offset"] = round_digits(offset, DIGITS)
    d.made.insert(0, f"slides.{name}")


def _direction(d: Drawing, message: Message, guide: str, pin: Pin, through: tuple[float, float] | None) -> float:
    """The direction [rad] in the world of a new slide: as given, else from a place to the pin, else along the guide's first bar."""
    if "angle_deg" in message:
        return math.radians(number(message, "angle_deg"))
    if through is not None and math.dist(through, pin.at) > SAME:
        return math.atan2(pin.at[1] - through[1], pin.at[0] - through[0])
    bars = [] if guide == "ground" else sequence(d.link(guide), "bars")
    if bars:
        a, b = (d.place(f"{guide}.{x}") for x in bars[0])
        return math.atan2(b[1] - a[1], b[0] - a[0])
    return 0.0 if guide == "ground" else float(d.poses[guide][2])


def _guide_point(d: Drawing, guide: str, through: tuple[float, float] | None, pin: Pin) -> str:
    """The point of the guide that its line runs through, made where there is none."""
    points = d.points(guide)
    if through is None and guide != "ground":
        bars = sequence(d.link(guide), "bars")
        return str(bars[0][0]) if bars else next(iter(points))
    at = through or pin.at
    local = d.local(guide, at)
    known = next((k for k, x in points.items() if np.abs(x - local).max() < SAME), None)
    if known is not None:
        return known
    name = d.number() if guide == "ground" else d.letter(guide)
    (d.sub("ground", "points") if guide == "ground" else d.link(guide)["points"])[name] = pair(local)
    return name


def join(d: Drawing, message: Message) -> None:
    a, b = d.pin(message.get("pin")), d.pin(message.get("to"))
    if a.id == b.id:
        raise Refused("a pin is joined to another", (f"pins.{a.id}",))
    shared = {*map(owner, a.members)} & {*map(owner, b.members)}
    if shared:
        what = "fixed to the ground" if "ground" in shared else f"on {min(shared)}"
        raise Refused(f"pins {a.id} and {b.id} are both {what}: they cannot be one", (f"pins.{a.id}", f"pins.{b.id}"))
    if any(owner(x) == "ground" for x in a.members):
        a, b = b, a
    _shift(d, a, b.at)
    joint = d.joint_of(a)
    if joint is not None:
        del d.group("joints")[joint]
    if not a.members:
        table(table(d.document, "assembly"), "sketch").pop(a.id, None)
    d.pins.pop(a.id)
    if not b.members:  # nothing was held there: what is joined to it takes its place
        table(table(d.document, "assembly"), "sketch").pop(b.id, None)
        if joint is not None:
            d.group("joints")[joint] = {"type": "revolute", "at": [*a.members]}
        return
    held = b
    for reference in a.members:
        if owner(reference) in d.group("links") or owner(reference) == "ground":
            held = d.hold(held, reference)
    if joint is not None and (kept := d.joint_of(held)) is not None:
        replace_joint(d, joint, kept)
    d.made.append(f"pins.{held.id}")


def replace_joint(d: Drawing, old: str, new: str) -> None:
    """Let everything that acted in one joint act in another."""
    for _, force in items(d.document, "forces"):
        if force.get("joint") == old:
            force["joint"] = new


def ground(d: Drawing, message: Message) -> None:
    pin, on = d.pin(message.get("pin")), bool(message.get("on", True))
    fixed = [x for x in pin.members if owner(x) == "ground"]
    if on == bool(fixed):
        return
    points = d.sub("ground", "points")
    if on:
        wished = d.joint_of(pin) or (pin.members[0].partition(".")[2] if pin.members else pin.id)
        table(table(d.document, "assembly"), "sketch").pop(pin.id, None)
        name = wished if wished not in points else d.number()
        points[name] = pair(pin.at)
        if pin.members:
            held = d.hold(pin, f"ground.{name}")
            joint = d.group("joints").get(held.id, {})
            if "at" in joint:  # the ground first, as in the linkages of the suite
                joint["at"] = [f"ground.{name}", *(x for x in joint["at"] if x != f"ground.{name}")]
        return
    joint_name = d.joint_of(pin)
    for reference in fixed:
        name = reference.partition(".")[2]
        used = [x for _, j in items(d.document, "joints") for x in (j.get("guide"), j.get("block")) if x == reference]
        if not used:
            del points[name]
        if joint_name is None:
            d.sub("assembly", "sketch")[name if name not in d.group("joints") else d.number()] = pair(pin.at)
    if joint_name is not None:
        left = [x for x in d.group("joints")[joint_name]["at"] if owner(x) != "ground"]
        d.group("joints")[joint_name]["at"] = left
        if len(left) < 2:
            del d.group("joints")[joint_name]


def move(d: Drawing, message: Message) -> None:
    _shift(d, d.pin(message.get("pin")), place(message.get("at")))


def _shift(d: Drawing, pin: Pin, at: tuple[float, float]) -> None:
    """Put a pin elsewhere: the links that it is on get other lengths; a guide on the ground that it slides along comes along."""
    if not pin.members:
        d.sub("assembly", "sketch")[pin.id] = pair(at)
    joints = d.group("joints")
    for _, joint in items(d.document, "joints"):
        guide = str(joint.get("guide"))
        if joint.get("block") in pin.members and owner(guide) == "ground":
            used = sum(str(x).count(f"'{guide}'") for x in joints.values())
            if used == 1:
                d.set_point(guide, d.place(guide) + np.array(at) - np.array(pin.at))
    for reference in pin.members:
        link = owner(reference)
        if link != "ground" and link not in d.group("links"):
            continue  # of a cylinder, which follows
        if link != "ground" and len(d.points(link)) == 1:  # a block goes where its pin goes
            d.poses[link][:2] += np.array(at) - np.array(pin.at)
            continue
        framed = link != "ground" and d.framed(link)
        d.set_point(reference, at)
        if link != "ground":
            for a, b in sequence(d.link(link), "bars"):
                if math.dist(d.place(f"{link}.{a}"), d.place(f"{link}.{b}")) < 1e-6:
                    raise Refused(f"{link} would have no length", (f"links.{link}",))
        if framed:
            d.reframe(link)


def set_length(d: Drawing, message: Message) -> None:
    name, length = str(message.get("link")), number(message, "value")
    points = d.points(name)
    a, b = str(message.get("a")), str(message.get("b"))
    if a not in points or b not in points or a == b:
        raise Refused(f"{name} has no length {a[:40]}-{b[:40]}", (f"links.{name}",), "a")
    if not 1e-6 <= length <= 1e5:
        raise Refused("a length is between 1e-6 and 1e5 m", (f"links.{name}",), "value")
    along, framed = points[b] - points[a], d.framed(name)
    if math.hypot(*along) < SAME:
        raise Refused(f"{a} and {b} lie at one place of {name}", (f"links.{name}",))
    d.set_point(f"{name}.{b}", d.world(name, points[a] + along * (length / math.hypot(*along))))
    if framed:
        d.reframe(name)


def set_angle(d: Drawing, message: Message) -> None:
    name, degrees = str(message.get("link")), number(message, "value_deg")
    d.link(name)
    reading = d.reading
    if reading.mechanism is None or reading.joints is None or not reading.closed:
        raise Refused("a link is turned once the drawing assembles", (f"links.{name}",))
    body, turn = reading.mechanism.placed(name)
    q, close = reading.q, joint_residual(reading.joints)
    goal = math.radians(degrees) - float(turn)
    first = float(q[3 * body + 2])
    way = math.remainder(goal - first, 2 * math.pi)
    row = np.zeros((1, len(q)))
    row[0, 3 * body + 2] = 1.0
    steps = max(1, math.ceil(abs(way) / math.radians(5.0)))
    for k in range(1, steps + 1):

        def residual(x: Array, held: float = first + way * k / steps) -> tuple[Array, Array]:
            F, J = close(x)
            return np.append(F, x[3 * body + 2] - held), np.vstack([J, row])

        q, error = gauss_newton(q, residual)
        if error > CLOSED:
            raise Refused(f"{name} cannot stand at {degrees:g} degrees: the linkage does not reach that", (f"links.{name}",))
    d.poses = {key: np.array(x) for key, x in reading.poses(q).items()}


GEOMETRY = {
    "add_pin": add_pin,
    "add_bar": add_bar,
    "add_link": add_link,
    "add_point": add_point,
    "add_slide": add_slide,
    "join": join,
    "ground": ground,
    "move": move,
    "set_length": set_length,
    "set_angle": set_angle,
    "observe": observe,
}
