"""Compute the kinematics of a drawing for the page: driven motions, their forces, singular positions and instant centres."""

from cmath import rect
from threading import Event
from typing import Any

import numpy as np

from gauss_bench import metrics
from gauss_bench.api.driven import free_at_start, load_with_drivers, move_by_drivers
from gauss_bench.api.history import transmission
from gauss_bench.kinematics.centres import advantages, centres
from gauss_bench.kinematics.singular import ChangePoint, singular_positions
from gauss_bench.linkage.references import items
from gauss_bench.mechanism.coordinates import acceleration, motion_of_links, position, velocity
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import AngleDriver, Mechanism
from gauss_bench.studio.autosave import temporary_file
from gauss_bench.studio.document import is_driven, write_document
from gauss_bench.studio.edits.drawing import Drawing
from gauss_bench.studio.edits.scenarios import DRIVEN, drive
from gauss_bench.studio.messages import Message, Refused
from gauss_bench.studio.reading import Reading, poses
from gauss_bench.studio.scene import find_drivable
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory

SAMPLES, MOST = 120, 2000  # default and largest number of intervals of a motion


def load_driven(text: str, reading: Reading, scenario: Any) -> Mechanism:
    """Return the mechanism with the drivers of a scenario.

    If `scenario` is None, the first driven scenario is taken; without one, the first coordinate that can be driven moves by its
    default law.

    Raises:
        Refused: no coordinate can be driven, or the drivers leave a coordinate free.
        LinkageError, ChoiceError: the file or the driver cannot be used.
    """
    document = reading.document
    if not isinstance(scenario, (str, type(None))):
        raise Refused("a scenario is given by its name", field="scenario")
    if scenario is None and not any(is_driven(x) for _, x in items(document, "scenarios")):
        possible = find_drivable(reading)
        if not possible:
            raise Refused("nothing can be driven yet: draw a link that is pinned to the ground, or a slide")
        d = Drawing(document | {"scenarios": {}}, reading)  # a copy, which gets the scenario "driven" alone
        drive(d, {"coordinate": possible[0]["name"]})
        text, scenario = write_document(text, d.document), DRIVEN
    with temporary_file(text, document.get("name")) as path:
        mechanism = load_with_drivers(str(path), scenario, None)
    if free := free_at_start(mechanism):
        raise Refused(f"the drivers leave {len(free)} coordinates free ({', '.join(free)}): drive them too, or hold them")
    return mechanism


def move(text: str, reading: Reading, message: Message) -> tuple[Mechanism, Trajectory, str | None]:
    """Return the mechanism, its motion over the scenario's duration, and the reason why the motion stops earlier, or None.

    Raises:
        Refused, LinkageError, ChoiceError: the drawing cannot be moved.
    """
    count = message.get("samples", SAMPLES)
    if not isinstance(count, int) or isinstance(count, bool) or not 1 <= count <= MOST:
        raise Refused(f"samples must be a whole number from 1 to {MOST}", field="samples")
    mechanism = load_driven(text, reading, message.get("scenario"))
    states, _, stopped = move_by_drivers(mechanism, np.linspace(0.0, mechanism.duration, count + 1))
    return mechanism, states, stopped or None


def describe_motion(text: str, reading: Reading, message: Message) -> tuple[Mechanism, dict[str, Any]]:
    """Return the driven mechanism, and the reply that describes its motion.

    The reply has no singular positions, because finding them takes long; they follow in an event.

    Raises:
        Refused, LinkageError, ChoiceError: the drawing cannot be moved.
    """
    mechanism, trajectory, stopped = move(text, reading, message)
    links, first, t = motion_of_links(mechanism, trajectory), mechanism.drivers[0], trajectory.t
    q, v, a, points = links.q, links.v, links.a, mechanism.whole.observed_points
    reply = {
        "scenario": mechanism.scenario,
        "times": t,
        "poses": pose_motion(mechanism, trajectory.q),
        "points": {p.name: {"p": position(q, p), "v": velocity(q, v, p), "a": acceleration(q, v, a, p)} for p in points},
        "input": {
            "name": first.name,
            "unit": "rad" if isinstance(first, AngleDriver) else "m",
            "values": np.broadcast_to(first.law(t)[0], t.shape),
        },
        "transmission": [{"name": c.of, "values": c.values} for c in transmission(mechanism, trajectory.q)],
        "limits": stopped,
        "note": None,
    }
    return mechanism, reply | describe_forces(mechanism, trajectory) | describe_ratios(mechanism, trajectory.q)


def pose_motion(mechanism: Mechanism, q: Array) -> dict[str, list[list[float]]]:
    """Return link -> [[x, y, theta], ...], the poses of the link's own frame at states q (k, n)."""
    at_states = [poses(mechanism, state) for state in q]
    return {link.name: [x[link.name] for x in at_states] for link in mechanism.whole.links}


def describe_forces(mechanism: Mechanism, trajectory: Trajectory) -> dict[str, Any]:
    """Return the part of the reply with the force or torque of the first driver, and forces and moments in pins and slides.

    `torque` is None and `pins` is empty if the trajectory has no samples or the forces cannot be computed.
    """
    unknown: dict[str, Any] = {"torque": None, "pins": []}
    if not len(trajectory.t):
        return unknown
    evaluator = Evaluator(mechanism)
    try:
        driving, loads = metrics.driving_forces(evaluator, trajectory), metrics.joint_forces(evaluator, trajectory)
    except (ArithmeticError, np.linalg.LinAlgError, ValueError):
        return unknown
    first = mechanism.drivers[0]
    torque = {"name": first.name, "unit": "N m" if isinstance(first, AngleDriver) else "N", "values": driving[:, 0]}
    pins = [{"joint": name, "force": np.stack([f["fx"], f["fy"]], axis=-1), "moment": f["moment"]} for name, f in loads.items()]
    return {"torque": torque, "pins": pins}


def describe_ratios(mechanism: Mechanism, q: Array) -> dict[str, Any]:
    """Return the part of the reply on velocity ratios and mechanical advantages at states q (k, n).

    The list is empty unless the linkage has one degree of freedom.
    """
    try:
        pairs = advantages(mechanism, q)
    except ValueError:
        pairs = ()
    return {"advantage": [{"input": x.input, "output": x.output, "values": x.mechanical, "velocity": x.velocity} for x in pairs]}


@np.errstate(all="ignore")  # `answer` sets this for its own thread only, and the search runs in another thread
def find_singular(mechanism: Mechanism, ended: Event) -> tuple[list[dict[str, Any]], str]:
    """Return limits of motion and dead centres with their poses, and the reason why they cannot be listed, or "".

    Another thread sets `ended` to end the search.
    """
    try:
        positions = singular_positions(mechanism, ended)
    except (ValueError, ChangePoint) as error:
        return [], str(error)
    keys = ("kind", "coordinate", "value", "input")
    return [{key: getattr(x, key) for key in keys} | {"poses": poses(mechanism, x.q)} for x in positions], ""


def instant_centres(reading: Reading, pose_of: Any) -> list[dict[str, Any]]:
    """Return the instant centre of every pair of links.

    Args:
        pose_of: the poses {link: [x, y, theta]} that the page sent; None for the poses in which the links are drawn.

    Raises:
        Refused: nothing is drawn, a link has no valid pose, or the linkage does not have one degree of freedom there.
    """
    mechanism = reading.mechanism
    if mechanism is None:
        raise Refused("nothing is drawn yet")
    q = reading.q if pose_of is None else read_positions(reading, pose_of)
    try:
        pairs = centres(mechanism, q)
    except ValueError as error:
        raise Refused(str(error)) from error
    return [{"links": [mechanism.link_name(k) for k in x.links], "at": x.at, "along": x.along} for x in pairs]


def centres_along(reading: Reading, poses_of: Any) -> list[dict[str, Any]]:
    """Return the instant centre of every pair of links along a motion, with None at poses that have no centres.

    Args:
        poses_of: the motion {link: [[x, y, theta], ...]} that the page sent.
    """
    lists = [*poses_of.values()] if isinstance(poses_of, dict) else []
    if not lists or not all(isinstance(x, list) and 0 < len(x) == len(lists[0]) <= MOST for x in lists):
        raise Refused(f"a motion is a list of poses for each link, all of one length, at most {MOST}", field="along")
    at_poses: list[list[dict[str, Any]]] = []  # the centres at every pose
    for k in range(len(lists[0])):
        try:
            at_poses.append(instant_centres(reading, {link: poses[k] for link, poses in poses_of.items()}))
        except Refused:
            if not any(at_poses) and k == len(lists[0]) - 1:  # no pose had centres: refuse, with the reason of the last pose
                raise
            at_poses.append([])  # at a fork the linkage has more degrees of freedom, and no centres
    pairs = [x["links"] for x in next(filter(None, at_poses))]
    return [{"links": links, "at": [x[i]["at"] if x else None for x in at_poses]} for i, links in enumerate(pairs)]


def read_positions(reading: Reading, pose_of: Any) -> Array:
    """Return the positions q (n,) that belong to poses {link: [x, y, theta]} from the page; refuse poses that lack a link.

    A pose has the origin of a link's frame, while q has the link's centre of mass.
    """
    mechanism, q = reading.mechanism, list[float]()
    for link in mechanism.links if mechanism else ():
        pose = pose_of.get(link.name) if isinstance(pose_of, dict) else None
        if not isinstance(pose, list) or len(pose) != 3 or not all(isinstance(x, (int, float)) for x in pose):
            raise Refused(f"the pose of {link.name} is missing", (f"links.{link.name}",), "at")
        x, y, theta = map(float, pose)
        centre = complex(x, y) + rect(1.0, theta) * complex(*link.com)
        q += [centre.real, centre.imag, theta]
    return np.array(q)
