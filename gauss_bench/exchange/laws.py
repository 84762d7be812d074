"""Motion laws as functions of a script: t -> (value, rate, second rate), as `mechanism/motion_laws.py` has them."""

from collections.abc import Sequence

from gauss_bench.exchange.text import python_value
from gauss_bench.mechanism.model import Driver
from gauss_bench.mechanism.motion_laws import MotionLaw

RISES = {
    "sine": (
        "s - math.sin(2 * math.pi * s) / (2 * math.pi)",
        "1 - math.cos(2 * math.pi * s)",
        "2 * math.pi * math.sin(2 * math.pi * s)",
    ),
    "cosine": ("(1 - math.cos(math.pi * s)) / 2", "math.pi / 2 * math.sin(math.pi * s)", "math.pi**2 / 2 * math.cos(math.pi * s)"),
    "poly345": ("s**3 * (10 - 15 * s + 6 * s * s)", "30 * s * s * (1 - s) ** 2", "60 * s * (1 - s) * (1 - 2 * s)"),
}
TABLE = """def {name}(t):
    start, times, values, bends = {start}, {times}, {values}, {curvatures}
    x = min(max(t, times[0]), times[-1])
    moving = times[0] <= t <= times[-1]
    j = max(k for k in range(len(times) - 1) if times[k] <= x)
    width, x = times[j + 1] - times[j], x - times[j]
    bend = (bends[j + 1] - bends[j]) / width
    slope = (values[j + 1] - values[j]) / width - width * (2 * bends[j] + bends[j + 1]) / 6
    value = values[j] + x * (slope + x * (bends[j] / 2 + x * bend / 6))
    return start + value, (slope + x * (bends[j] + x * bend / 2)) * moving, (bends[j] + x * bend) * moving
"""
RISE = """def {name}(t):
    start, travel, time = {start}, {travel}, {time}
    s = min(max(t / time, 0.0), 1.0)
    moving = 0 <= t <= time
    value = {rise[0]}
    rate = {rise[1]}
    second = {rise[2]}
    return start + travel * value, travel / time * rate * moving, travel / time**2 * second * moving
"""
CONSTANT = """def {name}(t):
    return {start} + {speed} * t, {speed}, 0.0
"""


def law_names(drivers: Sequence[Driver]) -> dict[int, str]:
    """The names of drivers' laws in a script, by their ids."""
    return {id(d.law): f"law_{k}" for k, d in enumerate(drivers, 1)}


def law_functions(drivers: Sequence[Driver]) -> str:
    """The functions of these names."""
    names = law_names(drivers)
    return "".join(f"\n\n{law_function(d.law, names[id(d.law)])}" for d in drivers)


def law_function(law: MotionLaw, name: str) -> str:
    """A function of that name; `math` is imported where it stands."""
    form = {"constant": CONSTANT, "table": TABLE}.get(law.name, RISE)
    return form.format(name=name, rise=RISES.get(law.name), **{key: python_value(x) for key, x in law.numbers.items()})
