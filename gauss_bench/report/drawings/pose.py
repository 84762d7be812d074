"""States worth drawing: a linkage at a readable crank angle, and one full turn of it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.linkage.closure import gauss_newton
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import document_of, load_document
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

POSE_DEG = 60.0  # crank angle of the drawings: no linkage of the suite is stretched out or folded there
TURN = 120  # states of a full turn


def pose_links(name_or_path: str | Path, crank_deg: float = POSE_DEG) -> tuple[Mechanism, Array, Array | None]:
    """`pose_document` of a file, or of a built-in linkage."""
    return pose_document(*document_of(name_or_path), crank_deg)


def pose_document(
    document: dict[str, Any], digest: str, path: Path, crank_deg: float = POSE_DEG
) -> tuple[Mechanism, Array, Array | None]:
    """A linkage with a state to draw, and the states (k, n) of a full turn of its crank where it has and can make one.

    A linkage at its pose has all forces of the file, whichever scenario they act in, and no driver; one at its start those of its
    first scenario.
    """
    crank = document.get("crank")
    driver = {"link": crank, "law": "constant", "start_deg": crank_deg, "speed": 2 * np.pi}
    scenarios = {"turn": {"duration": 1.0, "driver": driver, "forces": list(document.get("forces", {}))}}
    if crank is not None:
        try:
            mechanism = load_document(document | {"scenarios": scenarios}, "turn", str(path), digest)
            return replace(mechanism, drivers=()), mechanism.q0, full_turn(mechanism)
        except LinkageError:  # a crank that cannot reach the pose is drawn where its file starts it
            pass
    mechanism = load_document(document, None, str(path), digest)
    return mechanism, mechanism.q0, None


def full_turn(mechanism: Mechanism) -> Array | None:
    """States (TURN + 1, n) while the driver turns once in a second, or None where the linkage does not close all the way."""
    constraints, still = Constraints(mechanism), np.zeros(mechanism.n)
    q, states = mechanism.q0, [mechanism.q0]
    for t in np.linspace(0.0, 1.0, TURN + 1)[1:]:

        def residual(x: Array, t: float = float(t)) -> tuple[Array, Array]:
            rows = constraints(t, x, still)
            return rows.phi, rows.J

        q, error = gauss_newton(q, residual)
        if error > 1e-9:  # far above rounding, far below a pixel
            return None
        states.append(q)
    return np.array(states)


def unwrap_angles(states: Array) -> Array:
    """States (k, n) whose angles go on where they pass half a turn."""
    states = states.copy()
    states[:, 2::3] = np.unwrap(states[:, 2::3], axis=0)
    return states


def crank_angles(mechanism: Mechanism, states: Array) -> Array:
    """The angles (k,) [rad] of the crank at states (k, n)."""
    assert mechanism.crank is not None
    return states[:, 3 * mechanism.crank + 2]
