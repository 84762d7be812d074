"""Plan the varied numbers of a sweep's samples: grids, random values, and Sobol points.

    PATH=a:b:n:          a grid of n equally spaced values from a to b, ends included
    PATH=uniform(a,b):   random values from a to b, uniformly distributed
    PATH=normal(m,s):    random values, normally distributed with mean m and standard deviation s

Several grids are crossed: every combination of their values is one point. Random values come from one seed. If there are both grids
and random values, the samples cycle through the points of the crossed grids.

In a Sobol plan (`--sampling sobol`) numbers have random values only, and no grids. The samples are two scrambled Sobol sequences A
and B of n points each, where n is a power of two. In addition, for each of the d varied numbers there is a copy of A with the
column of this number taken from B. The plan has (d + 2) n samples in all. Sobol's first-order and total indices are computed from
this design of Saltelli.
Source: Saltelli et al., Variance based sensitivity analysis of model output (2010), table 2.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from gauss_bench.sweep.errors import SweepError
from gauss_bench.terms import Array

MOST = 10_000_000  # largest number of samples
PLANS = ("random", "sobol")
FORM = re.compile(r"(?P<kind>normal|uniform)\((?P<a>[^,()]+),(?P<b>[^,()]+)\)")


@dataclass(frozen=True)
class Dimension:
    """A number of the linkage file that a sweep varies.

    Attributes:
        kind: "grid", "uniform" or "normal".
        a, b: first and last value of a grid, bounds of a uniform distribution, or mean and deviation of a normal one.
        count: number of values of a grid, else 0.
    """

    path: str
    kind: str
    a: float
    b: float
    count: int = 0

    def values(self, shares: Array) -> Array:
        """Return the quantiles (k,) of the uniform or normal distribution at probabilities `shares` (k,)."""
        if self.kind == "uniform":
            return self.a + (self.b - self.a) * shares
        from scipy.special import ndtri  # imported late: its import takes long

        # clipped, because the quantiles at the probabilities 0 and 1 are infinite
        return np.asarray(self.a + self.b * ndtri(np.clip(shares, 1e-300, 1 - 2**-53)))


@dataclass(frozen=True, eq=False)
class Plan:
    """A sweep's samples.

    Attributes:
        values: (N, d) values of the d varied numbers in the N samples.
        base: number n of points in each sequence of Saltelli's design, whose samples are A, then B, then A with each column of B; 0
            for other plans.
    """

    dimensions: tuple[Dimension, ...]
    values: Array
    base: int = 0

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of the numbers that vary."""
        return tuple(x.path for x in self.dimensions)


def dimension(text: str) -> Dimension:
    """Return the varied number that a --vary option describes.

    Raises:
        SweepError: the option has none of the forms at the top of this file.
    """
    path, equals, values = (x.strip() for x in text.partition("="))
    if not (path and equals and values):
        raise SweepError(f"--vary {text}: must be PATH=a:b:n, PATH=uniform(a,b) or PATH=normal(mean,deviation)")
    if matched := FORM.fullmatch(values.replace(" ", "")):
        a, b = (_number(text, matched[x]) for x in "ab")
        if matched["kind"] == "uniform" and not a < b:
            raise SweepError(f"--vary {text}: the first bound must be smaller than the second")
        if matched["kind"] == "normal" and not b > 0:
            raise SweepError(f"--vary {text}: the standard deviation must be positive")
        return Dimension(path, matched["kind"], a, b)
    parts = values.split(":")
    if len(parts) != 3:
        raise SweepError(f"--vary {text}: {values!r} is neither a:b:n, uniform(a,b) nor normal(mean,deviation)")
    a, b = (_number(text, x) for x in parts[:2])
    if not (parts[2].isascii() and parts[2].isdigit() and len(parts[2]) < 10 and 1 <= int(parts[2]) <= MOST):
        raise SweepError(f"--vary {text}: a grid has a whole number of values from 1 to {MOST}, not {parts[2]!r}")
    return Dimension(path, "grid", a, b, int(parts[2]))


def _number(text: str, value: str) -> float:
    """Return the number that the text `value` contains, which is a part of the --vary option `text`.

    Raises:
        SweepError: the text is not a finite number.
    """
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise SweepError(f"--vary {text}: {value!r} is no finite number")
    return number


def plan(texts: Sequence[str], samples: int | None = None, sampling: str = "random", seed: int = 0) -> Plan:
    """Plan the samples of a sweep.

    Args:
        texts: values of the --vary options.
        samples: number of samples; None for a plan of grids alone, whose points are the samples.
        sampling: "random" or "sobol".
        seed: seed of the random values or of the scrambling.

    Raises:
        SweepError: the options do not make a plan.
    """
    dimensions = tuple(dimension(x) for x in texts)
    paths = [x.path for x in dimensions]
    if not dimensions:
        raise SweepError("--vary: nothing varies; give at least one PATH=VALUES")
    if repeated := [x for x in paths if paths.count(x) > 1]:
        raise SweepError(f"--vary {repeated[0]}: is given twice")
    if samples is not None and not 1 <= samples <= MOST:
        raise SweepError(f"--samples {samples}: must be from 1 to {MOST}")
    if seed < 0:
        raise SweepError(f"--seed {seed}: must not be negative")
    return _sobol(dimensions, samples, seed) if sampling == "sobol" else _random(dimensions, samples, seed)


def _random(dimensions: tuple[Dimension, ...], samples: int | None, seed: int) -> Plan:
    """Return the plan whose samples cycle through the points of the crossed grids, and have random values of other numbers."""
    grids = [x for x in dimensions if x.kind == "grid"]
    size = math.prod(x.count for x in grids)
    if len(grids) == len(dimensions):
        if samples not in (None, size):
            raise SweepError(f"--samples {samples}: the grids have {size} points, each of which is one sample; leave it out")
        samples = size
    if samples is None:
        raise SweepError("--samples: must be given if values are random")
    if max(samples, size) > MOST:
        raise SweepError(f"--vary: the grids have {size} points; at most {MOST} are allowed")
    random, columns = np.random.default_rng(seed), {}
    for x in dimensions:
        if x.kind != "grid":
            columns[x.path] = x.values(random.random(samples))
    if grids:
        crossed: Any = np.array(list(product(*(np.linspace(x.a, x.b, x.count) for x in grids))))
        columns |= {x.path: crossed[np.arange(samples) % size, k] for k, x in enumerate(grids)}
    return Plan(dimensions, np.stack([columns[x.path] for x in dimensions], axis=-1))


def _sobol(dimensions: tuple[Dimension, ...], samples: int | None, seed: int) -> Plan:
    """Return the Sobol plan: Saltelli's design, as described at the top of this file."""
    from scipy.stats import qmc

    for x in dimensions:
        if x.kind == "grid":
            raise SweepError(f"--vary {x.path}: a Sobol plan takes no grid; give uniform({x.a:g},{x.b:g})")
    d = len(dimensions)
    if samples is None or samples < 2 * (d + 2):
        raise SweepError(f"--samples: Sobol's plan of {d} numbers needs at least {2 * (d + 2)}, a power of two times {d + 2}")
    base = 1 << int(math.log2(samples / (d + 2)))  # the largest power of two with (d + 2) base <= samples
    points = qmc.Sobol(2 * d, scramble=True, rng=seed).random(base)
    a, b = points[:, :d], points[:, d:]
    mixed = [np.where(np.arange(d) == k, b, a) for k in range(d)]  # a with column k of b
    shares = np.concatenate([a, b, *mixed])
    return Plan(dimensions, np.stack([x.values(shares[:, k]) for k, x in enumerate(dimensions)], axis=-1), base)
