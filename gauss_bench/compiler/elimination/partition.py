"""Analysis of a linkage before elimination: its rank, its redundant rows, and the coordinates that may be independent.

J (m, n) is the Jacobian of the constraint rows. Independent coordinates must determine the velocities at every position of the
linkage: a coordinate that rests for a moment, while the linkage moves, does not. The null spaces of J at sampled positions show
whether coordinates determine the velocities.

Constraint rows to drop are chosen by a basis of the left null space of J, independent coordinates by a basis of the null space of
J, and both in the same way (`choose_rows`). At each sample, a basis is a matrix with one row for each constraint row or coordinate.
From a basis with c columns, c rows are chosen, which must be linearly independent at all samples. The first one is the row whose
smallest norm over all samples is the largest; then the component along this row is subtracted from all rows, and the next row is
chosen. In other words, the transposed bases are factorised by a column-pivoted QR factorisation, with the same pivots for all
samples.

The left null space may turn with the linkage, as in a parallelogram with a third crank: whichever row is dropped, the others are
dependent at some position. Then a linear combination of two rows is dropped, whose coefficients are a vector w (m,). The kept
combinations of rows are those whose coefficients are orthogonal to w. They are independent wherever l . w != 0, where l is the left
null vector. To form them, one of the two rows is dropped after a multiple of it is added to the other one; if several combinations
are dropped, each dropped row may be added to several kept ones.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product

import numpy as np

from gauss_bench.compiler.equations.sampling import DENSE, manifold_states, scales, shortest_solution
from gauss_bench.compiler.errors import KernelError
from gauss_bench.mechanism.close import RANK_TOLERANCE
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import SIZE, angle_slot
from gauss_bench.terms import Array
from gauss_bench.trajectory import States


def choose_rows(bases: Array, count: int, allowed: Iterable[int], first: int | None = None) -> tuple[int, ...] | None:
    """Return the indices, in order, of `count` rows that are linearly independent in each of several matrices.

    They are chosen one after another by the largest remaining norm. Return None if such a row depends on those chosen before.

    Args:
        bases: (k, n, c), at each of k samples a basis of c vectors (n,).
        first: the row to begin with; if None, the best one.
    """
    if count == 0:
        return ()
    remainder, open_rows = bases.copy(), sorted(allowed)  # remainder: rows without their components along the rows picked so far
    picked: list[int] = []
    largest = np.maximum(np.linalg.norm(bases, axis=2).max(axis=1, keepdims=True), np.finfo(float).tiny)
    for _ in range(count):
        sizes = np.linalg.norm(remainder, axis=2)  # (k, n)
        least_size = (sizes / largest).min(axis=0)  # (n,) smallest relative size of each row over all samples
        least_size[picked] = -1.0
        # rounded, so that rounding errors do not decide between equally good rows; the first of them is picked
        best = max(open_rows, key=lambda k: round(float(least_size[k]), 9), default=None)
        if first is not None and not picked:
            best = first
        if best is None or least_size[best] < RANK_TOLERANCE:
            return None
        picked.append(best)
        direction = remainder[:, best, :] / sizes[:, best, None]  # (k, c) unit vector along the picked row
        remainder = remainder - (remainder @ direction[:, :, None]) * direction[:, None, :]
    return tuple(sorted(picked))


def least_singular_values(bases: Array, rows: tuple[int, ...]) -> Array:
    """Return, for each of k bases (n, c), the smallest singular value of the given rows, divided by the norm of the largest row.

    The result (k,) is 0 where the given rows are linearly dependent.
    """
    if not rows:
        return np.ones(len(bases))
    values = np.linalg.svd(bases[:, list(rows), :], compute_uv=False)[:, -1]
    return np.asarray(values / np.linalg.norm(bases, axis=2).max(axis=1))


SAMPLES = 48  # number of poses, about a tenth of a radian apart: a pivot that touches zero between two of them is small at both
FEW = 8  # number of poses of a large linkage
SINGULAR = 0.02  # smallest singular value, divided by its median over the poses, below which a pose is too near to a singular one
# The condition of a choice of rows or coordinates at a sample is the result of `least_singular_values`; 0 is singular.
USABLE = 0.02  # smallest condition of a choice at a sample where it is used
ENOUGH = 5 * USABLE  # condition of a choice at a sample, below which a further choice is added
MOST = 4  # largest number of choices
NEAR = 0.5  # condition, divided by that of the best choice of coordinates, above which the costs decide
RATIOS = (1.0, -1.0, 0.5, -0.5, 2.0, -2.0)  # in a combination of two rows, the second coefficient divided by the first
CANDIDATES = 6  # number of choices of independent coordinates that are tried


@dataclass(frozen=True)
class Drop:
    """A choice of redundant rows to drop.

    Attributes:
        rows: indices of the dropped rows.
        shares: (k, d, factor) for every kept row k to which factor times the dropped row d is added before d is dropped.
    """

    rows: tuple[int, ...]
    shares: tuple[tuple[int, int, float], ...] = ()

    def directions(self, count: int) -> Array:
        """Return the combinations of constraint rows that are dropped, as unit vectors (dropped rows, count) of coefficients.

        `count` is the number of all constraint rows. The returned vectors are orthogonal to the coefficients of every kept row.
        """
        W = np.zeros((len(self.rows), count))
        W[range(len(self.rows)), list(self.rows)] = 1.0
        for kept, dropped, factor in self.shares:
            W[self.rows.index(dropped), kept] = -factor
        return np.asarray(W / np.linalg.norm(W, axis=1, keepdims=True))

    def soundness(self, left: Array) -> Array:
        """Return for each of k samples how far the kept constraint rows are from linear dependence (k,); 0 means dependent.

        The kept rows are linearly dependent where some vector of the left null space of J is orthogonal to all dropped combinations
        of rows. Let the rows of D be the coefficients of the dropped combinations, and the columns of L a basis of the left null
        space: the result is the smallest singular value of D L, divided by the norm of the largest row of L.

        Args:
            left: (k, m, redundant) the bases L.
        """
        if not self.rows:
            return np.ones(len(left))
        values = np.linalg.svd(self.directions(left.shape[1]) @ left, compute_uv=False)[:, -1]
        return np.asarray(values / np.linalg.norm(left, axis=2).max(axis=1))


@dataclass(frozen=True, eq=False)
class Study:
    """Results of the analysis of a linkage before elimination, from k samples of its states.

    Attributes:
        states: samples on the constraints at which J has its full rank.
        drops: choices of redundant rows to leave out, the best first; several if none alone is well conditioned at every sample.
        free: number of degrees of freedom of the velocities.
        left: (k, m, redundant) basis of the left null space of J at each sample.
        bases: (k, n, free) basis of the null space of J in scaled coordinates at each sample.
    """

    mechanism: Mechanism
    states: States
    drops: tuple[Drop, ...]
    free: int
    left: Array
    bases: Array

    def kept_rows(self, choice: int) -> tuple[int, ...]:
        """Return the indices of the constraint rows that are kept if the redundant rows in drops[choice] are left out."""
        return tuple(k for k in range(self.left.shape[1]) if k not in self.drops[choice].rows)

    def dropped_names(self, choice: int) -> tuple[str, ...]:
        """Return the names of the constraint rows that are left out by drops[choice]."""
        names = [f"{row.owner}.{row.part}" if row.part else row.owner for row in self.mechanism.row_names]
        return tuple(names[k] for k in self.drops[choice].rows)


@lru_cache(maxsize=32)  # a mechanism is compiled under several formulations, and needs its study again for further programs
def study(mechanism: Mechanism) -> Study:
    """Sample states of a mechanism on its constraints; find redundant rows and the null spaces of the Jacobian at the samples.

    Raises:
        KernelError: some rows are redundant and must not be dropped, for example those of two drivers of the same coordinate.
    """
    states = manifold_states(mechanism, SAMPLES if mechanism.n <= DENSE else FEW)
    scale, constraints = scales(mechanism), Constraints(mechanism)
    jacobians = [constraints(t, q, v).J * scale for t, q, v in zip(states.t, states.q, states.v, strict=True)]
    if mechanism.n > DENSE and mechanism.redundant == 0:  # a large linkage of full rank: no singular value decompositions
        free = mechanism.n - constraints.m
        bases = [_sparse_null_space(J, free) for J in jacobians]
        no_left = np.zeros((len(states), constraints.m, 0))
        return Study(mechanism, states, drops=(Drop(()),), free=free, left=no_left, bases=np.array(bases))
    U, s, Vt = np.linalg.svd(np.array(jacobians))  # (k, m, m), (k, min(m, n)), (k, n, n)
    ranks = (s > RANK_TOLERANCE * s.max(axis=1, initial=0.0, keepdims=True)).sum(axis=1)
    rank = int(ranks.max())
    smallest_values = s[:, rank - 1] / s[:, 0] if rank else np.ones(len(s))
    regular = (ranks == rank) & (smallest_values > SINGULAR * np.median(smallest_values[ranks == rank]))
    # left and right null spaces at the regular samples: the singular vectors after the first `rank` ones
    left, null = U[regular][:, :, rank:], Vt[regular][:, rank:].transpose(0, 2, 1)
    allowed = range(constraints.joint_rows)  # rows of drivers and knife edges are never dropped
    first = choose_rows(left, left.shape[2], allowed)
    if first is None:
        raise KernelError(f"{mechanism.name}: {left.shape[2]} constraint rows are redundant, and not all of them belong to joints")
    # choices of rows, of which at least one is well conditioned at each sample
    drops = [Drop(rows) for rows in _covering(left, [first], allowed)]
    # if no single choice of rows is good at every sample, combinations of rows may be
    mixed = _drop_combinations(left, allowed) if len(drops) > 1 else None
    chosen = tuple([mixed] if mixed else drops)
    return Study(mechanism, states[regular], drops=chosen, free=mechanism.n - rank, left=left, bases=null)


def _drop_combinations(left: Array, allowed: Iterable[int]) -> Drop | None:
    """Choose combinations of two constraint rows to drop that leave rows independent at every sample; None if there are none.

    A combination is row i + ratio row j, with a ratio from RATIOS; row j is left out after a multiple of it is added to row i.

    Args:
        left: (k, m, redundant) bases of the left null space of J at k samples.
    """
    m, redundant = left.shape[1:]
    # of equally good pairs the first is picked: the order from the last row on gives shorter programs for the parallelogram
    pairs = [(i, j, ratio) for (i, j), ratio in product(combinations(sorted(allowed, reverse=True), 2), RATIOS)]
    W = np.zeros((len(pairs), m))  # unit vectors: row i plus `ratio` times row j
    for row, (i, j, ratio) in zip(W, pairs, strict=True):
        row[[i, j]] = np.array([1.0, ratio]) / np.hypot(1.0, ratio)
    # first choose as many combinations as rows are redundant, far from orthogonal to the left null space at all samples
    chosen = choose_rows(W @ left, redundant, range(len(pairs)))
    if chosen is None:
        return None
    # then choose as many rows, in which the combinations are independent, to be dropped
    dropped = W[list(chosen)]
    rows = choose_rows(dropped.T[None], redundant, allowed)
    if rows is None:
        return None
    factors = -np.linalg.solve(dropped[:, list(rows)], dropped)  # (redundant, m): of each dropped row in every row
    shares = []  # (kept row, dropped row, factor)
    for k in (k for k in allowed if k not in rows):
        shares += [(k, r, float(x)) for r, x in zip(rows, factors[:, k], strict=True) if x]
    drop = Drop(rows, tuple(shares))
    return drop if (drop.soundness(left) >= ENOUGH).all() else None


def _covering(bases: Array, first_choices: list[tuple[int, ...]], allowed: Iterable[int]) -> list[tuple[int, ...]]:
    """Return `first_choices` of rows and further choices, of which at least one is well conditioned at every sample.

    At most MOST choices are returned; some samples may then have no well conditioned choice.
    """
    # open_samples: true where no choice is well conditioned
    open_samples, choices = np.ones(len(bases), bool), list(first_choices)
    for rows in choices:
        open_samples &= least_singular_values(bases, rows) < ENOUGH
    while open_samples.any() and len(choices) < MOST:
        k = int(np.flatnonzero(open_samples)[0])  # the first open sample
        best = choose_rows(bases[k : k + 1], bases.shape[2], allowed)  # the best rows for this sample alone
        if best is None or best in choices:
            break
        choices.append(best)
        open_samples &= least_singular_values(bases, best) < ENOUGH
    return choices


def _sparse_null_space(J: Array, free: int) -> Array:
    """Return a basis (n, free) of the null space of a large J (m, n) of full row rank."""
    X = np.random.default_rng(0).normal(size=(J.shape[1], free))
    for _ in range(2):  # project random vectors onto the null space; twice, because one pass leaves rounding errors
        X = np.array([x - shortest_solution(J, J @ x) for x in X.T]).reshape(free, -1).T
        X = np.linalg.qr(X)[0] if free else X
    return X


def candidates(study: Study) -> list[tuple[int, ...]]:
    """Return a few choices of independent coordinates, each of which is usable at every sample (its condition is above USABLE).

    A well conditioned choice has a smallest condition above NEAR times that of the best choice. A well conditioned choice with the
    crank's angle comes first, then a usable choice of angles, then others at even spacing, because in a long chain the coordinates
    near its middle make the cheapest programs. A large linkage gets a single choice. If drivers prescribe the whole motion, the
    single choice is the empty tuple: no coordinate is independent.
    """
    if study.free == 0:
        return [()]
    mechanism, coordinates = study.mechanism, range(study.mechanism.n)
    # for each coordinate the choice that begins with it
    begun_with_each = {choose_rows(study.bases, study.free, coordinates, first) for first in coordinates}
    angles = choose_rows(study.bases, study.free, coordinates[angle_slot(0) :: SIZE])  # among the indices of all angles
    # choice -> its condition at the worst sample
    worst = {x: float(conditions(study, x).min()) for x in {*begun_with_each, angles} if x is not None}
    best = max(worst.values(), default=0.0)
    sound = sorted(choice for choice, condition in worst.items() if condition > max(USABLE, NEAR * best))
    preferred = [] if mechanism.crank is None else [x for x in sound if angle_slot(mechanism.crank) in x][:1]
    if angles is not None and worst[angles] > USABLE:
        preferred.append(angles)
    if not sound:
        return preferred
    if mechanism.n > DENSE:
        return preferred[:1] or [sound[len(sound) // 2]]
    evenly_spaced = [sound[k] for k in np.unique(np.linspace(0, len(sound) - 1, CANDIDATES).round().astype(int))]
    return list(dict.fromkeys(preferred + evenly_spaced))


def conditions(study: Study, independent: tuple[int, ...]) -> Array:
    """Return the condition (k,) of independent coordinates at each sample: 0 where they do not determine the velocities."""
    return least_singular_values(study.bases, independent)


def covering(study: Study) -> list[tuple[int, ...]]:
    """Return choices of independent coordinates, one or more usable at each sample; the first has the crank's angle if possible."""
    crank = None if study.mechanism.crank is None else angle_slot(study.mechanism.crank)
    # the best candidate: the one with the best condition among those with the crank's angle, or among all if there are none
    best_first = sorted(candidates(study), key=lambda x: (crank not in x, -float(conditions(study, x).min())))
    return _covering(study.bases, best_first[:1], range(study.mechanism.n))
