"""Sparse rows of matrices at many states in extended precision: their products, and their copies as dense matrices of doubles."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.mechanism.numbers import Number
from gauss_bench.reference.taylor.arithmetic import Value
from gauss_bench.terms import Array

Long = NDArray[Any]  # array of numbers of extended precision


@lru_cache
def epsilon(number: Number) -> float:
    """Return the distance from 1 to the next larger number that the number type can represent."""
    one = number("1")
    half = one / 2
    while one + half != one:
        half = half / 2
    return float(half * 2)


def stack_arrays(values: Sequence[Value], like: Long) -> Long:
    """Return m values, each an array (k,), a number or a plain integer, as one array (k, m) in the number type of `like` (k,)."""
    zero = like - like
    return np.stack([zero + x for x in values], axis=-1) if len(values) else np.zeros((len(like), 0), dtype=like.dtype)


def split_columns(x: Long) -> list[Long]:
    """Return the n columns of an array (k, n), each as an array (k,)."""
    return [x[:, j] for j in range(x.shape[1])]


def to_dense(entries: Sequence[Mapping[int, Value]], k: int, n: int) -> Array:
    """Return sparse rows as matrices (k, m, n) in double precision."""
    A = np.zeros((k, len(entries), n))
    for r, row in enumerate(entries):
        for j, value in row.items():
            A[:, r, j] = np.asarray(value).astype(float)
    return A


def multiply(entries: Sequence[Mapping[int, Value]], x: Long) -> Long:
    """Return A x (k, m) in the type of x (k, n), for the sparse rows of A."""
    zero = x[:, 0] - x[:, 0]  # (k,) in the type of x
    return stack_arrays([sum((value * x[:, j] for j, value in row.items()), start=zero) for row in entries], zero)
