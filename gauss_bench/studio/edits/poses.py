"""Find the four-bar whose coupler takes three given poses, describe it for the page, and draw it."""

import math
from cmath import phase, rect
from typing import Any

from gauss_bench.kinematics.synthesis import FourBar, NoFourBar, Pose, four_bar_of_pins, four_bar_of_pivots
from gauss_bench.studio.edits.drawing import SAME, Drawing, owner, pair
from gauss_bench.studio.edits.geometry import add_bar, add_point, add_slide
from gauss_bench.studio.messages import Message, Refused, number, place


def find_four_bar(message: Message) -> tuple[FourBar, Pose]:
    """Return the four-bar whose coupler passes through the three poses [x, y, degrees] in a message, and the first pose.

    The message has the places of two moving `pins` at the first pose, or of two fixed `pivots`.
    """
    listed = message.get("poses")
    if not isinstance(listed, list) or len(listed) != 3 or not all(isinstance(x, list) and len(x) == 3 for x in listed):
        raise Refused("three poses [x, y, degrees] are needed", field="poses")
    first, second, third = ((place(x[:2], "poses"), math.radians(number({"poses": x[2]}, "poses"))) for x in listed)
    poses = (first, second, third)  # each: place of the origin [m], angle [rad]
    key = "pivots" if "pivots" in message else "pins"
    two = message.get(key)
    if not isinstance(two, list) or len(two) != 2:
        raise Refused(f"two {key} [x, y] are needed", field=key)
    places = [place(x, key) for x in two]
    origin, angle = first
    try:
        if key == "pivots":
            return four_bar_of_pivots(poses, places), first
        return four_bar_of_pins(poses, [(x - origin) * rect(1.0, -angle) for x in places]), first
    except NoFourBar as error:
        raise Refused(str(error), field=key) from error


def describe_four_bar(message: Message) -> dict[str, Any]:
    """Return the reply with the four-bar that `synthesize` would draw, and its motion if either connection is driven."""
    four_bar, _ = find_four_bar(message)
    connections = [
        {
            "places": [pair(x) for x in connection.places],
            "pivot": pair(connection.pivot),
            "slide_deg": None if connection.direction is None else math.degrees(phase(connection.direction)),
        }
        for connection in four_bar.connections
    ]
    return {"connections": connections, "drives": [{"fault": x.fault, "text": x.text, "travel": x.travel} for x in four_bar.drives]}


def synthesize(d: Drawing, message: Message) -> None:
    """Draw the four-bar that `find_four_bar` finds, at the first of the three poses: the coupler, and two bars or slides.

    The origin of the pose becomes an observed point of the coupler, unless it is a pin.
    """
    four_bar, (origin, _) = find_four_bar(message)
    first, second = (x.places[0] for x in four_bar.connections)  # places of the coupler's pins in the first pose
    add_bar(d, {"from": {"at": pair(first)}, "to": {"at": pair(second)}})
    coupler = d.made[0].removeprefix("links.")
    # the two pins of the coupler, in the order of the connections, in which `add_bar` has just made them
    pins = [x.id for x in d.pins.values() if coupler in map(owner, x.members)]
    for pin, connection in zip(pins, four_bar.connections, strict=True):
        pivot = pair(connection.pivot)
        if connection.direction is None:
            add_bar(d, {"from": {"at": pivot, "ground": True}, "to": {"pin": pin}})
        else:
            degrees = math.degrees(phase(connection.direction))
            add_slide(d, {"pin": pin, "guide": "ground", "through": pivot, "angle_deg": degrees})
    if min(abs(origin - first), abs(origin - second)) > SAME:
        add_point(d, {"link": coupler, "at": pair(origin), "observe": True})
