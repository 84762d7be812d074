"""Import of MJCF: MuJoCo compiles the document, and this module converts the compiled model to a spatial mechanism."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element, tostring

import numpy as np
from scipy.spatial.transform import Rotation

from gauss_bench.engines.mujoco.compiled import PARTS, Compiled, DoesNotCompile, compile_document
from gauss_bench.exchange.errors import ExchangeError, FileReader
from gauss_bench.exchange.safe_xml import refuse_bulk, refuse_files
from gauss_bench.exchange.spatial import Between, Body, Force, Joint, LinearLaw, OnJoints, Push, Spatial, Spot
from gauss_bench.exchange.unused import FIELDS, list_names, list_unused
from gauss_bench.terms import Array

NEEDED = {"constraint", "equality", "spring", "damper", "actuation", "passive"}  # flags that must not be disabled
START = "start"  # name of the keyframe at which the linkage starts; without this name, the first keyframe
SAME_POSE = 1e-6  # largest difference [m, or of a component of an axis] between two poses that count as equal for a weld
GROUPS = 31  # number of groups of actuators that <option actuatorgroupdisable> can switch off


def from_mjcf(root: Element, path: Path) -> Spatial:
    """Return the mechanism of a document that `read_xml` has accepted.

    Raises:
        ExchangeError: MuJoCo rejects the document, or it holds an element that a linkage cannot have.
        ImportError: MuJoCo is not installed.
    """
    refuse_files(root, path)
    refuse_bulk(root, path)
    # the checked tree is written anew, because MuJoCo's parser might read the bytes of the file differently
    spatial = make_reader(lambda: compile_document(tostring(root, encoding="unicode")), path).read()
    return replace(spatial, dropped=(*spatial.dropped, *list_unused(root)))


def make_reader(compiler: Callable[[], Compiled], path: Path) -> "Reader":
    """Return a reader of the file at `path`; `compiler` returns MuJoCo's compiled model of the file.

    Raises:
        ExchangeError: MuJoCo rejects the file.
    """
    try:
        return Reader(compiler(), str(path))
    except DoesNotCompile as error:
        raise ExchangeError(f"{path}: MuJoCo does not compile it: {' '.join(str(error).split())}") from error


class Reader(FileReader):
    """A reader of a compiled MJCF document; its methods raise ExchangeError for elements that a linkage cannot have.

    Attributes:
        model: MuJoCo's compiled model of the document; its fields have MuJoCo's names.
        data: MuJoCo's data, with the poses of all bodies and sites when every joint coordinate is at its reference.
        names: kind of element in MuJoCo's terms, such as "jnt" -> names of all elements of the kind, or "" for an unnamed element.
        disabled: names of MuJoCo's flags that are switched off.
        dropped: phrases that name the elements which the import leaves out.
        key: index of the keyframe from which the linkage starts.
    """

    def __init__(self, compiled: Compiled, file: str):
        self.compiled, self.model, self.data, self.file = compiled, compiled.model, compiled.data, file
        self.names, self.disabled = {kind: compiled.names(kind) for kind in PARTS}, compiled.disabled()
        self.dropped: list[str] = []
        self.key = self.names["key"].index(START) if START in self.names["key"] else 0

    def describe(self, kind: str, k: int, tag: str) -> str:
        """Return, for messages, the XML tag `tag` with the name of element k of a kind, or the number k + 1 if it has no name."""
        name = self.names[kind][k]
        return f'<{tag} name="{name}">' if name else f"<{tag}> number {k + 1}"

    def name(self, kind: str, k: int) -> str:
        """Return the name of element k of a kind, or a name made of the kind and k if it has none."""
        return self.names[kind][k] or f"{kind}{k}"

    def read(self) -> Spatial:
        """Return the mechanism that the complete document describes."""
        m = self.model
        self._check_document()
        joints = tuple(self._read_joint(k) for k in range(m.njnt))
        self._check_fields()
        closures, welds = self._read_equalities()
        forces = [*self._read_springs(), *self._read_tendons(), *(self._read_actuator(k) for k in self._list_enabled_actuators())]
        gravity = np.zeros(3) if "gravity" in self.disabled else np.array(m.opt.gravity)
        bodies = tuple(self._read_body(k) for k in range(m.nbody))
        spots = tuple(self._read_site(k) for k in range(m.nsite))
        return Spatial(self.file, bodies, joints, gravity, tuple(closures), tuple(welds), spots, tuple(forces), tuple(self.dropped))

    def _check_document(self) -> None:
        """Refuse or list properties of the whole document: media, flags, contacts, keyframes and sensors."""
        m = self.model
        if m.nflex or m.nplugin:
            raise self.refuse("<mujoco>", "a linkage has no flexible bodies and plug-ins")
        if m.opt.density or m.opt.viscosity:
            raise self.refuse("<option>", "a medium with density or viscosity")
        if lacking := NEEDED & self.disabled:
            raise self.refuse("<flag>", f"{min(lacking)} is disabled, so that the model does not behave as its elements say")
        if (m.body_mocapid >= 0).any():
            raise self.refuse(self.describe("body", int(m.body_mocapid.argmax()), "body"), "a motion capture body")
        colliding = [self.names["geom"][int(k)] for k in np.flatnonzero(m.geom_contype | m.geom_conaffinity)]
        contacts = len(colliding) + m.npair
        if contacts and "contact" not in self.disabled:
            geoms = f" (<geom> {list_names(colliding)})" if colliding else ""
            self.dropped.append(f"contacts of {contacts} geoms and pairs{geoms}: bodies pass through each other")
        if m.nkey > 1:
            others = [name for k, name in enumerate(self.names["key"]) if k != self.key]
            start = self.name("key", self.key)
            self.dropped.append(f"keyframes other than {start!r}, which is the start: <key> {list_names(others)}")
        if m.nsensor:
            kinds = [self.compiled.word("mjtSensor", kind) for kind in m.sensor_type]
            names = list_names([f"<{kind}> {name}".strip() for kind, name in zip(kinds, self.names["sensor"], strict=True)])
            self.dropped.append(f"{m.nsensor} sensors: {names}")

    def _check_fields(self) -> None:
        """Refuse every element with a field that no linkage can have, and list those with a field that the import leaves out."""
        for entry in FIELDS["refused"]:
            kind = entry["kind"]
            tag = "joint" if kind == "jnt" else kind
            for field in entry["fields"]:  # one number, or one row of numbers, for each element of the kind
                for k, numbers in enumerate(getattr(self.model, field)[: len(self.names[kind])]):
                    if np.any(numbers):
                        raise self.refuse(self.describe(kind, k, tag), entry["reason"])
        for entry in FIELDS["left_out"]:
            for index in np.flatnonzero(getattr(self.model, entry["field"])):
                self.dropped.append(f"{entry['reason']} {self.name(entry['kind'], int(index))}")

    def _read_joint(self, k: int) -> Joint:
        """Return joint k of MuJoCo's model; it starts as the keyframe says, or at its reference if there is no keyframe."""
        m, kind = self.model, self.compiled.word("mjtJoint", self.model.jnt_type[k])
        if kind not in ("hinge", "slide"):
            raise self.refuse(self.describe("jnt", k, "joint"), f"a {kind} joint does not move in a plane")
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

    def _read_body(self, k: int) -> Body:
        """Return body k of MuJoCo's model, with its pose, mass and inertia in world axes."""
        mass, com, inertia = float(self.model.body_mass[k]), self.data.xipos[k], self.compiled.inertia[k]
        parent = int(self.model.body_parentid[k])
        return Body(self.name("body", k), parent, self.data.xpos[k], self._rotation(k), mass, com, inertia)

    def _rotation(self, k: int) -> Array:
        """Return the rotation (3, 3) of the frame of body k."""
        return np.asarray(self.data.xmat[k].reshape(3, 3))

    def _read_site(self, k: int) -> Spot:
        """Return site k of MuJoCo's model as a point of its body."""
        return Spot(self.name("site", k), int(self.model.site_bodyid[k]), self.data.site_xpos[k])

    def _read_equalities(self) -> tuple[list[tuple[str, Spot, Spot]], list[tuple[int, int]]]:
        """Return the connect constraints, each as its name and two points, and the welds, each as the indices of two bodies."""
        m, closures, welds = self.model, list[tuple[str, Spot, Spot]](), list[tuple[int, int]]()
        for k in range(m.neq):
            kind = self.compiled.word("mjtEq", m.eq_type[k])
            element, name = self.describe("eq", k, kind), self.names["eq"][k] or f"{kind}{k + 1}"
            if not m.eq_active0[k]:
                self.dropped.append(f"equality {name}, which is not active")
                continue
            if kind not in ("connect", "weld"):
                raise self.refuse(element, "only connect and weld close a linkage")
            (a, axes_a), (b, axes_b) = self._read_ends(k, kind, name)
            if kind == "connect":
                closures.append((name, a, b))
                continue
            if np.abs(a.place - b.place).max() > SAME_POSE or np.abs(axes_a - axes_b).max() > SAME_POSE:
                raise self.refuse(element, "its bodies are not in the pose of the weld when the joints are at their references")
            welds.append((a.body, b.body))
        return closures, welds

    def _read_ends(self, k: int, kind: str, name: str) -> list[tuple[Spot, Array]]:
        """Return the two points that equality constraint k joins, each with the axes (3, 3) that a weld keeps parallel."""
        m = self.model
        a, b = int(m.eq_obj1id[k]), int(m.eq_obj2id[k])
        if self.compiled.word("mjtObj", m.eq_objtype[k]) == "site":
            return [(self._read_site(i), self.data.site_xmat[i].reshape(3, 3)) for i in (a, b)]
        at_a, at_b, turn = m.eq_data[k][:3], m.eq_data[k][3:6], np.eye(3)
        if kind == "weld":
            # for a weld, MuJoCo stores the anchor in the second body first, and the rotation of the second body in the first,
            # as a quaternion that begins with its scalar part; SciPy expects the scalar part last
            at_a, at_b = at_b, at_a
            turn = Rotation.from_quat(np.roll(m.eq_data[k][6:10], -1)).as_matrix()
        spot_a = Spot(name, a, self.data.xpos[a] + self._rotation(a) @ at_a)
        spot_b = Spot(name, b, self.data.xpos[b] + self._rotation(b) @ at_b)
        return [(spot_a, self._rotation(a) @ turn), (spot_b, self._rotation(b))]

    def _read_springs(self) -> list[Force]:
        """Return the springs and dampers in joints, as force laws on joint coordinates."""
        m, springs = self.model, list[Force]()
        for k in range(m.njnt):
            law = LinearLaw(k=float(m.jnt_stiffness[k]), c=float(m.dof_damping[k]), rest=float(m.qpos_spring[k]))
            if law.k or law.c:
                kind = "spring" if law.k else "damping"
                springs.append(OnJoints(f"{kind}_{self.name('jnt', k)}", {k: 1.0}, law))
        return springs

    def _act_on_tendon(self, k: int, name: str, law: LinearLaw) -> Force:
        """Return a force `name` by a law on the length of tendon k: a distance of two sites, or a sum of joint coordinates."""
        m, first = self.model, int(self.model.tendon_adr[k])
        path = slice(first, first + int(m.tendon_num[k]))  # indices of the tendon's parts in MuJoCo's arrays wrap_...
        kinds = [self.compiled.word("mjtWrap", x) for x in m.wrap_type[path]]
        objects = [int(x) for x in m.wrap_objid[path]]
        if {*kinds} == {"joint"}:
            weights = [float(x) for x in m.wrap_prm[path]]
            return OnJoints(name, dict(zip(objects, weights, strict=True)), law)
        if kinds == ["site", "site"]:
            return Between(name, self._read_site(objects[0]), self._read_site(objects[1]), law)
        reason = "only tendons between two sites, and sums of joints, act in a linkage"
        raise self.refuse(self.describe("tendon", k, "tendon"), reason)

    def _read_tendons(self) -> list[Force]:
        """Return the springs and dampers of tendons."""
        m, tendons = self.model, list[Force]()
        for k in range(m.ntendon):
            low, high = m.tendon_lengthspring[k]
            law = LinearLaw(float(m.tendon_stiffness[k]), float(m.tendon_damping[k]), float(low))
            if law.k and low != high:
                raise self.refuse(self.describe("tendon", k, "tendon"), "a spring that is not linear")
            if law.k or law.c:
                tendons.append(self._act_on_tendon(k, self.name("tendon", k), law))
        return tendons

    def _list_enabled_actuators(self) -> list[int]:
        """Return the indices of the enabled actuators, and record those whose group is switched off as left out."""
        m, enabled = self.model, list[int]()
        if m.nactuator != m.nu:
            raise self.refuse("<actuator>", "an actuator with several controls")
        for k in range(m.nu):
            group = int(m.actuator_group[k])
            if 0 <= group < GROUPS and int(m.opt.disableactuator) >> group & 1:  # bit number `group` switches the group off
                self.dropped.append(f"actuator {self.name('actuator', k)}, whose group is switched off")
            else:
                enabled.append(k)
        return enabled

    def _read_actuator(self, k: int) -> Force:
        """Return actuator k of the model as a force on joints, between two sites or at a site.

        MuJoCo's force is F = gain u + b0 + b1 L + b2 dL/dt along the length L = g x of the transmission, where g is the gear and x
        the coordinate of a joint, tendon or site. The power F dL/dt is g F dx/dt, so the generalised force that acts on x is g F.
        The control u is that of the keyframe, or 0 without a keyframe. MuJoCo may limit u and F to ranges; a linkage file has
        a limited F only if F is constant.
        """
        m, element, name = self.model, self.describe("actuator", k, "actuator"), self.name("actuator", k)
        gain = self.compiled.word("mjtGain", m.actuator_gaintype[k])
        bias = self.compiled.word("mjtBias", m.actuator_biastype[k])
        dynamics = self.compiled.word("mjtDyn", m.actuator_dyntype[k])
        transmission = self.compiled.word("mjtTrn", m.actuator_trntype[k])
        if gain != "fixed" or bias not in ("none", "affine") or dynamics != "none":
            raise self.refuse(element, "only motors and linear servos act in a linkage")
        u = float(m.key_ctrl[self.key][k]) if m.nkey else 0.0
        if m.actuator_ctrllimited[k] and "clampctrl" not in self.disabled:
            u = float(np.clip(u, *m.actuator_ctrlrange[k]))
        b0, b1, b2 = map(float, m.actuator_biasprm[k][:3]) if bias == "affine" else (0.0, 0.0, 0.0)
        constant = float(m.actuator_gainprm[k][0]) * u + b0
        if m.actuator_forcelimited[k] and not (b1 or b2):
            constant = float(np.clip(constant, *m.actuator_forcerange[k]))
        # at a site, gear[:3] is a vector: its length is the gear, and `_make_push` uses its direction
        gear, (target, reference) = m.actuator_gear[k], map(int, m.actuator_trnid[k])
        g = float(np.linalg.norm(gear[:3])) if transmission == "site" else float(gear[0])
        if b1:  # a servo is a spring whose rest makes the force along x zero: constant + b1 g x = 0
            law = LinearLaw(k=-g * g * b1, c=-g * g * b2, rest=constant / -(g * b1))
        else:
            law = LinearLaw(c=-g * g * b2, bias=g * constant)
        match transmission:
            case "joint" | "jointinparent":
                is_hinge = self.compiled.word("mjtJoint", m.jnt_type[target]) == "hinge"
                if g < 0 and not b1 and is_hinge:
                    # with a negative gear, reverse the hinge's coordinate, so that the torque in the linkage file has the sign of
                    # the control. Slides and servos need no reversal: forces are vectors, and the stiffness contains g^2.
                    return OnJoints(name, {target: -1.0}, replace(law, bias=-law.bias))
                return OnJoints(name, {target: 1.0}, law)
            case "tendon":
                return self._act_on_tendon(target, name, law)
            case "site":
                return self._make_push(element, name, target, reference, gear, law)
        raise self.refuse(element, f"a {transmission} transmission")

    def _make_push(self, element: str, name: str, site: int, reference: int, gear: Array, law: LinearLaw) -> Push:
        """Return the force of an actuator that acts at a site.

        Args:
            element: tag and name of the actuator, for messages.
            site, reference: indices of the site at which the force acts, and of its reference site, or -1 without one.
            gear: (6,) the direction in axes of the reference site (else of the site itself), and the torque, which must be zero.
        """
        if gear[3:].any():
            raise self.refuse(element, "a torque on a site; give it to the joint")
        if not gear[:3].any():
            raise self.refuse(element, "a site transmission with gear 0")
        if reference < 0 and (law.k or law.c):
            raise self.refuse(element, "a servo on a site needs a refsite")
        base, origin = (reference, self._read_site(reference)) if reference >= 0 else (site, None)
        direction = self.data.site_xmat[base].reshape(3, 3) @ (gear[:3] / np.linalg.norm(gear[:3]))
        body = int(self.model.site_bodyid[base])  # the direction is fixed in this body
        return Push(name, self._read_site(site), body, direction, law, origin)
