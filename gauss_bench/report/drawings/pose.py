"""States for drawings: a linkage at a readable crank angle, and a full turn of its crank."""

import hashlib
import tomllib
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.linkage.closure import gauss_newton
from gauss_bench.linkage.errors import Fault, LinkageError
from gauss_bench.linkage.load import built_in, document_of, load_document
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.report.rows import Run
from gauss_bench.terms import Array
from gauss_bench.untrusted import parse_toml

POSE_DEG = 60.0  # crank angle of the drawings, at which no built-in linkage is stretched or folded
INTERVALS = 120  # equal intervals of a full turn
FILES = "linkages"  # key of a run's environment for a dictionary: name of a linkage -> text of its file


def pose_links(name_or_path: str | Path, crank_deg: float = POSE_DEG) -> tuple[Mechanism, Array, Array | None]:
    """Return a linkage, the state q (n,) to draw, and the states (k, n) of a full turn; `pose_document` explains them."""
    return pose_document(*document_of(name_or_path), crank_deg)


def pose_document(
    document: dict[str, Any], digest: str, path: Path, crank_deg: float = POSE_DEG
) -> tuple[Mechanism, Array, Array | None]:
    """Return a linkage, the state q (n,) to draw, and the states (k, n) of a full turn of its crank.

    In the returned state the crank is at the angle `crank_deg`; the returned linkage has all forces of the file and no driver. If
    there is no crank, or it cannot reach this angle, linkage and state are those of the default scenario at its start. If the crank
    cannot turn fully, the states of a turn are None.
    """
    crank = document.get("crank")
    driver = {"link": crank, "law": "constant", "start_deg": crank_deg, "speed": 2 * np.pi}
    scenarios = {"turn": {"duration": 1.0, "driver": driver, "forces": list(document.get("forces", {}))}}
    if crank is not None:
        with suppress(LinkageError):  # if the crank cannot reach the pose, draw the file's own start
            mechanism = load_document(document | {"scenarios": scenarios}, "turn", str(path), digest)
            return replace(mechanism, drivers=()), mechanism.q0, full_turn(mechanism)
    mechanism = load_document(document, None, str(path), digest)
    return mechanism, mechanism.q0, None


def full_turn(mechanism: Mechanism) -> Array | None:
    """Return states (INTERVALS + 1, n) of a full turn of the driver in 1 s; None if the linkage does not close everywhere."""
    constraints, no_speed = Constraints(mechanism), np.zeros(mechanism.n)
    q, states = mechanism.q0, [mechanism.q0]
    for t in np.linspace(0.0, 1.0, INTERVALS + 1)[1:]:

        def residual(x: Array, t: float = float(t)) -> tuple[Array, Array]:
            """Return the residuals of the constraints, and their Jacobian."""
            rows = constraints(t, x, no_speed)
            return rows.phi, rows.J

        q, error = gauss_newton(q, residual)
        if error > 1e-9:  # far above rounding errors and far below a pixel
            return None
        states.append(q)
    return np.array(states)


def unwrap_angles(states: Array) -> Array:
    """Return states (k, n) with angles that are continuous over time."""
    states = states.copy()
    states[:, 2::3] = np.unwrap(states[:, 2::3], axis=0)
    return states


def crank_angles(mechanism: Mechanism, states: Array) -> Array:
    """Return the angles (k,) [rad] of the crank at states (k, n)."""
    assert mechanism.crank is not None
    return states[:, 3 * mechanism.crank + 2]


def document_in(run: Run, name: str) -> tuple[dict[str, Any], str, Path]:
    """Return document, digest and path of a linkage of a run, from the file that the run stored or else the built-in file.

    Raises:
        LinkageError: the linkage is neither built in nor stored, or the stored file is damaged.
    """
    stored = run.environment.get(FILES)
    text = stored.get(name) if isinstance(stored, dict) else None
    if isinstance(text, str):
        try:
            return parse_toml(text), hashlib.sha256(text.encode()).hexdigest(), Path(f"{name}.toml")
        except tomllib.TOMLDecodeError as error:
            raise LinkageError(name, [Fault("", f"the file that the run stored is not TOML: {error}")]) from error
    if name not in built_in():
        raise LinkageError(name, [Fault("", "the run did not store its file")])
    return document_of(name)


@lru_cache(maxsize=64)
def pose_in(run: Run, name: str, crank_deg: float = POSE_DEG) -> tuple[Mechanism, Array, Array | None]:
    """Return the result of `pose_document` for a linkage of a run.

    Raises:
        LinkageError: for the same reasons as in `document_in`, or because the linkage does not load.
    """
    return pose_document(*document_in(run, name), crank_deg)
