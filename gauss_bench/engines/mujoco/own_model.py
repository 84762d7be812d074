"""Run a user's MJCF model in MuJoCo with the model's own options, and convert the result to the motion of a planar linkage.

A link may be several rigidly connected bodies of MuJoCo; the first of them stands for the link. The pose of this body follows from
MuJoCo's joint coordinates, even if soft closures are open. The link's angle theta is a sum over the hinges between the body and the
world, and r is the link's centre of mass, with the local coordinates c:

    theta = theta_0 + sum of +-(qpos - ref)
    omega = J_rotation qvel . normal
    alpha = d omega / dt
    r = xpos + xmat c
    dr/dt = J_point qvel
    d2r/dt2 = J_point qacc + dJ_point/dt qvel
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.engines.base import Choice, sample_arrays
from gauss_bench.engines.mjcf.across_releases import find_integrator
from gauss_bench.engines.mjcf.settings import copy_to_evaluate
from gauss_bench.engines.mujoco.adapter import collect_warnings
from gauss_bench.integrate.fixed_step import stretches
from gauss_bench.mechanism.close import minimum_norm, project
from gauss_bench.terms import Array, largest
from gauss_bench.trajectory import RunFailure, Status, Trajectory

INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast", "discrete")  # as MJCF calls them
CLOSE = 1e-10  # [m, rad] change of joint coordinates at which Newton's method has converged
ITERATIONS = 30  # largest number of Newton's iterations
# parts of a model that are not compared as a whole: the options in `opt` are compared one by one, and the others change no motion
UNCOMPARED = ("opt", "signature", "paths", "text_data", "names", "stat", "vis", "nbuffer")


@dataclass(frozen=True, eq=False)
class LinkMap:
    """The links of a linkage in a compiled MuJoCo model with `nq` joint coordinates.

    Attributes:
        bodies: for each link, MuJoCo's index of the first of the rigidly connected bodies that form the link.
        locals: (links, 3) centres of mass in the frames of these bodies [m].
        plane: (3, 3) matrix with the rows: the two axes of the plane of motion, and the plane's normal.
        angles: (links,) angles of the links if all joint coordinates are zero [rad].
        turns: (links, nq) derivatives of the links' angles with respect to the joint coordinates: 0, 1 or -1.
    """

    bodies: tuple[int, ...]
    locals: Array
    plane: Array
    angles: Array
    turns: Array


class LinkStates(NamedTuple):
    """Positions q, velocities v and accelerations a (n,) of all links, and the Jacobian dq/dy (n, nv) by joint coordinates."""

    q: Array
    v: Array
    a: Array
    jacobian: Array


def read_options(path: str) -> dict[str, Any]:
    """Return name of an option in MJCF -> value, for the model of a file; solref and solimp are tables: closure -> value."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(path)
    words = {int(find_integrator(mujoco, name)): name for name in INTEGRATORS}
    names = [model.equality(k).name or f"closure {k + 1}" for k in range(model.neq)]
    return {
        "timestep": float(model.opt.timestep),
        "integrator": words[int(model.opt.integrator)],
        "iterations": int(model.opt.iterations),
        "tolerance": float(model.opt.tolerance),
        "solref": dict(zip(names, model.eq_solref.tolist(), strict=True)),
        "solimp": dict(zip(names, model.eq_solimp.tolist(), strict=True)),
    }


def change_options(mujoco: Any, model: Any, changes: Mapping[str, Any]) -> None:
    """Set options of a compiled model by their names in MJCF, and "body_invweight0", a factor on the compiled inverse weights.

    Raises:
        KeyError: an option has another name.
    """
    for key, value in changes.items():
        match key:
            case "solref" | "solimp":
                getattr(model, f"eq_{key}")[:] = value
            case "integrator":
                model.opt.integrator = find_integrator(mujoco, value)
            case "body_invweight0":
                model.body_invweight0[:] *= value
            case "iterations" | "tolerance" | "timestep":
                setattr(model.opt, key, value)
            case _:
                raise KeyError(key)


def open_model(mujoco: Any, path: Path | str) -> Any:
    """Return the compiled model of a file; MuJoCo must not reset a diverging run to the start, which would look like a motion."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    return model


def start_model(mujoco: Any, model: Any, data: Any, key: int) -> None:
    """Set MuJoCo's data to the keyframe with the index `key`, or to the model's own start if it has no keyframe."""
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, key)
    else:
        mujoco.mj_resetData(model, data)


class OwnModelRun:
    """The model that MuJoCo compiles from a file, run with the integrator and step of a `Choice`.

    Attributes:
        still, still_data: a copy of the model and its state that evaluates accelerations without changing the state of a run.
        key: index of the keyframe at which runs start.
        y0, dy0: (nv,) joint coordinates and rates at the start.
        y, dy: (k, nv) samples of joint coordinates and rates.
    """

    def __init__(self, path: Path, link_map: LinkMap, key: int, changes: Mapping[str, Any], choice: Choice):
        """Compile the model of a file with the options in `changes` (name in MJCF -> value), and set its start."""
        import mujoco

        self.mujoco: Any = mujoco
        self.link_map, self.choice = link_map, choice
        self.model: Any = open_model(mujoco, path)
        change_options(mujoco, self.model, changes)
        if choice.integrator:
            change_options(mujoco, self.model, {"integrator": choice.integrator})
        self.still: Any = copy_to_evaluate(mujoco, self.model)
        self.data, self.still_data = mujoco.MjData(self.model), mujoco.MjData(self.still)
        self.key = key
        start_model(mujoco, self.model, self.data, key)
        start_model(mujoco, self.still, self.still_data, key)
        self.y0, self.dy0 = np.array(self.data.qpos), np.array(self.data.qvel)

    def forward(self, y: Array, dy: Array) -> Any:
        """Evaluate the model `still` at joint coordinates y and rates dy (nv,), and return MuJoCo's data with accelerations."""
        self.still_data.qpos[:], self.still_data.qvel[:] = y, dy
        self.mujoco.mj_forward(self.still, self.still_data)
        return self.still_data

    def absolute(self, y: Array, dy: Array) -> LinkStates:
        """Return the states of all links at joint coordinates y and rates dy (nv,), with the accelerations that MuJoCo computes."""
        data, model, link_map = self.forward(y, dy), self.still, self.link_map
        axes, normal = link_map.plane[:2], link_map.plane[2]  # of the plane of motion, in the world of MuJoCo
        q: list[float] = []
        jacobian: list[Array] = []
        bias: list[float] = []  # dJ/dt dy
        for link, body in enumerate(link_map.bodies):
            # the link's centre of mass in the world: place of the body's frame plus the rotated local vector
            place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ link_map.locals[link]
            # (3, nv) each: Jacobians of the point and of the rotation, and their time derivatives
            point, turn, point_rate, turn_rate = np.zeros((4, 3, model.nv))
            self.mujoco.mj_jac(model, data, point, turn, place, body)
            self.mujoco.mj_jacDot(model, data, point_rate, turn_rate, place, body)
            q += [*(axes @ place), link_map.angles[link] + link_map.turns[link] @ y]
            jacobian += [*(axes @ point), normal @ turn]
            bias += [*(axes @ point_rate @ dy), normal @ turn_rate @ dy]
        J = np.array(jacobian)
        return LinkStates(np.array(q), J @ dy, J @ np.array(data.qacc) + np.array(bias), J)

    def relative(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the joint coordinates and rates (nv,) of a state q, v (n,), by Newton's method from the model's start.

        Raises:
            RunFailure: the joints of the model cannot reach the state.
        """
        at_rest = np.zeros_like(self.y0)

        def residual(y: Array) -> tuple[Array, Array]:
            """Return the difference (n,) of the links' positions from q, and its Jacobian (n, nv) by joint coordinates."""
            here = self.absolute(y, at_rest)
            return here.q - q, here.jacobian

        y = project(self.y0, residual, minimum_norm, ITERATIONS, stop_after=lambda _, size: bool(size < CLOSE))
        gap, J = residual(y)
        if not largest(minimum_norm(J, gap)) < CLOSE:
            raise RunFailure(Status.ERROR, "the joints of the model cannot take a state of its linkage")
        return y, minimum_norm(J, v)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the accelerations (n,) of the links at a state q, v (n,); the time has no effect."""
        return self.absolute(*self.relative(q, v)).a

    def prepare(self, times: Array, native: bool = True) -> None:
        self.times, self.plan = times, list(stretches(times, self.choice.step))
        self.y, self.dy = sample_arrays(times, self.y0, self.dy0)
        start_model(self.mujoco, self.model, self.data, self.key)
        self.data.time = times[0]

    def run(self) -> None:
        # MuJoCo's warnings are not used: whether a run diverges is judged later, from its samples
        with collect_warnings(self.mujoco, []):
            for _, count, size, _, row in self.plan:  # `count` steps of `size` [s], then sample `row` if one is due
                self.model.opt.timestep = size
                self.mujoco.mj_step(self.model, self.data, nstep=count)
                if row is not None:
                    self.y[row], self.dy[row] = self.data.qpos, self.data.qvel

    def read(self) -> Trajectory:
        with collect_warnings(self.mujoco, []):
            states = [self.absolute(*state) for state in zip(self.y, self.dy, strict=True)]
        q, v, a, _ = (np.array(x) for x in zip(*states, strict=True))
        return Trajectory(self.times, q, v, a, sum(stretch.steps for stretch in self.plan))


def find_other_constraint(path: str, key: int, until: float) -> dict[str, Any]:
    """Run the model of a file from a keyframe until `until` [s], or until a contact, a joint limit or dry friction acts.

    Returns:
        "what": a sentence that names the acting element, empty if there is none; and "at": the time [s] at which the run ended.
    """
    import mujoco

    model = open_model(mujoco, path)
    data = mujoco.MjData(model)
    start_model(mujoco, model, data, key)
    equality = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)  # constraints that close loops, which act all the time
    with collect_warnings(mujoco, []):
        mujoco.mj_forward(model, data)
        for _ in range(1 + round(until / model.opt.timestep)):
            for row in np.flatnonzero(data.efc_type != equality):
                kind, number = int(data.efc_type[row]), int(data.efc_id[row])
                return {"what": name_row(mujoco, model, data, kind, number), "at": float(data.time)}
            mujoco.mj_step(model, data)
    return {"what": "", "at": until}


def name_row(mujoco: Any, model: Any, data: Any, kind: int, number: int) -> str:
    """Return a sentence about the element that causes a row of MuJoCo's constraints other than a closure.

    Args:
        kind: the row's member of mjtConstraint.
        number: index of the row's joint, tendon or contact.
    """

    def name_element(tag: str, k: int) -> str:
        """Return words for an element of MJCF: its tag with its name, or with its number if it has none."""
        name = getattr(model, tag)(k).name
        return f'<{tag} name="{name}">' if name else f"<{tag}> number {k + 1}"

    rows = {
        "FRICTION_DOF": ("joint", "has frictionloss"),
        "FRICTION_TENDON": ("tendon", "has frictionloss"),
        "LIMIT_JOINT": ("joint", "is at the end of its range"),
        "LIMIT_TENDON": ("tendon", "is at the end of its range"),
    }
    for name, (tag, does) in rows.items():
        if kind == int(getattr(mujoco.mjtConstraint, f"mjCNSTR_{name}")):
            return f"{name_element(tag, number)} {does}"
    a, b = (int(x) for x in data.contact.geom[number])
    bodies = [model.body(model.geom_bodyid[x]).name or "the world" for x in (a, b)]
    return f"{name_element('geom', a)} of {bodies[0]} touches {name_element('geom', b)} of {bodies[1]}"


def compare_models(before: str, after: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Compare the compiled models of two files, after the options in `changes` (name in MJCF -> value) were applied to the first.

    Return a table with the key "reason": a sentence that says how the two models differ, or an empty text if they are equal.
    """
    import mujoco

    try:
        old, new = (mujoco.MjModel.from_xml_path(path) for path in (before, after))
    except ValueError as error:
        return {"reason": f"MuJoCo cannot compile the file: {' '.join(str(error).split())}"}
    change_options(mujoco, old, changes)
    for expected, found in ((old, new), (old.opt, new.opt)):
        for name in dir(expected):
            value = getattr(expected, name)
            if name.startswith("_") or callable(value) or name in UNCOMPARED:
                continue
            if not np.array_equal(np.asarray(value), np.asarray(getattr(found, name))):
                return {"reason": f"{name} of the compiled model has another value than intended: an included file may set it"}
    return {"reason": ""}
