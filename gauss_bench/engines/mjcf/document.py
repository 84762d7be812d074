"""Write a built model as an MJCF document that runs in MuJoCo without this suite.

Trap: MuJoCo's own writer keeps six digits, which are too few for closed loops. This module writes all digits, lets MuJoCo read the
document, and compares the accelerations with those of the built model.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mjcf.draft import Draft
from gauss_bench.engines.mjcf.drives import Drive, set_armatures
from gauss_bench.engines.shared import require_agreement, size, spatial, tree_states
from gauss_bench.engines.tree import Tree
from gauss_bench.mechanism.model import GROUND, Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

AGREEMENT = 1e-9  # largest relative difference of accelerations: MuJoCo computes both from the same numbers
THICKNESS = 0.02  # thickness of a drawn bar, relative to the longest bar
START = "start"  # name of the keyframe
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
    """
    mechanism = built.mechanism
    if mechanism.drivers and not edited:
        names = ", ".join(d.name for d in mechanism.drivers)
        raise RunFailure(Status.SKIP, f"MJCF has no motion laws, and this scenario prescribes {names}")
    if built.options["body_invweight0_factor"] != 1.0 and not edited:
        raise RunFailure(Status.SKIP, "MJCF cannot scale the compiled inverse weights, as these settings do")
    root = Element("mujoco", model=mechanism.name)
    SubElement(root, "compiler", angle="radian", autolimits="true")
    _add_option(root, built)
    draft = Draft(built.mujoco, mechanism, built.tree)
    controlled = draft.add_motors()
    _Writer(built, draft).add_model(root)
    start = {"qpos": write_numbers(built.y0), "qvel": write_numbers(built.dy0)}
    if draft.spec.actuators:
        start["ctrl"] = write_numbers([draft.controls.get(x.name, 0.0) for x in draft.spec.actuators])
    SubElement(SubElement(root, "keyframe"), "key", start, name=START)
    _verify(root, built)
    return Document(root, tuple(controlled))


def write_numbers(x: Any) -> str:
    """Return numbers in full precision, separated by spaces."""
    return " ".join(repr(float(value)) for value in np.atleast_1d(x))


def draw(mechanism: Mechanism, link: int) -> list[tuple[Array, Array]]:
    """Return the two end points (2,) [m] of each bar of a link, in the frame of its centre of mass; none for the ground."""
    bars = () if link == GROUND else mechanism.links[link].bars
    return [(mechanism.point(link, a).local, mechanism.point(link, b).local) for a, b in bars]


def _add_option(root: Element, built: Built) -> None:
    mujoco, opt, integrator = built.mujoco, built.model.opt, built.choice.integrator or "rk4"
    option = SubElement(
        root,
        "option",
        timestep=write_numbers(opt.timestep),
        gravity=write_numbers(opt.gravity),
        integrator=INTEGRATORS.get(integrator, integrator),
        solver=built.options["solver"],
        jacobian=built.options["jacobian"],
        tolerance=write_numbers(opt.tolerance),
        iterations=str(opt.iterations),
    )
    flags = {name: int(bit) for name, bit in mujoco.mjtDisableBit.__members__.items() if name.startswith("mjDSBL_")}
    disabled = [name for name, bit in flags.items() if opt.disableflags & bit]
    SubElement(option, "flag", {name.removeprefix("mjDSBL_").lower(): "disable" for name in sorted(disabled)})


class _Writer:
    """Writes the parts of a draft as elements of a document, with the softness of closures from the built model."""

    def __init__(self, built: Built, draft: Draft):
        """Prepare to write a compiled model; bars are drawn as shapes that take part in no collision, sized by the longest bar."""
        self.mujoco, self.mechanism, self.model, self.spec = built.mujoco, built.mechanism, built.model, draft.spec
        self.links = {draft.bodies[i].name: i for i in range(len(self.mechanism.links))}
        bars = [bar for link in range(len(self.mechanism.links)) for bar in draw(self.mechanism, link)]
        longest = max((float(np.linalg.norm(b - a)) for a, b in bars), default=1.0)
        self.look = {"size": write_numbers(THICKNESS * longest), "contype": "0", "conaffinity": "0", "group": "1"}

    def add_model(self, root: Element) -> None:
        """Add all bodies, closures, tendons and actuators to a document."""
        self._add_body(SubElement(root, "worldbody"), self.spec.worldbody)
        closures = [
            Element("connect", solref=write_numbers(solref), solimp=write_numbers(solimp), site1=x.name1, site2=x.name2)
            for x, solref, solimp in zip(self.spec.equalities, self.model.eq_solref, self.model.eq_solimp, strict=True)
        ]
        lists = {"equality": closures, "tendon": [*self._tendons()], "actuator": [*self._actuators()]}
        for name, elements in lists.items():
            if elements:
                SubElement(root, name).extend(elements)

    def _add_body(self, node: Element, body: Any) -> None:
        """Write a body into the XML element `node`: its joints, its sites, geometry for viewers, and its child bodies."""
        kinds = {self.mujoco.mjtJoint.mjJNT_HINGE: "hinge", self.mujoco.mjtJoint.mjJNT_SLIDE: "slide"}
        for joint in body.joints:
            written = {"axis": write_numbers(joint.axis), "pos": write_numbers(joint.pos), "ref": write_numbers(joint.ref)}
            if joint.stiffness[0]:
                written |= {"stiffness": write_numbers(joint.stiffness[0]), "springref": write_numbers(joint.springref)}
            if joint.damping[0]:
                written["damping"] = write_numbers(joint.damping[0])
            SubElement(node, "joint", written, name=joint.name, type=kinds[joint.type])
        sites = {site.name: site.pos for site in body.sites}  # those of forces and closures, and then all points of the link
        link = self.links.get(body.name, GROUND)
        names = self.mechanism.ground_points if link == GROUND else self.mechanism.links[link].points
        for name in names:
            point = self.mechanism.point(link, name)
            sites.setdefault(point.name, spatial(point.local))
        for name, place in sites.items():
            SubElement(node, "site", name=name, pos=write_numbers(place))
        for a, b in draw(self.mechanism, link):
            SubElement(node, "geom", self.look, type="capsule", fromto=write_numbers([*spatial(a), *spatial(b)]))
        for child in body.bodies:
            inner = SubElement(node, "body", name=child.name, pos=write_numbers(child.pos), quat=write_numbers(child.quat))
            moments = write_numbers(child.inertia)
            SubElement(inner, "inertial", pos=write_numbers(child.ipos), mass=write_numbers(child.mass), diaginertia=moments)
            self._add_body(inner, child)

    def _tendons(self) -> Iterator[Element]:
        for tendon in self.spec.tendons:
            fixed = tendon.path[0].type == self.mujoco.mjtWrap.mjWRAP_JOINT
            force = {"stiffness": write_numbers(tendon.stiffness[0]), "damping": write_numbers(tendon.damping[0])}
            node = Element("fixed" if fixed else "spatial", force, springlength=write_numbers(tendon.springlength))
            if tendon.name:
                node.set("name", tendon.name)
            for part in tendon.path:
                if fixed:
                    SubElement(node, "joint", joint=part.target.name, coef=write_numbers(part.coef))
                else:
                    SubElement(node, "site", site=part.target.name)
            yield node

    def _actuators(self) -> Iterator[Element]:
        """Yield motors, and springs along an axis.

        A spring's force is a linear function of the transmission's length and its rate.
        """
        kinds = self.mujoco.mjtTrn
        targets = {kinds.mjTRN_JOINT: "joint", kinds.mjTRN_TENDON: "tendon", kinds.mjTRN_SITE: "site"}
        for actuator in self.spec.actuators:
            target = targets[actuator.trntype]
            gear = actuator.gear if target == "site" else actuator.gear[:1]  # at a site, the first two give the direction
            written = {target: actuator.target, "gear": write_numbers(gear)}
            written |= {key: getattr(actuator, key) for key in ("name", "refsite") if getattr(actuator, key)}
            if actuator.biastype == self.mujoco.mjtBias.mjBIAS_NONE:
                yield Element("motor", written)
            else:
                bias = write_numbers(actuator.biasprm[:3])
                yield Element("general", written, gainprm="0", biastype="affine", biasprm=bias)


def _verify(root: Element, built: Built) -> None:
    """Let MuJoCo read the document, and compare its accelerations with those of the built model at states near the start.

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
