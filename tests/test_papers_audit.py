"""The audit stands, every line of it can fail, and none lets itself be talked into another verdict."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.papers import crank_slider, forms
from gauss_bench.papers.audit import FOLDER, PAPERS, lines, lines_of, read
from gauss_bench.papers.forms import link_units as lu
from gauss_bench.papers.forms import problems
from gauss_bench.papers.forms.loops import turnings
from gauss_bench.papers.line import Cause, Line, Verdict, discrepancy, judge
from gauss_bench.papers.line import row as measured_row
from tests.conftest import needs
from tests.papers_mutations import MUTATIONS
from tests.papers_tables import audited

PAPER_FILES = [read(FOLDER / f"{name}.toml") for name in PAPERS]
LINES = {line.name: line for line in lines()}
NOT_OK = {name for name, line in LINES.items() if line.verdict != Verdict.OK}

# The verdicts measured, held against the papers as read by hand: what is transcribed must not turn right by being copied wrong.
READ = {
    "rows that disagree": "loose",
    "exponent of M in A": "misprint",
    "exponent of M in b": "misprint",
    "motion from A and b": "misprint",
    "unit of length": "misprint",
    "condition of the minimum": "loose",
    "inverse in the minimum": "loose",
    "sign before the last term": "unreadable",
    "inverse of a projector": "wrong",
    "order of the factors reversed": "wrong",
    "with an ordinary inverse": "wrong",
    "with Moore-Penrose inverses": "wrong",
    "difference from the truth": "wrong",
    "unit of length in (16)": "wrong",
    "entry (6, 6) of the Jacobian": "misprint",
    "row 3 of g": "misprint",
    "row 5 of g": "misprint",
    "row 6 of g": "misprint",
    "figures of the crank's centre": "misprint",
    "inertias of crank and rod": "not given",
    "gravity": "not given",
    "integrator, step and time span": "not given",
    "RP2 rate unit, column 1": "misprint",
    "RP2 rate unit, what is missing": "misprint",
    "RP2 rate unit in a shaper": "misprint",
    "as many unknowns as equations": "loose",
    "accelerations": "unreadable",
    "one 1 in each row": "loose",
    "loops one above the other": "unreadable",
    "incidence matrix": "misprint",
    "motion laws": "not given",
    "which coordinate of C is known": "misprint",
    "which points are in line": "misprint",
    "line as a quotient": "loose",
    "line as a quotient in a search": "loose",
}


@pytest.mark.slow
def test_every_line_has_a_name_of_its_own_and_wrong_corrections() -> None:
    assert len(LINES) == len(lines())
    assert MUTATIONS.keys() == LINES.keys()
    assert sum(map(len, MUTATIONS.values())) >= 209
    assert {line["name"]: line["verdict"] for line in audited() if line["verdict"] != "ok"} == READ


@pytest.mark.parametrize("name", LINES)
def test_the_line_stands(name: str) -> None:
    line = LINES[name]
    assert judge(line).faults == ()
    assert np.isfinite(discrepancy(line, line.printed_form))  # off by a number, not by a form that cannot be evaluated


@pytest.mark.parametrize(("name", "wrong"), [(name, wrong) for name, wrongs in MUTATIONS.items() for wrong in wrongs])
def test_a_wrong_correction_is_found_out(name: str, wrong: str) -> None:
    line, form = LINES[name], MUTATIONS[name][wrong]
    both = replace(line, printed_form=form, intended_form=form) if line.verdict == Verdict.OK else replace(line, intended_form=form)
    with np.errstate(all="ignore"):
        assert "what is called right is not" in judge(both).faults


def talked_over(line: Line) -> dict[str, Line]:
    """The line with another verdict, or with one form put in the place of the other."""
    if line.verdict == Verdict.OK:
        return {"called a misprint": replace(line, verdict=Verdict.MISPRINT, intended="as printed")}
    return {
        "called ok": replace(line, verdict=Verdict.OK),
        "called ok, the correction withdrawn": replace(line, verdict=Verdict.OK, intended="", intended_form=line.printed_form),
        "correction taken for print": replace(line, printed_form=line.intended_form),
        "print taken for correction": replace(line, intended_form=line.printed_form),
        "exchanged": replace(line, printed_form=line.intended_form, intended_form=line.printed_form),
    }


@pytest.mark.parametrize("name", LINES)
def test_another_verdict_is_rejected(name: str) -> None:
    for what, line in talked_over(LINES[name]).items():
        assert judge(line).faults, what


def test_one_mistake_is_one_cause_however_many_lines_it_spoils() -> None:
    causes = {(row["paper"], row["cause"]) for row in audited() if row["cause"]}
    assert len(causes) == sum(len(paper.cause) for paper in PAPER_FILES) < len(READ)
    assert {row["cause"] for row in audited() if row["verdict"] == "wrong"} == {"inverse of a projector"}
    assert all(row["doubt"] for row in audited() if row["verdict"] == "unreadable")


def test_the_verdict_of_a_row_is_measured_and_not_read() -> None:
    right, off = LINES["velocities"], LINES["gravity"]
    blamed = measured_row(
        replace(right, verdict=Verdict.MISPRINT, intended="other", cause=Cause("a slip", Verdict.MISPRINT, "A slip."))
    )
    assert (blamed["verdict"], blamed["stands"]) == ("ok", False)
    praised = measured_row(replace(off, verdict=Verdict.OK, cause=None))
    assert (praised["verdict"], praised["stands"]) == ("wrong", False)


@pytest.mark.parametrize("other", sorted(set(Verdict) - {Verdict.OK}))
def test_the_kind_of_a_cause_is_what_is_said_of_all_its_lines(other: Verdict) -> None:
    line = LINES["row 3 of g"]
    assert line.cause is not None
    assert measured_row(replace(line, cause=replace(line.cause, kind=other)))["verdict"] == other


BROKEN = {
    "syntax": ('paper = "Men', "paper = Men", "TOML syntax"),
    "unknown key": ('place = "(1)"', 'spot = "(1)"', "chapter.0.line.0.place: Field required"),
    "not a verdict": ('kind = "loose"', 'kind = "fine"', "cause.quotient.kind: Input should be 'ok'"),
    "a cause that is ok": ('kind = "loose"', 'kind = "ok"', "line 'line as a quotient': cause 'quotient'"),
    "unreadable without a reason": ('kind = "loose"', 'kind = "unreadable"', "says by its `doubt` why"),
    "negative tolerance": ("value = 1e-13", "value = -1e-13", "tolerance.positions.value: Input should be greater"),
    "no such function": ('form = "sides"', 'form = "slides"', "line 'loops of the shaper', printed_form: no function 'slides'"),
    "no such measure": ('measure = "loops_off"', 'measure = "off"', "chapter.measure.off: no such key, though a line names it"),
    "no such module": ('forms = "points"', 'forms = "poems"', "forms: no module gauss_bench.papers.forms.poems"),
    "no such cause": ('cause = "X for Y"', 'cause = "Y for X"', "cause.Y for X: no such key"),
    "a tolerance nobody uses": (
        "[tolerance.count]",
        "[tolerance.spare]\nvalue = 0.0\nreason = 'x'\n[tolerance.count]",
        "spare: no line",
    ),
    "half a correction": ('cause = "X for Y"\n', "", "either `form`, or all of"),
    "a name twice": (
        'name = "lengths of lever and rod"',
        'name = "loops of the shaper"',
        "two lines are called 'loops",
    ),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_a_broken_data_file_is_refused_by_file_table_and_key(tmp_path: Path, fault: str) -> None:
    old, new, message = BROKEN[fault]
    text = (FOLDER / "men_2009.toml").read_text(encoding="utf-8")
    assert old in text
    broken = tmp_path / "broken.toml"
    broken.write_text(text.replace(old, new, 1), encoding="utf-8")
    if fault in ("half a correction", "no such cause"):  # its cause is then used by no line, which is found first
        text = broken.read_text(encoding="utf-8")
        start = text.index('[cause."X for Y"]')
        broken.write_text(text[:start] + text[text.index("[cause.", start + 1) :], encoding="utf-8")
    with pytest.raises(ValueError, match=f"broken.toml: .*{re.escape(message)}"):
        lines_of(broken)


def names_in(node: ast.AST) -> set[str]:
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name)} | {
        n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)
    }


def test_every_function_and_constant_of_the_forms_serves_a_line() -> None:
    """Reached from the names in the data files, through what calls what; what tests alone use is not used."""
    defined: dict[str, set[str]] = {}  # name -> names that its definitions mention
    for path in sorted(Path(forms.__file__).parent.glob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            match node:
                case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                    defined.setdefault(name, set()).update(names_in(node))
                case ast.Assign(targets=targets):
                    for target in targets:
                        for name in names_in(target):
                            defined.setdefault(name, set()).update(names_in(node.value))
    reached, waiting = set(), []
    for paper in PAPER_FILES:
        for chapter in paper.chapter:
            waiting += [*chapter.measure, *(x.truth for x in paper.number.values())]
            for line in chapter.line:
                waiting += [x for x in (line.form, line.printed_form, line.intended_form, line.example and line.example.of) if x]
    waiting = [name.rpartition(".")[2] for name in waiting]
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting += defined.get(name, set())
    assert set(defined) - reached == set()


def test_the_data_files_are_part_of_the_package() -> None:
    assert {path.stem for path in FOLDER.glob("*.toml")} == set(PAPERS)
    assert [paper.paper for paper in PAPER_FILES] == list(dict.fromkeys(row["paper"] for row in audited()))


def test_rows_are_flat_and_finite() -> None:
    rows = audited()
    assert [row["name"] for row in rows] == list(LINES)
    for row in rows:
        assert row["stands"] is True
        assert row["faults"] == ""
        assert all(isinstance(x, str | bool | float | None) for x in row.values())
        assert all(np.isfinite(x) for x in row.values() if isinstance(x, float))
        assert row["sentence"].endswith(".")


def test_the_numbers_a_reader_may_check_by_hand() -> None:
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


def test_the_truths_owe_nothing_to_the_paper() -> None:
    for problem in problems.all_problems():
        residual = problem.M @ problem.a + problem.f + problem.J.T @ problem.multipliers - problem.Q
        assert np.abs(residual).max() < 1e-10 * np.abs(problem.M @ problem.a).max()
        assert np.abs(problem.J @ problem.a - problem.g).max() < 1e-10 * np.abs(problem.J @ problem.a).max() + 1e-10
    assert len({t.equations.mechanism.name for t in turnings()}) == 4
    assert any(abs(p.phi_rate - p.s_rate) > 0.5 for p in lu.poses())


def test_a_computer_inverts_the_singular_projector_to_noise() -> None:
    for problem in problems.crank_problems():
        N = np.eye(problem.n) - np.linalg.pinv(problem.J) @ problem.J
        try:
            a = np.linalg.pinv(problem.J) @ problem.g - N @ np.linalg.inv(N) @ (
                np.linalg.pinv(problem.J) @ problem.g - np.linalg.solve(problem.M, problem.Q)
            )
        except np.linalg.LinAlgError:
            continue
        assert np.abs(problem.J @ a - problem.g).max() > 1.0


@pytest.mark.long
@pytest.mark.slow
def test_the_misprints_by_symbols() -> None:
    sp = needs("sympy")
    t, l1, l2, e = sp.symbols("t l1 l2 e")
    a1, x2, y2, a2, x3, phi, s = (sp.Function(name)(t) for name in ("a1", "x2", "y2", "a2", "x3", "phi", "s"))
    rod = y2 + l2 / 2 * sp.sin(a2)
    assert sp.diff(rod, a2) == l2 / 2 * sp.cos(a2)
    for constraint, bias in (
        (l1 * sp.cos(a1) - x2 + l2 / 2 * sp.cos(a2), l1 * sp.cos(a1) * a1.diff(t) ** 2 + l2 / 2 * sp.cos(a2) * a2.diff(t) ** 2),
        (x2 + l2 / 2 * sp.cos(a2) - x3, l2 / 2 * sp.cos(a2) * a2.diff(t) ** 2),
        (rod, l2 / 2 * sp.sin(a2) * a2.diff(t) ** 2),
    ):
        Ja = sum(sp.diff(constraint, q) * q.diff(t, 2) for q in (x2, y2, x3, a1, a2))
        assert sp.simplify(Ja - bias - constraint.diff(t, 2)) == 0
    J = sp.Matrix([e * sp.cos(phi) - s * sp.sin(phi), e * sp.sin(phi) + s * sp.cos(phi)])
    phi_rate, s_rate = phi.diff(t), s.diff(t)
    printed = sp.Matrix(
        [
            -e * phi_rate * sp.sin(phi) - s * phi_rate * sp.cos(phi) - phi_rate * sp.sin(phi),
            e * phi_rate * sp.cos(phi) - s * phi_rate * sp.sin(phi) + phi_rate * sp.cos(phi),
        ]
    )
    missing = (phi_rate - s_rate) * sp.Matrix([sp.sin(phi), -sp.cos(phi)])
    assert sp.simplify(J.diff(t) - printed - missing) == sp.zeros(2, 1)
