"""Equations that are derived by hand, compiled and run, where a C compiler is found.

The state is the crank's angle th and its rate w; with x any coordinate of the linkage, x' and x'' its derivatives by th,

    q = x(th),    v = x' w,    a = x' w' + x'' w^2

Before a run, accelerations at states along the motion are compared with the linkage's own, so that no derivation is believed.
"""

import ctypes
from pathlib import Path

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.by_hand.loops import Loop, Underived, loop_of
from gauss_bench.engines.c_code import FLAGS, NO_COMPILER, Code, compiler
from gauss_bench.engines.shared import finite, finite_acceleration, require_agreement, size, unsteady
from gauss_bench.formulations.gauss import gauss
from gauss_bench.integrate.fixed_step import EVALUATIONS, step_counts
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory

FOLDER = Path(__file__).parent
SETTINGS = {"default": {"compiler_flags": " ".join(FLAGS)}}
AGREEMENT = 1e-9  # relative: rounding and the closure of the start leave 1e-13, a wrong term about 1
TABLE = 721  # places of a turn: links turn by far less than half a turn from one to the next
CHECKED = 0.3  # [rad] between states of the comparison


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


class ByHandModel:
    """A linkage in the angle of its crank alone."""

    def __init__(self, mechanism: Mechanism, loop: Loop, choice: Choice):
        self.mechanism, self.loop, self.choice = mechanism, loop, choice
        numbers = "\n".join(f"static const double {name} = {float(value)!r};" for name, value in loop.numbers.items())
        self.code = Code(f"{numbers}\n{(FOLDER / loop.source).read_text(encoding='utf-8')}", 1)
        crank = 3 * loop.links[0] + 2
        self.start = np.array([mechanism.q0[crank] + loop.lines[0]]), np.array([mechanism.v0[crank]])
        self._follow()
        self._verify()

    def _verify(self) -> None:
        """Compare with the linkage.

        Raises:
            RunFailure: they differ.
        """
        evaluator, th, w = Evaluator(self.mechanism), float(self.start[0][0]), float(self.start[1][0])
        for turn, rate in ((0.0, w), (-CHECKED, 1.0), (CHECKED, -10.0)):
            q, v, a = self._absolute(np.array([th + turn]), np.array([rate]))
            if not np.isfinite(q).all():
                continue  # the crank does not reach so far
            terms = evaluator.terms(0.0, q[0], v[0])
            pairs = {"accelerations": (a[0], gauss(terms).a, size(a[0])), "joints": (terms.phi, 0 * terms.phi, 1.0)}
            if turn == 0.0:
                pairs["start"] = (q[0], self.mechanism.q0, size(q[0]))
            require_agreement(pairs, AGREEMENT)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        crank = 3 * self.loop.links[0] + 2
        a = self._absolute(q[[crank]] + self.loop.lines[0], v[[crank]])[2][0]
        return finite_acceleration(t, a, "the derivation by hand")

    def _absolute(self, th: Array, w: Array) -> tuple[Array, Array, Array]:
        """q, v, a (k, 9) in absolute coordinates at crank angles and rates (k,)."""
        told = np.array([self._tell(x) for x in th])
        turn = np.array([self.code.acceleration(0.0, np.array([x]), np.array([y]))[0] for x, y in zip(th, w, strict=True)])
        loop, places = self.loop, np.zeros((len(th), 9, 3))
        for k, link in enumerate(loop.links):
            x, y, angle = (places[:, 3 * link + i] for i in range(3))
            angle[:] = told[:, 3 * k : 3 * k + 3] if not (loop.slides and k == 2) else 0.0
            angle[:, 0] += self.mechanism.q0[3 * link + 2] if loop.slides and k == 2 else -loop.lines[k]
            if k == 1 or (loop.slides and k == 2):
                at = 9 if k == 1 else 15
                x[:], y[:] = told[:, at : at + 3], told[:, at + 3 : at + 6]
                x[:, 0], y[:, 0] = x[:, 0] + loop.arms[k, 0], y[:, 0] + loop.arms[k, 1]
                continue
            c, s = np.cos(angle[:, 0]), np.sin(angle[:, 0])
            arm = loop.arms[k] @ np.array([[c, s], [-s, c]]).transpose(2, 0, 1)
            p, pp = angle[:, 1], angle[:, 2]
            x[:] = np.stack([loop.pivots[k, 0] + arm[:, 0], -p * arm[:, 1], -pp * arm[:, 1] - p * p * arm[:, 0]], axis=-1)
            y[:] = np.stack([loop.pivots[k, 1] + arm[:, 1], p * arm[:, 0], pp * arm[:, 0] - p * p * arm[:, 1]], axis=-1)
        q, d, dd = (places[:, :, i] for i in range(3))
        for k in (1, 2):
            angle = q[:, 3 * loop.links[k] + 2]
            angle += 2 * np.pi * np.round((self._followed(th, k) - angle) / (2 * np.pi))
        return q, d * w[:, None], d * turn[:, None] + dd * (w * w)[:, None]

    def _followed(self, th: Array, k: int) -> Array:
        """Roughly the angle (k,) of the second or third link, followed from the start over as many turns as the crank makes."""
        turns = np.floor((th - self.turn[0]) / (2 * np.pi))
        return np.asarray(np.interp(th - 2 * np.pi * turns, self.turn, self.angles[k]) + 2 * np.pi * turns * self.winding[k])

    def _follow(self) -> None:
        """Tabulate the angles of all links over a turn of the crank, or over that part of it which the loop allows."""
        th = float(self.start[0][0])
        self.turn = np.linspace(th, th + 2 * np.pi, TABLE)
        lines = np.array([self._tell(x)[[0, 3, 6]] for x in self.turn])
        lines[~np.isfinite(lines)] = 0.0
        self.angles, at_start = np.unwrap(lines, axis=0).T, self.mechanism.q0[[3 * link + 2 for link in self.loop.links]]
        self.winding = np.round((self.angles[:, -1] - self.angles[:, 0]) / (2 * np.pi))
        self.angles += (at_start - self.angles[:, 0])[:, None]

    def _tell(self, th: float) -> Array:
        out = np.zeros(21)
        self.code.library.told(ctypes.c_double(th), ctypes.c_void_p(out.ctypes.data))
        return out

    def prepare(self, times: Array, native: bool = True) -> None:
        """There is only the compiled loop, whatever `native` says."""
        self.times, self.plan = times, step_counts(times, self.choice.step)
        self.th, self.w = np.full((2, len(times), 1), np.nan)
        self.th[0], self.w[0] = self.start

    def run(self) -> None:
        for k, (count, h) in enumerate(self.plan):
            self.th[k + 1], self.w[k + 1] = self.th[k], self.w[k]
            self.code.step(self.choice.integrator, self.th[k + 1], self.w[k + 1], float(self.times[k]), h, count)

    def read(self) -> Trajectory:
        reached = slice(finite(self.th, self.w))
        q, v, a = np.full((3, len(self.times), self.mechanism.n), np.nan)
        q[reached], v[reached], a[reached] = self._absolute(self.th[reached, 0], self.w[reached, 0])
        steps = sum(count for count, _ in self.plan)
        return Trajectory(
            self.times, q, v, a, steps, EVALUATIONS[self.choice.integrator] * steps, "one coordinate, derived by hand, in C"
        )
