"""Drags, driven motions, assemblies and runs of a drawing."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("tomlkit")
from gauss_bench.engines import MissingExtra, compiled, not_installed
from gauss_bench.studio.requests import answer
from tests.studio import Watched


def test_marks_of_singular_positions_come_behind_the_motion(bars):
    watched = Watched(bars)
    job, event = bars.ask("motion", samples=4)["job"], watched.until("singular")
    assert event["job"] == job
    assert {x["kind"] for x in event["singular"]} == {"dead centre"}


def test_what_is_drawn_without_a_law_turns_what_can_be_driven(pen):
    pen.bar((0.0, 0.0), (0.1, 0.0))
    assert "driven" in pen.refused("motion")
    pen.ask("ground", pin=pen.at(0.0, 0.0))
    found = pen.ask("motion", samples=4)
    angles = [x[2] for x in found["poses"]["bar1"]]
    assert angles == pytest.approx([k * math.pi / 2 for k in range(5)], abs=1e-9)
    assert "samples" in pen.refused("motion", samples=10**9)
    pen.bar((0.1, 0.0), (0.2, 0.1))
    assert "free" in pen.refused("motion")


@pytest.mark.slow
def test_a_drag_follows_the_pointer_and_is_drawn_where_it_ends(pen):
    x, y = at = next(p["at"] for p in pen.scene("template", name="eight_bar")["pins"] if p["id"] == "5")
    before = pen.session.text
    assert "fixed" in pen.refused("drag_begin", pin="1")
    pen.ask("drag_begin", pin="5")
    for k in range(20):
        found = pen.ask("drag", at=[x - 0.002 * k, y + 0.001 * k])
    moved = np.array(found["poses"]["rocker"])
    assert np.abs(moved - next(x["pose"] for x in pen.now["links"] if x["name"] == "rocker")).max() > 0.05
    assert pen.session.text == before
    kept = pen.scene("drag_end", keep=True)
    drawn = next(x["pose"] for x in kept["links"] if x["name"] == "rocker")
    assert drawn == pytest.approx(moved.tolist(), abs=1e-7)
    assert next(p["at"] for p in kept["pins"] if p["id"] == "5") != pytest.approx(at, abs=1e-3)
    assert kept["problems"] == []
    assert pen.scene("undo")["revision"] > kept["revision"]
    assert pen.session.text == before


@pytest.mark.parametrize(("template", "crank"), [("crank_rocker", "B"), ("eight_bar", "2"), ("five_bar", "B"), ("whitworth", "A")])
def test_a_crank_pin_led_all_round_beside_its_circle_says_nothing(template, crank, pen):
    """The pointer goes around in a wave about the circle, and the crank makes a whole turn with it."""
    pin = next(x for x in pen.scene("template", name=template)["pins"] if x["id"] == crank)
    owner = pin["members"][0].partition(".")[0]
    others = [x for x in pen.now["pins"] if x["ground"] and any(m.startswith(f"{owner}.") for m in x["members"])]
    centre = complex(*others[0]["at"])
    arm = complex(*pin["at"]) - centre
    pen.ask("drag_begin", pin=crank)
    angles = []
    for turn in np.linspace(0.0, 2 * np.pi, 91)[1:]:
        at = centre + arm * np.exp(1j * turn) * (1 + 0.4 * np.sin(5 * turn))
        moved = pen.ask("drag", at=[at.real, at.imag])
        assert moved["note"] is None
        angles.append(moved["poses"][owner][2])
    assert np.ptp(np.unwrap(angles)) > 6.2


def test_a_rocker_drawn_beyond_its_swing_says_that_it_comes_no_nearer_and_no_longer_when_it_comes_back(pen):
    pin = next(x for x in pen.scene("template", name="crank_rocker")["pins"] if x["id"] == "C")
    pen.ask("drag_begin", pin="C")
    assert "cannot come nearer" in pen.ask("drag", at=[pin["at"][0] + 5.0, pin["at"][1]])["note"]
    assert pen.ask("drag", at=[pin["at"][0], pin["at"][1] + 0.01])["note"] is None


def test_locked_angles_hold_a_drag(pen, bars):
    """The angle of a link, and the angle between the two bars of a pin."""
    bars.ask("lock", link="bar1")
    bars.ask("drag_begin", pin=bars.at(0.3, 0.28))
    found = bars.ask("drag", at=[0.2, 0.2])
    assert not found["reached"]
    assert found["poses"]["bar1"][2] == pytest.approx(math.pi / 2, abs=1e-9)
    pen.bar((0.0, 0.0), (0.2, 0.0))
    pen.bar((0.2, 0.0), (0.35, 0.15))
    pen.ask("ground", pin=pen.at(0.0, 0.0))
    pen.ask("lock", joint=pen.at(0.2, 0.0))
    pen.ask("drag_begin", pin=pen.at(0.35, 0.15))
    poses = pen.ask("drag", at=[0.1, 0.35])["poses"]
    assert poses["bar2"][2] - poses["bar1"][2] == pytest.approx(math.pi / 4, abs=1e-9)
    assert poses["bar1"][2] > 0.5


def test_other_branches_have_the_same_input(bars):
    found = bars.ask("branches")["branches"]
    assert len(found) == 2
    assert found[0]["poses"]["bar1"] == pytest.approx(found[1]["poses"]["bar1"], abs=1e-8)
    chosen = bars.scene("branch", index=1)
    drawn = {x["name"]: x["pose"] for x in chosen["links"]}
    assert drawn["bar3"] == pytest.approx(found[1]["poses"]["bar3"], abs=1e-7)
    assert chosen["problems"] == []
    assert bars.refused("branch", index=5)


@pytest.mark.parametrize("link", ['"ghost"', '"ground"', "3", "[1]"])
def test_branches_of_a_file_that_drives_no_link_are_those_of_its_next_input(pen, link):
    driver = f'[scenarios.odd]\nduration = 1.0\ndriver = {{ link = {link}, law = "constant", speed = 1.0 }}\n\n[scenarios.'
    text = (Path(__file__).parents[1] / "mechanisms" / "four_bar.toml").read_text(encoding="utf-8")
    pen.ask("open", text=text.replace("[scenarios.", driver, 1))
    assert len(pen.ask("branches")["branches"]) == 2


def test_instant_centres_lie_on_the_pins_here_and_along_a_motion(bars):
    found = {frozenset(x["links"]): x["at"] for x in bars.ask("centres")["centres"]}
    assert len(found) == 6
    assert found[frozenset({"bar1", "bar2"})] == pytest.approx([0.0, 0.12], abs=1e-9)
    poses = bars.ask("motion", samples=4)["poses"]
    along = bars.ask("centres", along=poses)["centres"]
    for k in range(5):
        here = bars.ask("centres", at={name: list(map(float, x[k])) for name, x in poses.items()})["centres"]
        assert [x["links"] for x in here] == [x["links"] for x in along]
        for one, all_of_them in zip(here, along, strict=True):
            assert one["at"] == pytest.approx(all_of_them["at"][k], abs=1e-9)
    bars.ask("drag_begin", pin=bars.at(0.3, 0.28))
    assert len(bars.ask("drag", at=[0.29, 0.28], centres=True)["centres"]) == 6
    assert "centres" not in bars.ask("drag", at=[0.28, 0.28])
    assert "missing" in bars.refused("centres", at={})
    for wrong in ({}, [], {"bar1": []}, {"bar1": [[0, 0, 0]], "bar2": []}, {"bar1": [[0, 0, 0]]}, {"bar1": ["x"], "bar2": [1]}):
        assert bars.refused("centres", along=wrong)


def test_what_an_engine_or_a_limit_refuses_is_a_sentence(bars):
    assert "no engine" in bars.refused("release", engine="nothing")
    assert bars.refused("release", until=1e9)
    assert "required" in bars.refused("recommend")
    assert bars.refused("recommend", position=-1.0)
    assert answer(bars.session, {"id": 2, "do": "stop", "job": 77})["ok"]


def test_what_is_not_installed_is_said_with_how_to_install_it(bars, monkeypatch):
    def lacking(library):
        raise MissingExtra(not_installed(ImportError(f"no package {library}", name=library)), name=library)

    monkeypatch.setattr(compiled, "require", lacking)
    monkeypatch.setattr("gauss_bench.runs.offers._known", {})
    told = {x["name"]: x for x in bars.ask("hello")["engines"]}
    how = "no package llvmlite; pip install 'gauss-bench[kernel]'"
    assert told["gauss"]["here"]
    assert not told["gauss-native"]["here"]
    assert told["gauss-native"]["reason"] == f"not installed: {how}"
    assert how in bars.refused("release", engine="gauss-native")


def test_a_recommendation_tells_each_answer_as_it_comes_and_all_of_them_at_the_end(monkeypatch):
    """The search itself is replaced here; test_recommend tests it."""
    from gauss_bench.advice.answer import Answer
    from gauss_bench.api import recommend
    from gauss_bench.studio import job

    first = Answer("gauss-native", "ok", settings="default", integrator="rk4", step=1e-3, errors={"position": 1e-6})
    raced = replace(first, ratio=1.0, snippet="import gauss_bench")

    def found(*wanted, better, **more):
        assert wanted[:2] == ("drawn.toml", 1e-3)
        better(first)
        return SimpleNamespace(answers=[raced], advice="take it", truth="certified", remarks=[], complete=True)

    monkeypatch.setattr(recommend, "recommend", found)
    said = []
    job.recommend({"path": "drawn.toml", "position": 1e-3, "scenario": "released", "budget": 30.0}, said.append)
    early, last = said
    assert early["answer"]["ratio"] is None
    assert early["answer"]["setting"]
    assert early["answer"]["error"] == 1e-6
    assert [x["snippet"] for x in last["answers"]] == ["import gauss_bench"]
    assert last["advice"] == "take it"
