"""The results of the public functions: frozen objects whose fields are the keys of `--json`."""

import json
import math
from dataclasses import dataclass, field, fields
from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.judge import Objection
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status, Told, Trajectory

States = dict[str, dict[str, Array]]


class Result:
    """A result that can be read by attribute, by key, as a dictionary and as JSON."""

    def as_dict(self) -> dict[str, Any]:
        """The fields by name, in order; arrays stay arrays."""
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]

    def to_json(self) -> str:
        """As `--json` prints it; what is not finite becomes null, because JSON has no word for it."""
        return json.dumps(plain(self.as_dict()))

    def __getitem__(self, key: str) -> Any:
        return self.as_dict()[key]


@dataclass(frozen=True, eq=False, kw_only=True)
class OneRun(Result):
    """The result of one run of one linkage in one engine.

    Attributes:
        engine, mechanism, scenario, settings, integrator, stabilization: what was run.
        step: of the integration [s].
    """

    engine: str
    mechanism: str
    scenario: str
    settings: str
    integrator: str
    stabilization: str
    step: float


def name_files(mechanism: Mechanism, engine: str, choice: Choice) -> dict[str, Any]:
    """The fields of OneRun."""
    what = {"engine": engine, "mechanism": mechanism.name, "scenario": mechanism.scenario}
    return what | {name: getattr(choice, name) for name in ("settings", "integrator", "stabilization", "step")}


@dataclass(frozen=True, eq=False, kw_only=True)
class Simulation(OneRun):
    """A run at the k times asked for, with the fields of OneRun.

    Attributes:
        status: how it ended: "ok", "skip", "invalid" where it ended and the judge objects, else what went wrong.
        message: why, or a remark on the run.
        t: (k,) [s]; where the run failed, those that it reached and the last that it reached; empty, as all that follows, where it
            reached none.
        links: per link x, y [m] of its centre of mass, theta [rad], vx, vy, omega, ax, ay, alpha, each (k,).
        points: per observed point x, y [m], vx, vy, ax, ay.
        joints: per joint the constraint force fx, fy [N] on its second link and the moment [N m].
        metrics: figures that need no truth, of the run until `until` [s], and its costs.
        valid: whether the run came to its end and the judge has no objection.
        objections: the judge's, each with its subject, value, limit and sentence; of a run that failed, to what it reached.
        trusted_until: [s] up to where the judge has none; None where there is nothing to judge.
        advice: what may mend a run that is not to be trusted, or an empty text.
        observed: {"points": names, "links": names} that the file asks to look at.
        drivers: per driver the torque [N m] or force [N] it exerts; left out of dictionaries where nothing is driven.
        welds: per weld the force fx, fy [N] on the link that is welded and the moment [N m] about the point where it is held; left
            out of dictionaries where there are none.
        warnings: what the loader says of the file; left out of dictionaries where it says nothing.
        asked_until: the last time asked for [s]; model: the linkage; trajectory: all samples that were reached, or None. They are
            not in dictionaries; `gauss_bench.history` makes curves of them.
    """

    status: Status
    message: str
    t: Array
    links: States
    points: States
    joints: States
    metrics: dict[str, Any]
    valid: bool
    objections: tuple[Objection, ...]
    observed: dict[str, list[str]]
    trusted_until: float | None
    advice: str
    asked_until: float
    model: Mechanism
    trajectory: Trajectory | None = None
    drivers: dict[str, Array] = field(default_factory=dict)
    welds: States = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """The fields by name; plain but for arrays."""
        by_name = super().as_dict() | {"status": str(self.status), "objections": [vars(x) for x in self.objections]}
        absent = ("model", "trajectory", "asked_until")
        return {k: v for k, v in by_name.items() if k not in absent and (k not in ("drivers", "welds", "warnings") or v)}

    def told(self) -> Told:
        """The sentences of plots and animations on the run."""
        how = f"{self.engine} ({self.settings}), {self.integrator}, stabilization {self.stabilization}, step {self.step:g} s"
        verdict = "" if self.valid else "; ".join(filter(None, (f"{self.status}: {self.message}", self.advice)))
        end = max(self.asked_until, float(self.t[-1]) if len(self.t) else 0.0)
        trusted = None if self.trusted_until is None or self.trusted_until >= end else self.trusted_until
        return Told(f"{self.mechanism} / {self.scenario}", how, verdict, end, trusted)


@dataclass(frozen=True, eq=False)
class Kinematics(Result):
    """One linkage moved through a law, at k times.

    Attributes:
        status: "ok", or "stopped" where the motion ends before the law does; message: why.
        method: "loop", "basic" or "native".
        t: (k,) [s].
        driver: of the first driver: angle [rad] (or distance [m]), speed, acceleration, each (k,); drivers: of each by name.
        links, points: as in Simulation.
        link_types: per link unit, how its pose follows from those before it.
        loops: joints around each loop.
        branch: how the linkage is assembled; branch_changes: where along the motion that changes.
        iterations: (k,) of the search at each time, or None where they are not counted.
        singular: limits and dead centres, or why they cannot be listed.
        observed: {"points": names, "links": names} that are shown.
    """

    status: str
    message: str
    mechanism: str
    scenario: str
    method: str
    t: Array
    driver: dict[str, Array]
    drivers: dict[str, dict[str, Array]]
    links: States
    points: States
    loops: list[Any]
    branch: Any
    iterations: Any
    singular: list[dict[str, Any]] | str
    link_types: dict[str, str]
    branch_changes: list[Any]
    observed: dict[str, list[str]]


@dataclass(frozen=True)
class Tuning:
    """The step that was found for an exported file, and what was measured with it.

    Attributes:
        settings, integrator: of the engine.
        step: [s]; until: how long was measured [s].
        loops_open: largest gap of any joint [m, rad].
        motion_error: largest error of any link's place or angle [m, rad].
        truth: how the motion is known that it is measured against; known: how far that may be off [m, rad].
        loops_wanted, motion_wanted: what was aimed at; a step is taken that needs half of it.
    """

    settings: str
    integrator: str
    step: float
    until: float
    loops_open: float
    motion_error: float
    truth: str
    known: float
    loops_wanted: float
    motion_wanted: float

    @property
    def met(self) -> bool:
        """True if half of the aim is reached, and the truth is known to a tenth of it."""
        known = self.known <= self.motion_wanted / 10
        return known and self.loops_open <= self.loops_wanted / 2 and self.motion_error <= self.motion_wanted / 2

    @property
    def sentences(self) -> tuple[str, ...]:
        """For the head of a file."""
        how = f"settings {self.settings}, {self.integrator}, step {self.step:g} s"
        held = "held with half of it" if self.met else "NOT HELD by any step that was tried"
        return (
            f"Measured over {self.until:g} s with {how}:",
            f"joints open by {self.loops_open:.1e} (m, rad) at most, links off by {self.motion_error:.1e} (m, rad) at most.",
            f"Errors are against a motion that is {self.truth}, and known to {self.known:.1e}.",
            f"Aimed at: joints {self.loops_wanted:g}, links {self.motion_wanted:g}: {held}.",
        )

    def as_dict(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)} | {"met": self.met}


@dataclass(frozen=True)
class Export(Result):
    """A linkage, written for another program.

    Attributes:
        engine: kind of the file; what: in words.
        mechanism, scenario: that it holds.
        file: that was written; bytes: its size.
        step: that it is written with [s].
        left_out: what of the linkage file it does not hold.
        tuning: how the step was found, or None.
    """

    engine: str
    mechanism: str
    scenario: str
    file: str
    what: str
    bytes: int
    step: float
    left_out: tuple[str, ...]
    tuning: Tuning | None

    def as_dict(self) -> dict[str, Any]:
        """The fields by name; plain."""
        return super().as_dict() | {"tuning": self.tuning and self.tuning.as_dict()}


@dataclass(frozen=True)
class Import(Result):
    """A linkage file, made of a model of another program.

    Attributes:
        model: the file that was read; kind: "MJCF" or "URDF".
        file: that was written; name: of the linkage.
        links, dof: how many it has.
        left_out: what of the model it does not hold, or has otherwise.
    """

    model: str
    kind: str
    file: str
    name: str
    links: int
    dof: int
    left_out: tuple[str, ...]


def plain(item: Any) -> Any:
    """Arrays, numpy numbers and tuples as what JSON knows."""
    if hasattr(item, "tolist"):
        item = item.tolist()
    if isinstance(item, dict):
        return {str(k): plain(v) for k, v in item.items()}
    if isinstance(item, (list, tuple)):
        return [plain(v) for v in item]
    return None if isinstance(item, float) and not math.isfinite(item) else item
