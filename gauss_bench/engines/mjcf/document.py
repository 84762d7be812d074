"""Write a built model as an MJCF document that runs in MuJoCo without this suite.

The document is a `Draft` to which the options, the start and shapes for viewers are added. Its accelerations in MuJoCo are compared
with those of the built model.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mjcf.draft import Draft, write_numbers
from gauss_bench.engines.mjcf.drives import Drive, set_armatures
from gauss_bench.engines.shared import require_agreement, size, spatial, tree_states
from gauss_bench.engines.tree import Tree
from gauss_bench.mechanism.model import GROUND, Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

AGREEMENT = 1e-9  # largest relative difference of accelerations: MuJoCo computes both from the same numbers
THICKNESS = 0.02  # radius of a drawn bar, relative to the length of the longest
START = "start"  # name of the keyframe that has the mechanism's start
INTEGRATORS = {"rk4": "RK4", "euler": "Euler"}  # engine's name -> name in MJCF, for those that differ


class Built(Protocol):
    """The members of an engine's built model that the MJCF document needs.

    Attributes:
        options: name of an option of the engine -> value.
        y0, dy0: tree coordinates and rates (n,) at the start.
        model: MuJoCo's compiled model.
        still: a copy of `model` that only evaluates accelerations at given states.
    """

    mujoco: Any
    mechanism: Mechanism
    choice: Choice
    options: Mapping[str, Any]
    tree: Tree
    y0: Array
    dy0: Array
    model: Any
    still: Any

    @property
    def drives(self) -> Sequence[Drive]: ...

    def forward(self, y: Array, dy: Array) -> Any:
        """Evaluate the model `still` at a tree state y, dy (n,) and t = 0, and return MuJoCo's data, with the accelerations."""
        ...


@dataclass(frozen=True)
class Document:
    """An MJCF document, and the names of the linkage's forces whose values are controls in the document's keyframe."""

    root: Element
    controlled: tuple[str, ...]


def write_document(built: Built, edited: bool = False) -> Document:
    """Return an MJCF document with the mechanism, its start as the keyframe START, and the options of the engine's setting.

    Constant forces become motors. The attribute `ctrl` of the keyframe has the values of the constant forces.

    Args:
        edited: whether the caller adds motion laws and scaled inverse weights to the compiled model, as an exported script does;
            otherwise a mechanism that needs them is refused, because MJCF cannot express them.

    Raises:
        RunFailure: MJCF cannot express the mechanism or the setting, or MuJoCo's model of the document differs.
    """
    mechanism = built.mechanism
    if mechanism.drivers and not edited:
        names = ", ".join(d.name for d in mechanism.drivers)
        raise RunFailure(Status.SKIP, f"MJCF has no motion laws, and this scenario prescribes {names}")
    if built.options["body_invweight0_factor"] != 1.0 and not edited:
        raise RunFailure(Status.SKIP, "MJCF cannot scale the compiled inverse weights, as these settings do")
    draft = Draft(mechanism, built.tree)
    root, controlled = draft.root, draft.add_motors()
    _set_options(draft, built)
    _add_shapes(draft)
    start = {"qpos": write_numbers(built.y0), "qvel": write_numbers(built.dy0)}
    if len(draft.actuators):
        start["ctrl"] = write_numbers([draft.controls.get(x.get("name", ""), 0.0) for x in draft.actuators])
    for element in (draft.closures, draft.tendons, draft.actuators):
        if not len(element):  # without children
            root.remove(element)
    SubElement(SubElement(root, "keyframe"), "key", start, name=START)
    _verify(root, built)
    return Document(root, tuple(controlled))


def _set_options(draft: Draft, built: Built) -> None:
    """Set the options of a draft, and the softness of its closures, to those of the built model."""
    mujoco, model, integrator = built.mujoco, built.model, built.choice.integrator or "rk4"
    draft.option.attrib |= {
        "timestep": write_numbers(model.opt.timestep),
        "integrator": INTEGRATORS.get(integrator, integrator),
        "solver": built.options["solver"],
        "jacobian": built.options["jacobian"],
        "tolerance": write_numbers(model.opt.tolerance),
        "iterations": str(model.opt.iterations),
    }
    flags = {name: int(bit) for name, bit in mujoco.mjtDisableBit.__members__.items() if name.startswith("mjDSBL_")}
    disabled = [name for name, bit in flags.items() if model.opt.disableflags & bit]
    SubElement(draft.option, "flag", {name.removeprefix("mjDSBL_").lower(): "disable" for name in sorted(disabled)})
    for closure, solref, solimp in zip(draft.closures, model.eq_solref, model.eq_solimp, strict=True):
        closure.attrib |= {"solref": write_numbers(solref), "solimp": write_numbers(solimp)}


def find_bar_ends(mechanism: Mechanism, link: int) -> list[tuple[Array, Array]]:
    """Return the two end points (2,) [m] of each bar of a link, in the frame of its centre of mass; none for the ground."""
    bars = () if link == GROUND else mechanism.links[link].bars
    return [(mechanism.point(link, a).local, mechanism.point(link, b).local) for a, b in bars]


def _add_shapes(draft: Draft) -> None:
    """Add a site at each point of a link, and for each bar a capsule that collides with nothing."""
    mechanism = draft.mechanism
    bars = {link: find_bar_ends(mechanism, link) for link in draft.bodies}
    longest = max((float(np.linalg.norm(b - a)) for link in bars for a, b in bars[link]), default=1.0)
    style = {"size": write_numbers(THICKNESS * longest), "contype": "0", "conaffinity": "0", "group": "1"}
    for link, body in draft.bodies.items():
        present = {site.get("name") for site in body.findall("site")}  # sites of forces and closures
        for name in mechanism.ground_points if link == GROUND else mechanism.links[link].points:
            point = mechanism.point(link, name)
            if point.name not in present:
                SubElement(body, "site", name=point.name, pos=write_numbers(spatial(point.local)))
        for a, b in bars[link]:
            SubElement(body, "geom", style, type="capsule", fromto=write_numbers([*spatial(a), *spatial(b)]))
        body[:] = sorted(body, key=lambda x: x.tag == "body")  # readers see all of a body before its child bodies


def _verify(root: Element, built: Built) -> None:
    """Compare MuJoCo's accelerations of the document with those of the built model, at the start and at random tree states.

    Raises:
        RunFailure: the start state or the accelerations of the model that MuJoCo reads differ from those of the built model.
    """
    mujoco = built.mujoco
    # armatures of drives and the factor on inverse weights are set on the compiled model, as in an exported script; integrator and
    # flags are those of `still`
    model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
    set_armatures(mujoco, model, built.drives)
    model.body_invweight0[:] *= built.options["body_invweight0_factor"]
    model.opt.integrator, model.opt.disableflags = built.still.opt.integrator, built.still.opt.disableflags
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    # tolerance 0.0: the document has all digits of the start
    require_agreement({"start": (np.concatenate([data.qpos, data.qvel]), np.concatenate([built.y0, built.dy0]), 1.0)}, 0.0)
    for drive in built.drives:
        drive.push(data, 0.0)
    for y, dy in tree_states(built.tree, built.y0, built.dy0):
        data.qpos[:], data.qvel[:] = y, dy
        mujoco.mj_forward(model, data)
        wanted = np.array(built.forward(y, dy).qacc)
        require_agreement({"accelerations of the document": (np.array(data.qacc), wanted, size(wanted))}, AGREEMENT)
