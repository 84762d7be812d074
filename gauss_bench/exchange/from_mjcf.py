"""Import of MJCF: from the model that MuJoCo compiles from a document to a mechanism in space.

Elements that a linkage cannot have are refused. Elements that do not change its motion are listed as left out.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import numpy as np
from scipy.spatial.transform import Rotation

from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.safe_xml import refuse_bulk, refuse_files
from gauss_bench.exchange.spatial import Acting, Between, Body, Joint, OnJoints, Push, Spatial, Spot, Straight
from gauss_bench.exchange.unused import FIELDS, list_names, list_unused
from gauss_bench.terms import Array

NEEDED = {"constraint", "equality", "spring", "damper", "actuation", "passive"}  # features that must not be disabled
START = "start"  # name of the preferred keyframe
TAGS = {"jnt": "joint"}  # MuJoCo's name of a kind of element -> its tag in a file, if they differ


def from_mjcf(root: Element, path: Path) -> Spatial:
    """Return the mechanism of a document that `read_xml` has accepted.

    Raises:
        ExchangeError: MuJoCo rejects the document, or it holds an element that a linkage cannot have.
        ImportError: MuJoCo is not installed.
    """
    from gauss_bench.engines.mujoco.compiled import DoesNotCompile, compile_document

    refuse_files(root, path)
    refuse_bulk(root, path)
    try:  # the inspected tree is written anew: MuJoCo's parser might read the file's bytes differently
        x = compile_document(tostring(root, encoding="unicode"))
    except DoesNotCompile as error:
        raise ExchangeError(f"{path}: MuJoCo does not compile it: {' '.join(str(error).split())}") from error
    spatial = Reader(x, str(path)).spatial()
    return replace(spatial, dropped=(*spatial.dropped, *list_unused(root)))


class Reader:
    """A reader of a compiled document.

    Attributes:
        x: the result of `engines.mujoco.compiled.compile_document`, with MuJoCo's names of the fields.
        dropped: sentences on elements that are left out.
        key: number of the keyframe that is the start.
    """

    def __init__(self, x: dict[str, Any], file: str):
        self.x, self.file = x, file
        self.dropped: list[str] = []
        self.key = next((k for k, name in enumerate(x["names"]["key"]) if name == START), 0)

    def refuse(self, element: str, reason: str) -> ExchangeError:
        return ExchangeError(f"{self.file}: {element}: {reason}")

    def describe(self, kind: str, k: int, tag: str | None = None) -> str:
        """Return an element as a message names it: by its name, or by its number if it has no name."""
        name, tag = self.x["names"][kind][k], tag or TAGS.get(kind, kind)
        return f'<{tag} name="{name}">' if name else f"<{tag}> number {k + 1}"

    def name(self, kind: str, k: int) -> str:
        return self.x["names"][kind][k] or f"{kind}{k}"

    def word(self, kind: str, number: Any) -> str:
        """Return MuJoCo's word for a number of an enumeration, such as "hinge"."""
        return str(self.x["types"][kind][str(int(number))])

    def spatial(self) -> Spatial:
        """Return the mechanism of the whole document.

        Raises:
            ExchangeError: the document holds an element that a linkage cannot have.
        """
        x = self.x
        self._check_document()
        joints = tuple(self._joint(k) for k in range(x["njnt"]))
        for known in FIELDS["refused"]:
            for k in range(len(x["names"][known["kind"]])):
                if any(np.any(x[field][k]) for field in known["fields"]):
                    raise self.refuse(self.describe(known["kind"], k), known["reason"])
        for known in FIELDS["left_out"]:
            set_ones = np.flatnonzero(x[known["fields"][0]])
            self.dropped += [f"{known['reason']} {self.name(known['kind'], int(k))}" for k in set_ones]
        closures, welds = self._equalities()
        acting = [*self._springs(), *self._tendons(), *(self._actuator(k) for k in self._enabled_actuators())]
        gravity = np.zeros(3) if "gravity" in x["disabled"] else x["gravity"]
        bodies = tuple(self._body(k) for k in range(len(x["body_mass"])))
        spots = tuple(self._site(k) for k in range(x["nsite"]))
        return Spatial(self.file, bodies, joints, gravity, tuple(closures), tuple(welds), spots, tuple(acting), tuple(self.dropped))

    def _check_document(self) -> None:
        """Refuse or list the properties of the document as a whole: media, flags, contacts, keyframes, sensors."""
        x = self.x
        if x["nflex"] or x["nplugin"]:
            raise self.refuse("<mujoco>", "a linkage has no flexible bodies and plug-ins")
        if any(x["medium"]):
            raise self.refuse("<option>", "a medium with density or viscosity")
        disabled = NEEDED & {*x["disabled"]}
        if disabled:
            raise self.refuse("<flag>", f"{min(disabled)} is disabled, so that the model does not behave as its elements say")
        if (x["body_mocapid"] >= 0).any():
            raise self.refuse(self.describe("body", int(x["body_mocapid"].argmax())), "a motion capture body")
        touching = [x["names"]["geom"][int(k)] for k in np.flatnonzero(x["geom_contype"] | x["geom_conaffinity"])]
        contacts = len(touching) + x["npair"]
        if contacts and "contact" not in x["disabled"]:
            geoms = f" (<geom> {list_names(touching)})" if touching else ""
            self.dropped.append(f"contacts of {contacts} geoms and pairs{geoms}: bodies pass through each other")
        if x["nkey"] > 1:
            others = [name for k, name in enumerate(x["names"]["key"]) if k != self.key]
            start = self.name("key", self.key)
            self.dropped.append(f"keyframes other than {start!r}, which is the start: <key> {list_names(others)}")
        if x["nsensor"]:
            kinds = [self.word("sensor", kind) for kind in x["sensor_type"]]
            names = list_names([f"<{kind}> {name}".strip() for kind, name in zip(kinds, x["names"]["sensor"], strict=True)])
            self.dropped.append(f"{x['nsensor']} sensors: {names}")

    def _joint(self, k: int) -> Joint:
        """Return a joint; its start is that of the keyframe, if there is one.

        Raises:
            ExchangeError: the joint is neither a hinge nor a slide.
        """
        x, kind = self.x, self.word("jnt", self.x["jnt_type"][k])
        if kind not in ("hinge", "slide"):
            raise self.refuse(self.describe("jnt", k), f"a {kind} joint does not move in a plane")
        start, speed = (x["key_qpos"][self.key][k], x["key_qvel"][self.key][k]) if x["nkey"] else (x["qpos0"][k], 0.0)
        return Joint(
            self.name("jnt", k),
            kind,
            body=int(x["jnt_bodyid"][k]),
            anchor=x["xanchor"][k],
            axis=x["xaxis"][k],
            ref=float(x["qpos0"][k]),
            start=float(start),
            speed=float(speed),
            armature=float(x["dof_armature"][k]),
        )

    def _body(self, k: int) -> Body:
        x, parent = self.x, int(self.x["body_parentid"][k])
        mass, com, inertia = float(x["body_mass"][k]), x["xipos"][k], x["inertia"][k]
        return Body(self.name("body", k), parent, x["xpos"][k], x["xmat"][k], mass, com, inertia)

    def _site(self, k: int) -> Spot:
        return Spot(self.name("site", k), int(self.x["site_bodyid"][k]), self.x["site_xpos"][k])

    def _equalities(self) -> tuple[list[tuple[str, Spot, Spot]], list[tuple[int, int]]]:
        """Return the closures, by name and points, and the welds, by bodies.

        Raises:
            ExchangeError: an equality does not close a linkage.
        """
        x, closures, welds = self.x, list[tuple[str, Spot, Spot]](), list[tuple[int, int]]()
        for k in range(x["neq"]):
            kind = self.word("eq", x["eq_type"][k])
            element, name = self.describe("eq", k, kind), x["names"]["eq"][k] or f"{kind}{k + 1}"
            if not x["eq_active0"][k]:
                self.dropped.append(f"equality {name}, which is not active")
                continue
            if kind not in ("connect", "weld"):
                raise self.refuse(element, "only connect and weld close a linkage")
            (a, turn_a), (b, turn_b) = self._ends(k, kind, name)
            if kind == "connect":
                closures.append((name, a, b))
                continue
            if np.abs(a.place - b.place).max() > 1e-6 or np.abs(turn_a - turn_b).max() > 1e-6:
                raise self.refuse(element, "its bodies are not in the pose of the weld when the joints are at their references")
            welds.append((a.body, b.body))
        return closures, welds

    def _ends(self, k: int, kind: str, name: str) -> list[tuple[Spot, Array]]:
        """Return the two points that an equality joins, each with axes (3, 3), which a weld makes parallel."""
        x = self.x
        a, b = int(x["eq_obj1id"][k]), int(x["eq_obj2id"][k])
        if x["eq_objtype"][k] == x["site_object"]:
            return [(self._site(i), x["site_xmat"][i]) for i in (a, b)]
        at_a, at_b, turn = x["eq_data"][k][:3], x["eq_data"][k][3:6], np.eye(3)
        if kind == "weld":
            # MuJoCo gives a weld's anchor in the second body first, and its pose as that of the second body in the first
            at_a, at_b = at_b, at_a
            turn = Rotation.from_quat(np.roll(x["eq_data"][k][6:10], -1)).as_matrix()
        spot_a, spot_b = (Spot(name, i, x["xpos"][i] + x["xmat"][i] @ at) for i, at in ((a, at_a), (b, at_b)))
        return [(spot_a, x["xmat"][a] @ turn), (spot_b, x["xmat"][b])]

    def _springs(self) -> list[Acting]:
        """Return the springs and dampers of joints."""
        x, springs = self.x, list[Acting]()
        for k in range(x["njnt"]):
            law = Straight(k=float(x["jnt_stiffness"][k]), c=float(x["dof_damping"][k]), rest=float(x["qpos_spring"][k]))
            if law.k or law.c:
                kind = "spring" if law.k else "damping"
                springs.append(OnJoints(f"{kind}_{self.name('jnt', k)}", {k: 1.0}, law))
        return springs

    def _on_tendon(self, k: int, name: str, law: Straight) -> Acting:
        """Return a law on the length of a tendon: the distance of two sites, or a sum of joint coordinates.

        Raises:
            ExchangeError: the tendon has another path.
        """
        x, first = self.x, int(self.x["tendon_adr"][k])
        parts = range(first, first + int(x["tendon_num"][k]))
        kinds = [self.word("wrap", x["wrap_type"][i]) for i in parts]
        objects = [int(x["wrap_objid"][i]) for i in parts]
        if {*kinds} == {"joint"}:
            return OnJoints(name, {j: float(x["wrap_prm"][i]) for j, i in zip(objects, parts, strict=True)}, law)
        if kinds == ["site", "site"]:
            return Between(name, self._site(objects[0]), self._site(objects[1]), law)
        raise self.refuse(self.describe("tendon", k), "only tendons between two sites, and sums of joints, act in a linkage")

    def _tendons(self) -> list[Acting]:
        """Return the springs and dampers of tendons.

        Raises:
            ExchangeError: a tendon's spring is not linear, or its path is not that of a linkage's force.
        """
        x, tendons = self.x, list[Acting]()
        for k in range(x["ntendon"]):
            low, high = x["tendon_lengthspring"][k]
            law = Straight(float(x["tendon_stiffness"][k]), float(x["tendon_damping"][k]), float(low))
            if law.k and low != high:
                raise self.refuse(self.describe("tendon", k), "a spring that is not linear")
            if law.k or law.c:
                tendons.append(self._on_tendon(k, self.name("tendon", k), law))
        return tendons

    def _enabled_actuators(self) -> list[int]:
        """Return the numbers of the actuators that act; those of groups that are switched off are listed as left out.

        Raises:
            ExchangeError: an actuator has several controls.
        """
        x = self.x
        if x["nactuator"] != x["nu"]:
            raise self.refuse("<actuator>", "an actuator with several controls")
        off = [k for k in range(x["nu"]) if x["actuator_group"][k] in x["disabled_groups"]]
        self.dropped += [f"actuator {self.name('actuator', k)}, whose group is switched off" for k in off]
        return [k for k in range(x["nu"]) if k not in off]

    def _actuator(self, k: int) -> Acting:
        """Return an actuator as a force: F = gain u + b0 + b1 L + b2 L' along the length L = g x of its transmission.

        The control u is that of the keyframe, or 0 without a keyframe. Along x the force is g F. Ranges act on u, and on F where it
        is constant.

        Raises:
            ExchangeError: the force is not linear, or acts on something else than a joint, a tendon or a point.
        """
        x, element, name = self.x, self.describe("actuator", k), self.name("actuator", k)
        words = {sort: self.word(sort, x[f"actuator_{sort}type"][k]) for sort in ("gain", "bias", "dyn", "trn")}
        if words["gain"] != "fixed" or words["bias"] not in ("none", "affine") or words["dyn"] != "none":
            raise self.refuse(element, "only motors and linear servos act in a linkage")
        control = float(x["key_ctrl"][self.key][k]) if x["nkey"] else 0.0
        if x["actuator_ctrllimited"][k] and "clampctrl" not in x["disabled"]:
            control = float(np.clip(control, *x["actuator_ctrlrange"][k]))
        bias = x["actuator_biasprm"][k][:3] if words["bias"] == "affine" else np.zeros(3)
        b0, b1, b2 = (float(b) for b in bias)
        constant = float(x["actuator_gainprm"][k][0]) * control + b0
        if x["actuator_forcelimited"][k] and not (b1 or b2):
            constant = float(np.clip(constant, *x["actuator_forcerange"][k]))
        gear, (first, second) = x["actuator_gear"][k], x["actuator_trnid"][k]
        g = float(np.linalg.norm(gear[:3])) if words["trn"] == "site" else float(gear[0])
        if b1:  # a servo is a spring towards the position that the control commands
            law = Straight(k=-g * g * b1, c=-g * g * b2, rest=constant / -(g * b1))
        else:
            law = Straight(c=-g * g * b2, bias=g * constant)
        match words["trn"]:
            case "joint" | "jointinparent":
                backwards = g < 0 and not b1 and self.word("jnt", x["jnt_type"][first]) == "hinge"
                if backwards:  # a motor on the hinge the other way round, so that its value is that of the control
                    return OnJoints(name, {int(first): -1.0}, replace(law, bias=-law.bias))
                return OnJoints(name, {int(first): 1.0}, law)
            case "tendon":
                return self._on_tendon(int(first), name, law)
            case "site":
                return self._push(element, name, int(first), int(second), gear, law)
        raise self.refuse(element, f"a {words['trn']} transmission")

    def _push(self, element: str, name: str, site: int, frame: int, gear: Array, law: Straight) -> Push:
        """Return a force at a site, along the direction `gear` of the reference site `frame`, or of the site itself if it is -1.

        Raises:
            ExchangeError: the actuator is a torque, or a servo without a reference site.
        """
        if gear[3:].any():
            raise self.refuse(element, "a torque on a site; give it to the joint")
        if not gear[:3].any():
            raise self.refuse(element, "a site transmission without gear")
        if frame < 0 and (law.k or law.c):
            raise self.refuse(element, "a servo on a site needs a refsite")
        base = frame if frame >= 0 else site
        direction = self.x["site_xmat"][base] @ (gear[:3] / np.linalg.norm(gear[:3]))
        body = int(self.x["site_bodyid"][base])
        return Push(name, self._site(site), body, direction, law, self._site(frame) if frame >= 0 else None)
