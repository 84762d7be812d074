"""The differences between Pinocchio's releases; only this file deals with them.

Releases before 4 keep Baumgarte's gains of a constraint in the field `corrector`, and have no lcaba, the articulated-body algorithm
for loops.
"""

from typing import Any

import numpy as np

from gauss_bench.trajectory import RunFailure, Status


def find_algorithm(pin: Any, name: str) -> Any:
    """Return the function of Pinocchio with the given name; a RunFailure if the installed release has none."""
    if not hasattr(pin, name):
        raise RunFailure(Status.SKIP, f"Pinocchio {pin.__version__} has no {name}")
    return getattr(pin, name)


def prepare(pin: Any, algorithm: str, model: Any, data: Any, rows: Any, row_data: Any) -> None:
    """Prepare the data of a model for an algorithm with constraints.

    Args:
        rows: Pinocchio's list of constraint models, one for each pin that closes a loop.
        row_data: Pinocchio's list of the constraints' work space.
    """
    if algorithm == "lcaba":  # this algorithm needs only an order of the joints
        pin.computeJointMinimalOrdering(model, data, rows)
        return
    try:
        pin.initConstraintDynamics(model, data, rows, row_data)
    except TypeError:  # a release before 4, which takes no row_data; Boost.Python's ArgumentError is a TypeError
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
