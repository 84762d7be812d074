"""The equations of a linkage as casadi.Function objects, which users can evaluate, differentiate, save or turn into C code."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gauss_bench.engines.shared import unsteady
from gauss_bench.mechanism.model import Mechanism, loads

GRAVITY = ("gravity.x", "gravity.y")  # parameters of the functions that belong to no link, force or joint
PARAMETERS = {  # table of a linkage file -> numbers of its items that can be parameters of the functions
    "links": ("mass", "inertia"),
    "forces": ("value", "value.x", "value.y", "k", "c", "rest"),
    "joints": ("offset",),
}


@dataclass(frozen=True, eq=False)
class Functions:
    """The equations M a + J^T lambda = Q subject to J a = gamma in absolute coordinates q = [x, y, theta] of every link (SI units).

    If there are parameters p (k,), they are the last argument of every function.

    Attributes:
        acceleration: (t, q, v) -> a (n,), multipliers (m,).
        residual: (t, q, v) -> phi (h,), phi_dot (m,); knife edges come last, and have a phi_dot but no phi.
        jacobian: (t, q, v) -> J (m, n), gamma (m,).
        mass_matrix: (q) -> M (n, n).
        forces: (q, v) -> Q (n,).
        energy: (q, v) -> kinetic plus potential energy.
        parameters: (k,) names of the entries of p.
        values: (k,) values of the parameters in the linkage file.
    """

    acceleration: Any
    residual: Any
    jacobian: Any
    mass_matrix: Any
    forces: Any
    energy: Any
    parameters: tuple[str, ...]
    values: tuple[float, ...]


def functions(mechanism: Mechanism, parameters: Sequence[str] = ()) -> Functions:
    """Return the functions of a linkage.

    Args:
        parameters: names of the numbers that become parameters: gravity.x, gravity.y, links.LINK.mass, links.LINK.inertia,
            forces.FORCE.value (or .value.x, .value.y), forces.FORCE.k, .c, .rest and joints.SLIDE.offset.

    Raises:
        ImportError: the extra 'casadi' is not installed.
        ValueError: a parameter does not exist or is named twice, a force varies, or the linkage has dry friction or redundant rows,
            with which the multipliers are not unique.
    """
    import casadi as ca

    from gauss_bench.engines.casadi.equations import equations, solution

    if reason := reason_to_refuse(mechanism):
        raise ValueError(f"{mechanism.name}: {reason}")
    if len(set(parameters)) < len(parameters):
        raise ValueError(f"{mechanism.name}: a parameter is named twice in {', '.join(parameters)}")
    p = ca.SX.sym("p", len(parameters))
    with_symbols, values = mechanism, []
    for k, name in enumerate(parameters):
        with_symbols, value = replace_number(with_symbols, name, p[k])
        values.append(value)
    e = equations(with_symbols)
    states = {"t": e.t, "q": e.q, "v": e.v}

    def function(name: str, inputs: str, **outputs: Any) -> Any:
        """Return a CasADi function whose arguments are the letters of `inputs`, such as "tqv", and p if there are parameters."""
        arguments = {x: states[x] for x in inputs} | ({"p": p} if parameters else {})
        return ca.Function(name, [*arguments.values()], [*outputs.values()], [*arguments], [*outputs])

    a, multipliers = solution(e)
    return Functions(
        function("acceleration", "tqv", a=a, multipliers=multipliers),
        function("residual", "tqv", phi=e.phi, phi_dot=e.c),
        function("jacobian", "tqv", J=e.J, gamma=e.gamma),
        function("mass_matrix", "q", M=ca.diag(e.mass)),
        function("forces", "qv", Q=e.Q),
        function("energy", "qv", energy=ca.dot(e.mass, e.v**2) / 2 + e.potential),
        tuple(parameters),
        tuple(values),
    )


def reason_to_refuse(mechanism: Mechanism) -> str | None:
    """Return the reason why CasADi cannot solve the equations in closed form here, or None if it can.

    Raises:
        TypeError: a force is of a kind that the function `loads` of `mechanism/model.py` cannot express.
    """
    if reason := unsteady(mechanism, "CasADi"):
        return reason
    loads(mechanism.forces)  # raises the TypeError
    if mechanism.has_friction:
        return "these equations do not support dry friction, which depends on the multipliers"
    if mechanism.redundant > 0:
        return f"redundant constraint rows ({mechanism.redundant}) make the equations singular"
    return None


def replace_number(mechanism: Mechanism, name: str, symbol: Any) -> tuple[Mechanism, float]:
    """Return the mechanism with a symbol in the place of one of its numbers, and this number.

    Args:
        name: name of the number, as in `functions`: TABLE.ITEM.FIELD, with .x or .y for a component, or gravity.x and gravity.y.

    Raises:
        ValueError: the mechanism has no number of that name.
    """
    table, _, rest = name.partition(".")
    if name in GRAVITY:
        return _replace_field(mechanism, name, symbol)
    owner, _, key = rest.partition(".")
    if key not in PARAMETERS.get(table, ()):
        raise ValueError(f"{mechanism.name}: no parameter {name!r}; see the documentation for the names")
    items = list(getattr(mechanism, table))
    for k, item in enumerate(items):
        value = getattr(item, key.partition(".")[0], None)
        # the `value` of a force at a point is a vector, or a list if a component is already a symbol; that of a torque is a number
        is_vector = isinstance(value, (list, np.ndarray))
        if item.name == owner and value is not None and is_vector == ("." in key):
            items[k], number = _replace_field(item, key, symbol)
            change: dict[str, Any] = {table: tuple(items)}
            return replace(mechanism, **change), number
    raise ValueError(f"{mechanism.name}: no parameter {name!r} in scenario {mechanism.scenario}")


def _replace_field(item: Any, key: str, symbol: Any) -> tuple[Any, float]:
    """Return a copy of a dataclass with a symbol in the field `key`, or in its component FIELD.x or .y, and the replaced number."""
    field, _, axis = key.partition(".")
    old = getattr(item, field)
    if not axis:
        return replace(item, **{field: symbol}), float(old)
    new, k = list(old), "xy".index(axis)
    new[k] = symbol
    return replace(item, **{field: new}), float(old[k])
