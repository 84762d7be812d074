"""Exudyn: every link a rigid body in absolute coordinates, joints as algebraic equations, Exudyn's own implicit integrators.

Exudyn's state is the displacement u from reference coordinates. With the assembled start as reference the translation is short:

    q = q0 + u,    v = u',    a = u''

Links are ObjectRigidBody2D with the centre of mass as reference point, so M is diagonal and constant. Pins and slides are
ObjectJointRevolute2D and ObjectJointPrismatic2D. Exudyn takes the normal of a slide from its second marker, so the block comes
first and the guide second, and both rows are those of the linkage with the opposite sign:

    (p_g + offset n - p_b) . n = 0,    (R_b u_b) . n = 0        u_b: direction of the line in the block's frame

Forces along an axis need care on moving links. Exudyn applies the opposite force at the origin's marker, which leaves out a torque
unless origin and point lie on one line along the axis. Where a slide between the two links keeps their distance from that line,
the marker is moved there and the law is exact; anywhere else the mechanism is skipped. Every model is compared with the terms of
the linkage before it is handed out.

What is Exudyn's and what is not:

    run            all Exudyn: SolveDynamic, one call where the samples lie on one grid of steps. Elsewhere one call per sample,
                   which carries u, v, a over but restarts the algorithmic accelerations of generalized-alpha, within its order.
    acceleration   "default": all Exudyn, its initial accelerations. They differentiate C_q v by one-sided differences; that, not
                   the formulation, limits them to about 1e-7. "tuned": M, f and C_q are Exudyn's; the rate of C_q, by fourth-order
                   differences of Exudyn's C_q along v, and the solution of [M C_q^T; C_q 0] are done here.

Adaptive steps are off everywhere: they halve the step without a word, and a benchmark compares at equal steps.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from tempfile import mkstemp
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.integrate.fixed_step import step_counts
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.forces import angle, axis_state, position
from gauss_bench.mechanism.model import (
    GROUND,
    AxisSpringDamper,
    Force,
    Joint,
    JointDamping,
    Mechanism,
    Point,
    PointForce,
    Prismatic,
    RotationalSpringDamper,
    SpringDamper,
    Torque,
)
from gauss_bench.terms import Array, Terms
from gauss_bench.trajectory import RunFailure, Status, Trajectory

SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "default": {  # as shipped, except for the adaptive steps
        "newton": "modified",
        "jacobian_every_step": False,
        "relative_tolerance": 1e-8,
        "absolute_tolerance": 1e-10,
        "spectral_radius": 0.9,
        "adaptive_step": False,
        "linear_solver_up_to_unknowns": {"EXUdense": None},
        "linear_solver_where_redundant": "EigenDense, singular Jacobian ignored",
        "acceleration": "Exudyn's initial accelerations, relative epsilon 1e-7",
    },
    "tuned": {
        "newton": "modified",
        "jacobian_every_step": True,  # the cheapest mode of all, and as exact
        "relative_tolerance": 1e-10,
        "absolute_tolerance": 1e-12,
        "spectral_radius": 0.8,
        "adaptive_step": False,
        "linear_solver_up_to_unknowns": {"EXUdense": 20, "EigenDense": 50, "EigenSparse": None},
        "linear_solver_where_redundant": "EigenDense, singular Jacobian ignored",
        "acceleration": "KKT system in numpy from Exudyn's M, f, C_q; fourth-order differences of C_q along v",
    },
}
SOLVERS = {"generalized_alpha": "GeneralizedAlpha", "trapezoidal_index2": "TrapezoidalIndex2"}
DIFFERENCE = 1e-3  # turn or shift per half-step of the differences: truncation eps^4/30 and rounding 1e-16/eps are both near 1e-13
AGREEMENT = 1e-9  # of the largest term, at least of 1: far above the rounding of stiff springs, far below any error of the model
PARALLEL = 1e-12  # sine of the angle between two axes: angles are summed in different orders
CLOSED = 1e-12  # [m, rad] residual of a state at which slides are closed, so that forces along them are exact
FAR = 0.1  # of the linkage's size (or rad): no truncation error is that large while the motion still means anything
REDUNDANT = 1e-12  # of the largest singular value of the KKT matrix: rounding leaves 1e-17, usable linkages 1e-7 or more


def library() -> tuple[Any, Any]:
    """Exudyn and its items, silent on the console."""
    import exudyn
    from exudyn import itemInterface

    exudyn.config.printToConsole = False
    return exudyn, itemInterface


class Exudyn:
    """Builds mechanisms in Exudyn."""

    name = "exudyn"
    integrators: tuple[str, ...] = tuple(SOLVERS)
    stabilizations: tuple[str, ...] = ("none",)
    settings = SETTINGS
    native_loop = True
    python_loop = False

    def version(self) -> str:
        exu, _ = library()
        return f"Exudyn {exu.config.Version()} ({exu.exudynCPP.__name__.rpartition('.')[2]})"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if mechanism.drivers:
            return "driven linkages are left out: Exudyn's initial accelerations ignore the second derivative of the motion law"
        if mechanism.knife_edges:
            return "Exudyn has no planar knife edge"
        return next((reason for f in mechanism.forces if (reason := inexpressible(mechanism, f))), None)

    def build(self, mechanism: Mechanism, choice: Choice) -> "ExudynModel":
        return ExudynModel(mechanism, choice)


def slides_along(mechanism: Mechanism, origin: int, other: int, theta: float) -> bool:
    """Whether a slide between the two links runs along the axis at `theta` [rad] in the origin's link."""
    for joint in mechanism.joints:
        if isinstance(joint, Prismatic) and {joint.guide.link, joint.block.link} == {origin, other}:
            line = joint.angle if joint.guide.link == origin else joint.angle - joint.turn
            if abs(np.sin(line - theta)) < PARALLEL:
                return True
    return False


def inexpressible(mechanism: Mechanism, force: Force) -> str | None:
    """Why a force has no exact counterpart among Exudyn's compiled items, or None."""
    match force:
        case AxisSpringDamper() if force.origin.link != GROUND:
            if not slides_along(mechanism, force.origin.link, force.point.link, force.angle):
                return (
                    f"force {force.name} acts along an axis of a moving link that no slide keeps the point on; "
                    "Exudyn's connectors leave out its torque on that link"
                )
        case SpringDamper() if force.c != 0:
            if np.linalg.norm(position(mechanism.q0, force.b) - position(mechanism.q0, force.a)) < CLOSED:
                return f"damper {force.name} joins points that coincide at the start, where its direction is undefined"
    return None


def spatial(x: Array) -> list[float]:
    """A planar vector as Exudyn wants it."""
    return [float(x[0]), float(x[1]), 0.0]


def unit(theta: float) -> Array:
    return np.array([np.cos(theta), np.sin(theta)])


class System:
    """A mechanism as Exudyn items. `container` owns the system and must live as long."""

    def __init__(self, mechanism: Mechanism):
        exu, self.items = library()
        self.mechanism = mechanism
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.bodies = {GROUND: self.mbs.AddObject(self.items.ObjectGround())}
        self.nodes = {GROUND: self.mbs.AddNode(self.items.NodePointGround())}
        for i in range(len(mechanism.links)):
            self._link(i)
        for joint in mechanism.joints:
            self._joint(joint)
        for force in mechanism.forces:
            self._force(force)
        self.mbs.Assemble()

    def _link(self, i: int) -> None:
        add, items, link = self.mbs, self.items, self.mechanism.links[i]
        self.nodes[i] = add.AddNode(items.NodeRigidBody2D(referenceCoordinates=list(self.mechanism.q0[3 * i : 3 * i + 3])))
        body = items.ObjectRigidBody2D(mass=link.mass, inertia=link.inertia, nodeNumber=self.nodes[i])
        self.bodies[i] = add.AddObject(body)
        marker = add.AddMarker(items.MarkerBodyMass(bodyNumber=self.bodies[i]))
        add.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=spatial(self.mechanism.gravity)))

    def _point(self, point: Point) -> Any:
        """A marker with a position."""
        marker = self.items.MarkerBodyPosition(bodyNumber=self.bodies[point.link], localPosition=spatial(point.local))
        return self.mbs.AddMarker(marker)

    def _frame(self, link: int, local: Array) -> Any:
        """A marker with a position and an orientation."""
        return self.mbs.AddMarker(self.items.MarkerBodyRigid(bodyNumber=self.bodies[link], localPosition=spatial(local)))

    def _angle(self, link: int) -> Any:
        """A marker of a link's angle from its reference; the ground has a coordinate that is always zero."""
        coordinate = 0 if link == GROUND else 2
        return self.mbs.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=self.nodes[link], coordinate=coordinate))

    def _joint(self, joint: Joint) -> None:
        if not isinstance(joint, Prismatic):
            markers = [self._point(joint.a), self._point(joint.b)]
            self.mbs.AddObject(self.items.ObjectJointRevolute2D(markerNumbers=markers))
            return
        normal = unit(joint.angle + np.pi / 2)
        foot = self._frame(joint.guide.link, joint.guide.local + joint.offset * normal)
        slide = self.items.ObjectJointPrismatic2D(
            markerNumbers=[self._frame(joint.block.link, joint.block.local), foot],
            axisMarker0=spatial(unit(joint.angle - joint.turn)),
            normalMarker1=spatial(normal),
            constrainRotation=True,
        )
        self.mbs.AddObject(slide)

    def _force(self, f: Force) -> None:
        match f:
            case Torque():
                self._torque(f.link, f.value)
                self._torque(f.reaction, -f.value)
            case PointForce():
                self._point_force(f)
            case SpringDamper():
                self._spring(f)
            case AxisSpringDamper():
                self._axis(f.point, f.origin, f.angle, f.k, f.c, f.rest)
            case RotationalSpringDamper():
                self._turning(f.a, f.b, f.k, f.c, f.rest)
            case JointDamping():
                for pair in f.pairs:
                    if isinstance(pair, Prismatic):
                        self._axis(pair.block, pair.guide, pair.angle, 0.0, f.c, 0.0)
                    else:
                        self._turning(pair.a.link, pair.b.link, 0.0, f.c, 0.0)

    def _torque(self, link: int, value: float) -> None:
        if link != GROUND:  # a load on the angle is what a torque vector comes to in the plane, and cheaper
            self.mbs.AddLoad(self.items.LoadCoordinate(markerNumber=self._angle(link), load=value))

    def _point_force(self, f: PointForce) -> None:
        """A force fixed in another link is the constant force of a connector whose opposite on that link is loaded away."""
        size, items = float(np.linalg.norm(f.value)), self.items
        if f.point.link == GROUND or size == 0:
            return
        marker, value = self._frame(f.point.link, f.point.local), spatial(f.value)
        if f.frame in (GROUND, f.point.link):
            self.mbs.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=value, bodyFixed=f.frame != GROUND))
            return
        base = self._frame(f.frame, np.zeros(2))
        push = items.ObjectConnectorLinearSpringDamper(
            markerNumbers=[base, marker],
            axisMarker0=spatial(f.value / size),
            force=-size,  # positive force pulls the markers together
        )
        self.mbs.AddObject(push)
        self.mbs.AddLoad(items.LoadForceVector(markerNumber=base, loadVector=value, bodyFixed=True))

    def _spring(self, f: SpringDamper) -> None:
        markers = [self._point(f.a), self._point(f.b)]
        if f.rest == 0 and f.c == 0:  # k times the gap, without the direction that is lost where the points meet
            spring = self.items.ObjectConnectorCartesianSpringDamper(markerNumbers=markers, stiffness=[f.k, f.k, 0.0])
        else:
            spring = self.items.ObjectConnectorSpringDamper(
                markerNumbers=markers, referenceLength=f.rest, stiffness=f.k, damping=f.c
            )
        self.mbs.AddObject(spring)

    def _turning(self, a: int, b: int, k: float, c: float, rest: float) -> None:
        start = float(angle(self.mechanism.q0, b) - angle(self.mechanism.q0, a))
        spring = self.items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=[self._angle(a), self._angle(b)], stiffness=k, damping=c, offset=rest - start
        )
        self.mbs.AddObject(spring)

    def _axis(self, point: Point, origin: Point, theta: float, k: float, c: float, rest: float) -> None:
        """Along an axis of the world a Cartesian spring serves, the cheapest; else one along an axis of the origin's marker."""
        u, items = unit(theta), self.items
        if origin.link == GROUND and np.abs(u).min() < PARALLEL:
            along = np.abs(u).round()
            spring = items.ObjectConnectorCartesianSpringDamper(
                markerNumbers=[self._point(origin), self._point(point)],
                stiffness=spatial(k * along),
                damping=spatial(c * along),
                offset=spatial(rest * u.round()),
            )
        else:
            beside, _, _ = axis_state(self.mechanism.q0, self.mechanism.v0, point, origin, theta + np.pi / 2)
            foot = self._frame(origin.link, origin.local + beside * unit(theta + np.pi / 2))
            spring = items.ObjectConnectorLinearSpringDamper(
                markerNumbers=[foot, self._frame(point.link, point.local)],
                axisMarker0=spatial(u),
                stiffness=k,
                damping=c,
                offset=rest,
            )
        self.mbs.AddObject(spring)


def simulation_settings(mechanism: Mechanism, choice: Choice) -> Any:
    """Exudyn's settings for a choice; times and numbers of steps are filled in by the run."""
    exu, _ = library()
    options = SETTINGS[choice.settings]
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    name = next(
        name
        for name, most in options["linear_solver_up_to_unknowns"].items()
        if most is None or mechanism.n + 2 * len(mechanism.joints) <= most
    )
    if mechanism.redundant:
        name = "EigenDense"
        settings.linearSolver.ignoreSingularJacobian = True
    settings.linearSolver.solverType = getattr(exu.LinearSolverType, name)
    run = settings.timeIntegration
    run.verboseMode = 0
    run.adaptiveStep = options["adaptive_step"]
    run.solverType = getattr(exu.DynamicSolverType, SOLVERS[choice.integrator])
    run.generalizedAlpha.spectralRadius = options["spectral_radius"]
    run.newton.useModifiedNewton = options["newton"] == "modified"
    run.newton.modifiedNewtonJacUpdatePerStep = options["jacobian_every_step"]
    run.newton.relativeTolerance = options["relative_tolerance"]
    run.newton.absoluteTolerance = options["absolute_tolerance"]
    return settings


class BuiltIn:
    """The accelerations with which Exudyn would start from a state."""

    def __init__(self, system: System, settings: Any):
        exu, _ = library()
        self.system, self.settings, self.initial = system, settings, exu.ConfigurationType.Initial
        self.solver = exu.MainSolverImplicitSecondOrder()
        self.solver.InitializeSolver(system.mbs, settings)

    def __call__(self, q: Array, v: Array) -> Array:
        data = self.system.mbs.systemData
        data.SetODE2Coordinates(q - self.system.mechanism.q0, self.initial)
        data.SetODE2Coordinates_t(v, self.initial)
        self.solver.InitializeSolverInitialConditions(self.system.mbs, self.settings)
        return np.array(data.GetODE2Coordinates_tt())


class Readout:
    """M, f, C_q and C of Exudyn at a state, with the bias -(C_q)' v by differences."""

    def __init__(self, system: System):
        exu, _ = library()
        self.system, self.current = system, exu.ConfigurationType.Current
        self.solver = exu.MainSolverImplicitSecondOrder()
        settings = exu.SimulationSettings()  # dense matrices, which can be read and set
        settings.solution.file.write = False
        self.solver.InitializeSolver(system.mbs, settings)
        self.n, self.m = self.solver.GetODE2size(), self.solver.GetAEsize()

    def _set(self, q: Array) -> None:
        self.system.mbs.systemData.SetODE2Coordinates(q - self.system.mechanism.q0, self.current)

    def jacobian(self, q: Array) -> Array:
        """C_q (m, n)."""
        self._set(q)
        self.solver.SetSystemJacobian(np.zeros((self.n + self.m,) * 2))  # what follows is added to what is there
        self.solver.ComputeJacobianAE(self.system.mbs, 1.0, 0.0, 1.0, False)
        return np.array(self.solver.GetSystemJacobian())[self.n :, : self.n]

    def bias(self, q: Array, v: Array) -> Array:
        """-(C_q)' v (m,): the derivative of C_q along v by fourth-order central differences."""
        speed = float(np.abs(v).max(initial=0.0))
        if speed == 0 or self.m == 0:
            return np.zeros(self.m)
        h = DIFFERENCE / speed
        near = self.jacobian(q + h * v) - self.jacobian(q - h * v)
        far = self.jacobian(q + 2 * h * v) - self.jacobian(q - 2 * h * v)
        rate: Array = (8 * near - far) / (12 * h)
        return -(rate @ v)

    def __call__(self, q: Array, v: Array) -> Terms:
        mbs, solver = self.system.mbs, self.solver
        bias, J = self.bias(q, v), self.jacobian(q)
        mbs.systemData.SetODE2Coordinates_t(v, self.current)
        solver.ComputeMassMatrix(mbs, 1.0)
        M = np.array(solver.GetSystemMassMatrix())
        solver.ComputeODE2RHS(mbs)
        Q = np.array(solver.GetSystemResidual())[: self.n]
        solver.ComputeAlgebraicEquations(mbs, False)
        phi = np.array(solver.GetSystemResidual())[self.n : self.n + self.m]
        return Terms(M, J, Q, bias, phi, J @ v)


def kkt_acceleration(terms: Terms, redundant: bool) -> Array:
    """Accelerations (n,) from [M J^T; J 0] [a; lambda] = [Q; gamma]; the shortest solution where rows are redundant."""
    n, m = len(terms.M), len(terms.J)
    K = np.block([[terms.M, terms.J.T], [terms.J, np.zeros((m, m))]])
    rhs = np.concatenate([terms.Q, terms.gamma])
    x: Array = np.linalg.lstsq(K, rhs, rcond=REDUNDANT)[0] if redundant else np.linalg.solve(K, rhs)
    return x[:n]


def disagreement(own: Terms, expected: Terms) -> tuple[str, float]:
    """The term that differs most, and by how much of the largest such term (at least 1); constraint rows up to their sign."""

    def relative(difference: Array, size: Array) -> float:
        return float(np.abs(difference).max(initial=0.0) / max(1.0, np.abs(size).max(initial=0.0)))

    same, opposite = np.abs(own.J - expected.J), np.abs(own.J + expected.J)
    rows = np.minimum(same.max(axis=1, initial=0.0), opposite.max(axis=1, initial=0.0))
    found = {
        "mass matrix": float(np.abs(own.M - expected.M).max(initial=0.0) / np.abs(expected.M).max(initial=0.0)),
        "applied forces": relative(own.Q - expected.Q, expected.Q),
        "constraint Jacobian": relative(rows, expected.J),
        "constraint residual": relative(np.abs(own.phi) - np.abs(expected.phi), expected.phi),
    }
    return max(found.items(), key=lambda item: item[1])


def verification_states(evaluator: Evaluator, size: float) -> list[tuple[Array, Array]]:
    """The start and two consistent states near it, with speeds of order one."""
    mechanism = evaluator.mechanism
    states: list[tuple[Array, Array]] = [(mechanism.q0, mechanism.v0)]
    spread = 0.01 * np.tile([size, size, 1.0], len(mechanism.links))
    rng = np.random.default_rng(0)
    for _ in range(2):
        q: Array = mechanism.q0 + spread * rng.standard_normal(mechanism.n)
        v: Array = rng.standard_normal(mechanism.n)
        for _ in range(2):  # each is two corrections, each of which squares the error
            q, v = evaluator.project(0.0, q, v)
        if np.abs(evaluator.terms(0.0, q, v).phi).max(initial=0.0) < CLOSED:
            states.append((q, v))
    return states


def verify(system: System, readout: Readout, evaluator: Evaluator, size: float) -> None:
    """Compare the generated model with the linkage.

    Raises:
        RunFailure: degrees of freedom, redundant rows or terms differ.
    """
    mechanism = system.mechanism
    counted = system.mbs.ComputeSystemDegreeOfFreedom()
    found = (int(counted["degreeOfFreedom"]), int(counted["redundantConstraints"]))
    if found != (mechanism.dof, mechanism.redundant):
        raise RunFailure(
            Status.ERROR,
            f"Exudyn counts {found[0]} degrees of freedom and {found[1]} redundant rows, "
            f"the linkage has {mechanism.dof} and {mechanism.redundant}",
        )
    for q, v in verification_states(evaluator, size):
        term, error = disagreement(readout(q, v), evaluator.terms(0.0, q, v))
        if not error <= AGREEMENT:
            raise RunFailure(Status.ERROR, f"the generated model differs from the linkage: {term} by {error:.1e} (relative)")


class Log:
    """What Exudyn prints: its warnings bypass Python's, so its output goes to a file that is searched afterwards."""

    def __init__(self) -> None:
        self.exu, _ = library()
        self.file: Path | None = None

    def open(self) -> None:
        self.close()
        handle, name = mkstemp(suffix=".log")
        os.close(handle)
        self.file = Path(name)
        self.exu.SetWriteToFile(name, True, False, True)  # flushed line by line: closing does not flush

    def close(self) -> str:
        """End the file and return what it holds."""
        if self.file is None:
            return ""
        self.exu.SetWriteToFile("", False)
        text = self.file.read_text(errors="replace")
        self.file.unlink()
        self.file = None
        return text


def first_warning(text: str) -> str | None:
    """The first line of Exudyn's output that warns."""
    return next((line.strip() for line in text.splitlines() if "warning" in line.lower()), None)


class ExudynModel:
    """A mechanism in Exudyn under one integrator and one set of options."""

    def __init__(self, mechanism: Mechanism, choice: Choice):
        self.exu, _ = library()
        self.mechanism, self.choice = mechanism, choice
        self.evaluator = Evaluator(mechanism)
        arms = [point - link.com for link in mechanism.links for point in link.points.values()]
        self.size = max((float(np.linalg.norm(arm)) for arm in arms), default=0.0) or 1.0
        try:
            self.system = System(mechanism)
            self.readout = Readout(self.system)
            verify(self.system, self.readout, self.evaluator, self.size)
            self.simulation = simulation_settings(mechanism, choice)
            self.built_in = BuiltIn(self.system, self.simulation)
        except self.exu.ExudynError as error:
            raise RunFailure(Status.ERROR, f"Exudyn refuses the model: {sentence(error)}") from error
        self.log = Log()

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        try:
            if self.choice.settings == "tuned":
                a = kkt_acceleration(self.readout(q, v), self.mechanism.redundant > 0)
            else:
                a = self.built_in(q, v)
        except (np.linalg.LinAlgError, self.exu.SolverError) as error:
            raise RunFailure(Status.RANK_LOST, f"t = {t:.6g} s: no unique acceleration ({sentence(error)})") from error
        if not np.isfinite(a).all():
            raise RunFailure(Status.NAN, f"t = {t:.6g} s: Exudyn's acceleration is not finite")
        return a

    def prepare(self, times: Array, native: bool = True) -> None:
        """There is only Exudyn's own loop, whatever `native` says."""
        self.times = times
        counts = step_counts(times, self.choice.step)
        self.last_steps = np.cumsum([0, *(count for count, _ in counts)])
        sizes = np.array([size for _, size in counts])
        if len(sizes) and np.ptp(sizes) <= 1e-9 * sizes[0]:
            self.legs = [(0, len(times) - 1)]
        else:
            self.legs = [(k, k + 1) for k in range(len(counts))]
        shape = (len(times), self.mechanism.n)
        self.q, self.v, self.a = np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan)
        self.failure: RunFailure | None = None
        self.log.open()
        self._reset()
        self._record()

    def _reset(self) -> None:
        """Back to the start, with the accelerations Exudyn begins with as the first sample."""
        data, initial = self.system.mbs.systemData, self.exu.ConfigurationType.Initial
        alpha = self.simulation.timeIntegration.generalizedAlpha
        alpha.computeInitialAccelerations, alpha.resetAccelerations = True, False
        data.SetTime(float(self.times[0]), initial)
        data.SetODE2Coordinates_tt(np.zeros(self.mechanism.n), initial)
        data.SetAECoordinates(np.zeros(2 * len(self.mechanism.joints)), initial)
        self.q[0], self.v[0] = 0.0, self.mechanism.v0
        try:
            self.a[0] = self.built_in(self.mechanism.q0, self.mechanism.v0)
        except self.exu.ExudynError as error:
            self._fail(Status.RANK_LOST, f"Exudyn finds no initial accelerations ({sentence(error)})")

    def _record(self) -> None:
        """Have samples inside a leg kept after their steps; without any, nothing is called from the loop."""
        if len(self.legs) != 1 or len(self.times) == 2:
            self.system.mbs.SetPostStepUserFunction(0)
            return
        rows = {int(step): k for k, step in enumerate(self.last_steps) if 0 < k < len(self.times) - 1}
        step = -1  # the first call comes before the first step

        def keep(mbs: Any, t: float) -> bool:
            nonlocal step
            step += 1
            if step in rows:
                self._keep(rows[step], t)
            return True

        self.system.mbs.SetPostStepUserFunction(keep)

    def _keep(self, k: int, t: float) -> None:
        if abs(t - self.times[k]) > 0.01 * self.choice.step:  # steps that Exudyn chose by itself; rounding is far less
            self._fail(Status.ERROR, f"Exudyn stands at t = {t:.9g} s where {self.times[k]:.9g} s was asked for")
        data = self.system.mbs.systemData
        self.q[k], self.v[k], self.a[k] = data.GetODE2Coordinates(), data.GetODE2Coordinates_t(), data.GetODE2Coordinates_tt()

    def _fail(self, status: Status, message: str) -> None:
        self.failure = self.failure or RunFailure(status, message)

    def run(self) -> None:
        settings, mbs = self.simulation, self.system.mbs
        clock, alpha = settings.timeIntegration, settings.timeIntegration.generalizedAlpha
        for first, last in [] if self.failure else self.legs:
            clock.startTime, clock.endTime = float(self.times[first]), float(self.times[last])
            clock.numberOfSteps = int(self.last_steps[last] - self.last_steps[first])
            try:
                done = mbs.SolveDynamic(settings, updateInitialValues=len(self.legs) > 1)
            except self.exu.ExudynError as error:
                t = mbs.systemData.GetTime()
                self._fail(Status.NOT_CONVERGED, f"t = {t:.6g} s: Exudyn gave up ({sentence(error)}); try a smaller step")
                return
            t, steps = mbs.systemData.GetTime(), mbs.sys["dynamicSolver"].it.currentStepIndex - 1
            if not done:
                self._fail(Status.NOT_CONVERGED, f"t = {t:.6g} s: Exudyn reports failure without a reason; try a smaller step")
            if steps != clock.numberOfSteps:
                self._fail(Status.ERROR, f"Exudyn took {steps} steps where {clock.numberOfSteps} were asked for")
            self._keep(last, t)
            if self.failure:
                return
            alpha.computeInitialAccelerations = False  # a further leg goes on with the accelerations it is given

    def read(self) -> Trajectory:
        output = self.log.close()
        self.system.mbs.SetPostStepUserFunction(0)  # it holds this object
        if self.failure:
            raise self.failure
        q = self.mechanism.q0 + self.q
        finite = np.isfinite(np.hstack([q, self.v, self.a])).all(axis=1)
        if not finite.all():
            t = self.times[int(np.argmin(finite))]
            raise RunFailure(Status.NAN, f"not finite at t = {t:.6g} s; a smaller step may help")
        self._check_closed(q)
        warning = first_warning(output)
        if warning:
            raise RunFailure(Status.WARNING, f"Exudyn warns: {warning}")
        return Trajectory(self.times, q, self.v, self.a, int(self.last_steps[-1]))

    def _check_closed(self, q: Array) -> None:
        """A return value of True does not mean solved.

        Raises:
            RunFailure: a joint is far open.
        """
        turns = [isinstance(joint, Prismatic) for joint in self.mechanism.joints]  # the second row of a slide is an angle
        scale = np.array([x for turn in turns for x in (self.size, 1.0 if turn else self.size)])
        gap = (np.abs(self.evaluator.constraints(self.times, q, self.v).phi) / scale).max(axis=-1, initial=0.0)
        if (gap > FAR).any():
            k = int(np.argmax(gap > FAR))
            text = f"joints are open by {gap[k]:.1g} of the linkage's size at t = {self.times[k]:.6g} s; try a smaller step"
            raise RunFailure(Status.DIVERGED, text)


def sentence(error: Exception) -> str:
    """The reason of an exception in one line, without the place in the file that Exudyn appends."""
    return " ".join(str(error).partition("[Python file")[0].split())
