"""Cases that compare Pinocchio's releases beyond the adapter's runs: constraints, algorithms, and default settings."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gauss_bench.engines.bars import FOUR_BAR, GRAVITY, HALVES, Bar, accelerate_states
from gauss_bench.engines.pinocchio.across_releases import corrector_of, find_algorithm, prepare
from gauss_bench.terms import Array

FOUR = "wide_four_bar"
KINDS = {"CONTACT_3D": FOUR_BAR, "CONTACT_6D": HALVES}  # kind of constraint -> the bars whose loop it closes
FRAMES = ("LOCAL", "LOCAL_WORLD_ALIGNED")
ALGORITHMS = ("constraintDynamics", "lcaba")
BY_JACOBIAN = "forwardDynamics of J and gamma"
MU = 1e-10  # proximal regularisation of constraintDynamics
MU_LCABA = 1e-6  # proximal regularisation of lcaba
ITERATIONS = 50
ACCURACY = 1e-14


def list_probes() -> list[dict[str, str]]:
    """List the cases: each kind of constraint in each frame with each algorithm, and one case that is given a Jacobian."""
    names = [f"{kind} {frame}, {algorithm}" for kind in KINDS for frame in FRAMES for algorithm in ALGORITHMS]
    return [{"name": name, "model": FOUR} for name in (*names, BY_JACOBIAN)]


def ask_probe(name: str, q: Array, v: Array) -> Array:
    """Return the absolute accelerations (k, n) of the four-bar at absolute states q, v (k, n), for one case of `list_probes`.

    The name of the case states the kind of constraint, the frame and the algorithm ("CONTACT_3D LOCAL, lcaba"), or is BY_JACOBIAN.
    """
    import pinocchio

    kind, _, algorithm = name.rpartition(", ")
    contact, _, frame = kind.partition(" ")
    bars = KINDS.get(contact, FOUR_BAR)
    model, joints = build(pinocchio, bars)
    if name == BY_JACOBIAN:
        solve = by_jacobian(pinocchio, model, joints)
    else:
        solve = by_constraint(pinocchio, model, joints, bars, contact, frame, algorithm)
    return accelerate_states(solve, q, v, bars)


Solve = Callable[[Array, Array], Array]  # function of joint angles and rates (bars,) -> joint accelerations (bars,)


def build(pin: Any, bars: Sequence[Bar]) -> tuple[Any, list[int]]:
    """Return the model of a tree of bars, each in a frame at its first pin along the bar, and the index of each bar's joint."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, GRAVITY, 0.0])
    joints: list[int] = []
    for bar in bars:
        parent = 0 if bar.parent < 0 else joints[bar.parent]
        joint = model.addJoint(parent, pin.JointModelRZ(), shift(pin, bar.at), bar.name)
        lamina = np.diag([bar.inertia / 2, bar.inertia / 2, bar.inertia])
        model.appendBodyToJoint(joint, pin.Inertia(bar.mass, np.zeros(3), lamina), shift(pin, bar.centre))
        joints.append(joint)
    return model, joints


def shift(pin: Any, at: float) -> Any:
    """Return the placement of a point `at` [m] along a bar, in the bar's frame."""
    return pin.SE3(np.eye(3), np.array([at, 0.0, 0.0]))


def by_constraint(
    pin: Any, model: Any, joints: Sequence[int], bars: Sequence[Bar], contact: str, frame: str, algorithm: str
) -> Solve:
    """Return a function (y, dy) -> joint accelerations (bars,) by one of Pinocchio's algorithms for constrained dynamics.

    Args:
        joints: Pinocchio's index of each bar's joint.
        contact: member of pin.ContactType: points or whole frames coincide.
        frame: member of pin.ReferenceFrame: the axes along which the constraint is written.
        algorithm: name of Pinocchio's function.
    """
    # the end of the rod, 2 m long, coincides with the end of the rocker, 1.5 m long
    ends = (joints[1], shift(pin, 2.0)), (joints[2], shift(pin, 1.5))
    if contact == "CONTACT_6D":  # the two halves of the rod, two bodies in the same place
        ends = (joints[1], shift(pin, 1.0)), (joints[3], shift(pin, -1.0))
    kind, axes = getattr(pin.ContactType, contact), getattr(pin.ReferenceFrame, frame)
    row = pin.RigidConstraintModel(kind, model, *ends[0], *ends[1], axes)
    rows, data = pin.StdVec_RigidConstraintModel(), model.createData()
    rows.append(row)
    row_data = pin.StdVec_RigidConstraintData()
    row_data.append(row.createData())
    call = find_algorithm(pin, algorithm)
    prepare(pin, algorithm, model, data, rows, row_data)
    mu = MU if algorithm == "constraintDynamics" else MU_LCABA
    settings = pin.ProximalSettings(ACCURACY, ACCURACY, mu, ITERATIONS)
    tau = np.zeros(model.nv)
    return lambda y, dy: np.array(call(model, data, y, dy, tau, rows, row_data, settings))


def by_jacobian(pin: Any, model: Any, joints: Sequence[int]) -> Solve:
    """Return a function (y, dy) -> joint accelerations (bars,) by forwardDynamics, from Jacobians and bias accelerations."""
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    kind = pin.FrameType.OP_FRAME
    frames = [
        model.addFrame(pin.Frame(name, joint, shift(pin, at), kind))
        for name, joint, at in (("rod end", joints[1], 2.0), ("rocker end", joints[2], 1.5))
    ]
    data = model.createData()

    def constrained_accelerations(y: Array, dy: Array) -> Array:
        pin.computeJointJacobians(model, data, y)
        pin.forwardKinematics(model, data, y, dy, np.zeros(model.nv))
        pin.updateFramePlacements(model, data)
        J = np.subtract(*(np.array(pin.getFrameJacobian(model, data, x, world))[:2] for x in frames))
        # the difference of the ends' accelerations if the joint accelerations are zero; Pinocchio solves J y'' + bias = 0
        bias = np.subtract(*(np.array(pin.getFrameClassicalAcceleration(model, data, x, world).linear)[:2] for x in frames))
        undamped = 0.0  # no regularisation
        return np.array(pin.forwardDynamics(model, data, y, dy, np.zeros(model.nv), J, bias, undamped))

    return constrained_accelerations


def defaults() -> dict[str, str]:
    """Return name -> default value, of ProximalSettings and of Baumgarte's gains.

    Pinocchio's public names about constraints, contacts, dynamics or solvers are listed too, each with the value "there".
    """
    import pinocchio as pin

    values: dict[str, str] = {}
    settings = pin.ProximalSettings()
    for name in ("absolute_accuracy", "relative_accuracy", "mu", "max_iter"):
        if hasattr(settings, name):
            values[f"ProximalSettings {name}"] = f"{getattr(settings, name):.12g}"
    model, joints = build(pin, FOUR_BAR)
    ends = joints[1], shift(pin, 2.0), joints[2], shift(pin, 1.5)
    row = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ends, pin.ReferenceFrame.LOCAL)
    for name in ("Kp", "Kd"):
        values[f"Baumgarte {name}"] = " ".join(f"{x:.12g}" for x in np.ravel(getattr(corrector_of(row), name)))
    words = ("onstraint", "aba", "Aba", "ABA", "Contact", "contact", "Dynamics", "Solver", "Admm", "ADMM", "PGS")
    public = [name for name in dir(pin) if not name.startswith(("_", "Std"))]
    return values | {f"function {name}": "there" for name in public if any(word in name for word in words)}
