"""The first table: multiples of the fastest engine, marks of own engines, both loops of Pinocchio, reasons for missing times."""

import math

import pytest

from gauss_bench.report.first_table import BEGIN, END, first_table, renew
from gauss_bench.report.rows import Run
from gauss_bench.report.sections.claim import compare_formula
from gauss_bench.report.sections.search import divide_by_ours
from gauss_bench.report.site.settings import multiples


def ladder(engine, settings, steps, error, status="ok", **more):
    place = {"mechanism": "four_bar", "scenario": "torque", "engine": engine, "settings": settings, "integrator": "rk4"}
    numbers = {"step": 1 / steps, "tolerance": math.nan, "steps": steps, "position_error": error, "until": 1.0}
    return place | {"stabilization": "none", "status": status, "message": ""} | numbers | more


def timed(row, seconds):
    return row | {"seconds": seconds, "seconds_low": 0.9 * seconds, "seconds_high": 1.1 * seconds}


WAYS = {
    "minimal": (ladder("minimal", "fixed/rk4", 100.0, 5e-7), 1e-5),
    "gauss-native": (ladder("gauss-native", "default", 100.0, 6e-7), 2e-5),
    "compiled": (ladder("pinocchio", "compiled/rk4", 100.0, 7e-7), 4e-4),
    "python": (ladder("pinocchio", "one/rk4", 100.0, 7e-7), 4e-3),
}
MISSED = [ladder("exudyn", "loose", n, 1.0 / n**2) for n in (100.0, 200.0, 400.0)]
RUN = Run({}, {"search_ladder": (*(x for x, _ in WAYS.values()), *MISSED), "search_times": tuple(timed(*x) for x in WAYS.values())})


def test_multiples_are_over_the_fastest_of_all():
    seconds = {"minimal": 1.0, "gauss-native": 2.0, "lagrange-native": 1.5, "mujoco": 30.0, "exudyn": math.nan}
    assert multiples(seconds) == {"minimal": 1.0, "gauss-native": 2.0, "lagrange-native": 1.5, "mujoco": 30.0}


def test_the_first_table_has_error_time_and_multiple_of_each_way():
    assert first_table(Run()) is None
    table = first_table(RUN)
    assert table.title == "Within 1e-06 m of position over 1 s"
    rows = [[cell.text for cell in row] for row in table.rows]
    assert rows == [
        ["minimal (own)", "5.0e-07", "10.0 µs", "1.00", "1 of 1", "1.00"],
        ["gauss-native (own)", "6.0e-07", "20.0 µs", "2.00", "1 of 1", "2.00"],
        ["pinocchio, compiled", "7.0e-07", "400 µs", "40.0", "1 of 1", "40.0"],
        ["pinocchio, called from Python", "7.0e-07", "4.00 ms", "400", "1 of 1", "400"],
        ["exudyn", "not reached in 400 steps; order 2.0 extrapolates to 1,000", "-", "-", "0 of 1", "-"],
    ]


def test_readme_is_renewed_between_its_two_lines_alone():
    page = f"before\n{BEGIN}\nold\n{END}\nafter\n"
    new = renew(page, RUN)
    assert new.startswith(f"before\n{BEGIN}\n| engine |")
    assert new.endswith(f"| 400 |\n| exudyn | {first_table(RUN).rows[-1][1].text} | - | - | 0 of 1 | - |\n{END}\nafter\n")
    assert renew(new, RUN) == new
    with pytest.raises(ValueError, match="README has no lines"):
        renew("no table", RUN)


def test_ratios_are_over_the_cheaper_of_our_engines_even_if_stored_over_one_that_ties():
    def stored(engine, ratio, ours):
        ends = {"ratio_low": 0.9 * ratio, "ratio_high": 1.1 * ratio}
        return {"mechanism": "six_bar", "engine": engine, "ours": ours, "ratio": ratio} | ends

    rows = [stored("gauss-native", 1.0, True), stored("lagrange-native", 0.8, True), stored("mujoco", 40.0, False)]
    found = divide_by_ours(rows)
    assert [r["ratio"] for r in found] == pytest.approx([1.25, 1.0, 50.0])
    assert (found[2]["ratio_low"], found[2]["ratio_high"]) == pytest.approx((45.0, 55.0))


def test_the_papers_claim_is_judged_by_its_own_formula_first():
    def case(engine, mechanism, ratio):
        row = {"mechanism": mechanism, "scenario": "", "engine": engine, "settings": "default", "integrator": "rk4"}
        return row | {"stabilization": "none", "step_time": ratio * 1e-5, "step_ratio": ratio}

    def of(*ratios):
        places = ("four_bar", "six_bar")
        rows = [case("lagrange", x, 0.5) for x in places]
        rows += [case("gauss_pinv", x, y) for x, y in zip(places, ratios, strict=True)]
        return compare_formula(Run({}, {"results": tuple(rows)}))

    said, found = of(1.0, 1.5)
    assert said.startswith("No, by the paper's own formula: ")
    assert "four_bar 2.00 and six_bar 3.00" in said
    assert found == pytest.approx({"four_bar": 2.0, "six_bar": 3.0})
    assert of(0.4, 0.6)[0].startswith("In part, ")
    assert of(0.4, 0.3)[0].startswith("Yes, ")
    assert compare_formula(Run()) == ("", {})
