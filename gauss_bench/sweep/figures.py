"""The figures of a motion in a row, evaluated from its states alone, for a whole family of linkages at once.

The formulas of coordinates, forces and energies are those of `mechanism/coordinates.py`; a family's numbers are arrays (batch,).
"""

import numpy as np

from gauss_bench import metrics
from gauss_bench.judge import Evidence
from gauss_bench.mechanism import equations
from gauss_bench.mechanism.coordinates import state
from gauss_bench.mechanism.model import Coordinate, Mechanism
from gauss_bench.mechanism.spaces import Vec, dot
from gauss_bench.sweep.family import Varied
from gauss_bench.terms import Array

OF_A_RUN = {"loops": "m or rad", "energy_error": "J", "energy_bar": "J", "energy_scale": "J"}


def units(mechanism: Mechanism) -> dict[str, str]:
    """Names of the figures of a linkage, in their order, with units."""
    told: dict[str, str] = {"measured": mechanism.measured.unit}
    told |= {f"{p.name}.{axis}_{end}": "m" for p in mechanism.observed_points for axis in "xy" for end in ("min", "max")}
    if not mechanism.redundant:
        told |= {f"force.{joint.name}": "N" for joint in mechanism.joints}
    return told | OF_A_RUN


def figures(x: Varied, t: Array, multipliers: Array) -> tuple[dict[str, Array], list[Evidence]]:
    """Return every figure (batch,) of motions at times t (k,), and the judge's input for each.

    Args:
        x: states (k, batch, n) of a family, or of one linkage.
        multipliers: (k, batch, rows) of M a + J^T lambda = Q.
    """
    mechanism = x.mechanism
    with np.errstate(all="ignore"):
        by_name = {"measured": np.asarray(state(mechanism.measured.coordinate, x).value)[-1]}
        for p in mechanism.observed_points:
            for axis, way in zip("xy", x.end(p).place.parts, strict=True):
                by_name |= {f"{p.name}.{axis}_min": way.min(axis=0), f"{p.name}.{axis}_max": way.max(axis=0)}
        by_name |= _forces(mechanism, multipliers)
        opened = _gaps(x, t)
        gain, bar, scale = _energy(x, t, multipliers)
    by_name |= {"loops": opened.max(axis=0), "energy_error": np.abs(gain).max(axis=0), "energy_bar": bar, "energy_scale": scale}
    still = np.zeros(len(t))
    evidence = [
        Evidence(mechanism.size, metrics.Drift(opened[:, k], still, still), gain[:, k], float(bar[k]), float(scale[k]))
        for k in range(x.q.shape[1])
    ]
    return by_name, evidence


def _forces(mechanism: Mechanism, multipliers: Array) -> dict[str, Array]:
    """Largest force of each joint [N]; nothing where redundant rows leave it open."""
    largest, row = dict[str, Array](), 0
    for joint in () if mechanism.redundant else mechanism.joints:
        held: tuple[tuple[Coordinate, float], ...] = joint.held
        parts = [multipliers[..., row + k] for k, (x, _) in enumerate(held) if x.unit == "m"]
        largest[f"force.{joint.name}"] = np.linalg.norm(parts, axis=0).max(axis=0)
        row += len(held)
    return largest


def _gaps(x: Varied, t: Array) -> Array:
    """Largest residual (k, batch) of joints and drivers [m, rad]."""
    rows = [np.abs(state(held, x).value - value) for held, value in x.held()]
    for driver in x.mechanism.drivers:
        rows.append(np.abs(state(driver.coordinate, x).value - np.asarray(driver.law(t)[0])[:, None]))
    return np.asarray(np.maximum.reduce(rows)) if rows else np.zeros(x.q.shape[:-1])


def _energy(x: Varied, t: Array, multipliers: Array) -> tuple[Array, Array, Array]:
    """Return energy gained beyond the work (k, batch), the error bar of that work (batch,), and the energy scale (batch,).

    As `metrics.energy_error` and `metrics.energy_scale` have it for one linkage.
    """
    mechanism = x.mechanism
    kinetic, potential, power = (np.zeros(x.q.shape[:-1]) for _ in range(3))
    gravity = Vec(*x.pair("gravity", mechanism.gravity))
    for i, link in enumerate(mechanism.links):
        mass, inertia = (x.number(f"links.{link.name}.{key}", getattr(link, key)) for key in ("mass", "inertia"))
        frame = x.frame(i)
        turning = frame.omega * frame.omega
        kinetic = kinetic + 0.5 * (mass * dot(frame.u, frame.u) + inertia * turning)
        potential = potential - mass * dot(gravity, frame.z)
    for load in x.loads():
        held, gained = equations.energies(x, load)
        potential, power = potential + held, power + gained
    for k, driver in enumerate(mechanism.drivers, sum(len(x.held) for x in (*mechanism.joints, *mechanism.couplings))):
        power = power - multipliers[..., k] * np.asarray(driver.law(t)[1] + 0 * t)[:, None]
    whole = kinetic + potential
    gain = whole - whole[0]
    bar = 8 * np.finfo(float).eps * (1.0 + np.abs(whole).max(axis=0))  # of rounding
    scale = np.maximum(kinetic.max(axis=0), np.ptp(potential, axis=0))
    active = np.isfinite(power).all(axis=0) & power.any(axis=0)
    if active.any() and len(t) > 1:
        half = np.unique([*range(0, len(t), 2), len(t) - 1])
        fine, coarse = metrics.work(t, power[:, active], t), metrics.work(t[half], power[half][:, active], t)
        gain[:, active] -= fine
        bar[active] += np.abs(fine - coarse).max(axis=0)
    return gain, bar, scale
