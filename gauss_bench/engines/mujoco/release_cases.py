"""Cases that compare MuJoCo's releases beyond the adapter's runs: equality constraints that close loops, and default options.

The models of the cases are MJCF documents: every release of MuJoCo reads them, or refuses an equality that it does not know. The
loops are closed in the reference pose, from which MuJoCo takes anchors, lengths and relative poses. In the cases with the equality
`weld`, the rod of the four-bar is two bodies in the same place, which the equality joins.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.engines.bars import (
    CHAIN,
    CURVE,
    FOUR_BAR,
    GRAVITY,
    HALVES,
    PAIR,
    RATIO,
    THREE_CRANKS,
    Bar,
    accelerate_states,
    relative,
)
from gauss_bench.engines.mjcf.across_releases import disable
from gauss_bench.terms import Array

SOLVERS = ("Newton", "CG", "PGS")
EXACT = 'solref="0.004 1" solimp="0.9999 0.9999 0.001"'  # the stiffest closures that documented options allow
FOUR, LENGTH, COUPLED, CRANKS = "wide_four_bar", "rod_of_one_length", "coupled_bars", "three_cranks"
POLYNOMIAL = f'polycoef="0 {RATIO} {CURVE} 0 0"'


@dataclass(frozen=True)
class Closure:
    """One kind of loop closure, and the model in which it closes the loops.

    Attributes:
        model: name of the linkage at whose states accelerations are computed.
        equality, tendons: MJCF elements that close the loops.
        options: attributes of the MJCF element <option>.
    """

    model: str
    bars: tuple[Bar, ...]
    equality: str
    tendons: str = ""
    options: str = ""


TWO_PINS = (
    f'<connect body1="middle" body2="beam" anchor="1 0 0" {EXACT}/><connect body1="beam" body2="right" anchor="2 0 0" {EXACT}/>'
)
FIXED = '<fixed name="a"><joint joint="first" coef="1"/></fixed><fixed name="b"><joint joint="second" coef="1"/></fixed>'
SPATIAL = '<spatial name="rod"><site site="crank"/><site site="rocker"/></spatial>'
CLOSURES = {
    "connect of bodies": Closure(FOUR, FOUR_BAR, f'<connect body1="rod" body2="rocker" anchor="2 0 0" {EXACT}/>'),
    "connect of sites": Closure(FOUR, FOUR_BAR, f'<connect site1="rod" site2="rocker" {EXACT}/>'),
    "weld of bodies": Closure(FOUR, HALVES, f'<weld body1="rod" body2="twin" {EXACT}/>'),
    "weld of sites": Closure(FOUR, HALVES, f'<weld site1="rod middle" site2="twin middle" {EXACT}/>'),
    "joint": Closure(COUPLED, CHAIN, f'<joint joint1="second" joint2="first" {POLYNOMIAL} {EXACT}/>'),
    "tendon of joints": Closure(COUPLED, CHAIN, f'<tendon tendon1="b" tendon2="a" {POLYNOMIAL} {EXACT}/>', FIXED),
    "tendon between sites": Closure(LENGTH, PAIR, f'<tendon tendon1="rod" {EXACT}/>', SPATIAL),
    # two loops through different branches of the tree share a body, so the columns of the sparse factor have different descendants
    "connects of branches, dense": Closure(CRANKS, THREE_CRANKS, TWO_PINS, options='jacobian="dense"'),
    "connects of branches, sparse": Closure(CRANKS, THREE_CRANKS, TWO_PINS, options='jacobian="sparse"'),
}
KINDS = ("mjtIntegrator", "mjtSolver", "mjtJacobian", "mjtCone", "mjtEq", "mjtDisableBit", "mjtEnableBit")


def list_probes() -> list[dict[str, str]]:
    """List the cases: every closure with every solver of constraints; each has a name and the name of its linkage."""
    return [{"name": f"{name}, {solver}", "model": closure.model} for name, closure in CLOSURES.items() for solver in SOLVERS]


def ask_probe(name: str, q: Array, v: Array) -> Array:
    """Return the absolute accelerations (k, n) of a case at absolute states q, v (k, n); `name` is "CLOSURE, SOLVER"."""
    import mujoco

    closure_name, _, solver = name.rpartition(", ")
    closure = CLOSURES[closure_name]
    model = mujoco.MjModel.from_xml_string(write_document(closure, solver))
    data: Any = mujoco.MjData(model)
    disable(mujoco, model, ["mjDSBL_WARMSTART"])  # a result must not depend on the state that was evaluated before

    def solve(y: Array, dy: Array) -> Array:
        """Return the accelerations (bars,) of the joint coordinates at y, dy (bars,)."""
        data.qpos[:], data.qvel[:] = y, dy
        mujoco.mj_forward(model, data)
        return np.array(data.qacc)

    return accelerate_states(solve, q, v, closure.bars)


def write_document(closure: Closure, solver: str) -> str:
    """Return an MJCF document of a tree of bars whose loops are closed by the equality constraints of `closure`."""
    bars = closure.bars
    pose = reference_pose(bars)
    bodies = "".join(write_bar(k, bars, pose) for k, bar in enumerate(bars) if bar.parent < 0)
    options = f'gravity="0 {GRAVITY} 0" integrator="Euler" solver="{solver}" iterations="300" tolerance="1e-15" {closure.options}'
    head = f'<compiler angle="radian"/><option {options}/>'
    tendons = f"<tendon>{closure.tendons}</tendon>" if closure.tendons else ""
    return f"<mujoco>{head}<worldbody>{bodies}</worldbody>{tendons}<equality>{closure.equality}</equality></mujoco>"


def write_bar(number: int, bars: Sequence[Bar], pose: Sequence[float]) -> str:
    """Return the MJCF body of a bar, with its child bars; the bar's joint coordinate is its angle relative to the parent.

    Args:
        pose: (bars,) angles in the reference pose, each relative to the parent's [rad].
    """
    bar = bars[number]
    inner = "".join(write_bar(k, bars, pose) for k, x in enumerate(bars) if x.parent == number)
    inertia = f'<inertial pos="{bar.centre} 0 0" mass="{bar.mass}" diaginertia="{bar.inertia} {bar.inertia} {bar.inertia}"/>'
    joint = f'<joint name="{bar.name}" axis="0 0 1" ref="{pose[number]!r}"/>'
    sites = f'<site name="{bar.name}" pos="{bar.length} 0 0"/><site name="{bar.name} middle" pos="{bar.centre} 0 0"/>'
    place = f'pos="{bar.at} 0 0" euler="0 0 {pose[number]!r}"'
    return f'<body name="{bar.name}" {place}>{inertia}{joint}{sites}{inner}</body>'


def reference_pose(bars: Sequence[Bar]) -> list[float]:
    """Return the angles (bars,) of a pose with closed loops, each relative to the parent's [rad]."""
    if bars in (CHAIN, THREE_CRANKS):  # closed at zero angles
        return [0.0] * len(bars)
    crank = 0.9  # [rad] an arbitrary angle
    end = np.array([np.cos(crank), np.sin(crank)])  # of the crank, whose length is 1 m
    pivot, rod, rocker = np.array([2.2, 0.0]), 2.0, 1.5  # the rocker's pin on the ground, and lengths [m]
    line = pivot - end
    distance = float(np.hypot(*line))
    # rod and rocker meet where circles about the crank's end and about the rocker's pin intersect
    along = (rod**2 - rocker**2 + distance**2) / (2 * distance)  # along the line from the crank's end to the rocker's pin
    height = float(np.sqrt(rod**2 - along**2))  # above that line
    meeting = end + (along * line + height * np.array([-line[1], line[0]])) / distance
    rod_angle, rocker_angle = (float(np.arctan2(x[1], x[0])) for x in (meeting - end, meeting - pivot))
    angles = {"crank": crank, "rod": rod_angle, "rocker": rocker_angle}
    theta = np.array([angles["rod" if bar.name == "twin" else bar.name] for bar in bars])
    return [float(x) for x in relative(theta, bars)]


def defaults() -> dict[str, str]:
    """Return name of an option -> its default value, and name of each member of MuJoCo's enumerations KINDS -> "there"."""
    import mujoco

    body, equality = '<body name="a"><geom size="1"/><joint/></body>', '<connect body1="a" anchor="0 0 0"/>'
    text = f"<mujoco><worldbody>{body}</worldbody><equality>{equality}</equality></mujoco>"
    model: Any = mujoco.MjModel.from_xml_string(text)
    options = [name for name in dir(model.opt) if not name.startswith("_") and not callable(getattr(model.opt, name))]
    found = {f"option {name}": write_numbers(getattr(model.opt, name)) for name in options}
    found |= {f"equality {name}": write_numbers(getattr(model, name)) for name in ("eq_solref", "eq_solimp")}
    found |= {f"joint {name}": write_numbers(getattr(model, name)) for name in ("dof_armature", "dof_damping", "jnt_stiffness")}
    for kind in KINDS:
        if hasattr(mujoco, kind):
            # names that begin with mjN are numbers of members
            members = (name for name in dir(getattr(mujoco, kind)) if name.startswith("mj") and not name.startswith("mjN"))
            found |= {f"{kind} {name}": "there" for name in members}
    return found


def write_numbers(value: Any) -> str:
    """Return the numbers of a value as a text with 12 digits each, which does not depend on the types of a release."""
    return " ".join(f"{x:.12g}" for x in np.ravel(np.asarray(value, dtype=float)))
