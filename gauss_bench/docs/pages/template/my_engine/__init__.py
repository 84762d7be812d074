"""Heun's method on Lagrange's equations: an engine for gauss_bench."""

from typing import ClassVar

import numpy as np

from gauss_bench.formulations.lagrange import lagrange
from gauss_bench.integrate.fixed_step import step_counts
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.trajectory import RunFailure, Status, Trajectory


class Heun:
    """An engine: its name, its choices, and the linkages that it refuses."""

    name = "heun"
    integrators = ("heun",)
    stabilizations = ("none",)
    settings: ClassVar = {"default": {}}  # label -> the library's options, printed in full in every report
    native_loop = False  # whether run() never returns to Python between steps
    python_loop = True

    def version(self):
        """Return the version of the library, for the report."""
        return "my_engine 0.1"

    def skip(self, mechanism, choice):
        """Return why this linkage cannot be run with this choice, or None; an engine must refuse what it would compute wrongly."""
        if mechanism.has_friction or mechanism.redundant:
            return "neither dry friction nor redundant rows are modelled here"
        return None

    def build(self, mechanism, choice):
        """Return the model of the linkage in the library."""
        return Model(mechanism, choice)


class Model:
    """A linkage in the engine. States q, v, a have x, y [m] and angle [rad] of each link, in shape (n,) with n = 3 * links."""

    def __init__(self, mechanism, choice):
        self.mechanism, self.choice, self.evaluator = mechanism, choice, Evaluator(mechanism)

    def acceleration(self, t, q, v):
        """Return the accelerations (n,) at a given state, which show errors of the model without those of the integrator."""
        return lagrange(self.evaluator.terms(t, q, v)).a

    def prepare(self, times, native=True):
        """Prepare a run from the start, with samples at these times [s], the first of them 0."""
        start = np.concatenate([self.mechanism.q0, self.mechanism.v0])
        self.times, self.y, self.steps = times, np.tile(start, (len(times), 1)), 0

    def run(self):
        """Integrate the motion; only this function is timed."""
        # `count` equal steps of length h lead from sample k to the next
        for k, (count, h) in enumerate(step_counts(self.times, self.choice.step)):
            y = self.y[k]
            for i in range(count):
                t = self.times[k] + i * h
                slope = self._rate(t, y)
                y = y + h / 2 * (slope + self._rate(t + h, y + h * slope))
            self.y[k + 1], self.steps = y, self.steps + count

    def read(self):
        """Return the samples of the last run."""
        if not np.isfinite(self.y).all():
            raise RunFailure(Status.NAN, "not finite; a smaller step may help")
        q, v = np.split(self.y, 2, axis=1)
        a = np.array([self.acceleration(*state) for state in zip(self.times, q, v, strict=True)])
        return Trajectory(self.times, q, v, a, self.steps)

    def _rate(self, t, y):
        """Return the time derivative of a state y = (q, v)."""
        q, v = np.split(y, 2)
        return np.concatenate([v, self.acceleration(t, q, v)])
