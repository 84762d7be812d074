"""The scenarios that the studio writes: "driven", by laws that prescribe coordinates, and "released", let go where it is drawn.

Both begin where the linkage is drawn and go along with the drawing, as does any other start that lay there.
"""

import copy
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from gauss_bench.linkage.bodies import write_out
from gauss_bench.linkage.references import drivers_of, items, sequence, table
from gauss_bench.linkage.surest import HELD, candidates, null_space, surest
from gauss_bench.mechanism.coordinates import gradient, value
from gauss_bench.mechanism.model import GROUND, Angle, Distance, Prismatic
from gauss_bench.studio.document import Document
from gauss_bench.studio.edits.drawing import PLACED, Drawing, pair, round_digits
from gauss_bench.studio.errors import Refused
from gauss_bench.studio.messages import Message, number
from gauss_bench.studio.reading import Reading, new_faults

DRIVEN, RELEASED = "driven", "released"  # the scenarios that the studio writes
FREE = 2.0  # [s] of a drawing let go
STROKE = 0.1  # of the linkage's size
FOLLOWS = 1e-6  # [m, rad] a start as near to the drawing as this goes along with it


def drive(d: Drawing, message: Message) -> None:
    """Prescribe a coordinate in the scenario "driven", from where it is drawn; or leave it free again."""
    coordinate = message.get("coordinate")
    scenarios = d.group("scenarios")
    scenario = scenarios.get(DRIVEN, {})
    drivers = drivers_of(scenario)
    where = _coordinate(d, coordinate)
    drivers = [x for x in drivers if not all(x.get(k) == y for k, y in where.items())]
    if not message.get("off"):
        more = {k: x for k, x in message.items() if k not in ("id", "do", "coordinate", "off", "duration", "scenario")}
        law = (
            {"law": "constant", "speed": 2 * math.pi}
            if "link" in where
            else {"law": "sine", "travel": _stroke(d.reading), "time": 1.0}
        )
        drivers.append(where | ({} if more else law) | {"law": more.get("law", law["law"])} | more)
    before = copy.deepcopy(d.document)
    if not drivers:
        scenarios.pop(DRIVEN, None)
        return
    kept = {k: x for k, x in scenario.items() if k not in ("driver", "drivers", "start", "hold")}
    lasts = number(message, "duration", kept.get("duration") or max(_lasts(x) for x in drivers))
    scenarios[DRIVEN] = {**kept, "duration": lasts, "drivers": drivers}
    if "link" in where and not message.get("off") and "crank" not in d.document:
        d.document["crank"] = where["link"]
    start_driven(d.document, d.reading, fresh=where)
    if faults := new_faults(before, d.document):
        raise Refused("; ".join(str(x) for x in faults[:3]), (f"scenarios.{DRIVEN}",), faults[0].path.rpartition(".")[2])
    d.made.append(f"scenarios.{DRIVEN}")


def _stroke(reading: Reading) -> float:
    """The stroke [m] of a slide that is driven by no law yet."""
    return round_digits(STROKE * reading.mechanism.size if reading.mechanism else STROKE)


def _coordinate(d: Drawing, given: Any) -> dict[str, Any]:
    """The keys of a driver that say what it prescribes."""
    if isinstance(given, dict) and "between" in given:
        a, b = (given["between"] + [None, None])[:2] if isinstance(given["between"], list) else (None, None)
        return {"between": [*d.ends(a, b)]}
    name = given.get("name") if isinstance(given, dict) else given
    joints = write_out(d.document).get("joints", {})
    if isinstance(name, str) and name in d.group("links"):
        return {"link": name}
    if isinstance(name, str) and table(joints, name).get("type") == "prismatic":
        return {"joint": name}
    raise Refused(f"nothing can be driven that is called {str(name)[:60]!r}", field="coordinate")


def _lasts(driver: Mapping[str, Any]) -> float:
    """The time [s] for which a law goes on; a constant speed for one turn, or one second."""
    if driver.get("law") == "constant":
        speed = driver.get("speed")
        turns = isinstance(speed, (int, float)) and speed != 0 and "link" in driver
        return round_digits(2 * math.pi / abs(speed)) if turns else 1.0  # type: ignore[arg-type]
    rows = sequence(driver, "rows")
    last = rows[-1][0] if rows and isinstance(rows[-1], list) and rows[-1] else driver.get("time", 1.0)
    return float(last) if isinstance(last, (int, float)) else 1.0


def coordinates(reading: Reading) -> dict[str, float]:
    """The place of every coordinate that a start or driver may hold: `link` [rad], `joint` [m]."""
    if reading.mechanism is None:
        return {}
    values = {f"links.{name}": pose[2] for name, pose in reading.poses(reading.q).items()}
    values |= {f"slides.{j.name}": float(value(j.motion, reading.q)) for j in reading.mechanism.joints if isinstance(j, Prismatic)}
    return values


def _length(reading: Reading, between: Any) -> float | None:
    mechanism = reading.mechanism
    try:
        a, b = [mechanism.named_point(x) for x in between] if mechanism else [None, None]
    except (KeyError, StopIteration, ValueError, TypeError, AttributeError):
        return None
    if a is None or b is None:
        return None
    return float(value(Distance(a, b), reading.q))


def start_driven(document: Document, reading: Reading, fresh: Mapping[str, Any] | None = None) -> None:
    """Let the drivers of "driven" begin where the linkage is drawn (those of `fresh`, or all), and hold what they leave free."""
    scenario = table(table(document, "scenarios"), DRIVEN)
    drivers = drivers_of(scenario)
    now = coordinates(reading)
    for driver in drivers:
        if fresh is not None and not all(driver.get(k) == x for k, x in fresh.items()):
            continue
        if "link" in driver and f"links.{driver['link']}" in now:
            if "start" not in driver:
                driver.setdefault("start_deg", round_digits(math.degrees(now[f"links.{driver['link']}"])))
        elif "joint" in driver and f"slides.{driver['joint']}" in now:
            driver.setdefault("start", round_digits(now[f"slides.{driver['joint']}"]))
        elif "between" in driver and (length := _length(reading, driver["between"])) is not None:
            driver.setdefault("start", round_digits(length))
    rest = free_start(reading, drivers) if reading.closed else {}
    scenario.pop("driver", None)
    scenario.pop("drivers", None)
    scenario.pop("start", None)
    if len(drivers) == 1 and not rest:
        scenario["driver"] = drivers[0]
    else:
        scenario["drivers"] = drivers
        if rest:
            scenario["start"] = rest


def free_start(reading: Reading, drivers: list[Any]) -> dict[str, Any]:
    """The table of a start at rest where the linkage is drawn: the surest coordinates for what joints and drivers leave free."""
    mechanism, joints = reading.mechanism, reading.joints
    if mechanism is None or joints is None:
        return {}
    rows = joints(0.0, reading.q, np.zeros_like(reading.q)).J
    held = []
    for driver in drivers:
        if "link" in driver:
            held.append(gradient(Angle(GROUND, mechanism.placed(driver["link"])[0]), reading.q))
        elif "joint" in driver:
            held += [gradient(j.motion, reading.q) for j in mechanism.joints if j.joint == driver["joint"]]
        elif "between" in driver:
            a, b = [mechanism.named_point(x) for x in driver["between"]]
            held.append(gradient(Distance(a, b), reading.q))
    free = null_space(np.vstack([rows, *held]), mechanism.n)
    start: dict[str, Any] = {}
    for kind, key, chosen in surest(candidates(mechanism, reading.q), reading.q, free):
        values = [float(value(x, reading.q)) for x in chosen]
        if kind == "angle":
            start.setdefault("angles_deg", {})[key] = round_digits(math.degrees(values[0]))
        else:
            start.setdefault(HELD[kind][0], {})[key] = pair(values, PLACED) if kind == "point" else round_digits(values[0])
    return start


def release(document: Document, reading: Reading) -> None:
    """Keep the scenario "released" at rest where the linkage is drawn; a drawing without scenarios gets it."""
    own = {*table(document, "scenarios")} <= {DRIVEN} or RELEASED in document["scenarios"]
    if reading.mechanism is None or not own:
        return
    scenarios = document.setdefault("scenarios", {})
    kept = scenarios.get(RELEASED, {"duration": FREE, "forces": [*table(document, "forces")]})
    start = free_start(reading, []) if reading.closed else kept.get("start", {})
    scenarios[RELEASED] = {k: x for k, x in kept.items() if k != "start"} | {"start": start}


def _freedom(reading: Reading) -> int:
    return reading.mechanism.n - reading.rank if reading.mechanism else 0


def follow(document: Document, old: Reading, new: Reading) -> None:
    """Starts and drivers that began where the linkage was drawn begin where it is drawn now."""
    if not (old.closed and new.closed):
        return
    scenario = table(table(document, "scenarios"), DRIVEN)
    if drivers_of(scenario) and "hold" not in scenario and _freedom(old) != _freedom(new):
        start_driven(document, new)
    was, now = coordinates(old), coordinates(new)

    def moved(x: Any, key: str, unit: float) -> Any:
        if not isinstance(x, (int, float)) or key not in was or key not in now:
            return x
        turn = 2 * math.pi if key.startswith("links.") else math.inf
        away = math.remainder(x / unit - was[key], turn) if turn < math.inf else x / unit - was[key]
        return round_digits((now[key] + (x / unit - was[key] - away)) * unit) if abs(away) < FOLLOWS else x

    degrees = math.degrees(1.0)
    for name, scenario in items(document, "scenarios"):
        if name == RELEASED:
            continue
        for driver in drivers_of(scenario):
            link, joint = f"links.{driver.get('link')}", f"slides.{driver.get('joint')}"
            for key, of, unit in (("start_deg", link, degrees), ("start", link, 1.0), ("start", joint, 1.0)):
                if key in driver:
                    driver[key] = moved(driver[key], of, unit)
            before, after = (_length(x, driver["between"]) if "between" in driver else None for x in (old, new))
            if before is not None and after is not None and abs(driver.get("start", 0.0) - before) < FOLLOWS:
                driver["start"] = round_digits(after)
        start = table(scenario, "start")
        crank = f"links.{document.get('crank')}"
        for key, unit in (("crank_deg", degrees), ("crank", 1.0)):
            if key in start:
                start[key] = moved(start[key], crank, unit)
        for key, word, unit in (("angles_deg", "links", degrees), ("angles", "links", 1.0), ("slides", "slides", 1.0)):
            for held in table(start, key):
                start[key][held] = moved(start[key][held], f"{word}.{held}", unit)
