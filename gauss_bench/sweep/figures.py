"""What a row says of a motion: evaluated here from its states alone, for a whole family of linkages at once.

The formulas of coordinates, forces and energies are those of `mechanism/coordinates.py`; a family's numbers are arrays (batch,).
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench import metrics
from gauss_bench.judge import Evidence
from gauss_bench.mechanism import equations
from gauss_bench.mechanism.coordinates import Placed, state
from gauss_bench.mechanism.model import Coordinate, Mechanism, Prismatic, loads
from gauss_bench.terms import Array

OF_A_RUN = {"loops": "m or rad", "energy_error": "J", "energy_bar": "J", "energy_scale": "J"}


def units(mechanism: Mechanism) -> dict[str, str]:
    """Names of the figures of a linkage, in their order, with units."""
    told: dict[str, str] = {"measured": mechanism.measured.unit}
    told |= {f"{p.name}.{axis}_{end}": "m" for p in mechanism.observed_points for axis in "xy" for end in ("min", "max")}
    if not mechanism.redundant:
        told |= {f"force.{joint.name}": "N" for joint in mechanism.joints}
    return told | OF_A_RUN


@dataclass(frozen=True, eq=False)
class Motions:
    """Motions of a family.

    Attributes:
        t: (k,). q, v: (k, batch, n). multipliers: (k, batch, rows) of M a + J^T lambda = Q.
    """

    t: Array
    q: Array
    v: Array
    multipliers: Array


def figures(mechanism: Mechanism, motions: Motions, size: float) -> tuple[dict[str, Array], list[Evidence]]:
    """Every figure (batch,), and what the judge needs of each motion.

    Args:
        mechanism: a family, or one linkage.
        size: of the linkage [m], for the judge.
    """
    with np.errstate(all="ignore"):
        x = Placed(motions.q, motions.v)

        def at(coordinate: Coordinate) -> Array:
            return np.asarray(state(coordinate, x).value)

        by_name = {"measured": at(mechanism.measured.coordinate)[-1]}
        for p in mechanism.observed_points:
            for axis, way in zip("xy", x.end(p).place.parts, strict=True):
                by_name |= {f"{p.name}.{axis}_min": way.min(axis=0), f"{p.name}.{axis}_max": way.max(axis=0)}
        by_name |= _forces(mechanism, motions.multipliers)
        opened = _gaps(mechanism, x, motions.t)
        gain, bar, scale = _energy(mechanism, motions, x)
    by_name |= {"loops": opened.max(axis=0), "energy_error": np.abs(gain).max(axis=0), "energy_bar": bar, "energy_scale": scale}
    still = np.zeros(len(motions.t))
    evidence = [
        Evidence(size, metrics.Drift(opened[:, k], still, still), gain[:, k], float(bar[k]), float(scale[k]))
        for k in range(motions.q.shape[1])
    ]
    return by_name, evidence


def _forces(mechanism: Mechanism, multipliers: Array) -> dict[str, Array]:
    """Largest force of each joint [N]; nothing where redundant rows leave it open."""
    if mechanism.redundant:
        return {}
    largest = {}
    for k, joint in enumerate(mechanism.joints):
        first, second = multipliers[..., 2 * k], multipliers[..., 2 * k + 1]
        largest[f"force.{joint.name}"] = (np.abs(first) if isinstance(joint, Prismatic) else np.hypot(first, second)).max(axis=0)
    return largest


def _gaps(mechanism: Mechanism, x: Placed, t: Array) -> Array:
    """Largest residual (k, batch) of joints and drivers [m, rad]."""
    rows = [np.abs(state(held, x).value - fixed) for joint in mechanism.joints for held, fixed in joint.held]
    for driver in mechanism.drivers:
        rows.append(np.abs(state(driver.coordinate, x).value - np.asarray(driver.law(t)[0])[:, None]))
    return np.asarray(np.maximum.reduce(rows)) if rows else np.zeros(x.q.shape[:-1])


def _energy(mechanism: Mechanism, motions: Motions, x: Placed) -> tuple[Array, Array, Array]:
    """Energy gained beyond the work done (k, batch), the error bar of that work (batch,), and the energy that moves (batch,).

    As `metrics.energy_error` and `metrics.energy_scale` have it for one linkage.
    """
    t, q, v = motions.t, motions.q, motions.v
    kinetic, potential, power = (np.zeros(q.shape[:-1]) for _ in range(3))
    for i, link in enumerate(mechanism.links):
        vx, vy, w = (v[..., 3 * i + j] for j in range(3))
        kinetic = kinetic + 0.5 * (link.mass * (vx * vx + vy * vy) + link.inertia * (w * w))
        potential = potential - link.mass * (mechanism.gravity[0] * q[..., 3 * i] + mechanism.gravity[1] * q[..., 3 * i + 1])
    for load in loads(mechanism.forces):
        held, gained = equations.energies(x, load)
        potential, power = potential + held, power + gained
    for k, driver in enumerate(mechanism.drivers, sum(len(x.held) for x in (*mechanism.joints, *mechanism.couplings))):
        power = power - motions.multipliers[..., k] * np.asarray(driver.law(t)[1] + 0 * t)[:, None]
    whole = kinetic + potential
    gain = whole - whole[0]
    rounding = 8 * np.finfo(float).eps * (1.0 + np.abs(whole).max(axis=0))
    scale = np.maximum(kinetic.max(axis=0), np.ptp(potential, axis=0))
    active = np.isfinite(power).all(axis=0) & power.any(axis=0)
    bar = rounding
    if active.any() and len(t) > 1:
        half = np.unique([*range(0, len(t), 2), len(t) - 1])
        fine, coarse = metrics.work(t, power[:, active], t), metrics.work(t[half], power[half][:, active], t)
        gain[:, active] -= fine
        bar = rounding.copy()
        bar[active] += np.abs(fine - coarse).max(axis=0)
    return gain, bar, scale
