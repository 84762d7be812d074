"""Edits of a drawing: the suite reads the saved file, every edit can be undone, and comments stay."""

import base64
import math
import tomllib
import zlib

import numpy as np
import pytest

pytest.importorskip("tomlkit")
from gauss_bench.linkage.load import built_in, load
from gauss_bench.studio.document import write_document
from tests.conftest import DATA, exhaustive
from tests.studio import DRAWN, Pen

EDITS = tomllib.loads((DATA / "page" / "edits.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    return {name: draw(tmp_path_factory.mktemp(name)) for name, draw in DRAWN.items()}


LOOPS = {"four_bar": 1, "quick_return": 2}


@pytest.mark.parametrize("name", DRAWN)
def test_what_was_drawn_from_nothing_assembles_and_is_a_file_that_the_suite_takes(drawn, name):
    """Both scenarios start at the drawing, within the digits of the file."""
    pen, found = drawn[name], drawn[name].now
    assert found["problems"] == []
    counts = {"assembles": True, "dof": 1, "loops": LOOPS[name], "redundant": 0}
    assert found["status"] == counts | {"loop_names": found["status"]["loop_names"]}
    assert len(found["status"]["loop_names"]) == LOOPS[name]
    pen.ask("save", path=f"my_{name}", replace=True)
    file = pen.session.folder / f"my_{name}.toml"
    poses = {x["name"]: x["pose"] for x in found["links"]}
    for scenario in ("released", "driven"):
        mechanism = load(file, scenario)
        for i, link in enumerate(mechanism.links):
            assert abs(math.remainder(mechanism.q0[3 * i + 2] - poses[link.name][2], 2 * math.pi)) < 1e-7
        assert not mechanism.v0.any() or scenario == "driven"


def test_every_edit_is_taken_back_and_made_again(bars):
    last, seen = bars.session.text, []
    while bars.now["can_undo"]:
        seen.append(bars.session.text)
        bars.ask("undo")
    assert bars.now["pins"] == []
    assert len(set(seen)) == len(seen) == 7
    while bars.now["can_redo"]:
        bars.ask("redo")
    assert bars.session.text == last


@pytest.mark.parametrize("name", exhaustive(sorted(built_in()), "crank_slider", "four_bar", "shaper"))
def test_an_edit_leaves_comments_and_everything_else_as_they_were(pen, name):
    before = built_in()[name].read_text(encoding="utf-8")
    pen.ask("template", name=name)
    link = pen.now["links"][0]["name"]
    pen.ask("set", path="gravity", value=[0.0, -1.62])
    pen.ask("rename", what=f"links.{link}", to="renamed_link")
    after = pen.session.text
    comments = [line.partition("#")[2] for line in before.splitlines() if "#" in line]
    assert [line.partition("#")[2] for line in after.splitlines() if "#" in line] == comments
    assert len(after.split()) <= len(before.split()) + 6
    pen.ask("rename", what="links.renamed_link", to=link)
    pen.ask("set", path="gravity", value=tomllib.loads(before).get("gravity"))
    assert tomllib.loads(pen.session.text) == tomllib.loads(before)
    pen.refused("rename", what=f"links.{link}", to="no name")


def test_a_renamed_link_is_the_same_motion(tmp_path, pen):
    pen.ask("template", name="shaper")
    pen.ask("rename", what="links.lever", to="arm")
    pen.ask("rename", what="pins.A", to="77")
    pen.ask("rename", what="slides.slot", to="groove")
    pen.ask("save", path="renamed")
    old, new = load("shaper"), load(tmp_path / "renamed.toml")
    assert np.array_equal(old.q0, new.q0)
    assert [x.name for x in new.links] == ["crank", "block", "arm", "rod", "ram"]


def test_text_that_cannot_be_changed_in_place_is_written_anew():
    """Dotted keys and tables out of order are TOML too."""
    odd = 'name = "odd"\nlinks.a.points = { P = [0.0, 1.0] }\n[joints.x]\ntype = "revolute"\n[links.b]\nmass = 1.0\n[joints.y]\n'
    document = tomllib.loads(odd)
    document["links"]["c"] = {"mass": 2.0}
    document["links"]["a"]["points"] = {"Q": [1.0, 2.0]}
    del document["joints"]["x"]
    assert tomllib.loads(write_document(odd, document)) == document


def test_moving_a_pin_changes_lengths_and_nothing_else_and_a_trial_shows_that_before(bars):
    before, pin = (bars.session.text, bars.session.revision), bars.at(0.3, 0.28)
    tried = bars.ask("move", pin=pin, at=[0.35, 0.3], trial=True)["trial"]
    assert (bars.session.text, bars.session.revision) == before
    found = bars.scene("move", pin=pin, at=[0.35, 0.3])
    assert {key: tried[key] for key in ("links", "pins", "status")} == {key: found[key] for key in ("links", "pins", "status")}
    assert found["status"]["assembles"]
    assert bars.at(0.35, 0.3)
    assert bars.at(0.0, 0.12)
    lengths = {x["name"]: max(p[0] for p in x["points"].values()) for x in found["links"]}
    assert lengths == pytest.approx({"bar1": 0.12, "bar2": math.hypot(0.35, 0.18), "bar3": math.hypot(0.05, 0.3)}, abs=1e-10)


def test_a_length_and_an_angle_are_numbers(bars):
    bars.ask("set_length", link="bar1", a="1", b="3", value=0.1)
    assert bars.now["links"][0]["points"]["3"] == [0.1, 0.0]
    bars.ask("set_angle", link="bar1", value_deg=30.0)
    found = bars.now
    assert found["links"][0]["pose"][2] == pytest.approx(math.radians(30.0), abs=1e-8)
    assert found["status"]["assembles"]
    scenarios = {x["name"]: x["table"] for x in found["scenarios"]}
    assert scenarios["driven"]["driver"]["start_deg"] == pytest.approx(30.0, abs=1e-7)
    assert scenarios["released"]["start"]["angles_deg"]["bar1"] == pytest.approx(30.0, abs=1e-7)
    assert "cannot have an angle" in bars.refused("set_angle", link="bar3", value_deg=0.0)
    found = bars.scene("set_length", link="bar1", a="1", b="3", value=2.0)  # which does not assemble
    assert not found["status"]["assembles"]
    assert found["problems"][0]["level"] == "error"
    assert found["problems"][0]["apart"] > 0.5
    assert bars.scene("undo")["status"]["assembles"]


@pytest.mark.long
def test_forces_act_where_they_are_drawn_and_in_the_free_scenario(bars):
    for force in EDITS["forces"]:
        bars.ask("add_force", **force)
    found = bars.now
    assert found["problems"] == []
    assert len(found["forces"]) == 8
    assert all(x["at"] for x in found["forces"])
    released = next(x for x in found["scenarios"] if x["name"] == "released")
    assert released["table"]["forces"] == [x["id"] for x in found["forces"]]
    bars.ask("add_force", type="cylinder", a=bars.at(0.0, 0.0), b=bars.at(0.3, 0.28))
    assert bars.now["status"] == found["status"] | {"dof": 1, "loops": 2, "loop_names": bars.now["status"]["loop_names"]}
    bars.ask("delete", ids=["forces.cylinder1", "forces.spring1", "links.bar3"])
    assert not any(x["level"] == "error" for x in bars.now["problems"])


def test_joining_and_freeing_pins(pen):
    first = pen.bar((0.0, 0.0), (0.1, 0.0))
    pen.bar((0.2, 0.1), (0.3, 0.05))
    pen.ask("ground", pin=pen.at(0.0, 0.0))
    assert pen.now["pins"][0]["ground"]
    pen.ask("join", pin=pen.at(0.2, 0.1), to=pen.at(0.1, 0.0))
    found = pen.now
    assert pen.at(0.1, 0.0)
    assert found["status"]["dof"] == 2
    assert "on bar1" in pen.refused("join", pin=pen.at(0.0, 0.0), to=pen.at(0.1, 0.0))
    pen.ask("ground", pin=pen.at(0.3, 0.05), on=True)
    assert pen.now["status"]["dof"] == 0
    pen.ask("ground", pin=pen.at(0.3, 0.05), on=False)
    assert pen.now["status"]["dof"] == 2
    assert pen.now["links"][0]["name"] == first


def test_what_cannot_be_drawn_is_refused_with_its_reason(bars):
    text = bars.session.text
    for case in EDITS["refused"]:
        assert case["said"] in bars.refused(**case["message"])
    assert bars.session.text == text


def test_deleting_takes_what_cannot_be_without_it(pen, bars):
    pen.ask("template", name="eight_bar")
    pen.ask("delete", ids=["links.upper"])
    found = pen.now
    assert not any(x["level"] == "error" for x in found["problems"])
    assert {"6", "7", "8"}.isdisjoint(x["joint"] for x in found["pins"])
    pen.ask("delete", ids=["pins.1"])
    assert "crank" not in [x["name"] for x in pen.now["links"]]
    pen.ask("delete", ids=[f"links.{x['name']}" for x in pen.now["links"]])
    assert pen.now["links"] == []
    assert pen.session.text.count("[joints") == 0
    pen.ask("template", name="five_bar")
    assert "driven" in pen.session.text
    pen.ask("delete", ids=["links.left", "links.right"])
    assert "driven" not in pen.session.text, "a scenario ends with the last of its drivers"
    after = bars.scene("delete", ids=["links.bar2"])  # the ends of the bars beside it are loose, each a single pin
    assert (len(after["pins"]), after["problems"]) == (4, [])
    assert bars.scene("undo")["status"]["loops"] == 1


def test_a_drawing_is_exported_as_it_moves(bars):
    assert bars.ask("export", kind="toml")["text"] == bars.session.text
    assert bars.ask("export", kind="svg")["text"].startswith("<svg")
    head, *rows = bars.ask("export", kind="csv", samples=2)["text"].splitlines()
    assert "bar2.P.x [m]" in head
    assert len(rows) == 3
    assert base64.b64decode(bars.ask("export", kind="gif", samples=2)["base64"]).startswith(b"GIF8")
    assert "no export" in bars.refused("export", kind="nothing")


@pytest.mark.slow
def test_an_exported_drawing_comes_back_by_import(pen, bars):
    pytest.importorskip("mujoco")
    drawn, back = bars.now, pen.scene("import", text=bars.ask("export", kind="mujoco")["text"])
    assert back["status"]["dof"] == 1
    assert {x["name"]: x["mass"] for x in back["links"]} == {x["name"]: pytest.approx(x["mass"]) for x in drawn["links"]}


def test_a_linkage_is_a_link_that_carries_itself(pen, bars):
    text, fragment = bars.session.text, bars.ask("share")["fragment"]
    assert set(fragment) <= set("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_")
    assert len(fragment) < 2000
    pen.ask("open", fragment=fragment)
    assert pen.session.text == text
    for spoilt in ("", "AAAA", fragment[:-8], "%%%", fragment + "*"):
        assert pen.refused("open", fragment=spoilt)
    huge = base64.urlsafe_b64encode(zlib.compress(bytes(64 << 20), 9)).decode()
    assert "more than a linkage file" in pen.refused("open", fragment=huge)


def test_a_locked_length_stays_whatever_is_edited(pen):
    """Edits that would change the length are refused and change nothing."""
    plate = pen.plate((0.0, 0.0), (0.3, 0.0), (0.1, 0.2))
    a, b, c = pen.now["links"][0]["points"]
    pen.ask("lock", link=plate, a=a, b=b)
    assert pen.now["links"][0]["locked"]["lengths"] == [[a, b]]
    before = pen.session.text
    assert "locked" in pen.refused("move", pin=pen.at(0.3, 0.0), at=[0.4, 0.0])
    assert "locked" in pen.refused("move", pin=pen.at(0.3, 0.0), at=[0.4, 0.0], trial=True)
    assert "locked" in pen.refused("set_length", link=plate, a=c, b=b, value=0.5)
    assert pen.session.text == before
    pen.ask("move", pin=pen.at(0.1, 0.2), at=[0.1, 0.25])
    pen.ask("lock", link=plate, a=a, b=b, on=False)
    pen.ask("set_length", link=plate, a=a, b=b, value=0.5)


def test_a_picture_is_named_in_scenes_and_outlives_its_process(tmp_path, monkeypatch):
    """The picture is kept with the unsaved drawing, and offered with it after the process has ended."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    pen, url = Pen(tmp_path), "data:image/png;base64,AAAA"
    here = {"at": [0, 0], "width": 1, "height": 1}
    for wrong in (3, {}, here, {"url": "data:text/html,x"} | here, {"url": url} | here | {"width": 0}):
        pen.refused("picture", picture=wrong)
    scene = pen.scene("picture", picture={"url": url, "at": [0, 1], "width": 2, "height": 3})
    assert "url" not in scene["picture"]
    assert pen.ask("behind")["url"] == url
    moved = pen.scene("picture", picture={"at": [5, 1], "width": 4, "height": 6})
    assert moved["picture"] == {"id": scene["picture"]["id"], "at": [5.0, 1.0], "width": 4.0, "height": 6.0}
    after = Pen(tmp_path)
    after.session.autosave.file = after.session.autosave.file.with_name("other.json")  # as of another process
    assert after.scene("recover", take=True)["picture"] == moved["picture"]
    assert after.ask("behind")["url"] == url
    assert not list((tmp_path / "cache").rglob(pen.session.autosave.file.stem + "*")), "what was taken is let go"
    assert after.scene("new")["picture"] is None
    assert not list((tmp_path / "cache").rglob("*.picture"))


def test_an_edit_that_continues_another_is_undone_with_it(pen):
    pen.pin(0.0, 0.0, ground=True)
    alone = pen.session.text
    pen.pin(0.3, 0.0, ground=True)
    pen.ask("add_bar", **{"from": {"pin": pen.at(0.3, 0.0)}, "to": {"at": [0.3, 0.2]}, "continues": True})
    drawn = pen.session.text
    assert len(pen.now["links"]) == 1
    pen.ask("undo")
    assert pen.session.text == alone
    pen.ask("redo")
    assert pen.session.text == drawn
