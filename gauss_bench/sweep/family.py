"""Linkages of one structure with different numbers: find the inputs of their kernel, and the start of each sample.

A kernel is a compiled program for one linkage. Most numbers of the linkage are constants of the kernel; those that remain open are
its inputs. A sample is one choice of values for the varied numbers, the numbers of the file that the sweep varies. The varied
numbers determine the values of the kernel's inputs. Many linkages are evaluated at once: in one mechanism each input becomes an
array (batch,) (`with_parameters`).

The start of a sample is its initial state q, v. It is found by continuation from the assembled initial state of the linkage in the
file. The kernel's inputs, and the coordinates that the scenario's start and drivers prescribe at t = 0, change in small steps from
their values in the file to those of the sample, and Newton's method closes the joints after each step. A sample whose joints do not
close in this way is read and assembled on its own; if that fails too, the sample's message has the reason.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from gauss_bench.compiler.equations.links import force_numbers, parameter_values, split_vectors, with_parameters
from gauss_bench.linkage.build import Resolver, build_link, resolve_points
from gauss_bench.linkage.closure import CLOSED, LONGEST, STEP, list_held
from gauss_bench.linkage.errors import BuildError, LinkageError
from gauss_bench.linkage.load import load_document
from gauss_bench.linkage.schema import LinkageTable
from gauss_bench.mechanism.close import project
from gauss_bench.mechanism.coordinates import Placed, state
from gauss_bench.mechanism.coordinates import columns as columns_of_gradient
from gauss_bench.mechanism.model import Coordinate, Mechanism
from gauss_bench.sweep.paths import Document, change, number_at
from gauss_bench.terms import Array

STRIDE = 0.02  # largest change of a dimension between two closures, relative to the linkage's size
NEWTON = 12  # largest number of iterations of a closure, which usually needs three or four
WHOLE = ("gravity", "ground")  # keys of the file that are read as a whole, and not entry by entry
OPEN = ("links", "ground", "gravity", "forces", "joints", "scenarios")  # keys with numbers that can be inputs of a kernel
BAD = (BuildError, ValidationError)  # errors of a table whose numbers are not valid
Columns = Mapping[str, Array]  # name of an input of the kernel -> its values (k,)


@dataclass(frozen=True, eq=False)
class Starts:
    """Initial states of k samples, and the values of the kernel's inputs in these samples.

    Attributes:
        columns: name of an input of the kernel -> its values (k,).
        q, v: (k, n) initial states; NaN for a sample that cannot be assembled.
        reasons: index of a sample that cannot be assembled -> the reason.
    """

    columns: Columns
    q: Array
    v: Array
    reasons: Mapping[int, str]


class Family:
    """One linkage in one scenario, some of whose numbers vary.

    Attributes:
        document: linkage document with this scenario alone, whose overrides are merged into it.
        nominal: the mechanism with the numbers of the file.
        paths: paths of the d varied numbers in the document, as in `paths.py`.
        source: path of the file.
        heads: keys of a table that contains varied numbers, such as ("links", "rod") or ("gravity",) -> indices in `paths` of the
            varied numbers in this table. Such a table is read anew for each sample.
    """

    def __init__(self, document: Document, scenario: str, paths: Sequence[str], source: str):
        """Load the mechanism of the file, and group the varied numbers by tables.

        Raises:
            LinkageError: the file is faulty.
        """
        self.document, self.scenario, self.paths, self.source = document, scenario, tuple(paths), source
        self.nominal = load_document(document, scenario, source)
        self.heads = dict[tuple[str, ...], list[int]]()
        for k, path in enumerate(paths):
            head, *rest = path.split(".")
            table = (head,) if head in WHOLE else (head, *rest[:1])
            self.heads.setdefault(table, []).append(k)

    @cached_property
    def not_open(self) -> str:
        """The reason why a varied number cannot be an input of a kernel; empty if all varied numbers can."""
        numbers = {f.name: force_numbers(f).keys() for f in self.nominal.forces}  # force -> keys that can be inputs
        for path in self.paths:
            head, *rest = path.split(".")
            is_open = head in OPEN
            match head:
                case "joints":
                    is_open = rest[-1] == "offset"
                case "scenarios":
                    is_open = rest[1:2] == ["start"]
                case "forces":
                    is_open = rest[1].removesuffix("_deg") in numbers.get(rest[0], ())
            if not is_open:
                return f"{path} cannot be an input of a kernel"
            # the numbers of welded links are merged into those of one body, and are not inputs themselves
            if head in ("links", "ground") and ("welds" in self.document or "cylinders" in self.document):
                return f"{path} may be part of a welded body"
        return ""

    def mechanism_of(self, values: Sequence[float]) -> Mechanism:
        """Return the assembled linkage with the values (d,) of the varied numbers in one sample.

        Raises:
            LinkageError: the linkage with these numbers is not valid, or it cannot be assembled.
        """
        changed = change(self.document, dict(zip(self.paths, map(float, values), strict=True)))
        return load_document(changed, self.scenario, self.source)

    @cached_property
    def _forms(self) -> dict[str, TypeAdapter[Any]]:
        """Top-level key of the file, such as "links" -> pydantic type that checks its value; only keys with varied numbers."""
        return {head: TypeAdapter(LinkageTable.model_fields[head].rebuild_annotation()) for head, *_ in self.heads}

    @cached_property
    def _resolver(self) -> Resolver:
        """The reader of force tables."""
        return Resolver(self.document)

    @cached_property
    def _parameters(self) -> dict[str, float]:
        """Name of a number in kernels -> its value in the linkage of the file."""
        return parameter_values(self.nominal)

    @cached_property
    def open_numbers(self) -> tuple[str, ...]:
        """The names of the kernel's inputs: all numbers of the mechanism that depend on at least one of the varied numbers.

        These numbers are found by two trials of each varied number: a change by 1 % and by 30 %, or from zero to 0.01 and to 0.3.
        A single changed value could be invalid, or leave a dependent number equal by chance.
        """
        changed = set[str]()
        for head, indices in self.heads.items():
            for path, factor in product([self.paths[k] for k in indices], (1.01, 1.3)):
                old = number_at(self.document, path)
                new = old * factor if old else factor - 1.0
                try:
                    numbers = self._numbers(head, change(self.document, {path: new}))
                except BAD:  # the linkage is not valid with this value
                    continue
                changed |= {name for name, x in numbers.items() if x != self._parameters[name]}
        return tuple(name for name in self._parameters if name in changed)

    def _numbers(self, head: tuple[str, ...], document: Document) -> dict[str, float]:
        """Return name in kernels -> value, for all numbers that follow from one table of a document.

        `head` are the keys of the table, such as ("links", "rod"). A vector counts as two numbers, NAME.x and NAME.y.

        Raises:
            ValidationError, BuildError: the table is not valid in a linkage.
        """
        kind, *names = head
        table, name = document[kind], "".join(names)
        self._forms[kind].validate_python({name: table[name]} if names else table)
        numbers: dict[str, Any] = {}
        match kind:
            case "gravity":
                numbers = {"gravity": table}
            case "ground":
                numbers = {f"points.ground.{key}": xy for key, xy in resolve_points(table["points"]).items()}
            case "links":
                link = build_link(name, table[name])
                numbers = {f"links.{name}.{key}": getattr(link, key) for key in ("mass", "inertia", "com")}
                numbers |= {f"points.{name}.{key}": xy for key, xy in link.points.items()}
            case "joints":
                numbers = {f"joints.{name}.offset": table[name]["offset"]}
            case "forces" if any(f.name == name for f in self.nominal.forces):  # not for a force that this scenario lacks
                force: Any = self._resolver.build_force(name, table[name])
                numbers = {f"forces.{name}.{key}": x for key, x in force_numbers(force).items()}
        return split_vectors(numbers)

    def starts(self, values: Array) -> Starts:
        """Return the values of the kernel's inputs and the initial states of k samples.

        All joints are closed together; a sample whose joints do not close in this way is read and assembled individually.
        """
        columns, goals, is_faulty = self._read_samples(values)
        q, v = self._close_joints(columns, goals)
        q[is_faulty] = v[is_faulty] = np.nan
        reasons: dict[int, str] = {}
        # one by one: the loader takes longer and succeeds more often, and its error has the reason
        for k in np.flatnonzero(~np.isfinite(q).all(axis=1)).tolist():
            try:
                mechanism = self.mechanism_of(values[k])
            except LinkageError as error:
                reasons[k] = describe(error)
            else:
                q[k], v[k] = mechanism.q0, mechanism.v0
        return Starts(columns, q, v, reasons)

    def _read_samples(self, values: Array) -> tuple[dict[str, Array], Array, NDArray[np.bool_]]:
        """Return the numbers of k samples: columns of kernel inputs, goals (k, 2, h), and a mask (k,) of the faulty samples.

        The columns are a dictionary, name of an input of the kernel -> its values (k,). The goals are, for each sample, the values
        and the rates of the h coordinates that its scenario prescribes at t = 0 (`_goals`). A sample is faulty if its numbers make
        no valid linkage; its columns then have the numbers of the file.
        """
        goals = np.array([self._goals(self.document)] * len(values))
        columns = {name: np.full(len(values), self._parameters[name]) for name in self.open_numbers}
        is_faulty = np.zeros(len(values), dtype=bool)
        for head, indices in self.heads.items():
            # each content of a table is read only once, however many samples have it; a grid has few different contents
            contents, index_of_content = np.unique(values[:, indices], axis=0, return_inverse=True)
            for j, row in enumerate(contents.tolist()):
                document = change(self.document, dict(zip([self.paths[k] for k in indices], row, strict=True)))
                has_content = index_of_content.ravel() == j  # (k,) samples with this content
                try:
                    numbers = self._numbers(head, document)
                    if head[0] == "scenarios":
                        goals[has_content] = self._goals(document)
                except BAD:
                    is_faulty |= has_content
                    continue
                for name in columns.keys() & numbers.keys():
                    columns[name][has_content] = numbers[name]
        for name, column in columns.items():
            column[is_faulty] = self._parameters[name]
        return columns, goals, is_faulty

    def _goals(self, document: Document) -> Array:
        """Return values and rates (2, h) of the h coordinates that the start and the drivers in a document prescribe at t = 0."""
        held = list_held(self.nominal, document["scenarios"][self.scenario])
        return np.array([held.target, held.rate], dtype=float)

    def _close_joints(self, columns: Columns, goals: Array) -> tuple[Array, Array]:
        """Return states q, v (k, n) that satisfy the constraints and have the prescribed values and rates of coordinates.

        Samples for which Newton's method fails get NaN.

        Args:
            columns: name of an input of the kernel -> its values (k,).
            goals: (k, 2, h) values and rates of the h coordinates that the samples' initial states must have.
        """
        k, mechanism = len(goals), self.nominal
        q, v = np.full((2, k, mechanism.n), np.nan)
        if mechanism.knife_edges or mechanism.parts:  # not closed here: the caller assembles such samples one by one
            return q, v
        # the continuation begins at the kernel inputs and goals of the file, and ends at those of the samples
        file_columns, file_goals = {name: np.full(k, self._parameters[name]) for name in columns}, self._goals(self.document)
        # enough strides that dimensions and held coordinates change little from one closure to the next
        dimensions = [x for x in columns if x.startswith(("points.", "joints."))]
        lengths = [np.abs(columns[x] - file_columns[x]).max(initial=0.0) for x in dimensions]
        turn = float(np.abs(goals[:, 0] - file_goals[0]).max(initial=0.0))
        strides = min(100, 1 + int(max(max(lengths, default=0.0) / (STRIDE * mechanism.size), turn / STEP)))

        def constraints_at(fraction: float) -> Callable[[Array], tuple[Array, Array]]:
            """Return the function q (k, n) -> residual (k, m) and Jacobian (k, m, n) of joints and prescribed coordinates.

            The kernel's inputs and the prescribed values are interpolated between those of the file (fraction 0) and those of the
            samples (fraction 1), which are used directly, because interpolation would round them.
            """
            between = {x: file_columns[x] + fraction * (columns[x] - file_columns[x]) for x in columns}
            changed = with_parameters(mechanism, columns if fraction == 1 else between)
            target = goals[:, 0] if fraction == 1 else file_goals[0] + fraction * (goals[:, 0] - file_goals[0])
            held = list_held(changed, self.document["scenarios"][self.scenario]).coordinates
            return partial(_residual, [*held_by_joints(changed), *zip(held, target.T, strict=True)])

        q = np.repeat(np.array(mechanism.q0)[None], k, axis=0)
        with np.errstate(all="ignore"):
            for fraction in np.arange(1, strides + 1) / strides:
                q = project(q, constraints_at(fraction), _solve, NEWTON, stop_after=_is_still, longest=LONGEST)
            phi, J = constraints_at(1.0)(q)
            # J v (k, m): the coordinates of joints do not change, and held coordinates have their rates
            rates = np.concatenate([np.zeros((k, phi.shape[1] - goals.shape[2])), goals[:, 1]], axis=1)
            v = _solve(J, rates)
            rate_error = np.abs((J @ v[..., None])[..., 0] - rates).max(axis=1, initial=0.0)
            is_closed = np.abs(phi).max(axis=1, initial=0.0) <= CLOSED
            has_rates = rate_error <= CLOSED * np.maximum(1.0, np.abs(rates).max(axis=1))
        failed = ~(is_closed & has_rates)
        q[failed], v[failed] = np.nan, np.nan
        return q, v


def held_by_joints(mechanism: Mechanism) -> list[tuple[Coordinate, Any]]:
    """Return the coordinates that joints and couplings keep constant, each with its constant value."""
    return [pair for joint in (*mechanism.joints, *mechanism.couplings) for pair in joint.held]


def _residual(held: Sequence[tuple[Coordinate, Any]], q: Array) -> tuple[Array, Array]:
    """Return, at k states q (k, n), the m held coordinates minus their values (k, m), and the Jacobian (k, m, n).

    `held` has each coordinate with the value that it must have, a number or an array (k,).
    """
    at = Placed(q)
    states = [state(coordinate, at) for coordinate, _ in held]
    residuals = [x.value - value for x, (_, value) in zip(states, held, strict=True)]
    phi = np.stack(np.broadcast_arrays(*residuals), axis=-1)
    J = np.zeros((*phi.shape, q.shape[-1]))
    for row, x in enumerate(states):
        for column, entry in columns_of_gradient(x.entries).items():
            J[:, row, column] = entry
    return phi, J


def _is_still(_: Array, size: Array) -> bool:
    """Tell whether the last corrections, of sizes (k,), are rounding in all samples; a size that is not finite is a failure."""
    return not (size[np.isfinite(size)] > 1e-14).any()


def _solve(J: Array, right: Array) -> Array:
    """Return the x (k, n) of least norm with J x = right, for J (k, m, n) and right (k, m); NaN for a J that is not finite."""
    if J.shape[1] == J.shape[2]:
        try:
            return np.asarray(np.linalg.solve(J, right[..., None])[..., 0])
        except np.linalg.LinAlgError:  # one of the matrices is singular: take pseudo-inverses of all
            pass
    is_finite = np.isfinite(J).all(axis=(1, 2))
    x = np.full((len(J), J.shape[2]), np.nan)
    if is_finite.any():
        # singular values below 1e-9 times the largest belong to redundant rows
        x[is_finite] = (np.linalg.pinv(J[is_finite], rcond=1e-9) @ right[is_finite][..., None])[..., 0]
    return x


def describe(error: LinkageError) -> str:
    """Return the faults of a sample's linkage, separated by semicolons."""
    return "; ".join(map(str, error.faults))
