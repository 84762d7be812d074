"""MuJoCo: a tree of links in relative coordinates, closed by soft `connect` constraints between sites.

Every link is a body whose frame is that of its centre of mass; its coordinate is the tree coordinate y, with the start of the
mechanism as MuJoCo's reference pose, so that the loops are closed where the compiler measures body_invweight0. Angles of links are
sums of hinge coordinates, theta = e . y + const, and forces are expressed with what MuJoCo has, exactly or not at all:

    torque                          constant generalised force on the hinges of the chain
    force at a point                site transmission; with a reference site in the world where the force does not turn
    spring and damper of points     spatial tendon
    ... on L = e . y + const        stiffness and damping of one joint, or a fixed tendon
    ... along an axis               site transmission with a reference site, force = k rest - k x - c x'

The generated model is compared with the suite's own terms before it is used: mass matrix, velocity terms plus all forces, and gaps
of the open joints, at the start and at random tree states. Only the softness of the closures is left unchecked: it is what the
settings vary.
"""

import copy
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.integrate.fixed_step import step_counts
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.forces import axis_state, position, rotated
from gauss_bench.mechanism.model import (
    GROUND,
    AxisSpringDamper,
    Force,
    Joint,
    JointDamping,
    Link,
    Mechanism,
    Point,
    PointForce,
    Prismatic,
    RotationalSpringDamper,
    SpringDamper,
    Torque,
)
from gauss_bench.mechanism.tree import Branch, Tree, spanning_tree
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

INTEGRATORS = {"rk4": "mjINT_RK4", "euler": "mjINT_EULER", "implicitfast": "mjINT_IMPLICITFAST", "discrete": "mjINT_DISCRETE"}
AGREEMENT = 1e-10  # relative: rounding of both sides leaves about 1e-14, a wrong sign or factor about 1
PARALLEL = 1e-12  # sine of the angle between a spring's axis and its slide: angles are summed in different orders


@dataclass(frozen=True)
class Softness:
    """What decides how rigid the loop closures are; the names are MuJoCo's.

    Attributes:
        solref: time constant, in units of `solref_unit` ("s" or "step"), and damping ratio of the constraint.
        solimp: impedance d0, d_width, width, midpoint, power; MuJoCo clamps impedances to 0.9999.
        tolerance, iterations: of the constraint solver.
        body_invweight0_factor: on the compiled inverse weights, to which the softness is proportional.
        remark: what the reader of a table must know.
    """

    solref: tuple[float, float]
    solref_unit: str
    solimp: tuple[float, float, float, float, float]
    tolerance: float
    iterations: int
    body_invweight0_factor: float
    remark: str


SOFTNESS = {
    "default": Softness((0.02, 1.0), "s", (0.9, 0.95, 0.001, 0.5, 2.0), 1e-8, 100, 1.0, "as shipped"),
    "tuned": Softness((2.0, 1.0), "step", (0.9999, 0.9999, 0.001, 0.5, 2.0), 1e-15, 100, 1.0, "documented options only"),
    "rigid": Softness(
        (0.02, 1.0),
        "s",
        (0.9999, 0.9999, 0.001, 0.5, 2.0),
        0.0,
        3,
        1e-6,
        "edits a compiled constant, which is no documented option",
    ),
}


class Inexpressible(ValueError):
    """A force or joint MuJoCo has no exact expression for; the text is a full sentence without its full stop."""


class Mujoco:
    """MuJoCo under three settings of how rigid its closures are."""

    name = "mujoco"
    integrators = tuple(INTEGRATORS)
    stabilizations = ("none",)
    settings: Mapping[str, Mapping[str, object]] = {label: asdict(x) for label, x in SOFTNESS.items()}
    native_loop = True
    python_loop = True

    def version(self) -> str:
        import mujoco

        return f"mujoco {mujoco.__version__}"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if mechanism.drivers:
            return "a prescribed motion is not modelled in MuJoCo here"
        if mechanism.knife_edges:
            return "MuJoCo has no constraint on velocities alone (knife edge)"
        tree = spanning_tree(mechanism)
        try:
            closing_pins(tree)
            native_forces(mechanism, tree)
        except Inexpressible as reason:
            return str(reason)
        return None

    def build(self, mechanism: Mechanism, choice: Choice) -> "MujocoModel":
        return MujocoModel(mechanism, choice)


# What MuJoCo can express ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Coordinate:
    """Force k (rest - L) - c dL/dt on L = row . y + constant, where row (n,) has entries of 0 and +-1."""

    row: Array
    constant: float
    k: float
    c: float
    rest: float


@dataclass(frozen=True, eq=False)
class AtSite:
    """Force (bias . [1, L, dL/dt]) * direction at a point, the opposite one on the frame.

    `direction` (2,) is fixed in the link of `frame`, or of `point` where `frame` is None and nothing takes the reaction;
    L is the coordinate of the point along it, from `frame`.
    """

    point: Point
    frame: Point | None
    direction: Array
    bias: tuple[float, float, float]


Native = Torque | SpringDamper | Coordinate | AtSite


@dataclass(frozen=True, eq=False)
class Turning:
    """Angles of links as theta = rows . y + constants: (links + 1, n) and (links + 1,); the last row is the ground."""

    rows: Array
    constants: Array

    def together(self, a: int, b: int) -> bool:
        """Whether two links never turn relative to each other."""
        return bool((self.rows[a] == self.rows[b]).all())

    def turns_with(self, a: int, b: int) -> bool:
        """Whether every hinge that turns link a turns b as well."""
        return bool((self.rows[a] <= self.rows[b]).all())

    def apart(self, a: int, b: int) -> bool:
        """Whether no hinge turns both links."""
        return not (self.rows[a] * self.rows[b]).any()


def turning(tree: Tree) -> Turning:
    rows, constants = np.zeros((tree.links + 1, tree.n)), np.zeros(tree.links + 1)
    for b in tree.branches:
        rows[b.link], constants[b.link] = rows[b.parent], constants[b.parent] + b.turn
        if b.kind != "prismatic":
            rows[b.link, b.at + (2 if b.kind == "free" else 0)] = 1.0
    return Turning(rows, constants)


def closing_pins(tree: Tree) -> list[tuple[Point, Point]]:
    """The pairs of points that `connect` holds together.

    Raises:
        Inexpressible: a slide is left open.
    """
    for joint in tree.closures:
        if isinstance(joint, Prismatic):
            raise Inexpressible(f"the slide {joint.name} closes a loop of slides, for which MuJoCo has no constraint")
    return [(joint.a, joint.b) for joint in tree.closures if not isinstance(joint, Prismatic)]


def native_forces(mechanism: Mechanism, tree: Tree) -> list[Native]:
    """All forces in MuJoCo's terms.

    Raises:
        Inexpressible: naming the force and why.
    """
    turns = turning(tree)
    return [x for f in mechanism.forces for x in native_force(f, mechanism, tree, turns)]


def native_force(f: Force, mechanism: Mechanism, tree: Tree, turns: Turning) -> list[Native]:
    match f:
        case Torque() | SpringDamper():
            return [f]
        case PointForce():
            return point_force(f, turns)
        case RotationalSpringDamper():
            return [between(turns, f.a, f.b, f.k, f.c, f.rest)]
        case AxisSpringDamper():
            return [axis_force(f, mechanism, tree, turns)]
        case JointDamping():
            return [pair_damping(pair, f.c, tree, turns) for pair in f.pairs]


def between(turns: Turning, a: int, b: int, k: float, c: float, rest: float) -> Coordinate:
    """A torsion spring and damper on theta_b - theta_a."""
    return Coordinate(turns.rows[b] - turns.rows[a], turns.constants[b] - turns.constants[a], k, c, rest)


def pair_damping(pair: Joint, c: float, tree: Tree, turns: Turning) -> Coordinate:
    """Damping of one pair; a slide is always a branch of the tree, or the mechanism has been refused."""
    if not isinstance(pair, Prismatic):
        return between(turns, pair.a.link, pair.b.link, 0.0, c, 0.0)
    row = np.zeros(tree.n)
    row[[b.at for b in tree.branches if b.joint is pair]] = 1.0
    return Coordinate(row, 0.0, 0.0, c, 0.0)


def point_force(f: PointForce, turns: Turning) -> list[Native]:
    """A constant force that turns with the world, with the link it acts on, or with a link whose hinges do not move the point.

    In the last case a second force takes the reaction off the link that only gives the direction.

    Raises:
        Inexpressible: it turns with any other link.
    """
    link, bias = f.point.link, (1.0, 0.0, 0.0)
    if turns.together(f.frame, GROUND):
        world = Point(GROUND, np.zeros(2), "ground")
        return [AtSite(f.point, world, rotated(f.value, turns.constants[f.frame]), bias)]
    if turns.together(f.frame, link):
        return [AtSite(f.point, None, rotated(f.value, turns.constants[f.frame] - turns.constants[link]), bias)]
    if turns.apart(f.frame, link):
        frame = Point(f.frame, np.zeros(2), "centre of mass")
        return [AtSite(f.point, frame, f.value, bias), AtSite(frame, None, f.value, bias)]
    raise Inexpressible(f"MuJoCo cannot turn the force {f.name} with a link whose hinges move its point")


def axis_force(f: AxisSpringDamper, mechanism: Mechanism, tree: Tree, turns: Turning) -> Coordinate | AtSite:
    """A spring on a slide's own coordinate, or a site transmission.

    The force of a site transmission lacks what the turning of the reference site adds to the rate of the coordinate, except where
    both sites turn on the same hinge, which leaves the coordinate alone.

    Raises:
        Inexpressible: a hinge turns the origin, but not the point.
    """
    on_slide = slide_coordinate(f, mechanism, tree)
    if on_slide is not None:
        return on_slide
    if turns.turns_with(f.origin.link, f.point.link):
        direction = np.array([np.cos(f.angle), np.sin(f.angle)])
        return AtSite(f.point, f.origin, direction, (f.k * f.rest, -f.k, -f.c))
    origin, point = mechanism.link_name(f.origin.link), mechanism.link_name(f.point.link)
    raise Inexpressible(f"MuJoCo has no exact axis for {f.name}: in the tree, {origin} turns on a hinge that does not turn {point}")


def slide_coordinate(f: AxisSpringDamper, mechanism: Mechanism, tree: Tree) -> Coordinate | None:
    """The spring as one on the slide between the two links, if its axis is parallel to the slide's."""
    pair = {f.point.link, f.origin.link}
    branch = next((b for b in tree.branches if b.kind == "prismatic" and {b.link, b.parent} == pair), None)
    if branch is None:
        return None
    y, _ = tree.relative(mechanism.q0, mechanism.v0)
    unit = np.zeros(tree.n)
    unit[branch.at] = 1.0
    q, v, _ = tree.absolute(y, unit, np.zeros(tree.n))
    x, rate, _ = axis_state(q, v, f.point, f.origin, f.angle)  # sliding at unit speed: the rate is the cosine
    _, across, _ = axis_state(q, v, f.point, f.origin, f.angle + np.pi / 2)
    if abs(across) > PARALLEL:
        return None
    sign = float(np.sign(rate))
    return Coordinate(sign * unit, float(x) - sign * y[branch.at], f.k, f.c, f.rest)


# The model --------------------------------------------------------------------------------------------------------------


class Draft:
    """A model under construction.

    Attributes:
        spec: what MuJoCo compiles.
        torque: (n,) constant generalised force, which MuJoCo keeps outside the model.
    """

    def __init__(self, mechanism: Mechanism, tree: Tree):
        import mujoco

        self.mujoco: Any = mujoco
        self.tree, self.turns = tree, turning(tree)
        self.spec: Any = mujoco.MjSpec()
        self.spec.compiler.degree = False
        self.spec.option.gravity = [*mechanism.gravity, 0.0]
        self.torque = np.zeros(tree.n)
        self.bodies: dict[int, Any] = {GROUND: self.spec.worldbody}
        self.joints: dict[int, Any] = {}
        self.sites = 0
        y, _ = tree.relative(mechanism.q0, mechanism.v0)
        for b in tree.branches:
            self.add_link(b, mechanism.links[b.link], y)
        for pair in closing_pins(tree):
            self.add_closure(*pair)
        springs = [self.add_force(x) for x in native_forces(mechanism, tree)]
        self.add_joint_springs([x for x in springs if x is not None])

    def add_link(self, b: Branch, link: Link, y: Array) -> None:
        """A body without geometry, placed at the tree coordinates y (n,), with its joints."""
        origin, angle = rest_pose(b, y)
        body = self.bodies[b.parent].add_body(
            name=f"link{b.link}", pos=[*origin, 0.0], quat=[np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]
        )
        body.explicitinertial = True
        body.mass, body.ipos, body.inertia = link.mass, [0.0] * 3, [link.inertia] * 3  # only the last moment of inertia acts
        self.bodies[b.link] = body
        hinge, slide = self.mujoco.mjtJoint.mjJNT_HINGE, self.mujoco.mjtJoint.mjJNT_SLIDE

        def joint(at: int, kind: Any, axis: list[float], anchor: Array) -> None:
            self.joints[at] = body.add_joint(name=f"y{at}", type=kind, axis=axis, pos=[*anchor, 0.0], ref=y[at])

        free: list[Array] = list(np.eye(2)) if b.kind == "free" else []
        slides = [b.axis] if b.kind == "prismatic" else free
        for i, axis in enumerate(slides):
            joint(b.at + i, slide, [*rotated(axis, np.array(-angle)), 0.0], np.zeros(2))  # axes are given in the child's frame
        if b.kind != "prismatic":
            joint(b.at + len(slides), hinge, [0.0, 0.0, 1.0], b.anchor)

    def add_site(self, point: Point) -> str:
        name = f"site{self.sites}"
        self.sites += 1
        self.bodies[point.link].add_site(name=name, pos=[*point.local, 0.0])
        return name

    def add_closure(self, a: Point, b: Point) -> None:
        self.spec.add_equality(
            type=self.mujoco.mjtEq.mjEQ_CONNECT,
            objtype=self.mujoco.mjtObj.mjOBJ_SITE,
            name1=self.add_site(a),
            name2=self.add_site(b),
        )

    def add_force(self, f: Native) -> Coordinate | None:
        """Add a force; those on single joints are handed back, because a joint has room for only one."""
        match f:
            case Torque():
                self.torque += f.value * (self.turns.rows[f.link] - self.turns.rows[f.reaction])
            case SpringDamper():
                tendon = self.spec.add_tendon()
                tendon.wrap_site(self.add_site(f.a))
                tendon.wrap_site(self.add_site(f.b))
                set_spring(tendon, f.k, f.c)
                tendon.springlength = [f.rest] * 2
            case AtSite():
                self.add_site_force(f)
            case Coordinate() if np.count_nonzero(f.row) == 1:
                return f
            case Coordinate() if f.row.any():
                self.add_fixed_tendon(f)
        return None

    def add_site_force(self, f: AtSite) -> None:
        actuator = self.spec.add_actuator(trntype=self.mujoco.mjtTrn.mjTRN_SITE, target=self.add_site(f.point))
        if f.frame is not None:
            actuator.refsite = self.add_site(f.frame)
        actuator.gear = [*f.direction, 0.0, 0.0, 0.0, 0.0]
        actuator.gainprm = np.zeros_like(actuator.gainprm)  # no control enters
        actuator.biastype = self.mujoco.mjtBias.mjBIAS_AFFINE
        actuator.biasprm = [*f.bias, *np.zeros(len(actuator.biasprm) - 3)]

    def add_fixed_tendon(self, f: Coordinate) -> None:
        """A spring on a sum of joint coordinates, signed so that its length at rest is not negative: -1 has another meaning."""
        rest = f.rest - f.constant
        sign = -1.0 if rest < 0 else 1.0
        tendon = self.spec.add_tendon()
        for at in np.flatnonzero(f.row):
            tendon.wrap_joint(f"y{at}", sign * f.row[at])
        set_spring(tendon, f.k, f.c)
        tendon.springlength = [sign * rest] * 2

    def add_joint_springs(self, springs: list[Coordinate]) -> None:
        """Springs and dampers on one joint act as one: stiffnesses add up, and so do their moments at y = 0."""
        at = [int(np.flatnonzero(f.row)[0]) for f in springs]
        for joint in set(at):
            here = [f for f, place in zip(springs, at, strict=True) if place == joint]
            k = sum(f.k for f in here)
            pull = sum(f.k * (f.rest - f.constant) * f.row[joint] for f in here)
            set_spring(self.joints[joint], k, sum(f.c for f in here))
            self.joints[joint].springref = pull / k if k else 0.0


def rest_pose(b: Branch, y: Array) -> tuple[Array, float]:
    """Origin (2,) and angle of a branch's link in its parent's frame."""
    if b.kind == "free":
        return y[b.at : b.at + 2], float(y[b.at + 2])
    slide = b.base + y[b.at] * b.axis if b.kind == "prismatic" else np.zeros(2)
    angle = b.turn if b.kind == "prismatic" else float(y[b.at])
    return b.parent_anchor + slide - rotated(b.anchor, np.array(angle)), angle


def set_spring(item: Any, k: float, c: float) -> None:
    """Linear stiffness and damping of a joint or tendon, where MuJoCo has room for polynomials."""
    item.stiffness, item.damping = [k, 0.0, 0.0], [c, 0.0, 0.0]


def soften(model: Any, softness: Softness, step: float) -> None:
    """Apply a setting to a compiled model."""
    unit = step if softness.solref_unit == "step" else 1.0
    model.eq_solref[:] = [softness.solref[0] * unit, softness.solref[1]]
    model.eq_solimp[:] = softness.solimp
    model.opt.tolerance, model.opt.iterations = softness.tolerance, softness.iterations
    model.body_invweight0[:] *= softness.body_invweight0_factor  # compiling again would undo it


class MujocoModel:
    """A mechanism in MuJoCo under one integrator and setting.

    Attributes:
        model, data: what is stepped.
        still, still_data: a copy for accelerations at given states, with the Euler integrator (under `discrete`, MuJoCo's qacc is a
            difference of velocities) and without warm start (an answer must not depend on the state asked before).
    """

    def __init__(self, mechanism: Mechanism, choice: Choice):
        import mujoco

        self.mujoco: Any = mujoco
        self.mechanism, self.choice = mechanism, choice
        self.tree = spanning_tree(mechanism)
        self.y0, self.dy0 = self.tree.relative(mechanism.q0, mechanism.v0)
        try:
            draft = Draft(mechanism, self.tree)
            self.model: Any = draft.spec.compile()
        except Inexpressible as reason:
            raise RunFailure(Status.SKIP, str(reason)) from reason
        except ValueError as error:
            raise RunFailure(Status.ERROR, f"MuJoCo cannot compile the model: {error}") from error
        self.torque = draft.torque
        soften(self.model, SOFTNESS[choice.settings], choice.step)
        self.model.opt.timestep = choice.step
        self.model.opt.integrator = getattr(mujoco.mjtIntegrator, INTEGRATORS[choice.integrator or "rk4"])
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)  # a reset would pass for a motion
        self.still: Any = copy.copy(self.model)
        self.still.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        self.still.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_WARMSTART)
        self.data: Any = mujoco.MjData(self.model)
        self.still_data: Any = mujoco.MjData(self.still)
        self.still_data.qfrc_applied[:] = self.torque
        verify(self)

    def forward(self, y: Array, dy: Array) -> Any:
        """MuJoCo's data at tree state y, dy (n,)."""
        data = self.still_data
        data.qpos[:], data.qvel[:] = y, dy
        self.mujoco.mj_forward(self.still, data)
        return data

    def tree_acceleration(self, t: float, y: Array, dy: Array) -> Array:
        """Accelerations (3 links,) in absolute coordinates at tree state y, dy (n,)."""
        a = self.tree.absolute(y, dy, self.forward(y, dy).qacc)[2]
        if not np.isfinite(a).all():
            raise RunFailure(Status.NAN, f"t = {t:.6g} s: MuJoCo's acceleration is not finite")
        return a

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self.tree_acceleration(t, *self.tree.relative(q, v))

    def prepare(self, times: Array, native: bool = True) -> None:
        self.times, self.native = times, native
        self.plan = step_counts(times, self.choice.step)
        self.y, self.dy = np.tile(self.y0, (len(times), 1)), np.tile(self.dy0, (len(times), 1))
        self.complaints: list[str] = []
        self.mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = self.y0, self.dy0
        self.data.qfrc_applied[:] = self.torque

    def run(self) -> None:
        usual = self.mujoco.get_mju_user_warning()
        self.mujoco.set_mju_user_warning(self.complaints.append)  # MuJoCo would write them to a file
        try:
            self._run()
        finally:
            self.mujoco.set_mju_user_warning(usual)

    def _run(self) -> None:
        step, model, data = self.mujoco.mj_step, self.model, self.data
        for k, (count, size) in enumerate(self.plan):
            model.opt.timestep = size
            if self.native:
                step(model, data, nstep=count)
            else:
                for _ in range(count):
                    step(model, data)
            self.y[k + 1], self.dy[k + 1] = data.qpos, data.qvel

    def read(self) -> Trajectory:
        self._check()
        rest = np.zeros_like(self.y)
        q, v, _ = self.tree.absolute(self.y, self.dy, rest)
        states = zip(self.times, self.y, self.dy, strict=True)
        a = np.array([self.tree_acceleration(float(t), y, dy) for t, y, dy in states])
        return Trajectory(self.times, q, v, a, sum(count for count, _ in self.plan))

    def _check(self) -> None:
        advice = "a smaller step or another integrator may help"
        finite = np.isfinite(self.y).all(axis=1) & np.isfinite(self.dy).all(axis=1)
        said = f"; MuJoCo: {self.complaints[0]}" if self.complaints else ""
        if not finite.all():
            raise RunFailure(Status.NAN, f"not finite at t = {self.times[finite.argmin()]:.6g} s{said}; {advice}")
        if self.complaints or any(w.number for w in self.data.warning):
            raise RunFailure(Status.WARNING, f"MuJoCo warned before t = {self.times[-1]:.6g} s{said}; {advice}")
        span = float(self.times[-1] - self.times[0])
        shortest = min((size for _, size in self.plan), default=1.0)
        if abs(self.data.time - span) > 0.5 * shortest:  # rounding adds up to far less than a lost step
            raise RunFailure(Status.ERROR, f"MuJoCo's clock shows {self.data.time:.6g} s instead of {span:.6g} s")


# Verification -----------------------------------------------------------------------------------------------------------


def verify(built: MujocoModel) -> None:
    """Compare a built model with the suite's own terms, at the start and at random tree states with open joints apart.

    With V the map from tree to absolute speeds and a0 the acceleration at rest of the tree's own, unconstrained motion obeys

        V^T M V y'' = V^T (Q - M a0)

    and MuJoCo's two sides must be the same, all forces included; so must the gaps of the open pins.

    Raises:
        RunFailure: they differ.
    """
    random, evaluator = np.random.default_rng(0), Evaluator(built.mechanism)
    spread = (0.0, 0.5, 1.0, 2.0, 3.0)  # rad and m about the start; 10 times that in speeds
    for size in spread:
        y = built.y0 + size * random.uniform(-1.0, 1.0, built.tree.n)
        dy = built.dy0 + 10.0 * size * random.uniform(-1.0, 1.0, built.tree.n)
        for what, (own, theirs, scale) in comparison(built, evaluator, y, dy).items():
            error = np.abs(own - theirs).max(initial=0.0)
            if not error <= AGREEMENT * scale:
                raise RunFailure(Status.ERROR, f"the generated MuJoCo model differs in {what} by {error:.1e} (of {scale:.1e})")


def comparison(built: MujocoModel, evaluator: Evaluator, y: Array, dy: Array) -> dict[str, tuple[Array, Array, float]]:
    """Everything but the softness of the closures at a tree state y, dy (n,): own value, MuJoCo's, and the size of its parts."""
    tree, n = built.tree, built.tree.n
    data = built.forward(y, dy)
    q, v, a0 = tree.absolute(y, dy, np.zeros(n))
    speeds = tree.absolute(np.tile(y, (n, 1)), np.eye(n), np.zeros((n, n)))[1]
    Q, inertial = evaluator.applied.generalised(q, v), evaluator.mass * a0
    theirs = data.qfrc_applied + data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
    mass, own_mass = np.zeros((n, n)), (speeds * evaluator.mass) @ speeds.T
    built.mujoco.mj_fullM(built.still, data, mass)
    gaps = np.array([position(q, a) - position(q, b) for a, b in closing_pins(tree)]).reshape(-1, 2)
    centres = np.array([data.body(f"link{i}").xipos[:2] for i in range(tree.links)])
    extent, load = float(np.abs(q).max()), float(np.abs(Q).max() + np.abs(inertial).max())
    return {
        "the positions of the links": (q.reshape(-1, 3)[:, :2], centres, extent),
        "the gaps of open pins": (gaps, np.array(data.efc_pos).reshape(-1, 3)[:, :2], extent),
        "the mass matrix": (own_mass, mass, float(own_mass.max())),
        "forces and velocity terms": (tree.forces(q, Q - inertial), theirs, load),
    }
