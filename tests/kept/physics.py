"""Terms and accelerations of every linkage and scenario at 20 states, to be stored once and compared ever after.

python -m tests.kept.physics     stores them: only where a linkage was added, or physics was wrong, in a commit of its own
"""

import tomllib
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator, UndeterminedLoads
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.suites.read import FOLDER
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure
from tests.conftest import DATA

STORED = DATA / "kept_physics.npz"
STATES = 20
SPREAD = 0.05  # of the linkage's size [m], and [rad]: far enough that every term acts, near enough that none is singular
TERMS = ("M", "J", "Q", "gamma", "phi", "phi_dot")
FOLDERS = {"mechanisms": Path(__file__).parents[2] / "mechanisms", "suites": FOLDER / "linkages", "tests": DATA}


def cases() -> Iterator[str]:
    """Yield "folder/linkage/scenario" of every linkage file of the repository and every scenario in it."""
    for folder, path in FOLDERS.items():
        for file in sorted(path.glob("*.toml")):
            for scenario in tomllib.loads(file.read_text(encoding="utf-8")).get("scenarios", {}):
                yield f"{folder}/{file.stem}/{scenario}"


def load_case(case: str) -> Mechanism:
    """Return the mechanism of a case, by its "folder/linkage/scenario"."""
    folder, name, scenario = case.split("/")
    return load(str(FOLDERS[folder] / f"{name}.toml"), scenario)


def draw_states(mechanism: Mechanism, seed: int) -> tuple[Array, Array, Array]:
    """Return times (k,) and states q, v (k, n) about the start; every second one is closed, the others are off the constraints.

    Off them a term shows that vanishes on them.
    """
    random = np.random.default_rng(seed)
    evaluator, n = Evaluator(mechanism), mechanism.n
    slots = np.arange(n) % 3 == 2
    size = np.where(slots, 1.0, mechanism.size)
    t = random.uniform(0.0, max(mechanism.duration, 1e-3), STATES)
    q = mechanism.q0 + SPREAD * size * random.standard_normal((STATES, n))
    v = mechanism.v0 + size * random.standard_normal((STATES, n))
    for k in range(0, STATES, 2):
        q[k], v[k] = evaluator.project(float(t[k]), q[k], v[k])
    return t, q, v


def terms_at(mechanism: Mechanism, t: Array, q: Array, v: Array) -> dict[str, Array]:
    """Return the terms at states (k, n), each stacked over them, and the accelerations a (k, n), NaN where there is no answer."""
    evaluator, model = Evaluator(mechanism), get("gauss").build(mechanism, Choice("default", "rk4"))
    found = [evaluator.terms(float(x), y, z) for x, y, z in zip(t, q, v, strict=True)]
    stacked = {name: np.array([getattr(x, name) for x in found]) for name in TERMS}
    return stacked | {"a": np.array([_acceleration(model, *x) for x in zip(t, q, v, strict=True)])}


def _acceleration(model: object, t: float, q: Array, v: Array) -> Array:
    try:
        return np.asarray(model.acceleration(float(t), q, v))  # type: ignore[attr-defined]
    except (RunFailure, UndeterminedLoads, ArithmeticError):
        return np.full(len(q), np.nan)


def store() -> None:
    """Add the terms of cases that are not stored yet; M, which is the same everywhere, once for each. What is stored stays."""
    arrays: dict[str, Array] = {f"{case}/{key}": x for case, kept in read().items() for key, x in kept.items()}
    for name in cases():
        if f"{name}/M" in arrays:
            continue
        mechanism = load_case(name)
        t, q, v = draw_states(mechanism, zlib.crc32(name.encode()))
        found = terms_at(mechanism, t, q, v)
        assert (found["M"] == found["M"][0]).all(), name
        arrays |= {f"{name}/{key}": x for key, x in {"t": t, "q": q, "v": v, **found, "M": found["M"][:1]}.items()}
    np.savez_compressed(STORED, **arrays)


def read() -> Mapping[str, dict[str, Array]]:
    """Return the stored arrays by case and name."""
    kept: dict[str, dict[str, Array]] = {}
    with np.load(STORED) as file:
        for key in file.files:
            case, _, name = key.rpartition("/")
            kept.setdefault(case, {})[name] = file[key]
    return kept


if __name__ == "__main__":
    store()
