"""Exudyn: links are rigid bodies in absolute coordinates, joints are algebraic equations, and the integrators are implicit.

Exudyn's state is the displacement u from the assembled start of the linkage, so that

    q = q0 + u,    v = u',    a = u''

If all steps have the same size and no force jumps, a run is one call of SolveDynamic. Otherwise every sample and every jump ends a
call, and each call starts the algorithmic accelerations of generalized-alpha anew, an error within the method's order. Adaptive
steps are off, because they halve the step size without notice, and the benchmark compares at equal steps.

Exudyn's initial accelerations ignore the second derivative of a motion law and the time of a force. The trapezoidal rule carries
this error through the whole run. Therefore linkages with drivers or varying forces start from accelerations of the KKT system.
"""

import contextlib
import os
import sys
from tempfile import mkstemp
from typing import IO, Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.exudyn import across_releases
from gauss_bench.engines.exudyn.accelerations import BuiltIn, Readout, solve_kkt, verify
from gauss_bench.engines.exudyn.items import System, explain_refusal
from gauss_bench.engines.shared import LibraryEngine, common_refusal, finite, finite_acceleration
from gauss_bench.integrate.fixed_step import Stretch, step_counts, stretches
from gauss_bench.mechanism.evaluate import evaluator_of
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

KKT = "KKT system"  # value of the knob `acceleration`
SOLVERS = {"generalized_alpha": "GeneralizedAlpha", "trapezoidal_index2": "TrapezoidalIndex2"}
FAR = 0.1  # a run has diverged if the gap of a joint exceeds this share of the linkage's size, or this angle [rad]


def load_library() -> tuple[Any, Any]:
    """Return the modules `exudyn` and `exudyn.itemInterface`, and keep Exudyn from printing on the console."""
    if not hasattr(sys, "exudynFast"):  # must be set before the first import: it selects the fast module without range checks
        setattr(sys, "exudynFast", Exudyn.settings["default"]["module"] == "fast")  # noqa: B010 - sys has no such attribute
    with contextlib.redirect_stdout(None):
        import exudyn
    from exudyn import itemInterface

    across_releases.silence(exudyn)
    return exudyn, itemInterface


class Exudyn(LibraryEngine, beside=__file__):
    """Exudyn with its implicit integrators, in absolute coordinates."""

    name = "exudyn"
    integrators: tuple[str, ...] = tuple(SOLVERS)
    resizable = True  # a built model can run with another step or tolerance
    native_loop = True
    python_loop = False

    def version(self) -> str:
        exu, _ = load_library()
        module = next(name for name in vars(exu) if name.startswith("exudynCPP"))
        return f"Exudyn {across_releases.version(exu)} ({module})"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if reason := common_refusal(mechanism, "Exudyn"):
            return reason
        if mechanism.knife_edges:
            return "Exudyn has no planar knife edge"
        reasons = (explain_refusal(mechanism, force) for force in mechanism.forces)
        return next(filter(None, reasons), None)  # the reason for the first force that Exudyn cannot express

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return "motion laws and varying forces, in every iteration" if mechanism.drivers or mechanism.varying else ""

    def build(self, mechanism: Mechanism, choice: Choice) -> "ExudynModel":
        return ExudynModel(mechanism, choice)


def make_settings(exu: Any, mechanism: Mechanism, choice: Choice) -> Any:
    """Return Exudyn's simulation settings for a choice; each run sets the start, the end and the number of steps."""
    options = Exudyn.file.options(choice.settings)
    settings = exu.SimulationSettings()
    across_releases.write_nothing(settings)
    solver = choose_linear_solver(options["linear_solver"], mechanism.n + mechanism.m)
    if mechanism.redundant:
        solver = options["linear_solver_where_redundant"]
    across_releases.set_linear_solver(exu, settings, solver, bool(mechanism.redundant))
    run = settings.timeIntegration
    run.verboseMode = 0
    run.adaptiveStep = options["adaptive_step"]
    across_releases.set_method(exu, settings, SOLVERS[choice.integrator])
    run.generalizedAlpha.spectralRadius = options["spectral_radius"]
    run.newton.useModifiedNewton = options["newton"] == "modified"
    run.newton.modifiedNewtonJacUpdatePerStep = options["jacobian_every_step"]
    run.newton.relativeTolerance = options["relative_tolerance"]
    run.newton.absoluteTolerance = options["absolute_tolerance"]
    return settings


def choose_linear_solver(rule: str, unknowns: int) -> str:
    """Return the linear solver that a rule chooses for a number of unknowns.

    The rule "NAME to MOST, NAME to MOST, NAME" means the first solver whose MOST is at least the number of unknowns.
    """
    for entry in rule.split(", "):
        name, _, most = entry.partition(" to ")
        if not most or unknowns <= int(most):
            return name
    raise ValueError(f"{rule}: no solver for {unknowns} unknowns")


class Log:
    """A log file for Exudyn's output, which is searched for warnings after a run: Exudyn raises no warnings in Python."""

    def __init__(self, exu: Any) -> None:
        self.exu = exu
        self.file: IO[str] | None = None

    def open(self) -> None:
        """Let Exudyn write its output to a new file."""
        self.close()
        handle, name = mkstemp(suffix=".log")
        self.file = os.fdopen(handle, errors="replace")
        across_releases.write_log(self.exu, name)  # flushes every line, because SetWriteToFile closes a file without flushing
        os.unlink(name)  # the file can be read until it is closed, and the system deletes it even if the process is killed

    def close(self) -> str | None:
        """Close the log file and return the first line in it that contains a warning; None if there is no such line."""
        if self.file is None:
            return None
        self.exu.SetWriteToFile("", False)
        with self.file as lines:
            self.file = None
            return next((line.strip() for line in lines if "warning" in line.lower()), None)


class ExudynModel:
    """A mechanism in Exudyn under one integrator and setting.

    Attributes:
        q, v, a: (k, n) samples; q holds Exudyn's displacements u, to which `read` adds q0.
        readout: function that reads the terms of Exudyn's equations of motion at a given state.
        built_in: function that returns Exudyn's initial accelerations of a run from a given state.
        solver_runs: for each call of SolveDynamic its `Stretch`, an interval of time with steps of equal size.
        last_steps: (k,) number of steps from the start to each sample.
        failure: the reason why the run ended early; otherwise None.
    """

    def __init__(self, mechanism: Mechanism, choice: Choice):
        self.exu, items = load_library()
        self.mechanism, self.choice = mechanism, choice
        self.evaluator = evaluator_of(mechanism)
        try:
            self.system = System(self.exu, items, mechanism)
            self.readout = Readout(self.system)
            verify(self.system, self.readout, self.evaluator)
            self.simulation = make_settings(self.exu, mechanism, choice)
            self.built_in = BuiltIn(self.system, self.simulation)
        except across_releases.errors(self.exu) as error:
            raise RunFailure(Status.ERROR, f"Exudyn refuses the model: {in_one_line(error)}") from error
        self.log = Log(self.exu)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the accelerations (n,) at time t [s] and a state q, v (n,), by the KKT system or by Exudyn."""
        try:
            self.system.last = np.inf  # every force has its value at t
            # Exudyn's initial accelerations ignore the second derivative of a law and the time of a force.
            varies = any(law(t)[2] != 0 for law in self.readout.laws) or self.mechanism.varying
            kkt = varies or Exudyn.file.options(self.choice.settings)["acceleration"] == KKT
            a = self._solve_kkt(t, q, v) if kkt else self.built_in(q, v)
        except across_releases.solver_errors(self.exu, np.linalg.LinAlgError) as error:
            raise RunFailure(Status.RANK_LOST, f"t = {t:.6g} s: no unique acceleration ({in_one_line(error)})") from error
        return finite_acceleration(t, a, "Exudyn")

    def _solve_kkt(self, t: float, q: Array, v: Array) -> Array:
        """Return the accelerations (n,) of the KKT system at time t [s] and a state q, v (n,)."""
        return solve_kkt(self.readout(q, v, t), self.mechanism.redundant > 0)

    def prepare(self, times: Array, native: bool = True) -> None:
        """Reset the model to the start and divide the run into calls of SolveDynamic; Exudyn always takes the steps."""
        self.times = times
        counts = step_counts(times, self.choice.step)
        self.last_steps = np.cumsum([0, *(count for count, _ in counts)])
        sizes = np.array([size for _, size in counts])
        # One call of the solver if all steps have the same size and no force jumps (`kinks` are the times of jumps). Otherwise one
        # call for each sample and each jump, because all steps of a call are equal, and a call must end at a jump.
        if len(sizes) and np.ptp(sizes) <= 1e-9 * sizes[0] and not self.mechanism.kinks:
            self.solver_runs = [Stretch(float(times[0]), int(self.last_steps[-1]), float(sizes[0]), np.inf, len(times) - 1)]
        else:
            self.solver_runs = list(stretches(times, self.choice.step, self.mechanism.kinks))
        self.q, self.v, self.a = np.full((3, len(times), self.mechanism.n), np.nan)
        self.failure: RunFailure | None = None
        self.log.open()
        self._reset()
        self._register_samples()

    def _reset(self) -> None:
        """Go back to the start, and store the first sample.

        With drivers or varying forces, Exudyn's own initial accelerations are wrong, and those of the KKT system are used.
        """
        data, initial = self.system.mbs.systemData, self.exu.ConfigurationType.Initial
        alpha = self.simulation.timeIntegration.generalizedAlpha
        use_kkt = bool(self.mechanism.drivers or self.mechanism.varying)
        alpha.computeInitialAccelerations, alpha.resetAccelerations = not use_kkt, False
        data.SetTime(float(self.times[0]), initial)
        data.SetODE2Coordinates_tt(np.zeros(self.mechanism.n), initial)
        data.SetAECoordinates(np.zeros(self.evaluator.constraints.m), initial)
        self.q[0], self.v[0] = 0.0, self.mechanism.v0  # q holds displacements from q0, so it is zero at the start
        try:
            self.a[0] = self.built_in(self.mechanism.q0, self.mechanism.v0)  # also puts this state into Exudyn
            if use_kkt:
                self.a[0] = self._solve_kkt(float(self.times[0]), self.mechanism.q0, self.mechanism.v0)
                data.SetODE2Coordinates_tt(self.a[0], initial)
        except across_releases.errors(self.exu, np.linalg.LinAlgError) as error:
            self.failure = RunFailure(Status.RANK_LOST, f"Exudyn finds no initial accelerations ({in_one_line(error)})")

    def _register_samples(self) -> None:
        """If one call of the solver covers several samples, let a function that Exudyn calls after each step store them."""
        # calls of a function take time, so there are none if all samples are at the ends of calls of the solver
        if len(self.solver_runs) != 1 or len(self.times) == 2:
            across_releases.call_after_steps(self.system.mbs, 0)
            return
        # number of steps from the start -> index of the sample that is due after these steps
        due = {int(step): k for k, step in enumerate(self.last_steps) if 0 < k < len(self.times) - 1}
        step = -1  # Exudyn also calls the function before the first step

        def after_step(mbs: Any, t: float) -> bool:
            """Store the sample that is due after this step, if there is one; True lets Exudyn continue."""
            nonlocal step
            step += 1
            if step in due:
                self._store_sample(due[step])
            return True

        across_releases.call_after_steps(self.system.mbs, after_step)

    def _store_sample(self, k: int) -> None:
        """Store Exudyn's present state as sample k."""
        data = self.system.mbs.systemData
        self.q[k], self.v[k], self.a[k] = data.GetODE2Coordinates(), data.GetODE2Coordinates_t(), data.GetODE2Coordinates_tt()

    def run(self) -> None:
        if self.failure:  # there are no initial accelerations
            return
        try:
            for stretch in self.solver_runs:
                self._run_stretch(stretch)
        except RunFailure as failure:  # `read` raises it, together with the samples
            self.failure = failure.with_traceback(None)  # the frames of the traceback would keep the model in memory

    def _run_stretch(self, stretch: Stretch) -> None:
        """Run Exudyn's solver for one stretch, an interval with equal steps, and store the sample at its end."""
        settings, mbs = self.simulation, self.system.mbs
        time = settings.timeIntegration
        time.startTime, time.endTime, time.numberOfSteps = stretch.begin, self._end_time(stretch), stretch.steps
        self.system.last = stretch.last  # no force is evaluated later than this time; infinite if no force jumps at the end
        try:
            # with several calls, each must start from the end of the call before it
            succeeded = across_releases.solve(self.exu, mbs, settings, update=len(self.solver_runs) > 1)
        except across_releases.errors(self.exu) as error:
            message = f"t = {mbs.systemData.GetTime():.6g} s: Exudyn gave up ({in_one_line(error)}); try a smaller step"
            raise RunFailure(Status.NOT_CONVERGED, message) from error
        if not succeeded:
            message = f"t = {mbs.systemData.GetTime():.6g} s: Exudyn reports failure without a reason; try a smaller step"
            raise RunFailure(Status.NOT_CONVERGED, message)
        steps = mbs.sys["dynamicSolver"].it.currentStepIndex - 1  # Exudyn's index is that of the next step, counted from 1
        if steps != stretch.steps:
            raise RunFailure(Status.ERROR, f"Exudyn took {steps} steps where {stretch.steps} were asked for")
        if stretch.row is not None:
            self._store_sample(stretch.row)
        time.generalizedAlpha.computeInitialAccelerations = False  # the next call continues with the accelerations of this one
        if stretch.last != np.inf:
            # a force jumps at the end: the next call, and a sample there, have the accelerations after the jump
            data = mbs.systemData
            q, v = self.mechanism.q0 + np.array(data.GetODE2Coordinates()), np.array(data.GetODE2Coordinates_t())
            a = self.acceleration(self._end_time(stretch), q, v)
            data.SetODE2Coordinates_tt(a, self.exu.ConfigurationType.Initial)
            if stretch.row is not None:
                self.a[stretch.row] = a

    def _end_time(self, stretch: Stretch) -> float:
        """Return the time [s] at the end of a stretch; if a sample is taken there, it is exactly the sample's time."""
        return stretch.begin + stretch.steps * stretch.size if stretch.row is None else float(self.times[stretch.row])

    def read(self) -> Trajectory:
        warning = self.log.close()
        across_releases.call_after_steps(self.system.mbs, 0)  # because the function would keep this object in memory
        q = self.mechanism.q0 + self.q
        calls_python = self.mechanism.drivers or self.mechanism.varying
        note = "the motion law is evaluated in Python in every Newton iteration" if calls_python else ""
        trajectory = Trajectory(self.times, q, self.v, self.a, sum(x.steps for x in self.solver_runs), note=note)
        if self.failure:
            self.failure.reached = trajectory
            raise self.failure
        if finite(q, self.v, self.a) == len(q):
            self._check_closed(trajectory)
            if warning:
                raise RunFailure(Status.WARNING, f"Exudyn warns: {warning}", trajectory)
        return trajectory

    def _check_closed(self, trajectory: Trajectory) -> None:
        """Check that the joints are closed, because SolveDynamic reports success for runs that have diverged too."""
        units = [coordinate.unit for joint in self.mechanism.joints for coordinate, _ in joint.held]
        joint_scales = [self.mechanism.size if unit == "m" else 1.0 for unit in units]
        scale = np.array(joint_scales + [1.0] * len(self.mechanism.drivers))  # (m,)
        phi = self.evaluator.constraints(trajectory.t, trajectory.q, trajectory.v).phi  # (k, m)
        gap = (np.abs(phi) / scale).max(axis=-1, initial=0.0)
        if (gap > FAR).any():
            k = int(np.argmax(gap > FAR))
            text = f"joints are open by {gap[k]:.1g} of the linkage's size at t = {self.times[k]:.6g} s; try a smaller step"
            raise RunFailure(Status.DIVERGED, text, trajectory)


def in_one_line(error: Exception) -> str:
    """Return the message of an exception in one line, without the name of a file and the line number that Exudyn appends."""
    return " ".join(str(error).partition("[Python file")[0].split())
