"""Exported files run without the package and move as the suite's own engines, and no text of a user becomes code in them."""

import ast
import contextlib
import io
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gauss_bench
from gauss_bench.advice.recommending import Recommender
from gauss_bench.advice.truth import NoTruth
from gauss_bench.engines import get
from gauss_bench.engines.transcript import python
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.export import KINDS, OWNED, export_linkage
from gauss_bench.exchange.text import C_WORDS, c_comment, c_string, make_identifiers, python_comment, toml_string, xml_comment
from gauss_bench.linkage.load import built_in, load, load_document
from gauss_bench.mechanism.model import Revolute
from tests.alone import BLOCKED, c_alone, needs_kind, python_alone, rows_of
from tests.conftest import DATA, exhaustive
from tests.engine_runs import ran

END, STEP = 0.2, 1e-3
QUICK = [("five_bar/spring", "exudyn"), ("four_bar/cycloid", "c")]
SLOW = [(name, kind) for name in ("jansen/walk", "shaper/torque") for kind in KINDS]  # loops in loops and forces; a moving guide
SLOW += [(name, "mujoco") for name in ("five_bar/spring", "parallelogram", "n_four_bar_7")]
SLOW += [("four_bar/cycloid", "pinocchio"), ("excavator", "exudyn"), ("excavator", "casadi"), ("sleigh", "c")]
SLOW += [(str(DATA / name), "pinocchio") for name in ("loaded.toml", "all_kinds.toml")] + [(str(DATA / "all_kinds.toml"), "exudyn")]
PLAIN_MUJOCO = DATA / "plain_mujoco.txt"


def suite_run(mechanism, kind, times, step):
    """Return q and v, both (k, n), of the suite's own run of the engine with the settings of the file."""
    k = KINDS[kind]
    chosen = {"settings": k.settings, "integrator": k.integrator, "stabilization": k.stabilization}
    found = ran(get(k.engine), mechanism, times, **chosen, step=step)
    return found.q, found.v


def run_alone(text, kind, folder, end, step=STEP):
    """Return heading and rows of the table that an exported file prints, or that a plain script prints for MJCF."""
    file = folder / f"exported{KINDS[kind].suffix}"
    file.write_text(text, encoding="utf-8")
    if kind == "c":
        return rows_of(c_alone(file, end, step))
    if kind == "mujoco":
        return rows_of(python_alone(PLAIN_MUJOCO, file, end, 10))
    return rows_of(python_alone(file, end, step))


def compared(mechanism, kind, folder, written=None):
    """Check that a file moves as the suite's own run; the file is that of the linkage, or of `written`, which has other names."""
    end, step = min(END, mechanism.duration), min(STEP, mechanism.duration / 300)
    heading, rows = run_alone(export_linkage(written or mechanism, kind, step).text, kind, folder, end, step)
    q, v = suite_run(mechanism, kind, rows[:, 0], step)
    if kind == "mujoco":
        order = [*range(len(mechanism.links))]
        if written is None:
            names = [link.name for link in mechanism.links]
            order = [names.index(x.rpartition(".")[0]) for x in heading[1:-1:2]]
        wanted = q.reshape(len(q), -1, 3)[:, order, :2].reshape(len(q), -1)
        found = rows[:, 1:-1]
    else:
        names = [f"{link.name}.{x}" for link in mechanism.links for x in ("x", "y", "theta")]
        assert written or heading[1 : 1 + mechanism.n] == names
        wanted, found = np.hstack([q, v]), rows[:, 1:]
    assert len(rows) > 10
    assert np.abs(wanted - wanted[0]).max() > 1e-3  # it moves
    np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-8 * np.abs(wanted).max())


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), exhaustive([*QUICK, *SLOW], *QUICK))
def test_an_exported_file_alone_moves_as_the_engine_in_the_suite(name, kind, tmp_path):
    needs_kind(kind)
    compared(load(name) if name.endswith(".toml") else load(*name.split("/")), kind, tmp_path)


@pytest.mark.parametrize("kind", [pytest.param("exudyn", marks=pytest.mark.long), "pinocchio"])
def test_a_motion_given_by_a_table_goes_out(kind, tmp_path):
    needs_kind(kind)
    document = tomllib.loads(built_in()["four_bar"].read_text(encoding="utf-8"))
    rows = [[0.0, 0.0], [0.05, 0.2], [0.15, 0.1]]
    document["scenarios"]["cycloid"] = {"duration": END, "driver": {"law": "table", "link": "crank", "rows": rows}}
    compared(load_document(document, "cycloid"), kind, tmp_path)


def test_the_package_is_blocked_where_files_run_alone(tmp_path):
    file = tmp_path / "imports.py"
    file.write_text("import gauss_bench")
    done = subprocess.run([sys.executable, "-I", "-c", BLOCKED, str(file)], capture_output=True, text=True, check=False)
    assert "gauss_bench is blocked" in done.stderr


HOSTILE = ('quo"te', "new\nline", "*/ int x; /*", "--> <evil/>", "]]>", "</script>", "back\\")
HOSTILE += ("'''\"\"\"", "coding: utf-7", "??/", "%s{0}")


def hostile(mechanism, points):
    """Return the mechanism with attacks as title and names, and with `points` as names of points too."""
    names = ("world", *HOSTILE)  # MuJoCo has a body "world" of its own
    links = tuple(replace(link, name=names[k % len(names)] + "#" * k) for k, link in enumerate(mechanism.links))

    def renamed(joint, k):
        if not (points and isinstance(joint, Revolute)):
            return replace(joint, name=HOSTILE[k])
        return replace(joint, name=HOSTILE[k], a=replace(joint.a, name=HOSTILE[k]), b=replace(joint.b, name=HOSTILE[k + 1]))

    joints = tuple(renamed(j, k + 3) for k, j in enumerate(mechanism.joints))
    told = " ".join(HOSTILE)
    return replace(mechanism, name=HOSTILE[0], links=links, joints=joints, title=told, scenario=told, scenarios=(told, *HOSTILE))


@pytest.mark.slow("c")
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_with_names_and_titles_of_any_kind_moves_alone_as_the_engine_in_the_suite(kind, tmp_path):
    needs_kind(kind)
    mechanism = load("crank_slider")
    compared(mechanism, kind, tmp_path, hostile(mechanism, points=kind != "c"))


@pytest.mark.slow("c")
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_says_whose_it_is_and_what_it_lacks(kind):
    needs_kind(kind)
    found = export_linkage(load("crank_slider"), kind, STEP)
    assert OWNED in found.text
    assert found.left_out == ("scenarios driven, settles, conservative",)
    assert "Not in this file: scenarios driven, settles, conservative" in found.text


REFUSED = [
    ("sleigh", "exudyn", "knife edge"),
    ("four_bar/cycloid", "mujoco", "crank"),
    ("excavator", "pinocchio", "ground.P-boom.A"),
    ("parallelogram", "casadi", "redundant"),
    (str(DATA / "friction.toml"), "c", "friction"),
]


@pytest.mark.parametrize(("name", "kind", "word"), REFUSED)
def test_what_a_format_cannot_hold_is_refused_by_name(name, kind, word):
    needs_kind(kind)
    mechanism = load(name) if name.endswith(".toml") else load(name.partition("/")[0], name.partition("/")[2] or None)
    with pytest.raises(ExchangeError) as caught:
        export_linkage(mechanism, kind, STEP)
    assert str(caught.value).startswith(f"{mechanism.source}: {mechanism.name}, scenario {mechanism.scenario}: cannot become")
    assert word in str(caught.value)


@pytest.mark.long
def test_the_loops_of_a_tuned_document_hold_in_plain_mujoco(tmp_path):
    pytest.importorskip("mujoco")
    file = tmp_path / "four_bar.xml"
    found = gauss_bench.export("four_bar", "mujoco", file, tuned=True, scenario="torque")
    assert found.tuning.met
    _, rows = rows_of(python_alone(PLAIN_MUJOCO, file, 5.0, 100))
    assert rows[-1, 0] == pytest.approx(5.0)
    assert rows[-1, -1] < 1e-6
    assert found.tuning.loops_open == pytest.approx(rows[-1, -1], rel=0.2)  # the largest at 200 times a second
    assert f"{found.tuning.loops_open:.1e}" in file.read_text()


@pytest.mark.long
def test_a_motion_that_nobody_knows_for_long_is_measured_over_less(monkeypatch, tmp_path):
    pytest.importorskip("casadi")
    search = Recommender.search

    def known_for_a_second(recommender):
        if recommender.run.until > 1.0:
            raise NoTruth("nobody knows")
        return search(recommender)

    monkeypatch.setattr(Recommender, "search", known_for_a_second)
    file = tmp_path / "script.py"
    found = gauss_bench.export("four_bar", "casadi", file, scenario="torque", tuned=True)
    assert found.tuning.met
    assert found.tuning.until == 5.0 / 16
    assert "Measured over 0.3125 s" in file.read_text()

    def known_never(recommender):
        raise NoTruth("nobody knows")

    monkeypatch.setattr(Recommender, "search", known_never)
    with pytest.raises(ExchangeError, match=r"no step can be judged over 0\.3125 s, choose it by --step: nobody knows"):
        gauss_bench.export("four_bar", "casadi", tmp_path / "other.py", scenario="torque", tuned=True)
    assert [x.name for x in tmp_path.iterdir()] == ["script.py"]


def test_what_cannot_be_held_is_said_to_be_missed():
    from gauss_bench.api.exchange import Tuning

    good = Tuning("tuned", "rk4", 1e-3, 5.0, 4e-7, 4e-5, "certified", 1e-9, 1e-6, 1e-4)
    assert good.met
    assert not any("NOT HELD" in x for x in good.sentences)
    for worse in (replace(good, loops_open=6e-7), replace(good, motion_error=6e-5), replace(good, known=2e-5)):
        assert not worse.met
        assert any("NOT HELD" in x for x in worse.sentences)


ANY_TEXT = st.text(max_size=60) | st.sampled_from(HOSTILE)


@pytest.mark.long
@given(st.lists(ANY_TEXT, max_size=8, unique=True))
def test_identifiers_are_unique_and_valid(names):
    found = make_identifiers([*names, "while", "int"], C_WORDS)
    assert len(set(found.values())) == len({*names, "while", "int"})
    for x in found.values():
        assert re.fullmatch("[A-Za-z][A-Za-z0-9_]*", x)
        assert x not in C_WORDS.split()


@given(ANY_TEXT)
def test_texts_come_back_as_they_were(text):
    whole = text.encode("utf-8", "replace")
    assert ast.literal_eval("b" + c_string(text)) == whole
    assert "??" not in c_string(text)
    assert ast.literal_eval(python(text)) == text
    assert python(text).isascii()
    assert tomllib.loads(f"x = {toml_string(text)}")["x"] == text


@given(st.lists(ANY_TEXT, max_size=4))
def test_comments_end_where_they_end(lines):
    told = c_comment(lines)
    assert told.index("*/") == len(told) - 3
    assert told.count("/*") == 1
    assert all(line.startswith("#") for line in python_comment(lines).splitlines())
    with contextlib.redirect_stderr(io.StringIO()):
        assert not ast.parse("'''first'''\n\n" + python_comment(lines)).body[1:]
    root = ElementTree.fromstring(f"<a><!--{xml_comment(lines)}--><b/></a>")
    assert [x.tag for x in root] == ["b"]
