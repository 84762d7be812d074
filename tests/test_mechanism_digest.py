"""Digests change with everything that a result depends on, and with nothing else.

test_reference_certificate tests that they are byte for byte what they were when the certificates of the suite were made.
"""

import copy
import pickle
import tomllib
from pathlib import Path

import pytest

import gauss_bench
from gauss_bench.linkage import digest
from gauss_bench.linkage.digest import content_digest
from gauss_bench.linkage.load import built_in, document_of, load_document, merge
from gauss_bench.linkage.schema import physics_digest
from tests.conftest import DATA

PACKAGE = Path(gauss_bench.__file__).parent


def leaves(item, path=()):
    """Yield the path of every number and text of a document."""
    if isinstance(item, (dict, list)):
        for key, value in item.items() if isinstance(item, dict) else enumerate(item):
            yield from leaves(value, (*path, key))
    else:
        yield path


NOT_PHYSICS = {"format", "name", "title", "expect", "observe", "measure", "duration"}


@pytest.mark.parametrize("source", [DATA / "everything.toml", DATA / "pushed.toml", built_in()["squeezer"]], ids=lambda p: p.stem)
def test_a_change_of_any_number_or_name_shows_unless_it_moves_nothing(source):
    document = tomllib.loads(source.read_text(encoding="utf-8"))
    scenario = next(iter(document["scenarios"]))
    acting = document["scenarios"][scenario].get("forces", [])
    before = physics_digest(document, scenario)
    for path in leaves(document):
        changed = copy.deepcopy(document)
        place = changed
        for key in path[:-1]:
            place = place[key]
        old = place[path[-1]]
        if not isinstance(old, (int, float)) or isinstance(old, bool):
            continue  # a name that is changed no longer fits the others
        place[path[-1]] = old + 1
        elsewhere = (path[0] == "forces" and path[1] not in acting) or (path[0] == "scenarios" and path[1] != scenario)
        moves = not NOT_PHYSICS & {key for key in path if isinstance(key, str)} and not elsewhere
        assert (physics_digest(changed, scenario) != before) == moves, path


def test_how_a_number_is_written_changes_nothing_and_an_override_does():
    document = document_of("four_bar")[0]
    same = copy.deepcopy(document)
    same["gravity"] = [0, -9.810]
    document["gravity"] = [0.0, -9.81]
    assert physics_digest(document, "torque") == physics_digest(same, "torque")
    link = next(iter(document["links"]))
    heavier = merge(document, {"links": {link: {"mass": 7.5}}})
    assert physics_digest(document, "torque") != physics_digest(heavier, "torque")


@pytest.mark.parametrize("law", ["constant", "sine", "cosine", "poly345", "table"])
def test_a_driven_linkage_arrives_in_another_process_as_it_is(law):
    rows = [[0.0, 0.0], [0.2, 30.0], [0.5, 90.0]]
    numbers = {"constant": {"speed": 2.0}, "table": {"rows": rows}}.get(law, {"travel_deg": 90.0, "time": 0.5})
    document = document_of("four_bar")[0]
    document["scenarios"]["driven"]["driver"] = {"link": "crank", "law": law, "start_deg": 10.0, **numbers}
    sent = load_document(document, "driven")
    arrived = pickle.loads(pickle.dumps(sent))
    assert content_digest(arrived) == content_digest(sent)
    for t in (0.0, 0.1, 0.7):
        assert arrived.drivers[0].law(t) == sent.drivers[0].law(t)


def test_a_digest_of_sources_follows_files_at_any_depth_of_its_folders(tmp_path, monkeypatch):
    monkeypatch.setattr(digest, "PACKAGE", tmp_path)
    places = {name: tmp_path / name for name in ("mechanism/forces.py", "reference/taylor/rows.py", "terms.py", "cli.py")}
    for place in places.values():
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text("x = 1\n", encoding="utf-8")

    def digests():
        return [digest.source_digest("mechanism", "terms.py"), digest.source_digest("", without=("cli.py",))]

    before = digests()
    for name, differ in (("terms.py", [True, True]), ("reference/taylor/rows.py", [False, True]), ("cli.py", [False, False])):
        places[name].write_text("x = 2\n", encoding="utf-8")
        assert [x != y for x, y in zip(digests(), before, strict=True)] == differ, name
        places[name].write_text("x = 1\n", encoding="utf-8")
    places["mechanism/forces.py"].unlink()
    with pytest.raises(FileNotFoundError, match="no sources"):
        digests()
