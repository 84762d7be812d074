"""Recommendations for an engine, and settings in words."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gauss_bench import reach

LOOPS = "loops"  # an error that needs no truth: how far joints open
UNITS = reach.UNITS | {LOOPS: "m"}


@dataclass(frozen=True)
class Answer:
    """The recommendation for an engine, or the reason why there is none.

    Attributes:
        status: "ok", "not reached", "not tried" or "skip"; message: the answer of `gauss_bench.reach` in words.
        settings, integrator, stabilization: of the engine; empty without a setting.
        step, tolerance: [s] or relative; one of them.
        steps: of the run.
        errors: kind -> largest of the whole run [m], [rad], [N]; of the setting, or of the best that there was.
        seconds, seconds_low, seconds_high: processor time of a run [s], with the 5 % and the 95 % point; None without a race.
        ratio, ratio_low, ratio_high: to the fastest engine.
        tried, variants: how many of its variants were tried, and how many there are.
        evaluations: runs of the search.
        complete: whether the search ended before its time.
        loops: whose loop -> its cheapest setting's time over that of the fastest engine, where an engine has several.
        in_python: what of the suite's own runs in Python inside the time.
        options: of the engine, that its settings stand for.
        snippet: a program that runs the setting, in the engine's own language where that can be; empty where none is written.
    """

    engine: str
    status: str
    message: str = ""
    settings: str = ""
    integrator: str = ""
    stabilization: str = ""
    step: float | None = None
    tolerance: float | None = None
    steps: int | None = None
    errors: Mapping[str, float] = field(default_factory=dict)
    seconds: float | None = None
    seconds_low: float | None = None
    seconds_high: float | None = None
    ratio: float | None = None
    ratio_low: float | None = None
    ratio_high: float | None = None
    tried: int = 0
    variants: int = 0
    evaluations: int = 0
    complete: bool = True
    loops: Mapping[str, float] = field(default_factory=dict)
    in_python: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    snippet: str = ""


def setting_said(settings: str, integrator: str, stabilization: str) -> str:
    """A setting in words, each once: variants are often called by what they choose."""
    words = [] if settings == "default" else [settings]
    words += [x for x in (integrator, stabilization) if x != "none" and x not in settings.split("/")]
    return ", ".join(words)
