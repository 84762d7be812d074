"""Integration with steps of fixed size: CasADi gives the accelerations in closed form, as generated C or in its virtual machine.

The virtual machine is used if a variant asks for it, or if there is no C compiler. The note of a run tells which was used.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.c_code import NO_COMPILER, Advance, Code, CompiledSteps, compiler
from gauss_bench.engines.shared import finite_acceleration
from gauss_bench.integrate.fixed_step import tableau
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

GENERATED = "generated C"
CHUNK = 500  # steps in one call of the virtual machine: enough to make the cost of the call negligible


class EqualSteps(CompiledSteps):
    """A mechanism whose accelerations CasADi computes, integrated with steps of fixed size.

    Attributes:
        plain: CasADi function (t, q, v) -> accelerations (n,) that are reported, without Baumgarte's terms.
        integrated: CasADi function (t, q, v) -> accelerations (n,) that are integrated, with Baumgarte's terms if chosen.
        advance: function (q, v, t, size, count) that takes `count` steps of `size` [s] and overwrites q and v (n,).
    """

    def __init__(self, mechanism: Mechanism, choice: Choice, options: Mapping[str, Any]):
        """Write the accelerations as CasADi functions, and the steps in generated C or for CasADi's virtual machine."""
        import casadi

        from gauss_bench.engines.casadi.equations import equations, solution, stabilize

        self.ca: Any = casadi
        self.mechanism, self.choice, self.start = mechanism, choice, (mechanism.q0, mechanism.v0)
        e = equations(mechanism)
        self.plain = casadi.Function("plain", [e.t, e.q, e.v], [solution(e)[0]])
        if choice.stabilization == "baumgarte":
            e = stabilize(e, options["baumgarte_alpha_beta_per_s"])
        self.integrated = casadi.Function("integrated", [e.t, e.q, e.v], [solution(e)[0]])
        generated = options["code"] == GENERATED and compiler() is not None
        self.advance = self._compile_steps() if generated else self._interpret_steps()
        self.note = "CasADi's generated C" if generated else "CasADi's virtual machine"
        if options["code"] == GENERATED and not generated:
            self.note += f": {NO_COMPILER}"

    def _compile_steps(self) -> Advance:
        """Return the function `advance`, compiled from the C code that CasADi generates for the function `integrated`."""
        generator = self.ca.CodeGenerator("engine")
        generator.add(self.integrated)
        f, n = self.integrated, self.mechanism.n
        # CasADi's C functions take arrays of pointers to inputs and outputs, and two work arrays; C has no arrays of length 0
        call = f"""
static void acceleration(double t, const double *q, const double *v, double *a)
{{
    const double *in[{f.sz_arg()}] = {{&t, q, v}};
    double *out[{f.sz_res()}] = {{a}}, work[{max(1, f.sz_w())}];
    casadi_int integers[{max(1, f.sz_iw())}];
    integrated(in, out, integers, work, 0);
}}
"""
        return partial(Code(generator.dump() + call, n).step, self.choice.integrator)

    def _interpret_steps(self) -> Advance:
        """Return the function `advance`, which runs in CasADi's virtual machine."""
        ca, n = self.ca, self.mechanism.n
        x, h = ca.SX.sym("x", 2 * n + 1), ca.SX.sym("h")  # x is q, v, t
        step = ca.Function("step", [x, h], [self._step(x, h)])
        chains: dict[int, Any] = {}  # number of steps -> function that takes this number of steps

        def advance(q: Array, v: Array, t: float, size: float, count: int) -> None:
            """Take `count` steps of `size` [s], at most CHUNK of them in one call, and overwrite q and v (n,)."""
            state = np.concatenate([q, v, [t]])
            while count:
                chunk = min(count, CHUNK)
                if chunk not in chains:
                    chains[chunk] = step.mapaccum(f"steps{chunk}", chunk)
                state = np.array(chains[chunk](state, np.full((1, chunk), size)))[:, -1]
                count -= chunk
            q[:], v[:] = state[:n], state[n : 2 * n]

        return advance

    def _step(self, x: Any, h: Any) -> Any:
        """Return CasADi's expression for the state [q, v, t] after one Runge-Kutta step of h [s] from the state x = [q, v, t]."""
        n = self.mechanism.n

        def rate(x: Any) -> Any:
            """Return dx/dt = [v, a, 1]."""
            return self.ca.vertcat(x[n : 2 * n], self.integrated(x[2 * n], x[:n], x[n : 2 * n]), 1)

        # the nodes are not needed, because x includes the time; 0 * x is the zero from which a sum of stages starts
        _, rows, weights = tableau(self.choice.integrator)
        rates: list[Any] = []
        for row in rows:
            rates.append(rate(x + h * sum((c * k for c, k in zip(row, rates, strict=True)), 0 * x)))
        return x + h * sum((c * k for c, k in zip(weights, rates, strict=True)), 0 * x)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return finite_acceleration(t, np.array(self.plain(t, q, v))[:, 0], "CasADi")

    def motion(self, t: Array, x: Array, dx: Array) -> tuple[Array, Array, Array]:
        return x, dx, np.array(self.plain.map(len(t))(t, x.T, dx.T)).T
