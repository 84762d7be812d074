"""What tells CasADi's releases apart beside the adapter's runs: linear solvers, further integrators, and the defaults.

The accelerations of the four-bar are those of the KKT system, solved by each linear solver that the release has.
"""

import re
from collections.abc import Callable
from typing import Any

import numpy as np

from gauss_bench.engines.bars import FOUR_BAR, GRAVITY
from gauss_bench.terms import Array

LINEAR = ("qr", "lsqr", "symbolicqr", "csparse", "lapacklu", "lapackqr", "mumps", "ma27")
INTEGRATORS = ("idas", "cvodes", "rk", "collocation")
ROOTS = ("newton", "fast_newton", "kinsol", "nlpsol")
FOUR = "wide_four_bar"
ROW = 5  # parts of a line of a table of options
PLUGINS = {"linear solver": ("Linsol", LINEAR), "integrator": ("Integrator", INTEGRATORS), "rootfinder": ("Rootfinder", ROOTS)}


def list_probes() -> list[dict[str, str]]:
    """List the probes: the KKT system of the four-bar, with every linear solver."""
    return [{"name": f"KKT system by {solver}", "model": FOUR} for solver in LINEAR]


def ask_probe(name: str, q: Array, v: Array) -> Array:
    """Return the absolute accelerations (k, n) of a probe at absolute states q, v (k, n)."""
    import casadi as ca

    solve = accelerations(ca, name.rpartition(" ")[2])
    return np.array([np.array(solve(*state))[:, 0] for state in zip(q, v, strict=True)])


def accelerations(ca: Any, solver: str) -> Callable[[Array, Array], Any]:
    """Return a function (q, v) -> accelerations (n,): M a + J^T lambda = Q, J a = -(J v)' v, derivatives by CasADi."""
    n = 3 * len(FOUR_BAR)
    q, v = ca.MX.sym("q", n), ca.MX.sym("v", n)
    masses = [x for bar in FOUR_BAR for x in (bar.mass, bar.mass, bar.inertia)]
    loads = [x for bar in FOUR_BAR for x in (0.0, bar.mass * GRAVITY, 0.0)]

    def pin(k: int, at: float) -> Any:
        """Return the place of a point at `at` [m] along a bar."""
        along = at - FOUR_BAR[k].centre
        return ca.vertcat(q[3 * k] + along * ca.cos(q[3 * k + 2]), q[3 * k + 1] + along * ca.sin(q[3 * k + 2]))

    gaps = [pin(1, FOUR_BAR[1].length) - pin(2, FOUR_BAR[2].length)]
    for k, bar in enumerate(FOUR_BAR):
        gaps.append(pin(k, 0.0) - (ca.DM([bar.at, 0.0]) if bar.parent < 0 else pin(bar.parent, bar.at)))
    phi = ca.vertcat(*gaps)
    J = ca.jacobian(phi, q)
    gamma = -ca.jtimes(J @ v, q, v)
    K = ca.blockcat([[ca.diag(ca.DM(masses)), J.T], [J, ca.MX(phi.shape[0], phi.shape[0])]])
    return ca.Function("a", [q, v], [ca.solve(K, ca.vertcat(ca.DM(loads), gamma), solver)[:n]])  # type: ignore[no-any-return]


def defaults() -> dict[str, str]:
    """Return the options of CasADi's integrators, solvers and functions with the values that their documentation gives."""
    import casadi as ca

    found: dict[str, str] = {}
    for kind, (loader, plugins) in PLUGINS.items():
        has = getattr(ca, f"has_{loader.lower()}", None)
        found |= {f"{kind} {x}": "there" for x in plugins if has and has(x)}
    for name in INTEGRATORS:
        found |= {f"{name} {option}": word for option, word in read_options(ca, name).items()}
    return found | spend(ca)


def read_options(ca: Any, name: str) -> dict[str, str]:
    """Return option -> its type, and its default where the documentation that is compiled into the library tells one."""
    try:
        text = str(ca.doc_integrator(name))
    except RuntimeError:
        return {}
    words: dict[str, str] = {}
    kinds: dict[str, str] = {}
    option = ""
    for line in text.splitlines():
        cells = [x.strip() for x in line.split("|")]
        if len(cells) != ROW:
            continue
        if cells[2].startswith("OT_"):
            option = cells[1]
            kinds[option] = cells[2]
        words[option] = f"{words.get(option, '')} {cells[3]}"
    defaults = {x: re.search(r"\[default: *([^\]]*)\]", words[x]) for x in kinds}
    return {x: f"{kind} {found[1]}" if (found := defaults[x]) else kind for x, kind in kinds.items()}


def spend(ca: Any) -> dict[str, str]:
    """Return the steps and evaluations that integrators spend on a stiff oscillator where nothing is set: what defaults do."""
    x = ca.SX.sym("x", 2)
    ode = ca.vertcat(x[1], 10.0 * (1 - x[0] ** 2) * x[1] - x[0])
    found: dict[str, str] = {}
    for name in ("cvodes", "idas"):
        integrator = ca.integrator("f", name, {"x": x, "ode": ode}, 0.0, [5.0])
        integrator(x0=[2.0, 0.0])
        counts = integrator.stats()
        found |= {f"{name} without options, {key}": str(counts[key]) for key in ("nsteps", "nfevals") if key in counts}
    return found
