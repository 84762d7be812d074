"""MuJoCo: the generated model is the mechanism, up to a softness of the closures that the settings name."""

from dataclasses import replace
from types import SimpleNamespace
from xml.etree.ElementTree import tostring

import numpy as np
import pytest

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mjcf.across_releases import compile_document
from gauss_bench.engines.mjcf.draft import Draft
from gauss_bench.engines.mjcf.settings import configure
from gauss_bench.engines.mujoco import forces
from gauss_bench.engines.mujoco.adapter import AGREEMENT, Mujoco
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.engines.tree_model import verify
from gauss_bench.formulations.gauss import gauss
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference.build import random_states
from gauss_bench.trajectory import RunFailure, Status
from tests.conftest import exhaustive, needs
from tests.engine_runs import DRIVEN, LINKAGES, QUICK, acceleration_errors, linkage, ran

mujoco = needs("mujoco")

ENGINE = Mujoco()
NAMES = [*LINKAGES, "loaded"]  # the last one is a four-bar with every force


def trajectory(mechanism, times, settings="rigid", **choice):
    return ran(ENGINE, mechanism, times, settings=settings, **choice)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda m: m.body_mass.__setitem__(-1, 1.001 * m.body_mass[-1]),
        lambda m: m.tendon_stiffness.__imul__(1.01),
        lambda m: m.dof_damping.__imul__(2.0),
        lambda m: m.actuator_gear.__imul__(-1.0),
        lambda m: m.site_pos.__setitem__(0, m.site_pos[0] + [1e-6, 0.0, 0.0]),
    ],
)
def test_a_spoiled_model_is_refused(spoil):
    model = ENGINE.build(linkage("loaded"), Choice())  # which compares it with the linkage
    spoil(model.still)
    with pytest.raises(RunFailure, match="differs from the linkage"):
        verify(model.mechanism, model.tree, model.describe, AGREEMENT)


def test_default_is_what_mujoco_ships():
    mechanism = load("six_bar")
    shipped = mujoco.MjModel.from_xml_string(tostring(Draft(mechanism, spanning_tree(mechanism)).root, encoding="unicode"))
    model = ENGINE.build(mechanism, Choice("default"))
    built = model.model
    assert (built.qpos0 == model.y0).all()  # loops are closed in the pose in which MuJoCo computes inverse weights
    for name in ("eq_solref", "eq_solimp", "body_invweight0"):
        assert (getattr(built, name) == getattr(shipped, name)).all()
    assert (built.opt.tolerance, built.opt.iterations) == (shipped.opt.tolerance, shipped.opt.iterations)


@pytest.mark.parametrize(("name", "scenario"), exhaustive([*((name, None) for name in NAMES), *DRIVEN], ("loaded", None), *QUICK))
def test_accelerations_are_as_exact_as_the_setting_is_rigid(name, scenario):
    mechanism = linkage(name, scenario)
    states = random_states(mechanism, 25)
    default, tuned, rigid = (acceleration_errors(ENGINE, mechanism, label, states) for label in ("default", "tuned", "rigid"))
    # the error is proportional to the regulariser (1 - d) / d times the inverse weight: d = 0.9, then 0.9999, then a weight of 1e-6
    assert np.median(tuned) == pytest.approx(1e-4 / (0.1 / 0.9) * np.median(default), rel=0.5)  # default is no longer small
    if scenario is None:
        assert np.median(rigid) == pytest.approx(1e-6 * np.median(tuned), rel=0.1)
    else:
        assert np.median(rigid) < 5e-9  # the load on the crank over its armature: 2e-9 at most was measured
    assert rigid.max() < 1e-7  # states of small acceleration inflate a relative error


@pytest.mark.parametrize("native", [True, False])
def test_a_driven_crank_follows_its_law_at_every_stage_of_a_step(native):
    mechanism, times = load("six_bar", "cycloid"), np.array([0.0, 0.1, 0.2345, 0.6])
    found = trajectory(mechanism, times, native=native)
    assert np.abs(found.q[:, 2] - mechanism.driver.law(times)[0]).max() < 1e-8  # a torque held over the step leaves 1e-3
    assert "law" in found.note
    assert mujoco.get_mjcb_control() is None


@pytest.mark.parametrize("integrator", ENGINE.integrators)
def test_both_loops_give_the_same_bits(integrator):
    mechanism, times = linkage("four_bar"), [0.0, 0.05, 0.0777, 0.1]
    a, b = (trajectory(mechanism, times, "tuned", integrator=integrator, native=native) for native in (True, False))
    assert a.steps == b.steps == 50 + 28 + 23
    assert (a.q == b.q).all()
    assert (a.v == b.v).all()


def test_diverging_runs_are_not_reset_and_leave_no_log_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mechanism = linkage("crank_slider")
    wild = replace(mechanism, v0=1e9 * gauss(Evaluator(mechanism).terms(0.0, mechanism.q0, mechanism.v0)).a)
    found = trajectory(wild, [0.0, 1.0, 2.0], "tuned", step=0.1)
    assert mujoco.get_mju_user_warning() is None
    assert "unstable" in found.note
    assert not np.isfinite(found.q[-1]).all()  # which the judge finds
    with pytest.raises(RunFailure, match="not finite"):  # at these states MuJoCo warns when it is asked for accelerations
        trajectory(load("shaper", "torque"), np.linspace(0.0, 1.0, 11), "rigid_lean/2", step=0.05)
    assert not list(tmp_path.iterdir())


def test_warnings_are_refused():
    model = ENGINE.build(linkage("four_bar"), Choice())
    model.prepare(np.array([0.0, 0.1]))
    model.run()
    model.data.warning[mujoco.mjtWarning.mjWARN_CNSTRFULL].number += 1
    with pytest.raises(RunFailure, match="warned") as failure:
        model.read()
    assert failure.value.status is Status.WARNING


def test_a_feature_that_a_model_uses_stays_on():
    model = ENGINE.build(load("four_bar"), Choice("default")).model
    bits = mujoco.mjtDisableBit
    assert model.opt.disableflags == bits.mjDSBL_AUTORESET  # as shipped, but for that
    for limited, expected in ((False, True), (True, False)):
        model.jnt_limited[0], model.opt.disableflags = limited, 0
        configure(mujoco, model, Mujoco.settings["tuned"], 1e-3)
        assert bool(model.opt.disableflags & bits.mjDSBL_LIMIT) is expected
        assert model.opt.disableflags & bits.mjDSBL_ISLAND


@pytest.mark.parametrize(("name", "home"), forces.MOVED.items())
def test_names_of_loads_are_found_under_their_former_module_with_a_warning(name, home):
    with pytest.warns(DeprecationWarning, match=rf"{home.__name__}\.{name}"):
        assert getattr(forces, name) is getattr(home, name)


def test_a_release_without_closures_between_sites_is_left_out_and_other_documents_are_errors():
    old = "XML Error: Schema violation: unrecognized attribute: 'site1'"

    def stand_in(message):
        def refuse(text):
            raise ValueError(message)

        return SimpleNamespace(__version__="2.3.7", MjModel=SimpleNamespace(from_xml_string=refuse))

    for message, status in ((old, Status.SKIP), ("XML Error: no mass", Status.ERROR)):
        with pytest.raises(RunFailure) as failure:
            compile_document(stand_in(message), "<mujoco/>")
        assert failure.value.status == status


def test_free_flight_is_a_parabola():
    t = np.array([[0.0], [0.3], [1.0], [2.0]])
    found = trajectory(linkage("puck"), t[:, 0], step=0.1)  # RK4 is exact for constant acceleration
    expected = [2.0, 1.0, 0.5] + [1.0, -1.0, 3.0] * t + np.array([3.0 / 2, 1.0 / 2 - 2.0, 0.4 / 0.05]) * t**2 / 2
    np.testing.assert_allclose(found.q, expected, rtol=0, atol=1e-12)  # rounding of 20 steps at 25 rad
