"""DART, in an environment of its own: the forces that it is given, what it refuses, and its errors against certificates.

What needs DART is skipped without its environment, in CI too.
"""

import os
from dataclasses import replace

import numpy as np
import pytest

import gauss_bench
from gauss_bench.engines.base import Choice
from gauss_bench.engines.dart.adapter import Dart
from gauss_bench.engines.dart.messages import Messages
from gauss_bench.engines.dart.translate import EXPLICIT, IMPLICIT, forces_of
from gauss_bench.engines.given_forces import on_one_joint
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.engines.tree_loads import OnJoints
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status
from tests.conftest import everything

ENGINE = "dart"


@pytest.mark.usefixtures("elsewhere")
def test_a_run_that_blows_up_is_a_warning_of_one_sentence() -> None:
    run = gauss_bench.simulate("eight_bar", "dart", "torque", "shut,lcp=PGS", at=[0.0, 1.0], step=1e-2)
    assert run.status == "warning"
    assert run.message.startswith("DART: Warning")
    assert "\x1b" not in run.message


@pytest.mark.parametrize("joint_forces", [IMPLICIT, EXPLICIT])
def test_forces_that_dart_has_and_is_given_are_all_forces(joint_forces: str, rng: np.random.Generator) -> None:
    """As generalised forces on the tree, at random states."""
    mechanism = everything()
    tree = spanning_tree(mechanism)
    given = forces_of(mechanism, tree, joint_forces)
    assert bool(given.own) == (joint_forces == IMPLICIT)
    whole = AppliedForces(replace(mechanism, gravity=np.zeros(2)))
    for _ in range(3):
        y, dy = rng.standard_normal((2, tree.n))
        q, v, _ = tree.absolute(y, dy, np.zeros(tree.n))
        own = sum((spring(x, y, dy) for x in given.own), np.zeros(tree.n))
        on_links = given.on_links(0.3, y, dy)
        assert on_links is not None
        found = own + given.on_joints(y, dy) + tree.forces(q, on_links)
        np.testing.assert_allclose(found, tree.forces(q, whole.generalised(q, v, 0.3)), atol=1e-11 * np.abs(found).max())


def spring(x: OnJoints, y: Array, dy: Array) -> Array:
    """Force (n,) of a spring and damper of a joint."""
    return np.asarray((x.k * (x.rest - x.row @ y - x.constant) - x.c * x.row @ dy) * x.row)


def test_dart_has_springs_on_one_coordinate_of_its_tree_alone() -> None:
    alone, both = np.array([0.0, -1.0, 0.0]), np.array([1.0, -1.0, 0.0])
    assert on_one_joint(OnJoints(alone, 0.0, 1.0, 0.0, 0.0))
    assert not on_one_joint(OnJoints(both, 0.0, 1.0, 0.0, 0.0))


def test_what_runs_in_python_is_told() -> None:
    dart = Dart()
    assert dart.in_python(load("parallelogram", "torque"), Choice("default")) == ""
    assert "forces" in dart.in_python(load("crank_slider", "paper"), Choice("explicit"))
    assert dart.in_python(load("four_bar", "cycloid"), Choice("default")).startswith("motion laws")


def test_what_a_library_prints_is_a_failure_with_its_first_line_and_does_not_reach_the_streams(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with Messages() as messages:
        messages.check()
        os.write(2, b"\x1b[1;33mWarning [X.cpp:1]\x1b[0m Non-finite\n" * 3)
        os.write(1, b"and more\n")
        with pytest.raises(RunFailure, match=r"^DART: Warning \[X.cpp:1\] Non-finite$") as caught:
            messages.check()
    assert caught.value.status is Status.WARNING
    print("after")
    assert capfd.readouterr() == ("after\n", "")
