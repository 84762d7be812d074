"""Two linkages by equations derived on paper, in C: the code of an expert who has one linkage and wants it fast.

The derivations are `crank_slider.c` and `four_bar.c`: the loop is closed by trigonometry, then Lagrange's equation is written in
the angle of the crank, the one degree of freedom. They use no generated code. They cover these two kinds of loops and the loads
that `loops.py` names; every other linkage is refused. Each model is compared with the linkage before it is used. The velocities and
accelerations of the other links follow from those of the crank by the linkage's constraint rows.
"""

import ctypes
from pathlib import Path

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.by_hand.loops import Loop, Underived, loop_of
from gauss_bench.engines.c_code import FLAGS, NO_COMPILER, Code, CompiledSteps, compiler
from gauss_bench.engines.following import follow, wind
from gauss_bench.engines.shared import finite_acceleration, require_agreement, size, unsteady
from gauss_bench.formulations.gauss import gauss
from gauss_bench.mechanism.coordinates import position, rotate
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import angle_at, angle_slot, places
from gauss_bench.terms import Array

FOLDER = Path(__file__).parent
SETTINGS = {"default": {"compiler_flags": " ".join(FLAGS)}}
AGREEMENT = 1e-9  # relative: rounding and the closure of the start leave 1e-13, a wrong term about 1
CHECKED = 0.3  # [rad] crank angle between the states that are compared


class ByHand:
    """The engine."""

    name = "by_hand"
    integrators = ("rk4", "dop853_fixed")
    stabilizations = ("none",)
    settings = SETTINGS
    resizable = True  # a model takes another step
    native_loop = True
    python_loop = False

    def version(self) -> str:
        return f"C by {compiler()}" if compiler() else NO_COMPILER

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        if reason := unsteady(mechanism, "the derivation by hand"):
            return reason
        try:
            loop_of(mechanism)
        except Underived as reason:
            return str(reason)
        return None if compiler() else NO_COMPILER

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return ""

    def build(self, mechanism: Mechanism, choice: Choice) -> "ByHandModel":
        return ByHandModel(mechanism, loop_of(mechanism), choice)


class ByHandModel(CompiledSteps):
    """A linkage in the angle of its crank alone."""

    note = "one coordinate, derived by hand, in C"

    def __init__(self, mechanism: Mechanism, loop: Loop, choice: Choice):
        self.mechanism, self.loop, self.choice, self.evaluator = mechanism, loop, choice, Evaluator(mechanism)
        numbers = "\n".join(f"static const double {name} = {float(value)!r};" for name, value in loop.numbers.items())
        self.code = Code(f"{numbers}\n{(FOLDER / loop.source).read_text(encoding='utf-8')}", 1)
        self.crank = angle_slot(loop.links[0])
        self.start = np.array([mechanism.q0[self.crank] + loop.lines[0]]), mechanism.v0[[self.crank]]
        self._verify()

    def _verify(self) -> None:
        """Compare the derivation with the linkage at the start and at a crank angle on either side.

        Raises:
            RunFailure: accelerations, joints or the start differ.
        """
        th, w = self.start
        for turn, rate in ((0.0, w), (-CHECKED, np.ones(1)), (CHECKED, -10.0 * np.ones(1))):
            (q,), (v,), (a,) = self.motion(np.zeros(1), th[None] + turn, rate[None])
            if not np.isfinite(q).all():
                continue  # the crank does not reach this angle
            terms = self.evaluator.terms(0.0, q, v)
            pairs = {"accelerations": (a, gauss(terms).a, size(a)), "joints": (terms.phi, 0 * terms.phi, 1.0)}
            if turn == 0.0:
                pairs["start"] = (q, self.mechanism.q0, size(q))
            require_agreement(pairs, AGREEMENT)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        a = self.motion(np.array([t]), q[None, [self.crank]] + self.loop.lines[0], v[None, [self.crank]])[2][0]
        return finite_acceleration(t, a, "the derivation by hand")

    def advance(self, x: Array, dx: Array, t: float, h: float, count: int) -> None:
        self.code.step(self.choice.integrator, x, dx, t, h, count)

    def motion(self, t: Array, x: Array, dx: Array) -> tuple[Array, Array, Array]:
        q = self._place(x[:, 0])
        second = np.array([self.code.acceleration(0.0, *state)[0] for state in zip(x, dx, strict=True)])
        v = self._solve(q, np.zeros_like(q), dx[:, 0])[0]
        return q, v, self._solve(q, v, second)[1]

    def _solve(self, q: Array, v: Array, given: Array) -> tuple[Array, Array]:
        """Solve J x = 0 and J x = gamma for all links, x (k, n) each, given the crank's rate or second rate (k,)."""
        rows = self.evaluator.constraints(0.0, q, v)
        crank = np.broadcast_to(np.eye(self.mechanism.n)[self.crank], (len(q), 1, self.mechanism.n))
        right = np.stack([0 * rows.gamma, rows.gamma], axis=-1)
        ends = np.stack([given, given], axis=-1)[:, None]
        found = np.linalg.solve(np.concatenate([rows.J, crank], axis=1), np.concatenate([right, ends], axis=1))
        return found[..., 0], found[..., 1]

    def _place(self, th: Array) -> Array:
        """Return q (k, n) at crank angles (k,), placing each link at the pin that joins it to the one before."""
        loop, q = self.loop, np.zeros((len(th), self.mechanism.n))
        angles = self._angles(th)
        for link, angle, (before, pin) in zip(loop.links, wind(angles, self._followed(th)).T, loop.pins, strict=True):
            q[:, angle_slot(link)] = angle
            places(q)[:, link] = position(q, before) - rotate(pin.local, angle)
        return q

    def _angles(self, th: Array) -> Array:
        """Return the angles (k, 3) [rad] of the links at crank angles (k,), up to whole turns except for the crank."""
        lines, out = np.empty((len(th), 3)), np.zeros(2)
        for row, x in zip(lines, th, strict=True):
            self.code.library.told(ctypes.c_double(x), ctypes.c_void_p(out.ctypes.data))
            row[:] = x, *out
        return lines - self.loop.lines

    def _followed(self, th: Array) -> Array:
        start = np.array([angle_at(self.mechanism.q0, link) for link in self.loop.links])
        return follow(self._angles, float(self.start[0][0]), th, start)
