"""Exudyn: exact models, accelerations of known error, motions of second order, and failures with a reason."""

from dataclasses import replace

import numpy as np
import pytest

from gauss_bench.engines.base import Choice
from gauss_bench.engines.exudyn.accelerations import Readout, verify
from gauss_bench.engines.exudyn.adapter import Exudyn, load_library, make_settings
from gauss_bench.engines.exudyn.items import System
from gauss_bench.linkage.load import document_of, load, load_document
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference.build import build_reference, random_states
from gauss_bench.trajectory import RunFailure, Status
from tests.conftest import exhaustive, needs
from tests.engine_runs import LINKAGES, acceleration_errors, by_gauss, document, linkage, ran, relative_error

exu = needs("exudyn")

ENGINE = Exudyn()
INTEGRATORS = ENGINE.integrators


def run(mechanism, times, integrator=INTEGRATORS[0], step=1e-3, settings="tuned"):
    return ran(ENGINE, mechanism, times, integrator=integrator, step=step, settings=settings)


def with_forces(*names):
    """The linkage with every kind of joint, under some of its forces."""
    content = document("all_kinds")
    content["scenarios"]["all"]["forces"] = list(names)
    return load_document(content)


def test_default_settings_are_the_shipped_ones():
    shipped = exu.SimulationSettings()
    own = make_settings(load_library()[0], load("four_bar"), Choice("default", "generalized_alpha"))
    own.timeIntegration.adaptiveStep = True  # the one deviation that the settings admit
    own.solution.file.write = True  # nothing but speed
    assert str(own) == str(shipped)


@pytest.mark.parametrize("settings", Exudyn.settings)
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_law_that_begins_with_a_jump_is_met_from_the_first_sample_on(integrator, settings):
    content = document_of("four_bar")[0]
    content["scenarios"]["cycloid"]["driver"]["law"] = "cosine"  # with its largest acceleration at the start
    mechanism = load_document(content, "cycloid")
    exact = build_reference(mechanism, 0.3)
    found = run(mechanism, exact.t, integrator, settings=settings)
    assert np.abs(exact.a[0, 2]) > 10, "or there is nothing to ignore"
    assert relative_error(found.a[0], exact.a[0]) < 1e-11, "given, not found by Exudyn"
    assert relative_error(found.q, exact.q) < 1e-4
    assert relative_error(found.a[10:], exact.a[10:]) < 1e-3, "an offset in the start would stay in the trapezoidal rule"


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("name", exhaustive(LINKAGES, "crank_slider", "eight_bar"))
def test_halving_the_step_quarters_the_error(name, integrator):
    times = [0.0, 0.2]
    end = by_gauss(linkage(name), times).q[-1]
    coarse, fine = (np.abs(run(linkage(name), times, integrator, h).q[-1] - end).max() for h in (1e-3, 5e-4))
    assert 3.5 < coarse / fine < 4.5, "both integrators are of order two; the next order is far smaller at these steps"


def test_index_three_keeps_positions_and_index_two_keeps_velocities():
    mechanism, gaps = load("four_bar"), []
    for integrator in ("generalized_alpha", "trapezoidal_index2"):
        end = run(mechanism, [0.0, 0.5], integrator)
        terms = Evaluator(mechanism).terms(0.0, end.q[-1], end.v[-1])
        gaps.append((np.abs(terms.phi).max(), np.abs(terms.phi_dot).max()))
    (of_index_3, rate_of_index_3), (of_index_2, rate_of_index_2) = gaps
    assert of_index_3 < 1e-10, "to the tolerance of the Newton iteration"
    assert rate_of_index_2 < 1e-8, "the same, divided by the step"
    assert rate_of_index_3 > 100 * rate_of_index_2, "what is not enforced drifts"
    assert of_index_2 > 100 * of_index_3


@pytest.mark.slow("tuned")
@pytest.mark.parametrize(("settings", "limit"), [("default", 1e-4), ("tuned", 1e-9)], ids=["default", "tuned"])
def test_redundant_rows_leave_the_motion_right(settings, limit):
    mechanism = load("parallelogram", "torque")
    assert acceleration_errors(ENGINE, mechanism, settings, random_states(mechanism, 50)).max() < limit
    end = by_gauss(mechanism, [0.0, 0.5], integrator="rk4", stabilization="projection").q[-1]
    for integrator in INTEGRATORS:
        error = np.abs(run(mechanism, [0.0, 0.5], integrator, 5e-4, settings).q[-1] - end).max()
        assert error < 5e-4, "1.6e-4 measured, a quarter of what 1e-3 leaves; a lost row changes the motion by 0.1"


def test_every_kind_of_force_and_joint_is_exact():
    mechanism, times = linkage("all_kinds"), [0.0, 0.1, 0.3]
    assert ENGINE.skip(mechanism, Choice()) is None
    assert acceleration_errors(ENGINE, mechanism, "tuned", random_states(mechanism, 5)).max() < 1e-11
    true = by_gauss(mechanism, times)
    for integrator in INTEGRATORS:
        assert np.abs(run(mechanism, times, integrator).q - true.q).max() < 1e-4, "h^2; forces matter from 1e-2 on"


@pytest.mark.parametrize("force", document("all_kinds")["scenarios"]["all"]["forces"])
def test_each_force_alone_passes_and_its_absence_is_noticed(force):
    mechanism = with_forces(force)
    ENGINE.build(mechanism, Choice("tuned", INTEGRATORS[0]))  # compares all terms with the linkage's
    bare = System(*load_library(), replace(mechanism, forces=()))
    with pytest.raises(RunFailure, match="applied forces") as caught:
        verify(bare, Readout(bare), Evaluator(mechanism))
    assert caught.value.status is Status.ERROR


def test_a_missing_joint_or_a_wrong_mass_is_noticed():
    mechanism = load("four_bar")
    heavy = replace(mechanism.links[0], mass=2 * mechanism.links[0].mass)
    for wrong, words in (
        (replace(mechanism, joints=mechanism.joints[1:]), "degrees of freedom"),
        (replace(mechanism, links=(heavy, *mechanism.links[1:]), gravity=np.zeros(2)), "mass matrix"),
    ):
        system = System(*load_library(), replace(wrong, dof=mechanism.dof))
        with pytest.raises(RunFailure, match=words):
            verify(system, Readout(system), Evaluator(replace(mechanism, gravity=wrong.gravity)))


def test_what_cannot_be_modelled_is_skipped_and_would_indeed_be_wrong():
    choice = Choice("tuned", INTEGRATORS[0])
    assert "across" in ENGINE.skip(with_forces("across"), choice)
    with pytest.raises(RunFailure, match="applied forces"):
        ENGINE.build(with_forces("across"), choice)
    content = document("all_kinds")
    content["forces"]["anchor"] |= {"c": 0.5, "between": ["ground.O", "arm.O"]}
    content["scenarios"]["all"]["forces"] = ["anchor"]
    assert "coincide" in ENGINE.skip(load_document(content), choice)


def test_a_step_too_large_for_the_newton_iteration_is_a_failure_with_a_sentence():
    with pytest.raises(RunFailure, match=r"t = 0\.\d+ s: Exudyn gave up .*smaller step") as caught:
        run(load("six_bar", "torque"), [0.0, 1.0], step=1e-2)
    assert caught.value.status is Status.NOT_CONVERGED
    assert "python" not in str(caught.value).lower(), "no place in a file"


def test_open_joints_and_warnings_fail_whatever_exudyn_returned():
    for spoil, status, words in (
        (lambda model: model.q.__setitem__((-1, 0), model.q[-1, 0] + 0.2), Status.DIVERGED, "open"),  # a crank torn off its pin
        (lambda model: exu.Print("WARNING: something is odd"), Status.WARNING, "something is odd"),
    ):
        model = ENGINE.build(load("four_bar", "torque"), Choice("tuned", INTEGRATORS[0], step=1e-3))
        model.prepare(np.array([0.0, 0.05]))
        model.run()
        spoil(model)
        with pytest.raises(RunFailure, match=words) as caught:
            model.read()
        assert caught.value.status is status


def test_nothing_is_printed_and_no_file_is_left(capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(load("four_bar", "torque"), [0.0, 0.05])
    assert capfd.readouterr().out == ""
    assert list(tmp_path.iterdir()) == []
