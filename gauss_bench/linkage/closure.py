"""Assemble a linkage: find a consistent start near its rough sketch, which decides the assembly mode.

Gauss-Newton closes the joints near the sketch. Then the coordinates that the start prescribes move to their values in small steps,
so that the assembly mode is kept. Speeds follow from one linear system.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from gauss_bench.linkage.build import measure_angle, measure_slide
from gauss_bench.linkage.errors import AssemblyError
from gauss_bench.linkage.sketch import sketch
from gauss_bench.mechanism.close import RANK_TOLERANCE, Residual, minimum_norm, project
from gauss_bench.mechanism.coordinates import gradient, motion_of_links, value
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import GROUND, Along, Angle, Coordinate, Distance, Law, Measured, Mechanism, Point, Revolute
from gauss_bench.mechanism.numbers import Number, angle_of, exact, pair, radians
from gauss_bench.mechanism.spaces import angles
from gauss_bench.terms import Array, largest
from gauss_bench.trajectory import Trajectory

LARGE = 100  # smallest number of rows, and of columns, of a system that is solved by sparse normal equations
REGULAR = 1e-8  # smallest pivot of regular normal equations, relative to the largest
MOVES = 1e-6  # a coordinate can move if its gradient has a larger entry outside the span of the joint rows; less is rounding
CLOSED = 1e-10  # [m, rad] largest residual of closed joints; Gauss-Newton ends near 1e-16
STILL = 1e-15  # [m, rad] largest step of Gauss-Newton that is rounding alone
NEARLY = 1e-9  # [m, rad] largest last step of an intermediate closure: convergence is quadratic, so that 1e-18 is left
FAR, ROUNDING = 100.0, 4e-16  # coordinates of FAR [m, rad] or more converge to a step of ROUNDING times the largest of them
LONGEST = 0.5  # [m, rad] longest step of Gauss-Newton
STEP = np.radians(5.0)  # [rad, m] largest change of a held coordinate between two closures
PATIENCE = 1500  # number of evaluated residuals after which intermediate closures are skipped if the last closure failed
MOST_STEPS = 720  # largest number of steps to a target (ten turns): for a longer way, whole turns come first, or steps are longer


@dataclass(frozen=True)
class Held:
    """The k coordinates that the drivers and the start of a scenario prescribe ("hold").

    Attributes:
        target: (k,) values that the coordinates must take [m, rad].
        rate: (k,) rates that they must take [m/s, rad/s].
    """

    coordinates: list[Coordinate]
    target: Array
    rate: Array

    def evaluate(self, q: Array) -> tuple[Array, Array]:
        """Return the values (k,) of the held coordinates at q (n,), and their gradients as rows (k, n)."""
        rows = [gradient(x, q) for x in self.coordinates]
        return np.array([value(x, q) for x in self.coordinates]), np.array(rows).reshape(-1, len(q))


def assemble(mechanism: Mechanism, document: dict[str, Any]) -> Mechanism:
    """Return the mechanism with its start q0, v0 (n,), the degrees of freedom `dof` and the number `redundant` of redundant rows.

    Raises:
        AssemblyError: the sketch does not place a link; the joints cannot be closed; the start cannot be reached, leaves the
            position undetermined or contradicts the joints; a count differs from the table `expect`; or a spring has no direction.
    """
    joints = joint_constraints(mechanism)
    held = list_held(mechanism, document["scenarios"][mechanism.scenario])
    q = close_joints(mechanism, joints, sketch(mechanism, document))
    q = reach_held(mechanism, joints, held, q)
    v = start_velocity(mechanism, held, q)
    _, J = joints.residual(q)
    rank = _rank(J)
    closed = replace(mechanism, q0=q, v0=v, dof=mechanism.n - rank, redundant=joints.m - rank)
    if not (mechanism.drivers or mechanism.crank is not None or "measure" in document):  # the file does not say what is measured
        closed = replace(closed, measured=first_moving(closed, J))
    check_expected(closed, document.get("expect", {}))
    closed = replace(closed, warnings=tuple(check_springs(closed)))
    if closed.apart is None:
        return closed
    # in `apart`, welded links are separate bodies
    start = motion_of_links(closed, Trajectory(np.zeros(1), q[None], v[None], np.zeros((1, mechanism.n)), 0))
    return replace(closed, apart=replace(closed.apart, q0=start.q[0], v0=start.v[0]))


def joint_constraints(mechanism: Mechanism) -> Constraints:
    """Return the constraint rows of the joints and couplings of a mechanism, without those of drivers and knife edges."""
    return Constraints(replace(mechanism, drivers=(), knife_edges=()))


def free_coordinates(mechanism: Mechanism, q: Array, J: Array) -> list[str]:
    """Return names of angles and slides that, fixed in addition to the constraints J (m, n), leave no freedom at q (n,)."""
    names = []
    rank = _rank(J)
    # greedy: a coordinate is taken if its gradient raises the rank of the rows taken so far
    for x in _list_coordinates(mechanism):
        extended = np.vstack([J, gradient(x.coordinate, q)])
        if rank < mechanism.n and _rank(extended) > rank:
            J, rank = extended, rank + 1
            names.append(x.name)
    return names


def _list_coordinates(mechanism: Mechanism) -> list[Measured]:
    """Return the angle of every link, then the coordinate along every slide, in the order of the file."""
    angles = [measure_angle(mechanism.links, i) for i in range(len(mechanism.links))]
    return [*angles, *map(measure_slide, mechanism.slides)]


def first_moving(mechanism: Mechanism, J: Array) -> Measured:
    """Return the first link angle, else the first slide, that can change without violating the joint rows J (m, n).

    If nothing can move, the first angle is returned.
    """
    coordinates = _list_coordinates(mechanism)
    rows = np.array([gradient(x.coordinate, mechanism.q0) for x in coordinates])  # (k, n)
    # a coordinate cannot move if its gradient is a combination of joint rows: subtract the nearest combination
    coefficients = _shortest(J.T, rows.T)  # (m, k)
    moves = np.abs(rows - coefficients.T @ J).max(axis=1) > MOVES
    return coordinates[int(moves.argmax())]  # argmax: the first True


def check_expected(mechanism: Mechanism, expect: dict[str, int]) -> None:
    """Compare the counted degrees of freedom, redundant rows and loops with those that the file expects.

    Raises:
        AssemblyError: a count differs.
    """
    counted = {"dof": mechanism.dof, "redundant": mechanism.redundant, "loops": mechanism.loops}
    for key, count in expect.items():
        if counted[key] != count:
            raise AssemblyError(f"expect.{key}", f"the file says {count}, the assembled linkage has {counted[key]}")


def check_springs(mechanism: Mechanism) -> Iterator[str]:
    """Yield a warning about each spring that has a force at zero length and whose end points can coincide in some position.

    There is no warning if the drivers prescribe the whole motion. This is a generator: it checks nothing until it is read.

    Raises:
        AssemblyError: the end points of a spring with a rest length or a bias coincide at the start: its force has no direction.
    """
    loads = [(force.name, load) for force in mechanism.forces for load in force.to_loads() if isinstance(load, Law)]
    springs = [(name, law, law.coordinate) for name, law in loads if isinstance(law.coordinate, Distance)]
    for name, law, distance in springs:
        if (law.rest != 0 or law.bias != 0) and value(distance, mechanism.q0) < CLOSED:
            raise AssemblyError(f"forces.{name}.between", "the points coincide at the start: the force has no direction")
    for name, law, distance in springs:
        # a spring without rest length passes through zero smoothly, and driven motions do not follow from forces
        if law.k * law.rest + law.bias == 0 or mechanism.dof <= len(mechanism.drivers):
            continue
        # the points can coincide if the joints can be closed with one more pin between them
        pin = Revolute(name, name, distance.a, distance.b)
        pinned = joint_constraints(replace(mechanism, joints=(*mechanism.joints, pin)))
        if gauss_newton(mechanism.q0, pinned.residual)[1] < CLOSED:
            yield (
                f"forces.{name}: the linkage can bring {pin.a.name} and {pin.b.name} together, where the spring has no "
                "direction: its force reverses at once, which no step size resolves; keep the motion away from there"
            )


def gauss_newton(q: Array, residual: Residual, iterations: int = 60, enough: float = STILL) -> tuple[Array, float]:
    """Solve F = 0 by Gauss-Newton with minimum-norm steps of at most LONGEST; return q (n,) and max |F|.

    residual(q) returns F (m,) and J (m, n). The iteration ends if a step is shorter than `enough` [m, rad], or than the rounding of
    large coordinates. If it diverges, max |F| is infinite.
    """

    def is_infinite(_: Array, F: Array, J: Array) -> bool:
        return not (np.isfinite(F).all() and np.isfinite(J).all())

    def is_still(q: Array, size: Array) -> bool:
        """Tell whether the largest entry of a step, `size`, is below `enough`, or below the rounding of large coordinates."""
        coordinate = largest(q)
        rounding = ROUNDING * coordinate if coordinate >= FAR else 0.0
        return bool(size < max(enough, rounding))

    q = project(q, residual, _shortest, iterations, is_infinite, is_still, LONGEST)
    F, J = residual(q)
    return q, np.inf if is_infinite(q, F, J) else largest(F)


def _shortest(J: Array, F: Array) -> Array:
    """Return the shortest x that minimises |J x - F|; large regular systems are solved by sparse normal equations."""
    normal = _normal_equations(J)
    if normal is None:
        return minimum_norm(J, F)
    sparse, factors = normal
    # at least as many columns as rows: x = J^T (J J^T)^-1 F; otherwise x = (J^T J)^-1 J^T F
    return np.asarray(sparse.T @ factors.solve(F) if J.shape[0] <= J.shape[1] else factors.solve(sparse.T @ F))


def _rank(J: Array) -> int:
    """Return the rank of rows J (m, n); regular normal equations show a full rank without a singular value decomposition."""
    if not len(J):
        return 0
    return int(np.linalg.matrix_rank(J, rtol=RANK_TOLERANCE)) if _normal_equations(J) is None else min(J.shape)


def _normal_equations(J: Array) -> tuple[Any, Any] | None:
    """Return sparse J and LU factors of the smaller of J J^T and J^T J; None if J is small or the product nearly singular."""
    if min(J.shape) < LARGE:
        return None
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    sparse = csc_array(J)
    normal = sparse @ sparse.T if J.shape[0] <= J.shape[1] else sparse.T @ sparse
    try:
        factors = splu(normal.tocsc())
    except RuntimeError:  # exactly singular
        return None
    pivots = np.abs(factors.U.diagonal())
    return (sparse, factors) if pivots.min() > REGULAR * pivots.max() else None


def levenberg_marquardt(q: Array, residual: Residual) -> Array:
    """Return q (n,) nearer to a root of `residual`, by scipy's trust-region method: Gauss-Newton may converge from there."""
    from scipy.optimize import least_squares

    return np.asarray(least_squares(lambda x: residual(x)[0], q, lambda x: residual(x)[1], xtol=1e-15, ftol=1e-15, gtol=1e-15).x)


def close_joints(mechanism: Mechanism, joints: Constraints, q: Array) -> Array:
    """Return a position (n,) near the sketch q (n,) that closes all joints.

    Raises:
        AssemblyError: the joints cannot be closed; the message names the joint or coupling with the widest gap.
    """
    closed, error = gauss_newton(q, joints.residual)
    if error > CLOSED:
        closed, error = gauss_newton(levenberg_marquardt(q, joints.residual), joints.residual)
    if error > CLOSED:
        row = int(np.abs(joints.residual(closed)[0]).argmax())
        name = mechanism.held_names[row]
        kind = "constraint" if name in [x.name for x in mechanism.couplings] else "joint"
        raise AssemblyError("assembly", f"cannot be assembled from the sketch: {kind} {name} stays open by {error:.3g} (m or rad)")
    return closed


def list_held(mechanism: Mechanism, scenario: dict[str, Any], number: Number = float) -> Held:
    """Return the coordinates that the drivers and the table `start` prescribe at t = 0, with their values and rates.

    Drivers come first, then the angles, slides and points of `start`.
    """
    start = scenario.get("start", {})
    # (coordinate, value, rate); a law returns value, first and second derivative
    held: list[tuple[Coordinate, Any, Any]] = [(x.coordinate, *x.law(number("0"))[:2]) for x in mechanism.drivers]
    held += [(Angle(GROUND, link), *prescribed) for link, prescribed in _list_held_angles(mechanism, start, number).items()]
    for name, target in start.get("slides", {}).items():
        speed = start.get("slide_speeds", {}).get(name, 0)
        held.append((mechanism.drivable[name].motion, exact(number, target), exact(number, speed)))
    world = Point(GROUND, pair(number, (0, 0)), "ground.")
    for reference, place in start.get("points", {}).items():
        velocity = start.get("point_velocities", {}).get(reference, (0, 0))
        point = mechanism.find_point(reference)
        for across, target, speed in zip((False, True), place, velocity, strict=True):  # x, then y
            held.append((Along(world, point, 0.0, across), exact(number, target), exact(number, speed)))
    return Held([x for x, _, _ in held], np.array([target for _, target, _ in held]), np.array([rate for _, _, rate in held]))


def _list_held_angles(mechanism: Mechanism, start: dict[str, Any], number: Number) -> dict[int, tuple[Any, Any]]:
    """Return index of a body -> (angle [rad], angular speed [rad/s]) of each body whose angle `start` prescribes."""
    speeds: dict[int, Any] = {}
    for name, speed in start.get("speeds", {}).items():
        body, _ = mechanism.find_body(name)
        speeds[body] = exact(number, speed)
    crank = mechanism.crank
    if "speed" in start and crank is not None:
        speeds.setdefault(crank, exact(number, start["speed"]))
    angles: dict[int, Any] = {}
    for key, convert in (("angles_deg", radians), ("angles", exact)):
        for name, angle in start.get(key, {}).items():
            body, turn = mechanism.find_body(name)  # turn: constant angle of the link in its body
            angles[body] = convert(number, angle) - turn
    if crank is not None and {"crank", "crank_deg"} & start.keys():
        angles[crank] = angle_of(start, "crank", number)
    return {body: (angle, speeds.get(body, number("0"))) for body, angle in angles.items()}


@dataclass
class _Search:
    """The search for a position in which the joints are closed and the held coordinates have their prescribed values.

    Attributes:
        evaluations: number of residuals computed so far, in all attempts together.
    """

    joints: Constraints
    held: Held
    evaluations: int = 0

    def follow(self, q: Array, stays_closed: bool) -> tuple[Array, float]:
        """Move the held coordinates in small steps to their targets (homotopy); return the last position and its residual.

        With `stays_closed`, stop at the first intermediate position in which the joints cannot be closed.
        """
        # the held coordinates must equal target + share * gap, with the share falling from 1 to 0
        target = self.held.target
        gap, error = self.held.evaluate(q)[0] - target, np.inf
        steps = 1 + min(MOST_STEPS, int(largest(gap) / STEP))
        for share in np.linspace(1.0, 0.0, steps + 1)[1:]:
            if share and error > CLOSED and self.evaluations > PATIENCE:
                continue  # the last intermediate position failed, after many evaluations: try the target itself at once
            q, error = gauss_newton(q, partial(self._residual, target + share * gap), enough=NEARLY if share else STILL)
            if stays_closed and error > CLOSED:
                break
        return q, error

    def _residual(self, goal: Array, q: Array) -> tuple[Array, Array]:
        """Return the residual of the joints, then of the held coordinates less `goal` (k,), at q (n,), and its Jacobian."""
        self.evaluations += 1
        F, J = self.joints.residual(q)
        values, rows = self.held.evaluate(q)
        return np.concatenate([F, values - goal]), np.vstack([J, rows])


def reach_held(mechanism: Mechanism, joints: Constraints, held: Held, q: Array) -> Array:
    """Move a position q (n,) with closed joints until the held coordinates have their prescribed values; return that position.

    The steps are small enough to keep the assembly mode. There are up to three attempts: through closed positions; the same after
    whole turns have been added to links; and through positions in which the joints cannot be closed.

    Raises:
        AssemblyError: the held coordinates cannot be reached, or leave the position undetermined.
    """
    path = f"scenarios.{mechanism.scenario}.{'driver' if mechanism.drivers else 'start'}"
    search = _Search(joints, held)
    # a start beyond a dead centre needs the last attempt; from far away, whole turns come first
    turned = turn_links(mechanism, held, q)
    attempts = [(q, True), (turned, True), (q, False)]  # (first position, whether to stop where the joints cannot be closed)
    values, _ = held.evaluate(q)
    if largest(values - held.target) > MOST_STEPS * STEP:
        attempts = [(turned, True), (turned, False)]
    for start, stays_closed in attempts:
        reached, error = search.follow(start, stays_closed)
        if error <= CLOSED:
            break
    else:
        raise AssemblyError(path, f"the held coordinates cannot be reached from the sketch (residual {error:.3g})")
    _check_determined(mechanism, reached, np.vstack([joints.residual(reached)[1], held.evaluate(reached)[1]]), path)
    return reached


def _check_determined(mechanism: Mechanism, q: Array, J: Array, path: str) -> None:
    """Check that rows J (m, n) of joints and held coordinates determine the position q (n,); `path` of keys is for the message.

    Raises:
        AssemblyError: the rank of J is less than n; the message names coordinates that are free.
    """
    rank = _rank(J)
    if rank < mechanism.n:
        free = ", ".join(free_coordinates(mechanism, q, J))
        where = ", in a `start` beside the list `drivers = [{ ... }]`" if mechanism.drivers else ""
        text = f"the held coordinates do not determine the position: {mechanism.n - rank} too few; still free: {free or 'a link'}"
        raise AssemblyError(path, f"{text}; hold it{where}")


def turn_links(mechanism: Mechanism, held: Held, q: Array) -> Array:
    """Return q (n,) with whole turns added to links, so that each held angle is within half a turn of its target.

    Links that slides connect to a turned link turn with it, because a slide compares their angles.
    """
    q = q.copy()
    slides = [{end.link for end in joint.ends} for joint in mechanism.slides]
    for coordinate, gap in zip(held.coordinates, held.target - held.evaluate(q)[0], strict=True):
        if isinstance(coordinate, Angle) and coordinate.a == GROUND:
            links = {coordinate.b}  # grows to all links that slides connect to it
            for _ in slides:
                links = links.union(*(pair for pair in slides if pair & links))
            if GROUND not in links:
                angles(q)[sorted(links)] += 2 * np.pi * np.round(gap / (2 * np.pi))
    return q


def start_velocity(mechanism: Mechanism, held: Held, q: Array) -> Array:
    """Return v (n,) that satisfies joints and knife edges, and gives the held coordinates their prescribed rates.

    Raises:
        AssemblyError: the rates contradict the constraints.
    """
    rows = Constraints(replace(mechanism, drivers=()))(0.0, q, np.zeros_like(q))
    # J v = 0 for joints and knife edges; the gradients of held coordinates times v equal the held rates
    A = np.vstack([rows.J, held.evaluate(q)[1]])
    b = np.concatenate([np.zeros(len(rows.J)), held.rate])
    v = _shortest(A, b)
    if largest(A @ v - b) > CLOSED * max(1.0, largest(b)):
        raise AssemblyError(f"scenarios.{mechanism.scenario}.start", "the speeds violate the constraints")
    return v


def null_space(J: Array, n: int) -> Array:
    """Return an orthonormal basis (n, dof) of the directions that rows J (m, n) leave free."""
    if not J.any():
        return np.eye(n)
    _, s, Vt = np.linalg.svd(J)
    return np.asarray(Vt[int((s > RANK_TOLERANCE * s[0]).sum()) :].T)
