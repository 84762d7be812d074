"""The differences between Exudyn's releases; only this file deals with them.

The functions test for the names of the newest release. Their second branch is for releases before 1.12 (1.10 in `write_log`).
"""

from typing import Any

INDEX_2 = "TrapezoidalIndex2"


def errors(exu: Any, *others: type[Exception]) -> tuple[type[Exception], ...]:
    """Return the classes of the exceptions that Exudyn raises, and those in `others`."""
    own = (exu.ExudynError,) if hasattr(exu, "ExudynError") else (RuntimeError, ValueError, SystemError)
    return (*own, *others)


def solver_errors(exu: Any, *others: type[Exception]) -> tuple[type[Exception], ...]:
    """Return the classes of the exceptions that Exudyn's solvers raise, and those in `others`."""
    return (exu.SolverError, *others) if hasattr(exu, "SolverError") else errors(exu, *others)


def silence(exu: Any) -> None:
    """Let Exudyn print nothing to the console."""
    if hasattr(getattr(exu, "config", None), "printToConsole"):
        exu.config.printToConsole = False
    else:
        exu.SetWriteToConsole(False)


def write_log(exu: Any, name: str) -> None:
    """Let Exudyn write its output to a file, and flush it after every line if the release can do that."""
    try:
        exu.SetWriteToFile(name, True, False, True)
    except TypeError:
        exu.SetWriteToFile(name, True, False)


def version(exu: Any) -> str:
    """Return the version of Exudyn."""
    return str(exu.config.Version() if hasattr(getattr(exu, "config", None), "Version") else exu.__version__)


def write_nothing(settings: Any) -> None:
    """Let a simulation with these settings write no file of its solution."""
    if hasattr(settings, "solution"):
        settings.solution.file.write = False
    else:  # before 1.12
        settings.solutionSettings.writeSolutionToFile = False


def set_linear_solver(exu: Any, settings: Any, name: str, ignore_singular: bool) -> None:
    """Set the linear solver, a member of LinearSolverType; with `ignore_singular` it accepts singular Jacobians."""
    kind = getattr(exu.LinearSolverType, name)
    if hasattr(settings, "linearSolver"):
        options = settings.linearSolver
        options.solverType = kind
    else:  # before 1.12
        options, settings.linearSolverType = settings.linearSolverSettings, kind
    if ignore_singular:
        options.ignoreSingularJacobian = True


def set_method(exu: Any, settings: Any, name: str) -> None:
    """Set the integrator, a member of DynamicSolverType: generalized-alpha, or the trapezoidal rule in index 2."""
    run = settings.timeIntegration
    if hasattr(run, "solverType"):
        run.solverType = getattr(exu.DynamicSolverType, name)
        return
    run.generalizedAlpha.useNewmark = run.generalizedAlpha.useIndex2Constraints = name == INDEX_2  # flags of releases before 1.12


def solve(exu: Any, mbs: Any, settings: Any, update: bool) -> bool:
    """Run a system and tell whether Exudyn reports success; with `update`, the next run starts from the end of this one."""
    if hasattr(settings.timeIntegration, "solverType"):
        return bool(mbs.SolveDynamic(settings, updateInitialValues=update))
    # before 1.12 the integrator is an argument; `set_method` has stored it in the flags
    index_2 = settings.timeIntegration.generalizedAlpha.useIndex2Constraints
    kind = getattr(exu.DynamicSolverType, INDEX_2 if index_2 else "GeneralizedAlpha")
    return bool(mbs.SolveDynamic(settings, solverType=kind, updateInitialValues=update, showHints=False))


def compute_gaps(solver: Any, mbs: Any, settings: Any) -> None:
    """Compute the residual of the constraints at the current state; it becomes the last rows of the solver's residual."""
    if hasattr(settings, "solution"):  # a release since 1.12
        solver.ComputeAlgebraicEquations(mbs, False)
    else:  # before 1.12, ComputeAlgebraicEquations writes beyond the end of an array
        solver.ComputeNewtonResidual(mbs, settings)


def rigid_body(kind: Any, mass: float, inertia: float | list[float], node: Any) -> Any:
    """Return a rigid body of a class of Exudyn, in the plane or in space, at the node with Exudyn's number `node`.

    Args:
        inertia: moment of inertia [kg m^2] of a body in the plane, or the six moments of inertia of a body in space.
    """
    try:
        return kind(mass=mass, inertia=inertia, nodeNumber=node)
    except TypeError:  # a release before 1.12
        return kind(physicsMass=mass, physicsInertia=inertia, nodeNumber=node)


def call_after_steps(mbs: Any, function: Any) -> None:
    """Let Exudyn call function(mbs, t) after each step; the number 0 as `function` ends these calls."""
    if hasattr(mbs, "SetPostStepUserFunction"):
        mbs.SetPostStepUserFunction(function)
    else:  # a release with calls before each step only, at the state after the previous step
        mbs.SetPreStepUserFunction(function)
