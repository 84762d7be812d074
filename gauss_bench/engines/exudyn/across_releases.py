"""The differences between Exudyn's releases that the adapter must bridge; they stand here alone.

The adapter is written for the newest release. Those before 1.12 differ in this:

    errors          are exceptions of Python's own kinds
    the console     is silenced by SetWriteToConsole
    settings        solutionSettings.writeSolutionToFile, linearSolverType and linearSolverSettings; the method of a step is an
                    argument of SolveDynamic, which sets Newmark's and the index of the constraints
    gaps            are computed with the whole residual: ComputeAlgebraicEquations writes beyond its end
    the log         is flushed line by line since 1.10 alone
    bodies          have the prefix `physics` before mass and inertia
"""

from typing import Any

INDEX_2 = "TrapezoidalIndex2"


def errors(exu: Any, *others: type[Exception]) -> tuple[type[Exception], ...]:
    """Return the exceptions that Exudyn raises, and others."""
    own = (exu.ExudynError,) if hasattr(exu, "ExudynError") else (RuntimeError, ValueError, SystemError)
    return (*own, *others)


def solver_errors(exu: Any, *others: type[Exception]) -> tuple[type[Exception], ...]:
    """Return the exceptions that a solver raises, and others."""
    return (exu.SolverError, *others) if hasattr(exu, "SolverError") else errors(exu, *others)


def silence(exu: Any) -> None:
    """Keep Exudyn from printing on the console."""
    if hasattr(getattr(exu, "config", None), "printToConsole"):
        exu.config.printToConsole = False
    else:
        exu.SetWriteToConsole(False)


def write_log(exu: Any, name: str) -> None:
    """Have Exudyn write its output into a file, flushed line by line where it can."""
    try:
        exu.SetWriteToFile(name, True, False, True)
    except TypeError:
        exu.SetWriteToFile(name, True, False)


def version(exu: Any) -> str:
    """Return the version."""
    return str(exu.config.Version() if hasattr(getattr(exu, "config", None), "Version") else exu.__version__)


def write_nothing(settings: Any) -> None:
    """Keep a run from writing a solution file."""
    if hasattr(settings, "solution"):
        settings.solution.file.write = False
    else:
        settings.solutionSettings.writeSolutionToFile = False


def set_linear_solver(exu: Any, settings: Any, name: str, ignore_singular: bool) -> None:
    """Choose the linear solver, and whether singular Jacobians are ignored."""
    kind = getattr(exu.LinearSolverType, name)
    if hasattr(settings, "linearSolver"):
        settings.linearSolver.solverType = kind
        options = settings.linearSolver
    else:
        settings.linearSolverType = kind
        options = settings.linearSolverSettings
    if ignore_singular:
        options.ignoreSingularJacobian = True


def set_method(exu: Any, settings: Any, name: str) -> None:
    """Choose the method of a step; of older releases, set what SolveDynamic and the solvers read."""
    run = settings.timeIntegration
    if hasattr(run, "solverType"):
        run.solverType = getattr(exu.DynamicSolverType, name)
        return
    run.generalizedAlpha.useNewmark = run.generalizedAlpha.useIndex2Constraints = name == INDEX_2


def solve(exu: Any, mbs: Any, settings: Any, update: bool) -> bool:
    """Run a system; `update` makes the end the next start."""
    if hasattr(settings.timeIntegration, "solverType"):
        return bool(mbs.SolveDynamic(settings, updateInitialValues=update))
    alpha = settings.timeIntegration.generalizedAlpha
    kind = exu.DynamicSolverType.TrapezoidalIndex2 if alpha.useIndex2Constraints else exu.DynamicSolverType.GeneralizedAlpha
    return bool(mbs.SolveDynamic(settings, solverType=kind, updateInitialValues=update, showHints=False))


def compute_gaps(solver: Any, mbs: Any, settings: Any) -> None:
    """Compute the residual of the constraints at the current state into the last rows of a solver's residual."""
    if hasattr(settings, "solution"):
        solver.ComputeAlgebraicEquations(mbs, False)
    else:
        solver.ComputeNewtonResidual(mbs, settings)


def rigid_body(kind: Any, mass: float, inertia: float | list[float], node: Any) -> Any:
    """Return a rigid body of a kind, in the plane or in space; `inertia` is a number or the six moments."""
    try:
        return kind(mass=mass, inertia=inertia, nodeNumber=node)
    except TypeError:
        return kind(physicsMass=mass, physicsInertia=inertia, nodeNumber=node)


def call_after_steps(mbs: Any, function: Any) -> None:
    """Have a function called after each step; 0 for none."""
    if hasattr(mbs, "SetPostStepUserFunction"):
        mbs.SetPostStepUserFunction(function)
    else:
        mbs.SetPreStepUserFunction(function)
