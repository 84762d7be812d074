"""First assembly: from a rough sketch to a consistent start.

The sketch picks the branch: Gauss-Newton closes the joints from it with nothing held, then the held coordinates of the start are
reached in small steps, so that a start far from the sketch keeps its assembly. Speeds follow from one linear system.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gauss_bench.linkage.bodies import write_out
from gauss_bench.linkage.build import measure_angle, measure_slide
from gauss_bench.linkage.errors import AssemblyError, NotPlaced
from gauss_bench.mechanism.close import Residual, project
from gauss_bench.mechanism.coordinates import gradient, spread, value
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import (
    GROUND,
    Along,
    Angle,
    Coordinate,
    Distance,
    Law,
    Measured,
    Mechanism,
    Point,
)
from gauss_bench.mechanism.numbers import Number, angle_of, exact, pair, radians, turn_vector
from gauss_bench.mechanism.spaces import angles
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory

RANK_TOLERANCE = 1e-9  # of the largest singular value: far above rounding, far below any usable transmission angle
LARGE, REGULAR = 100, 1e-8  # rows and columns from which normal equations are solved, where their pivots are that even
MOVES = 1e-6  # share of a coordinate's gradient that the joints leave free: far above rounding over any usable conditioning
CLOSED = 1e-10  # [m, rad] a residual that rounding explains; Gauss-Newton ends near 1e-16
STILL = 1e-15  # [m, rad] a step of Gauss-Newton that only rounding makes
NEARLY = 1e-9  # [m, rad] a step of Gauss-Newton that ends an intermediate closure: convergence is quadratic, so 1e-18 is left
FAR, ROUNDING = 100.0, 4e-16  # coordinates larger than FAR [m, rad] converge only to their own rounding, relative ROUNDING
LONGEST = 0.5  # [m, rad] longest step of Gauss-Newton
STEP = np.radians(5.0)  # largest change of a held coordinate between two closures
PATIENCE = 1500  # evaluations after which intermediate closures are skipped if the last one failed
MOST_STEPS = 720  # of STEP, ten turns: a larger gap is first reduced by whole turns, or is crossed in longer steps


@dataclass(frozen=True)
class Held:
    """Coordinates that a start holds, with the values (k,) and rates (k,) that they must take [m, rad and per second]."""

    coordinates: list[Coordinate]
    target: Array
    rate: Array

    def of(self, q: Array) -> tuple[Array, Array]:
        """Return the values (k,) of the held coordinates at q (n,), and their gradients as rows (k, n)."""
        rows = [gradient(x, q) for x in self.coordinates]
        return np.array([value(x, q) for x in self.coordinates]), np.array(rows).reshape(-1, len(q))


def assemble(mechanism: Mechanism, document: dict[str, Any]) -> Mechanism:
    """Return the mechanism with its start q0, v0 (n,) and the counts dof and redundant filled in.

    Raises:
        AssemblyError: a link is not placed by the sketch, the joints cannot be closed, the start does not determine the
            position or speeds, or the counts differ from `expect`.
    """
    joints = Constraints(replace(mechanism, drivers=(), knife_edges=()))
    held = list_held(mechanism, document["scenarios"][mechanism.scenario])
    q = sketch_from(mechanism, document)
    q = reach(mechanism, joints, held, q)
    v = start_velocity(mechanism, held, q)
    rank = _rank(joints(0.0, q, v).J)
    closed = replace(mechanism, q0=q, v0=v, dof=mechanism.n - rank, redundant=joints.m - rank)
    if not (mechanism.drivers or mechanism.crank is not None or "measure" in document):
        closed = replace(closed, measured=first_moving(closed, joints(0.0, q, v).J))
    check_expected(closed, document.get("expect", {}))
    check_springs(closed)
    closed = replace(closed, warnings=tuple(through_zero(closed, joints)))
    return replace(closed, apart=closed.apart and start_state(closed.apart, closed))


def sketch_from(mechanism: Mechanism, document: dict[str, Any]) -> Array:
    """Return q (n,) with the joints closed near the sketch; no coordinate of a start is held.

    Raises:
        AssemblyError: a link is not placed by the sketch, or the joints cannot be closed.
    """
    joints = Constraints(replace(mechanism, drivers=(), knife_edges=()))
    return close_joints(mechanism, joints, sketch(mechanism, document))


def start_state(apart: Mechanism, mechanism: Mechanism) -> Mechanism:
    """Return the mechanism of unwelded links, placed where the start of the welded bodies puts them."""
    start = Trajectory(np.zeros(1), mechanism.q0[None], mechanism.v0[None], np.zeros((1, mechanism.n)), 0)
    links = spread(mechanism, start)
    return replace(apart, q0=links.q[0], v0=links.v[0])


def free_coordinates(mechanism: Mechanism, q: Array, J: Array) -> list[str]:
    """Return names of link angles and slides that, held together, leave no freedom beside rows J (m, n) at q (n,); angles first."""
    names = []
    rank = _rank(J)
    # greedy: a coordinate is taken when its gradient raises the rank of the rows taken so far
    for x in _coordinates(mechanism):
        more = np.vstack([J, gradient(x.coordinate, q)])
        if rank < mechanism.n and _rank(more) > rank:
            J, rank = more, rank + 1
            names.append(x.name)
    return names


def _coordinates(mechanism: Mechanism) -> list[Measured]:
    """Return the angle of every link, then the coordinate of every slide."""
    angles = [measure_angle(mechanism.links, i) for i in range(len(mechanism.links))]
    return [*angles, *map(measure_slide, mechanism.slides)]


def first_moving(mechanism: Mechanism, J: Array) -> Measured:
    """Return the first link angle, or else the first slide, that joint rows J (m, n) let move.

    If the linkage is rigid, that is the angle of the first link.
    """
    coordinates = _coordinates(mechanism)
    rows = np.array([gradient(x.coordinate, mechanism.q0) for x in coordinates])  # (k, n)
    # a gradient that is a combination of joint rows belongs to a coordinate that cannot move: project those rows out
    held = _shortest(J.T, rows.T)
    free = np.abs(rows - held.T @ J).max(axis=1) > MOVES
    return coordinates[int(free.argmax())]


def check_expected(mechanism: Mechanism, expect: dict[str, int]) -> None:
    """Compare the counted degrees of freedom, redundant rows and loops with those that the file expects.

    Raises:
        AssemblyError: a count differs.
    """
    # Euler: a connected graph of links (and the ground) and joints has joints - links independent loops
    loops = len(mechanism.joints) - len(mechanism.links)
    counted = {"dof": mechanism.dof, "redundant": mechanism.redundant, "loops": loops}
    for key, count in expect.items():
        if counted[key] != count:
            raise AssemblyError(f"expect.{key}", f"the file says {count}, the assembled linkage has {counted[key]}")


def check_springs(mechanism: Mechanism) -> None:
    """Refuse a spring with a rest length between points that coincide at the start.

    Raises:
        AssemblyError: there is one.
    """
    for f in mechanism.forces:
        for law in (x for x in f.to_loads() if isinstance(x, Law) and (x.rest != 0 or x.bias != 0)):
            if isinstance(law.coordinate, Distance) and value(law.coordinate, mechanism.q0) < CLOSED:
                raise AssemblyError(f"forces.{f.name}.between", "the points coincide at the start: the force has no direction")


def through_zero(mechanism: Mechanism, joints: Constraints) -> Iterator[str]:
    """Warn of springs with a rest length whose end points the linkage can bring together: their force has no direction there."""
    if mechanism.dof <= len(mechanism.drivers):
        return  # the motion does not follow from forces
    close, world = joint_residual(joints), Point(GROUND, np.zeros(2), "ground.")
    for f in mechanism.forces:
        for law in (x for x in f.to_loads() if isinstance(x, Law) and x.k * x.rest + x.bias != 0):
            if not isinstance(ends := law.coordinate, Distance):
                continue
            # x and y of both ends; the joints closed with equal x and equal y mean that the points coincide
            axes = [[Along(world, p, 0.0, across) for p in (ends.a, ends.b)] for across in (False, True)]

            def residual(q: Array, axes: list[list[Along]] = axes) -> tuple[Array, Array]:
                (F, J), gaps = close(q), [value(b, q) - value(a, q) for a, b in axes]
                return np.append(F, gaps), np.vstack([J, *(gradient(b, q) - gradient(a, q) for a, b in axes)])

            if gauss_newton(mechanism.q0, residual)[1] < CLOSED:
                yield (
                    f"forces.{f.name}: the linkage can bring {ends.a.name} and {ends.b.name} together, where the spring has no "
                    "direction: its force turns round at once, and no step size follows that; keep the motion away from there"
                )


def gauss_newton(q: Array, residual: Residual, iterations: int = 60, enough: float = STILL) -> tuple[Array, float]:
    """Solve residual(q) -> (F, J) for F = 0 by Gauss-Newton with minimum-norm steps of at most LONGEST.

    The iteration ends when a step is smaller than `enough`, or than the rounding of coordinates that are large.

    Returns:
        q (n,) and max |F| there, infinity if the iteration diverged.
    """

    def lost(_: Array, F: Array, J: Array) -> bool:
        return not (np.isfinite(F).all() and np.isfinite(J).all())

    def still(q: Array, size: Array) -> bool:
        largest = float(np.abs(q).max(initial=0.0))
        return bool(size < (enough if largest < FAR else max(enough, ROUNDING * largest)))

    q = project(q, residual, _shortest, iterations, lost, still, LONGEST)
    F, J = residual(q)
    return q, np.inf if lost(q, F, J) else float(np.abs(F).max(initial=0.0))


def _shortest(J: Array, F: Array) -> Array:
    """Return the shortest x that minimises |J x - F|; large regular systems are solved by sparse normal equations."""
    sparse, factors = _normal_equations(J)
    if factors is None:
        return np.asarray(np.linalg.lstsq(J, F, rcond=RANK_TOLERANCE)[0])
    return np.asarray(sparse.T @ factors.solve(F) if J.shape[0] <= J.shape[1] else factors.solve(sparse.T @ F))


def _rank(J: Array) -> int:
    """Return the rank of rows J (m, n); regular normal equations show a full rank without a singular value decomposition."""
    if not len(J):
        return 0
    return min(J.shape) if _normal_equations(J)[1] is not None else int(np.linalg.matrix_rank(J, rtol=RANK_TOLERANCE))


def _normal_equations(J: Array) -> tuple[Any, Any]:
    """Return sparse J and LU factors of the smaller of J J^T and J^T J; None, None if J is small or they are singular."""
    if min(J.shape) >= LARGE:
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        sparse = csc_array(J)
        with suppress(RuntimeError):  # exactly singular
            factors = splu((sparse @ sparse.T if J.shape[0] <= J.shape[1] else sparse.T @ sparse).tocsc())
            pivots = np.abs(factors.U.diagonal())
            if pivots.min() > REGULAR * pivots.max():
                return sparse, factors
    return None, None


def levenberg_marquardt(q: Array, residual: Residual) -> Array:
    """Search for a root by Levenberg-Marquardt, for a sketch from which Gauss-Newton does not close the joints."""
    from scipy.optimize import least_squares

    tolerance = 1e-15
    return np.asarray(
        least_squares(lambda x: residual(x)[0], q, jac=lambda x: residual(x)[1], xtol=tolerance, ftol=tolerance, gtol=tolerance).x
    )


def joint_residual(joints: Constraints) -> Residual:
    """Return the function q (n,) -> joint constraints phi (m,) and their Jacobian (m, n)."""

    def residual(q: Array) -> tuple[Array, Array]:
        rows = joints(0.0, q, np.zeros_like(q))
        return rows.phi, rows.J

    return residual


def close_joints(mechanism: Mechanism, joints: Constraints, q: Array) -> Array:
    """Return q (n,) that closes all joints, near the sketch q (n,).

    Raises:
        AssemblyError: the joints cannot be closed; the widest open one is named.
    """
    residual = joint_residual(joints)
    closed, error = gauss_newton(q, residual)
    if error > CLOSED:
        closed, error = gauss_newton(levenberg_marquardt(q, residual), residual)
    if error > CLOSED:
        row = int(np.abs(residual(closed)[0]).argmax())
        name = mechanism.joints[row // 2].name
        raise AssemblyError("assembly", f"cannot be assembled from the sketch: joint {name} stays open by {error:.3g} (m or rad)")
    return closed


def list_held_items(mechanism: Mechanism, scenario: dict[str, Any], number: Number = float) -> list[tuple[Coordinate, Any, Any]]:
    """List the coordinates that the start and the drivers at t = 0 hold, with their values and rates."""
    held: list[tuple[Coordinate, Any, Any]] = []
    for driver in mechanism.drivers:
        target, rate, _ = driver.law(number("0"))
        held.append((driver.coordinate, target, rate))
    for link, (target, rate) in _list_held_angles(mechanism, scenario, number).items():
        held.append((Angle(GROUND, link), target, rate))
    start = scenario.get("start", {})
    by_name = {joint.name: joint for joint in mechanism.slides}
    for name, target in start.get("slides", {}).items():
        rate = start.get("slide_speeds", {}).get(name, 0)
        held.append((by_name[name].motion, exact(number, target), exact(number, rate)))
    for reference, target in start.get("points", {}).items():
        rates = start.get("point_velocities", {}).get(reference, (0, 0))
        point = mechanism.find_point(reference)
        for axis, across in enumerate((False, True)):
            along = Along(Point(GROUND, pair(number, (0, 0)), "ground."), point, 0.0, across)
            held.append((along, exact(number, target[axis]), exact(number, rates[axis])))
    return held


def list_held(mechanism: Mechanism, scenario: dict[str, Any], number: Number = float) -> Held:
    """List the angles, slides, points and lengths that the start and the drivers at t = 0 hold, with their rates."""
    items = list_held_items(mechanism, scenario, number)
    return Held([x for x, _, _ in items], np.array([target for _, target, _ in items]), np.array([rate for _, _, rate in items]))


def _list_held_angles(mechanism: Mechanism, scenario: dict[str, Any], number: Number) -> dict[int, tuple[Any, Any]]:
    """Link index -> held angle [rad] and speed [rad/s]."""
    start = scenario.get("start", {})
    placed = mechanism.find_body
    speeds = {placed(name)[0]: exact(number, x) for name, x in start.get("speeds", {}).items()}
    if "speed" in start and mechanism.crank is not None:
        speeds.setdefault(mechanism.crank, exact(number, start["speed"]))
    angles = {placed(name)[0]: radians(number, x) - placed(name)[1] for name, x in start.get("angles_deg", {}).items()}
    angles |= {placed(name)[0]: exact(number, x) - placed(name)[1] for name, x in start.get("angles", {}).items()}
    if mechanism.crank is not None and {"crank", "crank_deg"} & start.keys():
        angles[mechanism.crank] = angle_of(start, "crank", number)
    return {i: (x, speeds.get(i, number("0"))) for i, x in angles.items()}


def reach(mechanism: Mechanism, joints: Constraints, held: Held, q: Array) -> Array:
    """Move a closed q (n,) until the held coordinates take their values, in steps small enough to keep the assembly branch.

    Raises:
        AssemblyError: the held coordinates cannot be reached, or leave the position undetermined.
    """
    path = f"scenarios.{mechanism.scenario}.{'driver' if mechanism.drivers else 'start'}"
    close, evaluations = joint_residual(joints), 0

    def follow(state: Array, closed: bool) -> tuple[Array, float]:
        """Return the end of the homotopy and its residual; with `closed`, stop at the first place that cannot be closed."""
        # homotopy: the held coordinates must equal target + part * gap, with part falling from 1 to 0
        gap, error = held.of(state)[0] - held.target, np.inf
        for part in np.linspace(1.0, 0.0, 2 + min(MOST_STEPS, int(np.abs(gap).max(initial=0.0) / STEP)))[1:]:
            if part and error > CLOSED and evaluations > PATIENCE:
                continue
            goal = held.target + part * gap

            def residual(x: Array, goal: Array = goal) -> tuple[Array, Array]:
                nonlocal evaluations
                evaluations += 1
                (F, J), (value, rows) = close(x), held.of(x)
                return np.concatenate([F, value - goal]), np.vstack([J, rows])

            state, error = gauss_newton(state, residual, enough=NEARLY if part else STILL)
            if closed and error > CLOSED:
                break
        return state, error

    # First with every intermediate place closed, which keeps the branch; then from whole turns nearer; last through places that
    # cannot be closed, as a start beyond a dead centre needs it.
    near = turn_links(mechanism, held, q)
    far = bool(np.abs(held.of(q)[0] - held.target).max(initial=0.0) > MOST_STEPS * STEP)
    for start, closed in ((near, True), (near, False)) if far else ((q, True), (near, True), (q, False)):
        reached, error = follow(start, closed)
        if error <= CLOSED:
            break
    else:
        raise AssemblyError(path, f"the held coordinates cannot be reached from the sketch (residual {error:.3g})")
    J = np.vstack([close(reached)[1], held.of(reached)[1]])
    rank = _rank(J)
    if rank < mechanism.n:
        free = ", ".join(free_coordinates(mechanism, reached, J))
        way = ", in a `start` beside the list `drivers = [{ ... }]`" if mechanism.drivers else ""
        text = f"the held coordinates do not determine the position: {mechanism.n - rank} too few; what is free: {free or 'a link'}"
        raise AssemblyError(path, f"{text}; hold it{way}")
    return reached


def turn_links(mechanism: Mechanism, held: Held, q: Array) -> Array:
    """Return the same pose with each held angle within half a turn of its target, by adding whole turns.

    Links that slides connect to a turned link are turned with it: the slide constraint compares their angles.
    """
    q = q.copy()
    tied = [{end.link for end in joint.ends} for joint in mechanism.slides]
    for coordinate, gap in zip(held.coordinates, held.target - held.of(q)[0], strict=True):
        if isinstance(coordinate, Angle) and coordinate.a == GROUND:
            links = {coordinate.b}  # grows to all links that slides connect to it
            for _ in tied:
                links = links.union(*(pair for pair in tied if pair & links))
            if GROUND not in links:
                angles(q)[sorted(links)] += 2 * np.pi * np.round(gap / (2 * np.pi))
    return q


def start_velocity(mechanism: Mechanism, held: Held, q: Array) -> Array:
    """Return v (n,) that satisfies joints, knife edges and the held rates.

    Raises:
        AssemblyError: the rates contradict the constraints or leave the velocity undetermined.
    """
    rows = Constraints(replace(mechanism, drivers=()))(0.0, q, np.zeros_like(q))
    # J v = 0 for joints and knife edges, and the held gradients times v equal the held rates
    A = np.vstack([rows.J, held.of(q)[1]])
    b = np.concatenate([np.zeros(len(rows.J)), held.rate])
    v = _shortest(A, b)
    if np.abs(A @ v - b).max(initial=0.0) > CLOSED * max(1.0, np.abs(b).max(initial=0.0)):
        raise AssemblyError(f"scenarios.{mechanism.scenario}.start", "the speeds violate the constraints")
    return v


def sketch(mechanism: Mechanism, document: dict[str, Any]) -> Array:
    """Return a first guess q (n,): each link is placed by two known points, or by one point and a known angle.

    An angle is known from the file, or from a link that slides along this one.

    Raises:
        NotPlaced: links that cannot be placed, by name.
    """
    placing = _Sketch(mechanism, document)
    todo = list(range(len(mechanism.links)))
    while todo:
        placed = [i for i in todo if placing.place(i)]
        if not placed:
            raise NotPlaced(tuple(mechanism.links[i].name for i in todo))
        todo = [i for i in todo if i not in placed]
    return np.concatenate([[*placing.centre[i], placing.theta[i]] for i in range(len(mechanism.links))])


class _Sketch:
    """Places links one after the other: a placed link makes its pins known to its neighbours.

    Attributes:
        given: body -> angle [rad] that the file gives.
        drawn: name of a point -> world position (2,) [m] in the sketch, from joints, single points and ground pivots.
        theta, centre: body -> angle [rad] and centre of mass (2,) [m] of the placed bodies.
    """

    def __init__(self, mechanism: Mechanism, document: dict[str, Any]):
        self.mechanism, assembly = mechanism, document.get("assembly", {})
        angles = {name: float(np.radians(x)) for name, x in assembly.get("angles_deg", {}).items()} | assembly.get("angles", {})
        self.given = {i: x - turn for name, x in angles.items() for i, turn in [mechanism.find_body(name)]}
        drawing, drawn = assembly.get("sketch", {}), dict[str, Any]()
        for name, joint in write_out(document).get("joints", {}).items():
            references = joint.get("at") or [joint["block"]]
            grounded = [mechanism.ground_points[r.split(".")[1]] for r in references if r.startswith("ground.")]
            where = drawing.get(name, grounded[0] if grounded else None)
            drawn |= {} if where is None else dict.fromkeys(references, where)
        drawn |= {r: x for r, x in drawing.items() if "." in r}
        self.drawn = {mechanism.find_point(r).name: np.array(x, dtype=float) for r, x in drawn.items()}
        self.theta: dict[int, float] = {GROUND: 0.0}
        self.centre: dict[int, Array] = {GROUND: np.zeros(2)}

    def world(self, point: Point) -> Array:
        return np.asarray(self.centre[point.link] + turn_vector(point.local, self.theta[point.link]))

    def place(self, i: int) -> bool:
        """Place body i if enough is known, and return whether it was placed."""
        link = self.mechanism.links[i]
        known = {name: self.drawn[f"{link.name}.{name}"] for name in link.points if f"{link.name}.{name}" in self.drawn}
        for pin in self.mechanism.pins:
            for mine, other in (pin.ends, pin.ends[::-1]):
                if mine.link == i and other.link in self.theta:
                    known.setdefault(mine.name.partition(".")[2], self.world(other))
        if not known:
            return False
        # `first` is put where it is drawn; a second point apart from it gives the angle
        (first, at), *others = known.items()
        apart = next((name for name, _ in others if np.any(link.points[name] != link.points[first])), None)
        near, turn = self._partner_angle(i), self.given.get(i)
        if turn is None and apart is not None:
            own, drawn_line = link.points[apart] - link.points[first], known[apart] - at
            turn = float(np.arctan2(drawn_line[1], drawn_line[0]) - np.arctan2(own[1], own[0]))
        elif turn is None:
            turn = self._slide_angle(i) if near is None else near
        if turn is None:
            return False
        if near is not None:  # the sketch fixes angles only up to whole turns; slides do not
            turn += 2 * np.pi * round((near - turn) / (2 * np.pi))
        self.theta[i] = turn
        self.centre[i] = at - turn_vector(link.points[first] - link.com, turn)
        return True

    def _slide_angle(self, i: int) -> float | None:
        """Return the angle [rad] of body i from a slide whose guide and block points are known, the block ahead of the guide."""

        def where(point: Point) -> Array | None:
            ends = [(x, y) for pin in self.mechanism.pins for x, y in (pin.ends, pin.ends[::-1])]
            shared = next((y for x, y in ends if x.name == point.name and y.link in self.theta), None)
            return self.drawn.get(point.name, None if shared is None else self.world(shared))

        for joint in self.mechanism.slides:
            guide, block = where(joint.guide), where(joint.block)
            if i not in (joint.guide.link, joint.block.link) or guide is None or block is None:
                continue
            apart = float(np.hypot(*(block - guide)))
            # the axis passes the block at the offset: it is turned off the line of both points by arcsin(offset / apart)
            if apart > abs(joint.offset):
                line = float(np.arctan2(*(block - guide)[::-1])) - float(np.arcsin(joint.offset / apart)) - joint.angle
                return line if i == joint.guide.link else line + joint.turn
        return None

    def _partner_angle(self, i: int) -> float | None:
        """Return the angle [rad] of body i from a slide to a placed body; None without one."""
        for joint in self.mechanism.slides:
            for mine, other, turn in ((joint.block, joint.guide, joint.turn), (joint.guide, joint.block, -joint.turn)):
                if mine.link == i and other.link in self.theta:
                    return self.theta[other.link] + turn
        return None


def null_space(J: Array, n: int) -> Array:
    """Return an orthonormal basis (n, dof) of the directions that rows J (m, n) leave free."""
    if not J.any():
        return np.eye(n)
    _, s, Vt = np.linalg.svd(J)
    return np.asarray(Vt[int((s > RANK_TOLERANCE * s[0]).sum()) :].T)
