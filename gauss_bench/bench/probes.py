"""Linkages on which an engine's accelerations are compared with the suite's own: unchanged, and with changed numbers.

A probe is such a linkage at some states of motion. Every number of `suites/linkages/probe.toml` affects the accelerations, so that
an engine that leaves out, scales or hard-codes one of them has wrong accelerations where that number is changed.

Let the columns of N (n, dof) be a basis of the velocities that the constraints allow: J N = 0. Constraint forces do no work in
these motions. The accelerations a therefore obey, even if the constraint forces are too weak to keep a loop closed,

    N^T (M a - Q) = 0

unless a mass, a force or a row of J is wrong.
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
STATES, SEED = 8, 20261123  # number of states of a probe, and the seed of their random numbers
# [m, rad] standard deviation of the steps between states; [m/s, rad/s] least and largest velocities along free directions
REACH, SLOW, FAST = 0.4, 2.0, 6.0
FLOOR = 0.05  # errors near equilibrium are relative to this fraction of the largest value among the states
RESTING = 1e-9  # rows whose constraint force is below this fraction of the largest one, and thus a rounding error, are left out
AS_IT_IS, EVERYTHING = "as it is", "every number changed"
FACTORS = {  # kind of a number -> plural, and factor by which numbers of this kind are changed
    "mass": ("masses", 1.3),
    "inertia": ("inertias", 1.4),
    "length": ("lengths", 1.04),
    "angle": ("angles", 1.1),
    "gravity": ("gravity", 1.2),
    "force": ("forces", 1.3),
}

Path = tuple[str | int, ...]  # keys and indices that lead to a number of a document


@dataclass(frozen=True, eq=False)
class Probe:
    """A linkage at states of motion.

    Attributes:
        change: name of the change of its numbers.
        mechanism: the changed linkage.
        t: (k,) times of the states [s].
        q, v, a: (k, n) states that satisfy the constraints, and their accelerations from the suite's own equations of motion.
    """

    change: str
    mechanism: Mechanism
    t: Array
    q: Array
    v: Array
    a: Array

    def error(self, a: Array) -> float:
        """Return the largest error of accelerations (k, n), relative to the largest acceleration of the state."""
        return _share(np.abs(a - self.a).max(axis=1), np.abs(self.a).max(axis=1))

    def residual_along_free(self, a: Array) -> float:
        """Return the largest component of N^T (M a - Q) for accelerations (k, n), relative to that of N^T Q.

        The columns of N are a basis of the velocities that the constraints allow; the result is 0 without degrees of freedom.
        """
        motion = AbsoluteCoordinates(self.mechanism)
        residuals, loads = [], []  # of each state: the largest component of the residual, and of N^T Q
        for t, q, v, given in zip(self.t, self.q, self.v, a, strict=True):
            N = motion.null_space(q)  # (n, dof)
            terms = motion.evaluator.terms(float(t), q, v)
            residuals.append(np.abs(N.T @ (terms.M @ given - terms.Q)).max(initial=0.0))
            loads.append(np.abs(N.T @ terms.Q).max(initial=0.0))
        return _share(np.array(residuals), np.array(loads))

    def share_of_gamma(self, a: Array) -> float:
        """Estimate the share of the velocity term that an engine used in each row of J a; return the smallest share.

        Exact accelerations (k, n) obey J a = gamma, where gamma = -dJ/dt v (plus drivers' terms) depends on velocities. An engine
        that leaves out the velocity term g of its constraints has J a = gamma - g. In absolute coordinates such an engine has
        J a = 0, and g is gamma. In the joint coordinates of a spanning tree it has J a = J a0, where a0 are the accelerations of
        the links if all joint accelerations of the tree are 0; g is gamma - J a0. To find the share c of g that an engine used,
        each row of J a, as a function of the k states, is fitted by least squares:

            J a = gamma + (c - 1) g + r f

        Here f is the constraint force that the accelerations need, and r is a compliance: if the row's constraint is a spring, J a
        differs from gamma in proportion to f, and c is 1. For each row, the candidate for g with the smallest residual is taken.

        Rows without a velocity term or without a force are left out. The share is 1 if no row remains, or with redundant rows,
        because their forces are not determined.
        """
        if self.mechanism.redundant:
            return 1.0
        # engines open each loop at different joints: both kinds of spanning tree are tried
        evaluator, trees = AbsoluteCoordinates(self.mechanism).evaluator, [spanning_tree(self.mechanism, x) for x in (False, True)]
        extra, forces, velocities = [], [], []  # at each state: J a - gamma and f, (m,), and the three candidates of g, (3, m)
        for t, q, v, given in zip(self.t, self.q, self.v, a, strict=True):
            terms = evaluator.terms(float(t), q, v)
            terms_of_velocity = [terms.gamma]
            for tree in trees:
                y, dy = tree.relative(q, v)
                _, _, a0 = tree.absolute(y, dy, 0.0 * y)
                terms_of_velocity.append(terms.gamma - terms.J @ a0)
            extra.append(terms.J @ given - terms.gamma)
            forces.append(np.linalg.lstsq(terms.J.T, terms.M @ given - terms.Q, rcond=None)[0])
            velocities.append(terms_of_velocity)
        return _least_share(np.array(extra), np.array(forces), np.array(velocities))


def _least_share(extra: Array, forces: Array, velocities: Array) -> float:
    """Return the smallest share c of the velocity term in a row of J a, by the fit of `share_of_gamma`; 1 if no row can be judged.

    Args:
        extra, forces: J a - gamma and the constraint forces f, (k, m) each, for m constraint rows at k states.
        velocities: three candidates of the velocity term g, (k, 3, m); the first is gamma.
    """
    largest = np.abs(velocities[:, 0]).max(initial=0.0)
    has_force = np.abs(forces).max(axis=0) > RESTING * np.abs(forces).max(initial=0.0)  # (m,)
    shares = []
    for row in np.flatnonzero(has_force):
        fits = []  # (largest residual, c - 1) of each candidate
        for g in velocities[:, :, row].T:
            if np.abs(g).max() > FLOOR * largest:
                columns = np.column_stack([g, forces[:, row]])
                solution = np.linalg.lstsq(columns, extra[:, row], rcond=None)[0]  # c - 1 and r
                residual = float(np.abs(extra[:, row] - columns @ solution).max())
                # rounded, so that of residuals that are equal up to rounding the one with the least c is taken
                fits.append((round(residual, 12), float(solution[0])))
        if fits:
            _, c_minus_1 = min(fits)
            shares.append(1.0 + c_minus_1)
    return float(min(shares, default=1.0))


def _share(errors: Array, sizes: Array) -> float:
    """Return max(errors / sizes) over k states, where sizes below FLOOR * max(sizes) are replaced by this bound.

    The result is infinite if an error is NaN. If all sizes are 0, the result is the largest error itself: rounding errors then meet
    a limit for the share, and wrong terms do not.
    """
    floored = np.maximum(sizes, FLOOR * sizes.max(initial=0.0)) if sizes.any() else np.ones_like(sizes)
    return float((errors / floored).max(initial=0.0)) if np.isfinite(errors).all() else float("inf")


@lru_cache(maxsize=256)
def probe(linkage: str, scenario: str, change: str = AS_IT_IS, forces: tuple[str, ...] | None = None) -> Probe:
    """Return a linkage with one of the `changes`, at random states, and the exact accelerations there.

    `forces` names the forces that act; by default all forces of the scenario.
    """
    document, digest, path = document_of(linkage)
    changed = scale(document, changes(linkage, scenario)[change])
    if forces is not None:
        changed["scenarios"][scenario]["forces"] = list(forces)
    mechanism = load_document(changed, scenario, f"{path} ({change})", f"{digest} {change} {forces}", path.stem)
    motion = AbsoluteCoordinates(mechanism)
    t, q, v = moving_states(mechanism, motion)
    return Probe(change, mechanism, t, q, v, motion.acceleration(t, q, v))


def moving_states(mechanism: Mechanism, motion: AbsoluteCoordinates) -> tuple[Array, Array, Array]:
    """Return states t (k,), q, v (k, n) on the constraints, by random steps from the start.

    The times are those of the drivers' laws; without drivers they are 0.
    """
    random = np.random.default_rng(SEED)
    times = np.linspace(0.05, 0.95, STATES) * (mechanism.duration if mechanism.drivers else 0.0)
    q, states = mechanism.q0, []
    for t in times:
        N = motion.null_space(q)  # (n, dof)
        q, _ = motion.evaluator.project(t, q + N @ random.normal(0.0, REACH, N.shape[1]), 0.0 * q)
        q, _ = motion.evaluator.project(t, q, 0.0 * q)  # removes the error that a projection from far away leaves
        N = motion.null_space(q)
        speeds = random.choice([-1.0, 1.0], N.shape[1]) * random.uniform(SLOW, FAST, N.shape[1])  # (dof,)
        states.append(motion.evaluator.project(t, q, N @ speeds))
    positions, velocities = zip(*states, strict=True)
    return times, np.array(positions), np.array(velocities)


@lru_cache(maxsize=8)
def changes(linkage: str, scenario: str) -> Mapping[str, Mapping[Path, float]]:
    """Return the changes of a linkage by name, each as a map: path of a number -> factor by which it is multiplied.

    The first one changes nothing, the second one all numbers. Then follow one change for each kind, of all numbers of this kind
    (such as masses), and one change for each single number.
    """
    document, _, _ = document_of(linkage)
    factors = [(path, *FACTORS[_kind(path)]) for path in numbers(document, scenario)]  # (path, plural of its kind, factor)
    named: dict[str, dict[Path, float]] = {AS_IT_IS: {}, EVERYTHING: {path: factor for path, _, factor in factors}}
    for path, plural, factor in factors:
        named.setdefault(f"all {plural} x {factor:g}", {})[path] = factor
    for path, _, factor in factors:
        number = "".join(f"[{x}]" if isinstance(x, int) else f".{x}" for x in path).lstrip(".")  # such as links.crank.mass
        named[f"{number} x {factor:g}"] = {path: factor}
    return named


def numbers(document: dict[str, Any], scenario: str) -> Iterator[Path]:
    """Yield the paths of all nonzero numbers in a linkage file on which the equations of motion of a scenario depend.

    The numbers that define the scenario's start and its motion laws are not among them.
    """
    for key in ("gravity", "ground", "links", "joints"):
        yield from _numbers(document.get(key), (key,))
    for name in document["scenarios"][scenario].get("forces", ()):
        yield from _numbers(document["forces"][name], ("forces", name))


def _numbers(item: Any, path: Path) -> Iterator[Path]:
    """Yield the paths of all numbers other than 0 in the part of a document at `path`; booleans do not count."""
    if isinstance(item, (dict, list)):
        for key, value in item.items() if isinstance(item, dict) else enumerate(item):
            yield from _numbers(value, (*path, key))
    elif isinstance(item, (int, float)) and not isinstance(item, bool) and item:
        yield path


def _kind(path: Path) -> str:
    """Return the kind of the number at a path: a key of FACTORS."""
    words = [x for x in path if isinstance(x, str)]
    if words[0] in ("gravity", "forces"):
        return words[0].removesuffix("s")
    return {"mass": "mass", "kg_per_m": "mass", "inertia": "inertia", "angle_deg": "angle"}.get(words[-1], "length")


def scale(item: Any, factors: Mapping[Path, float], path: Path = ()) -> Any:
    """Return a copy of the part of a document at `path`, in which the numbers at some paths are multiplied by factors."""
    if isinstance(item, dict):
        return {key: scale(x, factors, (*path, key)) for key, x in item.items()}
    if isinstance(item, list):
        return [scale(x, factors, (*path, k)) for k, x in enumerate(item)]
    return item * factors[path] if path in factors else item
