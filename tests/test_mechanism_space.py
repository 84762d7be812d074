"""The equations stand in nobody's way in space: a planar linkage whose bodies are placed in space comes to the same operations."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.linkage.load import built_in, load
from gauss_bench.mechanism import equations
from gauss_bench.mechanism.equations import Symbols
from gauss_bench.mechanism.frames import Direction, Frame
from gauss_bench.mechanism.model import Mechanism, factor_of, loads
from gauss_bench.mechanism.spaces import Plane, Real, Vec
from gauss_bench.mechanism.written import Symbol
from tests.conftest import DATA, everything

FILES = [*built_in().values(), *sorted(DATA.glob("*.toml"))]
NORMAL = (0, 1, 5)  # of a body's six speeds in space: along x, along y, about z


class Space(Plane):
    """Space: a turning is a vector, and angles turn about z."""

    dimension, turns = 3, 3
    axis = Vec(0.0, 0.0, 1.0)  # type: ignore[assignment]

    def dot(self, a: Vec, b: Vec) -> Real:
        return sum(x * y for x, y in zip(a.parts, b.parts, strict=True))

    def wedge(self, a: Vec, b: Vec) -> Vec:
        (x, y, z), (u, v, w) = a.parts, b.parts
        return Vec(y * w - z * v, z * u - x * w, x * v - y * u)

    inner, twist = dot, wedge

    def pull(self, w: Vec, n: Vec, r: Vec) -> Real:
        """n . (w x (w x r)) = (n . w) (w . r) - w^2 (n . r)."""
        return self.dot(n, w) * self.dot(w, r) - self.dot(w, w) * self.dot(n, r)

    def swing(self, w: Vec, d: Vec, r: Vec) -> Vec:
        """d x (w x r) = w (d . r) - r (d . w)."""
        return w * self.dot(d, r) - r * self.dot(d, w)

    def levers(self, m: Vec) -> tuple[Real, ...]:
        return m.parts


class Lifted(Symbols):
    """The bodies of a planar mechanism in space, at z = 0."""

    space = Space()

    def frame(self, body: int) -> Frame:
        flat, none = super().frame(body), self.program.symbol(0.0)
        place, velocity = (Vec(*x.parts, none) for x in (flat.z, flat.u))
        return Frame(body, place, velocity, Vec(none, none, flat.omega), flat.angle, flat.rests)

    def vector(self, body: int, value: Sequence[float]) -> Direction:
        flat = super().vector(body, value)
        return Direction(self.frame(body), Vec(*flat.n.parts, self.program.symbol(0.0)))


def entries(at: Symbols, found: dict[int, Real]) -> dict[int, Symbol]:
    """What is not zero by structure, by generalised speed of the plane."""
    symbols = {k: at.program.symbol(x) for k, x in found.items()}
    if isinstance(at, Lifted):
        beyond = [k for k, x in symbols.items() if k % 6 not in NORMAL and not x.zero]
        assert not beyond, "a force or a row leaves the plane"
        symbols = {3 * (k // 6) + NORMAL.index(k % 6): x for k, x in symbols.items() if k % 6 in NORMAL}
    return {k: x for k, x in symbols.items() if not x.zero}


def describe(mechanism: Mechanism, at: Symbols) -> dict[tuple[object, ...], Symbol]:
    """Everything that the equations say of a mechanism, by what it is."""
    found: dict[tuple[object, ...], Symbol] = {}
    for i, row in enumerate(equations.rows(mechanism, at)):
        found |= {("J", i, k): x for k, x in entries(at, row.entries).items()}
        found |= {(name, i): at.program.symbol(getattr(row, name) or 0.0) for name in ("gamma", "phi", "phi_t")}
    for i, each in enumerate(loads(f for f in mechanism.forces if not factor_of(f))):
        found |= {("Q", i, k): x for k, x in entries(at, equations.generalise(at, each)).items()}
        found |= {("energies", i, k): at.program.symbol(x) for k, x in enumerate(equations.energies(at, each))}
    return found


def operations(at: Symbols, found: dict[tuple[object, ...], Symbol]) -> Counter[str]:
    """How many of each kind are needed."""
    return Counter(
        re.sub(r"[(]-[^)]*[)]|[a-z]+[0-9]+|[0-9.]+(e[-+]?[0-9]+)?", "", x.text) for x in at.program.needed(found.values())
    )


def assert_same_operations(mechanism: Mechanism, rng: np.random.Generator) -> None:
    both = Symbols(mechanism.n), Lifted(mechanism.n)
    plane, space = (describe(mechanism, at) for at in both)
    assert plane.keys() == space.keys()
    assert operations(both[0], plane) == operations(both[1], space)
    q, v = rng.normal(size=(2, mechanism.n))
    values = [at.written(list(found.values()))(0.0, q, v)[0] for at, found in zip(both, (plane, space), strict=True)]
    np.testing.assert_allclose(*values, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_linkage_lifted_into_space_takes_the_same_operations(path: Path, rng: np.random.Generator) -> None:
    for scenario in load(path).scenarios:
        assert_same_operations(load(path, scenario), rng)


def test_so_does_every_joint_force_and_driver(rng: np.random.Generator) -> None:
    assert_same_operations(everything(), rng)
