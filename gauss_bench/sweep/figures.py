"""Compute the numbers in the columns of a sweep's table, called figures, from states of motions, for many linkages at once."""

from itertools import product

import numpy as np

from gauss_bench import metrics
from gauss_bench.compiler.equations.links import with_parameters
from gauss_bench.judge import Evidence
from gauss_bench.mechanism import equations
from gauss_bench.mechanism.coordinates import Placed, state
from gauss_bench.mechanism.model import Coordinate, Mechanism, loads
from gauss_bench.mechanism.spaces import Vec, dot
from gauss_bench.sweep.family import Columns, held_by_joints
from gauss_bench.terms import Array

OF_A_RUN = {"loops": "m or rad", "energy_error": "J", "energy_bar": "J", "energy_scale": "J"}  # figures of every linkage


def units(mechanism: Mechanism) -> dict[str, str]:
    """Return name of a figure -> its unit, in the order of the columns."""
    units: dict[str, str] = {"measured": mechanism.measured.unit}
    for point, end in product(mechanism.observed_points, ("x_min", "x_max", "y_min", "y_max")):
        units[f"{point.name}.{end}"] = "m"
    if not mechanism.redundant:
        units |= {f"force.{joint.name}": "N" for joint in mechanism.joints}
    return units | OF_A_RUN


def figures(
    nominal: Mechanism, columns: Columns, t: Array, q: Array, v: Array, multipliers: Array
) -> tuple[dict[str, Array], list[Evidence]]:
    """Return name of a figure -> its values (batch,), and for each motion the evidence from which the judge decides its status.

    Args:
        nominal: the mechanism of the file; columns: name of a number that differs between the motions -> its values (batch,).
        t: (k,) times [s]; q, v: (k, batch, n) motions.
        multipliers: (k, batch, rows) lambda of M a + J^T lambda = Q.
    """
    mechanism, x = with_parameters(nominal, columns), Placed(q, v)
    with np.errstate(all="ignore"):
        by_name = {"measured": np.asarray(state(mechanism.measured.coordinate, x).value)[-1]}
        for p in mechanism.observed_points:
            for axis, path in zip("xy", x.end(p).place.parts, strict=True):
                by_name |= {f"{p.name}.{axis}_min": path.min(axis=0), f"{p.name}.{axis}_max": path.max(axis=0)}
        by_name |= _forces(mechanism, multipliers)
        gaps = _gaps(mechanism, x, t)
        gain, bar, scale = _energy(mechanism, x, t, multipliers)
    by_name |= {"loops": gaps.max(axis=0), "energy_error": np.abs(gain).max(axis=0), "energy_bar": bar, "energy_scale": scale}
    evidence, none = [], np.zeros(len(t))  # drift of rates is not evaluated here
    for k in range(q.shape[1]):
        evidence.append(Evidence(nominal.size, metrics.Drift(gaps[:, k], none, none), gain[:, k], float(bar[k]), float(scale[k])))
    return by_name, evidence


def _forces(mechanism: Mechanism, multipliers: Array) -> dict[str, Array]:
    """Return name of a figure -> largest force (batch,) in the joint [N]; empty if redundant rows leave forces undetermined.

    `multipliers` (k, batch, rows) are those at k times.
    """
    if mechanism.redundant:
        return {}
    largest, row = dict[str, Array](), 0  # row: first multiplier of the joint
    for joint in mechanism.joints:
        held: tuple[tuple[Coordinate, float], ...] = joint.held
        # multipliers of lengths are components of the force; that of an angle is a moment
        parts = [multipliers[..., row + k] for k, (x, _) in enumerate(held) if x.unit == "m"]
        largest[f"force.{joint.name}"] = np.linalg.norm(parts, axis=0).max(axis=0)
        row += len(held)
    return largest


def _gaps(mechanism: Mechanism, x: Placed, t: Array) -> Array:
    """Return the largest residual (k, batch) [m or rad] of all joints and drivers, for motions x at the times t (k,)."""
    rows = [np.abs(state(coordinate, x).value - value) for coordinate, value in held_by_joints(mechanism)]
    for driver in mechanism.drivers:
        rows.append(np.abs(state(driver.coordinate, x).value - np.asarray(driver.law(t)[0])[:, None]))
    return np.asarray(np.maximum.reduce(rows)) if rows else np.zeros(x.q.shape[:-1])


def _energy(mechanism: Mechanism, x: Placed, t: Array, multipliers: Array) -> tuple[Array, Array, Array]:
    """Return the gain of energy (k, batch), its error bar (batch,) and the scale of the energy (batch,) of motions [J].

    The gain is the energy gained beyond the work of drivers and forces at k times, and the error bar is that of this work. Gain and
    scale are defined as in `metrics.energy_error` and `metrics.energy_scale`.

    Args:
        x: positions and velocities of the motions at the times t (k,).
        multipliers: (k, batch, rows) lambda of M a + J^T lambda = Q.
    """
    kinetic, potential, power = (np.zeros(x.q.shape[:-1]) for _ in range(3))
    gravity = Vec(*mechanism.gravity)
    for i, link in enumerate(mechanism.links):
        frame = x.frame(i)
        kinetic = kinetic + 0.5 * (link.mass * dot(frame.u, frame.u) + link.inertia * (frame.omega * frame.omega))
        potential = potential - link.mass * dot(gravity, frame.z)
    for load in loads(mechanism.forces):
        stored, supplied = equations.energies(x, load)
        potential, power = potential + stored, power + supplied
    joint_rows = len(held_by_joints(mechanism))
    # the force of a driver is minus its multiplier; + 0 * t: a rate that is a constant becomes an array
    for k, driver in enumerate(mechanism.drivers, joint_rows):
        power = power - multipliers[..., k] * np.asarray(driver.law(t)[1] + 0 * t)[:, None]
    energy = kinetic + potential
    gain = energy - energy[0]
    bar = 8 * np.finfo(float).eps * (1.0 + np.abs(energy).max(axis=0))  # rounding errors
    scale = np.maximum(kinetic.max(axis=0), np.ptp(potential, axis=0))
    active = np.isfinite(power).all(axis=0) & power.any(axis=0)  # (batch,) motions with a power to integrate
    if active.any() and len(t) > 1:
        work, error = metrics.work(t, power[:, active])
        gain[:, active] -= work
        bar[active] += error
    return gain, bar, scale
