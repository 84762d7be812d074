"""Parts of the Python programs that run one linkage with a library, without this package.

Every program prints t, positions and velocities of the links as CSV. The calls with which an adapter builds its model are recorded
(`transcript.py`), and the engine's `program.py` adds the lines that take the steps.
"""

import inspect
import math
from collections.abc import Sequence
from string import Template
from textwrap import indent
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.given_forces import GivenForces
from gauss_bench.engines.shared import drivers_by_coordinate
from gauss_bench.engines.transcript import name_laws, python
from gauss_bench.engines.tree import Tree, turning
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.trajectory import RunFailure, Status

SAMPLES = 100  # largest number of rows that a program prints after the first, which is the start
TITLE = "One linkage: python THIS_FILE [END [STEP]] prints t, positions and velocities as CSV; simulate() returns them."
MAIN = """if __name__ == "__main__":
    import sys

    print(",".join(["t", *NAMES, *RATES]))
    for row in simulate(*map(float, sys.argv[1:3])):
        print(",".join(repr(float(x)) for x in row))
"""


def plan(end: float, step: float) -> tuple[int, int]:
    """Return the number of equal steps until `end` [s], none longer than `step` [s], and the number of steps per printed row.

    The first number is a multiple of the second, and a program prints at most SAMPLES rows after the start.
    """
    count = max(1, math.ceil(end / step - 1e-9))  # 1e-9: a rounding error of the quotient must not add a step
    every = math.ceil(count / SAMPLES)
    return every * math.ceil(count / every), every


PLAN = inspect.getsource(plan)  # every program has this function


def heading(name: str) -> str:
    """Return a name as the heading of a CSV column, with underscores for commas, quotes and other special characters."""
    return "".join(c if c.isalnum() or c in "._- " else "_" for c in name)


def coordinates(mechanism: Mechanism, kinds: Sequence[str] = ("x", "y", "theta")) -> list[str]:
    """Return the column headings for the positions q (n,): LINK.x, LINK.y, LINK.theta for every link."""
    return [f"{heading(link.name)}.{x}" for link in mechanism.links for x in kinds]


def rates(mechanism: Mechanism) -> list[str]:
    """Return the column headings for the velocities v (n,): LINK.vx, LINK.vy, LINK.omega for every link."""
    return coordinates(mechanism, ("vx", "vy", "omega"))


# the bodies of functions t -> (value, rate, second derivative), one for each kind of motion law
CONSTANT = "    return $start + $speed * t, $speed, 0.0\n"
# a cubic spline: `bends` are its second derivatives at `times`; in the interval from times[j] on, `bend` is its third derivative,
# and `slope` its first derivative at times[j]
TABLE = """    start, times, values = $start, $times, $angles
    bends = $curvatures
    x = min(max(t, times[0]), times[-1])
    moving = times[0] <= t <= times[-1]
    j = max(k for k in range(len(times) - 1) if times[k] <= x)
    width, x = times[j + 1] - times[j], x - times[j]
    bend = (bends[j + 1] - bends[j]) / width
    slope = (values[j + 1] - values[j]) / width - width * (2 * bends[j] + bends[j + 1]) / 6
    value = values[j] + x * (slope + x * (bends[j] / 2 + x * bend / 6))
    return start + value, (slope + x * (bends[j] + x * bend / 2)) * moving, (bends[j] + x * bend) * moving
"""
RISE = """    start, travel, time = $start, $travel, $time
    s = min(max(t / time, 0.0), 1.0)
    moving = 0 <= t <= time
$family    return start + travel * value, travel / time * rate * moving, travel / time**2 * second * moving
"""
FAMILIES = {  # name of a law that rises from 0 to 1 -> lines that compute its value and its two derivatives by s
    "sine": """    value = s - math.sin(2 * math.pi * s) / (2 * math.pi)
    rate = 1 - math.cos(2 * math.pi * s)
    second = 2 * math.pi * math.sin(2 * math.pi * s)
""",
    "cosine": """    value = (1 - math.cos(math.pi * s)) / 2
    rate = math.pi / 2 * math.sin(math.pi * s)
    second = math.pi**2 / 2 * math.cos(math.pi * s)
""",
    "poly345": """    value = s**3 * (10 - 15 * s + 6 * s * s)
    rate = 30 * s * s * (1 - s) ** 2
    second = 60 * s * (1 - s) * (1 - 2 * s)
""",
}


def write_law(name: str, law: MotionLaw) -> str:
    """Return the Python source of a function `name`: t -> (value, rate, second derivative) of the motion law `law`."""
    numbers = {key: python(np.asarray(x).tolist()) for key, x in law.numbers.items()}
    body = {"constant": CONSTANT, "table": TABLE}.get(law.name, RISE)  # every other law is a rise from rest to rest
    return f"def {name}(t):\n{Template(body).substitute(numbers, family=FAMILIES.get(law.name, ''))}"


def write_laws(mechanism: Mechanism) -> str:
    """Return the sources of law_1, law_2, ..., the motion laws of all drivers, each after two empty lines."""
    return "".join(f"\n\n{write_law(f'law_{k}', driver.law)}" for k, driver in enumerate(mechanism.drivers, 1))


FRAME = Template('''"""$title"""

import math

$imports

NAMES = $names  # of q: centres of mass and angles
RATES = $rates  # of v
Q0 = $q0
V0 = $v0
END, STEP, SAMPLES = $end, $step, $samples
$laws$numbers


$plan

def absolute(y, dy, places, speeds):
    """Positions and velocities of the links; y are the joints' coordinates, of which the links' angles are sums."""
    q, v = np.empty(len(Q0)), np.empty(len(Q0))
    q[2::3], v[2::3] = ANGLES + TURNS @ y, TURNS @ dy
    for k in range(2):
        q[k::3], v[k::3] = [place[k] for place in places], [speed[k] for speed in speeds]
    return [*q, *v]


def simulate(end=END, step=STEP):
    """Rows [t, *q, *v] at equally spaced times."""
    steps, every = plan(end, step)
    step = end / steps
$model
    rows = [[0.0, *Q0, *V0]]
$run    return rows


$main''')


def force_numbers(forces: GivenForces, mechanism: Mechanism, tree: Tree) -> dict[str, Any]:
    """Return the constants, name -> value, of a program that passes the forces on tree coordinates y to the library at every step.

    These forces are CONSTANT - STIFFNESS y - DAMPING y'. LAWS lists the index and the motion law of each driven coordinate.

    Raises:
        RunFailure: the program would need forces that only this suite computes.
    """
    if forces.others is not None:
        reason = "a program can compute forces of joints only: no forces at points or between points, and none that vary"
        raise RunFailure(Status.SKIP, reason)
    laws = name_laws(mechanism)
    driven = [[index, laws[id(driver.law)]] for index, driver in drivers_by_coordinate(mechanism, tree).items()]
    return {"CONSTANT": forces.constant, "STIFFNESS": forces.stiffness, "DAMPING": forces.damping, "LAWS": driven}


def write_tree_program(
    mechanism: Mechanism,
    tree: Tree,
    choice: Choice,
    *,
    imports: Sequence[str],
    numbers: dict[str, Any],
    model: Sequence[str],
    run: str,
) -> str:
    """Return the text of a program that runs a linkage in a library that models trees of joints, with the step size `choice.step`.

    In the program, the angles of the links are ANGLES + TURNS y, where y are the tree coordinates.

    Args:
        numbers: name -> value of the engine's constants.
        model: statements that build the library's model for steps of size `step`.
        run: statements that take `steps` steps, and append [t, *absolute(y, dy, places, speeds)] to `rows` after each group of
            `every` steps.
    """
    y0, dy0 = tree.relative(mechanism.q0, mechanism.v0)
    turns = turning(tree)
    angles = {"ANGLES": turns.constants[:-1], "TURNS": turns.rows[:-1]}  # without those of the ground
    constants = {"Y0": y0, "DY0": dy0, **angles, **numbers}
    laws = write_laws(mechanism)
    return FRAME.substitute(
        title=TITLE,
        imports="\n".join(sorted(["import numpy as np", *imports], key=lambda line: line.split()[1])),
        names=python(coordinates(mechanism)),
        rates=python(rates(mechanism)),
        q0=python(mechanism.q0.tolist()),
        v0=python(mechanism.v0.tolist()),
        end=python(float(mechanism.duration)),
        step=python(choice.step),
        samples=SAMPLES,
        numbers="\n".join(f"{name} = {python(x)}" for name, x in constants.items()),
        laws=f"{laws}\n\n" if laws else "",
        plan=PLAN,
        model=indent("\n".join(model), "    "),
        run=run,
        main=MAIN,
    )
