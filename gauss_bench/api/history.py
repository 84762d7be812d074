"""A run as curves: what `simulate --plot` draws and `--out` writes, and a user may plot by himself.

The order is that of `Group`: observed links, observed points, energies, joint forces, motors, transmission angles; in a group that
of the linkage file. Where a file observes nothing, all links are told. Signs and reference points are those of `Simulation`.
"""

import csv
import io
from collections.abc import Iterable, Iterator

import numpy as np

from gauss_bench import metrics
from gauss_bench.api.simulate import Simulation, point_levels
from gauss_bench.engines.minimal.structure import Links, closed_from
from gauss_bench.mechanism.coordinates import spread
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import AngleDriver, Mechanism, Torque
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.terms import Array
from gauss_bench.trajectory import Curve, Group, History, Trajectory

LEVELS = ("", "/s", "/s^2")
DIGITS = 10  # of a number in a CSV file


def history(result: Simulation) -> History:
    """The curves of a run at all its samples, about a millisecond apart; without any where it reached none.

    Joint forces are worked out from the accelerations at every sample: seconds for tens of thousands.
    """
    mechanism, x = result.model, result.trajectory
    if x is None:
        return History(np.zeros(0), ())
    with np.errstate(all="ignore"):  # what grows beyond bounds is told as that
        sound = len(x.t) if result.trusted_until is None else int(np.searchsorted(x.t, result.trusted_until, "right"))
        return History(x.t, tuple(curves(mechanism, x, sound)))


def curves(mechanism: Mechanism, x: Trajectory, sound: int) -> Iterator[Curve]:
    """Every curve in its order; behind the first `sound` samples the work done is not worth integrating."""
    whole, links = mechanism.whole, spread(mechanism, x)
    turning = whole.observed_links or (() if whole.observed_points else range(len(whole.links)))
    yield from turn(whole, links, turning)
    yield from observe(whole, links)
    evaluator = Evaluator(mechanism)
    yield from energies(evaluator, x, sound)
    yield from forces(evaluator, x)
    yield from transmission(mechanism, x.q)


def turn(whole: Mechanism, links: Trajectory, which: Iterable[int]) -> Iterator[Curve]:
    """Angles of links, with their rates."""
    for i in which:
        for key, unit, level in zip(("theta", "omega", "alpha"), LEVELS, (links.q, links.v, links.a), strict=True):
            yield Curve(Group.LINK, whole.link_name(i), key, f"rad{unit}", angle_at(level, i))


def observe(whole: Mechanism, links: Trajectory) -> Iterator[Curve]:
    """Places of observed points, with their rates."""
    for point in whole.observed_points:
        for letter, unit, level in zip(("", "v", "a"), LEVELS, point_levels(point, links), strict=True):
            for j, axis in enumerate("xy"):
                yield Curve(Group.POINT, point.name, letter + axis, f"m{unit}", level[:, j])


def energies(evaluator: Evaluator, x: Trajectory, sound: int) -> Iterator[Curve]:
    """Kinetic and potential energy, and what was gained beyond the work done since the start, NaN behind `sound` samples [J]."""
    potential, gained = evaluator.applied.potential(x.q), np.full(len(x.t), np.nan)
    if sound:
        part = Trajectory(x.t[:sound], x.q[:sound], x.v[:sound], x.a[:sound], 0)
        gained[:sound] = metrics.energy_error(evaluator, part)[0]
    samples = {"kinetic": evaluator.energy(x.q, x.v) - potential, "potential": potential, "gained": gained}
    for key, values in samples.items():
        yield Curve(Group.ENERGY, "energy", key, "J", np.asarray(values))


def forces(evaluator: Evaluator, x: Trajectory) -> Iterator[Curve]:
    """Joint forces, then what drivers and constant torques exert."""
    mechanism = evaluator.mechanism
    slides = {joint.name for joint in mechanism.slides}
    joints = metrics.joint_forces(evaluator, x)
    for name, components in [*joints.items(), *metrics.weld_forces(evaluator, x).items()]:
        for key, values in components.items():
            if key != "moment" or name in slides or name not in joints:  # a pin has none
                yield Curve(Group.JOINT, name, key, "N m" if key == "moment" else "N", values)
    if mechanism.drivers:
        exerted = metrics.driving_forces(evaluator, x)
        for k, driver in enumerate(mechanism.drivers):
            turns = isinstance(driver, AngleDriver)
            yield Curve(Group.MOTOR, driver.name, "torque" if turns else "force", "N m" if turns else "N", exerted[:, k])
    for force in mechanism.forces:
        if isinstance(force, Torque):
            yield Curve(Group.MOTOR, force.name, "torque", "N m", np.full(len(x.t), float(force.value)))


def transmission(mechanism: Mechanism, q: Array) -> Iterator[Curve]:
    """The transmission angle [deg] of every dyad that closes on the crank or on driven links: 90 is best, 0 is a dead centre.

    Of two links on a pin it is the angle between them, of a rod on a slide that between the rod and the normal of the guide; either
    way folded into 0 to 90 degrees. A slide between two pinned links has none.
    Source: Alt, Der Uebertragungswinkel und seine Bedeutung fuer das Konstruieren periodischer Getriebe (1932).
    """
    given = {driver.link for driver in mechanism.drivers if isinstance(driver, AngleDriver)}
    given |= {mechanism.crank} if mechanism.crank is not None and not given else set()
    at = Links.of(q, np.zeros_like(q))
    for dyad in closed_from(mechanism, given)[0] if given else ():
        if dyad.kind != "RPR":
            names = "-".join(mechanism.link_name(k) for k in dyad.links)
            angle = np.degrees(np.arcsin(np.clip(np.abs(dyad.opening(at)), 0.0, 1.0)))
            yield Curve(Group.TRANSMISSION, names, "transmission", "deg", angle)


def table(history: History) -> str:
    """The curves as CSV: a row per time, and a header that gives every column's unit."""
    lines = io.StringIO()
    writer = csv.writer(lines, lineterminator="\n")
    writer.writerow(["t [s]", *(f"{x.name} [{x.unit}]" for x in history.curves)])
    for row in np.column_stack([history.t, *(x.values for x in history.curves)]):
        writer.writerow(["" if value != value else f"{value:.{DIGITS}g}" for value in row.tolist()])
    return lines.getvalue()
