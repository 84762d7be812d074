"""Test the atlas: its families of linkages, verdicts with known answers, and the search for the limit of a way."""

import itertools
import json
import os
import signal
import time
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from gauss_bench.atlas import survey as surveying
from gauss_bench.atlas.chart import BAR, FAILED, chart, fraction, number, page
from gauss_bench.atlas.families import FAMILIES, SCENARIO, pendulum
from gauss_bench.atlas.survey import EngineSetting, Linkages, Reach, describe, find_reach
from gauss_bench.atlas.table import row, rows_of
from gauss_bench.atlas.verdict import PASSES, RunVerdict, Verdict, decide
from gauss_bench.cli import main
from gauss_bench.engines.interpreted import Interpreted
from gauss_bench.linkage.load import load, load_document
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.report import rows as rows_module
from gauss_bench.report.site.engine import engine_page
from gauss_bench.runs.one_run import Run, sampling, sampling_at
from gauss_bench.runs.worker import Worker
from gauss_bench.tables import read_table, write_table
from gauss_bench.trajectory import Reference, Status, Trajectory
from tests.engine_runs import by_gauss

SVG = "{http://www.w3.org/2000/svg}"
WAY = EngineSetting("gauss", "default", "rk4", "none")


def of(family, value):
    return load_document(FAMILIES[family].document(value), SCENARIO)


def test_rungs_are_round_numbers_from_easy_to_hard():
    assert FAMILIES["size"].values == (1, 2, 4, 8, 16, 32, 64)
    assert FAMILIES["mass"].values[::12] == (1.0, 1e6)
    for name, digits in {"singular": "125", "mass": "13", "stiffness": "13", "speed": "13", "step": "125"}.items():
        rungs = FAMILIES[name].values
        round_numbers = [float(f"{digit}e{power}") for power in range(-4, 8) for digit in digits]
        between = [x for x in round_numbers if min(rungs) <= x <= max(rungs)]
        assert rungs == tuple(between if name != "singular" else reversed(between))  # small angles are hard


def test_every_family_assembles_at_both_ends():
    for family in FAMILIES.values():
        for value in (family.values[0], family.values[-1]):
            mechanism = of(family.name, value)
            assert mechanism.dof == 1
            assert np.abs(Evaluator(mechanism).constraints(0.0, mechanism.q0, mechanism.v0).phi).max() < 1e-10


def test_the_smallest_transmission_angle_is_the_one_asked_for():
    for angle in (20.0, 1.0, 0.01):
        links = FAMILIES["singular"].document(angle)["links"]
        a, b, c = (max(x[0] for x in links[name]["points"].values()) for name in ("crank", "coupler", "rocker"))
        cosines = (b**2 + c**2 - np.array([1 - a, 1 + a]) ** 2) / (2 * b * c)
        folded = np.minimum(np.arccos(cosines), np.pi - np.arccos(cosines))
        assert np.degrees(folded.min()) == pytest.approx(angle, rel=1e-6)


def test_families_differ_in_what_they_say_and_in_nothing_else():
    assert [of("redundancy", x).redundant for x in (0.0, 1.0, 3.0)] == [0, 1, 3]
    assert [len(of("size", x).links) for x in (1.0, 8.0)] == [3, 17]
    even, uneven = of("mass", 1.0), of("mass", 100.0)
    np.testing.assert_allclose(even.links[0].mass / uneven.links[0].mass, 100.0)
    assert even.links[1].mass == uneven.links[1].mass
    np.testing.assert_allclose(of("speed", 30.0).v0, 10 * of("speed", 3.0).v0, rtol=1e-12)
    assert FAMILIES["step"].document(1e-3) == FAMILIES["step"].document(1e-1)


def test_many_windows_move_as_one_pendulum():
    mechanism, t = of("size", 4.0), np.linspace(0.0, 0.1, 5)
    q, v, a = pendulum(4.0, t, 1e-12)
    np.testing.assert_allclose(q[0], mechanism.q0, atol=1e-12)
    rows = Evaluator(mechanism).constraints(t, q, v)
    assert np.abs(rows.phi).max() < 1e-12
    model = Interpreted("gauss").build(mechanism, surveying.Choice("default", "rk4"))
    for k in range(len(t)):
        np.testing.assert_allclose(model.acceleration(float(t[k]), q[k], v[k]), a[k], atol=1e-9)


@pytest.fixture(scope="module")
def known():
    """A pendulum of windows, a run without any error, and the reference."""
    mechanism, wanted = of("size", 1.0), sampling(1e-2, 0.1)
    states = pendulum(1.0, wanted.times, 1e-12)
    run = Run(Status.OK, "", Trajectory(wanted.times, *states, 10), None, wanted)
    return mechanism, run, Reference.with_one_bar(run.trajectory, "closed form")


def shifted(run, by):
    """Return a run with all links moved along x [m], so that loops on the ground open by as much."""
    q = run.trajectory.q.copy()
    q[5:, 0::3] += by
    return replace(run, trajectory=replace(run.trajectory, q=q))


def test_verdicts_follow_their_numbers(known):
    mechanism, run, reference = known
    for by, verdict in ((0.0, Verdict.PASS), (0.9e-3, Verdict.PASS), (1.1e-3, Verdict.DEGRADED), (0.02, Verdict.FAILED)):
        found = decide(mechanism, shifted(run, by), reference)
        assert (found.verdict, found.error) == (verdict, pytest.approx(by, rel=1e-9))
    assert "loops open by 0.02" in found.reason
    for status in (Status.CRASHED, Status.TIMEOUT, Status.NAN, Status.NOT_CONVERGED):
        ended = decide(mechanism, replace(run, status=status, message="why", trajectory=None), reference)
        assert (ended.verdict, ended.reason) == (Verdict.FAILED, f"{status}: why")
    skipped = replace(run, status=Status.SKIP, message="no such model", trajectory=None)
    assert decide(mechanism, skipped, reference).verdict is Verdict.CANNOT


def test_an_error_is_a_share_of_the_linkages_size():
    """The size of the four-bar is not one metre."""
    mechanism = load("four_bar", "conservative")
    x = by_gauss(mechanism, 1e-3 * np.arange(11), integrator="rk4")
    truth = Reference.with_one_bar(x, "the run itself")
    assert mechanism.size < 0.8
    run = shifted(Run(Status.OK, "", x, None, sampling(1e-3, 0.01)), 0.5 * PASSES * mechanism.size)
    assert decide(mechanism, run, truth).error == pytest.approx(0.5 * PASSES, rel=1e-9)
    for share, verdict in ((0.9, Verdict.PASS), (1.1, Verdict.OPEN)):
        assert decide(mechanism, run, Reference.with_one_bar(x, "", share * 1e-4 * mechanism.size)).verdict is verdict


def test_halving_finds_where_a_way_breaks(monkeypatch, tmp_path):
    family = FAMILIES["size"]
    for passing, degraded in itertools.product(range(8), (0, 1, 3)):
        verdicts = [Verdict.PASS] * passing + [Verdict.DEGRADED] * degraded + [Verdict.FAILED] * 7
        answer = {value: RunVerdict(verdicts[i], 1e-6, f"at {value:g}") for i, value in enumerate(family.values)}
        monkeypatch.setattr(surveying, "judge_run", lambda way, family, value, *_, answer=answer: answer[value])
        found = find_reach(WAY, family, Linkages(tmp_path), Worker(), lambda: 0.0)
        ends = min(passing + degraded, 7)
        assert found.passes_to == (family.values[passing - 1] if passing else None)
        assert found.ends_at == (family.values[ends - 1] if ends else None)
        assert found.reason == ("" if passing == 7 else f"at {family.values[passing]:g}")
        assert found.runs <= 7
        assert row(found)["breaks_at"] == (None if passing == 7 else family.values[passing])


def test_a_search_that_is_cut_tells_no_more_than_it_ran(monkeypatch, tmp_path):
    family, said = FAMILIES["size"], {1.0: Verdict.PASS, 64.0: Verdict.FAILED}
    monkeypatch.setattr(
        surveying, "judge_run", lambda way, family, value, *_: RunVerdict(said.get(value, Verdict.OPEN), 0.0, "no time")
    )
    found = find_reach(WAY, family, Linkages(tmp_path), Worker(), lambda: 0.0)
    assert (found.passes_to, found.ends_at, found.last, found.reason) == (1.0, 1.0, Verdict.OPEN, "no time")
    assert row(found)["breaks_at"] is None
    assert FAILED not in chart([found], alone=True)
    assert "≥ 1" in chart([found], alone=True)


def test_a_reference_is_made_once_and_its_bar_is_what_a_looser_tolerance_changes(monkeypatch, tmp_path):
    def run_apart(request, mechanism, *_):
        t = request.wanted.times
        states = np.full((3, len(t), mechanism.n), 1e6 * request.choice.tolerance)
        return Run(Status.OK, "", Trajectory(t, *states, 10), None, request.wanted)

    monkeypatch.setattr(surveying, "run_apart", run_apart)
    linkages, worker, family = Linkages(tmp_path), Worker(), replace(FAMILIES["size"], truth=None)
    mechanism, reference = linkages.prepare(family, 1.0, worker)
    assert linkages.prepare(family, 1.0, worker)[0] is mechanism
    assert isinstance(reference, Reference)
    assert (reference.q.max(), reference.error_q.max()) == (pytest.approx(1e-6), pytest.approx(99e-6))
    lost = Run(Status.CRASHED, "why", None, None, sampling(1e-2, 0.1))
    monkeypatch.setattr(surveying, "run_apart", lambda *_: lost)
    assert Linkages(tmp_path).prepare(family, 1.0, worker)[1] == "no reference: why"


def test_the_end_of_a_way_is_described_by_its_verdict():
    for last, said in {Verdict.FAILED: "then why", Verdict.OPEN: "then open: why", Verdict.CANNOT: "then cannot: why"}.items():
        assert describe(Reach(WAY, "size", 1.0, 1.0, last, "why", 0.0, 3)) == f"passes to 1; {said}"


def test_a_survey_that_is_interrupted_begins_no_further_run(monkeypatch):
    begun, told = list[float](), list[str]()

    def looked_at(way, family, value, linkages, worker, left):
        if left > 0:
            begun.append(value)
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.2)
        return RunVerdict(Verdict.PASS if value < family.values[-1] and left > 0 else Verdict.OPEN)

    monkeypatch.setattr(surveying, "judge_run", looked_at)
    with pytest.raises(KeyboardInterrupt):
        surveying.survey([WAY], [FAMILIES["size"], FAMILIES["mass"]], surveying.BUDGET, 1, told.append)
    assert len(begun) == 1
    assert told == ["settings of engines: 1; axes: 2"]


def test_times_that_are_compared_lie_on_whole_steps():
    assert len(surveying.comparison_times(1e-3, 0.5)) == 101
    np.testing.assert_allclose(surveying.comparison_times(5e-4, 0.5), np.arange(101) * 5e-3, atol=1e-15)
    np.testing.assert_allclose(surveying.comparison_times(0.1, 0.5), np.arange(6) * 0.1)
    assert sampling_at(0.1, surveying.comparison_times(0.1, 0.5)).shortened == 0


def some():
    """Return reaches of two ways along all axes, the first of which the engine cannot model."""
    found = []
    for family in FAMILIES.values():
        for way in (WAY, EngineSetting("mujoco", "tuned", "rk4", "none")):
            found.append(Reach(way, family.name, *family.values[:2], Verdict.FAILED, 'off & <"out">', 1e-5, 5))
    return [replace(found[0], passes_to=None, ends_at=None, last=Verdict.CANNOT, reason="cannot hold it"), *found[1:]]


def test_a_bar_is_as_long_as_its_way_goes():
    family = FAMILIES["size"]
    assert [fraction(family, x) for x in (None, 1.0, 64.0)] == [0.0, pytest.approx(1 / 7), 1.0]
    one = Reach(WAY, "size", 8.0, 16.0, Verdict.FAILED, "too large", 1e-9, 5)
    bars = [x for x in ET.fromstring(chart([one], alone=True)).iter(f"{SVG}rect") if x.get("width") != "100%"]
    widths = [float(x.attrib["width"]) for x in bars]
    assert widths == pytest.approx([BAR, BAR * 5 / 7, BAR * 4 / 7], abs=0.1)
    assert [number(x) for x in (1e6, 1e-4, 0.01, 300.0)] == ["1e6", "1e-4", "0.01", "300"]


def test_tables_tell_all_and_escape_what_others_said(tmp_path):
    write_table("atlas", rows_of(some(), "0123456789ab"), tmp_path)
    rows = read_table("atlas", tmp_path)
    assert len(rows) == 2 * len(FAMILIES)
    assert {x["last"] for x in rows} == {"failed", "cannot"}
    engine = str(rows[0]["engine"])
    shown = engine_page(rows_module.Run({}, {"atlas": tuple(rows)}), engine).body
    assert shown.count("<tr") == 1 + sum(x["engine"] == engine for x in rows)
    written = page(some())
    assert '<"out">' not in written
    assert "&lt;" in written
    assert "http" not in written.replace("http://www.w3.org/2000/svg", "")


def test_what_the_budget_does_not_reach_stays_open(tmp_path, capsys):
    assert main(["atlas", "--engine", "lagrange", "--axis", "size", "--budget", "1e-9", "--json", "--out", str(tmp_path)]) == 0
    assert [x.name for x in surveying.choose_settings(["gauss"])] == ["gauss", "gauss + projection"]
    assert [x.name for x in surveying.choose_axes(["speed", "size"])] == ["speed", "size"]
    told = capsys.readouterr()
    assert {x["last"] for x in json.loads(told.out)} == {"open"}
    assert "not reached within the budget" in told.err
    assert sorted(x.name for x in tmp_path.iterdir()) == ["atlas.csv", "atlas.svg", "checksums.json", "index.html"]
