"""Newton, in an environment of its own: how a linkage is built in it, its refusals, and its errors against certificates.

What needs Newton is skipped without its environment or without its compiled kernels, in CI too. A stand-in for its library then
takes the steps.
"""

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gauss_bench
from gauss_bench.bench.agreement import KINDS
from gauss_bench.compiler import user_cache
from gauss_bench.engines import FILE, environment_of
from gauss_bench.engines.base import Choice
from gauss_bench.engines.newton import adapter, kernels
from gauss_bench.engines.newton.adapter import VARIANTS, Newton
from gauss_bench.engines.newton.kernels import Libraries
from gauss_bench.engines.newton.sample import sample_linkage
from gauss_bench.engines.newton.world import World
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import random_states
from gauss_bench.reference.certificate import certificate_path, read_certificate
from gauss_bench.runs.worker import keep
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory
from tests import newton_stand_in
from tests.conftest import USERS_CACHE
from tests.engine_runs import by_gauss, linkage, relative_error
from tests.newton_stand_in import Kamino

ENVIRONMENT = environment_of("newton")
STAND_IN = Libraries(newton_stand_in.warp, newton_stand_in.newton, None)


def mechanism_of(name: str) -> Mechanism:
    return load(KINDS, "loaded") if name == "kinds" else linkage(name)


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stand-in takes the steps of Newton."""
    monkeypatch.setattr(adapter, "load_libraries", lambda: STAND_IN)


def run(mechanism: Mechanism, times: list[float], step: float, settings: str = "default") -> Trajectory:
    model = Newton().build(mechanism, Choice(settings, "semi_implicit_euler", "none", step))
    model.prepare(np.array(times))
    model.run()
    return model.read()


@pytest.mark.usefixtures("stand_in")
@pytest.mark.parametrize("name", ["crank_slider", "parallelogram", "loaded", "kinds", "slides"])
def test_errors_fall_with_the_step_as_those_of_a_method_of_first_order_do(name: str) -> None:
    mechanism, times = mechanism_of(name), [0.0, 0.03, 0.08]
    true = by_gauss(mechanism, times)
    coarse, fine = (np.abs(run(mechanism, times, step).q - true.q).max() for step in (1e-3, 5e-4))
    assert coarse / fine == pytest.approx(2.0, rel=0.1)
    assert coarse < 1e-2


@pytest.mark.usefixtures("stand_in")
@pytest.mark.parametrize("name", ["crank_slider", "parallelogram", "loaded", "kinds", "puck"])
def test_a_step_of_copies_shows_the_accelerations_of_closed_loops(name: str) -> None:
    mechanism = mechanism_of(name)
    model = Newton().build(mechanism, Choice())
    states = random_states(mechanism, 3)
    for t, q, v, a in zip(states.t, states.q, states.v, states.a, strict=True):
        assert relative_error(model.acceleration(t, q, v), a) < 1e-4  # positions and velocities are given in single precision


@pytest.mark.usefixtures("stand_in")
def test_accelerations_of_samples_are_those_at_their_states() -> None:
    mechanism = load("four_bar", "torque")
    samples = run(mechanism, [0.0, 0.02, 0.0205, 0.04], 1e-3)
    exact = np.array([by_gauss_at(mechanism, *state) for state in zip(samples.t, samples.q, samples.v, strict=True)])
    assert relative_error(samples.a, exact) < 1e-4
    assert samples.steps == 20 + 1 + 20


def by_gauss_at(mechanism: Mechanism, t: float, q: Array, v: Array) -> Array:
    from gauss_bench.engines.interpreted import Interpreted

    return Interpreted("gauss").build(mechanism, Choice("default", "rk4")).acceleration(t, q, v)


@pytest.mark.usefixtures("stand_in")
def test_a_model_that_has_run_takes_another_step_as_a_new_one_does() -> None:
    mechanism, times = load("four_bar", "torque"), [0.0, 0.02]
    model: Any = Newton().build(mechanism, Choice())
    for step in (1e-3, 2e-3):
        model.choice = Choice(step=step)
        model.prepare(np.array(times))
        model.run()
    np.testing.assert_array_equal(model.read().q, run(mechanism, times, 2e-3).q)


@pytest.mark.usefixtures("stand_in")
def test_a_crank_that_turns_keeps_count_of_its_turns() -> None:
    mechanism = load("four_bar", "torque")
    samples = run(mechanism, [0.0, 1.0], 2e-3)
    crank = mechanism.crank
    assert crank is not None
    assert abs(samples.q[-1, 3 * crank + 2] - by_gauss(mechanism, [0.0, 1.0]).q[-1, 3 * crank + 2]) < 1.0
    assert abs(samples.q[-1, 3 * crank + 2]) > 2 * np.pi


@pytest.mark.usefixtures("stand_in")
def test_steps_in_which_the_solver_did_not_converge_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism, times = load("four_bar", "torque"), [0.0, 0.005]
    assert run(mechanism, times, 1e-3).note == ""
    monkeypatch.setattr(Kamino, "fails", True)
    assert run(mechanism, times, 1e-3).note == "Kamino's solver did not converge in 5 of 5 steps"


def test_gaps_of_joints_are_drawn_shut_by_the_share_alpha_in_a_step() -> None:
    mechanism = load("crank_slider", "paper")
    q = mechanism.q0 + 1e-4 * np.arange(mechanism.n)
    evaluator = Evaluator(mechanism)
    left = []
    for alpha in (0.0, 0.2):
        world = World(STAND_IN, mechanism, {**VARIANTS.options("default"), "alpha": alpha})
        world.put(q, np.zeros(mechanism.n))
        world.step(np.zeros(mechanism.n), 1e-4)
        left.append(evaluator.constraints(0.0, world.state()[0], mechanism.v0).phi)
    np.testing.assert_allclose(left[1], 0.8 * left[0], atol=1e-2 * np.abs(left[0]).max())


@pytest.mark.parametrize("copies", [1, 6])
def test_each_copy_has_room_for_one_contact(copies: int) -> None:
    world = World(STAND_IN, load("four_bar", "torque"), VARIANTS.options("default"), copies)
    assert world.solver.model.rigid_contact_max == copies


def test_a_step_is_recorded_once_for_each_size_in_single_precision() -> None:
    world = World(STAND_IN, load("four_bar", "torque"), VARIANTS.options("default"))
    for h in (1e-3, 1e-3 * (1 + 1e-12), 5e-4):
        world.step(np.zeros(9), h)
    assert len(world.graphs) == 2


def test_the_sample_linkage_is_closed_and_has_a_pin_and_a_slide_that_close_no_tree() -> None:
    mechanism = sample_linkage()
    assert np.abs(Evaluator(mechanism).constraints(0.0, mechanism.q0, mechanism.v0).phi).max() < 1e-15
    assert {b.kind for b in spanning_tree(mechanism).branches} == {"revolute", "prismatic"}
    assert len(spanning_tree(mechanism).closures) == 1


@pytest.mark.parametrize(
    ("name", "scenario", "words"),
    [
        ("four_bar", "driven", "would not follow its law"),
        ("excavator", None, "would not follow its law"),
        ("sleigh", None, "Newton has no constraint on velocities alone"),
    ],
)
def test_what_newton_cannot_have_is_refused_by_name(name: str, scenario: str | None, words: str) -> None:
    assert words in str(Newton().skip(load(name, scenario), Choice()))


def test_what_newton_can_have_is_taken() -> None:
    for name in ("crank_slider", "parallelogram", "jansen", "kinds", "loaded"):
        assert Newton().skip(mechanism_of(name), Choice()) is None


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's cache of its own, and a stand-in for Warp and Newton that can be imported."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setitem(sys.modules, "warp", newton_stand_in.warp)
    monkeypatch.setitem(sys.modules, "newton", newton_stand_in.newton)
    monkeypatch.setattr(kernels, "version", lambda package: "1.0")
    return tmp_path / "gauss-bench" / "kernels" / "warp"


def test_kernels_are_kept_where_this_user_alone_may_enter(cache: Path) -> None:
    kernels.load_libraries.__wrapped__()
    assert newton_stand_in.warp.config.kernel_cache_dir == str(cache)
    assert cache.parent.stat().st_mode & 0o077 == 0


def test_kernels_are_in_a_folder_of_the_process_where_others_may_write_into_the_cache(cache: Path) -> None:
    cache.parent.mkdir(parents=True)
    cache.parent.chmod(0o777)
    libraries = kernels.load_libraries.__wrapped__()
    place = Path(newton_stand_in.warp.config.kernel_cache_dir)
    assert place.is_dir()
    assert cache.parent not in place.parents
    assert kernels.are_compiled()  # nothing that is compiled before a run would be kept
    libraries.folder.cleanup()  # type: ignore[attr-defined]


def test_kernels_are_compiled_once_for_each_release(cache: Path, monkeypatch: pytest.MonkeyPatch, stand_in: None) -> None:
    newton, tried = Newton(), []
    monkeypatch.setattr(adapter, "compile_kernels", lambda options: tried.append(options["dynamics_solver"]))
    assert newton.unbuilt("default").startswith("Newton's kernels")
    newton.build_once()
    assert sorted(tried) == sorted({x["dynamics_solver"] for x in VARIANTS.settings.values()})
    assert newton.unbuilt("default") == ""
    monkeypatch.setattr(kernels, "version", lambda package: "1.1")
    assert newton.unbuilt("default").startswith("Newton's kernels")


@pytest.mark.usefixtures("stand_in")
def test_kernels_are_compiled_by_steps_that_any_linkage_takes() -> None:
    for options in VARIANTS.settings.values():
        adapter.compile_kernels(options)


@pytest.fixture
def newton(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The adapter of this package, in the environment of Newton that the user's file of engines names, with the user's kernels."""
    if ENVIRONMENT is None:
        pytest.skip("there is no environment of Newton here")
    monkeypatch.setenv("XDG_CACHE_HOME", os.environ[USERS_CACHE])
    if not [*(user_cache.folder() / kernels.FOLDER).glob(kernels.MADE.format("*"))]:
        pytest.skip("Newton's kernels are not compiled here, which takes minutes")
    path = tmp_path / "engines.toml"
    path.write_text(f'[newton]\npython = "{ENVIRONMENT.python}"\n', encoding="utf-8")
    monkeypatch.setenv(FILE, str(path))
    monkeypatch.setattr("gauss_bench.runs.offers._known", {})
    keep("newton").stop()  # its process may have another file of engines


# crank error after 0.1 s in steps of 1 ms [rad]
MEASURED = [
    ("crank_slider", "paper", "default", 4.6e-3),
    ("crank_slider", "paper", "dvi", 4.8e-3),
    ("four_bar", "torque", "dvi", 3.8e-3),
]


@pytest.mark.slow
@pytest.mark.usefixtures("newton")
@pytest.mark.parametrize(("name", "scenario", "settings", "measured"), MEASURED)
def test_the_crank_is_off_the_certificate_by_as_much_as_was_measured(
    name: str, scenario: str, settings: str, measured: float
) -> None:
    mechanism = load(name, scenario)
    path = certificate_path(mechanism)
    assert path is not None
    certificate = read_certificate(path)
    at = int(np.abs(certificate.t - 0.1).argmin())
    run = gauss_bench.simulate(name, "newton", scenario, settings, step=1e-3, at=[0.0, float(certificate.t[at])])
    assert run.links, run.message
    crank = mechanism.crank
    assert crank is not None
    error = abs(run.links[mechanism.link_name(crank)]["theta"][-1] - certificate.q[at, 3 * crank + 2])
    assert 0.9 * measured < error < 1.1 * measured
