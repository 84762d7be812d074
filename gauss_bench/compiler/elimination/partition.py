"""Analysis of a linkage before elimination: its rank, its redundant rows, and the coordinates that may be independent.

An independent coordinate must move in every motion that the constraints allow, at every position of the linkage: where it rests for
a moment, it does not determine the others. The null spaces of J at the samples decide this.

Rows to drop are chosen by bases of the left null space of J, independent coordinates by bases of the null space, and both in the
same way (`spread`). As many rows of a basis are wanted as it has columns, and they must be independent at all samples. They are
chosen one after another: first the row whose smallest size over all samples is the largest; then all bases are projected onto what
is orthogonal to it. This is a column-pivoted QR of the transposed bases at all samples together.

The left null space may turn with the linkage, as in a parallelogram with a third crank: whichever row is dropped, the others are
singular somewhere on the way. Then a combination w of two rows is dropped. The kept combinations span what is normal to w, and are
independent wherever l w is not zero, l being the left null space. Each dropped row is added, with a factor, to some of the rows
that are kept.
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
    """Return the indices of `count` rows that are independent in each of the bases (k, n, c), or None if there are none.

    Only the rows in `allowed` are chosen; `first` is the first of them if it is given.
    """
    if count == 0:
        return ()
    left, open_rows = bases.copy(), sorted(allowed)
    picked: list[int] = []
    largest = np.maximum(np.linalg.norm(bases, axis=2).max(axis=1, keepdims=True), np.finfo(float).tiny)
    for _ in range(count):
        sizes = np.linalg.norm(left, axis=2)  # (k, n)
        worst = (sizes / largest).min(axis=0)  # (n,) smallest relative size of each row over all samples
        worst[picked] = -1.0
        best = max(open_rows, key=lambda k: float(worst[k]), default=None)
        if first is not None and not picked:
            best = first
        if best is None or worst[best] < RANK_TOLERANCE:
            return None
        picked.append(best)
        direction = left[:, best, :] / sizes[:, best, None]  # (k, c)
        left = left - (left @ direction[:, :, None]) * direction[:, None, :]
    return tuple(sorted(picked))


def smallest(bases: Array, rows: tuple[int, ...]) -> Array:
    """Return (k,) the smallest singular value of these rows of each basis (k, n, c), relative to the basis's largest row.

    It is 0 where the rows are dependent.
    """
    if not rows:
        return np.ones(len(bases))
    values = np.linalg.svd(bases[:, list(rows), :], compute_uv=False)[:, -1]
    return np.asarray(values / np.linalg.norm(bases, axis=2).max(axis=1))


SAMPLES = 48  # number of poses, a tenth of a radian apart: a pivot that touches zero between two of them is small at both
FEW = 8  # number of poses of a large linkage
SINGULAR = 0.02  # smallest singular value relative to its median: a pose with less is too near to a singular position
USABLE = 0.02  # least condition of a choice at a sample where it is used
ENOUGH = 5 * USABLE  # condition of a choice below which another choice is sought
MOST = 4  # number of choices at most
NEAR = 0.5  # condition relative to the best partition: among those above it the costs decide
RATIOS = (1.0, -1.0, 0.5, -0.5, 2.0, -2.0)  # factors of the second of two rows that are dropped together
CANDIDATES = 6  # number of partitions that are tried


@dataclass(frozen=True)
class Drop:
    """A choice of redundant rows to drop.

    Attributes:
        rows: the dropped rows.
        shares: (kept row, dropped row, factor), for every dropped row that is added to a kept row.
    """

    rows: tuple[int, ...]
    shares: tuple[tuple[int, int, float], ...] = ()

    def directions(self, count: int) -> Array:
        """Return, for each dropped row, the unit vector (count,) over all rows that is normal to every kept row with its shares."""
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
        drops: choices of redundant rows, the best first; there are several if none is regular at every sample.
        free: number of degrees of freedom of the velocities.
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
        """Return the indices of the rows that one of the choices keeps."""
        return tuple(k for k in range(self.left.shape[1]) if k not in self.drops[choice].rows)

    def dropped(self, choice: int) -> tuple[str, ...]:
        """Return the names of the rows that one of the choices drops."""
        names = row_names(self.mechanism)
        return tuple(names[k] for k in self.drops[choice].rows)

    def soundness(self, choice: int) -> Array:
        """Return (k,) the distance of the kept rows of a choice from linear dependence at each sample; 0 is singular."""
        return _soundness(self.left, self.drops[choice])


def row_names(mechanism: Mechanism) -> list[str]:
    """Return the names of all rows in the file's order."""
    parts = [(j.name, ("normal", "turn") if j.slides else ("x", "y")) for j in mechanism.joints]
    names = [f"{name}.{part}" for name, both in parts for part in both]
    names += [x.name for x in mechanism.couplings for _ in x.held]
    return names + [d.name for d in mechanism.drivers] + [e.name for e in mechanism.knife_edges]


@lru_cache(maxsize=32)  # a mechanism is compiled under several formulations, and needs its study again for further programs
def study(mechanism: Mechanism) -> Study:
    """Compute samples, redundant rows and null spaces of a mechanism.

    Raises:
        KernelError: rows are redundant that must not be dropped, as of two drivers of the same coordinate.
    """
    states = manifold_states(mechanism, SAMPLES if mechanism.n <= DENSE else FEW)
    scale, constraints = scales(mechanism), Constraints(mechanism)
    jacobians = [constraints(t, q, v).J * scale for t, q, v in zip(states.t, states.q, states.v, strict=True)]
    if mechanism.n > DENSE and mechanism.redundant == 0:
        free = mechanism.n - constraints.m
        bases = [_sparse_null_space(J, free) for J in jacobians]
        return Study(mechanism, states, (Drop(()),), free, np.zeros((len(states), constraints.m, 0)), np.array(bases))
    U, s, Vt = np.linalg.svd(np.array(jacobians))  # (k, m, m), (k, min(m, n)), (k, n, n)
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
    """Return (k,) the distance of the rows that a choice keeps from linear dependence, for left null spaces (k, m, redundant)."""
    if not drop.rows:
        return np.ones(len(left))
    values = np.linalg.svd(drop.directions(left.shape[1]) @ left, compute_uv=False)[:, -1]
    return np.asarray(values / np.linalg.norm(left, axis=2).max(axis=1))


def _mix(left: Array, allowed: Iterable[int]) -> Drop | None:
    """Return combinations of two rows to drop at all samples, or None, from left null spaces (k, m, redundant)."""
    m, redundant = left.shape[1:]
    pairs = [(i, j, ratio) for (i, j), ratio in product(combinations(allowed, 2), RATIOS)]
    W = np.zeros((len(pairs), m))  # unit vectors: row i and `ratio` times row j
    for row, (i, j, ratio) in zip(W, pairs, strict=True):
        row[[i, j]] = np.array([1.0, ratio]) / np.hypot(1.0, ratio)
    chosen = spread(W @ left, redundant, range(len(pairs)))
    if chosen is None:
        return None
    dropped = W[list(chosen)]
    rows = spread(dropped.T[None], redundant, allowed)
    if rows is None:
        return None
    factors = -np.linalg.solve(dropped[:, list(rows)], dropped)  # (redundant, m): of each dropped row in each kept one
    shares = []
    for k in (k for k in allowed if k not in rows):
        shares += [(k, r, float(x)) for r, x in zip(rows, factors[:, k], strict=True) if x]
    drop = Drop(rows, tuple(shares))
    return drop if (_soundness(left, drop) >= ENOUGH).all() else None


def _covering(bases: Array, chosen: list[tuple[int, ...]], allowed: Iterable[int]) -> list[tuple[int, ...]]:
    """Return choices of rows of bases (k, n, c), extended until at every sample one of them is well conditioned."""
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
    """Return a basis (n, free) of the null space of a large J (m, n) of full row rank."""
    X = np.random.default_rng(0).normal(size=(J.shape[1], free))
    for _ in range(2):
        X = np.array([x - shortest(J, J @ x) for x in X.T]).reshape(free, -1).T
        X = np.linalg.qr(X)[0] if free else X
    return X


def candidates(study: Study) -> list[tuple[int, ...]]:
    """Return a few well conditioned choices of independent coordinates that are usable at every sample.

    From many choices an even selection is taken, because along a chain the middle is best. A choice with the crank's angle, and one
    of angles alone, come first if they are usable; for a large linkage one choice is returned. If drivers prescribe the whole
    motion, the only choice is ().
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
    if angles is not None and worst[angles] > USABLE:
        natural.append(angles)
    if not near:
        return natural
    if mechanism.n > DENSE:
        return natural[:1] or [near[len(near) // 2]]
    even = [near[k] for k in np.unique(np.linspace(0, len(near) - 1, CANDIDATES).round().astype(int))]
    return list(dict.fromkeys(natural + even))


def conditions(study: Study, independent: tuple[int, ...]) -> Array:
    """Return (k,) the condition of independent coordinates at each sample: 0 where they do not determine the velocities."""
    return smallest(study.bases, independent)


def covering(study: Study) -> list[tuple[int, ...]]:
    """Return choices of independent coordinates, of which one is usable at every sample.

    The first has the crank's angle if possible.
    """
    chosen = candidates(study)
    crank = None if study.mechanism.crank is None else angle_slot(study.mechanism.crank)
    # the best of them: one with the crank's angle, and of these the one with the best condition
    chosen = sorted(chosen, key=lambda x: (crank not in x, -float(conditions(study, x).min())))[:1]
    return _covering(study.bases, chosen, range(study.mechanism.n))
