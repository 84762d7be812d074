"""Questions of the drawing to the suite: letting it go, other engines beside, and which setting of which engine to take."""

import math
from importlib.util import find_spec
from typing import Any

from gauss_bench.engines import all_names
from gauss_bench.runs.offers import SAFE, offer, offers
from gauss_bench.studio.document import write_document
from gauss_bench.studio.dragging import assemble
from gauss_bench.studio.edits.scenarios import FREE, RELEASED, free_start
from gauss_bench.studio.errors import Refused
from gauss_bench.studio.messages import Message, number
from gauss_bench.studio.session import Session

LONGEST, LIMIT, STEP = 60.0, 120.0, 1e-3  # [s] of a release, of its run, and of a step
BUDGET, MOST_BUDGET = 30.0, 600.0  # [s] to look for a recommendation


def engines_here() -> list[dict[str, Any]]:
    """Every engine of the suite, with why it cannot be used where it cannot."""
    told = offers([x for x in all_names() if x in SAFE])
    return [{"name": x.name, "here": x.usable, "reason": x.reason} for x in told]


def text_of(session: Session, message: Message, until: float | None) -> tuple[str, str, float]:
    """Text, scenario and end [s] of what is run: a scenario that is named, or the drawing let go where it is.

    Raises:
        Refused: there is no such scenario, or the drawing does not assemble.
    """
    document = session.document
    scenarios = document.setdefault("scenarios", {})
    name = message.get("scenario")
    if name is not None:
        if not isinstance(name, str) or name not in scenarios:
            raise Refused(f"there is no scenario {str(name)[:60]!r}", field="scenario")
        return session.text, name, until or float(scenarios[name].get("duration") or FREE)
    assemble(session.reading, "let go")
    kept = scenarios.get(RELEASED, {"forces": [*document.get("forces", {})]})
    lasts = until or float(kept.get("duration") or FREE)
    start = message.get("start")
    scenarios[RELEASED] = {
        "duration": lasts,
        "forces": kept.get("forces", []),
        "start": start if isinstance(start, dict) else free_start(session.reading, []),
    }
    return write_document(session.text, document), RELEASED, lasts


def _until(message: Message) -> float | None:
    if message.get("until") is None:
        return None
    until = number(message, "until")
    if not 0 < until <= LONGEST:
        raise Refused(f"until is a time of at most {LONGEST:g} s", field="until")
    return until


def release(session: Session, message: Message) -> dict[str, Any]:
    """Begin a run of the drawing in an engine, and in others beside it.

    Raises:
        Refused: an engine is not there; in the words of who knows how to install it.
    """
    text, scenario, until = text_of(session, message, _until(message))
    kernel = find_spec("llvmlite") is not None
    overlay = message.get("overlay") or []
    first = message.get("engine") or ("gauss-native" if kernel else "gauss")
    engines = [first, *(overlay if isinstance(overlay, list) else [overlay])]
    _usable(engines)
    step = number(message, "step", STEP)
    if not 1e-6 <= step <= 1.0 or until / step > 1e6:
        raise Refused("a step is between 1e-6 and 1 s, and a run has at most a million", field="step")
    settings = message.get("settings")
    request = {"work": "release", "engines": engines, "scenario": scenario, "until": until, "step": step, "limit": LIMIT}
    request |= {"settings": settings} if isinstance(settings, str) else {}
    return {"job": session.jobs.start(text, request, "release_done"), "until": until, "engines": engines}


def _usable(engines: list[Any]) -> None:
    """See that engines are there.

    Raises:
        Refused: one is not; in the words of who knows how to install it.
    """
    names = all_names()
    for engine in engines:
        if engine not in names:
            raise Refused(f"there is no engine {str(engine)[:60]!r}", field="engine")
        if not (told := offer(engine)).usable:
            raise Refused(f"{engine}: {told.reason}", field="engine")


def recommend(session: Session, message: Message) -> dict[str, Any]:
    """Begin to look for the cheapest setting that holds an accuracy.

    Raises:
        Refused: nothing is required, or no such number.
    """
    wanted = {key: number(message, key) for key in ("position", "angle", "force") if message.get(key) is not None}
    if not wanted or not all(math.isfinite(x) and x > 0 for x in wanted.values()):
        raise Refused("say what is required: position in metres, angle in rad or force in N", field="position")
    budget = number(message, "budget", BUDGET)
    if not 1 <= budget <= MOST_BUDGET:
        raise Refused(f"a budget is 1 to {MOST_BUDGET:g} seconds", field="budget")
    engines = message.get("engines") or []
    _usable(engines if isinstance(engines, list) else [engines])
    text, scenario, until = text_of(session, message, _until(message))
    request = {"work": "recommend", "scenario": scenario, "until": until, "budget": budget, "engines": engines} | wanted
    return {"job": session.jobs.start(text, request, "recommend_done")}
