"""Pinocchio: on and off the constraints its accelerations are those of Gauss's principle; the suite's integrators step them.

Its compiled loop computes what calls from Python compute; it is built once, in bounded memory, or is missing.
"""

import os
import stat
import sys
from dataclasses import replace
from threading import Thread

import numpy as np
import pytest

from gauss_bench.compiler import user_cache
from gauss_bench.engines.base import Choice
from gauss_bench.engines.pinocchio import build as building
from gauss_bench.engines.pinocchio import compiled
from gauss_bench.engines.pinocchio.adapter import Pinocchio
from gauss_bench.engines.pinocchio.tree import Multibody, verify
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.formulations.gauss import gauss
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Revolute
from gauss_bench.reference.build import random_states
from gauss_bench.terms import baumgarte
from gauss_bench.trajectory import RunFailure, Status
from tests.conftest import USERS_CACHE, everything, exhaustive, needs, redundant
from tests.engine_runs import LINKAGES, acceleration_errors, by_gauss, linkage, moved, relative_error
from tests.engine_runs import ran as ran_in

pinocchio = needs("pinocchio")

ENGINE = Pinocchio()
MORE = ("swinging_block", "parallelogram")
LAWS = [("shaper", "driven"), ("five_bar", "driven")]


def made(name):
    others = {"redundant": redundant, "everything": lambda: replace(everything(), knife_edges=())}
    return others[name]() if name in others else linkage(name, "torque" if name == "parallelogram" else None)


def build(mechanism, **choice):
    return ENGINE.build(mechanism, Choice(**{"integrator": "rk4", **choice}))


def ran(mechanism, times, **choice):
    return ran_in(ENGINE, mechanism, times, **choice)


@pytest.mark.parametrize("settings", Pinocchio.settings)
@pytest.mark.parametrize("name", exhaustive(["everything", "redundant", *MORE], "everything", "redundant"))
def test_accelerations_of_closed_states_are_those_of_gauss(name, settings):
    mechanism = made(name)
    errors = acceleration_errors(ENGINE, mechanism, settings, random_states(mechanism, 25))
    assert errors.max() < 1e-10  # rounding, amplified by transmission angles, is 3e-13


@pytest.mark.parametrize("stabilization", ["none", "baumgarte"])
@pytest.mark.parametrize(
    ("name", "scenario"),
    exhaustive(
        [*((x, None) for x in (*LINKAGES, "swinging_block")), *LAWS], ("eight_bar", None), ("swinging_block", None), LAWS[0]
    ),
)
def test_open_loops_and_links_off_their_laws_are_drawn_back_as_the_suite_does_it(name, scenario, stabilization, rng):
    mechanism = linkage(name, scenario)
    tree, evaluator, model = spanning_tree(mechanism), Evaluator(mechanism), build(mechanism, stabilization=stabilization)
    y0, dy0 = tree.relative(mechanism.q0, mechanism.v0)
    for t in (0.0, 0.2, 0.3):
        y, dy = y0 + 1e-2 * rng.standard_normal(tree.n), dy0 + rng.standard_normal(tree.n)
        q, v, a = tree.absolute(y, dy, model.stabilized(t, y, dy))
        terms = evaluator.terms(t, q, v)
        assert np.abs(terms.phi).max() > 1e-4  # off the constraints, or nothing is shown
        expected = gauss(baumgarte(terms, 20.0, 20.0) if stabilization == "baumgarte" else terms).a
        assert relative_error(a, expected) < 1e-10  # rounding, amplified by transmission angles


def test_only_forces_that_bend_with_the_state_are_evaluated_each_time():
    """Torques, dampers of joints and springs along slides are linear in tree coordinates; a spring between turning links is not."""
    assert "spring" in ran(made("swinging_block"), np.array([0.0, 0.01])).note
    for name in LINKAGES:
        assert build(load(name)).forces.others == ()


@pytest.mark.parametrize("settings", Pinocchio.settings)
def test_redundant_rows_that_part_end_the_run_and_projection_keeps_them_together(settings):
    """The three cranks of a parallelogram drift until they lock each other: no answer is better than that one."""
    mechanism, times = made("parallelogram"), np.linspace(0.0, 2.0, 5)
    with pytest.raises(RunFailure, match="redundant") as failure:
        ran(mechanism, times, settings=settings)
    assert failure.value.status is Status.NOT_CONVERGED
    together = ran(mechanism, times[:2], settings=settings, stabilization="projection")
    assert np.abs(together.q - by_gauss(mechanism, times[:2]).q).max() < 1e-8  # RK4 at 1 ms


@pytest.mark.parametrize("name", exhaustive(LINKAGES, "crank_slider"))
def test_a_model_of_another_mechanism_is_refused(name):
    mechanism = load(name)
    tree, last = spanning_tree(mechanism), mechanism.links[-1]
    up = np.array([0.0, 1e-6])
    moved = [replace(x, b=replace(x.b, local=x.b.local + up)) if isinstance(x, Revolute) else x for x in mechanism.joints]
    for change in (
        {"gravity": mechanism.gravity + up},
        {"links": (*mechanism.links[:-1], replace(last, mass=last.mass * (1 + 1e-6)))},
        {"joints": tuple(moved)},
    ):
        other = replace(mechanism, **change)
        with pytest.raises(RunFailure, match="differs from the linkage"):
            verify(Multibody(pinocchio, other, spanning_tree(other)), mechanism, tree)


@pytest.mark.parametrize("stabilization", Pinocchio.stabilizations)
@pytest.mark.parametrize("name", ["four_bar", "swinging_block"])
def test_an_exploding_run_ends_in_a_sentence(name, stabilization):
    wild = made(name)
    wild = replace(wild, forces=(*wild.forces, *(replace(f, c=1e9) for f in wild.forces if f.name == "brake")))
    with pytest.raises(RunFailure, match="t = ") as failure:
        ran(wild, np.linspace(0.0, 1.0, 3), integrator="rk4", step=0.02, stabilization=stabilization)
    assert failure.value.status in (Status.NAN, Status.NOT_CONVERGED)


# The compiled loop

COMPILED = "compiled/rk4/least depth"
SEARCHED = exhaustive(["crank_slider", "five_bar", "jansen", "eight_bar", "everything"], "crank_slider", "everything")


@pytest.fixture
def built(monkeypatch):
    """The loop of the user's own cache: no test builds it."""
    monkeypatch.setenv("XDG_CACHE_HOME", os.environ[USERS_CACHE])
    if reason := building.explain_missing() or building.explain_absence():
        pytest.skip(reason)


def pair(mechanism, integrator, stabilization="none", **choice):
    """The models of the same settings, called from Python and compiled."""
    both = ("one_iteration", "one_iteration,loop=compiled")
    return [ENGINE.build(mechanism, Choice(x, integrator, stabilization, **choice)) for x in both]


@pytest.mark.usefixtures("built")
@pytest.mark.parametrize("name", SEARCHED)
def test_accelerations_of_the_compiled_loop_are_those_of_calls_from_python(name):
    mechanism = made(name)
    python, own_loop = pair(mechanism, "rk4")
    states = random_states(mechanism, 20)
    for q, v in zip(states.q, states.v, strict=True):
        assert relative_error(own_loop.acceleration(0.0, q, v), python.acceleration(0.0, q, v)) < 1e-12


@pytest.mark.usefixtures("built")
@pytest.mark.parametrize("stabilization", ["none", "baumgarte"])
@pytest.mark.parametrize("integrator", ["rk4", "dop853_fixed", "dop853"])
def test_runs_of_the_compiled_loop_are_those_of_calls_from_python(integrator, stabilization):
    models = pair(load("five_bar"), integrator, stabilization, step=0.01)
    python, own_loop = (moved(model, [0.0, 0.013, 0.2, 0.21, 0.5]) for model in models)
    assert np.abs(np.array([python.q, python.v, python.a]) - np.array([own_loop.q, own_loop.v, own_loop.a])).max() < 1e-8
    assert python.steps == own_loop.steps
    assert 0.9 * python.evaluations < own_loop.evaluations <= python.evaluations  # scipy evaluates the ends of refused steps too


@pytest.mark.usefixtures("built")
def test_a_failure_of_the_compiled_loop_names_the_last_sample_before_it():
    """At this tolerance the redundant rows of the parallelogram drift apart, but not at once."""
    choice = Choice("one_iteration,loop=compiled", "dop853", tolerance=1e-3)
    model = ENGINE.build(load("parallelogram"), choice)
    with pytest.raises(RunFailure, match=r"^after t = 0\.5 s: proximal"):
        moved(model, [0.0, 0.25, 0.5, 1.0, 2.0])


def test_what_the_loop_does_not_run_is_refused_by_name():
    four_bar, driven = load("four_bar"), load("crank_slider", "driven")
    assert "does not support projection" in str(ENGINE.skip(four_bar, Choice(COMPILED, "rk4", "projection")))
    assert "has no lcaba" in str(ENGINE.skip(four_bar, Choice("articulated/rk4/least depth,loop=compiled", "rk4")))
    assert "does not support drivers" in str(ENGINE.skip(driven, Choice(COMPILED, "rk4")))


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(building, "NEEDED", {})  # headers
    building._describe_compiler.cache_clear()
    compiled._load_library.cache_clear()  # another test of this process may have loaded the user's
    return tmp_path


def compiler_in(folder, monkeypatch, body):
    """A stand-in for the compiler, which is found first: it writes down its arguments and does as `body` says."""
    program = folder / "c++"
    text = f"""#!{sys.executable}
import sys, time, resource
if "--version" in sys.argv:
    print("stand-in 1"); raise SystemExit
open({str(folder / "calls")!r}, "a").write(" ".join(sys.argv[1:]) + chr(10))
target = sys.argv[sys.argv.index("-o") + 1]
{body}
"""
    program.write_text(text)
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr(building, "find_prefix", lambda: folder)
    return folder / "calls"


WRITES = 'open(target, "w").write("library of " + str(resource.getrlimit(resource.RLIMIT_AS)[0]))'


def test_a_loop_is_built_once_with_generic_alignment_and_bounded_memory(own_cache, monkeypatch):
    calls = compiler_in(own_cache, monkeypatch, f"time.sleep(0.3)\n{WRITES}")
    with pytest.raises(RunFailure, match="not built yet") as caught:  # a run does not build it
        ENGINE.build(load("four_bar"), Choice(COMPILED, "rk4"))
    assert caught.value.status is Status.SKIP
    assert "2 minutes" in ENGINE.unbuilt(COMPILED)
    assert not ENGINE.unbuilt("default")
    both = [Thread(target=building.build_loop) for _ in range(2)]
    for x in both:
        x.start()
    for x in both:
        x.join()
    (arguments,) = calls.read_text().splitlines()
    assert "-march" not in arguments
    assert f"-Wl,-rpath,{own_cache / 'lib'}" in arguments
    assert building.load_loop() == f"library of {3 << 30}".encode()
    assert not ENGINE.unbuilt(COMPILED)


def test_another_source_flag_or_compiler_is_another_loop(own_cache, monkeypatch):
    compiler_in(own_cache, monkeypatch, WRITES)
    building.build_loop()
    source = own_cache / "loop.cpp"
    source.write_text("// another")
    others = {"FLAGS": (*building.FLAGS, "-g"), "SOURCE": source, "_describe_compiler": lambda program: "stand-in 2"}
    for name, other in others.items():
        assert not building.explain_absence()
        with monkeypatch.context() as patch:
            patch.setattr(building, name, other)
            assert building.explain_absence()


@pytest.mark.parametrize(("body", "said"), [('sys.exit("no such header")', "no such header"), ("time.sleep(60)", "did not finish")])
def test_a_build_that_fails_leaves_nothing(body, said, own_cache, monkeypatch):
    compiler_in(own_cache, monkeypatch, body)
    monkeypatch.setattr(building, "LONGEST", 1.0)
    with pytest.raises(RunFailure, match=said):
        building.build_loop()
    assert [x.suffix for x in user_cache.folder().iterdir()] == [".lock"]
    assert building.explain_absence()


def test_without_a_compiler_or_headers_a_run_is_skipped_with_the_reason(monkeypatch, tmp_path):
    choice = Choice(COMPILED, "rk4")
    for program, root, reason in ((None, building.find_prefix(), "no C++ compiler"), ("c++", tmp_path, "headers")):
        monkeypatch.setattr(building, "find_compiler", lambda program=program: program)
        monkeypatch.setattr(building, "find_prefix", lambda root=root: root)
        assert reason in str(ENGINE.skip(load("four_bar"), choice))
    assert ENGINE.skip(load("four_bar"), Choice("default", "rk4")) is None
