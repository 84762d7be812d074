"""The adapter's model as an MJCF document that runs in MuJoCo without this suite.

MuJoCo's own writer keeps six digits, too few for closed loops, so every number is written here in full. MuJoCo reads the document
back, and its accelerations are compared with those of the adapter's model.
"""

from collections.abc import Callable, Iterator
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mujoco.adapter import MujocoModel
from gauss_bench.engines.mujoco.draft import Draft
from gauss_bench.engines.shared import require_agreement, size, spatial, tree_states
from gauss_bench.mechanism.model import GROUND, Mechanism, Point
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

AGREEMENT = 1e-9  # relative, of accelerations: both are MuJoCo's, of the same numbers
THICKNESS = 0.02  # thickness of a drawn bar, relative to the longest bar
START = "start"  # name of the keyframe
SPELT = {  # MuJoCo's name of an integrator or solver -> its spelling in a document
    "mjINT_RK4": "RK4",
    "mjINT_EULER": "Euler",
    "mjINT_IMPLICITFAST": "implicitfast",
    "mjINT_DISCRETE": "discrete",
    "mjSOL_NEWTON": "Newton",
    "mjSOL_CG": "CG",
    "mjSOL_PGS": "PGS",
}


def mjcf(mechanism: Mechanism, choice: Choice, edited: bool = False) -> Element:
    """Return the root of a document that holds the mechanism, its start as the keyframe START, and the choice's options.

    A document cannot hold motion laws or scaled inverse weights. With `edited` the caller promises to add these to the compiled
    model, as an exported script does; without it such a mechanism is refused.

    Raises:
        RunFailure: MuJoCo cannot model the mechanism, or a document cannot hold it.
        ImportError: MuJoCo is not installed.
    """
    if mechanism.drivers and not edited:
        names = ", ".join(d.name for d in mechanism.drivers)
        raise RunFailure(Status.SKIP, f"MJCF has no motion laws, and this scenario prescribes {names}")
    built = MujocoModel(mechanism, choice)
    if built.options["body_invweight0_factor"] != 1.0 and not edited:
        raise RunFailure(Status.SKIP, "MJCF cannot scale the compiled inverse weights, as these settings do")
    draft = Draft(built.mujoco, mechanism, built.tree)
    draft.hold_torque()
    root = Element("mujoco", model=mechanism.name)
    SubElement(root, "compiler", angle="radian", autolimits="true")
    root.append(_option(built))
    world = SubElement(root, "worldbody")
    lines = {link: draw(mechanism, link) for link in range(GROUND, len(mechanism.links))}
    thickness = THICKNESS * max((float(np.linalg.norm(b - a)) for pairs in lines.values() for a, b in pairs), default=1.0)
    links = {draft.bodies[i].name: i for i in range(len(mechanism.links))}

    def decorate(node: Element) -> None:
        link = links.get(node.get("name", ""), GROUND)
        _points(node, mechanism, link)
        for a, b in lines[link]:
            look = {"size": said(thickness), "contype": "0", "conaffinity": "0", "group": "1"}
            SubElement(node, "geom", look, type="capsule", fromto=said([*spatial(a), *spatial(b)]))

    _body(world, draft.spec.worldbody, built.mujoco, decorate)
    _list(root, "equality", _closures(draft.spec, built.model))
    _list(root, "tendon", _tendons(draft.spec, built.mujoco))
    _list(root, "actuator", _actuators(draft.spec, built.mujoco))
    key = {"qpos": said(built.y0), "qvel": said(built.dy0)}
    SubElement(SubElement(root, "keyframe"), "key", key, name=START)
    _verify(root, built)
    return root


def said(x: Any) -> str:
    """Write numbers in full precision, separated by spaces."""
    return " ".join(repr(float(value)) for value in np.atleast_1d(x))


def draw(mechanism: Mechanism, link: int) -> list[tuple[Array, Array]]:
    """Return the end points (2,) of each of a link's bars, in the frame of its centre of mass [m]."""
    bars = () if link == GROUND else mechanism.links[link].bars
    return [(mechanism.point(link, a).local, mechanism.point(link, b).local) for a, b in bars]


def _points(node: Element, mechanism: Mechanism, link: int) -> None:
    """Add the named points of a link as sites, except those that a force or closure has added already."""
    there = {site.get("name") for site in node.findall("site")}
    names = mechanism.ground_points if link == GROUND else mechanism.links[link].points
    for name in names:
        point: Point = mechanism.point(link, name)
        if point.name not in there:
            SubElement(node, "site", name=point.name, pos=said(spatial(point.local)))


def _option(built: MujocoModel) -> Element:
    """Return the <option> element with the options that the adapter has set in the compiled model."""
    mujoco, opt = built.mujoco, built.model.opt
    option = Element(
        "option",
        timestep=said(opt.timestep),
        gravity=said(opt.gravity),
        integrator=SPELT[mujoco.mjtIntegrator(opt.integrator).name],
        solver=SPELT[mujoco.mjtSolver(opt.solver).name],
        jacobian=mujoco.mjtJacobian(opt.jacobian).name.removeprefix("mjJAC_").lower(),
        tolerance=said(opt.tolerance),
        iterations=str(opt.iterations),
    )
    bits = {name: int(bit) for name, bit in mujoco.mjtDisableBit.__members__.items() if name.startswith("mjDSBL_")}
    off = {name.removeprefix("mjDSBL_").lower(): "disable" for name, bit in sorted(bits.items()) if opt.disableflags & bit}
    SubElement(option, "flag", off)
    return option


def _body(node: Element, body: Any, mujoco: Any, decorate: Callable[[Element], None]) -> None:
    """Write a body of the specification into `node`: its joints and sites, the geometry for viewers, and its child bodies."""
    kinds = {mujoco.mjtJoint.mjJNT_HINGE: "hinge", mujoco.mjtJoint.mjJNT_SLIDE: "slide"}
    for joint in body.joints:
        more = {"stiffness": said(joint.stiffness[0]), "springref": said(joint.springref)} if joint.stiffness[0] else {}
        more |= {"damping": said(joint.damping[0])} if joint.damping[0] else {}
        where = {"axis": said(joint.axis), "pos": said(joint.pos), "ref": said(joint.ref)}
        SubElement(node, "joint", where | more, name=joint.name, type=kinds[joint.type])
    for site in body.sites:
        SubElement(node, "site", name=site.name, pos=said(site.pos))
    decorate(node)
    for child in body.bodies:
        inner = SubElement(node, "body", name=child.name, pos=said(child.pos), quat=said(child.quat))
        SubElement(inner, "inertial", pos=said(child.ipos), mass=said(child.mass), diaginertia=said(child.inertia))
        _body(inner, child, mujoco, decorate)


def _closures(spec: Any, model: Any) -> Iterator[Element]:
    for k, closure in enumerate(spec.equalities):
        softness = {"solref": said(model.eq_solref[k]), "solimp": said(model.eq_solimp[k])}
        yield Element("connect", softness, site1=closure.name1, site2=closure.name2)


def _tendons(spec: Any, mujoco: Any) -> Iterator[Element]:
    for tendon in spec.tendons:
        fixed = tendon.path[0].type == mujoco.mjtWrap.mjWRAP_JOINT
        force = {"stiffness": said(tendon.stiffness[0]), "damping": said(tendon.damping[0])}
        node = Element("fixed" if fixed else "spatial", force, springlength=said(tendon.springlength))
        node.attrib |= {"name": tendon.name} if tendon.name else {}
        for part in tendon.path:
            if fixed:
                SubElement(node, "joint", joint=part.target.name, coef=said(part.coef))
            else:
                SubElement(node, "site", site=part.target.name)
        yield node


def _actuators(spec: Any, mujoco: Any) -> Iterator[Element]:
    """Yield the actuators: force gain u + bias . [1, L, dL/dt], where the gain is zero unless a length is driven."""
    on = {mujoco.mjtTrn.mjTRN_JOINT: "joint", mujoco.mjtTrn.mjTRN_TENDON: "tendon", mujoco.mjtTrn.mjTRN_SITE: "site"}
    for actuator in spec.actuators:
        where = {on[actuator.trntype]: actuator.target, "gear": said(actuator.gear)}
        where |= {key: x for key, x in (("name", actuator.name), ("refsite", actuator.refsite)) if x}
        yield Element("general", where, gainprm=said(actuator.gainprm[0]), biastype="affine", biasprm=said(actuator.biasprm[:3]))


def _list(root: Element, name: str, items: Iterator[Element]) -> None:
    elements = list(items)
    if elements:
        SubElement(root, name).extend(elements)


def _verify(root: Element, built: MujocoModel) -> None:
    """Have MuJoCo read the document, and compare its accelerations with those of the adapter's model at states near the start.

    Raises:
        RunFailure: the start or the accelerations differ.
    """
    mujoco = built.mujoco
    # Settings that a document cannot hold are repeated on the compiled model, as the exported script does.
    model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
    for k, armature, _ in built.drives:
        model.dof_armature[k] = armature
    for (tendon, _), (_, mass, _) in zip(built.drawn, built.cylinders, strict=True):
        model.tendon_armature[tendon] = mass
    mujoco.mj_setConst(model, mujoco.MjData(model))
    model.body_invweight0[:] *= built.options["body_invweight0_factor"]
    model.opt.integrator, model.opt.disableflags = built.still.opt.integrator, built.still.opt.disableflags
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    require_agreement({"start": (np.concatenate([data.qpos, data.qvel]), np.concatenate([built.y0, built.dy0]), 1.0)}, 0.0)
    for k, armature, law in built.drives:
        data.qfrc_applied[k] = armature * float(law(0.0)[2])
    for motor, mass, law in built.cylinders:
        data.ctrl[motor] = mass * float(law(0.0)[2])
    for y, dy in tree_states(built.tree, built.y0, built.dy0):
        data.qpos[:], data.qvel[:] = y, dy
        mujoco.mj_forward(model, data)
        wanted = np.array(built.forward(y, dy).qacc)
        require_agreement({"accelerations of the document": (np.array(data.qacc), wanted, size(wanted))}, AGREEMENT)
