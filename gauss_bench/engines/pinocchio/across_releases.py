"""The differences between Pinocchio's releases; only this file deals with them.

The adapter is written for the newest release. Releases before 4 differ as follows:

    constraints     initConstraintDynamics takes no data of the constraints; Baumgarte's gains are in the field `corrector`
    algorithms      lcaba, the articulated-body algorithm for loops, does not exist
"""

from typing import Any

import numpy as np

from gauss_bench.trajectory import RunFailure, Status


def find_algorithm(pin: Any, name: str) -> Any:
    """Return Pinocchio's function of that name.

    Raises:
        RunFailure: the release does not have it.
    """
    if not hasattr(pin, name):
        raise RunFailure(Status.SKIP, f"Pinocchio {pin.__version__} has no {name}")
    return getattr(pin, name)


def prepare(pin: Any, algorithm: str, model: Any, data: Any, rows: Any, row_data: Any) -> None:
    """Prepare the data of a model for an algorithm with constraints.

    Args:
        rows, row_data: the constraints and their data.
    """
    if algorithm == "lcaba":
        pin.computeJointMinimalOrdering(model, data, rows)
        return
    try:
        pin.initConstraintDynamics(model, data, rows, row_data)
    except TypeError:  # Boost.Python's ArgumentError is one
        pin.initConstraintDynamics(model, data, rows)


def corrector_of(row: Any) -> Any:
    """Return the object that holds Baumgarte's gains of a constraint in the fields Kp and Kd."""
    return row.m_baumgarte_parameters if hasattr(row, "m_baumgarte_parameters") else row.corrector


def set_gains(row: Any, gains: tuple[float, float]) -> None:
    """Set Baumgarte's gains Kp, Kd of a constraint; in older releases each of its rows has its own gains."""
    corrector = corrector_of(row)
    for name, gain in zip(("Kp", "Kd"), gains, strict=True):
        if isinstance(getattr(corrector, name), np.ndarray):
            getattr(corrector, name)[:] = gain
        else:
            setattr(corrector, name, gain)
