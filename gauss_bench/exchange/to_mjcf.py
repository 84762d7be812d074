"""MJCF: the model of MuJoCo's adapter as a document, with what there is to tell in a comment."""

from xml.etree.ElementTree import Comment, indent, tostring

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.text import xml_comment
from gauss_bench.mechanism.model import Mechanism


def written(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """The document.

    Raises:
        RunFailure: MJCF cannot hold the mechanism.
        ImportError: MuJoCo is not installed.
    """
    from gauss_bench.engines.mujoco.mjcf import START, mjcf

    root = mjcf(mechanism, choice)
    told = [
        *head,
        "Bodies are links, with their frames at the centres of mass; joints open the loops, which connect constraints close again.",
        f"The start is the keyframe {START!r}: mj_resetDataKeyframe(model, data, 0).",
        f"Settings: {choice.integrator}, step {choice.step:g} s, solref of two steps, impedance 0.9999, features not used are off.",
        "solref goes with the step: whoever changes the one changes the other (a solref below two steps is raised to that).",
    ]
    root.insert(0, Comment(xml_comment(told)))
    indent(root)
    return tostring(root, encoding="unicode") + "\n"
