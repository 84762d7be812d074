"""A linkage as casadi.Function objects, which a user of CasADi can evaluate, differentiate, save or turn into C code."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gauss_bench.engines.shared import unsteady
from gauss_bench.mechanism.model import Mechanism, loads


@dataclass(frozen=True, eq=False)
class Functions:
    """The equations M a + J^T lambda = Q subject to J a = gamma in absolute coordinates q = [x, y, theta] of every link (SI units).

    If parameters were left open, every function takes them, p (k,), as its last argument.

    Attributes:
        acceleration: (t, q, v) -> a (n,), multipliers (m,).
        residual: (t, q, v) -> phi (h,), phi_dot (m,); knife edges have a phi_dot but no phi, and come last.
        jacobian: (t, q, v) -> J (m, n), gamma (m,).
        mass_matrix: (q) -> M (n, n).
        forces: (q, v) -> Q (n,).
        energy: (q, v) -> kinetic plus potential energy.
        parameters: names of the entries of p, in order.
        values: (k,) their values in the linkage file.
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
        mechanism: a linkage in one scenario, as `gauss_bench.linkage.load.load` returns it.
        parameters: numbers left open, by name: gravity.x, gravity.y, links.LINK.mass, links.LINK.inertia, forces.FORCE.value (or
            .value.x, .value.y), forces.FORCE.k, .c, .rest and joints.SLIDE.offset.

    Raises:
        ImportError: the extra 'casadi' is not installed.
        ValueError: the linkage does not have a parameter, a parameter is named twice, or the linkage has dry friction or redundant
            rows, whose multipliers are not unique.
    """
    import casadi as ca

    from gauss_bench.engines.casadi.equations import equations, solution

    if reason := unfit(mechanism):
        raise ValueError(f"{mechanism.name}: {reason}")
    if len(set(parameters)) < len(parameters):
        raise ValueError(f"{mechanism.name}: a parameter is named twice in {', '.join(parameters)}")
    p = ca.SX.sym("p", len(parameters))
    opened, values = mechanism, []
    for k, name in enumerate(parameters):
        opened, number = put(opened, name, p[k])
        values.append(number)
    e = equations(opened)
    states = {"t": e.t, "q": e.q, "v": e.v}

    def function(name: str, inputs: str, **outputs: Any) -> Any:
        symbols = [states[x] for x in inputs] + ([p] if parameters else [])
        return ca.Function(name, symbols, [*outputs.values()], [*inputs, *(["p"] if parameters else [])], [*outputs])

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


def unfit(mechanism: Mechanism) -> str | None:
    """Return why the equations have no closed solution, or None if they have one.

    Raises:
        TypeError: a force is of a kind that cannot be expressed by loads.
    """
    if reason := unsteady(mechanism, "CasADi"):
        return reason
    loads(mechanism.forces)
    if mechanism.has_friction:
        return "dry friction follows from the multipliers, and these equations do not hold it"
    if mechanism.redundant > 0:
        return f"redundant constraint rows ({mechanism.redundant}) leave the multipliers open, and the equations singular"
    return None


def put(mechanism: Mechanism, name: str, symbol: Any) -> tuple[Mechanism, float]:
    """Replace one number of a mechanism by a symbol; return the new mechanism and the number.

    Raises:
        ValueError: the mechanism has no such number.
    """
    fields = {
        "gravity": ("x", "y"),
        "links": ("mass", "inertia"),
        "forces": ("value", "value.x", "value.y", "k", "c", "rest"),
        "joints": ("offset",),
    }
    table, _, rest = name.partition(".")
    owner, _, key = ("", "", rest) if table == "gravity" else rest.partition(".")
    if key not in fields.get(table, ()):
        raise ValueError(f"{mechanism.name}: no parameter {name!r}; see the documentation for the names")
    field, _, axis = (table, "", key) if table == "gravity" else key.partition(".")
    owners = [mechanism] if table == "gravity" else [x for x in getattr(mechanism, table) if x.name == owner]
    for item in owners:
        old = getattr(item, field, None)
        if old is not None and bool(axis) == isinstance(old, (list, np.ndarray)):
            new, number = _entry(old, axis, symbol) if axis else (symbol, float(old))
            change: dict[str, Any] = {field: new}
            changed = replace(item, **change)
            if item is mechanism:
                return changed, number
            change = {table: tuple(changed if x is item else x for x in getattr(mechanism, table))}
            return replace(mechanism, **change), number
    raise ValueError(f"{mechanism.name}: no parameter {name!r} in scenario {mechanism.scenario}")


def _entry(pair: Any, axis: str, symbol: Any) -> tuple[list[Any], float]:
    k = "xy".index(axis)
    return [symbol if i == k else x for i, x in enumerate(pair)], float(pair[k])
