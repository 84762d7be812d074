"""Linkages of one structure with different numbers: what a kernel leaves open, and a start for each that is closed.

A family is a `Mechanism` whose numbers are arrays: a length is (batch,), a vector (2, batch), and the formulas of
`mechanism/coordinates.py`, which take numbers of any kind, evaluate all of them at states (..., batch, n) at once.

Starts come from that of the file: numbers and held coordinates go to those of each sample in small steps, and Newton's method
closes the joints after each. Where that does not end on the constraints, the sample is read and assembled on its own, which also
says why one cannot be.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from gauss_bench.compiler.equations.links import force_numbers, parameter_values
from gauss_bench.linkage.build import Resolver, build_link, resolve_points
from gauss_bench.linkage.closure import CLOSED, LONGEST, STEP, list_held_items
from gauss_bench.linkage.errors import BuildError, LinkageError
from gauss_bench.linkage.load import load_document
from gauss_bench.linkage.schema import LinkageTable
from gauss_bench.mechanism.close import project
from gauss_bench.mechanism.coordinates import gradient, value
from gauss_bench.mechanism.model import GROUND, Along, Coordinate, Force, Joint, Mechanism, Point, Prismatic, Revolute
from gauss_bench.sweep.paths import Document, change, number_at
from gauss_bench.terms import Array

STRIDE = 0.02  # of the linkage's size: largest change of a dimension between two closures
NEWTON = 12  # iterations of each closure: three or four are needed
WHOLE = ("gravity", "ground")  # tables of the file's top level that hold no tables by name
OPEN = ("links", "ground", "gravity", "forces", "joints", "scenarios")
Columns = Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Starts:
    """Starts of some samples.

    Attributes:
        columns: name of an open number -> (k,) values.
        q, v: (k, n); not a number where a sample cannot be assembled.
        reasons: sample -> why it cannot be.
    """

    columns: Columns
    q: Array
    v: Array
    reasons: Mapping[int, str]


class Family:
    """One linkage in one scenario with some of its numbers varied.

    Attributes:
        document: of the one scenario, its override merged.
        paths: of what varies.
        nominal: the mechanism of the file.
    """

    def __init__(self, document: Document, scenario: str, paths: Sequence[str], source: str):
        self.document, self.scenario, self.paths, self.source = document, scenario, tuple(paths), source
        self.nominal = load_document(document, scenario, source)
        self.heads = dict[tuple[str, ...], list[int]]()  # of each table that paths touch: which paths
        for k, path in enumerate(paths):
            head, *rest = path.split(".")
            self.heads.setdefault((head,) if head in WHOLE else (head, *rest[:1]), []).append(k)

    @cached_property
    def closed_to_kernels(self) -> str:
        """The reason why a kernel cannot leave open what varies, or an empty text."""
        for path in self.paths:
            head, *rest = path.split(".")
            usual = head in OPEN and not (head == "joints" and rest[-1] != "offset")
            usual = usual and not (head == "scenarios" and rest[1:2] != ["start"])
            usual = usual and not (head == "forces" and rest[1].removesuffix("_deg") not in force_numbers_of(self.nominal, rest[0]))
            if not usual:
                return f"{path} is no number that a kernel leaves open"
            if head in ("links", "ground") and ("welds" in self.document or "cylinders" in self.document):
                return f"{path} may be part of a welded body"
        return ""

    def document_of(self, values: Sequence[float]) -> Document:
        """The document of one sample."""
        return change(self.document, dict(zip(self.paths, map(float, values), strict=True)))

    def mechanism_of(self, values: Sequence[float]) -> Mechanism:
        """One sample, read and assembled on its own.

        Raises:
            LinkageError: why it cannot be.
        """
        return load_document(self.document_of(values), self.scenario, self.source)

    @cached_property
    def _tables(self) -> dict[str, TypeAdapter[Any]]:
        known = LinkageTable.model_fields
        return {head: TypeAdapter(known[head].rebuild_annotation()) for head, *_ in self.heads}

    @cached_property
    def _resolver(self) -> Resolver:
        return Resolver(self.document)

    @cached_property
    def _parameters(self) -> dict[str, float]:
        return parameter_values(self.nominal)

    @cached_property
    def open_numbers(self) -> tuple[str, ...]:
        """Names of the numbers that change with any of the paths, as kernels call them."""
        moved = set[str]()
        for factor in (1.01, 1.3):
            for head, places in self.heads.items():
                for path in (self.paths[k] for k in places):
                    old = number_at(self.document, path)
                    try:
                        numbers = self._numbers(head, change(self.document, {path: old * factor if old else factor - 1.0}))
                    except (BuildError, ValidationError):
                        continue
                    moved |= {name for name, x in numbers.items() if x != self._parameters[name]}
        return tuple(name for name in self._parameters if name in moved)

    def _numbers(self, head: tuple[str, ...], document: Document) -> dict[str, float]:
        """Numbers of a table, by their names in kernels.

        Raises:
            ValidationError, BuildError: the table is no longer that of a linkage.
        """
        kind, *names = head
        table, form = document[kind], self._tables[kind]
        if kind == "gravity":
            form.validate_python(table)
            return {f"gravity.{axis}": float(x) for axis, x in zip("xy", table, strict=True)}
        if kind == "ground":
            form.validate_python(table)
            return _places("points.ground", resolve_points(table["points"]))
        (name,) = names
        form.validate_python({name: table[name]})
        if kind == "links":
            link = build_link(name, table[name])
            numbers = {f"links.{name}.mass": float(link.mass), f"links.{name}.inertia": float(link.inertia)}
            numbers |= {f"links.{name}.com.{axis}": float(x) for axis, x in zip("xy", link.com, strict=True)}
            return numbers | _places(f"points.{name}", link.points)
        if kind == "joints":
            return {f"joints.{name}.offset": float(table[name]["offset"])}
        if kind != "forces" or all(f.name != name for f in self.nominal.forces):
            return {}
        numbers = {}
        for key, x in force_numbers(self._resolver.force(name, table[name])).items():  # type: ignore[arg-type]
            numbers |= (
                {f"forces.{name}.{key}": float(x)}
                if np.ndim(x) == 0
                else {f"forces.{name}.{key}.{axis}": float(y) for axis, y in zip("xy", np.ravel(x), strict=True)}
            )
        return numbers

    def starts(self, values: Array) -> Starts:
        """Numbers and starts of samples (k, d)."""
        reasons, goals = dict[int, str](), np.array([self._goals(self.document)] * len(values))
        columns = {name: np.full(len(values), self._parameters[name]) for name in self.open_numbers}
        for head, places in self.heads.items():
            # a table is read once for each of its contents: a grid has few, and what varies elsewhere does not change them
            contents, which = np.unique(values[:, places], axis=0, return_inverse=True)
            which, numbers = which.ravel(), list[dict[str, float] | None]()
            for j, row in enumerate(contents.tolist()):
                document = change(self.document, dict(zip([self.paths[k] for k in places], row, strict=True)))
                try:
                    numbers.append(self._numbers(head, document))
                    if head[0] == "scenarios":
                        goals[which == j] = self._goals(document)
                except (ValidationError, BuildError):
                    numbers.append(None)
            wrong = np.array([x is None for x in numbers])[which]
            reasons |= dict.fromkeys(np.flatnonzero(wrong).tolist(), "")
            for name in columns.keys() & next((x.keys() for x in numbers if x is not None), ()):
                each = np.array([np.nan if x is None else x[name] for x in numbers])
                columns[name] = np.where(wrong, columns[name], each[which])
        for k in reasons:
            reasons[k] = self._reason(values[k])
            for name, column in columns.items():
                column[k] = self._parameters[name]
        q, v = self._close_joints(columns, goals)
        for k in np.flatnonzero(~np.isfinite(q).all(axis=1)).tolist():
            if k not in reasons:
                q[k], v[k] = self._alone(values[k], k, reasons)
        for k in reasons:
            q[k] = v[k] = np.nan
        return Starts(columns, q, v, reasons)

    def _reason(self, values: Sequence[float]) -> str:
        try:
            self.mechanism_of(values)
        except LinkageError as error:
            return describe(error)
        return "the numbers are no linkage's"

    def _alone(self, values: Sequence[float], k: int, reasons: dict[int, str]) -> tuple[Array, Array]:
        """Start of a sample by the patient way of the file."""
        none = np.full(self.nominal.n, np.nan)
        try:
            one = self.mechanism_of(values)
        except LinkageError as error:
            reasons[k] = describe(error)
            return none, none
        return one.q0, one.v0

    def _goals(self, document: Document) -> Array:
        """Targets and rates (2, h) of the coordinates that a start holds."""
        items = list_held_items(self.nominal, document["scenarios"][self.scenario])
        return np.array([[float(x) for _, x, _ in items], [float(x) for _, _, x in items]])

    def _close_joints(self, columns: Columns, goals: Array) -> tuple[Array, Array]:
        """States (k, n) on the constraints, at targets and rates (k, 2, h); not a number where Newton's method ends elsewhere."""
        k, mechanism = len(goals), self.nominal
        q, v = np.full((2, k, mechanism.n), np.nan)
        if mechanism.knife_edges or mechanism.parts:
            return q, v
        first = {name: np.full(k, self._parameters[name]) for name in columns}
        old = self._goals(self.document)
        lengths = [np.abs(columns[x] - first[x]).max(initial=0.0) for x in columns if x.startswith(("points.", "joints."))]
        turn = float(np.abs(goals[:, 0] - old[0]).max(initial=0.0))
        strides = min(100, 1 + int(max(max(lengths, default=0.0) / (STRIDE * mechanism.size), turn / STEP)))
        q = np.repeat(np.array(mechanism.q0)[None], k, axis=0)
        with np.errstate(all="ignore"):
            for part in np.arange(1, strides + 1) / strides:
                now = {name: columns[name] if part == 1 else first[name] + part * (columns[name] - first[name]) for name in columns}
                rows = _Closing(family_of(mechanism, now), self.document["scenarios"][self.scenario])
                target = goals[:, 0] if part == 1 else old[0] + part * (goals[:, 0] - old[0])
                q = rows.solve(q, target)
            phi, J = rows(q, goals[:, 0])
            right = np.concatenate([np.zeros((k, phi.shape[1] - goals.shape[2])), goals[:, 1]], axis=1)
            v = _solution(J, right)
            left = np.abs((J @ v[..., None])[..., 0] - right).max(axis=1, initial=0.0)
            good = (np.abs(phi).max(axis=1, initial=0.0) <= CLOSED) & (left <= CLOSED * np.maximum(1.0, np.abs(right).max(axis=1)))
        q[~good], v[~good] = np.nan, np.nan
        return q, v


class _Closing:
    """Residual and Jacobian of joints and held coordinates of a family at states (k, n)."""

    def __init__(self, mechanism: Mechanism, scenario: dict[str, Any]):
        world = Point(GROUND, np.zeros(2), "ground.")
        self.gaps: list[tuple[Coordinate, Coordinate]] = []
        self.held: list[tuple[Coordinate, Any]] = []
        for joint in mechanism.joints:
            if isinstance(joint, Revolute):
                self.gaps += [(Along(world, joint.a, 0.0, x), Along(world, joint.b, 0.0, x)) for x in (False, True)]
            else:
                self.held += joint.held
        self.items = [x for x, _, _ in list_held_items(mechanism, scenario)]

    def __call__(self, q: Array, target: Array) -> tuple[Array, Array]:
        rows: list[tuple[Array, Array]] = [(value(b, q) - value(a, q), gradient(b, q) - gradient(a, q)) for a, b in self.gaps]
        rows += [(value(x, q) - fixed, gradient(x, q)) for x, fixed in self.held]
        rows += [(value(x, q) - target[:, j], gradient(x, q)) for j, x in enumerate(self.items)]
        phi, J = zip(*rows, strict=True)
        return np.stack(np.broadcast_arrays(*phi), axis=-1), np.stack(J, axis=-2)

    def solve(self, q: Array, target: Array) -> Array:
        """States on the rows, from near ones."""

        def still(_: Array, size: Array) -> bool:
            return not (size[np.isfinite(size)] > 1e-14).any()

        return project(q, lambda x: self(x, target), _solution, NEWTON, still=still, longest=LONGEST)


def _solution(J: Array, right: Array) -> Array:
    """The shortest x (k, n) of J x = right, for J (k, m, n)."""
    if J.shape[1] == J.shape[2]:
        try:
            return np.asarray(np.linalg.solve(J, right[..., None])[..., 0])
        except np.linalg.LinAlgError:
            pass
    whole = np.isfinite(J).all(axis=(1, 2))
    x = np.full((len(J), J.shape[2]), np.nan)
    if whole.any():
        x[whole] = (np.linalg.pinv(J[whole], rcond=1e-9) @ right[whole][..., None])[..., 0]
    return x


def family_of(mechanism: Mechanism, columns: Columns) -> Mechanism:
    """The mechanism with arrays (k,) in the place of open numbers."""
    if not columns:
        return mechanism

    many = np.zeros(len(next(iter(columns.values()))))

    def at(name: str, usual: Any) -> Any:
        return columns.get(name, usual + many)

    def pair(name: str, xy: Array) -> Any:
        return np.stack([at(f"{name}.{axis}", x) for axis, x in zip("xy", xy, strict=True)])

    ground = {name: pair(f"points.ground.{name}", xy) for name, xy in mechanism.ground_points.items()}
    links = tuple(
        replace(
            link,
            mass=at(f"links.{link.name}.mass", link.mass),
            inertia=at(f"links.{link.name}.inertia", link.inertia),
            com=pair(f"links.{link.name}.com", link.com),
            points={name: pair(f"points.{link.name}.{name}", xy) for name, xy in link.points.items()},
        )
        for link in mechanism.links
    )

    def moved(point: Point) -> Point:
        name = point.name.partition(".")[2]
        if point.link == GROUND:
            return replace(point, local=ground[name]) if name in ground else point
        link = links[point.link]
        if name not in link.points:
            return point
        return replace(point, local=link.points[name] - link.com)

    def jointed(joint: Joint) -> Joint:
        if isinstance(joint, Prismatic):
            offset = at(f"joints.{joint.name}.offset", joint.offset)
            return replace(joint, guide=moved(joint.guide), block=moved(joint.block), offset=offset)
        return replace(joint, a=moved(joint.a), b=moved(joint.b))

    def acting(force: Force) -> Force:
        changes: dict[str, Any] = {}
        numbers = force_numbers(force)
        for field in fields(force):
            old = getattr(force, field.name)
            if isinstance(old, Point):
                changes[field.name] = moved(old)
            elif field.name == "pairs":
                changes[field.name] = tuple(map(jointed, old))
            elif field.name in numbers:
                name = f"forces.{force.name}.{field.name}"
                changes[field.name] = at(name, old) if np.ndim(old) == 0 else pair(name, old)
        return replace(force, **changes)

    def coordinate(x: Coordinate) -> Coordinate:
        changes: dict[str, Any] = {f.name: moved(getattr(x, f.name)) for f in fields(x) if isinstance(getattr(x, f.name), Point)}
        return replace(x, **changes)

    joints = tuple(map(jointed, mechanism.joints))
    by_name = {j.name: j for j in joints}

    def driven(driver: Any) -> Any:
        changes = {f.name: moved(getattr(driver, f.name)) for f in fields(driver) if isinstance(getattr(driver, f.name), Point)}
        return replace(driver, **changes, **({"joint": by_name[driver.joint.name]} if hasattr(driver, "joint") else {}))

    return replace(
        mechanism,
        links=links,
        ground_points=ground,
        joints=joints,
        forces=tuple(map(acting, mechanism.forces)),
        drivers=tuple(map(driven, mechanism.drivers)),
        gravity=pair("gravity", mechanism.gravity),
        observed_points=tuple(map(moved, mechanism.observed_points)),
        measured=replace(mechanism.measured, coordinate=coordinate(mechanism.measured.coordinate)),
    )


def force_numbers_of(mechanism: Mechanism, name: str) -> set[str]:
    """Keys of a force of the file that are numbers of its own."""
    force = next((f for f in mechanism.forces if f.name == name), None)
    return set(force_numbers(force)) if force else set()


def _places(prefix: str, points: Mapping[str, Array]) -> dict[str, float]:
    return {f"{prefix}.{name}.{axis}": float(x) for name, xy in points.items() for axis, x in zip("xy", xy, strict=True)}


def describe(error: LinkageError) -> str:
    """The faults of a sample in one sentence."""
    return "; ".join(f"{x.path}: {x.text}" if x.path else x.text for x in error.faults)
