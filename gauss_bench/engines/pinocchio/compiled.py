"""The dynamics and the steps of the adapter in C++ (`loop.cpp`), which get the numbers of the model that Python has verified."""

import ctypes
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.pinocchio.build import load_loop
from gauss_bench.engines.pinocchio.dynamics import SOLVED, ConstrainedDynamics, TreeForces
from gauss_bench.engines.pinocchio.tree import Multibody
from gauss_bench.engines.shared import require_agreement, size
from gauss_bench.integrate import StepFailure
from gauss_bench.integrate.adaptive import MOST
from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import Along, Distance, Law, Mechanism, Point, PointForce
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

METHODS = ("rk4", "semi_implicit_euler", "dop853_fixed")  # in the order of the numbers that `advance` of loop.cpp takes
KINDS = {"JointModelRZ": b"z", "JointModelPX": b"x", "JointModelPY": b"y"}
AGREEMENT = 1e-9  # relative: rounding causes about 1e-13; a memory layout that differs from the library's causes errors of any size
# `advance_adaptive` of loop.cpp returns these in place of the number of steps, and -2 for too many steps
VANISHING, FAILED = -1, -3
ARRAY, INT, LONG, DOUBLE = np.ctypeslib.ndpointer(float, flags="C_CONTIGUOUS"), ctypes.c_int, ctypes.c_long, ctypes.c_double
ARGUMENTS = {  # function of loop.cpp -> types of its arguments after the linkage
    "add_joint": (INT, ctypes.c_char, ARRAY, DOUBLE, ARRAY, ARRAY),
    "add_closure": (INT, ARRAY, INT, ARRAY, ARRAY),
    "add_spring": (INT, ARRAY, INT, ARRAY, ARRAY, ARRAY),
    "add_push": (INT, ARRAY, INT, ARRAY),
    "finish": (ARRAY, ARRAY, ARRAY, ARRAY, DOUBLE, INT, DOUBLE),
    "accelerate": (ARRAY, ARRAY, ARRAY),
    "advance": (INT, ARRAY, DOUBLE, LONG, ARRAY, ARRAY),
    "advance_adaptive": (ARRAY, ARRAY, ARRAY, LONG, LONG, ARRAY, ARRAY, ARRAY, ARRAY),
    "evaluations": (),
    "destroy": (),
}


def unsupported_by_compiled_loop(mechanism: Mechanism, choice: Choice, options: Mapping[str, Any]) -> str | None:
    """Return the reason why the compiled loop cannot run a mechanism with a setting, although Python can; None if it can."""
    if choice.stabilization == "projection":
        return "Pinocchio's compiled loop does not support projection, which the suite does in Python"
    if mechanism.drivers:
        return "Pinocchio's compiled loop does not support drivers"
    if options["algorithm"] == "lcaba":
        return "Pinocchio's compiled loop has no lcaba, which takes longer than constraintDynamics, and twice as long to build"
    names = ", ".join(f.name for f in mechanism.varying)
    return f"Pinocchio's compiled loop does not support forces that vary with time or direction: {names}" if names else None


class CompiledDynamics(ConstrainedDynamics):
    """A function (t, y, dy) -> tree accelerations (n,), and methods that take whole steps, all in C++.

    Raises:
        RunFailure: the compiled loop is not built, or its accelerations at the start differ from those of calls from Python.
    """

    def __init__(self, body: Multibody, forces: TreeForces, options: Mapping[str, Any], gains: tuple[float, float]):
        """Copy the numbers of Pinocchio's model, its closures, loads and solver options to C++, and verify its accelerations."""
        super().__init__(body, forces, options, gains)
        self.n, self.library = forces.tree.n, _load_library()
        self.tableau = _read_tableau()  # imports scipy, which must not happen in a timed run
        self.linkage = self.library.create(_flatten(body.model.gravity.linear))
        model = body.model
        for j in range(1, model.njoints):  # each with the mass, centre and moments of inertia of the body that it carries
            kind, placement, inertia = KINDS[model.joints[j].shortname()], _flatten_se3(model.jointPlacements[j]), model.inertias[j]
            lever, moments = _flatten(inertia.lever), _flatten(inertia.inertia)
            self.library.add_joint(self.linkage, int(model.parents[j]), kind, placement, inertia.mass, lever, moments)
        for row in self.rows:
            first, second = _flatten_se3(row.joint1_placement), _flatten_se3(row.joint2_placement)
            self.library.add_closure(self.linkage, row.joint1_id, first, row.joint2_id, second, _flatten(gains))
        for force in forces.others:
            for load in force.to_loads():
                self._add_load(body, load)
        affine_forces = [_flatten(x) for x in (forces.constant, forces.stiffness, forces.damping)]
        accuracies = _flatten([options["absolute_accuracy"], options["relative_accuracy"]])
        self.library.finish(self.linkage, *affine_forces, accuracies, options["mu"], int(options["max_iter"]), SOLVED)
        # if Eigen's headers have another memory layout than Pinocchio's library, the compiled loop computes nonsense
        start = forces.tree.relative(forces.weightless.q0, forces.weightless.v0)
        own, expected = self(0.0, *start), np.array(super().__call__(0.0, *start))
        require_agreement({"accelerations of the compiled loop": (own, expected, size(expected))}, AGREEMENT)

    def __del__(self) -> None:
        if linkage := getattr(self, "linkage", None):
            self.library.destroy(linkage)

    def _add_load(self, body: Multibody, load: Law | PointForce) -> None:
        """Add a force to the linkage in C++, as a spring with damper and bias or as a constant force at a point."""

        def place(point: Point) -> tuple[int, Array]:
            """Return Pinocchio's index of the joint that carries a point, and the point (2,) [m] in this joint's frame."""
            joint, placement = body.place(point)
            return int(joint), _flatten(placement.translation[:2])

        def direction(link: int, x: Array) -> tuple[int, Array]:
            """Return Pinocchio's index of the joint that carries a link, and a vector (2,) of the link in this joint's frame."""
            joint, placement = body.carriers[link]
            return int(joint), _flatten(placement.rotation[:2, :2] @ x)

        match load:
            case PointForce():
                self.library.add_push(self.linkage, *place(load.point), *direction(load.frame, load.value))
            case Law(Along(origin, point, angle, across), k, c, rest, bias):
                _, axis = direction(origin.link, unit(angle, across))
                self.library.add_spring(self.linkage, *place(origin), *place(point), axis, _flatten([k, c, rest, bias]))
            case Law(Distance(a, b), k, c, rest, bias):
                axis = np.zeros(2)  # the force acts along the line between the points
                self.library.add_spring(self.linkage, *place(a), *place(b), axis, _flatten([k, c, rest, bias]))
            case _:
                raise RunFailure(Status.SKIP, f"Pinocchio's compiled loop has no force on {load.coordinate}")

    def __call__(self, t: float, y: Array, dy: Array) -> Array:
        """Return the accelerations (n,) at a tree state y, dy (n,); the time t [s] appears only in the message of a failure."""
        y, dy, a = np.array(y, dtype=float), np.array(dy, dtype=float), np.empty(self.n)
        if not self.library.accelerate(self.linkage, y, dy, a):
            raise self._explain_failure(f"t = {t:.6g} s", t, y, dy)
        self.evaluations += self.library.evaluations(self.linkage)
        return a

    def advance(self, integrator: str, t: float, y: Array, dy: Array, h: float, count: int) -> tuple[Array, Array]:
        """Return the tree state y, dy (n,) after `count` steps of h [s] from t [s].

        Raises:
            RunFailure: the solver finds no accelerations at a stage of a step.
        """
        y, dy = y.copy(), dy.copy()
        succeeded = self.library.advance(self.linkage, METHODS.index(integrator), self.tableau, h, count, y, dy)
        self.evaluations += self.library.evaluations(self.linkage)
        if not succeeded:
            raise self._explain_failure(f"between t = {t:.6g} s and t = {t + count * h:.6g} s", t, y, dy)
        return y, dy

    def advance_adaptive(self, times: Array, y: Array, dy: Array, rtol: float, atol: float) -> int:
        """Integrate from the first rows of y, dy (k, n), fill the other rows at the times (k,) [s], and return the number of steps.

        Raises:
            RunFailure: the solver finds no accelerations at a stage of a step.
        """
        # if the loop returns FAILED, y_last, dy_last are the state, at an unknown time, at which it stopped
        y_last, dy_last, times = y[0].copy(), dy[0].copy(), _flatten(times)
        steps: int = self.library.advance_adaptive(
            self.linkage, self.tableau, _flatten([rtol, atol]), times, len(times), MOST, y_last, dy_last, y, dy
        )
        self.evaluations += self.library.evaluations(self.linkage)
        if steps == FAILED:
            # time of the last filled sample; later ones are still NaN, and one step may pass several samples
            last = times[int(np.isfinite(y[:, 0]).sum()) - 1]
            raise self._explain_failure(f"after t = {last:.6g} s", last, y_last, dy_last)
        if steps == VANISHING:
            raise StepFailure("Required step size is less than spacing between numbers.")
        if steps < 0:
            raise StepFailure(f"more than {MOST} steps")
        return steps

    def _explain_failure(self, when: str, begin: float, y: Array, dy: Array) -> RunFailure:
        """Return the failure at a tree state y, dy (n,) that the loop met after `begin` [s]; `when` is the time in words."""
        status, reason = Status.NOT_CONVERGED, "Pinocchio's compiled loop misses the constraints"
        try:
            super().__call__(begin, y, dy)
        except RunFailure as failure:  # a call from Python usually fails with a more precise reason
            status, reason = failure.status, str(failure).removeprefix(f"t = {begin:.6g} s: ")
        return RunFailure(status, f"{when}: {reason}")


def _flatten(x: Any) -> Array:
    """Return numbers as one flat array, row by row, which a C function can read."""
    return np.ascontiguousarray(x, dtype=float).ravel()


def _flatten_se3(x: Any) -> Array:
    """Return the translation (3,) and then the rotation (9,) of a placement."""
    return np.concatenate([x.translation, _flatten(x.rotation)])


@lru_cache(maxsize=1)
def _read_tableau() -> Array:
    """Return DOP853's coefficients from scipy, in the layout of `Tableau` in `loop.cpp`.

    A step has 12 stages, and its dense output needs four more evaluations, 16 in all. The first of the four is at the end of the
    step, with the coefficients B, so its row stays zero in `a`; the rows of the other three are A_EXTRA.
    """
    from scipy.integrate import DOP853

    stages, evaluations = len(DOP853.B), 16
    a = np.zeros((evaluations, evaluations))
    a[:stages, :stages] = DOP853.A[:stages, :stages]
    a[stages + 1 :] = DOP853.A_EXTRA
    return np.concatenate([x.ravel() for x in (a, DOP853.B, DOP853.E5, DOP853.E3, DOP853.D)])


@lru_cache(maxsize=1)
def _load_library() -> ctypes.CDLL:
    """Load the compiled loop into this process, where it stays when its file is deleted, and declare its argument types.

    Raises:
        RunFailure: the compiled loop is not built.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "loop.so"
        path.write_bytes(load_loop())
        library = ctypes.CDLL(str(path))
    library.create.restype, library.create.argtypes = ctypes.c_void_p, [ARRAY]
    for name, types in ARGUMENTS.items():
        getattr(library, name).argtypes = [ctypes.c_void_p, *types]
    library.accelerate.restype = library.advance.restype = ctypes.c_bool
    library.advance_adaptive.restype = library.evaluations.restype = ctypes.c_long
    return library
