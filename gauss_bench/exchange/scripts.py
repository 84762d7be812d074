"""The common part of exported Python scripts: their first lines, their constants, and how they are run alone."""

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.export import coordinates
from gauss_bench.exchange.text import python_value
from gauss_bench.mechanism.model import Mechanism

SAMPLES = 100  # rows that a program prints at most, beside the first
HEADING = '''"""One linkage: python THIS_FILE [END [STEP]] prints t, positions and velocities as CSV; simulate() returns them."""

'''  # nobody's text stands in the first two lines, where a comment could choose the encoding
PLAN = '''

def plan(end, step):
    """How many steps, none longer than `step`, end at `end`, and after how many of them a row is kept."""
    count = max(1, math.ceil(end / step - 1e-9))
    every = math.ceil(count / SAMPLES)
    return every * math.ceil(count / every), every
'''
MAIN = """

if __name__ == "__main__":
    import sys

    print(",".join(["t", *NAMES, *RATES]))
    for row in simulate(*map(float, sys.argv[1:3])):
        print(",".join(repr(float(x)) for x in row))
"""


def rates(mechanism: Mechanism) -> list[str]:
    """The names of v, in order."""
    return coordinates(mechanism, ("vx", "vy", "omega"))


def constants(mechanism: Mechanism, choice: Choice) -> str:
    """The names of the coordinates, the start, and how far and by which steps."""
    return (
        f"NAMES = {python_value(coordinates(mechanism))}  # of q: centres of mass and angles\n"
        f"RATES = {python_value(rates(mechanism))}  # of v\n"
        f"Q0 = {python_value(mechanism.q0)}\n"
        f"V0 = {python_value(mechanism.v0)}\n"
        f"END, STEP, SAMPLES = {float(mechanism.duration)!r}, {choice.step!r}, {SAMPLES}\n"
    )
