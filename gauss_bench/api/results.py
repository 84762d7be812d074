"""What the public functions return: frozen objects whose fields are the keys of `--json`."""

import json
import math
from dataclasses import dataclass, field, fields
from typing import Any

from gauss_bench.judge import Objection
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status

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


@dataclass(frozen=True, eq=False)
class Simulation(Result):
    """One run of one linkage in one engine, at the k times asked for.

    Attributes:
        status: how it ended: "ok", "skip", "invalid" where it ended and the judge objects, else what went wrong.
        message: why, or a remark on the run.
        engine, mechanism, scenario, settings, integrator, stabilization: what was run.
        step: integration step [s].
        t: (k,) [s]; where the run failed, those that it reached and the last that it reached; empty, as all that follows, where it
            reached none.
        links: per link x, y [m] of its centre of mass, theta [rad], vx, vy, omega, ax, ay, alpha, each (k,).
        points: per observed point x, y [m], vx, vy, ax, ay.
        joints: per joint the constraint force fx, fy [N] on its second link and the moment [N m].
        metrics: figures that need no truth, of the run until `until` [s], and its costs.
        valid: whether the judge has no objection.
        objections: the judge's, each with its subject, value, limit and sentence.
        observed: {"points": names, "links": names} that the file asks to look at.
        drivers: per driver the torque [N m] or force [N] it exerts; left out of dictionaries where nothing is driven.
    """

    status: Status
    message: str
    engine: str
    mechanism: str
    scenario: str
    settings: str
    integrator: str
    stabilization: str
    step: float
    t: Array
    links: States
    points: States
    joints: States
    metrics: dict[str, Any]
    valid: bool
    objections: tuple[Objection, ...]
    observed: dict[str, list[str]]
    drivers: dict[str, Array] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The fields by name; plain but for arrays."""
        found = super().as_dict() | {"status": str(self.status), "objections": [vars(x) for x in self.objections]}
        return found if self.drivers else {k: v for k, v in found.items() if k != "drivers"}


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


def plain(item: Any) -> Any:
    """Arrays, numpy numbers and tuples as what JSON knows."""
    if hasattr(item, "tolist"):
        item = item.tolist()
    if isinstance(item, dict):
        return {str(k): plain(v) for k, v in item.items()}
    if isinstance(item, (list, tuple)):
        return [plain(v) for v in item]
    return None if isinstance(item, float) and not math.isfinite(item) else item
