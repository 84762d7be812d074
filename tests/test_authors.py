"""Settings that an engine's authors own: a faulty file is refused by name and field, a sound one races without a line of code."""

import json
import shutil

import numpy as np
import pytest

from gauss_bench.api.recommend import list_owned
from gauss_bench.cli import main
from gauss_bench.engines import authors
from gauss_bench.engines.authors import ROOMS, SettingsFault, candidates_of, read_settings
from gauss_bench.engines.own_options import OptionTable, write_options
from gauss_bench.engines.variants import read_variants
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.suites.read import read_suite
from gauss_bench.verbs.suites import with_authors
from tests.conftest import DATA

SOUND = DATA / "settings" / "minimal.toml"
TEXT = SOUND.read_text(encoding="utf-8")
TIGHT, EQUAL = "default,dop853_rtol=1e-11", "default,dop853_rtol=1e-09"
FAULTS = [
    ('"gauss-bench-settings/1"', '"gauss-bench-settings/9"', "format: must be 'gauss-bench-settings/1'"),
    ('engine = "minimal"', 'engine = "nobody"', "engine: 'nobody' has no variants.toml"),
    ('"Those who wrote it"', '" "', "authors: must be a text of 1 to 200 characters in one line"),
    ('"https://example.org/them"', '"ask around"', "contact: must be an address"),
    ("2026-11-26", '"2026-11-26"', "date: must be a date"),
    ("2026-11-26", "9999-01-01", "date: 9999-01-01 is in the future"),
    ("date =", "day =", "day: no such field; there are format, engine"),
    ("tight enough for what is asked", "because", "knobs.dop853_rtol.why: must be a sentence of 20 characters at least"),
    ("[knobs.dop853_rtol]", "[knobs.dop853_atol]", "settings.tight.dop853_rtol: has no source"),
    ("dop853_rtol = 1e-11", "speed = 3", "settings.tight.speed: minimal has no such knob"),
    ("dop853_rtol = 1e-11", 'dop853_rtol = "small"', "settings.tight.dop853_rtol: the option 'dop853_rtol' takes a number"),
    ("dop853_rtol = 1e-11", "dop853_rtol = 1.5", "settings.tight.dop853_rtol: must be in the range 0 to 1, not 1.5"),
    ("dop853_rtol = 1e-11\n", "", "settings.tight: changes no knob"),
    ('integrator = "dop853"\n', "", "settings.tight.integrator: is missing; minimal has"),
    ('integrator = "dop853"\n', 'integrator = "hope"\n', "settings.tight.integrator: no integrator 'hope'; there are rk4"),
    ('base = "default"', 'base = "best"', "settings.equal.base: no settings 'best'; there are default"),
    ("[settings.tight]", "[settings.tight", "TOML syntax"),
]


def saved(folder, text):
    path = folder / "theirs.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(("old", "new", "said"), FAULTS)
def test_a_faulty_file_is_refused_by_name_and_field(old, new, said, tmp_path, capsys):
    assert TEXT.count(old) == 1
    path = saved(tmp_path, TEXT.replace(old, new))
    assert main(["check-settings", str(path)]) == 2
    told = capsys.readouterr()
    assert f"{path}: {said}" in told.err
    assert told.out == ""


@pytest.mark.parametrize("room", sorted(x.parent for x in ROOMS.glob("*/variants.toml")), ids=lambda x: x.name)
def test_a_knob_that_takes_numbers_has_a_range(room):
    found = read_variants(room)
    for key, knob in found.knobs.items():
        values = [x.get(key) for x in found.settings.values()]
        takes_numbers = any(isinstance(x, int | float | list) and not isinstance(x, bool) for x in values)
        assert all(np.isfinite(knob.range)) or not takes_numbers, key


@pytest.mark.parametrize(("path", "said"), [(".", "Is a directory"), ("none.toml", "No such file"), ("long.toml", "larger than")])
def test_what_cannot_be_read_is_named(path, said, tmp_path, capsys):
    (tmp_path / "long.toml").write_bytes(b"#" * (authors.LARGEST + 1))
    assert main(["check-settings", str(tmp_path / path)]) == 2
    assert f"error: {tmp_path / path}: {said}" in capsys.readouterr().err


def test_there_are_at_most_as_many_settings_as_our_search_has_variants(tmp_path):
    most = len(read_variants(ROOMS / "minimal").space)
    assert read_settings(SOUND).most == most == 3
    third = '[settings.third]\nintegrator = "dop853"\ndop853_rtol = 1e-10\n'
    assert len(read_settings(saved(tmp_path, TEXT + third)).settings) == 3
    with pytest.raises(SettingsFault, match=r"settings: 4 settings; at most 3 are allowed"):
        read_settings(saved(tmp_path, TEXT + third + third.replace("third", "fourth")))


def test_a_sound_file_is_a_list_of_candidates_with_their_owner(capsys):
    tight, equal = candidates_of("minimal", [SOUND])
    assert (tight.name, tight.integrator, tight.stabilization, tight.owner) == (TIGHT, "dop853", "none", "Those who wrote it")
    assert dict(tight.options) == {"dop853_rtol": 1e-11, "dop853_atol": 1e-12}
    assert (equal.name, equal.integrator) == (EQUAL, "dop853_fixed")
    assert candidates_of("mujoco", [SOUND]) == []
    assert candidates_of("minimal", [SOUND, SOUND]) == [tight, equal]
    assert main(["check-settings", str(SOUND), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["engine"], told["most"], [*told["settings"]]) == ("minimal", 3, ["tight", "equal"])


def test_the_file_of_a_room_is_found_by_itself(tmp_path, monkeypatch):
    (tmp_path / "minimal").mkdir()
    shutil.copy(ROOMS / "minimal" / "variants.toml", tmp_path / "minimal")
    monkeypatch.setattr(authors, "ROOMS", tmp_path)
    assert candidates_of("minimal") == []
    shutil.copy(SOUND, tmp_path / "minimal" / "authors.toml")
    assert [x.name for x in candidates_of("minimal")] == [TIGHT, EQUAL]


@pytest.mark.parametrize("path", sorted(ROOMS.glob("*/authors.toml")) or [None], ids=str)
def test_every_file_of_a_room_is_sound_and_of_its_engine(path):
    assert path is None or read_settings(path).engine == path.parent.name


def test_the_text_of_a_setting_has_the_same_values_bit_for_bit():
    changes = {"x": 1 / 3, "pair": [0.1 + 0.2, 1e-300], "word": 'least "depth", so', "on": True, "count": 3}
    usual = {"x": 1.0, "pair": [0.0, 0.0], "word": "none", "on": False, "count": 1}
    table = OptionTable({"base": usual}, {key: ('least "depth", so',) if key == "word" else () for key in usual})
    assert table.resolve(write_options("base", changes)) == changes


def test_a_file_for_an_engine_that_nobody_asks_is_refused():
    with pytest.raises(ChoiceError, match=r"minimal\.toml: engine: the suite searches no settings of minimal"):
        with_authors(read_suite("quick"), [SOUND])
    with pytest.raises(ChoiceError, match=r"minimal\.toml: engine: minimal is not among the engines of this search, gauss"):
        list_owned(["gauss"], [SOUND])
    (part,) = (x for x in with_authors(read_suite("search"), [SOUND]).search)
    assert part.authors == (str(SOUND),)
