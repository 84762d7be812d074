"""Nobody is broken: what users and plug-ins could name once, they can name still."""

import json
from importlib import import_module

import pytest

from tests.kept import interface

KEPT = json.loads(interface.STORED.read_text(encoding="utf-8"))
PARTS = {
    "exports": interface.exports,
    "interfaces": interface.interfaces,
    "verbs": interface.verbs,
    "columns": interface.columns,
    "files": interface.file_keys,
}


@pytest.mark.parametrize("part", PARTS)
def test_every_name_is_there_with_what_belongs_to_it(part):
    now = PARTS[part]()
    gone = {name: sorted(set(kept) - set(now.get(name, ()))) for name, kept in KEPT[part].items()}
    assert set(KEPT[part]) <= set(now)
    assert {name: missing for name, missing in gone.items() if missing} == {}


def test_arguments_of_functions_keep_their_order():
    for part in ("exports", "interfaces"):
        now = PARTS[part]()
        for name, kept in KEPT[part].items():
            if name[0].islower() or "." in name:  # the fields of a result are found by their names
                assert [x for x in now[name] if x in kept] == kept, name


def test_choices_of_a_flag_stay():
    now = interface.verbs()
    for verb, flags in KEPT["verbs"].items():
        for flag, choices in flags.items():
            assert set(choices) <= set(now[verb][flag]), (verb, flag)


@pytest.mark.long("conformance", "doctor", "atlas")
@pytest.mark.parametrize("call", [*interface.QUICK, *(pytest.param(x, marks=pytest.mark.slow) for x in interface.SLOW)])
def test_json_keeps_its_keys(call, tmp_path):
    printed = interface.json_keys((interface.QUICK | interface.SLOW)[call], tmp_path)
    assert sorted(set(KEPT["json"][call]) - set(printed)) == []


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
@pytest.mark.parametrize("module", interface.NAMES)
def test_what_plug_ins_import_is_there(module):
    for name in interface.NAMES[module]:
        assert hasattr(import_module(module), name), name


def test_a_key_that_is_gone_is_seen():
    assert list(interface.paths_of({"a": [{"b": 1}, {"c": {"d": 2}}]})) == ["/a", "/a/*/b", "/a/*/c", "/a/*/c/d"]
