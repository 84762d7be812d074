"""Test simulate, compare and kinematics: steps and times, the limits of the judge, results, and former names."""

import json
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

import gauss_bench
from gauss_bench.api.exchange import Export
from gauss_bench.bench.cases import Case, as_asked
from gauss_bench.judge import Subject, completeness, examine, judge
from gauss_bench.linkage.load import built_in, load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference.build import sample_times
from gauss_bench.runs.offers import ChoiceError, duration, usable_steps
from gauss_bench.runs.one_run import sampling, sampling_through
from tests.engine_runs import by_gauss


@pytest.mark.parametrize(
    ("step", "t_end", "count", "shortened"), [(4e-4, 0.5, 1250, 0), (7e-4, 0.5, 715, 1), (1e-3, 2.0, 2000, 0), (0.3, 0.5, 2, 1)]
)
def test_a_step_is_the_step_that_is_taken(step, t_end, count, shortened):
    found = sampling(step, t_end, sample_times(t_end))
    assert (found.count, found.shortened, bool(found.note)) == (count, shortened, bool(shortened))
    assert (found.times[0], found.times[-1]) == (0.0, pytest.approx(t_end, abs=1e-12))
    whole = found.times[:-1] if shortened else found.times
    assert np.abs(whole / step - np.round(whole / step)).max() < 1e-6


def test_a_time_that_whole_steps_miss_is_met_by_two_short_ones():
    found = sampling_through(1e-4, [0.0, 0.01375 + 2e-5, 0.02])
    assert 0.01375 + 2e-5 in found.times
    assert (found.shortened, found.count) == (2, 201)


@pytest.mark.slow
def test_compare_labels_a_row_with_the_step_it_took():
    rows = gauss_bench.compare("four_bar", ["gauss"], steps=(4e-4, 7e-4), t_end=0.1, jobs=1)
    plain = rows[(rows["stabilization"] == "none") & (rows["integrator"] == "rk4")].set_index("step")
    assert plain[["steps", "compared"]].loc[[4e-4, 7e-4]].to_numpy().tolist() == [[250, 11], [143, 3]]  # at 0, 0.07 and the end
    assert plain.loc[4e-4, "note"] == ""
    assert "1 of 143 steps" in plain.loc[7e-4, "note"]
    assert plain.loc[4e-4, "measured_unit"] == "rad"
    assert plain.loc[4e-4, "position_error"] == max(plain.loc[4e-4, ["length_error", "angle_error"]])


def test_how_long_and_by_which_steps():
    assert [duration(5.0), duration(5.0, 2.0), duration(5.0, 2.0, 0.5)] == [5.0, 2.0, 0.5]
    assert usable_steps([1e-3, 1e-2, 1e-3], 1.0) == (1e-2, 1e-3)
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(ChoiceError):
            duration(1.0, until=wrong)
        with pytest.raises(ChoiceError):
            usable_steps([wrong], 1.0)
    with pytest.raises(ChoiceError, match=r"longer than the run of 0\.5 s"):
        usable_steps([1.0], 0.5)
    listed, other = (
        Case(*x, "gauss", "default", "rk4", "none", 1e-3, 2.0) for x in (("four_bar", "torque"), ("squeezer", "squeeze"))
    )
    assert [c.t_end for c in as_asked([listed, other])] == [2.0, 0.03]
    assert [(c.step, c.t_end) for c in as_asked([listed], 0.5, [1e-4])] == [(1e-4, 0.5)]


def test_the_judge_objects_to_missing_samples_and_to_nothing_in_a_sound_run():
    mechanism = load("four_bar", "conservative")
    n, x = mechanism.n, by_gauss(mechanism, np.arange(201) * 1e-3, integrator="rk4", stabilization="projection")
    assert judge(examine(Evaluator(mechanism), x, None, 0.0)).valid
    shifts = {0.0: True, 0.5e-9: True, 2e-9: False}
    assert {by: completeness(replace(x, t=x.t + by), x.t, n).valid for by in shifts} == shifts
    lost = np.where(np.arange(201)[:, None] == 100, np.nan, x.q)
    spoilt = (x[:5], replace(x, t=2 * x.t), replace(x, q=x.q[:, :3]), None, replace(x, q=lost))
    verdicts = [completeness(y, x.t, n) for y in spoilt]
    assert [y.objections[0].subject for y in verdicts] == [Subject.COMPLETENESS] * 4 + [Subject.NUMBERS]
    assert "5 of 201 samples" in verdicts[0].sentence


def test_public_functions_return_objects_that_are_read_by_key_and_as_json():
    import gauss_bench.kinematics.motion  # a room of the same name does not hide the function

    assert all(callable(getattr(gauss_bench, name)) for name in gauss_bench.__all__ if name != "__version__")
    run = gauss_bench.simulate("four_bar", "gauss", at=[0.1])
    assert run.valid
    assert run["status"] == run.status == "ok"
    assert json.loads(run.to_json())["links"].keys() == run.links.keys()


def test_a_driver_starts_where_the_scenario_does(tmp_path):
    path = tmp_path / "four_bar.toml"
    content, own = built_in()["four_bar"].read_text(encoding="utf-8"), 'law = "constant", start_deg = 0.0'
    assert own in content
    path.write_text(content.replace(own, 'law = "constant", start_deg = 30.0', 1), encoding="utf-8")
    laws = {"constant": 30.0, "poly345:travel_deg=20,time=1": 30.0, "constant:speed=1": 30.0, "constant:speed=1,start_deg=10": 10.0}
    for law, start in laws.items():
        found = gauss_bench.kinematics(str(path), "driven", driver=law, intervals=2)
        assert found.driver["angle"][0] == pytest.approx(np.radians(start), abs=1e-12)


def test_former_names_serve_for_one_release_with_a_warning():
    with pytest.warns(DeprecationWarning, match="intervals"):
        assert len(gauss_bench.kinematics("four_bar", steps=2).t) == 3
    former = import_module("gauss_bench.mechanism.load")
    with pytest.warns(DeprecationWarning, match=r"gauss_bench\.linkage\.load"):
        assert former.load is gauss_bench.load
    with pytest.warns(DeprecationWarning, match=r"gauss_bench\.api\.exchange\.Export"):
        assert import_module("gauss_bench.api.results").Export is Export
    mechanism = gauss_bench.load("four_bar")
    with pytest.warns(DeprecationWarning, match="find_body"):
        assert mechanism.placed("crank") == mechanism.find_body("crank")
    with pytest.warns(DeprecationWarning, match="find_point"):
        assert mechanism.named_point("ground.A").name == "ground.A"
