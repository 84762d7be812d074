"""An engine as someone else would bring it: a library with an integrator, and the adapter that translates."""

LIBRARY = '''"""A library that knows nothing of linkages: Heun's method."""


def heun(rate, t, y, h):
    slope = rate(t, y)
    return y + h / 2 * (slope + rate(t + h, y + h * slope))
'''

ADAPTER = '''"""Heun's method on Lagrange's equations."""

import numpy as np

from gauss_bench.formulations.lagrange import lagrange
from gauss_bench.integrate.fixed_step import step_counts
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.trajectory import RunFailure, Status, Trajectory


class NAME:
    name = "NAME"
    integrators = ("heun",)
    stabilizations = ("none",)
    settings = {"default": {}}
    native_loop = False
    python_loop = True

    def version(self):
        import NAME

        return "NAME 1.0"

    def skip(self, mechanism, choice):
        if mechanism.has_friction or mechanism.redundant:
            return "neither dry friction nor redundant rows are modelled here"
        return None

    def build(self, mechanism, choice):
        import NAME

        return Model(NAME.heun, mechanism, choice)


class Model:
    def __init__(self, heun, mechanism, choice):
        self.heun, self.mechanism, self.choice, self.evaluator = heun, mechanism, choice, Evaluator(mechanism)

    def acceleration(self, t, q, v):
        return lagrange(self.evaluator.terms(t, q, v)).a

    def rate(self, t, y):
        q, v = np.split(y, 2)
        return np.concatenate([v, self.acceleration(t, q, v)])

    def prepare(self, times, native=True):
        self.times, self.y, self.steps = times, np.tile(np.concatenate([self.mechanism.q0, self.mechanism.v0]), (len(times), 1)), 0

    def run(self):
        for k, (count, h) in enumerate(step_counts(self.times, self.choice.step)):
            y = self.y[k]
            for i in range(count):
                y = self.heun(self.rate, self.times[k] + i * h, y, h)
            self.y[k + 1], self.steps = y, self.steps + count

    def read(self):
        if not np.isfinite(self.y).all():
            raise RunFailure(Status.NAN, "not finite")
        q, v = np.split(self.y, 2, axis=1)
        a = np.array([self.acceleration(*state) for state in zip(self.times, q, v)])
        return Trajectory(self.times, q, v, a, self.steps)
'''
