"""The engine `by_hand`: equations of two kinds of linkage, derived on paper and written in C, as an expert would do for speed.

In `crank_slider.c` and `four_bar.c`, trigonometry closes the loop, and Lagrange's equation is written in the angle of the crank,
the only degree of freedom. The head of `loops.py` names the loads that the equations include. The velocities and accelerations of
the other links follow from those of the crank by the constraint equations J v = 0 and J a = gamma.
"""

import ctypes
from functools import partial
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
AGREEMENT = 1e-9  # relative: rounding and the closure of the start cause about 1e-13, a wrong term about 1
CHECKED = 0.3  # [rad] the model is checked at the start and at crank angles that differ from the start by this angle


class ByHand:
    """Equations derived on paper, for crank-sliders and four-bars."""

    name = "by_hand"
    integrators = ("rk4", "dop853_fixed")
    stabilizations = ("none",)
    settings = SETTINGS
    resizable = True  # a built model can run with another step
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
    """The model of a linkage in one coordinate, the angle of the line between the crank's two pins.

    This angle is that of the crank's frame plus `loop.lines[0]`.
    """

    note = "one coordinate, derived by hand, in C"

    def __init__(self, mechanism: Mechanism, loop: Loop, choice: Choice):
        """Compile the C file of a loop with the loop's numbers as constants, and compare the result with the linkage."""
        self.mechanism, self.loop, self.choice, self.evaluator = mechanism, loop, choice, Evaluator(mechanism)
        numbers = "\n".join(f"static const double {name} = {float(value)!r};" for name, value in loop.numbers.items())
        self.code = Code(f"{numbers}\n{(FOLDER / loop.source).read_text(encoding='utf-8')}", n=1)
        self.advance = partial(self.code.step, choice.integrator)
        self.crank = angle_slot(loop.links[0])
        # crank angle (1,) [rad] of the line between the crank's pins, and crank speed (1,) [rad/s]
        self.start = np.array([mechanism.q0[self.crank] + loop.lines[0]]), mechanism.v0[[self.crank]]
        self._verify()

    def _verify(self) -> None:
        """Compare the equations derived by hand with the suite's, at the start and at crank angles CHECKED [rad] from the start.

        Each entry of `pairs` is (value, expected value, scale of the difference). The crank speeds 1 and -10 rad/s are arbitrary.
        """
        angle, speed = self.start
        for turn, rate in ((0.0, speed), (-CHECKED, np.ones(1)), (CHECKED, -10.0 * np.ones(1))):
            (q,), (v,), (a,) = self.motion(np.zeros(1), angle[None] + turn, rate[None])
            if not np.isfinite(q).all():
                continue  # the crank cannot reach this angle
            terms = self.evaluator.terms(0.0, q, v)
            pairs = {"accelerations": (a, gauss(terms).a, size(a)), "joints": (terms.phi, 0 * terms.phi, 1.0)}
            if turn == 0.0:
                pairs["start"] = (q, self.mechanism.q0, size(q))
            require_agreement(pairs, AGREEMENT)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the accelerations (n,) of all links at the crank's angle and speed in q, v (n,)."""
        _, _, a = self.motion(np.array([t]), q[None, [self.crank]] + self.loop.lines[0], v[None, [self.crank]])
        return finite_acceleration(t, a[0], "the derivation by hand")

    def motion(self, t: Array, x: Array, dx: Array) -> tuple[Array, Array, Array]:
        """Return q, v, a (k, n) of all links at crank angles x (k, 1) and speeds dx (k, 1)."""
        q = self._place_links(x[:, 0])
        crank_accelerations = np.array([self.code.acceleration(0.0, *state)[0] for state in zip(x, dx, strict=True)])
        # J v = 0 and the crank's speed determine v; then J a = gamma(q, v) and the crank's acceleration determine a
        at_rest = self.evaluator.constraints(0.0, q, np.zeros_like(q))
        v = self._solve(at_rest.J, 0 * at_rest.gamma, dx[:, 0])
        moving = self.evaluator.constraints(0.0, q, v)
        return q, v, self._solve(moving.J, moving.gamma, crank_accelerations)

    def _solve(self, J: Array, right: Array, crank: Array) -> Array:
        """Solve the n equations J x = right (k, m = n - 1) and x_c = crank (k,), where x_c is the entry of the crank's angle in x.

        Return x (k, n): velocities or accelerations of all links.
        """
        crank_row = np.broadcast_to(np.eye(self.mechanism.n)[self.crank], (len(J), 1, self.mechanism.n))
        right = np.concatenate([right, crank[:, None]], axis=1)
        return np.asarray(np.linalg.solve(np.concatenate([J, crank_row], axis=1), right[..., None])[..., 0])

    def _place_links(self, th: Array) -> Array:
        """Return q (k, n) at crank angles th (k,): each link is placed at its pin with the previous link of the chain."""
        loop, q = self.loop, np.zeros((len(th), self.mechanism.n))
        start_angles = np.array([angle_at(self.mechanism.q0, link) for link in loop.links])
        # `_angles` gives exact angles up to whole turns, and `wind` adds the turns that bring them nearest to continuous ones
        unwrapped = wind(self._angles(th), follow(self._angles, float(self.start[0][0]), th, start_angles))  # (k, 3)
        for link, angle, pin in zip(loop.links, unwrapped.T, loop.pins, strict=True):
            # the pin's point on the previous link is placed already; the pin's point on this link must coincide with it
            q[:, angle_slot(link)] = angle
            places(q)[:, link] = position(q, pin.before) - rotate(pin.own.local, angle)
        return q

    def _angles(self, th: Array) -> Array:
        """Return the link angles (k, 3) [rad] at crank angles th (k,); those of the second and third link up to whole turns."""
        lines, others = np.empty((len(th), 3)), np.zeros(2)
        for row, x in zip(lines, th, strict=True):
            self.code.library.line_angles(ctypes.c_double(x), ctypes.c_void_p(others.ctypes.data))
            row[:] = x, *others
        # the C code gives the angles of the lines from pin to pin; loop.lines are the angles of these lines in the links' frames
        return lines - self.loop.lines
