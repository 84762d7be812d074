"""Edit the geometry: add pins, bars, larger links and slides; join, ground and move pins; set lengths and angles.

Every function with the name of a verb makes the edit of that verb. `../README.md` lists the keys of its message.
"""

import math
from cmath import phase, rect
from collections import Counter
from itertools import combinations

import numpy as np

from gauss_bench.linkage.closure import CLOSED, gauss_newton
from gauss_bench.linkage.references import items, sequence
from gauss_bench.mechanism.coordinates import gradient
from gauss_bench.mechanism.model import GROUND, Angle
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.studio.edits.drawing import BLOCK, DIGITS, KG_PER_M, SAME, Drawing, Pin, owner, pair, round_digits, tail
from gauss_bench.studio.messages import Message, Refused, number, place
from gauss_bench.terms import Array

SHORTEST = 1e-6  # [m] shortest bar
TURN = math.radians(5.0)  # [rad] largest turn of a link before the joints are closed again


def add_pin(d: Drawing, message: Message) -> None:
    """Draw a pin at a place: a pivot on the ground, or a pin that joins nothing yet."""
    d.pin({"at": message.get("at"), "ground": message.get("ground", False)})


def add_bar(d: Drawing, message: Message) -> None:
    """Add a link with one bar between two pins."""
    _connect(d, [d.pin(message.get("from")), d.pin(message.get("to"))], "bar")


def add_link(d: Drawing, message: Message) -> None:
    """Add a rigid link through three or more pins."""
    choices = message.get("points")
    if not isinstance(choices, list) or not 3 <= len(choices) <= 20:
        raise Refused("a link has three points or more, at most 20", field="points")
    _connect(d, [d.pin(x) for x in choices], "plate")


def describe_owner(link: str) -> str:
    """Return "on LINK" or "fixed to the ground", for sentences about a pin on this link."""
    return "fixed to the ground" if link == "ground" else f"on {link}"


def _connect(d: Drawing, pins: list[Pin], word: str) -> None:
    """Add a rigid link that joins the given pins; its name is `word` followed by a number."""
    for a, b in combinations(pins, 2):
        if a.id == b.id or abs(a.at - b.at) < SHORTEST:
            raise Refused("a bar between two pins at one place has no length", (f"pins.{b.id}",))
        shared = [x for x in map(owner, b.members) if x in map(owner, a.members)]
        if shared:
            text = f"pins {a.id} and {b.id} are both {describe_owner(shared[0])} already: no bar is needed between them"
            raise Refused(text, (f"pins.{b.id}", f"pins.{a.id}"))
    name = d.new_name(word, "links")
    d.add_link(name, pins[0].at, phase(pins[1].at - pins[0].at), {"bars": [], "kg_per_m": KG_PER_M})
    ends = [tail(d.attach(pin, name).members[-1]) for pin in pins]  # names of the new points
    polygon = [[a, b] for a, b in zip(ends, [*ends[1:], ends[0]], strict=True)]
    d.link(name)["bars"] = polygon if len(ends) > 2 else polygon[:1]  # two points have one bar, not two sides


def add_point(d: Drawing, message: Message) -> None:
    """Add a point to a link."""
    link, at = message.get("link"), place(message.get("at"))
    d.link(link)
    reference = f"{link}.{d.new_point_name(str(link))}"
    d.set_point(reference, at)
    d.made.append(f"pins.{reference}")
    if message.get("observe"):
        observe(d, {"point": reference})


def observe(d: Drawing, message: Message) -> None:
    """Add a point to the observed points of the file (`observe.points`); with `on` false, remove it from them."""
    point, observed = d.point_on_link(str(message.get("point"))), d.group("observe")
    others = [x for x in sequence(observed, "points") if x != point]
    observed["points"] = [*others, point] if message.get("on", True) else others


def add_slide(d: Drawing, message: Message) -> None:
    """Add a slide along a guide, with a new block that is pinned at a pin.

    Keys of the message:
        guide: link that carries the axis, by default the ground.
        pin, or at: id of the pin at the block, or the place of a new pin.
        angle_deg: direction of the axis in the world [deg].
        through: place on the axis.
    """
    guide = message.get("guide", "ground")
    pin = d.pin(message["pin"] if "pin" in message else {"at": message.get("at")})
    if guide != "ground":
        d.link(guide)  # refuses a link that is not there
    if guide in map(owner, pin.members):
        name = "the ground" if guide == "ground" else guide
        raise Refused(f"pin {pin.id} is on {name} itself, and cannot slide along it", (f"pins.{pin.id}",))
    angle = math.radians(number(message, "angle_deg"))
    point = _guide_point(d, guide, place(message.get("through"), "through"))
    # the distance of the pin from the axis [m], positive on the left of the axis
    offset = ((pin.at - d.place(f"{guide}.{point}")) * rect(1.0, -angle)).imag
    block, slide = d.new_name("block", "links"), d.new_name("slide", "joints", "cylinders")
    d.add_link(block, pin.at, angle, {**BLOCK})
    block_point = d.attach(pin, block).members[-1]
    _, guide_angle = d.poses[guide]
    degrees = round_digits(math.degrees(math.remainder(angle - guide_angle, 2 * math.pi)), DIGITS)
    joint = {"type": "prismatic", "guide": f"{guide}.{point}", "angle_deg": degrees, "block": block_point}
    if abs(offset) > SAME:
        joint["offset"] = round_digits(offset, DIGITS)
    d.group("joints")[slide] = joint
    d.made.insert(0, f"slides.{slide}")


def _guide_point(d: Drawing, guide: str, at: complex) -> str:
    """Return the name of the guide's point at a place in the world; add the point if there is none."""
    local = d.to_local(guide, at)
    for name, x in d.points(guide).items():
        if abs(x - local) < SAME:
            return name
    name = d.new_point_name(guide)
    d.written_points(guide)[name] = pair(local)
    return name


def join(d: Drawing, message: Message) -> None:
    """Move a pin onto another pin, and join all points of both pins in one joint.

    The pin `pin` of the message moves onto the pin `to`, or `to` onto `pin` if `pin` is fixed to the ground.
    """
    a, b = d.pin(message.get("pin")), d.pin(message.get("to"))
    if a.id == b.id:
        raise Refused("a pin cannot be joined to itself", (f"pins.{a.id}",))
    shared = {*map(owner, a.members)} & {*map(owner, b.members)}
    if shared:
        words = describe_owner("ground" if "ground" in shared else min(shared))
        raise Refused(f"pins {a.id} and {b.id} are both {words}: they cannot be joined", (f"pins.{a.id}", f"pins.{b.id}"))
    if a.is_grounded:
        a, b = b, a
    _move_pin(d, a, b.at)
    joints, joint = d.group("joints"), d.joint_of(a)
    if joint is not None:
        del joints[joint]
    if not a.members:
        d.remove_from_sketch(a)
    del d.pins[a.id]
    if not b.members:  # the moved pin takes the place of a pin that joined nothing
        d.remove_from_sketch(b)
        if joint is not None:
            joints[joint] = {"type": "revolute", "at": [*a.members]}
        return
    for reference in a.members:
        if d.is_written(owner(reference)):  # no joint can name points of the parts of a cylinder, which have no table in the file
            b = d.join_at_pin(b, reference)
    remaining_joint = d.joint_of(b)
    if joint is not None and remaining_joint is not None:
        for _, force in items(d.document, "forces"):  # forces in the removed joint now act in the other joint
            if force.get("joint") == joint:
                force["joint"] = remaining_joint
    d.made.append(f"pins.{b.id}")


def ground(d: Drawing, message: Message) -> None:
    """Fix a pin to the ground; with `on` false, release it from the ground."""
    pin, on = d.pin(message.get("pin")), bool(message.get("on", True))
    if on and not pin.is_grounded:
        _fix_to_ground(d, pin)
    elif pin.is_grounded and not on:
        _release_from_ground(d, pin)


def _fix_to_ground(d: Drawing, pin: Pin) -> None:
    """Fix a pin to a new point of the ground."""
    points, joints = d.written_points("ground"), d.group("joints")
    d.remove_from_sketch(pin)
    name = d.name_at(pin, points)
    points[name] = pair(pin.at)
    if pin.members:
        joint = joints.get(d.join_at_pin(pin, f"ground.{name}").id, {})
        if "at" in joint:  # put the ground first, as in the linkages of the suite
            joint["at"] = [f"ground.{name}", *(x for x in joint["at"] if x != f"ground.{name}")]


def _release_from_ground(d: Drawing, pin: Pin) -> None:
    """Release a pin from the ground: remove its ground points, except points that a slide uses.

    A pin that then joins nothing keeps its place in `assembly.sketch`; a joint with one point is removed.
    """
    points, joints, joint = d.written_points("ground"), d.group("joints"), d.joint_of(pin)
    for reference in (x for x in pin.members if owner(x) == "ground"):
        name = tail(reference)
        is_used = any(reference in (x.get("guide"), x.get("block")) for _, x in items(d.document, "joints"))
        if not is_used:
            del points[name]
        if joint is None:  # the pin gets the name of the point, or a new name if a joint has that name
            d.group("assembly", "sketch")[name if name not in joints else d.new_name("")] = pair(pin.at)
    if joint is not None:
        joints[joint]["at"] = [x for x in joints[joint]["at"] if owner(x) != "ground"]
        if len(joints[joint]["at"]) < 2:
            del joints[joint]


def move(d: Drawing, message: Message) -> None:
    """Move a pin to a place in the world."""
    _move_pin(d, d.pin(message.get("pin")), place(message.get("at")))


def _move_pin(d: Drawing, pin: Pin, at: complex) -> None:
    """Move a pin to a place in the world, and change the lengths of the links that it joins.

    A pin that joins nothing changes only in the sketch. A point of the ground is moved to the new place. A link with a single point
    (a block) is translated. In any other link only the point is moved. If the block of a slide is at the pin, and a point of the
    ground serves only as the guide of this slide, this point of the ground moves by the same displacement.
    """
    if not pin.members:
        d.group("assembly", "sketch")[pin.id] = pair(at)
    joints = [x for _, x in items(d.document, "joints")]
    used: Counter[str] = Counter()  # reference of a point -> number of times that joints name it
    for joint in joints:
        used.update(map(str, (joint.get("guide"), joint.get("block"), *sequence(joint, "at"))))
    for joint in joints:
        guide = str(joint.get("guide"))
        if joint.get("block") in pin.members and owner(guide) == "ground" and used[guide] == 1:
            d.set_point(guide, d.place(guide) + at - pin.at)
    for reference in pin.members:
        link = owner(reference)
        if link == "ground":
            d.set_point(reference, at)
        elif link not in d.group("links"):
            continue  # a part of a cylinder has no table in the file
        elif len(d.points(link)) == 1:  # a block moves as a whole
            origin, theta = d.poses[link]
            d.poses[link] = origin + at - pin.at, theta
        else:
            _move_point(d, reference, at)


def _move_point(d: Drawing, reference: str, at: complex) -> None:
    """Move a point of a link to a place in the world; a frame that lay along the link's first bar is aligned with it again."""
    link = owner(reference)
    is_aligned = d.is_aligned(link)
    d.set_point(reference, at)
    bars = [[d.place(f"{link}.{x}") for x in bar] for bar in sequence(d.link(link), "bars")]
    if any(abs(a - b) < SHORTEST for a, b in bars):
        raise Refused(f"{link} would have no length", (f"links.{link}",))
    if is_aligned:
        d.align(link)


def set_length(d: Drawing, message: Message) -> None:
    """Set the distance of two points of a link [m]: move the second point towards or away from the first."""
    name, length = str(message.get("link")), number(message, "value")
    points = d.points(name)
    a, b = str(message.get("a")), str(message.get("b"))
    where = (f"links.{name}",)
    if a not in points or b not in points or a == b:
        raise Refused(f"{name} has no length {a[:40]}-{b[:40]}", where, "a")
    if not SHORTEST <= length <= 1e5:
        raise Refused("a length is at least 1e-6 m and at most 1e5 m", where, "value")
    along = points[b] - points[a]
    if abs(along) < SAME:
        raise Refused(f"{a} and {b} lie at one place of {name}", where)
    _move_point(d, f"{name}.{b}", d.to_world(name, points[a] + along * (length / abs(along))))


def set_angle(d: Drawing, message: Message) -> None:
    """Turn a link to an angle in small steps, and close the joints after each step, so that the linkage stays on its branch."""
    name, degrees, reading = str(message.get("link")), number(message, "value_deg"), d.reading
    d.link(name)  # raises if there is no such link
    if reading.mechanism is None or reading.joints is None or not reading.closed:
        raise Refused("a link can be turned only if the drawing assembles", (f"links.{name}",))
    body, turn = reading.mechanism.find_body(name)  # turn: angle of a welded link in its body [rad]
    q, joints = reading.q, reading.joints
    first, row = float(angle_at(q, body)), gradient(Angle(GROUND, body), q)
    change = math.remainder(math.radians(degrees) - float(turn) - first, 2 * math.pi)  # [rad], at most half a turn
    for goal in np.linspace(first, first + change, max(1, math.ceil(abs(change) / TURN)) + 1)[1:]:

        def residual(x: Array, goal: float = goal) -> tuple[Array, Array]:
            """Return residual and Jacobian of the joints, with one more row: the link's angle minus `goal`."""
            F, J = joints.residual(x)
            return np.append(F, angle_at(x, body) - goal), np.vstack([J, row])

        q, error = gauss_newton(q, residual)
        if error > CLOSED:
            raise Refused(f"{name} cannot have an angle of {degrees:g} degrees: the linkage does not reach it", (f"links.{name}",))
    d.set_poses(reading.poses(q))


VERBS = (add_pin, add_bar, add_link, add_point, add_slide, join, ground, move, set_length, set_angle, observe)
GEOMETRY = {verb.__name__: verb for verb in VERBS}
