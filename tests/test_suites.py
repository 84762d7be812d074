"""Suites are data: each is read, joins what it builds on, and says why it leaves cases out; a faulty one is told."""

from pathlib import Path

import pytest

from gauss_bench.bench.cases import Case, cases, left_out
from gauss_bench.cli import main
from gauss_bench.linkage.load import load
from gauss_bench.suites.read import SECTIONS, SuiteError, names, of_engines, read_suite, restricted
from gauss_bench.suites.schema import FORMAT, LeftOut, OnLinkages

GOOD = f"""
format = "{FORMAT}"
title = "a suite"
[[accuracy]]
linkages = {{ four_bar = "torque" }}
steps = [1e-3]
until = 1.0
"""


@pytest.mark.parametrize("name", names())
def test_every_suite_names_linkages_and_scenarios_that_exist(name: str) -> None:
    suite = read_suite(name)
    for section in SECTIONS:
        for part in getattr(suite, section):
            if isinstance(part, OnLinkages):
                assert all(load(x, scenario).scenario == scenario for x, scenario in part.linkages.items())
    found = cases(suite)
    assert len(set(found)) == len(found)
    timed = [linkage for part in suite.cost for linkage in part.linkages]
    assert len(set(timed)) == len(timed), "one race of a linkage, so that a cost has one value"


def test_a_suite_joins_those_it_builds_on_once_each() -> None:
    quick, kernel, whole = (read_suite(name) for name in ("quick", "kernel", "full"))
    assert set(cases(quick)) < set(cases(whole))
    assert {(x.engine, x.step) for x in set(cases(whole)) - set(cases(quick))} == {("gauss", 1e-3)}  # `gauss-native` runs there
    assert whole.cost == kernel.cost
    assert whole.steps == kernel.steps
    assert whole.papers == quick.papers


def test_what_is_left_out_matches_every_field_and_has_a_reason() -> None:
    case = Case("four_bar", "torque", "lagrange", "default", "rk4", "none", 1e-4, 2.0)
    why = "for the sake of the test"
    assert left_out(case, LeftOut(engines=("lagrange",), steps=(1e-4,), why=why))
    assert not left_out(case, LeftOut(engines=("lagrange",), steps=(1e-3,), why=why))
    assert not left_out(case, LeftOut(engines=("gauss",), steps=(1e-4,), why=why))
    quick = read_suite("quick")
    assert all(rule.why for rule in quick.left_out)
    assert not any(c.engine == "lagrange" and c.step == 1e-4 for c in cases(quick))
    assert any(c.engine == "lagrange" and c.step == 1e-3 for c in cases(quick))
    assert any(c.engine == "lagrange" and c.step == 1e-4 for c in cases(read_suite("exhaustive")))


def test_a_users_linkages_and_engines_cut_a_suite() -> None:
    suite = of_engines(restricted(read_suite("full"), {"parallelogram": "torque"}), ["gauss"])
    assert {(c.linkage, c.engine) for c in cases(suite)} == {("parallelogram", "gauss")}
    assert {x for part in suite.cost for x in part.linkages} == {"parallelogram"}
    assert not suite.growth
    assert not suite.papers


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (GOOD + "untill = 2.0\n", "accuracy.0.untill"),
        (GOOD.replace("1e-3", "-1e-3"), "accuracy.0.steps.0"),
        (GOOD.replace("until = 1.0", ""), "accuracy.0.until"),
        (GOOD.replace(FORMAT, "gauss-bench-suite/9"), "format"),
        (GOOD + 'with = "quick"', "accuracy.0.with"),
        (GOOD.replace("title", "title title"), "TOML syntax"),
    ],
)
def test_a_faulty_suite_is_told_by_file_and_field(
    content: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(content)
    assert main(["run", "--suite", str(path), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert "mine.toml" in told
    assert said in told
    assert not (tmp_path / "out").exists()


def test_an_unknown_suite_and_one_that_builds_on_itself_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--suite", "quickly", "--out", str(tmp_path / "out")]) == 2
    assert "unknown suite 'quickly'; there are accuracy, costs" in capsys.readouterr().err
    path = tmp_path / "mine.toml"
    path.write_text(f'format = "{FORMAT}"\ntitle = "round and round"\nwith = ["{path}"]\n')
    with pytest.raises(SuiteError, match="builds on itself"):
        read_suite(str(path))
