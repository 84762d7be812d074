"""One linkage, one engine, one run: the object that `gauss-bench simulate --json` prints."""

import time
from typing import Any

import numpy as np

from gauss_bench import metrics
from gauss_bench.engines import FOREIGN, get
from gauss_bench.engines.base import Choice, Engine
from gauss_bench.integrate.fixed_step import step_counts
from gauss_bench.mechanism.coordinates import acceleration, position, velocity
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.load import load
from gauss_bench.mechanism.model import Mechanism, Point
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

GRID = 1e-3  # [s] spacing of the samples that metrics are taken from, where the step is not longer
ALIASES = {"euler": "semi_implicit_euler"}


class ChoiceError(ValueError):
    """A setting, integrator or stabilisation that the engine does not have."""


def choose(engine: Engine, settings: str | None, integrator: str | None, stabilization: str | None, step: float) -> Choice:
    """The choice for a run, with the engine's own defaults where nothing is asked for.

    Raises:
        ChoiceError: naming what the engine offers.
    """
    integrator = integrator.lower() if integrator else engine.integrators[0]
    if integrator not in engine.integrators:
        integrator = ALIASES.get(integrator, integrator)
    chosen = Choice(settings or next(iter(engine.settings)), integrator, stabilization or "none", step)
    offers = (
        ("settings", chosen.settings, list(engine.settings)),
        ("integrator", chosen.integrator, engine.integrators),
        ("stabilization", chosen.stabilization, engine.stabilizations),
    )
    for field, value, offered in offers:
        if value not in offered:
            raise ChoiceError(f"{engine.name} has no {field} {value!r}; it offers {', '.join(offered)}")
    if not (np.isfinite(step) and step > 0):
        raise ChoiceError(f"the step must be a positive number of seconds, not {step}")
    return chosen


def run_times(step: float, at: list[float]) -> Array:
    """Sample times from 0 to the last asked for: a grid that keeps the step unbroken, and the times asked for."""
    spacing = step * max(1, round(GRID / step))
    grid = np.arange(int(np.floor(max(at) / spacing * (1 + 1e-12))) + 1) * spacing
    wanted = [x for x in at if np.abs(grid - x).min() > 1e-9 * max(1.0, x)]
    return np.unique(np.concatenate([grid, wanted]))


def simulate(
    linkage: str,
    engine: str = "gauss",
    scenario: str | None = None,
    settings: str | None = None,
    integrator: str | None = None,
    stabilization: str | None = None,
    step: float = 1e-3,
    at: list[float] | None = None,
    limit: float = 600.0,
) -> dict[str, Any]:
    """The motion of a linkage (a built-in name or a file) in one engine, as plain data; foreign engines run in a worker process.

    Args:
        linkage: name of a built-in linkage, or a path.
        engine: one of `gauss_bench.engines.names()`.
        scenario: of the file; the first with a start where not given.
        settings, integrator, stabilization: of the engine; its defaults where not given.
        step: integration step [s].
        at: times [s] to report; 0 and the scenario's duration where not given.
        limit: seconds after which a worker is stopped.

    Raises:
        LinkageError: the file has faults.
        ChoiceError: the engine does not offer what was asked for.
        KeyError: unknown engine.
    """
    choice = choose(get(engine), settings, integrator, stabilization, step)
    mechanism = load(linkage, scenario)
    at = sorted(set(at)) if at else [0.0, mechanism.duration]
    if not all(np.isfinite(x) and x >= 0 for x in at):
        raise ChoiceError("times must be numbers that are not negative")
    if engine not in FOREIGN or get(engine).skip(mechanism, choice):
        return simulate_here(linkage, engine, scenario, choice, at)
    from gauss_bench.bench.worker import Worker, WorkerFailure

    with Worker() as worker:
        try:
            result: dict[str, Any] = worker.call(simulate_here, (linkage, engine, scenario, choice, at), limit)
        except WorkerFailure as failure:
            return described(mechanism, engine, choice, at, failure.status, str(failure))
    return result


def simulate_here(linkage: str, engine: str, scenario: str | None, choice: Choice, at: list[float]) -> dict[str, Any]:
    """As `simulate`, in this process, with every choice made."""
    mechanism = load(linkage, scenario)
    adapter = get(engine)
    reason = adapter.skip(mechanism, choice)
    if reason:
        return described(mechanism, engine, choice, at, Status.SKIP, reason)
    times = run_times(choice.step, at)
    try:
        started = time.perf_counter()
        model = adapter.build(mechanism, choice)
        built = time.perf_counter()
        model.prepare(times)
        ready = time.perf_counter()
        model.run()
        done = time.perf_counter()
        trajectory = model.read()
    except RunFailure as failure:
        return described(mechanism, engine, choice, at, failure.status, str(failure))
    except ImportError as error:
        return described(mechanism, engine, choice, at, Status.SKIP, f"{engine} is not installed: {error}")
    steps = max(1, sum(count for count, _ in step_counts(times, choice.step)))
    cost = {"build_time": built - started, "step_time": (done - ready) / steps}
    return described(mechanism, engine, choice, at, Status.OK, trajectory.note, trajectory, cost)


def described(
    mechanism: Mechanism,
    engine: str,
    choice: Choice,
    at: list[float],
    status: Status,
    message: str,
    trajectory: Trajectory | None = None,
    cost: dict[str, float] | None = None,
) -> dict[str, Any]:
    """The result object; without a trajectory its lists are empty."""
    evaluator = Evaluator(mechanism)
    chosen = at_times(trajectory, at) if trajectory else empty(mechanism.n)
    result: dict[str, Any] = {
        "status": str(status),
        "message": message,
        "engine": engine,
        "mechanism": mechanism.name,
        "scenario": mechanism.scenario,
        "settings": choice.settings,
        "integrator": choice.integrator,
        "stabilization": choice.stabilization,
        "step": choice.step,
        "t": chosen.t,
        "links": link_states(mechanism, chosen),
        "points": point_states(mechanism.observed_points, chosen),
        "joints": metrics.joint_forces(evaluator, chosen),
        "metrics": measured(evaluator, trajectory) | (cost or {}) if trajectory else {},
    }
    if mechanism.drivers:
        forces = metrics.driving_forces(evaluator, chosen)
        result["drivers"] = {driver.name: forces[:, k] for k, driver in enumerate(mechanism.drivers)}
    return result


def measured(evaluator: Evaluator, trajectory: Trajectory) -> dict[str, Any]:
    """The metrics that need no reference."""
    drift = metrics.drift(evaluator, trajectory)
    energy, bar = metrics.energy_error(evaluator, trajectory)
    return {
        "position_drift": float(drift.position.max()),
        "velocity_drift": float(drift.velocity.max()),
        "acceleration_residual": float(drift.acceleration.max()),
        "energy_error": float(np.abs(energy).max()),
        "energy_error_bar": bar,
        "steps": trajectory.steps,
        "evaluations": trajectory.evaluations,
    }


def at_times(trajectory: Trajectory, at: list[float]) -> Trajectory:
    """The samples nearest to the times."""
    k = [int(np.abs(trajectory.t - x).argmin()) for x in at]
    return Trajectory(trajectory.t[k], trajectory.q[k], trajectory.v[k], trajectory.a[k], trajectory.steps)


def empty(n: int) -> Trajectory:
    none = np.zeros((0, n))
    return Trajectory(np.zeros(0), none, none, none, 0)


def link_states(mechanism: Mechanism, x: Trajectory) -> dict[str, dict[str, Array]]:
    """Per link: centre of mass, angle (unwrapped) and their rates."""
    keys = (("x", "y", "theta"), ("vx", "vy", "omega"), ("ax", "ay", "alpha"))
    return {
        link.name: {
            key: values[:, 3 * i + j] for names, values in zip(keys, (x.q, x.v, x.a), strict=True) for j, key in enumerate(names)
        }
        for i, link in enumerate(mechanism.links)
    }


def point_states(points: tuple[Point, ...], x: Trajectory) -> dict[str, dict[str, Array]]:
    """Per point: position, velocity, acceleration."""
    found = {}
    for p in points:
        levels = position(x.q, p), velocity(x.q, x.v, p), acceleration(x.q, x.v, x.a, p)
        pairs = zip((("x", "y"), ("vx", "vy"), ("ax", "ay")), levels, strict=True)
        found[p.name] = {key: values[:, j] for keys, values in pairs for j, key in enumerate(keys)}
    return found
