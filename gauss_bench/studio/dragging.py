"""Drag a drawn linkage and find its other assemblies, by functions of `kinematics`."""

import time
from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.kinematics.branches import branches
from gauss_bench.kinematics.dragging import Drag, Locks
from gauss_bench.linkage.references import drivers_of
from gauss_bench.mechanism.model import AngleDriver, Mechanism
from gauss_bench.mechanism.motion_laws import constant
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.studio.edits.drawing import Drawing, Pin, owner
from gauss_bench.studio.messages import Message, Refused, place
from gauss_bench.studio.reading import Reading
from gauss_bench.studio.scene import find_drivable
from gauss_bench.terms import Array

STEPS = 40  # largest number of steps towards one position of the pointer


def begin_drag(reading: Reading, locks: frozenset[str], message: Message) -> Drag:
    """Return a `Drag` of the pin or point that a message names, in which the parts with the ids `locks` do not move."""
    mechanism = closed_mechanism(reading, "dragged")
    d = Drawing(reading.document, reading)
    id = str(message.get("point") or message.get("pin"))
    pin = d.pins.get(id) or Pin(id, 0j, (id,))  # not a pin: the id is the reference of a point
    where = (f"pins.{id}",)
    if pin.is_grounded:
        raise Refused(f"pin {id} is fixed to the ground: moving it would change the linkage instead of dragging it", where)
    if not pin.members:
        raise Refused(f"pin {id} joins no link that could be dragged: move the pin instead", where)
    locked: dict[str, list[str]] = {"pins": [], "links": [], "slides": [], "joints": []}  # group -> names
    for lock in sorted(locks):
        group, _, name = lock.partition(".")
        if group in locked and ":" not in lock:  # the lock of a length has a colon, and no drag changes lengths
            locked[group].append(name)
    locked_pins = [d.pins[x] for x in locked["pins"] if x in d.pins and d.pins[x].members]
    points = [x.members[0] for x in locked_pins if owner(x.members[0]) != "ground"]  # locking one point locks its pin
    joints = {x.joint for x in mechanism.pins}.intersection(locked["joints"])
    try:
        parts = Locks(tuple(locked["links"]), tuple(points), tuple(locked["slides"]), tuple(sorted(joints)))
        return Drag(mechanism, reading.q, pin.members[0], parts)
    except (ValueError, KeyError) as error:
        raise Refused(str(error), where) from error


def drag_linkage(drag: Drag, reading: Reading, message: Message) -> dict[str, Any]:
    """Drag the linkage towards the pointer, and return the reply to the page.

    The reply has the `poses` of the links, whether the dragged pin has `reached` the pointer, their distance `apart` [m], the
    processor time `ms` [ms], and a `note`. The note is None except at a limit of the motion, where the pin can move in fewer
    directions than at the beginning of the drag. A pointer away from the circle of a crank's pin causes no note, because the pin
    can still move along the circle.
    """
    target, began = place(message.get("at")), time.thread_time()
    moved = drag.to(np.array([target.real, target.imag]), STEPS)
    ms = 1e3 * (time.thread_time() - began)
    note = moved.note if not moved.reached and drag.is_at_limit() else None
    return {"poses": reading.poses(moved.q), "reached": moved.reached, "apart": moved.apart, "ms": ms, "note": note}


def closed_mechanism(reading: Reading, word: str) -> Mechanism:
    """Return the mechanism of a drawing, or refuse a drawing that does not assemble; `word` completes "cannot be ..."."""
    if reading.mechanism is None:
        raise Refused(f"nothing is drawn yet that could be {word}")
    if not reading.closed:
        raise Refused(f"the drawing does not assemble yet, and cannot be {word}: the problems say which joint is open")
    return reading.mechanism


def find_input_links(reading: Reading) -> list[str]:
    """Return the names of the input links: those that the first scenario with driven links drives.

    Without such a scenario, the crank is the input link, and without a crank, the first link that is pinned to the ground, if any.
    """
    document = reading.document

    def exists(name: Any) -> bool:
        """Tell whether the drawing has a link of that name; a faulty file may drive a missing link."""
        return isinstance(name, str) and name in document.get("links", {})

    for scenario in document.get("scenarios", {}).values():
        names = [x["link"] for x in drivers_of(scenario) if exists(x.get("link"))]
        if names:
            return names
    if exists(document.get("crank")):
        return [document["crank"]]
    return [x["name"] for x in find_drivable(reading) if x["kind"] == "angle"][:1]


def find_branches(reading: Reading) -> list[Array]:
    """Return the positions, each (n,), of all assemblies with the present angles of the input links, first the drawn assembly."""
    mechanism = closed_mechanism(reading, "assembled in another way")
    drivers = []  # each holds an input link at its present angle
    for name in find_input_links(reading):
        body, _ = mechanism.find_body(name)
        drivers.append(AngleDriver(name, constant(float(angle_at(reading.q, body)), 0.0), body))
    try:
        return [*branches(replace(mechanism, drivers=tuple(drivers)), reading.q)]
    except ValueError as error:
        raise Refused(str(error)) from error
