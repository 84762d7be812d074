"""Half-drawn and broken linkages: each is shown as far as it goes and explained in place; nothing ends in a fault of the studio."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("tomlkit")
from gauss_bench.linkage.load import built_in
from gauss_bench.studio.requests import answer
from tests.studio import Pen, four_bar

BASE = built_in()["four_bar"].read_text(encoding="utf-8")


def lone_pin(pen: Pen) -> None:
    pen.pin(0.1, 0.2)


def lone_pivot(pen: Pen) -> None:
    pen.pin(0.1, 0.2, ground=True)


def loose_bar(pen: Pen) -> None:
    pen.bar((0.0, 0.0), (0.3, 0.1))


def loose_chain(pen: Pen) -> None:
    pen.bar((0.0, 0.0), (0.3, 0.1))
    pen.bar((0.3, 0.1), (0.5, 0.0))


def rigid_triangle(pen: Pen) -> None:
    pen.pin(0.0, 0.0, ground=True)
    pen.pin(0.4, 0.0, ground=True)
    pen.bar((0.0, 0.0), (0.2, 0.3))
    pen.bar((0.2, 0.3), (0.4, 0.0))


def block_on_nothing(pen: Pen) -> None:
    pen.ask("add_slide", at=[0.2, 0.1], guide="ground", angle_deg=30.0)


def too_long_a_crank(pen: Pen) -> None:
    pen.ask("open", text=BASE.replace("B = [0.12, 0.0] }", "B = [3.0, 0.0] }"))


def text(old: str, new: str) -> Callable[[Pen], None]:
    def opened(pen: Pen) -> None:
        assert old in BASE
        pen.ask("open", text=BASE.replace(old, new))

    return opened


def nothing(pen: Pen) -> None:
    """An empty drawing."""


def cut_four_bar(pen: Pen) -> None:
    pen.ask("open", text=four_bar(pen.session.folder).session.text)
    pen.ask("delete", ids=["links.bar2"])


BROKEN: dict[str, tuple[Callable[[Pen], None], str, str]] = {  # how it is drawn, a word of the explanation, where it is told
    "nothing": (nothing, "nothing is drawn yet", ""),
    "a lone pin": (lone_pin, "holds nothing", "pins.1"),
    "a lone pivot": (lone_pivot, "nothing is drawn yet", ""),
    "a loose bar": (loose_bar, "hangs on nothing", "links.bar1"),
    "a loose chain": (loose_chain, "hangs on nothing", "links.bar2"),
    "a rigid triangle": (rigid_triangle, "nothing can move", ""),
    "a block on nothing": (block_on_nothing, "", ""),
    "too long a crank": (too_long_a_crank, "does not", "pins."),
    "a link without a mass": (text('bars   = [["B", "C"]]\nkg_per_m = 0.8', 'bars = [["B", "C"]]'), "mass", "links.coupler"),
    "a bar without length": (text('["D", "C"]', '["D", "D"]'), "zero length", "links.rocker"),
    "an unknown point in a joint": (text('"crank.B", ', '"crank.Z", '), "unknown point", "pins.B"),
    "an unknown link in a joint": (text('"coupler.C", ', '"nobody.C", '), "unknown link", "pins.C"),
    "a joint of one link": (text('at   = ["crank.B", "coupler.B"]', 'at = ["crank.B"]'), "at", "pins.B"),
    "a joint of an unknown type": (text('[joints.D]\ntype = "revolute"', '[joints.D]\ntype = "glue"'), "glue", "pins.D"),
    "a force on nobody": (text('link = "crank"\nvalue = 0.6', 'link = "nobody"\nvalue = 0.6'), "unknown link", "forces.motor"),
    "a mass below nothing": (text("kg_per_m = 0.8                     #", "kg_per_m = -1.0 #"), "must be positive", "links.crank"),
    "a sketch of the unknown": (text("sketch = { B =", 'sketch = { "crank.Z" = [0.0, 0.0], B ='), "unknown", "pins.crank.Z"),
    "no sketch": (text("sketch = { B = [0.12, 0.0], C = [0.32, 0.28] }", ""), "not placed", "links."),
    "links that are no tables": (text("[links.rocker]", "[links]\nrocker = 5\n[links.other]"), "table", "links.rocker"),
    "another format": (text("planar-linkage/1", "planar-linkage/9"), "format", ""),
    "points in a circle": (text("P = [0.18, 0.12]", 'P = { from = "P", r = 1.0 }'), "circular", "links.coupler"),
    "an unknown crank": (text('crank  = "crank"', 'crank = "nobody"'), "unknown link", ""),
    "a scenario that cannot start": (text("crank_deg = 0.0, speed = 6.0", "speed = 6.0"), "start", "scenarios.conservative"),
    "counts that are others": (text("dof = 1", "dof = 2"), "the file says 2", ""),
    "a linkage cut in two": (cut_four_bar, "", ""),
    "a sketch that is no place": (text("C = [0.32, 0.28]", "C = [0.32, 0.28, 1.0]"), "sketch", "pins.C"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_is_shown_and_explained_in_place(tmp_path: Path, name: str) -> None:
    draw, word, where = BROKEN[name]
    pen = Pen(tmp_path)
    draw(pen)
    found = pen.now
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


ASKED = [
    {"do": "motion", "samples": 3},
    {"do": "drag_begin", "pin": "B"},
    {"do": "drag", "at": [0.0, 0.0]},
    {"do": "branches"},
    {"do": "centres"},
    {"do": "add_bar", "from": {"at": [1.0, 1.0]}, "to": {"at": [1.5, 1.0]}},
    {"do": "add_point", "link": "coupler", "at": [0.1, 0.1]},
    {"do": "set_length", "link": "crank", "a": "A", "b": "B", "value": 0.11},
    {"do": "set_angle", "link": "crank", "value_deg": 20.0},
    {"do": "move", "pin": "C", "at": [0.3, 0.3]},
    {"do": "rename", "id": "links.coupler", "to": "floating"},
    {"do": "add_force", "type": "spring", "a": "A", "b": "C"},
    {"do": "drive", "coordinate": "crank"},
    {"do": "export", "kind": "svg"},
    {"do": "delete", "ids": ["pins.B", "links.rocker", "forces.motor"]},
    {"do": "undo"},
    {"do": "share"},
]


@pytest.mark.long("too long a crank")
@pytest.mark.slow("counts that are others")
@pytest.mark.parametrize("name", BROKEN)
def test_nothing_asked_of_what_is_broken_is_a_fault(tmp_path: Path, name: str) -> None:
    """Each request gets what it asks for, or a sentence."""
    pen = Pen(tmp_path)
    BROKEN[name][0](pen)
    for message in ASKED:
        found = answer(pen.session, {"id": 1} | message)
        assert found["ok"] or (found["error"]["text"] and not found["error"].get("fault")), (message, found)


HOSTILE = [
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "\u202eabc",
    "a" * 100_000,
    "../../etc/passwd",
    "\x00",
    "x\ny",
]


@pytest.mark.parametrize("word", HOSTILE)
def test_names_and_paths_that_mean_harm_are_refused(tmp_path: Path, word: str) -> None:
    pen = four_bar(tmp_path)
    text = pen.session.text
    assert pen.refused("rename", id="links.bar1", to=word)
    assert pen.refused("save", path=word)
    assert pen.refused("open", name=word)
    assert pen.refused("template", name=word)
    assert pen.refused("set", path=word, value=1.0)
    assert pen.refused("picture", picture={"url": word})
    assert pen.session.text == text
    assert [x.name for x in tmp_path.iterdir()] == []


def test_files_are_of_the_working_folder_alone(tmp_path: Path) -> None:
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


def test_a_file_that_is_there_is_replaced_only_where_that_is_wished(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("# mine\n", encoding="utf-8")
    pen = four_bar(tmp_path)
    assert "there already" in pen.refused("save", path="mine")
    assert (tmp_path / "mine.toml").read_text(encoding="utf-8") == "# mine\n"
    pen.ask("save", path="mine", replace=True)
    assert not pen.now["unsaved"]
    pen.ask("set", path="title", value="Changed")
    assert pen.now["unsaved"]
    pen.ask("save")
    assert "built-in" in pen.refused("save", path="eight_bar")


def test_half_a_drawing_is_saved_and_opened_as_it_is(tmp_path: Path) -> None:
    pen = Pen(tmp_path)
    pen.pin(0.5, 0.5)
    pen.bar((0.0, 0.0), (0.1, 0.0))
    before = pen.now["pins"]
    pen.ask("save", path="half")
    other = Pen(tmp_path)
    assert other.scene("open", name="half.toml")["pins"] == before
