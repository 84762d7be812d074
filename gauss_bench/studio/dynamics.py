"""Simulate a drawing that is released from rest, or search for the cheapest engine setting that reaches an accuracy.

A copy of the file gets a scenario "released", which has no drivers and starts at rest where the linkage is drawn. One or more
engines then simulate this scenario.
"""

from importlib.util import find_spec
from typing import Any

from gauss_bench.engines import all_names
from gauss_bench.runs.offers import SAFE, offer, offers
from gauss_bench.studio.document import write_document
from gauss_bench.studio.dragging import closed_mechanism
from gauss_bench.studio.edits.scenarios import FREE, RELEASED, make_start
from gauss_bench.studio.messages import Message, Refused, number
from gauss_bench.studio.session import Session

LONGEST, LIMIT, STEP = 60.0, 120.0, 1e-3  # [s] longest motion, time limit of a simulation, step size
BUDGET, MOST_BUDGET = 30.0, 600.0  # [s] default and longest duration of a search


def list_engines() -> list[dict[str, Any]]:
    """Return for every engine of this package its name, whether it is usable on this machine, and the reason if it is not."""
    offered = offers([x for x in all_names() if x in SAFE])
    return [{"name": x.name, "here": x.usable, "reason": x.reason} for x in offered]


def write_released(session: Session, message: Message) -> tuple[str, float]:
    """Return the file's text with the scenario "released", and the end time of the simulation [s].

    The end time is `until` of the message, by default the scenario's duration in the file.
    """
    closed_mechanism(session.reading, "let go")  # raises if the drawing does not assemble
    document = session.document
    scenarios = document.setdefault("scenarios", {})
    present = scenarios.get(RELEASED, {"forces": [*document.get("forces", {})]})  # without the scenario in the file, all forces act
    until = number(message, "until", float(present.get("duration") or FREE))
    if not 0 < until <= LONGEST:
        raise Refused(f"until must be above 0 and at most {LONGEST:g} s", field="until")
    start = make_start(session.reading, [])
    scenarios[RELEASED] = {"duration": until, "forces": present.get("forces", []), "start": start}
    return write_document(session.text, document), until


def release(session: Session, message: Message) -> dict[str, Any]:
    """Start a job that simulates the drawn linkage, released from rest, in one or more engines.

    Return the reply: the number of the job, the end time `until` [s] and the names of the engines.
    """
    text, until = write_released(session, message)
    overlay = message.get("overlay") or []
    first = message.get("engine") or ("gauss-native" if find_spec("llvmlite") else "gauss")
    engines = [first, *(overlay if isinstance(overlay, list) else [overlay])]
    _check_usable(engines)
    request = {"work": "release", "engines": engines, "scenario": RELEASED, "until": until, "step": STEP, "limit": LIMIT}
    return {"job": session.jobs.start(text, request, "release_done"), "until": until, "engines": engines}


def _check_usable(engines: list[Any]) -> None:
    """Refuse a list of engines if one of them does not exist or cannot be used on this machine."""
    names = all_names()
    for engine in engines:
        if engine not in names:
            raise Refused(f"there is no engine {str(engine)[:60]!r}", field="engine")
        offered = offer(engine)
        if not offered.usable:
            raise Refused(f"{engine}: {offered.reason}", field="engine")


def recommend(session: Session, message: Message) -> dict[str, Any]:
    """Start a job that searches for each engine's cheapest setting with the required accuracy, in the scenario "released".

    Return the reply, which has the number of the job.
    """
    required = {key: number(message, key) for key in ("position", "angle", "force") if message.get(key) is not None}
    if not required or not all(x > 0 for x in required.values()):
        raise Refused("say what is required: a position, an angle or a force above 0", field="position")
    budget = number(message, "budget", BUDGET)
    if not 1 <= budget <= MOST_BUDGET:
        raise Refused(f"the budget must be between 1 and {MOST_BUDGET:g} s", field="budget")
    engines = message.get("engines") or []
    _check_usable(engines if isinstance(engines, list) else [engines])
    text, until = write_released(session, message)
    request = {"work": "recommend", "scenario": RELEASED, "until": until, "budget": budget, "engines": engines} | required
    return {"job": session.jobs.start(text, request, "recommend_done")}
