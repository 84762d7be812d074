"""Drake's adapter: its forces, closures and accelerations, its refusals, and the findings on Drake.

Tests that need Drake are skipped without its environment, in CI too.
"""

import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench.engines.base import Choice
from gauss_bench.engines.drake.adapter import Drake
from gauss_bench.engines.drake.stepping import LENGTHS, SETTLING, settled_acceleration
from gauss_bench.engines.drake.translate import Closure, branch_of, explain_refusal, least_mass
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.linkage.load import load
from gauss_bench.suites.read import FOLDER
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status
from tests.conftest import everything

ENGINE = "drake"
FINDINGS = Path(gauss_bench.__file__).parents[1] / "reports" / "findings"


@pytest.mark.slow
@pytest.mark.usefixtures("elsewhere")
@pytest.mark.parametrize("wind", ['"wind", ', ""])
def test_every_force_that_drake_takes_acts_as_defined(wind, tmp_path):
    """The judge compares the run with the suite's own motion; the jet is a propeller, and a wind enters beside it."""
    text = (FOLDER / "linkages" / "kinds.toml").read_text(encoding="utf-8")
    whole = '"wind", "jet", "guy", "cord", "buffer", "spring"'
    assert text.count(whole) == 1
    path = tmp_path / "kinds.toml"
    path.write_text(text.replace(whole, f'{wind}"jet", "cord", "spring"'), encoding="utf-8")
    run = gauss_bench.simulate(path, "drake", "loaded", "bushing", "runge_kutta3_adaptive", tolerance=1e-8, at=[0.0, 0.5])
    assert run.status == "ok", run.message


@pytest.mark.long
def test_the_findings_on_drake_are_as_told(elsewhere):
    crash, ignored = (
        subprocess.run([elsewhere, str(FINDINGS / f"{name}.py")], capture_output=True, text=True, check=True).stdout.splitlines()
        for name in ("drake_world_constraint", "drake_ignored_forces")
    )
    assert [line.split()[0] for line in crash if "signal 11" in line] == ["ball", "distance", "weld"]
    assert sum("stepped" in line for line in crash) == 5
    table = [line.partition("with it ")[2] for line in ignored if "with it" in line]
    assert table == ["1.0000"] * 3 + ["0.0000"] + ["1.0000"] * 2 + ["0.0000"] * 2 + ["1.0000"] + ["0.0000"] * 7


# what follows needs no library


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"rest": 0.0}, "Drake's spring between points needs a positive free length (stretch)"),
        ({"k": -1.0}, "Drake has no spring or damper with a negative constant (stretch)"),
        ({"c": -1.0}, "Drake has no spring or damper with a negative constant (stretch)"),
    ],
)
def test_a_spring_between_points_beyond_drakes_is_refused_by_name(change, reason):
    whole = everything()
    (stretch,) = (f for f in whole.forces if f.name == "stretch")
    alone = replace(whole, forces=(replace(stretch, **change),))
    assert explain_refusal(alone, spanning_tree(alone)) == reason


def test_only_discrete_plants_have_constraints():
    four_bar = load("four_bar", "torque")
    assert Drake().skip(four_bar, Choice(integrator="sap")) is None
    assert "in discrete plants only" in str(Drake().skip(four_bar, Choice(integrator="radau3")))
    assert Drake().skip(four_bar, Choice("bushing", "radau3")) is None
    open_chain = replace(four_bar, joints=four_bar.joints[:3])
    assert Drake().skip(open_chain, Choice(integrator="radau3")) is None


def test_a_coordinate_belongs_to_the_branch_that_begins_last_before_it():
    tree = spanning_tree(everything())
    owners = [branch_of(tree, at).at for at in range(tree.n)]
    assert owners == [b.at for b in tree.branches for _ in b.coordinates]


def test_a_bushing_vibrates_with_its_period_and_damping():
    """A mass of 2 kg on the spring has the period; a damper of twice the critical one has the ratio 2."""
    stiffness, damping = Closure("bushing", period=0.1, damping_ratio=2.0).constants(2.0)
    assert 2 * np.pi * np.sqrt(2.0 / stiffness) == pytest.approx(0.1)
    assert damping == pytest.approx(2 * (2 * np.sqrt(stiffness * 2.0)))


def test_a_gap_moves_the_least_mass():
    """Two masses of 1 and 3 kg that move along x and y: the gap is their own place, and the lighter one is the least mass."""
    assert least_mass(np.eye(2), np.diag([1.0, 3.0])) == pytest.approx(1.0)
    assert least_mass(np.array([[1.0, -1.0], [0.0, 0.0]]), np.diag([1.0, 1.0])) == pytest.approx(0.5)  # a spring between two masses


@dataclass
class Settling:
    """Steps that behave like those of SAP: the error of the acceleration halves with every step.

    Attributes:
        length: length of a step [s].
        acceleration: (2,) limit of the acceleration at length 0.
        blur: error of the acceleration if the length is below `coarse` [s].
    """

    length: float
    acceleration: Array
    blur: float = 0.0
    coarse: float = 0.0

    def last_changes(self, y, dy, steps):
        shown = self.acceleration + 5.0 * self.length - 30.0 * self.length**2
        if self.length < self.coarse:
            shown = shown + self.blur
        before, last = (shown + np.array([2.0, -1.0]) / 2**k for k in (steps - 1, steps))
        return before, last


def test_the_acceleration_is_what_ever_more_and_ever_shorter_steps_show():
    acceleration, rest = np.array([3.0, -4.0]), np.zeros(2)
    found = settled_acceleration(lambda longest: [Settling(longest / 2**k, acceleration) for k in range(3)], rest, rest)
    assert found == pytest.approx(acceleration, abs=1e-10)
    assert 2.0 / 2**SETTLING > 1e-3  # without the last two steps' difference, it would be that far off


def test_longer_steps_are_taken_where_short_ones_do_not_agree():
    acceleration, rest, asked = np.array([3.0, -4.0]), np.zeros(2), []

    def steppers(longest):
        asked.append(longest)
        return [Settling(longest / 2**k, acceleration, 1.0, 0.6 * LENGTHS[0]) for k in range(3)]

    assert settled_acceleration(steppers, rest, rest) == pytest.approx(acceleration, abs=1e-10)
    assert asked == [*LENGTHS]
    with pytest.raises(RunFailure, match="do not settle") as failure:
        settled_acceleration(lambda x: [Settling(x / 2**k, acceleration, 1.0, 0.6 * x) for k in range(3)], rest, rest)
    assert failure.value.status is Status.NOT_CONVERGED
