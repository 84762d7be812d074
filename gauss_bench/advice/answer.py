"""The recommendation for one engine as data, and functions that write settings, requirements and errors as text."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from gauss_bench import reach
from gauss_bench.engines.base import Choice

LOOPS = "loops"  # kind of error that needs no reference: the largest gap of a joint
UNITS = reach.UNITS | {LOOPS: "m"}  # kind of error -> its unit
BEATS = 200  # number of samples of a run whose integrator chooses its own steps


@dataclass(frozen=True)
class Answer:
    """The recommendation for an engine, or the reason why there is none.

    Attributes:
        engine: name of the engine.
        status: "ok", "not reached", "not tried" or "skip".
        message: the reason of the status in one sentence, from `gauss_bench.reach`.
        settings, integrator, stabilization: names as the engine offers them; empty if no setting is recommended.
        step, tolerance: integration step [s], or relative tolerance of an integrator that chooses its own steps.
        steps: number of steps of the run.
        errors: kind of error -> largest error in the whole run [m], [rad], [N]. If no setting meets the requirement, they are the
            errors of the run that came nearest.
        seconds, seconds_low, seconds_high: processor time of a run [s], its 5 % and 95 % quantile; None if no run was timed.
        ratio, ratio_low, ratio_high: time of a run divided by the time of the fastest engine, its 5 % and 95 % quantile.
        tried, variants: number of variants that were tried, and number of all variants of the engine.
        evaluations: number of runs in the search.
        complete: whether every variant was searched to its end.
        loops: name of a time loop -> run time of its fastest setting divided by the run time of the fastest engine; empty if the
            engine has a single time loop.
        in_python: the Python code outside the engine's library that a timed run executes.
        options: the engine's options under these settings.
        owner: the engine's authors if the settings are theirs; empty if they are the suite's.
        snippet: a program that runs the setting, in the engine's own language if possible; empty if there is no program.
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
    owner: str = ""
    snippet: str = ""

    def choose(self, until: float) -> Choice:
        """Return the `Choice` with which an engine runs this setting for `until` seconds."""
        return Choice(self.settings, self.integrator, self.stabilization, self.step or until / BEATS, self.tolerance)


def format_setting(
    settings: str, integrator: str, stabilization: str, step: float | None = None, tolerance: float | None = None
) -> str:
    """Return a setting as text; an integrator or stabilization that the name of the settings contains is not repeated."""
    words = [] if settings == "default" else [settings]
    words += [x for x in (integrator, stabilization) if x not in ("", "none", *settings.split("/"))]
    if tolerance is not None:
        words.append(f"tolerance {tolerance:.2g}")
    elif step is not None:
        words.append(f"step {step:.4g} s")
    return ", ".join(words)


def format_limits(wanted: Mapping[str, float]) -> str:
    """Return requirements (kind of error -> largest allowed error) as a text such as "0.0001 m and 0.001 rad"."""
    return " and ".join(f"{x:g} {UNITS[kind]}" for kind, x in wanted.items())


def format_errors(errors: Mapping[str, float], kinds: Iterable[str], joint: str = " and ") -> str:
    """Return the errors of the given kinds as a text such as "1.0e-05 m and 2.0e-04 rad"; `joint` stands between two errors."""
    return joint.join(f"{errors[kind]:.1e} {UNITS[kind]}" for kind in kinds if kind in errors)
