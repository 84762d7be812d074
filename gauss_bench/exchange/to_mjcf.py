"""Export as MJCF: write the model that MuJoCo's adapter builds as a document, with an explanatory comment."""

from collections.abc import Collection
from xml.etree.ElementTree import Comment, Element, indent, tostring

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.text import xml_comment
from gauss_bench.mechanism.model import Mechanism, PointForce, Torque


def write(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """Return the text of the MJCF document.

    Raises:
        RunFailure: MJCF cannot express the mechanism.
        ImportError: MuJoCo is not installed.
    """
    from gauss_bench.engines.mjcf.document import START, write_document
    from gauss_bench.engines.mujoco.adapter import MujocoModel

    document = write_document(MujocoModel(mechanism, choice))
    root = document.root
    closure = root.find("equality/connect")
    soft = "" if closure is None else f" solref {closure.get('solref')}, solimp {closure.get('solimp')}."
    lines = [
        *head,
        "Bodies are links, with their frames at the centres of mass; loops are opened at joints and closed by connect constraints.",
        f"The start is the keyframe {START!r}: mj_resetDataKeyframe(model, data, 0).",
        *describe_controls(root, mechanism, document.controlled),
        f"Settings: {choice.settings}, {choice.integrator}, step {choice.step:g} s.{soft}",
        "solref is two steps: if you change the step, change both (MuJoCo raises a smaller solref to two steps).",
    ]
    root.insert(0, Comment(xml_comment(lines)))
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def describe_controls(root: Element, mechanism: Mechanism, controlled: Collection[str]) -> list[str]:
    """Return sentences on a document's motors and on forces that no control changes; motors express the forces `controlled`."""
    actuators, key = root.findall("actuator/*"), root.find("keyframe/key")
    controls = [] if key is None else [float(x) for x in key.get("ctrl", "").split()]
    slides = {joint.get("name") for joint in root.iter("joint") if joint.get("type") == "slide"}
    motors: list[str] = []
    for actuator, control in zip(actuators, controls, strict=True):
        if actuator.tag == "motor":
            is_force = actuator.get("site") or actuator.get("joint") in slides  # other motors are torques
            motors.append(f"{actuator.get('name')} = {control:g} {'N' if is_force else 'N m'}")
    constant = [f.name for f in mechanism.forces if isinstance(f, (Torque, PointForce))]
    fixed = [name for name in constant if name not in controlled]
    # the adapter writes a spring along an axis as a <general> actuator of the spring's name
    general = {x.get("name") for x in actuators if x.tag == "general"}
    springs = [f.name for f in mechanism.forces if f.name in general and f.name not in constant]
    sentences: list[str] = []
    if motors:
        sentences.append(f"Motors: {', '.join(motors)}. These are the ctrl of the keyframe: change ctrl to drive them.")
    if fixed:
        sentences.append(f"No ctrl changes {', '.join(fixed)}: it has no effect here, or no single motor of MJCF expresses it.")
    if springs:
        sentences.append(f"No ctrl changes {', '.join(springs)}: springs along an axis are actuators in MJCF.")
    return sentences
