"""Build the mechanism for kinematics from a linkage file, a driver and a list of links, slides and pins that must not move."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.kinematics.motion import MotionError
from gauss_bench.linkage.bodies import expand_cylinders
from gauss_bench.linkage.closure import assemble, free_coordinates
from gauss_bench.linkage.errors import Fault, LinkageError
from gauss_bench.linkage.load import MAX_BYTES, Place, document_of, load_document, merge, place_by_sketch
from gauss_bench.linkage.references import drivers_of, items, sequence, table
from gauss_bench.linkage.schema import SECOND
from gauss_bench.mechanism.coordinates import value as value_of
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import AngleDriver, Mechanism, SlideDriver
from gauss_bench.mechanism.motion_laws import constant
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory
from gauss_bench.untrusted import read_bytes

# keys of a law that is given by its name alone: one turn in a second
TURN = {"constant": {"speed": 2 * np.pi}}  # [rad/s]
RISE = {"travel_deg": 360.0, "time": 1.0}  # [deg], [s] for all other laws
UNDRIVEN = "drives nothing; name a driven scenario, or give a driver"


def driver_table(text: str) -> dict[str, Any]:
    """Return the driver table (key -> number or text, as in a scenario) of a text "LAW" or "LAW:key=value,...".

    A law without keys has the values TURN or RISE. The law "table" may name a file, whose rows are read.

    Raises:
        ChoiceError: the text after "LAW:" is not of the form key=value,key=value or repeats a key, or a table's file is unreadable.
    """
    law, _, assignments = text.partition(":")
    driver: dict[str, Any] = {"law": law}
    for assignment in filter(None, assignments.split(",")):
        key, equals, value = assignment.partition("=")
        key = key.strip()
        if not equals:
            raise ChoiceError(f"driver {text!r}: {assignment!r} is not of the form key=value")
        if key in driver:
            raise ChoiceError(f"driver {text!r}: {key} is given twice")
        driver[key] = _read_number(value.strip())
    if law == "table" and "file" in driver:
        driver["rows"] = _read_rows(Path(driver.pop("file")))
    if not assignments and law != "table":
        driver = TURN.get(law, RISE) | driver
    return driver


def _read_number(value: str) -> float | str:
    """Return a text as a number, or the unchanged text if it is not a number."""
    try:
        return float(value)
    except ValueError:
        return value


def _read_rows(path: Path) -> list[list[float]]:
    """Return the rows [t, value] of a motion law from a text file; empty lines and comments, which begin with #, give no row.

    Commas or blanks separate numbers. The loader checks later that each row has two numbers.
    """
    try:
        content = read_bytes(path, MAX_BYTES).decode("utf-8")
        lines = [line.partition("#")[0].replace(",", " ").split() for line in content.splitlines()]
        return [[float(x) for x in line] for line in lines if line]
    except (OSError, ValueError) as error:
        raise ChoiceError(f"{path}: not a table of numbers t, value ({error})") from error


@dataclass(frozen=True, eq=False)
class Source:
    """The content of a linkage file, and the name of the scenario whose motion is computed.

    Attributes:
        document, digest, path: content, checksum and path of the file.
        scenario: name of a scenario; None takes the file's first.
    """

    document: dict[str, Any]
    digest: str
    path: Path
    scenario: str | None

    def load(self, place: Place = assemble) -> Mechanism:
        """Return the mechanism of the unchanged file in the chosen scenario; the function `place` finds the start position."""
        return load_document(self.document, self.scenario, str(self.path), self.digest, self.path.stem, place)

    def load_changed(self, document: dict[str, Any], scenario: dict[str, Any]) -> Mechanism:
        """Return the mechanism of a changed document, whose only scenario is the given table, under the name "kinematics"."""
        return load_document(document | {"scenarios": {"kinematics": scenario}}, "kinematics", str(self.path), self.digest)

    def refuse(self, scenario: str, sentence: str) -> LinkageError:
        """Return the exception that says why a scenario of this file has no kinematics; `sentence` is the reason."""
        return LinkageError(str(self.path), [Fault(f"scenarios.{scenario}", sentence)])


def load_with_drivers(
    linkage: str, scenario: str | None, driver: str | None, hold: Sequence[str] | None = None, with_forces: bool = False
) -> Mechanism:
    """Return the mechanism of a driven scenario, with some parts held: links and slides by constant drivers, pins by welds.

    Args:
        scenario: name of a scenario; None for the first driven one.
        driver: the driver as text; None for the scenario's own drivers.
        hold: names of links, slides and pins, each with "=VALUE" or without; None for the scenario's own list.
        with_forces: whether the scenario's forces act with a new driver or held parts; an unchanged scenario keeps its forces.

    Raises:
        LinkageError: the file or the driver has faults, named by table and field.
        ChoiceError: a name in `hold` cannot be held, or its value is not a number.
    """
    document, digest, path = document_of(linkage)
    first_driven = next((name for name, x in items(document, "scenarios") if "driver" in x or "drivers" in x), None)
    source = Source(document, digest, path, scenario or first_driven)
    if held := _read_holds(source, hold):
        return _load_held(source, driver, held, with_forces)
    own = source.load()  # faults of the file are reported first, by the names in the file
    if driver is None:
        if not own.drivers:
            raise source.refuse(own.scenario, _explain_undriven(own))
        return own
    new_driver, chosen = _complete_driver(document, own, driver), document["scenarios"][own.scenario]
    acting = {"forces": chosen.get("forces", [])} if with_forces else {}
    changed = merge(document, chosen.get("override", {}))
    return source.load_changed(changed, {"duration": float(new_driver.get("time", 1.0)), "driver": new_driver} | acting)


def _explain_undriven(mechanism: Mechanism) -> str:
    """Return a sentence on why a linkage without drivers has no kinematics, and what to do instead."""
    if not mechanism.knife_edges:
        return UNDRIVEN
    names = ", ".join(x.name for x in mechanism.knife_edges)
    return (
        f"the knife edge {names} constrains a velocity and no position: the motion depends on the forces, and cannot be "
        f"prescribed by a law; run `gauss-bench simulate {mechanism.name} --scenario {mechanism.scenario}`"
    )


def _complete_driver(document: dict[str, Any], own: Mechanism, text: str) -> dict[str, Any]:
    """Return the driver table of a driver given as text, with defaults: the crank is driven, from the start value of its angle."""
    driver = driver_table(text)
    if not {"link", "joint", "between"} & driver.keys():
        if "crank" not in document:
            raise ChoiceError(
                "--driver: the linkage has no crank; name what is driven: link=NAME, joint=NAME or between=POINT+POINT"
            )
        driver["link"] = document["crank"]
    if driver["law"] != "table" and not {"start", "start_deg"} & driver.keys():
        start = start_value(own, driver)
        if start is not None:
            driver["start"] = start
    return driver


def _read_holds(source: Source, hold: Sequence[str] | None) -> dict[str, float | None]:
    """Return name of a held link or joint -> value at which it is held [degrees or m], or None for its value at the start.

    `hold` lists texts "NAME" or "NAME=VALUE"; None takes the names in the scenario's own list `hold`.
    """
    if hold is None:
        return dict.fromkeys(sequence(table(table(source.document, "scenarios"), source.scenario or ""), "hold"))
    held: dict[str, float | None] = {}
    for text in hold:
        name, equals, value = text.partition("=")
        number = _read_number(value.strip()) if equals else None  # a text if VALUE is not a number
        if isinstance(number, str) or (number is not None and not np.isfinite(number)):
            raise ChoiceError(f"hold {text!r}: {value!r} is not a number of degrees or metres")
        held[name.strip()] = number
    return held


def _load_held(source: Source, driver: str | None, held: dict[str, float | None], with_forces: bool) -> Mechanism:
    """Return the mechanism of a driven scenario in which the links, slides and pins in `held` do not move.

    Args:
        held: name of a link, slide or pin -> the value at which it is held [deg], [m], or None for its value at the start.
    """
    try:
        own = source.load()
    except LinkageError as error:  # if the start leaves some freedom open, the sketch in the file places the links
        try:
            own = source.load(place_by_sketch)
        except LinkageError:
            raise error from None
    chosen = source.document["scenarios"][own.scenario]
    document = expand_cylinders(merge(source.document, chosen.get("override", {})))
    drivers = [*drivers_of(chosen)] if driver is None else [_complete_driver(source.document, own, driver)]
    if not drivers:
        raise source.refuse(own.scenario, UNDRIVEN)
    # the start of a new scenario sets the held coordinates, and constant drivers keep them there
    start: dict[str, Any] = {"angles": {}, "slides": {}}
    for name, value in held.items():
        _hold_part(document, own, name, value, start)
    duration = chosen["duration"] if driver is None else float(drivers[0].get("time", 1.0))
    scenario: dict[str, Any] = {"duration": duration, "drivers": drivers, "start": start}
    for key in ("expect", "measure"):  # held parts change the counts in `expect`, and may remove the coordinate in `measure`
        document.pop(key, None)
    forces, joints = document.pop("forces", {}), document.get("joints", {})
    if with_forces:  # a pin that became a weld does not turn, so its damping and friction exert nothing and are left out
        scenario["forces"] = [x for x in chosen.get("forces", []) if forces[x].get("joint") in (None, *joints)]
        document["forces"] = {x: forces[x] for x in scenario["forces"]}
    mechanism = source.load_changed(document | {"format": SECOND}, scenario)
    all_drivers = (*mechanism.drivers, *_make_constant_drivers(mechanism, mechanism, start))
    apart = mechanism.apart  # the mechanism with a body for each link of the file, from which forces of welds are found
    if apart:
        apart = replace(apart, drivers=(*apart.drivers, *_make_constant_drivers(mechanism, apart, start)))
    return replace(mechanism, drivers=all_drivers, apart=apart, scenario=own.scenario, scenarios=own.scenarios)


def _make_constant_drivers(mechanism: Mechanism, bodies: Mechanism, start: dict[str, Any]) -> list[AngleDriver | SlideDriver]:
    """Return drivers that hold each angle and slide in `start` at its value at the start of `mechanism`.

    Args:
        bodies: the mechanism on whose bodies the drivers act: `mechanism`, or the same with a body for each link.
        start: {"angles": name -> value, "slides": name -> value}.
    """
    drivers: list[AngleDriver | SlideDriver] = []
    for name in start["angles"]:
        body, turn = bodies.find_body(name)  # a welded link has a constant angle `turn` [rad] in its body
        drivers.append(AngleDriver(name, constant(_start_angle(mechanism, name) - turn, 0.0), body))
    for name, slide in mechanism.drivable.items():
        if name in start["slides"]:
            law = constant(float(value_of(slide.motion, mechanism.q0)), 0.0)
            drivers.append(SlideDriver(name, law, bodies.drivable[name]))
    return drivers


def _hold_part(document: dict[str, Any], own: Mechanism, name: str, value: float | None, start: dict[str, Any]) -> None:
    """Hold a link by its angle, a slide by its coordinate, or a pin by welding its two links.

    Args:
        document: the linkage document, which is changed: a held pin becomes a weld in it.
        own: the mechanism of the unchanged file.
        value: angle [deg] of the link or pin, or position [m] of the slide; None holds its value at the start of `own`.
        start: a scenario's table `start`, to which a held angle [rad] or slide [m] is added for `_make_constant_drivers`.
    """
    joints = document.get("joints", {})
    slide = own.drivable.get(name)
    if name in document["links"]:
        start["angles"][name] = _start_angle(own, name) if value is None else float(np.radians(value))
    elif name not in joints:
        raise ChoiceError(f"hold {name!r}: no such link or joint; there are {', '.join([*document['links'], *joints])}")
    elif slide is not None:
        start["slides"][name] = float(value_of(slide.motion, own.q0)) if value is None else value
    elif len(joints[name]["at"]) > 2:
        raise ChoiceError(f"hold {name!r}: the pin joins {len(joints[name]['at'])} links; hold links by their names")
    else:
        _hold_pin(document, own, name, value, start)


def _hold_pin(document: dict[str, Any], own: Mechanism, name: str, value: float | None, start: dict[str, Any]) -> None:
    """Hold a pin of two links by replacing the pin with a weld; if one link is the ground, hold the angle of the other link.

    The arguments are those of `_hold_part`; `value` is the angle [deg] of the second link relative to the first.
    """
    first, second = document["joints"][name]["at"]  # both as "link.point"
    first_link, second_link = (x.partition(".")[0] for x in (first, second))
    # the ground cannot be welded, so the other link's angle is held: the pin's angle, or its negative if the ground comes second
    if first_link == "ground":
        return _hold_part(document, own, second_link, value, start)
    if second_link == "ground":
        return _hold_part(document, own, first_link, None if value is None else -value, start)
    angle = _start_angle(own, second_link) - _start_angle(own, first_link) if value is None else float(np.radians(value))
    document["joints"] = {key: x for key, x in document["joints"].items() if key != name}
    sketch = dict(document.get("assembly", {}).get("sketch", {}))
    if name in sketch:  # the removed joint has a position in the sketch, which becomes the position of its first point
        sketch[first] = sketch.pop(name)
        document["assembly"] = document["assembly"] | {"sketch": sketch}
    weld = {"link": second_link, "to": first_link, "points": [[first, second]], "angle": angle}
    document["welds"] = document.get("welds", {}) | {f"{name}_held": weld}


def _start_angle(mechanism: Mechanism, name: str) -> float:
    """Return the angle [rad] that a link of the file has at the start; the link may be welded into a larger body."""
    body, turn = mechanism.find_body(name)  # turn: angle of the link in the frame of its body [rad]
    return float(angle_at(mechanism.q0, body) + turn)


def start_value(mechanism: Mechanism, table: dict[str, Any]) -> float | None:
    """Return the start value [rad, m] of the coordinate that a driver table names, or None if it is unknown.

    A coordinate that the scenario drives has the value of the driver's law at time 0. An undriven angle or slide has its value in
    the assembled position; an undriven length has none.
    """
    link, joint, between = table.get("link"), table.get("joint"), table.get("between", ())
    names = {"link": link, "joint": joint, "between": "-".join(between)}
    for driver in mechanism.drivers:
        if driver.name == names[driver.by]:
            return float(driver.law(0.0)[0])
    if link in [x.name for x in mechanism.whole.links]:
        return _start_angle(mechanism, str(link))
    slide = mechanism.drivable.get(joint) if isinstance(joint, str) else None
    return None if slide is None else float(value_of(slide.motion, mechanism.q0))


def free_at_start(mechanism: Mechanism) -> list[str]:
    """Return names of coordinates that joints and drivers leave free at the start, such as "angle of rocker" or "slide piston".

    Their number is that of the remaining degrees of freedom: if all of them are held, nothing moves freely.
    """
    if mechanism.dof <= len(mechanism.drivers):
        return []
    rows = Constraints(replace(mechanism, knife_edges=()))(0.0, mechanism.q0, mechanism.v0)
    return free_coordinates(mechanism, mechanism.q0, rows.J)


def move_by_drivers(
    mechanism: Mechanism, times: Array, method: Callable[..., Any] = loop_motion
) -> tuple[Trajectory, Array | None, str]:
    """Move a linkage by its drivers over times (k,) [s], up to the first position that cannot be reached.

    Return the states, the solver's iterations at each time (None if the method does not count them), and the reason why the motion
    stops before the last time ("" if it does not).

    Raises:
        ChoiceError: the method does not cover the linkage, or the drivers do not fit its degrees of freedom.
    """
    stopped = ""
    try:
        motion = method(mechanism, times)
    except MotionError as error:
        stopped, motion = str(error), error.reached
    except ValueError as error:
        raise ChoiceError(str(error)) from error
    count = len(motion.q)
    states = Trajectory(times[:count], motion.q, motion.v, motion.a, steps=count - 1)
    return states, getattr(motion, "iterations", None), stopped
