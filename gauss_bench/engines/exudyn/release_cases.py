"""Cases that compare Exudyn's releases beyond the adapter's runs: joints that the adapter does not use, and default settings.

The loop of the bars is closed by a constraint of constant distance between planar bodies, or by a joint between spatial bodies.
The accelerations that are compared are those that Exudyn computes at the start of a run.
"""

import inspect
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from gauss_bench.engines.bars import FOUR_BAR, GRAVITY, PAIR
from gauss_bench.engines.exudyn import across_releases
from gauss_bench.engines.exudyn.adapter import load_library
from gauss_bench.terms import Array

SOLVERS = ("EXUdense", "EigenDense", "EigenSparse")
# closure of bodies in space -> flags of the axes that it constrains: x and y only, because rows of other axes would be redundant
SPATIAL = {"ObjectJointGeneric": [1, 1, 0, 0, 0, 0], "ObjectJointSpherical": [1, 1, 0]}
PLANAR = "ObjectConnectorDistance"
FOUR, LENGTH = "wide_four_bar", "rod_of_one_length"
COMPARED = ("ObjectJoint", "ObjectConnector", "ObjectRigidBody", "Load")  # beginnings of names of items whose defaults are compared
WITHOUT_EFFECT = ("visualization", "name")  # arguments of an item on which no motion depends
DEPTH = 4  # levels of the settings that are read


def list_probes() -> list[dict[str, str]]:
    """List the cases: every closure with every linear solver; each has a name and the name of its linkage."""
    closures = dict.fromkeys(SPATIAL, FOUR) | {PLANAR: LENGTH}
    return [{"name": f"{name}, {solver}", "model": model} for name, model in closures.items() for solver in SOLVERS]


def ask_probe(name: str, q: Array, v: Array) -> Array:
    """Return the absolute accelerations (k, n) that Exudyn computes at the start of runs from the states q, v (k, n) of the bars.

    `name` is one of `list_probes`, "CLOSURE, SOLVER": Exudyn's names of the item that closes the loop and of the linear solver.
    """
    closure, _, linear_solver = name.rpartition(", ")
    exu, items = load_library()
    settings = exu.SimulationSettings()
    across_releases.write_nothing(settings)
    across_releases.set_linear_solver(exu, settings, linear_solver, ignore_singular=False)
    across_releases.set_method(exu, settings, "GeneralizedAlpha")
    accelerations = []
    for state in zip(q, v, strict=True):
        container = exu.SystemContainer()
        mbs = container.AddSystem()
        build = build_pair if closure == PLANAR else build_in_space
        coordinates = build(mbs, items, *state, closure)  # indices of x, y and the angle of every bar
        mbs.Assemble()
        solver = exu.MainSolverImplicitSecondOrder()
        solver.InitializeSolver(mbs, settings)
        # with this flag, the next call computes the accelerations
        settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = True
        solver.InitializeSolverInitialConditions(mbs, settings)
        accelerations.append(np.array(mbs.systemData.GetODE2Coordinates_tt())[list(coordinates)])
        del solver, mbs, container  # in this order: the solver and the system may refer to the container
    return np.array(accelerations)


def build_pair(mbs: Any, items: Any, q: Array, v: Array, closure: str) -> Sequence[int]:
    """Build crank and rocker as planar bodies with ends at a constant distance; return the indices of the bodies' coordinates."""
    ground = mbs.AddObject(items.ObjectGround())
    ends = []
    for k, bar in enumerate(PAIR):
        pose, speed = list(q[3 * k : 3 * k + 3]), list(v[3 * k : 3 * k + 3])
        node = mbs.AddNode(items.NodeRigidBody2D(referenceCoordinates=pose, initialVelocities=speed))
        body = mbs.AddObject(across_releases.rigid_body(items.ObjectRigidBody2D, bar.mass, bar.inertia, node))
        weigh(mbs, items, body)
        pins = [mark(mbs, items.MarkerBodyPosition, *end) for end in ((ground, bar.at), (body, -bar.centre))]
        mbs.AddObject(items.ObjectJointRevolute2D(markerNumbers=pins))
        ends.append(mark(mbs, items.MarkerBodyPosition, body, bar.length - bar.centre))
    mbs.AddObject(getattr(items, closure)(markerNumbers=ends, distance=2.0))
    return range(6)


def build_in_space(mbs: Any, items: Any, q: Array, v: Array, closure: str) -> Sequence[int]:
    """Build the four-bar of spatial rigid bodies, and return the indices of x, y and the angle about z of every bar.

    The bars form a tree of hinges about z; the joint `closure` holds the end of the rod at the end of the rocker, in x and y.
    """
    ground = mbs.AddObject(items.ObjectGround())
    bodies: list[Any] = []
    for k, bar in enumerate(FOUR_BAR):
        pose, speed = in_space(q[3 * k : 3 * k + 3]), in_space(v[3 * k : 3 * k + 3])
        node = mbs.AddNode(items.NodeRigidBodyRxyz(referenceCoordinates=pose, initialVelocities=speed))
        moments = [bar.inertia] * 3 + [0.0] * 3  # equal about all axes
        bodies.append(mbs.AddObject(across_releases.rigid_body(items.ObjectRigidBody, bar.mass, moments, node)))
        weigh(mbs, items, bodies[k])
        parent, place = (ground, bar.at) if bar.parent < 0 else (bodies[bar.parent], bar.at - FOUR_BAR[bar.parent].centre)
        pins = [mark(mbs, items.MarkerBodyRigid, *end) for end in ((parent, place), (bodies[k], -bar.centre))]
        mbs.AddObject(items.ObjectJointGeneric(markerNumbers=pins, constrainedAxes=[1, 1, 1, 1, 1, 0]))
    ends = [mark(mbs, items.MarkerBodyRigid, bodies[k], FOUR_BAR[k].length - FOUR_BAR[k].centre) for k in (1, 2)]  # rod, rocker
    mbs.AddObject(getattr(items, closure)(markerNumbers=ends, constrainedAxes=SPATIAL[closure]))
    return [6 * k + axis for k in range(len(FOUR_BAR)) for axis in (0, 1, 5)]


def in_space(x: Array) -> list[float]:
    """Return x, y and angle (3,) of a body in the plane as its six coordinates in space."""
    return [float(x[0]), float(x[1]), 0.0, 0.0, 0.0, float(x[2])]


def weigh(mbs: Any, items: Any, body: Any) -> None:
    """Let gravity act on a body."""
    marker = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=body))
    mbs.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=[0.0, GRAVITY, 0.0]))


def mark(mbs: Any, kind: Any, body: Any, at: float) -> Any:
    """Add a marker of the class `kind` at a point of a bar, `at` [m] from its centre of mass, and return it."""
    return mbs.AddMarker(kind(bodyNumber=body, localPosition=[at, 0.0, 0.0]))


def defaults() -> dict[str, str]:
    """Return name -> default value, of the simulation settings and of the arguments of joints, connectors, bodies and loads.

    Linear solvers and integrators have no default value; each one that the release has is listed with the value "there".
    """
    exu, items = load_library()
    values = dict(read_settings(exu.SimulationSettings(), "", DEPTH))
    for name, kind in vars(items).items():
        if inspect.isclass(kind) and name.startswith(COMPARED):
            for argument in inspect.signature(kind.__init__).parameters.values():
                if argument.default is not argument.empty and argument.name not in WITHOUT_EFFECT:
                    values[f"{name} {argument.name}"] = str(argument.default)
    values |= {f"linear solver {name}": "there" for name in dir(exu.LinearSolverType) if name.startswith(("EXU", "Eigen"))}
    return values | {f"method {name}": "there" for name in dir(exu.DynamicSolverType) if name[0].isupper()}


def read_settings(settings: Any, place: str, depth: int) -> Iterator[tuple[str, str]]:
    """Yield the path and the value of every number, flag and word of settings.

    Args:
        place: beginning of every path, such as "timeIntegration.".
        depth: number of nested levels of settings that are read.
    """
    for name in dir(settings):
        if name.startswith("_"):
            continue
        value = getattr(settings, name)
        if callable(value):
            continue
        if isinstance(value, (bool, int, float)):
            yield f"{place}{name}", f"{value:.12g}" if isinstance(value, float) else str(value)
        elif type(value).__module__.startswith("exudyn") and depth and not hasattr(value, "value"):  # nested settings, no word
            yield from read_settings(value, f"{place}{name}.", depth - 1)
        elif hasattr(value, "name"):
            yield f"{place}{name}", str(value.name)
