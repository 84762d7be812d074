"""Export as MJCF: the model of MuJoCo's adapter as a document, with a comment that explains it."""

from xml.etree.ElementTree import Comment, indent, tostring

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.text import xml_comment
from gauss_bench.mechanism.model import Mechanism


def write(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """Return the document.

    Raises:
        RunFailure: MJCF cannot hold the mechanism.
        ImportError: MuJoCo is not installed.
    """
    from gauss_bench.engines.mujoco.mjcf import START, mjcf

    root = mjcf(mechanism, choice)
    closure = root.find("equality/connect")
    soft = "" if closure is None else f" solref {closure.get('solref')}, solimp {closure.get('solimp')}."
    lines = [
        *head,
        "Bodies are links, with their frames at the centres of mass; loops are opened at joints and closed by connect constraints.",
        f"The start is the keyframe {START!r}: mj_resetDataKeyframe(model, data, 0).",
        f"Settings: {choice.settings}, {choice.integrator}, step {choice.step:g} s.{soft}",
        "solref is two steps: if you change the step, change both (MuJoCo raises a smaller solref to two steps).",
    ]
    root.insert(0, Comment(xml_comment(lines)))
    indent(root)
    return tostring(root, encoding="unicode") + "\n"
