"""The curves of a run, which `simulate --plot` draws and `--out` writes as a table.

The groups of curves are: observed links, observed points, energies, joint forces, motors, transmission angles. Within a group, the
curves have the order of the file. If the file observes no point and no link, all links are included. Joint forces have the signs of
`gauss_bench.api.simulate.Simulation`.
"""

import csv
import io
from collections.abc import Iterable, Iterator

import numpy as np

from gauss_bench import metrics
from gauss_bench.api.simulate import Simulation, point_levels
from gauss_bench.engines.minimal.structure import Links, close_from
from gauss_bench.mechanism.coordinates import motion_of_links
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.terms import Array
from gauss_bench.trajectory import Curve, Group, History, Trajectory

PER_TIME = ("", "/s", "/s^2")  # endings of the units of a position, a velocity and an acceleration, after "rad" or "m"
DIGITS = 10  # significant digits of a number in a CSV file


def history(result: Simulation) -> History:
    """Return the curves of a run at all its samples; a run without samples has no curves.

    Joint forces are computed from the accelerations at every sample, which takes seconds for tens of thousands of samples.
    """
    mechanism, x = result.model, result.trajectory
    if x is None:
        return History(np.zeros(0), ())
    with np.errstate(all="ignore"):  # a diverged run overflows; its curves then hold infinities
        trusted = len(x.t) if result.trusted_until is None else int(np.searchsorted(x.t, result.trusted_until, "right"))
        return History(x.t, tuple(curves(mechanism, x, trusted)))


def curves(mechanism: Mechanism, x: Trajectory, trusted: int) -> Iterator[Curve]:
    """Yield every curve of a trajectory, in the order of the groups in this module's docstring.

    The balance of energy is integrated over the first `trusted` samples, to which the judge does not object.
    """
    # whole: the linkage with every link of the file, also those that are welded together; links: the motion of these links
    whole, links = mechanism.whole, motion_of_links(mechanism, x)
    # angles are drawn for observed links, and for all links if the file lists neither observed links nor observed points
    indices = whole.observed_links or (() if whole.observed_points else range(len(whole.links)))
    yield from angular_curves(whole, links, indices)
    yield from point_curves(whole, links)
    evaluator = Evaluator(mechanism)
    yield from energies(evaluator, x, trusted)
    yield from forces(evaluator, x)
    yield from transmission(mechanism, x.q)


def angular_curves(whole: Mechanism, links: Trajectory, indices: Iterable[int]) -> Iterator[Curve]:
    """Yield the angle, angular velocity and angular acceleration of each link whose index is in `indices`."""
    for i in indices:
        for key, unit, level in zip(("theta", "omega", "alpha"), PER_TIME, (links.q, links.v, links.a), strict=True):
            yield Curve(Group.LINK, whole.link_name(i), key, f"rad{unit}", angle_at(level, i))


def point_curves(whole: Mechanism, links: Trajectory) -> Iterator[Curve]:
    """Yield the x and y coordinates of the position, velocity and acceleration of each observed point."""
    for point in whole.observed_points:
        for letter, unit, level in zip(("", "v", "a"), PER_TIME, point_levels(point, links), strict=True):
            for j, axis in enumerate("xy"):
                yield Curve(Group.POINT, point.name, letter + axis, f"m{unit}", level[:, j])


def energies(evaluator: Evaluator, x: Trajectory, trusted: int) -> Iterator[Curve]:
    """Yield kinetic energy, potential energy, and the energy gained beyond the work of drivers and forces [J].

    The energy gained is the error of the energy balance; it is NaN after the first `trusted` samples.
    """
    potential, gained = evaluator.applied.potential(x.q), np.full(len(x.t), np.nan)
    if trusted:
        gained[:trusted] = metrics.energy_error(evaluator, x[:trusted])[0]
    samples = {"kinetic": evaluator.energy(x.q, x.v) - potential, "potential": potential, "gained": gained}
    for key, values in samples.items():
        yield Curve(Group.ENERGY, "energy", key, "J", np.asarray(values))


def forces(evaluator: Evaluator, x: Trajectory) -> Iterator[Curve]:
    """Yield joint and weld forces, then the forces and torques of drivers, then the constant torques of motors [N, N m]."""
    yield from metrics.load_curves(evaluator, x)
    for torque in evaluator.mechanism.torques:
        yield Curve(Group.MOTOR, torque.name, "torque", "N m", np.full(len(x.t), float(torque.value)))


def transmission(mechanism: Mechanism, q: Array) -> Iterator[Curve]:
    """Yield the transmission angle [deg] of every dyad placed from the crank or driven links: 90 is best, 0 a dead centre.

    The transmission angle is the angle between two links on a pin, or between a rod and the normal of its slide's guide, folded
    into 0 to 90 degrees. A slide between two pinned links has no transmission angle.
    Source: Alt, Der Uebertragungswinkel und seine Bedeutung fuer das Konstruieren periodischer Getriebe (1932).
    """
    inputs = mechanism.turned_links
    if not inputs and mechanism.crank is not None:
        inputs = {mechanism.crank}
    links = Links.of(q, np.zeros_like(q))
    dyads = close_from(mechanism, inputs)[0] if inputs else []
    for dyad in dyads:
        if not dyad.opening_is_length:
            names = "-".join(mechanism.link_name(k) for k in dyad.links)
            # the opening of a dyad is the sine of the transmission angle; rounding may bring it beyond 1
            angle = np.degrees(np.arcsin(np.clip(np.abs(dyad.opening(links)), 0.0, 1.0)))
            yield Curve(Group.TRANSMISSION, names, "transmission", "deg", angle)


def table(history: History) -> str:
    """Return curves as the text of a CSV file with one row per time and the units in the header."""
    lines = io.StringIO()
    writer = csv.writer(lines, lineterminator="\n")
    writer.writerow(["t [s]", *(f"{x.name} [{x.unit}]" for x in history.curves)])
    for row in np.column_stack([history.t, *(x.values for x in history.curves)]):
        # NaN, the only value that differs from itself, is an empty cell
        writer.writerow(["" if value != value else f"{value:.{DIGITS}g}" for value in row.tolist()])
    return lines.getvalue()
