"""MJCF: what MuJoCo's compiler has made of a document, as a mechanism in space; what has no place there is refused or listed."""

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import numpy as np

from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.safe_xml import refuse_bulk, refuse_files
from gauss_bench.exchange.spatial import Acting, Between, Body, Joint, OnJoint, OnSum, Push, Spatial, Spot, Straight

NEEDED = {"constraint", "equality", "spring", "damper", "actuation", "passive"}  # flags without which a model is another
START = "start"  # the keyframe that is taken before others


def from_mjcf(root: Element, path: Path) -> Spatial:
    """The mechanism of a document that has been inspected.

    Raises:
        ExchangeError: MuJoCo refuses it, or it holds what a linkage cannot have.
        ImportError: MuJoCo is not installed.
    """
    from gauss_bench.engines.mujoco.compiled import DoesNotCompile, compile_document

    refuse_files(root, path)
    refuse_bulk(root, path)
    try:
        x = compile_document(
            tostring(root, encoding="unicode")
        )  # what was inspected: of the file's bytes MuJoCo may read something else
    except DoesNotCompile as error:
        raise ExchangeError(f"{path}: MuJoCo does not compile it: {' '.join(str(error).split())}") from error
    return Reader(x, str(path)).spatial()


class Reader:
    """Reads a compiled document `x` of `compiled`."""

    def __init__(self, x: dict[str, Any], file: str):
        self.x, self.file = x, file
        self.dropped: list[str] = []
        self.key = next((k for k, name in enumerate(x["names"]["key"]) if name == START), 0)

    def refuse(self, element: str, reason: str) -> ExchangeError:
        return ExchangeError(f"{self.file}: {element}: {reason}")

    def called(self, kind: str, k: int, tag: str) -> str:
        name = self.x["names"][kind][k]
        return f'<{tag} name="{name}">' if name else f"<{tag}> number {k + 1}"

    def name(self, kind: str, k: int) -> str:
        return self.x["names"][kind][k] or f"{kind}{k}"

    def spatial(self) -> Spatial:
        """The whole."""
        self._whole()
        bodies, joints = self._bodies(), self._joints()
        closures, welds = self._equalities()
        acting = [*self._springs(), *self._tendons(), *self._actuators()]
        gravity = np.zeros(3) if "gravity" in self.x["disabled"] else self.x["gravity"]
        spots = tuple(self._site(k) for k in range(self.x["nsite"]))
        return Spatial(self.file, bodies, joints, gravity, closures, welds, spots, tuple(acting), tuple(self.dropped))

    def _whole(self) -> None:
        """Read what concerns all of the document."""
        x = self.x
        if x["nflex"] or x["nplugin"]:
            raise self.refuse("<mujoco>", "flexible bodies and plug-ins are no parts of a linkage")
        if any(x["medium"]):
            raise self.refuse("<option>", "a medium with density or viscosity")
        if wrong := NEEDED & {*x["disabled"]}:
            raise self.refuse("<flag>", f"{min(wrong)} is disabled, so that the model does not act as it is written")
        if touching := int(np.count_nonzero(x["geom_contype"] | x["geom_conaffinity"]) + x["npair"]):
            self.dropped.append(f"contacts of {touching} geoms and pairs: bodies pass through each other")
        if x["nkey"] > 1:
            self.dropped.append(f"keyframes other than {self.name('key', self.key)!r}, which is the start")
        if x["nsensor"]:
            self.dropped.append(f"{x['nsensor']} sensors")

    def _bodies(self) -> tuple[Body, ...]:
        x = self.x
        for k in range(x["nbody"]):
            if x["body_gravcomp"][k] or x["body_mocapid"][k] >= 0:
                raise self.refuse(self.called("body", k, "body"), "gravity compensation or a motion capture body")
        parts = zip(x["body_parentid"], x["xpos"], x["xmat"], x["body_mass"], x["xipos"], x["inertia"], strict=True)
        return tuple(
            Body(self.name("body", k), int(parent), place, turn, float(mass), com, inertia)
            for k, (parent, place, turn, mass, com, inertia) in enumerate(parts)
        )

    def _joints(self) -> tuple[Joint, ...]:
        x, joints = self.x, []
        for k in range(x["njnt"]):
            kind, element = x["types"]["jnt"][str(int(x["jnt_type"][k]))], self.called("jnt", k, "joint")
            if kind not in ("hinge", "slide"):
                raise self.refuse(element, f"a {kind} joint does not move in a plane")
            at, dof = int(x["jnt_qposadr"][k]), int(x["jnt_dofadr"][k])
            if x["jnt_stiffnesspoly"][k].any() or x["dof_dampingpoly"][dof].any() or x["jnt_springyield"][k]:
                raise self.refuse(element, "a spring or damper that is not linear")
            if x["dof_frictionloss"][dof]:
                raise self.refuse(element, "frictionloss, which does not depend on the joint's load as friction of a linkage does")
            if x["jnt_limited"][k]:
                self.dropped.append(f"the range of joint {self.name('jnt', k)}")
            start, speed = (x["key_qpos"][self.key][at], x["key_qvel"][self.key][dof]) if x["nkey"] else (x["qpos0"][at], 0.0)
            numbers = (float(y) for y in (x["qpos0"][at], start, speed, x["dof_armature"][dof]))
            body = int(x["jnt_bodyid"][k])
            joints.append(Joint(self.name("jnt", k), kind, body, x["xanchor"][k], x["xaxis"][k], *numbers))
        return tuple(joints)

    def _site(self, k: int) -> Spot:
        return Spot(self.name("site", k), int(self.x["site_bodyid"][k]), self.x["site_xpos"][k])

    def _equalities(self) -> tuple[tuple[tuple[str, Spot, Spot], ...], tuple[tuple[int, int], ...]]:
        x, closures, welds = self.x, [], []
        for k in range(x["neq"]):
            kind = x["types"]["eq"][str(int(x["eq_type"][k]))]
            element, name = self.called("eq", k, kind), x["names"]["eq"][k] or f"{kind}{k + 1}"
            if not x["eq_active0"][k]:
                self.dropped.append(f"equality {name}, which is not active")
                continue
            if kind not in ("connect", "weld"):
                raise self.refuse(element, "only connect and weld close a linkage")
            a, b = int(x["eq_obj1id"][k]), int(x["eq_obj2id"][k])
            if x["eq_objtype"][k] == x["site_object"]:
                ends = self._site(a), self._site(b)
            else:
                places = (x["xpos"][i] + x["xmat"][i] @ x["eq_data"][k][3 * j : 3 * j + 3] for j, i in enumerate((a, b)))
                ends = Spot(name, a, next(places)), Spot(name, b, next(places))
            if kind == "connect":
                closures.append((name, *ends))
            else:
                self._weld_holds(k, element)
                welds.append((ends[0].body, ends[1].body))
        return tuple(closures), tuple(welds)

    def _weld_holds(self, k: int, element: str) -> None:
        """Tell whether a weld keeps the pose that its bodies have where all joints have their reference.

        Raises:
            ExchangeError: it does not.
        """
        x, a, b = self.x, int(self.x["eq_obj1id"][k]), int(self.x["eq_obj2id"][k])
        if x["eq_objtype"][k] == x["site_object"]:
            shift, turn = x["site_xpos"][b] - x["site_xpos"][a], x["site_xmat"][a].T @ x["site_xmat"][b]
            wanted_shift, wanted_turn = np.zeros(3), np.eye(3)
        else:
            data = x["eq_data"][k]
            turn = x["xmat"][a].T @ x["xmat"][b]
            wanted_turn = rotation(data[6:10])
            shift = x["xpos"][b] + x["xmat"][b] @ data[:3] - x["xpos"][a] - x["xmat"][a] @ data[3:6]
            wanted_shift = np.zeros(3)
        if np.abs(shift - wanted_shift).max() > 1e-6 or np.abs(turn - wanted_turn).max() > 1e-6:
            raise self.refuse(element, "its bodies are not in the pose that it holds, where joints have their reference")

    def _springs(self) -> list[Acting]:
        x, springs = self.x, list[Acting]()
        for k in range(x["njnt"]):
            stiffness, damping = float(x["jnt_stiffness"][k]), float(x["dof_damping"][int(x["jnt_dofadr"][k])])
            if stiffness or damping:
                rest = float(x["qpos_spring"][int(x["jnt_qposadr"][k])])
                springs.append(OnJoint(f"spring_{self.name('jnt', k)}", k, Straight(stiffness, damping, rest)))
        return springs

    def _tendon(self, k: int) -> tuple[Spot, Spot] | dict[int, float]:
        """The path of a tendon: two sites, or joints with their coefficients.

        Raises:
            ExchangeError: another way.
        """
        x, first = self.x, int(self.x["tendon_adr"][k])
        parts = range(first, first + int(x["tendon_num"][k]))
        kinds = [x["types"]["wrap"][str(int(x["wrap_type"][i]))] for i in parts]
        if {*kinds} == {"joint"}:
            return {int(x["wrap_objid"][i]): float(x["wrap_prm"][i]) for i in parts}
        if kinds == ["site", "site"]:
            a, b = (self._site(int(x["wrap_objid"][i])) for i in parts)
            return a, b
        raise self.refuse(
            self.called("tendon", k, "tendon"), "only tendons between two sites, and sums of joints, act in a linkage"
        )

    def _on_tendon(self, k: int, name: str, law: Straight) -> Acting:
        way = self._tendon(k)
        return OnSum(name, way, law) if isinstance(way, dict) else Between(name, *way, law)

    def _tendons(self) -> list[Acting]:
        x, tendons = self.x, list[Acting]()
        for k in range(x["ntendon"]):
            element, (low, high) = self.called("tendon", k, "tendon"), x["tendon_lengthspring"][k]
            stiffness, damping = float(x["tendon_stiffness"][k]), float(x["tendon_damping"][k])
            uneven = x["tendon_stiffnesspoly"][k].any() or x["tendon_dampingpoly"][k].any() or x["tendon_springyield"][k]
            if uneven or (stiffness and low != high):
                raise self.refuse(element, "a spring or damper that is not linear")
            if x["tendon_frictionloss"][k] or x["tendon_armature"][k]:
                raise self.refuse(element, "frictionloss or armature of a tendon")
            if x["tendon_limited"][k]:
                self.dropped.append(f"the range of tendon {self.name('tendon', k)}")
            if stiffness or damping:
                tendons.append(self._on_tendon(k, self.name("tendon", k), Straight(stiffness, damping, float(low))))
        return tendons

    def _actuators(self) -> list[Acting]:
        return [self._actuator(k) for k in range(self.x["nu"])]

    def _actuator(self, k: int) -> Acting:
        """An actuator under the control of the keyframe, else none: force = gain u + b0 + b1 L + b2 L' on L = gear x.

        Raises:
            ExchangeError: a force that is not linear, or acts on something else than joints, tendons and points.
        """
        x, element, name = self.x, self.called("actuator", k, "actuator"), self.name("actuator", k)
        words = {sort: x["types"][sort][str(int(x[f"actuator_{sort}type"][k]))] for sort in ("gain", "bias", "dyn", "trn")}
        other = words["gain"] != "fixed" or words["bias"] not in ("none", "affine") or words["dyn"] != "none"
        own = x["actuator_armature"][k] or x["actuator_damping"][k] or x["actuator_dampingpoly"][k].any()
        if other or own or x["actuator_actnum"][k]:
            raise self.refuse(element, "only motors and linear servos without states of their own act in a linkage")
        control = float(x["key_ctrl"][self.key][k]) if x["nkey"] else 0.0
        if x["actuator_ctrllimited"][k]:
            control = float(np.clip(control, *x["actuator_ctrlrange"][k]))
            self.dropped.append(f"the control range of actuator {name}")
        if x["actuator_forcelimited"][k]:
            self.dropped.append(f"the force range of actuator {name}")
        bias = x["actuator_biasprm"][k][:3] if words["bias"] == "affine" else np.zeros(3)
        force, slope, rate = (float(y) for y in (x["actuator_gainprm"][k][0] * control + bias[0], bias[1], bias[2]))
        gear, (first, second) = x["actuator_gear"][k], (int(y) for y in x["actuator_trnid"][k])
        g = float(gear[0])
        law = straight(g * force, g * g * slope, g * g * rate)
        match words["trn"]:
            case "joint" | "jointinparent":
                return OnJoint(name, first, law)
            case "tendon":
                return self._on_tendon(first, name, law)
            case "site":
                return self._push(element, name, first, second, gear, (force, slope, rate))
        raise self.refuse(element, f"a {words['trn']} transmission")

    def _push(self, element: str, name: str, site: int, frame: int, gear: Any, numbers: tuple[float, float, float]) -> Push:
        if gear[3:].any():
            raise self.refuse(element, "a torque on a site; give it to the joint")
        size = float(np.linalg.norm(gear[:3]))
        if size == 0:
            raise self.refuse(element, "a site transmission without gear")
        base = frame if frame >= 0 else site
        direction = self.x["site_xmat"][base] @ (gear[:3] / size)
        force, slope, rate = numbers
        if frame < 0 and (slope or rate):
            raise self.refuse(element, "a servo on a site needs a refsite")
        law = straight(size * force, size * size * slope, size * size * rate)
        body = int(self.x["site_bodyid"][base])
        return Push(name, self._site(site), body, direction, law, self._site(frame) if frame >= 0 else None)


def straight(force: float, slope: float, rate: float) -> Straight:
    """The law force + slope x + rate x'."""
    return Straight(-slope, -rate, force / -slope, 0.0) if slope else Straight(0.0, -rate, 0.0, force)


def rotation(quaternion: Any) -> Any:
    """(3, 3) of a quaternion (w, x, y, z), which need not be a unit."""
    w, x, y, z = np.asarray(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
