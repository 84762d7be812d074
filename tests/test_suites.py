"""Suites are data: each is read, joins what it builds on, and says why it leaves cases out; a faulty one is told."""

import math
from pathlib import Path

import pytest

from gauss_bench.bench.cases import Case, cases, is_left_out
from gauss_bench.bench.search import COARSEST
from gauss_bench.cli import main
from gauss_bench.linkage.load import load
from gauss_bench.reach import Kind, Requirement, reach, trial_of
from gauss_bench.suites.read import SECTIONS, names, of_engines, read_suite, restrict
from gauss_bench.suites.schema import FORMAT, LeftOut, OnLinkages
from gauss_bench.tables import read_table

GOOD = f"""
format = "{FORMAT}"
title = "a suite"
[[accuracy]]
linkages = {{ four_bar = "torque" }}
steps = [1e-3]
until = 1.0
"""
FAULTY = [  # content of a suite, and what the refusal names
    (GOOD + "untill = 2.0\n", "accuracy.0.untill"),
    (GOOD.replace("1e-3", "-1e-3"), "accuracy.0.steps.0"),
    (GOOD.replace("until = 1.0", ""), "accuracy.0.until"),
    (GOOD.replace("until = 1.0", 'until = "1.0"'), "accuracy.0.until"),
    (GOOD.replace(FORMAT, "gauss-bench-suite/9"), "format"),
    (GOOD + 'with = "quick"', "accuracy.0.with"),
    (GOOD.replace("title", "title title"), "TOML syntax"),
]


@pytest.mark.parametrize("name", names())
def test_every_suite_names_linkages_and_scenarios_that_exist(name):
    suite = read_suite(name)
    for section in SECTIONS:
        for part in getattr(suite, section):
            if isinstance(part, OnLinkages):
                assert all(load(x, scenario).scenario == scenario for x, scenario in part.linkages.items())
    found = cases(suite)
    assert len(set(found)) == len(found)
    timed = [linkage for part in suite.cost for linkage in part.linkages]
    assert len(set(timed)) == len(timed), "one race of a linkage, so that a cost has one value"
    assert suite.hours or not suite.search, "a suite that searches states its time"


def test_exudyn_may_take_the_steps_that_its_stored_order_asks_for():
    """Within 1e-6 m, on every linkage that it models: its budget holds what its published ladders extrapolate to."""
    ladders = {}
    for r in read_table("search_ladder", Path(__file__).parents[1] / "reports"):
        if r["engine"] == "exudyn":
            ladders.setdefault(r["mechanism"], {}).setdefault(r["settings"], []).append(trial_of(r))
    for part in read_suite("full").search:
        most = part.steps_of.get("exudyn", part.most_steps)
        assert part.budget >= math.log2(most / COARSEST) + 6  # evaluations: the octaves, and the gaps of three requirements
        for linkage in part.linkages:
            found = reach(ladders[linkage].values(), [Requirement("position", 1e-6)])
            assert found.kind in (Kind.TIMED, Kind.NO_MODEL) or found.needed < 0.9 * most, (linkage, found.words)


def test_a_suite_joins_those_it_builds_on_once_each():
    quick, kernel, whole = (read_suite(name) for name in ("quick", "kernel", "full"))
    assert set(cases(quick)) < set(cases(whole))
    assert {(x.engine, x.step) for x in set(cases(whole)) - set(cases(quick))} == {("gauss", 1e-3)}  # `gauss-native` runs there
    assert whole.cost == kernel.cost
    assert whole.steps == kernel.steps
    assert whole.papers == quick.papers


def test_what_is_left_out_matches_every_field_and_has_a_reason():
    case = Case("four_bar", "torque", "lagrange", "default", "rk4", "none", 1e-4, 2.0)
    why = "for the sake of the test"
    rules = ({"engines": ("lagrange",), "steps": (1e-4,)}, {"engines": ("lagrange",), "steps": (1e-3,)}, {"engines": ("gauss",)})
    assert [is_left_out(case, LeftOut(**x, why=why)) for x in rules] == [True, False, False]
    quick = read_suite("quick")
    assert all(rule.why for rule in quick.left_out)
    assert not any(c.engine == "lagrange" and c.step == 1e-4 for c in cases(quick))
    assert any(c.engine == "lagrange" and c.step == 1e-3 for c in cases(quick))
    assert any(c.engine == "lagrange" and c.step == 1e-4 for c in cases(read_suite("exhaustive")))


def test_a_users_linkages_and_engines_cut_a_suite():
    suite = of_engines(restrict(read_suite("full"), {"parallelogram": "torque"}), ["gauss"])
    assert {(c.linkage, c.engine) for c in cases(suite)} == {("parallelogram", "gauss")}
    assert {x for part in suite.cost for x in part.linkages} == {"parallelogram"}
    assert not suite.growth
    assert not suite.papers


def test_a_faulty_suite_is_told_by_file_and_field(tmp_path, capsys):
    path = tmp_path / "mine.toml"
    around = f'format = "{FORMAT}"\ntitle = "round and round"\nwith = ["{path}"]\n'
    for content, said in (*FAULTY, (around, "builds on itself")):
        path.write_text(content)
        assert main(["run", "--suite", str(path), "--out", str(tmp_path / "out")]) == 2
        told = capsys.readouterr().err
        assert all(x in told for x in ("mine.toml", said))
        assert not (tmp_path / "out").exists()
