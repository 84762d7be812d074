"""Starts of linkages with other dimensions than the file's, which are known for the file's alone.

The numbers go from the one to the other little by little, in steps that grow, with a guess from the last two steps; every guard
keeps its side on the way, so that the assembly stays the same.
Source: Allgower and Georg, Introduction to Numerical Continuation Methods (2003), chapter 2.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from gauss_bench.compiler.turns.motions import Start
from gauss_bench.compiler.turns.tracker import Tracker, held
from gauss_bench.terms import Array

STEPS = (32, 256)  # the last is the longest, a sixteenth or a 128th of the way
APART = "with these numbers the linkage cannot be assembled where the file has it, coming from there"


def deformed_starts(tracker: Tracker, start: Start, nominal: Array, p: Array) -> list[Start]:
    """The starts of linkages with numbers p (linkages, n_p), from that with the nominal ones; with a fault where there is none."""
    found = np.full((len(p), len(start.x)), np.nan)
    for steps in STEPS:
        left = np.flatnonzero(~np.isfinite(found).all(axis=1))
        if len(left):
            found[left] = _deformed(tracker, start, nominal, p[left], steps)
    faults = ["" if good else APART for good in np.isfinite(found).all(axis=1)]
    return [replace(start, x=x, fault=fault) for x, fault in zip(found, faults, strict=True)]


def _deformed(tracker: Tracker, start: Start, nominal: Array, p: Array, steps: int) -> Array:
    """Unknowns (linkages, U), NaN where lost."""
    inputs = held(start).repeat(2, axis=0)[None]
    signs = start.signs[None].repeat(len(p), axis=0)
    before = x = start.x[None].repeat(len(p), axis=0)
    last = 1.0
    for a, b in pairwise(np.linspace(0.0, 1.0, steps + 1) ** 2):
        guess = x + (x - before) * ((b - a) / last)
        followed = tracker.ends(guess, signs, inputs, nominal + b * (p - nominal))
        x, before, last = np.where(followed.closed[:, None] == 1, followed.x, np.nan), x, b - a
    return np.asarray(x)
