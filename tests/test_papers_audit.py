"""The audit stands, every line of it can fail, and none lets itself be talked into another verdict."""

from dataclasses import replace

import numpy as np
import pytest

from gauss_bench.papers import crank_slider, problems
from gauss_bench.papers import link_unit_lines as lu
from gauss_bench.papers.audit import lines
from gauss_bench.papers.line import Line, Verdict, discrepancy, judge
from gauss_bench.papers.loop_forms import turnings
from tests.papers_mutations import MUTATIONS
from tests.papers_tables import audited

LINES = {line.name: line for line in lines()}
NOT_OK = {name for name, line in LINES.items() if line.verdict != Verdict.OK}

# As read in the papers by hand: what is transcribed must not turn right by being copied wrong.
READ = {
    "rows that disagree": "loose",
    "exponent of M in A": "misprint",
    "exponent of M in b": "misprint",
    "motion from A and b": "misprint",
    "unit of length": "misprint",
    "condition of the minimum": "loose",
    "inverse in the minimum": "loose",
    "sign before the last term": "misprint",
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
    "accelerations": "misprint",
    "one 1 in each row": "loose",
    "loops one above the other": "misprint",
    "incidence matrix": "misprint",
    "motion laws": "not given",
    "which coordinate of C is known": "misprint",
    "which points are in line": "misprint",
    "line as a quotient": "loose",
    "line as a quotient in a search": "loose",
    "number of assemblies": "loose",
    "insensitive to the start of the search": "loose",
}


def test_every_line_has_a_name_of_its_own_and_wrong_corrections() -> None:
    assert len(LINES) == len(lines())
    assert MUTATIONS.keys() == LINES.keys()
    assert {name: str(LINES[name].verdict) for name in NOT_OK} == READ


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


def test_the_misprints_by_symbols() -> None:
    sp = pytest.importorskip("sympy")
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
