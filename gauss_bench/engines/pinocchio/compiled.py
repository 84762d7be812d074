"""The adapter's dynamics and steps in C++: `loop.cpp` with the numbers of the model that Python has built and verified."""

import ctypes
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.pinocchio.build import loop_library
from gauss_bench.engines.pinocchio.dynamics import SOLVED, ConstrainedDynamics
from gauss_bench.engines.pinocchio.forces import TreeForces
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
AGREEMENT = 1e-9  # relative: rounding leaves about 1e-13; headers whose layout differs from the library's give any number
VANISHING, ENDLESS, FAILED = -1, -2, -3  # returned by `advance_adaptive` instead of the number of steps


def beyond_the_loop(mechanism: Mechanism, choice: Choice, options: Mapping[str, Any]) -> str | None:
    """Return why the compiled loop cannot run this mechanism or choice, although the adapter in Python can, or None."""
    if choice.stabilization == "projection":
        return "Pinocchio's compiled loop has no projection: it is the suite's own"
    if mechanism.drivers:
        return "Pinocchio's compiled loop has no drivers"
    if options["algorithm"] == "lcaba":
        return "Pinocchio's compiled loop has no lcaba: it takes longer than constraintDynamics, and twice as long to build"
    names = ", ".join(f.name for f in mechanism.varying)
    return f"Pinocchio's compiled loop has no force that varies with time or direction: {names}" if names else None


class CompiledDynamics(ConstrainedDynamics):
    """A call (t, y, dy) -> tree accelerations (n,), and the steps, in C++.

    Raises:
        RunFailure: the loop is not built, or its accelerations at the start differ from those of Python's calls.
    """

    def __init__(self, body: Multibody, forces: TreeForces, options: Mapping[str, Any], gains: tuple[float, float]):
        super().__init__(body, forces, options, gains)
        self.n, self.library = forces.tree.n, _library()
        self.tableau = _tableau()  # imports scipy, which must not happen inside a run
        self.linkage = ctypes.c_void_p(self.library.create(_numbers(body.model.gravity.linear)))
        self._add_joints(body)
        for row in self.rows:
            ends = (row.joint1_id, _placement(row.joint1_placement), row.joint2_id, _placement(row.joint2_placement))
            self.library.add_closure(self.linkage, *ends, _numbers(gains))
        for force in forces.others:
            for load in force.to_loads():
                self._add_load(body, load)
        tables = [_numbers(x) for x in (forces.constant, forces.stiffness, forces.damping)]
        accuracies = _numbers([options["absolute_accuracy"], options["relative_accuracy"]])
        mu, most = (ctypes.c_double(options["mu"]), int(options["max_iter"]))
        self.library.finish(self.linkage, *tables, accuracies, mu, most, ctypes.c_double(SOLVED))
        self._compare(forces)

    def __del__(self) -> None:
        if linkage := getattr(self, "linkage", None):
            self.library.destroy(linkage)

    def _add_joints(self, body: Multibody) -> None:
        model = body.model
        for j in range(1, model.njoints):
            own = model.inertias[j]
            numbers = ctypes.c_double(own.mass), _numbers(own.lever), _numbers(own.inertia)
            kind = ctypes.c_char(KINDS[model.joints[j].shortname()])
            self.library.add_joint(self.linkage, int(model.parents[j]), kind, _placement(model.jointPlacements[j]), *numbers)

    def _add_load(self, body: Multibody, load: Law | PointForce) -> None:
        def at(point: Point) -> tuple[int, Any]:
            joint, own = body.placed(point)
            return int(joint), _numbers(own.translation[:2])

        def direction(link: int, x: Array) -> tuple[int, Any]:
            joint, own = body.carriers[link]
            return int(joint), _numbers(own.rotation[:2, :2] @ x)

        match load:
            case PointForce():
                self.library.add_push(self.linkage, *at(load.point), *direction(load.frame, load.value))
            case Law(coordinate=Along() as x):
                axis = direction(x.origin.link, unit(x.angle, x.across))[1]
                self.library.add_spring(self.linkage, *at(x.origin), *at(x.point), axis, _law(load))
            case Law(coordinate=Distance() as x):
                self.library.add_spring(self.linkage, *at(x.a), *at(x.b), _numbers([0.0, 0.0]), _law(load))
            case _:
                raise RunFailure(Status.SKIP, f"Pinocchio's compiled loop has no force on {load.coordinate}")

    def _compare(self, forces: TreeForces) -> None:
        """Check the loop's accelerations at the start against Python's calls: Eigen's headers must have the library's layout."""
        start = forces.tree.relative(forces.weightless.q0, forces.weightless.v0)
        own, expected = self(0.0, *start), np.array(super().__call__(0.0, *start))
        require_agreement({"accelerations of the compiled loop": (own, expected, size(expected))}, AGREEMENT)

    def __call__(self, t: float, y: Array, dy: Array) -> Array:
        state, a = [np.array(x, dtype=float) for x in (y, dy)], np.empty(self.n)
        if not self.library.accelerate(self.linkage, *map(_pointer, (*state, a))):
            self._fail(t, *state)
        self.evaluations += self.library.evaluations(self.linkage)
        return a

    def advance(self, integrator: str, t: float, y: Array, dy: Array, h: float, count: int) -> tuple[Array, Array]:
        """Return the state after `count` steps of h [s] from t.

        Raises:
            RunFailure: the accelerations have no solution at some stage.
        """
        y, dy = y.copy(), dy.copy()
        numbers = METHODS.index(integrator), _pointer(self.tableau), ctypes.c_double(h), ctypes.c_long(count)
        done = self.library.advance(self.linkage, *numbers, _pointer(y), _pointer(dy))
        self.evaluations += self.library.evaluations(self.linkage)
        if not done:
            self._fail(t, y, dy)
        return y, dy

    def advance_adaptive(self, times: Array, y: Array, dy: Array, rtol: float, atol: float) -> int:
        """Fill the states y, dy (k, n) at the times (k,), beginning with their first rows; return the number of steps.

        Raises:
            StepFailure: the error control could not continue.
            RunFailure: the accelerations have no solution at some stage.
        """
        last, times = [y[0].copy(), dy[0].copy()], np.ascontiguousarray(times, dtype=float)
        limits = _numbers([rtol, atol]), _pointer(times), ctypes.c_long(len(times)), ctypes.c_long(MOST)
        steps: int = self.library.advance_adaptive(self.linkage, _pointer(self.tableau), *limits, *map(_pointer, (*last, y, dy)))
        self.evaluations += self.library.evaluations(self.linkage)
        if steps == FAILED:
            self._fail(float(times[0]), *last)
        if steps < 0:
            raise StepFailure(
                {VANISHING: "Required step size is less than spacing between numbers."}.get(steps, f"more than {MOST} steps")
            )
        return steps

    def _fail(self, t: float, y: Array, dy: Array) -> None:
        """Raise the failure for the state at which the loop stopped; Python's call usually finds a more precise reason.

        Raises:
            RunFailure: always.
        """
        super().__call__(t, y, dy)
        raise RunFailure(Status.NOT_CONVERGED, f"after t = {t:.6g} s: Pinocchio's compiled loop misses the constraints")


def _numbers(x: Any) -> Any:
    """Return numbers as a C array, which owns its memory."""
    flat = np.ascontiguousarray(x, dtype=float).ravel()
    return (ctypes.c_double * len(flat))(*flat)


def _pointer(x: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(x.ctypes.data)


def _placement(x: Any) -> Any:
    return _numbers([*x.translation, *np.asarray(x.rotation).ravel()])


def _law(law: Law) -> Any:
    return _numbers([law.k, law.c, law.rest, law.bias])


@lru_cache(maxsize=1)
def _tableau() -> Array:
    """Return DOP853's coefficients from scipy, in the layout of `Tableau` in `loop.cpp`."""
    from scipy.integrate import DOP853

    stages, every = len(DOP853.B), 16
    a = np.zeros((every, every))
    a[:stages, :stages] = DOP853.A[:stages, :stages]
    a[stages + 1 :] = DOP853.A_EXTRA
    return np.concatenate([x.ravel() for x in (a, DOP853.B, DOP853.E5, DOP853.E3, DOP853.D)])


@lru_cache(maxsize=1)
def _library() -> ctypes.CDLL:
    """Load the compiled loop, once in a process.

    Raises:
        RunFailure: it is not built.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "loop.so"
        path.write_bytes(loop_library())
        library = ctypes.CDLL(str(path))
    library.create.restype = ctypes.c_void_p
    library.accelerate.restype = library.advance.restype = ctypes.c_bool
    library.advance_adaptive.restype = library.evaluations.restype = ctypes.c_long
    return library
