"""Newton's adapter, with a stand-in that takes the steps of Newton's library; see also `test_engines_elsewhere.py`."""

import sys
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.bench.agreement import KINDS
from gauss_bench.engines.base import Choice
from gauss_bench.engines.newton import adapter, kernels
from gauss_bench.engines.newton.adapter import Newton
from gauss_bench.engines.newton.kernels import Libraries
from gauss_bench.engines.newton.sample import sample_linkage
from gauss_bench.engines.newton.world import World
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.spaces import angles
from gauss_bench.reference.build import random_states
from tests import newton_stand_in
from tests.engine_runs import by_gauss, linkage, moved, ran, relative_error
from tests.newton_stand_in import Kamino

STAND_IN = Libraries(newton_stand_in.warp, newton_stand_in.newton, None)


def mechanism_of(name):
    return load(KINDS, "loaded") if name == "kinds" else linkage(name)


@pytest.fixture
def stand_in(monkeypatch):
    """A stand-in takes the steps of Newton."""
    monkeypatch.setattr(adapter, "load_libraries", lambda: STAND_IN)


def run(mechanism, times, step):
    return ran(Newton(), mechanism, times, step=step)


@pytest.mark.usefixtures("stand_in")
@pytest.mark.parametrize("name", ["crank_slider", "parallelogram", "loaded", "kinds", "slides"])
def test_errors_fall_with_the_step_as_those_of_a_method_of_first_order_do(name):
    mechanism, times = mechanism_of(name), [0.0, 0.02, 0.0205, 0.08]
    true = by_gauss(mechanism, times)
    coarse, fine = (run(mechanism, times, step) for step in (1e-3, 5e-4))
    errors = [np.abs(x.q - true.q).max() for x in (coarse, fine)]
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)
    assert errors[0] < 1e-2
    assert coarse.steps == 20 + 1 + 60
    assert relative_error(coarse.a[0], true.a[0]) < 1e-4


@pytest.mark.usefixtures("stand_in")
@pytest.mark.parametrize("name", ["crank_slider", "parallelogram", "loaded", "kinds", "puck"])
def test_a_step_of_copies_shows_the_accelerations_of_closed_loops(name):
    mechanism = mechanism_of(name)
    states, model = random_states(mechanism, 3), Newton().build(mechanism, Choice())
    found = np.array([model.acceleration(*x) for x in zip(states.t, states.q, states.v, strict=True)])
    assert relative_error(found, states.a) < 1e-4  # positions and velocities are given in single precision


@pytest.mark.usefixtures("stand_in")
def test_a_model_that_has_run_takes_another_step_as_a_new_one_does():
    mechanism, times = load("four_bar", "torque"), [0.0, 0.02]
    model = Newton().build(mechanism, Choice())
    moved(model, times)
    model.choice = Choice(step=2e-3)
    np.testing.assert_array_equal(moved(model, times).q, run(mechanism, times, 2e-3).q)


@pytest.mark.usefixtures("stand_in")
def test_a_crank_that_turns_keeps_count_of_its_turns():
    mechanism = load("four_bar", "torque")
    end, true = (angles(x.q[-1])[0] for x in (run(mechanism, [0.0, 1.0], 5e-3), by_gauss(mechanism, [0.0, 1.0])))
    assert abs(end - true) < 2.0
    assert abs(end) > 2 * np.pi


@pytest.mark.usefixtures("stand_in")
def test_steps_in_which_the_solver_did_not_converge_are_counted(monkeypatch):
    mechanism, times = load("four_bar", "torque"), [0.0, 0.005]
    assert run(mechanism, times, 1e-3).note == ""
    monkeypatch.setattr(Kamino, "fails", True)
    assert run(mechanism, times, 1e-3).note == "Kamino's solver did not converge in 5 of 5 steps"


def test_gaps_of_joints_are_drawn_shut_by_the_share_alpha_in_a_step():
    mechanism = load("crank_slider", "paper")
    q = mechanism.q0 + 1e-4 * np.arange(mechanism.n)
    evaluator = Evaluator(mechanism)
    left = []
    for alpha in (0.0, 0.2):
        world = World(STAND_IN, mechanism, {**Newton.file.options("default"), "alpha": alpha})
        world.put(q, np.zeros(mechanism.n))
        world.step(np.zeros(mechanism.n), 1e-4)
        left.append(evaluator.constraints(0.0, world.state()[0], mechanism.v0).phi)
    np.testing.assert_allclose(left[1], 0.8 * left[0], atol=1e-2 * np.abs(left[0]).max())


def test_each_copy_has_room_for_one_contact_and_each_size_of_steps_in_single_precision_one_recording():
    for copies in (1, 6):
        world = World(STAND_IN, load("four_bar", "torque"), Newton.file.options("default"), copies)
        assert world.solver.model.rigid_contact_max == copies
        for h in (1e-3, 1e-3 * (1 + 1e-12), 5e-4):
            world.step(np.zeros(9 * copies), h)
        assert len(world.graphs) == 2


def test_the_sample_linkage_is_closed_and_has_a_pin_and_a_slide_that_close_no_tree():
    mechanism = sample_linkage()
    assert np.abs(Evaluator(mechanism).constraints(0.0, mechanism.q0, mechanism.v0).phi).max() < 1e-15
    assert {b.kind for b in spanning_tree(mechanism).branches} == {"revolute", "prismatic"}
    assert len(spanning_tree(mechanism).closures) == 1


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A user's cache of its own, and a stand-in for Warp and Newton that can be imported."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setitem(sys.modules, "warp", newton_stand_in.warp)
    monkeypatch.setitem(sys.modules, "newton", newton_stand_in.newton)
    monkeypatch.setattr(kernels, "version", lambda package: "1.0")
    return tmp_path / "gauss-bench" / "kernels" / "warp"


def test_kernels_are_kept_unless_others_may_write_into_the_cache(cache):
    kernels.load_libraries.__wrapped__()
    assert newton_stand_in.warp.config.kernel_cache_dir == str(cache)
    assert cache.parent.stat().st_mode & 0o077 == 0
    cache.parent.chmod(0o777)
    libraries = kernels.load_libraries.__wrapped__()
    place = Path(newton_stand_in.warp.config.kernel_cache_dir)
    assert place.is_dir()
    assert cache.parent not in place.parents
    assert kernels.are_compiled()  # nothing that is compiled before a run would be kept
    libraries.folder.cleanup()


def test_kernels_are_compiled_once_for_each_release(cache, monkeypatch, stand_in):
    newton, tried = Newton(), []
    monkeypatch.setattr(adapter, "compile_kernels", lambda options: tried.append(options["dynamics_solver"]))
    assert newton.unbuilt("default").startswith("Newton's kernels")
    newton.build_once()
    assert sorted(tried) == sorted({x["dynamics_solver"] for x in Newton.settings.values()})
    assert newton.unbuilt("default") == ""
    monkeypatch.setattr(kernels, "version", lambda package: "1.1")
    assert newton.unbuilt("default").startswith("Newton's kernels")
    monkeypatch.undo()
    monkeypatch.setattr(adapter, "load_libraries", lambda: STAND_IN)
    adapter.compile_kernels(Newton.settings["default"])  # by a step that the sample linkage can take
