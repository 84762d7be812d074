"""Write the scenarios of the studio: "driven", in which motion laws prescribe coordinates, and "released", which starts at rest.

"driven" and "released" start in the position in which the linkage is drawn. A change of the drawing also changes their start
values, and those start values of other scenarios that were equal to the drawing.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from gauss_bench.linkage.bodies import expand_cylinders
from gauss_bench.linkage.closure import null_space
from gauss_bench.linkage.references import drivers_of, items, sequence, table
from gauss_bench.linkage.start_coordinates import choose_held
from gauss_bench.mechanism.coordinates import gradient, value
from gauss_bench.mechanism.model import GROUND, Angle, Coordinate, Distance, Mechanism
from gauss_bench.studio.document import Document
from gauss_bench.studio.edits.drawing import Drawing, round_digits
from gauss_bench.studio.messages import Message, Refused, number
from gauss_bench.studio.reading import Reading

DRIVEN, RELEASED = "driven", "released"  # the scenarios that the studio writes
USUAL, FREE = 1.0, 2.0  # [s] usual durations of "driven" and "released"
STROKE = 0.1  # default travel of a driven length, relative to the size of the linkage
FOLLOWS = 1e-6  # [m, rad] a start value that differs less from the drawing changes with the drawing
UNITS = {"_deg": math.degrees(1.0), "": 1.0}  # ending of a key for an angle -> value of the key for one radian


def drive(d: Drawing, message: Message) -> None:
    """Prescribe the motion of a coordinate in the scenario "driven", starting at its value in the drawing.

    `off: true` removes the driver instead, and the scenario with its last driver.
    """
    scenarios = d.group("scenarios")
    scenario, coordinate = scenarios.get(DRIVEN, {}), _name_coordinate(d, message.get("coordinate"))
    drivers = [x for x in drivers_of(scenario) if not coordinate.items() <= x.items()]
    if not message.get("off"):
        law = {k: x for k, x in message.items() if k not in ("id", "do", "coordinate", "off", "duration", "scenario")}
        if "link" in coordinate:
            d.document.setdefault("crank", coordinate["link"])
            usual: dict[str, Any] = {"law": "constant", "speed": 2 * math.pi}  # one turn a second
        else:
            size = d.reading.mechanism.size if d.reading.mechanism else 1.0
            usual = {"law": "sine", "travel": round_digits(STROKE * size), "time": 1.0}
        chosen = {"law": usual["law"]} | law if law else usual
        drivers.append(coordinate | chosen)
    if not drivers:
        scenarios.pop(DRIVEN, None)
        return
    # other drivers leave other coordinates free: `start_driven` writes a new start
    kept = {k: x for k, x in scenario.items() if k not in ("driver", "drivers", "start", "hold")}
    duration = number(message, "duration", kept.get("duration") or USUAL)
    scenarios[DRIVEN] = {**kept, "duration": duration, "drivers": drivers}
    start_driven(d.document, d.reading, only=coordinate)
    d.check((f"scenarios.{DRIVEN}",))
    d.made.append(f"scenarios.{DRIVEN}")


def _name_coordinate(d: Drawing, choice: Any) -> dict[str, Any]:
    """Return the part of a driver's table that names its coordinate: {"link": name}, {"joint": name} or {"between": [a, b]}.

    Args:
        choice: a value of a message: the name of a link or slide, `{"name": name}`, or `{"between": [a, b]}` for a distance.
    """
    if isinstance(choice, dict) and "between" in choice:
        a, b, *_ = [*sequence(choice, "between"), None, None]  # None for a missing end, which `find_ends` refuses
        return {"between": d.find_ends(a, b)}
    name = choice.get("name") if isinstance(choice, dict) else choice
    if isinstance(name, str) and name in d.group("links"):
        return {"link": name}
    if isinstance(name, str) and table(expand_cylinders(d.document).get("joints", {}), name).get("type") == "prismatic":
        return {"joint": name}
    raise Refused(f"there is no coordinate {str(name)[:60]!r} that can be driven", field="coordinate")


def coordinate_of(mechanism: Mechanism, driver: Mapping[str, Any]) -> Coordinate | None:
    """Return the coordinate that a driver's table names by its key `link`, `joint` or `between`; None if the linkage lacks it."""
    try:
        if "link" in driver:
            return Angle(GROUND, mechanism.find_body(driver["link"])[0])
        if "joint" in driver:
            return next(joint.motion for joint in mechanism.slides if joint.name == driver["joint"])
        return Distance(*map(mechanism.find_point, driver["between"]))
    except (KeyError, StopIteration, ValueError, TypeError, AttributeError):
        return None


def drawn_value(reading: Reading, driver: Mapping[str, Any]) -> float | None:
    """Return the value [rad, m] of a driver's coordinate in the drawing, or None if the linkage lacks the coordinate."""
    mechanism = reading.mechanism
    coordinate = None if mechanism is None else coordinate_of(mechanism, driver)
    if mechanism is None or coordinate is None:
        return None
    turn = mechanism.find_body(driver["link"])[1] if "link" in driver else 0.0  # angle of a welded link in its body [rad]
    return float(value(coordinate, reading.q)) + float(turn)


def start_driven(document: Document, reading: Reading, only: Mapping[str, Any] | None = None) -> None:
    """Let the scenario "driven" of a document start in the drawn position.

    A driver without a start gets the drawn value; with `only`, the driver must also have these keys and values. `start` is written
    again for the coordinates without drivers.
    """
    scenario = table(table(document, "scenarios"), DRIVEN)
    drivers = drivers_of(scenario)
    for driver in drivers:
        drawn = drawn_value(reading, driver)
        is_chosen = only is None or only.items() <= driver.items()
        if drawn is not None and is_chosen and not {"start", "start_deg"} & driver.keys():
            key, unit = ("start_deg", UNITS["_deg"]) if "link" in driver else ("start", 1.0)
            driver[key] = round_digits(drawn * unit)
    start = make_start(reading, drivers) if reading.closed else {}
    for key in ("driver", "drivers", "start"):
        scenario.pop(key, None)
    if len(drivers) == 1 and not start:
        scenario["driver"] = drivers[0]
    else:
        scenario["drivers"] = drivers
    if start:
        scenario["start"] = start


def make_start(reading: Reading, drivers: list[Any]) -> dict[str, Any]:
    """Return the table `start` of a scenario that starts at rest in the drawn position; empty without a mechanism.

    It prescribes those coordinates that best determine all others, as many as the drivers leave free.
    """
    mechanism, joints, q = reading.mechanism, reading.joints, reading.q
    if mechanism is None or joints is None:
        return {}
    driven = [coordinate_of(mechanism, driver) for driver in drivers]
    rows = [gradient(x, q) for x in driven if x is not None]
    free = null_space(np.vstack([joints(0.0, q, np.zeros_like(q)).J, *rows]), mechanism.n)  # (n, free coordinates)
    start: dict[str, Any] = {}
    for chosen in choose_held(mechanism, q, free):
        table_name, unit = ("angles_deg", UNITS["_deg"]) if chosen.kind == "angle" else (chosen.tables[0], 1.0)
        values = [round_digits(value(x, q) * unit) for x in chosen.coordinates]  # two for a point, otherwise one
        start.setdefault(table_name, {})[chosen.name] = values if chosen.kind == "point" else values[0]
    return start


def start_released(document: Document, reading: Reading) -> None:
    """Let the scenario "released", in which the linkage moves without drivers, start at rest in the drawn position.

    The scenario is added if the file has no scenario but "driven". If the drawn joints do not close, the present start stays.
    """
    is_wanted = {*table(document, "scenarios")} <= {DRIVEN} or RELEASED in document["scenarios"]
    if reading.mechanism is None or not is_wanted:
        return
    scenarios = document.setdefault("scenarios", {})
    present = scenarios.get(RELEASED, {"duration": FREE, "forces": [*table(document, "forces")]})
    start = make_start(reading, []) if reading.closed else present.get("start", {})
    scenarios[RELEASED] = {k: x for k, x in present.items() if k != "start"} | {"start": start}


def update_starts(document: Document, old: Reading, new: Reading) -> None:
    """Change the start values of all scenarios but "released" from the old drawing to the new one.

    A start value that was equal to its coordinate in the old drawing, up to whole turns, is set to the coordinate in the new one,
    with the same turns. Other start values stay.
    """
    if old.mechanism is None or new.mechanism is None or not (old.closed and new.closed):
        return
    driven = table(table(document, "scenarios"), DRIVEN)
    # with another number of degrees of freedom, the start of "driven" must have other coordinates; with `hold`, the user has chosen
    # these coordinates
    has_other_freedom = old.mechanism.n - old.rank != new.mechanism.n - new.rank
    if drivers_of(driven) and "hold" not in driven and has_other_freedom:
        start_driven(document, new)

    def move(entry: dict[str, Any], key: str, coordinate: Mapping[str, Any], unit: float) -> None:
        """Set one start value to its coordinate in the new drawing, if it was equal to its coordinate in the old drawing.

        Args:
            entry, key: the table that has the start value, and the key of the start value in it.
            coordinate: table that names the coordinate as a driver's table does, such as {"link": "crank"}.
            unit: number that the file has for 1 rad or 1 m under this key.
        """
        before, after, x = drawn_value(old, coordinate), drawn_value(new, coordinate), entry.get(key)
        if before is None or after is None or not isinstance(x, (int, float)):
            return
        away = x / unit - before
        turns = away - math.remainder(away, 2 * math.pi) if "link" in coordinate else 0.0  # whole turns of an angle [rad]
        if abs(away - turns) < FOLLOWS:  # the start value is the value in the old drawing
            entry[key] = round_digits((after + turns) * unit)

    for name, scenario in items(document, "scenarios"):
        start = table(scenario, "start")
        if name == RELEASED:  # `start_released` sets its start
            continue
        for ending, unit in UNITS.items():
            for driver in drivers_of(scenario):
                move(driver, f"start{ending}", driver, unit)
            move(start, f"crank{ending}", {"link": document.get("crank")}, unit)
            for link in table(start, f"angles{ending}"):
                move(start[f"angles{ending}"], link, {"link": link}, unit)
        for slide in table(start, "slides"):
            move(start["slides"], slide, {"joint": slide}, 1.0)
