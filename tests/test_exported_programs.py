"""Exported programs state the error that they have, and one that the suite's judge refuses is not written."""

import re
from dataclasses import replace

import numpy as np
import pytest

import gauss_bench
from gauss_bench.advice.recommending import Recommender
from gauss_bench.advice.truth import NoTruth
from gauss_bench.api import program_error
from gauss_bench.api.exchange import export
from gauss_bench.cli import main
from gauss_bench.exchange import to_c
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.export import KINDS, export_linkage
from gauss_bench.linkage.load import built_in, load
from gauss_bench.mechanism.spaces import angles, places
from gauss_bench.reference.certificate import find_certified
from tests.alone import c_alone, needs_kind, python_alone, rows_of
from tests.conftest import DATA

PROGRAMS = [kind for kind in KINDS if KINDS[kind].is_program]
GRIPPER = str(DATA / "gripper.toml")
STATED = re.compile(r"Error: centres of mass are off by (\S+) m at most, angles by (\S+) rad at most")
KNOWN = re.compile(r"Reference: .*known to (\S+) \(m, rad\)")
ROUNDED = 1.06  # two digits of a stated error
CANNOT = {("excavator", "pinocchio"), ("parallelogram", "casadi"), ("sleigh", "exudyn"), ("sleigh", "pinocchio")}
REFUSED = {  # by the judge at 1 ms -> a step [s] that it accepts, or None
    ("parallelogram", "pinocchio"): None,  # redundant rows drift apart, and the script has no projection
    ("shaper", "exudyn"): 2e-4,
    ("six_bar", "exudyn"): 2e-4,
    ("squeezer", "pinocchio"): 1e-4,
    ("squeezer", "exudyn"): 1e-5,
    ("squeezer", "casadi"): 1e-4,
    ("squeezer", "c"): 1e-4,
}


def run_alone(kind, file):
    """Return the numbers that a program prints with its own end and step."""
    return rows_of(c_alone(file) if kind == "c" else python_alone(file))[1]


def assert_error_held(file, kind, linkage):
    """Compare the end that a program prints with the certified motion, and its error with the one in its head."""
    text, mechanism = file.read_text(encoding="utf-8"), load(linkage)
    stated, known = STATED.search(text), KNOWN.search(text)
    assert stated, text[:2000]
    assert known
    truth = find_certified(mechanism, mechanism.duration)
    last = run_alone(kind, file)[-1]
    assert last[0] == pytest.approx(mechanism.duration)
    off = np.abs(last[1 : 1 + mechanism.n] - truth.q[np.argmin(np.abs(truth.t - mechanism.duration))])
    for found, said in ((places(off).max(), stated[1]), (angles(off).max(), stated[2])):
        assert found <= ROUNDED * (float(said) + float(known[1]))


@pytest.mark.long
@pytest.mark.parametrize("kind", PROGRAMS)
@pytest.mark.parametrize("linkage", built_in())
def test_a_program_of_a_built_in_linkage_holds_the_error_that_it_states(linkage, kind, tmp_path):
    needs_kind(kind)
    file = tmp_path / f"program{KINDS[kind].suffix}"
    if (linkage, kind) in CANNOT:
        with pytest.raises(ExchangeError, match="cannot become"):
            export(linkage, kind, file)
        assert not file.exists()
        return
    found = export(linkage, kind, file)
    assert bool(found.refused) == ((linkage, kind) in REFUSED), found.refused
    assert file.exists() == (not found.refused)
    if step := REFUSED.get((linkage, kind)):
        found = export(linkage, kind, file, step=step, budget=400.0)
        assert not found.refused
    if file.exists():
        assert_error_held(file, kind, linkage)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["c", "casadi"])
def test_a_program_with_a_required_accuracy_holds_it(kind, tmp_path):
    needs_kind(kind)
    file = tmp_path / f"program{KINDS[kind].suffix}"
    found = export("four_bar", kind, file, scenario="torque", position=1e-5)
    assert not found.refused
    assert found.error is not None
    assert found.error.position is not None
    assert 1e-9 < found.error.position <= 1e-5  # it is the cheapest setting, not the most exact one
    assert "Found for at most 1e-05 m" in file.read_text(encoding="utf-8")
    assert_error_held(file, kind, "four_bar")


@pytest.mark.slow
def test_a_program_that_the_judge_refuses_is_written_only_anyway(tmp_path, capsys):
    needs_kind("c")
    file = tmp_path / "crank_slider.c"
    call = ["export", "crank_slider", "--engine", "c", "--step", "0.02", "--out", str(file)]  # too coarse a step
    assert main(call) == 1
    assert "not written: invalid with rk4, projection, step 0.02 s: " in capsys.readouterr().out
    assert not file.exists()
    assert main([*call, "--anyway"]) == 0
    assert "must not be trusted" in capsys.readouterr().out
    assert "WARNING: do not trust this program with rk4, projection, step 0.02 s. invalid: " in file.read_text().splitlines()[1]


@pytest.mark.slow
def test_the_program_in_c_is_judged_by_its_own_numbers(monkeypatch, tmp_path):
    needs_kind("c")
    run = program_error.run_c

    def run_elsewhere(source, n):
        rows, why = run(source, n)
        return replace(rows, q=rows.q + np.linspace(0.0, 1.0, len(rows.t))[:, None]), why

    monkeypatch.setattr(program_error, "run_c", run_elsewhere)
    found = export("crank_slider", "c", tmp_path / "x.c", step=2e-3)
    assert "a link ends up 1 m from where it should be" in found.refused
    monkeypatch.setattr(program_error, "run_c", run)
    monkeypatch.setattr(program_error, "compiler", lambda: None)
    found = export("crank_slider", "c", tmp_path / "x.c", step=2e-3)
    assert not found.refused
    assert "with the same setting, because there is no C compiler" in (tmp_path / "x.c").read_text()


@pytest.mark.long
def test_a_program_without_a_reference_says_why(monkeypatch, tmp_path):
    def know_nothing(*_):
        raise NoTruth("nobody knows")

    monkeypatch.setattr(program_error, "compute_reference", know_nothing)
    found = export("crank_slider", "c", tmp_path / "x.c", step=2e-3)
    assert found.error is not None
    assert found.error.position is None
    assert "Error: not known: no reference could be computed: nobody knows." in (tmp_path / "x.c").read_text()


def test_a_requirement_that_is_not_reached_leaves_no_file(monkeypatch, tmp_path, capsys):
    def know_nothing(recommender):
        raise NoTruth("nobody knows")

    monkeypatch.setattr(Recommender, "search", know_nothing)
    assert main(["export", "pendulum", "--engine", "c", "--position", "1e-9", "--out", str(tmp_path / "x.c")]) == 1
    assert "not written: no setting can be judged: nobody knows" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


@pytest.mark.long("0.0005", "1e-05")
@pytest.mark.slow
@pytest.mark.parametrize("step", [1e-3, 5e-4, 1e-4, 1e-5])
def test_a_program_in_c_passes_no_vanishing_pivot_by_chance(step, tmp_path):
    needs_kind("c")
    with pytest.raises(ExchangeError, match=r"needs a second, at t = 0\.03\d* s for any step"):
        export_linkage(load(GRIPPER, "grip"), "c", step)
    closing = load(GRIPPER, "close")
    file = tmp_path / "close.c"
    file.write_text(export_linkage(closing, "c", step).text)
    last = run_alone("c", file)[-1]
    assert last[1] == pytest.approx(-0.003, abs=1e-12)  # the driver's start and travel: 0.005 - 0.008 m
    assert last[1 + closing.n] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_a_stopped_program_advises_a_smaller_step_only_where_one_helps(monkeypatch, tmp_path):
    needs_kind("c")
    monkeypatch.setattr(to_c, "find_end", lambda *_: None)
    gripper, four_bar = tmp_path / "gripper.c", tmp_path / "four_bar.c"
    gripper.write_text(export_linkage(load(GRIPPER, "grip"), "c", 1e-3).text)
    four_bar.write_text(export_linkage(load("four_bar"), "c", 1e-3).text)
    for step in ("0.0005", "0.0001", "0.00001"):
        with pytest.raises(AssertionError, match=r"t = 0\.034\d* s: a pivot is zero here for any step") as stopped:
            c_alone(gripper, "0.1", step)
        assert "smaller" not in str(stopped.value)
    with pytest.raises(AssertionError, match="the step is too long here; a smaller one may help"):
        c_alone(four_bar, "2", "0.5")
    monkeypatch.undo()
    with pytest.raises(ExchangeError, match="needs a second, or a shorter step"):
        export_linkage(load("four_bar"), "c", 0.2)


@pytest.mark.long
def test_programs_of_recommend_state_their_error_in_metres():
    found = gauss_bench.recommend("four_bar", angle=1e-3, until=0.05, engines=["gauss"], budget=20.0)
    (answer,) = found.answers
    stated = STATED.search(answer.snippet)
    assert float(stated[1]) == pytest.approx(answer.errors["position"], rel=0.06)
    assert KNOWN.search(answer.snippet)
