"""One recipe, one judge, and one way to ask for more: what simulate, compare and kinematics promise."""

import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench import judge as judging
from gauss_bench.bench.cases import Case, as_asked
from gauss_bench.cli import main
from gauss_bench.engines.base import Choice
from gauss_bench.engines.interpreted import Interpreted
from gauss_bench.judge import Subject, completeness, examine, judge
from gauss_bench.linkage.load import built_in, load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.metrics import Drift
from gauss_bench.reference.build import sample_times
from gauss_bench.runs.offers import ChoiceError, duration, usable_steps
from gauss_bench.runs.one_run import sampling, sampling_through
from gauss_bench.trajectory import Status, Trajectory


@pytest.mark.parametrize(
    ("step", "t_end", "count", "shortened"),
    [(4e-4, 0.5, 1250, 0), (7e-4, 0.5, 715, 1), (1e-3, 2.0, 2000, 0), (1e-2, 0.5, 50, 0), (1e-4, 1.0, 10000, 0), (0.3, 0.5, 2, 1)],
)
def test_a_step_is_the_step_that_is_taken(step: float, t_end: float, count: int, shortened: int) -> None:
    found = sampling(step, t_end, sample_times(t_end))
    assert (found.count, found.shortened) == (count, shortened)
    assert bool(found.note) is bool(shortened)
    assert found.times[0] == 0.0
    assert found.times[-1] == pytest.approx(t_end, abs=1e-12)
    whole = found.times[:-1] if shortened else found.times
    assert np.abs(whole / step - np.round(whole / step)).max() < 1e-6


def test_a_time_that_whole_steps_miss_is_met_by_two_short_ones() -> None:
    found = sampling_through(1e-4, [0.0, 0.01375 + 2e-5, 0.02])
    assert 0.01375 + 2e-5 in found.times
    assert found.shortened == 2
    assert found.count == 201


@pytest.mark.slow
def test_compare_labels_a_row_with_the_step_it_took() -> None:
    rows = gauss_bench.compare("four_bar", ["gauss"], steps=(4e-4, 7e-4), t_end=0.1, jobs=1)
    plain = rows[(rows["stabilization"] == "none") & (rows["integrator"] == "rk4")].set_index("step")
    assert plain.loc[4e-4, "steps"] == 250
    assert plain.loc[4e-4, "compared"] == 11
    assert plain.loc[4e-4, "note"] == ""
    assert plain.loc[7e-4, "steps"] == 143
    assert plain.loc[7e-4, "compared"] == 3  # 0, 0.07 and the end
    assert "1 of 143 steps" in plain.loc[7e-4, "note"]
    assert plain.loc[4e-4, "measured_unit"] == "rad"
    assert plain.loc[4e-4, "position_error"] == max(plain.loc[4e-4, ["length_error", "angle_error"]])


def test_how_long_and_by_which_steps() -> None:
    assert duration(5.0) == 5.0
    assert duration(5.0, 2.0) == 2.0
    assert duration(5.0, 2.0, 0.5) == 0.5
    assert usable_steps([1e-3, 1e-2, 1e-3], 1.0) == (1e-2, 1e-3)
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(ChoiceError):
            duration(1.0, until=wrong)
        with pytest.raises(ChoiceError):
            usable_steps([wrong], 1.0)
    with pytest.raises(ChoiceError, match=r"longer than the run of 0\.5 s"):
        usable_steps([1.0], 0.5)
    listed = Case("four_bar", "torque", "gauss", "default", "rk4", "none", 1e-3, 2.0)
    other = Case("squeezer", "squeeze", "gauss", "default", "rk4", "none", 1e-3, 2.0)
    assert [c.t_end for c in as_asked([listed, other])] == [2.0, 0.03]
    assert [(c.step, c.t_end) for c in as_asked([listed], 0.5, [1e-4])] == [(1e-4, 0.5)]


@pytest.fixture(scope="module")
def run() -> tuple[Evaluator, Trajectory]:
    mechanism = load("four_bar", "conservative")
    model = Interpreted("gauss").build(mechanism, Choice("default", "rk4", "projection", 1e-3))
    model.prepare(np.arange(201) * 1e-3)
    model.run()
    return Evaluator(mechanism), model.read()


def changed(trajectory: Trajectory, **columns: object) -> Trajectory:
    return Trajectory(**{k: columns.get(k, getattr(trajectory, k)) for k in ("t", "q", "v", "a", "steps")})  # type: ignore[arg-type]


def test_the_judge_has_nothing_to_say_of_a_sound_run(run: tuple[Evaluator, Trajectory]) -> None:
    evaluator, trajectory = run
    assert completeness(trajectory, trajectory.t, evaluator.mechanism.n).valid
    assert judge(examine(evaluator, trajectory, None, 0.0)).valid


def test_missing_samples_are_objected_to(run: tuple[Evaluator, Trajectory]) -> None:
    evaluator, x = run
    n = evaluator.mechanism.n
    five = Trajectory(x.t[:5], x.q[:5], x.v[:5], x.a[:5], 5)
    lost = np.where(np.arange(201)[:, None] == 100, np.nan, x.q)
    told = [completeness(y, x.t, n) for y in (five, changed(x, t=2 * x.t), changed(x, q=x.q[:, :3]), None, changed(x, q=lost))]
    assert [y.objections[0].subject for y in told] == [Subject.COMPLETENESS] * 4 + [Subject.NUMBERS]
    assert "5 of 201 samples" in told[0].sentence
    assert completeness(changed(x, t=x.t + 0.5e-9), x.t, n).valid
    assert not completeness(changed(x, t=x.t + 2e-9), x.t, n).valid


def test_each_limit_of_the_judge_holds_from_both_sides(run: tuple[Evaluator, Trajectory]) -> None:
    evaluator, trajectory = run
    plain = vars(examine(evaluator, trajectory, None, 0.0)) | {"size": 0.5, "energy_scale": 10.0, "energy_bar": 0.02}
    still = np.zeros(201)

    def subjects(**found: object) -> list[Subject]:
        return [x.subject for x in judge(judging.Evidence(**plain | found)).objections]  # type: ignore[arg-type]

    assert subjects(acceleration_error=0.9e-2) == []
    assert subjects(acceleration_error=1.1e-2) == [Subject.MODEL]
    assert subjects(acceleration_error=float("nan")) == [Subject.MODEL]
    assert subjects(drift=Drift(still + 4.9e-3, still, still)) == []
    assert subjects(drift=Drift(still + 5.1e-3, still, still)) == [Subject.LOOPS]
    assert subjects(drift=Drift(still + 0.9e-2, still, still), size=20.0) == []
    assert subjects(drift=Drift(still + 1.1e-2, still, still), size=20.0) == [Subject.LOOPS]
    assert subjects(energy=still - 0.11) == []
    assert subjects(energy=still - 0.13) == [Subject.ENERGY]
    far = judging.metrics.Errors(still, still, np.full((201, 3), 0.024), np.full((201, 3), 0.049), still, still, still)
    off = judging.metrics.Errors(still, still, np.full((201, 3), 0.026), np.full((201, 3), 0.051), still, still, still)
    assert subjects(errors=far) == []
    assert subjects(errors=off) == [Subject.MOTION] * 2


def test_simulate_does_not_call_ok_what_may_not_be_used(capsys: pytest.CaptureFixture[str]) -> None:
    control = gauss_bench.simulate("four_bar", "yuan_ge_eq16", at=[0.1])
    assert control.status is Status.INVALID
    assert not control.valid
    assert control.objections[0].subject is Subject.MODEL
    assert "accelerations off" in control.message
    assert main(["simulate", "four_bar", "--integrator", "euler", "--step", "0.01", "--at", "1", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["status"] == "invalid"
    assert {x["subject"] for x in found["objections"]} >= {"loops"}
    assert found["t"] == [1.0]  # what was computed is shown all the same


def test_results_read_as_objects_by_key_and_as_json() -> None:
    found = gauss_bench.simulate("four_bar", "gauss", at=[0.1])
    assert found.valid
    assert found["status"] == found.status == "ok"
    assert json.loads(found.to_json())["links"].keys() == found.links.keys()


def test_public_functions_stand_beside_each_other() -> None:
    import gauss_bench.kinematics.motion  # a room of the same name does not hide the function

    assert {"simulate", "compare", "kinematics", "certify", "compile_kernel", "Kernel"} <= set(gauss_bench.__all__)
    assert all(callable(getattr(gauss_bench, name)) for name in gauss_bench.__all__ if name != "__version__")
    found = gauss_bench.kinematics("jansen", intervals=2)
    assert found.observed["links"]
    assert found.link_types["crank"]
    assert found.branch_changes == []


@pytest.mark.parametrize(("start", "law"), [(30.0, "constant"), (30.0, "poly345:travel_deg=20,time=1"), (30.0, "constant:speed=1")])
def test_a_driver_starts_where_the_scenario_does(start: float, law: str, tmp_path: Path) -> None:
    path = tmp_path / "four_bar.toml"
    content = built_in()["four_bar"].read_text(encoding="utf-8")
    own = 'law = "constant", start_deg = 0.0'
    assert own in content
    path.write_text(content.replace(own, f'law = "constant", start_deg = {start}', 1), encoding="utf-8")
    found = gauss_bench.kinematics(str(path), "driven", driver=law, intervals=4)
    assert found.driver["angle"][0] == pytest.approx(np.radians(start), abs=1e-12)
    given = gauss_bench.kinematics(str(path), "driven", driver="constant:speed=1,start_deg=10", intervals=2)
    assert given.driver["angle"][0] == pytest.approx(np.radians(10.0), abs=1e-12)


def test_the_former_name_of_intervals_serves_for_one_release() -> None:
    with pytest.warns(DeprecationWarning, match="intervals"):
        found = gauss_bench.kinematics("four_bar", steps=2)
    assert len(found.t) == 3


def test_a_linkage_is_read_under_the_rooms_former_name_too_with_a_warning() -> None:
    former = import_module("gauss_bench.mechanism.load")
    with pytest.warns(DeprecationWarning, match=r"gauss_bench\.linkage\.load"):
        read = former.load
    assert read is gauss_bench.load
