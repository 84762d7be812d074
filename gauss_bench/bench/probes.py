"""Linkages on which an engine's accelerations are held against own terms: as they are, and with their numbers changed.

An engine that leaves out, scales or hard-codes a number is wrong wherever that number shows in the accelerations, and every number
of `suites/linkages/probe.toml` does. Engine and own terms are given the same changed linkage.

With N (n, dof) a basis of the velocities that the constraints allow, accelerations a of whatever constraint forces obey

    N^T (M a - Q) = 0

because those forces do no work along N: a loop that gives way leaves this alone, a wrong mass, force or row of J does not.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from gauss_bench.engines.tree import spanning_tree
from gauss_bench.linkage.load import document_of, load_document
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.suites.read import FOLDER
from gauss_bench.terms import Array

PROBE = str(FOLDER / "linkages" / "probe.toml")
STATES, SEED = 8, 20261123
REACH, SLOW, FAST = 0.4, 2.0, 6.0  # steps [m, rad] between states; least and largest velocities [m/s, rad/s] along free directions
FLOOR = 0.05  # of the largest among the states: errors at states near equilibrium are relative to this share
RESTING = 1e-9  # of the largest constraint force: a smaller one is rounding, and nothing holds its row
AS_IT_IS, EVERYTHING = "as it is", "every number changed"
FACTORS = {  # kind -> its plural, and what its numbers are multiplied by
    "mass": ("masses", 1.3),
    "inertia": ("inertias", 1.4),
    "length": ("lengths", 1.04),
    "angle": ("angles", 1.1),
    "gravity": ("gravity", 1.2),
    "force": ("forces", 1.3),
}

Path = tuple[str | int, ...]


@dataclass(frozen=True, eq=False)
class Probe:
    """A linkage at states of motion.

    Attributes:
        change: what is changed in it.
        t, q, v, a: (k,) and (k, n): states on the constraints, with the accelerations of own terms.
    """

    change: str
    mechanism: Mechanism
    t: Array
    q: Array
    v: Array
    a: Array

    def off(self, a: Array) -> float:
        """Return the largest error of accelerations (k, n), relative to the largest acceleration of the state."""
        return _share(np.abs(a - self.a).max(axis=1), np.abs(self.a).max(axis=1))

    def off_along(self, a: Array) -> float:
        """Return the largest N^T (M a - Q) of accelerations (k, n), relative to N^T Q; 0 without degrees of freedom."""
        motion = AbsoluteCoordinates(self.mechanism)
        left, loads = [], []
        for t, q, v, given in zip(self.t, self.q, self.v, a, strict=True):
            N = motion.null_space(q)  # (n, dof)
            terms = motion.evaluator.terms(float(t), q, v)
            left.append(np.abs(N.T @ (terms.M @ given - terms.Q)).max(initial=0.0))
            loads.append(np.abs(N.T @ terms.Q).max(initial=0.0))
        return _share(np.array(left), np.array(loads))

    def share_of_gamma(self, a: Array) -> float:
        """Return the smallest share c of its velocity term that a row of J has in accelerations a (k, n), by least squares.

        With f the constraint forces that the accelerations need, J a = gamma + (c - 1) g + r f over the states. A row that gives
        way in proportion to its force has c = 1; c is 0 for a row without its velocity term g. That term depends on the coordinates
        of an engine: g is gamma in absolute coordinates, and gamma - J a0 in those of a joint tree, where a0 are the accelerations
        with which the tree moves if its coordinates keep their rates. Of these, the one that explains the row best is taken. Rows
        without velocity terms are left out, those without forces (of springs, where loops are closed), and linkages with redundant
        rows, whose forces are not determined; the result is then 1.
        """
        if self.mechanism.redundant:
            return 1.0
        evaluator, trees = AbsoluteCoordinates(self.mechanism).evaluator, [spanning_tree(self.mechanism, x) for x in (False, True)]
        found = []
        for t, q, v, given in zip(self.t, self.q, self.v, a, strict=True):
            terms = evaluator.terms(float(t), q, v)
            force = np.linalg.lstsq(terms.J.T, terms.M @ given - terms.Q, rcond=None)[0]
            states = [tree.relative(q, v) for tree in trees]
            moved = [tree.absolute(*y, 0.0 * y[0])[2] for tree, y in zip(trees, states, strict=True)]
            velocity = [terms.gamma, *(terms.gamma - terms.J @ a0 for a0 in moved)]
            found.append((terms.J @ given - terms.gamma, force, velocity))
        beside, forces, velocities = (np.array(x) for x in zip(*found, strict=True))  # (k, m), (k, m), (k, 3, m)
        largest = np.abs(velocities[:, 0]).max(initial=0.0)
        shares, strong = [], np.abs(forces).max(axis=0) > RESTING * np.abs(forces).max(initial=0.0)
        for row in np.flatnonzero(strong):
            terms_of_row = [g for g in velocities[:, :, row].T if np.abs(g).max() > FLOOR * largest]
            fits = [_fit(beside[:, row], np.column_stack([g, forces[:, row]])) for g in terms_of_row]
            if fits:
                shares.append(1.0 + min(fits)[1])
        return float(min(shares, default=1.0))


def _fit(x: Array, columns: Array) -> tuple[float, float]:
    """Return what least squares leave of x (k,) by columns (k, 2), rounded, and the factor of the first column."""
    factors = np.linalg.lstsq(columns, x, rcond=None)[0]
    return round(float(np.abs(x - columns @ factors).max()), 12), float(factors[0])


def _share(errors: Array, sizes: Array) -> float:
    """Return the largest error (k,) relative to its size (k,); infinite where an error is NaN."""
    floored = np.maximum(sizes, FLOOR * sizes.max(initial=0.0))
    share = np.divide(errors, floored, out=np.zeros_like(errors), where=floored > 0)
    return float(share.max(initial=0.0)) if np.isfinite(errors).all() else float("inf")


@lru_cache(maxsize=256)
def probe(linkage: str, scenario: str, change: str = AS_IT_IS, forces: tuple[str, ...] | None = None) -> Probe:
    """Return a linkage with one of `changes` made, at states of its motion; with only the given forces, if any are given."""
    document, digest, path = document_of(linkage)
    changed = scale(document, changes(linkage, scenario)[change])
    if forces is not None:
        changed["scenarios"][scenario]["forces"] = list(forces)
    mechanism = load_document(changed, scenario, f"{path} ({change})", f"{digest} {change} {forces}", path.stem)
    motion = AbsoluteCoordinates(mechanism)
    t, q, v = moving_states(mechanism, motion)
    return Probe(change, mechanism, t, q, v, motion.acceleration(t, q, v))


def moving_states(mechanism: Mechanism, motion: AbsoluteCoordinates) -> tuple[Array, Array, Array]:
    """Return states t (k,), q, v (k, n) on the constraints, by steps of random size from the start; drivers use the times."""
    random = np.random.default_rng(SEED)
    times = np.linspace(0.05, 0.95, STATES) * (mechanism.duration if mechanism.drivers else 0.0)
    q, states = mechanism.q0, []
    for t in times:
        N = motion.null_space(q)  # (n, dof)
        for _ in range(2):  # the second projection starts near and removes the error that the first leaves
            q, _ = motion.evaluator.project(t, q + N @ random.normal(0.0, REACH, N.shape[1]), 0.0 * q)
            N = 0.0 * N
        N = motion.null_space(q)
        states.append(
            motion.evaluator.project(t, q, N @ (random.choice([-1.0, 1.0], N.shape[1]) * random.uniform(SLOW, FAST, N.shape[1])))
        )
    return times, np.array([x[0] for x in states]), np.array([x[1] for x in states])


@lru_cache(maxsize=8)
def changes(linkage: str, scenario: str) -> Mapping[str, Mapping[Path, float]]:
    """Return name of a change -> path of a number -> its factor: no number, all, those of one kind, and each alone."""
    document, _, _ = document_of(linkage)
    every = [(path, *FACTORS[_kind(path)]) for path in numbers(document, scenario)]
    found: dict[str, dict[Path, float]] = {AS_IT_IS: {}, EVERYTHING: {path: factor for path, _, factor in every}}
    for path, plural, factor in every:
        found.setdefault(f"all {plural} x {factor:g}", {})[path] = factor
    for path, _, factor in every:
        name = "".join(f"[{x}]" if isinstance(x, int) else f".{x}" for x in path).lstrip(".")
        found[f"{name} x {factor:g}"] = {path: factor}
    return found


def numbers(document: dict[str, Any], scenario: str) -> Iterator[Path]:
    """Yield the paths of all numbers but 0 that a scenario's motion depends on, except its start and its laws."""
    for key in ("gravity", "ground", "links", "joints"):
        yield from _numbers(document.get(key), (key,))
    for name in document["scenarios"][scenario].get("forces", ()):
        yield from _numbers(document["forces"][name], ("forces", name))


def _numbers(item: Any, path: Path) -> Iterator[Path]:
    if isinstance(item, (dict, list)):
        for key, value in item.items() if isinstance(item, dict) else enumerate(item):
            yield from _numbers(value, (*path, key))
    elif isinstance(item, (int, float)) and item:
        yield path


def _kind(path: Path) -> str:
    """Return the kind of the number at a path: a key of FACTORS."""
    words = [x for x in path if isinstance(x, str)]
    if words[0] in ("gravity", "forces"):
        return words[0].removesuffix("s")
    return {"mass": "mass", "kg_per_m": "mass", "inertia": "inertia", "angle_deg": "angle"}.get(words[-1], "length")


def scale(item: Any, factors: Mapping[Path, float], path: Path = ()) -> Any:
    """Return a copy of a part of a document in which the numbers at some paths are multiplied by their factors."""
    if isinstance(item, dict):
        return {key: scale(x, factors, (*path, key)) for key, x in item.items()}
    if isinstance(item, list):
        return [scale(x, factors, (*path, k)) for k, x in enumerate(item)]
    return item * factors[path] if path in factors else item
