"""Test that the audit's verdicts hold, that every line can fail, and that another claimed verdict is found out."""

import ast
import re
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.papers import crank_slider, forms
from gauss_bench.papers.audit import PAPERS, Verdict, audit, lines, list_faults, measure_line, read_paper
from gauss_bench.papers.forms import link_units as lu
from gauss_bench.papers.forms import problems
from gauss_bench.papers.forms.loops import list_driven
from tests.papers_mutations import CORRECTIONS, MUTATIONS
from tests.published import published


@cache
def audited():
    return tuple(audit()["audit"])


PAPER_FILES = [read_paper(name) for name in PAPERS]
ENTRIES = [(paper, chapter, line) for paper in PAPER_FILES for chapter in paper["chapter"] for line in chapter["line"]]
LINES = {line.texts["name"]: line for line in lines()}


@pytest.mark.slow
def test_every_line_has_a_name_of_its_own_and_a_wrong_form():
    assert MUTATIONS.keys() == {name for name, line in LINES.items() if line.verdict == Verdict.OK}
    assert len(LINES) == len(lines())
    assert [row["name"] for row in audited()] == list(LINES)
    assert {row["name"]: row["verdict"] for row in audited()} == {r["name"]: r["verdict"] for r in published().table("audit")}
    assert sum(row["verdict"] != "ok" for row in audited()) == 35  # as read by hand in the papers


@pytest.mark.parametrize("name", LINES)
def test_wrong_forms_are_found_out_and_so_is_another_verdict(name):
    line, row = LINES[name], next(row for row in audited() if row["name"] == name)
    assert row["faults"] == ""
    wrong = MUTATIONS[name] if line.verdict == Verdict.OK else {"as printed": line.printed, "corrected": CORRECTIONS[name]}
    with np.errstate(all="ignore"):
        for what, form in wrong.items():
            assert not line.measure(form) <= line.tolerance, what
    off, right, tolerance = row["printed_off"], row["intended_off"], row["tolerance"]
    assert np.isfinite(off)  # off by a number, not by a form that cannot be evaluated
    others = {Verdict.OK, Verdict.MISPRINT} - {line.verdict}
    assert all(list_faults(other, off, right, tolerance) for other in others if Verdict.OK in (other, line.verdict))
    if line.verdict != Verdict.OK:  # one form put in the place of the other
        assert all(list_faults(line.verdict, x, y, tolerance) for x, y in ((right, right), (off, off), (right, off)))


def test_the_verdict_of_a_row_is_measured_and_not_read():
    blamed = measure_line(replace(LINES["velocities"], verdict=Verdict.MISPRINT))
    assert (blamed["verdict"], blamed["stands"]) == ("ok", False)
    praised = measure_line(replace(LINES["gravity"], verdict=Verdict.OK))
    assert (praised["verdict"], praised["stands"]) == ("wrong", False)


def test_a_line_is_right_as_printed_or_has_a_cause_and_both_forms():
    corrected = {"intended", "cause", "printed_form", "intended_form"}
    for _, _, line in ENTRIES:
        assert corrected & line.keys() == (set() if "form" in line else corrected), line["name"]


def test_every_function_and_constant_of_the_forms_serves_a_line():
    """Every name is used in a data file or in another place of the forms; use by tests does not count."""
    folder = Path(forms.__file__).parent
    sources = {path: path.read_text(encoding="utf-8") for path in (*folder.glob("*.py"), *folder.parent.glob("*.toml"))}
    words = Counter(re.findall(r"\w+", "\n".join(sources.values())))
    for path, source in sources.items():
        if path.suffix == ".py":
            for node in ast.parse(source).body:
                targets = node.targets if isinstance(node, ast.Assign) else []
                names = [x.id for target in targets for x in ast.walk(target) if isinstance(x, ast.Name)]
                names += [node.name] if isinstance(node, ast.FunctionDef | ast.ClassDef) else []
                assert [x for x in names if words[x] < 2] == [], path.name


def test_the_numbers_a_reader_may_check_by_hand():
    rows = {row["name"]: row for row in audited()}
    free = crank_slider.TORQUE / crank_slider.I1  # without constraints only the torque turns the crank
    assert rows["with an ordinary inverse"]["example_printed"] == pytest.approx(free, rel=1e-12)
    m1, m2, l1 = crank_slider.M1, crank_slider.M2, crank_slider.L1
    # stretched out and at rest: the crank turns about O, the rod about the slider, which stands still at first
    inertia = (m1 + m2) * l1**2 / 3
    true = (crank_slider.TORQUE - (m1 + m2) * crank_slider.GRAVITY * l1 / 2) / inertia
    for name in ("with Moore-Penrose inverses", "motion from A and b", "entry (6, 6) of the Jacobian"):
        assert rows[name]["example_true"] == pytest.approx(true, rel=1e-12)
    assert rows["with Moore-Penrose inverses"]["example_intended"] == pytest.approx(true, rel=1e-10)


def test_the_truths_owe_nothing_to_the_paper():
    for problem in problems.all_problems():
        residual = problem.M @ problem.a + problem.f + problem.J.T @ problem.multipliers - problem.Q
        assert np.abs(residual).max() < 1e-10 * np.abs(problem.M @ problem.a).max()
        assert np.abs(problem.J @ problem.a - problem.g).max() < 1e-10 * np.abs(problem.J @ problem.a).max() + 1e-10
    assert len({t.equations.mechanism.name for t in list_driven()}) == 4
    assert any(abs(p.phi_rate - p.s_rate) > 0.5 for p in lu.poses())


def test_everything_that_the_data_files_define_serves_a_line():
    for paper in PAPER_FILES:
        of_paper = [line for p, _, line in ENTRIES if p is paper]
        for table in ("tolerance", "cause"):
            assert {line[table] for line in of_paper if table in line} == paper[table].keys()
        assert {line["example"]["number"] for line in of_paper if "example" in line} == paper.get("number", {}).keys()
        assert {line["measure"] for line in of_paper} == {x for chapter in paper["chapter"] for x in chapter["measure"]}
        assert all(chapter.get("over", {}).keys() <= chapter["measure"].keys() for chapter in paper["chapter"])
