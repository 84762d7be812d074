"""Linkages drawn by lot: native steps are as exact as the interpreted ones, with and without projection, whatever the linkage."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from gauss_bench.compiler.kernel import compile_kernel
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load_document
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

from .drawn_linkages import random_linkage

H, STEPS, GAP = 1e-3, 100, 10  # [s], steps, steps between samples
ROUNDING = 1e-13  # of positions, after a hundred steps
MORE = [pytest.param(seed, marks=pytest.mark.long) for seed in (4, 5, 7, 10)]


@cache
def mechanism(seed: int) -> Mechanism:
    return load_document(random_linkage(seed))


def interpreted(m: Mechanism, **choice: Any) -> Array:
    """Positions (k, n) at the samples by numpy's gauss."""
    model = get("gauss").build(m, Choice(step=H, **choice))
    model.prepare(H * np.arange(0, STEPS + 1, GAP))
    model.run()
    return model.read().q


@cache
def exact(seed: int) -> Array:
    return interpreted(mechanism(seed), integrator="dop853_fixed", stabilization="projection")


@pytest.mark.long("2-none", "2-projection", "4-none", "4-projection", "7-none")
@pytest.mark.slow("0-none", "0-projection")
@pytest.mark.parametrize("stabilization", ["none", "projection"])
@pytest.mark.parametrize("seed", [*range(3), *MORE])
def test_native_steps_are_as_exact_as_interpreted_ones(seed: int, stabilization: str) -> None:
    m = mechanism(seed)
    q, _ = compile_kernel(m, "gauss", stabilization).rollout(m.q0, m.v0, H, STEPS, every=GAP)
    native = np.abs(q - exact(seed)[1:]).max()
    numpy = np.abs(interpreted(m, integrator="rk4", stabilization=stabilization) - exact(seed)).max()
    assert native <= 1.5 * numpy + ROUNDING
