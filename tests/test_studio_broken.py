"""Unfinished and faulty linkages: the readable part is shown, faults are explained, no request ends in a fault of the studio."""

import math
import stat
import tomllib

import pytest

pytest.importorskip("tomlkit")
from gauss_bench.linkage.load import built_in
from gauss_bench.studio.requests import answer
from tests.conftest import DATA, exhaustive
from tests.studio import Pen, four_bar

BASE = built_in()["four_bar"].read_text(encoding="utf-8")
FOUND = tomllib.loads((DATA / "page" / "broken.toml").read_text(encoding="utf-8"))
BROKEN = FOUND["broken"]


def broken(name, folder):
    """Return a drawing with the fault that the data file describes."""
    how, pen = BROKEN[name], Pen(folder)
    for x, y in how.get("pins", []):
        pen.pin(x, y, ground="ground" in how)
    for a, b in how.get("bars", []):
        pen.bar(tuple(a), tuple(b))
    if "old" in how:
        assert how["old"] in BASE
        pen.ask("open", text=BASE.replace(how["old"], how["new"]))
    if "drawn" in how:
        pen.ask("open", text=four_bar(folder).session.text)
    if "asked" in how:
        pen.ask(**how["asked"])
    return pen


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_is_shown_and_explained_in_place(tmp_path, name):
    word, where, found = BROKEN[name].get("word", ""), BROKEN[name].get("where", ""), broken(name, tmp_path).now
    told = [x for x in found["problems"] if word in x["text"]]
    if word:
        assert told, [x["text"] for x in found["problems"]]
    if where:
        assert any(y.startswith(where) for x in told for y in x["where"]), told
    for x in found["problems"]:
        assert x["level"] in ("error", "warning", "hint")
        assert "Traceback" not in x["text"]
    numbers = [y for x in found["links"] for y in x["pose"]] + [y for x in found["pins"] for y in x["at"]]
    assert all(map(math.isfinite, numbers))
    if name not in ("nothing", "a lone pin", "a lone pivot"):
        assert found["links"], "what is left is drawn"


@pytest.mark.slow
@pytest.mark.parametrize("name", exhaustive(BROKEN, "a loose chain", "no sketch", "a scenario that cannot start"))
def test_nothing_asked_of_what_is_broken_is_a_fault(tmp_path, name):
    """Each request gets a result, or a sentence that refuses it."""
    pen = broken(name, tmp_path)
    for message in FOUND["asked"]:
        found = answer(pen.session, {"id": 1} | message)
        assert found["ok"] or (found["error"]["text"] and not found["error"].get("fault")), (message, found)


HOSTILE = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "\u202eabc",
    "../../etc/passwd",
    "\x00",
    "x\ny",
    "a" * 100_000,
)


def test_names_and_paths_that_mean_harm_are_refused(tmp_path, bars):
    text = bars.session.text
    for word in HOSTILE:
        assert bars.refused("rename", what="links.bar1", to=word)
        for do, key in (("save", "path"), ("open", "name"), ("template", "name")):
            assert bars.refused(do, **{key: word}), word
        assert bars.refused("set", path=word, value=1.0)
        assert bars.refused("picture", picture={"url": word})
    assert bars.session.text == text
    assert [*tmp_path.iterdir()] == []


def test_files_are_of_the_working_folder_alone(tmp_path):
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    inside.mkdir()
    outside.mkdir()
    (outside / "secret.toml").write_text(BASE, encoding="utf-8")
    (inside / "link.toml").symlink_to(outside / "secret.toml")
    pen = Pen(inside)
    for name in ("../outside/secret.toml", str(outside / "secret.toml"), "link.toml"):
        assert "outside" in pen.refused("open", name=name)
        assert "outside" in pen.refused("save", path=name)
    assert (outside / "secret.toml").read_text(encoding="utf-8") == BASE


def test_a_file_is_replaced_only_where_that_is_wished_and_possible(tmp_path, bars):
    file = tmp_path / "mine.toml"
    file.write_text(theirs := "# mine\n", encoding="utf-8")
    assert "exists already" in bars.refused("save", path="mine")
    assert file.read_text(encoding="utf-8") == theirs
    bars.ask("save", path="mine", replace=True)
    assert not bars.now["unsaved"]
    bars.ask("set", path="title", value="Changed")
    assert bars.now["unsaved"]
    bars.ask("save")
    assert "built-in" in bars.refused("save", path="eight_bar")
    bars.ask("set", path="title", value="Changed here")
    file.write_text(theirs := file.read_text(encoding="utf-8") + "# and there\n", encoding="utf-8")
    assert "changed by another program" in bars.refused("save")
    file.chmod(stat.S_IRUSR)
    assert "may only be read" in bars.refused("save", replace=True)
    assert file.read_text(encoding="utf-8") == theirs
    file.chmod(stat.S_IRUSR | stat.S_IWUSR)
    assert bars.scene("save", replace=True)["unsaved"] is False


def test_a_template_is_unsaved_only_once_it_is_changed(tmp_path, pen):
    """A template can be opened again, so nothing of an unchanged template is kept."""
    for how in (
        {"do": "template", "name": "crank_rocker"},
        {"do": "open", "name": "four_bar"},
        {"do": "template", "name": "klann"},
    ):
        assert pen.scene(**how)["unsaved"] is False
        assert not pen.session.close(), "nothing would be offered again"
    assert pen.scene("set", path="title", value="Mine")["unsaved"] is True
    assert pen.scene("undo")["unsaved"] is False
    pen.ask("save", path="mine")
    assert (tmp_path / "mine.toml").exists(), "an unchanged template is saved like anything else"
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    assert pen.scene("open", text=text)["unsaved"] is True, "the server cannot have a text of the page again"


def test_half_a_drawing_is_saved_and_opened_as_it_is(tmp_path, pen):
    pen.pin(0.5, 0.5)
    pen.bar((0.0, 0.0), (0.1, 0.0))
    before = pen.now["pins"]
    pen.ask("save", path="half")
    other = Pen(tmp_path)
    assert other.scene("open", name="half.toml")["pins"] == before
