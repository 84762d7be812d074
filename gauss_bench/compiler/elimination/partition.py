"""Analysis of a linkage before elimination: its rank, its redundant rows, and the coordinates that may be independent.

An independent coordinate must move in every motion the constraints allow, at every position of the linkage: where it rests for a
moment, it does not determine the others. The null spaces of J at the samples decide this.

Which rows may be dropped (bases of the left null space of J) and which coordinates may be left independent (bases of the null
space) is one question: as many entries are wanted as a basis has columns, such that those rows of the basis are independent at all
samples. They are picked one after another, each time the entry that is largest where it is smallest, and what is picked is
projected out: a column-pivoted QR of the transposed bases, all at once.

Where the left null space turns with the linkage, as in a parallelogram with a third crank, whichever row is dropped the others are
singular somewhere on the way. There a combination w of two rows is dropped, which is the same question asked of more rows: those
kept span what is normal to w, and are independent wherever l w, l the left null space, is not zero. Dropped rows leave then, and
some of those kept take on a share of them.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product

import numpy as np

from gauss_bench.compiler.equations.sampling import DENSE, RANK_TOLERANCE, manifold_states, scales, shortest
from gauss_bench.compiler.errors import KernelError
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import SIZE, angle_slot
from gauss_bench.terms import Array
from gauss_bench.trajectory import States


def spread(bases: Array, count: int, allowed: Iterable[int], first: int | None = None) -> tuple[int, ...] | None:
    """`count` rows that are independent in every one of the bases (k, n, c), or None; `first` is the one to begin with."""
    if count == 0:
        return ()
    left, open_rows = bases.copy(), sorted(allowed)
    picked: list[int] = []
    largest = np.maximum(np.linalg.norm(bases, axis=2).max(axis=1, keepdims=True), np.finfo(float).tiny)
    for _ in range(count):
        sizes = np.linalg.norm(left, axis=2)
        worst = (sizes / largest).min(axis=0)
        worst[picked] = -1.0
        best = first if first is not None and not picked else max(open_rows, key=lambda k: float(worst[k]), default=None)
        if best is None or worst[best] < RANK_TOLERANCE:
            return None
        picked.append(best)
        direction = left[:, best, :] / sizes[:, best, None]
        left = left - (left @ direction[:, :, None]) * direction[:, None, :]
    return tuple(sorted(picked))


def smallest(bases: Array, rows: tuple[int, ...]) -> Array:
    """(k,) smallest singular value of some rows of each basis, relative to its largest row: 0 where they are dependent."""
    if not rows:
        return np.ones(len(bases))
    values = np.linalg.svd(bases[:, list(rows), :], compute_uv=False)[:, -1]
    return np.asarray(values / np.linalg.norm(bases, axis=2).max(axis=1))


SAMPLES = 48  # poses, a tenth of a radian apart: a pivot that touches zero between two of them is small at both
FEW = 8  # of a large linkage
SINGULAR = 0.02  # of the usual smallest singular value: nearer to a singular position no pivots are chosen
USABLE = 0.02  # of the fastest coordinate: an independent coordinate that moves less at a sample cannot serve there
ENOUGH, MOST = 5 * USABLE, 4  # where one choice is below, another is sought; choices
NEAR = 0.5  # of the best conditioned partition: what is between is left to the costs
RATIOS = (1.0, -1.0, 0.5, -0.5, 2.0, -2.0)  # of two rows that are dropped together
CANDIDATES = 6  # partitions that are tried; along a chain, where the middle is best, they are spread evenly


@dataclass(frozen=True)
class Drop:
    """A choice of redundant rows: those left out, and (kept row, dropped row, factor) of those combined into kept rows."""

    rows: tuple[int, ...]
    shares: tuple[tuple[int, int, float], ...] = ()

    def directions(self, count: int) -> Array:
        """(dropped, count) unit vectors of what is dropped among so many rows: normal to all that is kept."""
        W = np.zeros((len(self.rows), count))
        W[range(len(self.rows)), list(self.rows)] = 1.0
        for kept, dropped, factor in self.shares:
            W[self.rows.index(dropped), kept] = -factor
        return np.asarray(W / np.linalg.norm(W, axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class Study:
    """Results of the analysis of a linkage before elimination.

    Attributes:
        states: samples on the constraints at which J has its full rank.
        drops: choices of redundant rows, the best first. If no choice, with combinations, is regular at every position, another
            one is used where the first is singular.
        free: degrees of freedom of the velocities.
        left: (k, m, redundant) left null space of J at each sample.
        bases: (k, n, free) null space of J in scaled coordinates at each sample.
    """

    mechanism: Mechanism
    states: States
    drops: tuple[Drop, ...]
    free: int
    left: Array
    bases: Array

    def kept(self, choice: int) -> tuple[int, ...]:
        """Indices of the rows that are left under one of the choices."""
        return tuple(k for k in range(self.left.shape[1]) if k not in self.drops[choice].rows)

    def dropped(self, choice: int) -> tuple[str, ...]:
        """Return the names of the dropped rows."""
        names = row_names(self.mechanism)
        return tuple(names[k] for k in self.drops[choice].rows)

    def soundness(self, choice: int) -> Array:
        """Return (k,) the distance of the kept rows from linear dependence at each sample; 0 is singular."""
        return _soundness(self.left, self.drops[choice])


def row_names(mechanism: Mechanism) -> list[str]:
    """Names of all rows in the file's order."""
    parts = [(j.name, ("normal", "turn") if j.slides else ("x", "y")) for j in mechanism.joints]
    names = [f"{name}.{part}" for name, both in parts for part in both]
    names += [x.name for x in mechanism.couplings for _ in x.held]
    return names + [d.name for d in mechanism.drivers] + [e.name for e in mechanism.knife_edges]


@lru_cache(maxsize=32)  # a mechanism is asked about under several formulations, and once more for other partitions
def study(mechanism: Mechanism) -> Study:
    """Compute samples, redundant rows and null spaces of a mechanism.

    Raises:
        KernelError: rows are redundant that cannot be dropped, as two drivers that prescribe the same.
    """
    states = manifold_states(mechanism, SAMPLES if mechanism.n <= DENSE else FEW)
    scale, constraints = scales(mechanism), Constraints(mechanism)
    jacobians = [constraints(t, q, v).J * scale for t, q, v in zip(states.t, states.q, states.v, strict=True)]
    if mechanism.n > DENSE and mechanism.redundant == 0:
        free = mechanism.n - constraints.m
        bases = [_sparse_null_space(J, free) for J in jacobians]
        return Study(mechanism, states, (Drop(()),), free, np.zeros((len(states), constraints.m, 0)), np.array(bases))
    U, s, Vt = np.linalg.svd(np.array(jacobians))
    ranks = (s > RANK_TOLERANCE * s.max(axis=1, initial=0.0, keepdims=True)).sum(axis=1)
    rank = int(ranks.max())
    smallest_values = s[:, rank - 1] / s[:, 0] if rank else np.ones(len(s))
    regular = (ranks == rank) & (smallest_values > SINGULAR * np.median(smallest_values[ranks == rank]))
    left, null = U[regular][:, :, rank:], Vt[regular][:, rank:].transpose(0, 2, 1)
    allowed = range(constraints.joint_rows)
    first = spread(left, left.shape[2], allowed)
    if first is None:
        raise KernelError(f"{mechanism.name}: {left.shape[2]} constraint rows are redundant, and not only among the joints")
    drops = [Drop(rows) for rows in _covering(left, [first], allowed)]
    mixed = _mix(left, allowed) if len(drops) > 1 else None
    return Study(mechanism, states[regular], tuple([mixed] if mixed else drops), mechanism.n - rank, left, null)


def _soundness(left: Array, drop: Drop) -> Array:
    if not drop.rows:
        return np.ones(len(left))
    values = np.linalg.svd(drop.directions(left.shape[1]) @ left, compute_uv=False)[:, -1]
    return np.asarray(values / np.linalg.norm(left, axis=2).max(axis=1))


def _mix(left: Array, allowed: Iterable[int]) -> Drop | None:
    """Combinations of two rows of the left null spaces (k, m, redundant) to drop at all samples, or None."""
    m, redundant = left.shape[1:]
    pairs = [(i, j, x) for (i, j), x in product(combinations(allowed, 2), RATIOS)]
    W = np.zeros((len(pairs), m))
    for row, (i, j, x) in zip(W, pairs, strict=True):
        row[[i, j]] = np.array([1.0, x]) / np.hypot(1.0, x)
    chosen = spread(W @ left, redundant, range(len(pairs)))
    if chosen is None:
        return None
    dropped = W[list(chosen)]
    rows = spread(dropped.T[None], redundant, allowed)
    if rows is None:
        return None
    shares = -np.linalg.solve(dropped[:, list(rows)], dropped)
    taken = [(k, r, float(shares[i, k])) for k in allowed if k not in rows for i, r in enumerate(rows) if shares[i, k]]
    drop = Drop(rows, tuple(taken))
    return drop if (_soundness(left, drop) >= ENOUGH).all() else None


def _covering(bases: Array, chosen: list[tuple[int, ...]], allowed: Iterable[int]) -> list[tuple[int, ...]]:
    """Extend choices of rows of bases (k, n, c) until at every sample one of them is well conditioned."""
    open_samples, choices = np.ones(len(bases), bool), list(chosen)
    for rows in choices:
        open_samples &= smallest(bases, rows) < ENOUGH
    while open_samples.any() and len(choices) < MOST:
        at = int(np.flatnonzero(open_samples)[0])
        best = spread(bases[at : at + 1], bases.shape[2], allowed)
        if best is None or best in choices:
            break
        choices.append(best)
        open_samples &= smallest(bases, best) < ENOUGH
    return choices


def _sparse_null_space(J: Array, free: int) -> Array:
    """The null space of a large J of full row rank."""
    X = np.random.default_rng(0).normal(size=(J.shape[1], free))
    for _ in range(2):
        X = np.array([x - shortest(J, J @ x) for x in X.T]).reshape(free, -1).T
        X = np.linalg.qr(X)[0] if free else X
    return X


def candidates(study: Study) -> list[tuple[int, ...]]:
    """Return a few well conditioned partitions that are usable at every sample; () if drivers prescribe the whole motion.

    From many of them an even selection is taken, since along a chain the middle is best. The crank's angle, and angles alone, are
    always included; for a large linkage nothing else is tried.
    """
    if study.free == 0:
        return [()]
    mechanism, every = study.mechanism, range(study.mechanism.n)
    made = {spread(study.bases, study.free, every, first) for first in every}
    angles = spread(study.bases, study.free, every[angle_slot(0) :: SIZE])
    worst = {chosen: float(conditions(study, chosen).min()) for chosen in {*made, angles} if chosen is not None}
    best = max(worst.values(), default=0.0)
    near = sorted(chosen for chosen, x in worst.items() if x > max(USABLE, NEAR * best))
    natural = [] if mechanism.crank is None else [x for x in near if angle_slot(mechanism.crank) in x][:1]
    natural += [angles] if angles is not None and worst[angles] > USABLE else []
    if mechanism.n > DENSE and (natural or near):
        return natural[:1] or near[len(near) // 2 :][:1]
    even = [near[k] for k in np.unique(np.linspace(0, len(near) - 1, CANDIDATES).round().astype(int))] if near else []
    return list(dict.fromkeys(natural + even))


def conditions(study: Study, independent: tuple[int, ...]) -> Array:
    """Return (k,) how well conditioned the partition is at each sample: 0 where the velocities do not follow from it."""
    return smallest(study.bases, independent)


def covering(study: Study) -> list[tuple[int, ...]]:
    """Return partitions that together cover every sample; the first, with the crank's angle if possible, covers the most."""
    chosen = candidates(study)
    crank = None if study.mechanism.crank is None else angle_slot(study.mechanism.crank)
    chosen = sorted(chosen, key=lambda x: (crank not in x, -float(conditions(study, x).min())))[:1]
    return _covering(study.bases, chosen, range(study.mechanism.n))
