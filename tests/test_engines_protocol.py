"""The interface of engines: all that is asked stands in one place with its default, and engines from outside may offer it all."""

import ast
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
import gauss_bench.bench.conformance as rules
from gauss_bench.advice.recommending import TriedSetting
from gauss_bench.api.telling import render
from gauss_bench.bench import provenance
from gauss_bench.bench.cases import Case
from gauss_bench.bench.conformance import conformance
from gauss_bench.bench.measure import measure
from gauss_bench.bench.ways import Run, Way, evaluate_run, one_step
from gauss_bench.engines.base import OPTIONAL, REQUIRED, Engine, EngineDefaults, ModelDefaults, ask, has_own, list_lacking
from gauss_bench.engines.bullet.adapter import Bullet
from gauss_bench.judge import cut_at_fault
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.metrics import compare_joint_forces, joint_forces
from gauss_bench.reach import Requirement, Trial, convergence, reach, trial_of
from gauss_bench.runs.apart import Request, run_of
from gauss_bench.runs.offers import NOT_INSTALLED, Offer, offer
from gauss_bench.runs.one_run import sampling_at
from gauss_bench.runs.programs import LONGEST, read_program
from gauss_bench.trajectory import RunFailure, Status, Trajectory
from tests.engine_runs import certified

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "gauss_bench"
PAGES = PACKAGE / "docs" / "pages"
TEMPLATE = PAGES / "template" / "trees"
FAULTY = "tests.faulty_engines"
ASKED = {*OPTIONAL, *REQUIRED}


def calls_of(source):
    return [x for x in ast.walk(ast.parse(source)) if isinstance(x, ast.Call) and isinstance(x.func, ast.Name)]


def asks_an_engine(call):
    """Whether a call is getattr or hasattr of an engine or model, or of one of their members by name."""
    if not (isinstance(call.func, ast.Name) and call.func.id in ("getattr", "hasattr")):
        return False
    whom, what = call.args[:2]
    named = isinstance(what, ast.Constant) and what.value in ASKED
    return named or "engine" in ast.unparse(whom) or ast.unparse(whom).startswith(("get(", "model", "adapter"))


@pytest.fixture(scope="module")
def calls():
    """All calls of functions by name in files that ask engines: base.py, and all files outside the adapters' own folders."""
    folders = [PAGES, *(x for x in (PACKAGE / "engines").iterdir() if x.is_dir())]
    files = [path for path in PACKAGE.rglob("*.py") if not any(x in path.parents for x in folders)]
    return [x for path in files for x in calls_of(path.read_text(encoding="utf-8"))]


def test_no_caller_has_a_default_of_its_own(calls):
    """Only base.py itself, by `ask` and `has_own`, looks for members of engines and models."""
    found = sorted(ast.unparse(x) for x in calls if asks_an_engine(x))
    assert found == ["getattr(engine, x, None)"], "ask(engine, member) of engines/base.py knows the default"
    callers = calls_of("getattr(x, 'first', ()), hasattr(engine, 'name'), getattr(reference, 'q')")
    assert [asks_an_engine(x) for x in callers] == [True, True, False]


def test_an_engine_that_has_nothing_optional_is_asked_nothing_else(calls):
    """Callers ask for optional members of the interface only, and some caller asks for each of them."""
    asked = [x.args[1] for x in calls if ast.unparse(x.func) == "ask" and len(x.args) == 2]
    assert {x.value for x in asked if isinstance(x, ast.Constant)} == {*OPTIONAL}


def test_the_page_of_engines_has_every_optional_member_with_its_default():
    page = (PAGES / "engine.md").read_text(encoding="utf-8")
    rows = {name: more for name, *more in re.findall(r"^\| `([a-z_]+)[^|]*\| ([^|]+) \| ([^|]+) \|$", page, re.MULTILINE)}
    assert {*OPTIONAL} <= rows.keys() <= {*OPTIONAL} | {x for x in dir(Engine) if not x.startswith("_")}
    for member in OPTIONAL:
        default, meaning = rows[member]
        assert len(meaning) > 10
        value = getattr(OPTIONAL[member], member)
        shown = "none" if value in ((), {}) else repr(value).replace("'", '"')
        assert callable(value) or default.strip("`") == shown


class Bare:
    """An engine with the required members only."""

    name, integrators, stabilizations, settings, native_loop, python_loop = "bare", ("a",), ("none",), {"default": {}}, False, True
    version = skip = build = print


class Heir(Bare, EngineDefaults):
    """The same, with inherited defaults and one member of its own."""

    first = ("one",)


def test_what_an_engine_lacks_is_the_default_inherited_or_not():
    for engine in (Bare(), Heir()):
        assert ask(engine, "adaptive") == ("dop853",)
        assert ask(engine, "unbuilt")("default") == ""
        assert ask(engine, "in_python")(None, None) == "not told"
        assert not has_own(engine, "program")
        with pytest.raises(RunFailure, match="writes no programs"):
            ask(engine, "program")(None, None)
        assert not list_lacking(engine)
    assert ask(Bare(), "first") == ()
    assert ask(Heir(), "first") == ("one",)
    assert has_own(Heir(), "first")
    assert ask(object(), "joint_forces")(0.0, None, None) == {}
    assert list_lacking(object()) == list(REQUIRED)
    with pytest.raises(KeyError):
        ask(Bare(), "firsts")
    assert {*vars(EngineDefaults)} & {*vars(ModelDefaults)} <= {x for x in vars(EngineDefaults) if x.startswith("_")}


# Steps that are not counted


def test_a_run_whose_steps_nobody_counts_has_none_and_no_cost_a_step():
    run = gauss_bench.simulate("four_bar", f"{FAULTY}:Chooser", at=[0.0, 0.05])
    assert run.status is Status.OK
    assert run.metrics["steps"] is None
    assert run.metrics["step_time"] is None
    text = render("simulate", run)
    assert re.search(r"^steps +- \(the engine does not count them\)$", text, re.MULTILINE)
    assert "step_time" not in text
    case = Case("four_bar", "torque", f"{FAULTY}:Chooser", "default", run.integrator, "none", 1e-3, 0.05)
    row = measure(case, "nowhere")["results"][0]
    assert (row["status"], row["steps"]) == ("ok", None)


def test_equal_steps_that_are_not_counted_are_those_asked_for_and_chosen_ones_are_unknown():
    mechanism = load("four_bar")
    run, truth = Run("four_bar", mechanism, 0.5), certified(mechanism, 0.5)
    equal = evaluate_run(run, Evaluator(mechanism), truth, Way(f"{FAULTY}:Uncounted", "default", "rk4", "none", 0.005), False, 10)
    chosen = evaluate_run(run, Evaluator(mechanism), truth, Way(f"{FAULTY}:Chooser", "default", "dop853", "none", 1e-8), True, 10)
    assert (equal.status, equal.steps) == (Status.OK, 100)
    assert (chosen.status, chosen.steps) == (Status.OK, None)
    assert chosen.errors["position"] < 1e-6


def test_work_of_unknown_steps_is_infinite_unless_evaluations_are_counted():
    way = Way("gauss", "default", "rk4", "none", 1e-6)
    assert TriedSetting(way, Trial(1e-6, {}, 100)).work == 400
    assert TriedSetting(way, Trial(1e-6, {}, None)).work == math.inf
    assert TriedSetting(way, Trial(1e-6, {}, None, evaluations=70)).work == 70
    wanted = Requirement("position", 1e-6)
    uncounted = [Trial(x, {"position": 1e-3}, None) for x in (1e-3, 1e-4, 1e-5, 1e-6)]
    assert reach([uncounted], [wanted]).words == "not reached"
    assert all(map(math.isnan, convergence(uncounted, [wanted])))
    row = {"tolerance": 1e-6, "step": math.nan, "steps": math.nan, "position_error": 1e-7, "status": "ok"}
    assert trial_of(row).steps is None
    assert trial_of(row | {"steps": 12.0}).steps == 12


def test_a_cost_a_step_needs_a_count_and_what_is_no_count_is_refused():
    choice = offer("lagrange").choose(None, "rk4", None, 1e-3)
    run = run_of(Request("four_bar", "torque", "lagrange", choice, sampling_at(1e-3, [0.0, 0.01])), load("four_bar"), 60.0)
    assert run.step_time == run.seconds / 10
    assert replace(run, trajectory=replace(run.trajectory, steps=None)).step_time is None
    for steps, known in ((10, True), (None, True), (-1, False), ("many", False), (10**400, False)):
        told = replace(run.trajectory, steps=steps)
        assert (cut_at_fault(told, run.trajectory.t, 9) is not None) is known


# What engines from outside may offer


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ({"text": "x = '\0'"}, "is no program in Python"),
        ({"text": "  \n"}, "is no program of at most"),
        ({"text": "#" * (LONGEST + 1)}, "is no program of at most"),
        (None, "is no program of at most"),
        ({"refused": "no slides"}, "^no slides$"),
    ],
)
def test_what_is_no_program_is_not_written(answer, words):
    with pytest.raises(RunFailure, match=words):
        read_program("heun", answer)
    assert read_program("heun", {"text": "#" * LONGEST}) == "#" * LONGEST


def test_versions_of_the_packages_that_engines_name_are_provenance(monkeypatch):
    offers = [
        Offer("one", packages={"library": "2.5", "numpy": np.__version__, "gone": NOT_INSTALLED}),
        Offer("two", packages={"library": "2.6"}),
    ]
    monkeypatch.setattr(provenance, "offers_from_outside", lambda: offers)
    found = provenance.package_versions()
    assert (found["library"], found["library of two"], found["numpy"]) == ("2.5", "2.6", np.__version__)
    assert not [x for x in found if x.startswith(("gone", "numpy of"))]


# Joint forces


def test_joint_forces_that_an_engine_tells_are_compared_with_those_of_the_accelerations():
    mechanism = load("four_bar")
    truth = certified(mechanism, 0.5)
    states = Trajectory(truth.t[:3], truth.q[:3], truth.v[:3], truth.a[:3], None)
    found = joint_forces(Evaluator(mechanism), states)
    told = np.array([[x["fx"], x["fy"], x["moment"]] for x in found.values()]).transpose(2, 0, 1)
    largest = np.abs(told).max()
    assert compare_joint_forces(Evaluator(mechanism), states, told) == (0.0, largest)
    told[1, 2, 0] += 3.0
    told[0, 1] = np.nan  # a joint that the engine does not tell
    assert compare_joint_forces(Evaluator(mechanism), states, told) == (pytest.approx(3.0), largest)
    assert np.isnan(compare_joint_forces(Evaluator(mechanism), states, np.full_like(told, np.nan))[0])


@pytest.mark.long
def test_conformance_and_diagnose_look_at_joint_forces(monkeypatch):
    monkeypatch.setattr(rules, "CHECKS", [x for x in rules.CHECKS if x.__name__ == "check_joint_forces"])
    sound, opposed, silent = (conformance(f"{FAULTY}:{x}")[-1] for x in ("Reacting", "Opposed", "Sound"))
    assert sound.passed
    assert float(re.fullmatch(r"agree to (\d+\.\d) digits", sound.message)[1]) > 9
    assert opposed.passed is False
    assert "off by" in opposed.message
    assert (silent.passed, silent.message) == (None, "it reports none")
    remarks = gauss_bench.diagnose("four_bar", f"{FAULTY}:Opposed", until=0.1).remarks
    off, largest = map(float, re.findall(r"\d\.\de[+-]\d+", next(x for x in remarks if "joint forces" in x)))
    assert off == pytest.approx(2 * largest, rel=0.06)  # each is the opposite of what it should be; both are rounded
    assert not gauss_bench.diagnose("four_bar", f"{FAULTY}:Sound", until=0.1).remarks


def test_a_whole_run_whose_steps_nobody_counts_is_one_repetition():
    run, way = Run("four_bar", load("four_bar"), 0.01), Way(f"{FAULTY}:Chooser", "default", "dop853", "none", 1e-3)
    assert [one_step(run, way, steps, {}).count for steps in (None, 7)] == [1, 7]


def test_a_class_derived_from_an_adapter_has_its_settings():
    class Derived(Bullet):
        name = "derived"

    assert Derived.settings == Bullet.settings
