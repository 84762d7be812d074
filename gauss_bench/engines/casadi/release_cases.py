"""Cases that compare CasADi's releases beyond the adapter's runs: linear solvers, integrators, and default options.

Each linear solver of a release solves the KKT system of the four-bar for its accelerations.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gauss_bench.engines.bars import FOUR_BAR, GRAVITY
from gauss_bench.terms import Array

LINEAR = ("qr", "lsqr", "symbolicqr", "csparse", "lapacklu", "lapackqr", "mumps", "ma27")
SUNDIALS = {"abstol": 1e-8, "reltol": 1e-6, "max_num_steps": 10000, "max_multistep_order": 5, "newton_scheme": "direct"}
STEPS = {"number_of_finite_elements": 20}
ASSUMED: dict[str, dict[str, Any]] = {  # integrator -> option -> the default that is expected
    "cvodes": SUNDIALS | {"linear_multistep_method": "bdf", "nonlinear_solver_iteration": "newton"},
    "idas": SUNDIALS | {"suppress_algebraic": False, "cj_scaling": False},
    "rk": STEPS,
    "collocation": STEPS | {"interpolation_order": 3, "collocation_scheme": "radau"},
}
ROOTS = ("newton", "fast_newton", "kinsol", "nlpsol")
FOUR = "wide_four_bar"
# kind of plugins -> CasADi's name of the kind, and names of plugins
PLUGINS = {"linear solver": ("Linsol", LINEAR), "integrator": ("Integrator", tuple(ASSUMED)), "rootfinder": ("Rootfinder", ROOTS)}


def list_probes() -> list[dict[str, str]]:
    """List the cases: the KKT system of the four-bar with every linear solver; each has a name and the name of its linkage."""
    return [{"name": f"KKT system by {solver}", "model": FOUR} for solver in LINEAR]


def ask_probe(name: str, q: Array, v: Array) -> Array:
    """Return the absolute accelerations (k, n) of the four-bar at states q, v (k, n) by a linear solver of CasADi.

    Args:
        name: name of a case of `list_probes`, whose last word is the linear solver.
    """
    import casadi as ca

    solver = name.rpartition(" ")[2]
    if not ca.has_linsol(solver):
        raise RuntimeError(f"CasADi {ca.CasadiMeta.version()} has no linear solver {solver}")
    solve = make_accelerations(ca, solver)
    return np.array([np.array(solve(*state))[:, 0] for state in zip(q, v, strict=True)])


def make_accelerations(ca: Any, solver: str) -> Callable[[Array, Array], Any]:
    """Return a CasADi function (q, v) -> accelerations (n,) of the four-bar FOUR_BAR, in absolute coordinates x, y, angle per bar.

    It solves M a + J^T lambda = Q, J a = -(d(J v)/dq) v by CasADi's linear solver `solver`; CasADi computes the derivatives.
    """
    n = 3 * len(FOUR_BAR)
    q, v = ca.MX.sym("q", n), ca.MX.sym("v", n)
    masses = [x for bar in FOUR_BAR for x in (bar.mass, bar.mass, bar.inertia)]
    loads = [x for bar in FOUR_BAR for x in (0.0, bar.mass * GRAVITY, 0.0)]

    def place_on_bar(k: int, distance: float) -> Any:
        """Return the position (2,) of the point of bar k at a distance [m] from the bar's first pin."""
        along = distance - FOUR_BAR[k].centre
        return ca.vertcat(q[3 * k] + along * ca.cos(q[3 * k + 2]), q[3 * k + 1] + along * ca.sin(q[3 * k + 2]))

    gaps = [place_on_bar(1, FOUR_BAR[1].length) - place_on_bar(2, FOUR_BAR[2].length)]
    for k, bar in enumerate(FOUR_BAR):
        on_parent = ca.DM([bar.at, 0.0]) if bar.parent < 0 else place_on_bar(bar.parent, bar.at)
        gaps.append(place_on_bar(k, 0.0) - on_parent)
    phi = ca.vertcat(*gaps)
    J = ca.jacobian(phi, q)
    gamma = -ca.jtimes(J @ v, q, v)
    K = ca.blockcat([[ca.diag(ca.DM(masses)), J.T], [J, ca.MX(phi.shape[0], phi.shape[0])]])
    return ca.Function("a", [q, v], [ca.solve(K, ca.vertcat(ca.DM(loads), gamma), solver)[:n]])  # type: ignore[no-any-return]


def defaults() -> dict[str, str]:
    """Return name -> finding for the plugins and default options of the installed release of CasADi.

    For each available plugin the finding is "there". For each option of an integrator it is "acts as X" if a run without the option
    equals a run with the option's value X in ASSUMED, and otherwise "acts otherwise than X". A further finding for each integrator
    is its number of steps and of evaluations, if it counts them.
    """
    import casadi as ca

    found: dict[str, str] = {}
    for kind, (loader, plugins) in PLUGINS.items():
        has = getattr(ca, f"has_{loader.lower()}", None)
        found |= {f"{kind} {x}": "there" for x in plugins if has and has(x)}
    for name, options in ASSUMED.items():
        plain = integrate(ca, name, {})
        if plain[0]:
            found[f"{name} without options, steps and evaluations"] = " ".join(map(str, plain[0]))
        for option, value in options.items():
            same = integrate(ca, name, {option: value}) == plain
            found[f"{name} {option}"] = f"acts as {value}" if same else f"acts otherwise than {value}"
    return found


def integrate(ca: Any, name: str, options: dict[str, Any]) -> tuple[list[int], list[float]]:
    """Integrate van der Pol's oscillator over 5 s; return the counts of steps and evaluations, and the state (2,) at the end.

    Runs show the defaults. CasADi's built-in documentation does not: before 3.7 it is that of much older releases.
    """
    x = ca.SX.sym("x", 2)
    ode = ca.vertcat(x[1], (1 - x[0] ** 2) * x[1] - x[0])
    integrator = ca.integrator("f", name, {"x": x, "ode": ode}, 0.0, [5.0], options)
    end = np.array(integrator(x0=[2.0, 0.0])["xf"])[:, 0].tolist()
    counts = integrator.stats()
    return [int(counts[key]) for key in ("nsteps", "nfevals") if key in counts], end
