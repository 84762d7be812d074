"""Import of MJCF: from the model that MuJoCo compiles from a document to a mechanism in space.

Elements that a linkage cannot have are refused. Elements that do not change its motion are listed as left out.
"""

from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element, tostring

import numpy as np
from scipy.spatial.transform import Rotation

from gauss_bench.engines.mujoco.compiled import PARTS, Compiled, DoesNotCompile, compile_document
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
    refuse_files(root, path)
    refuse_bulk(root, path)
    try:  # the inspected tree is written anew: MuJoCo's parser might read the file's bytes differently
        compiled = compile_document(tostring(root, encoding="unicode"))
    except DoesNotCompile as error:
        raise ExchangeError(f"{path}: MuJoCo does not compile it: {' '.join(str(error).split())}") from error
    spatial = Reader(compiled, str(path)).spatial()
    return replace(spatial, dropped=(*spatial.dropped, *list_unused(root)))


class Reader:
    """A reader of a compiled document.

    Attributes:
        compiled: the document; model: MuJoCo's model of it, with MuJoCo's names of the fields; data: the poses of its parts.
        names: kind of part -> names of all such parts.
        disabled: flags that are off.
        dropped: sentences on elements that are left out.
        key: number of the keyframe that is the start.
    """

    def __init__(self, compiled: Compiled, file: str):
        self.compiled, self.model, self.data, self.file = compiled, compiled.model, compiled.data, file
        self.names, self.disabled = {kind: compiled.names(kind) for kind in PARTS}, compiled.disabled()
        self.dropped: list[str] = []
        self.key = self.names["key"].index(START) if START in self.names["key"] else 0

    def refuse(self, element: str, reason: str) -> ExchangeError:
        return ExchangeError(f"{self.file}: {element}: {reason}")

    def describe(self, kind: str, k: int, tag: str | None = None) -> str:
        """Return an element as a message names it: by its name, or by its number if it has no name."""
        name, tag = self.names[kind][k], tag or TAGS.get(kind, kind)
        return f'<{tag} name="{name}">' if name else f"<{tag}> number {k + 1}"

    def name(self, kind: str, k: int) -> str:
        return self.names[kind][k] or f"{kind}{k}"

    def spatial(self) -> Spatial:
        """Return the mechanism of the whole document.

        Raises:
            ExchangeError: the document holds an element that a linkage cannot have.
        """
        m = self.model
        self._check_document()
        joints = tuple(self._joint(k) for k in range(m.njnt))
        for known in FIELDS["refused"]:
            for k in range(len(self.names[known["kind"]])):
                if any(np.any(getattr(m, field)[k]) for field in known["fields"]):
                    raise self.refuse(self.describe(known["kind"], k), known["reason"])
        for known in FIELDS["left_out"]:
            set_ones = np.flatnonzero(getattr(m, known["fields"][0]))
            self.dropped += [f"{known['reason']} {self.name(known['kind'], int(k))}" for k in set_ones]
        closures, welds = self._equalities()
        acting = [*self._springs(), *self._tendons(), *(self._actuator(k) for k in self._enabled_actuators())]
        gravity = np.zeros(3) if "gravity" in self.disabled else np.array(m.opt.gravity)
        bodies = tuple(self._body(k) for k in range(m.nbody))
        spots = tuple(self._site(k) for k in range(m.nsite))
        return Spatial(self.file, bodies, joints, gravity, tuple(closures), tuple(welds), spots, tuple(acting), tuple(self.dropped))

    def _check_document(self) -> None:
        """Refuse or list the properties of the document as a whole: media, flags, contacts, keyframes, sensors."""
        m = self.model
        if m.nflex or m.nplugin:
            raise self.refuse("<mujoco>", "a linkage has no flexible bodies and plug-ins")
        if m.opt.density or m.opt.viscosity:
            raise self.refuse("<option>", "a medium with density or viscosity")
        if lacking := NEEDED & self.disabled:
            raise self.refuse("<flag>", f"{min(lacking)} is disabled, so that the model does not behave as its elements say")
        if (m.body_mocapid >= 0).any():
            raise self.refuse(self.describe("body", int(m.body_mocapid.argmax())), "a motion capture body")
        touching = [self.names["geom"][int(k)] for k in np.flatnonzero(m.geom_contype | m.geom_conaffinity)]
        contacts = len(touching) + m.npair
        if contacts and "contact" not in self.disabled:
            geoms = f" (<geom> {list_names(touching)})" if touching else ""
            self.dropped.append(f"contacts of {contacts} geoms and pairs{geoms}: bodies pass through each other")
        if m.nkey > 1:
            others = [name for k, name in enumerate(self.names["key"]) if k != self.key]
            start = self.name("key", self.key)
            self.dropped.append(f"keyframes other than {start!r}, which is the start: <key> {list_names(others)}")
        if m.nsensor:
            kinds = [self.compiled.word("mjtSensor", kind) for kind in m.sensor_type]
            names = list_names([f"<{kind}> {name}".strip() for kind, name in zip(kinds, self.names["sensor"], strict=True)])
            self.dropped.append(f"{m.nsensor} sensors: {names}")

    def _joint(self, k: int) -> Joint:
        """Return a joint; its start is that of the keyframe, if there is one.

        Raises:
            ExchangeError: the joint is neither a hinge nor a slide.
        """
        m, kind = self.model, self.compiled.word("mjtJoint", self.model.jnt_type[k])
        if kind not in ("hinge", "slide"):
            raise self.refuse(self.describe("jnt", k), f"a {kind} joint does not move in a plane")
        start, speed = (m.key_qpos[self.key][k], m.key_qvel[self.key][k]) if m.nkey else (m.qpos0[k], 0.0)
        return Joint(
            self.name("jnt", k),
            kind,
            body=int(m.jnt_bodyid[k]),
            anchor=self.data.xanchor[k],
            axis=self.data.xaxis[k],
            ref=float(m.qpos0[k]),
            start=float(start),
            speed=float(speed),
            armature=float(m.dof_armature[k]),
        )

    def _body(self, k: int) -> Body:
        m, parent = self.model, int(self.model.body_parentid[k])
        mass, com, inertia = float(m.body_mass[k]), self.data.xipos[k], self.compiled.inertia[k]
        return Body(self.name("body", k), parent, self.data.xpos[k], self._turn(k), mass, com, inertia)

    def _turn(self, k: int) -> Array:
        """Return the rotation (3, 3) of a body."""
        return np.asarray(self.data.xmat[k].reshape(3, 3))

    def _site(self, k: int) -> Spot:
        return Spot(self.name("site", k), int(self.model.site_bodyid[k]), self.data.site_xpos[k])

    def _equalities(self) -> tuple[list[tuple[str, Spot, Spot]], list[tuple[int, int]]]:
        """Return the name and points of each closure, and the two bodies of each weld.

        Raises:
            ExchangeError: an equality does not close a linkage.
        """
        m, closures, welds = self.model, list[tuple[str, Spot, Spot]](), list[tuple[int, int]]()
        for k in range(m.neq):
            kind = self.compiled.word("mjtEq", m.eq_type[k])
            element, name = self.describe("eq", k, kind), self.names["eq"][k] or f"{kind}{k + 1}"
            if not m.eq_active0[k]:
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
        m = self.model
        a, b = int(m.eq_obj1id[k]), int(m.eq_obj2id[k])
        if self.compiled.word("mjtObj", m.eq_objtype[k]) == "site":
            return [(self._site(i), self.data.site_xmat[i].reshape(3, 3)) for i in (a, b)]
        at_a, at_b, turn = m.eq_data[k][:3], m.eq_data[k][3:6], np.eye(3)
        if kind == "weld":
            # MuJoCo gives a weld's anchor in the second body first, and its pose as that of the second body in the first
            at_a, at_b = at_b, at_a
            turn = Rotation.from_quat(np.roll(m.eq_data[k][6:10], -1)).as_matrix()
        spot_a, spot_b = (Spot(name, i, self.data.xpos[i] + self._turn(i) @ at) for i, at in ((a, at_a), (b, at_b)))
        return [(spot_a, self._turn(a) @ turn), (spot_b, self._turn(b))]

    def _springs(self) -> list[Acting]:
        """Return the springs and dampers of joints."""
        m, springs = self.model, list[Acting]()
        for k in range(m.njnt):
            law = Straight(k=float(m.jnt_stiffness[k]), c=float(m.dof_damping[k]), rest=float(m.qpos_spring[k]))
            if law.k or law.c:
                kind = "spring" if law.k else "damping"
                springs.append(OnJoints(f"{kind}_{self.name('jnt', k)}", {k: 1.0}, law))
        return springs

    def _on_tendon(self, k: int, name: str, law: Straight) -> Acting:
        """Return a law on the length of a tendon: the distance of two sites, or a sum of joint coordinates.

        Raises:
            ExchangeError: the tendon has another path.
        """
        m, first = self.model, int(self.model.tendon_adr[k])
        parts = range(first, first + int(m.tendon_num[k]))
        kinds = [self.compiled.word("mjtWrap", m.wrap_type[i]) for i in parts]
        objects = [int(m.wrap_objid[i]) for i in parts]
        if {*kinds} == {"joint"}:
            return OnJoints(name, {j: float(m.wrap_prm[i]) for j, i in zip(objects, parts, strict=True)}, law)
        if kinds == ["site", "site"]:
            return Between(name, self._site(objects[0]), self._site(objects[1]), law)
        raise self.refuse(self.describe("tendon", k), "only tendons between two sites, and sums of joints, act in a linkage")

    def _tendons(self) -> list[Acting]:
        """Return the springs and dampers of tendons.

        Raises:
            ExchangeError: a tendon's spring is not linear, or its path is not that of a linkage's force.
        """
        m, tendons = self.model, list[Acting]()
        for k in range(m.ntendon):
            low, high = m.tendon_lengthspring[k]
            law = Straight(float(m.tendon_stiffness[k]), float(m.tendon_damping[k]), float(low))
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
        m = self.model
        if m.nactuator != m.nu:
            raise self.refuse("<actuator>", "an actuator with several controls")
        groups = [group for group in range(31) if int(m.opt.disableactuator) >> group & 1]
        off = [k for k in range(m.nu) if m.actuator_group[k] in groups]
        self.dropped += [f"actuator {self.name('actuator', k)}, whose group is switched off" for k in off]
        return [k for k in range(m.nu) if k not in off]

    def _actuator(self, k: int) -> Acting:
        """Return an actuator as a force: F = gain u + b0 + b1 L + b2 L' along the length L = g x of its transmission.

        The control u is that of the keyframe, or 0 without a keyframe. Along x the force is g F. Ranges act on u, and on F where it
        is constant.

        Raises:
            ExchangeError: the force is not linear, or acts on something else than a joint, a tendon or a point.
        """
        m, element, name = self.model, self.describe("actuator", k), self.name("actuator", k)
        words: dict[str, str] = {}
        for sort in ("gain", "bias", "dyn", "trn"):
            words[sort] = self.compiled.word(f"mjt{sort.capitalize()}", getattr(m, f"actuator_{sort}type")[k])
        if words["gain"] != "fixed" or words["bias"] not in ("none", "affine") or words["dyn"] != "none":
            raise self.refuse(element, "only motors and linear servos act in a linkage")
        control = float(m.key_ctrl[self.key][k]) if m.nkey else 0.0
        if m.actuator_ctrllimited[k] and "clampctrl" not in self.disabled:
            control = float(np.clip(control, *m.actuator_ctrlrange[k]))
        bias = m.actuator_biasprm[k][:3] if words["bias"] == "affine" else np.zeros(3)
        b0, b1, b2 = (float(b) for b in bias)
        constant = float(m.actuator_gainprm[k][0]) * control + b0
        if m.actuator_forcelimited[k] and not (b1 or b2):
            constant = float(np.clip(constant, *m.actuator_forcerange[k]))
        gear, (first, second) = m.actuator_gear[k], m.actuator_trnid[k]
        g = float(np.linalg.norm(gear[:3])) if words["trn"] == "site" else float(gear[0])
        if b1:  # a servo is a spring towards the position that the control commands
            law = Straight(k=-g * g * b1, c=-g * g * b2, rest=constant / -(g * b1))
        else:
            law = Straight(c=-g * g * b2, bias=g * constant)
        match words["trn"]:
            case "joint" | "jointinparent":
                backwards = g < 0 and not b1 and self.compiled.word("mjtJoint", m.jnt_type[first]) == "hinge"
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
        direction = self.data.site_xmat[base].reshape(3, 3) @ (gear[:3] / np.linalg.norm(gear[:3]))
        body = int(self.model.site_bodyid[base])
        return Push(name, self._site(site), body, direction, law, self._site(frame) if frame >= 0 else None)
