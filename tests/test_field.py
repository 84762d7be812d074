"""The field: the same questions to every engine, and a reason in place of each answer that there is not."""

import json
import math
import os
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.bench import sizes
from gauss_bench.bench.measurements import field
from gauss_bench.bench.measurements.cost import START, time_first_step
from gauss_bench.bench.measurements.search import space_of
from gauss_bench.bench.runner import run as run_suite
from gauss_bench.bench.sizes import required_by, size_of
from gauss_bench.checksums import ChangedRows, checksum_of_run, read_checksums
from gauss_bench.engines import ELSEWHERE, FOREIGN
from gauss_bench.engines.installation import read_offered
from gauss_bench.linkage.load import load
from gauss_bench.report.build import build_report, read_run
from gauss_bench.report.citation import renew
from gauss_bench.report.content import Bullets, Table, Text, lay_out
from gauss_bench.report.field_run import READ, drop_unread
from gauss_bench.report.pages import fault_sections
from gauss_bench.report.rows import Run
from gauss_bench.report.sections import field as shown
from gauss_bench.report.site.engine import (
    command_of,
    engine_page,
    engines_page,
    list_changes,
    list_commands,
    list_failures,
    list_inexact,
    runs_of_engines,
)
from gauss_bench.report.site.first import write_call
from gauss_bench.report.site.settings import Setting
from gauss_bench.runs.offers import offer
from gauss_bench.suites.read import of_engines, read_suite
from gauss_bench.suites.schema import SameQuestions, Search, Suite
from gauss_bench.tables import TABLES, files_of, row_of, write_schema, write_table
from gauss_bench.trajectory import Trajectory
from tests.conftest import needs

REPORTS = Path(__file__).parents[1] / "reports"
PLACE = {"mechanism": "four_bar", "scenario": "torque"}
PART = SameQuestions(
    linkages={"four_bar": "torque"},
    redundant={"parallelogram": "torque"},
    step=1e-3,
    until=0.05,
    processes=2,
    position=(1e-4, 1e-6),
)
SEARCH = Search(linkages={"four_bar": "torque"}, own=("gauss",), until=0.1, budget=2, most_steps=9, rounds=1, lead=0.1, brief=True)


def test_two_runs_agree_only_if_every_bit_does():
    x = np.linspace(0.0, 1.0, 12).reshape(4, 3)
    one = Trajectory(np.arange(4.0), x, x + 1, x + 2, 3)
    assert field.repeats(one, replace(one, q=x.copy())) == (True, 0.0)
    off = x.copy()
    off[2, 1] = np.nextafter(off[2, 1], 2.0)
    same, apart = field.repeats(one, replace(one, q=off))
    assert (same, apart) == (False, off[2, 1] - x[2, 1])
    rates = replace(one, v=np.nextafter(one.v, 9.0))
    assert field.repeats(one, rates) == (False, 0.0)  # positions agree, rates do not
    signed = replace(one, q=np.where(x == 0, -0.0, x))
    assert struct.pack("d", signed.q[0, 0]) != struct.pack("d", x[0, 0])
    assert field.repeats(one, signed) == (False, 0.0)


def test_an_engine_that_does_not_repeat_is_a_row_that_says_so(tmp_path):
    """Two engines: one adds noise below 1e-9 to its samples, one does not."""
    steady, rows = "tests.faulty_engines:Sound", {}
    for name, engine in {"steady": steady, "dice": "tests.faulty_engines:Dice"}.items():
        found = field.compare_runs("four_bar", "torque", engine, ("default", "rk4", "none"), 1e-3, 0.05, str(tmp_path / "store"))
        (rows[name],) = found["field"]
        assert rows[name]["status"] == "ok", rows[name]["message"]
    assert (rows["steady"]["same_bits"], rows["steady"]["difference"]) == (True, 0.0)
    assert rows["dice"]["same_bits"] is False
    assert 0 < rows["dice"]["difference"] < 1e-9
    assert rows["steady"]["force_error"] < 1e-3  # [N], of a step of order four
    assert math.isnan(rows["steady"]["told_force_error"])
    assert rows["dice"]["told_force_error"] > 1.0  # [N] of a pin that carries more than it tells, which is nothing
    started = time_first_step("four_bar", "torque", steady, 1e-3, START, 1)["samples"]
    assert [(r["quantity"], r["process"], 0 < r["seconds"] < 60) for r in started] == [("start", 1, True)]


def test_an_engine_that_is_not_installed_is_a_row_with_its_reason(engines):
    tables = {}
    field.complete(Suite(format="gauss-bench-suite/1", title="one", field=(PART,)), tables)
    rows = {row["engine"]: row for row in tables["field"]}
    assert rows.keys() == ELSEWHERE.keys()
    for name, row in rows.items():
        assert row["status"] == "skip"
        assert row["message"] == f"the engine {name} is not installed; `gauss-bench engines install {name}` installs it"
        assert row["redundant"] == "parallelogram"
        assert row["size"] == read_offered(name).installed
        assert row_of(TABLES["field"], row)


def test_the_start_of_an_engine_is_the_middle_of_its_processes():
    samples = [{"quantity": "start", "engine": "x", "seconds": s} for s in (1.0, 3.0, 2.0)]
    others = [{"quantity": "step", "engine": "x", "seconds": 9.0}, {"quantity": "start", "engine": "y", "seconds": 9.0}]
    columns = field.start_columns([*samples, *others], "x")
    assert columns["start"] == 2.0
    assert columns["start_low"] <= 1.0
    assert columns["start_high"] >= 3.0
    assert field.start_columns(samples, "z") == {}


def test_the_size_of_an_environment_is_that_of_its_folder_in_megabytes(engines, tmp_path):
    """Without caches and links."""
    place = tmp_path / "there"
    (place / "bin" / "__pycache__").mkdir(parents=True)
    engines.write_text(f'[twin]\nclass = "a:B"\npython = "{place}/bin/python"\n')
    assert math.isnan(size_of("twin").megabytes)  # the interpreter is in no environment of its own
    (place / "pyvenv.cfg").write_bytes(bytes(500_000))
    (place / "library.so").write_bytes(bytes(2_000_000))
    (place / "bin" / "__pycache__" / "b.pyc").write_bytes(bytes(500))
    (place / "link.so").symlink_to(place / "library.so")
    assert size_of("twin").megabytes == 2.5
    assert math.isnan(size_of("gauss").megabytes)
    assert size_of("gauss").measured == "a part of the suite"


def test_the_size_of_a_library_is_that_of_all_that_it_requires(monkeypatch):
    monkeypatch.setattr(sizes, "direct_requirements", lambda engine: ["Jinja2"])
    monkeypatch.setattr(sizes, "size_of_distribution", lambda found: 3_000_000)
    assert sorted(x.metadata["Name"].lower() for x in required_by(["Jinja2", "jinja2"])) == ["jinja2", "markupsafe"]
    assert size_of("mujoco").megabytes == 6.0


def test_a_brief_search_tries_what_an_engine_names_first_or_its_first_integrators():
    mujoco, own = offer("mujoco"), offer("gauss-native")
    assert {x.name for x in space_of(mujoco, SEARCH)} == set(mujoco.first)
    assert {(x.integrator, x.stabilization) for x in space_of(own, SEARCH)} == {(x, "none") for x in own.integrators[:2]}
    whole = SEARCH.model_copy(update={"brief": False})
    assert len(space_of(mujoco, whole)) == len(mujoco.variants)


def test_the_suite_asks_every_engine_within_twenty_minutes():
    suite = read_suite("field")
    (part,) = suite.field
    assert (suite.hours or 1.0) <= 1 / 3
    assert part.engines == ()
    assert {*part.position} == {*shown.ACCURACIES.values()} == {x for p in suite.search for x in p.position}
    assert part.step in {x for p in suite.accuracy if "four_bar" in p.linkages for x in p.steps}
    assert all(load(x, s).redundant > 0 for x, s in part.redundant.items())
    assert of_engines(suite, ["gauss"]).field[0].engines == ("gauss",)


# What the site shows

METHOD = {"settings": "default", "integrator": "rk4", "stabilization": "none"}
ASKED = PLACE | METHOD | {"step": 1e-3, "redundant": "parallelogram"}
FORCES = {"force_error": 2e-3, "told_force_error": 4e-5}
FIRST = {"start": 0.5, "size": 12.0, "size_of": "its environment"}
FIELD = [
    ASKED | {"engine": "good", "status": "ok", "same_bits": True, **FORCES, **FIRST},
    ASKED | {"engine": "good", "settings": "tuned", "status": "ok", "same_bits": True, "start": 0.5, "size": 12.0},
    ASKED | {"engine": "dice", "status": "ok", "same_bits": False, "difference": 3e-10, "size_of": "a part of the suite"},
    ASKED | {"engine": "gone", "settings": "", "integrator": "", "status": "skip", "message": "the engine gone is not installed"},
]
CASE = PLACE | METHOD | {"step": 1e-3, "t_end": 1.0, "status": "ok", "valid": True, "control": False, "steps": 1000.0}
CASES = [
    CASE | {"engine": "good", "acceleration_error_median": 1e-12, "observed_order": 4.0, "length_error": 1e-7},
    CASE | {"engine": "good", "settings": "tuned", "acceleration_error_median": 1e-3, "length_error": 1e-5},
    CASE | {"engine": "good", "mechanism": "six_bar", "length_error": 9e-7},
    CASE | {"engine": "good", "mechanism": "parallelogram", "length_error": 2e-7},
    CASE | {"engine": "good", "settings": "tuned", "mechanism": "parallelogram", "status": "skip", "message": "rows are redundant"},
    CASE | {"engine": "dice", "acceleration_error_median": 1e-12, "observed_order": 1.0, "length_error": 1e-4},
]
WINNER = PLACE | METHOD | {"engine": "good", "required": "position", "unit": "m", "status": "ok", "step": 1e-3, "error": 1e-7}
WINNERS = [
    WINNER | {"accuracy": 1e-4, "seconds": 2e-3, "seconds_low": 1.5e-3, "seconds_high": 2.5e-3},
    WINNER | {"accuracy": 1e-6, "seconds": 5e-3, "seconds_low": 4e-3, "seconds_high": 6e-3},
]


@pytest.fixture
def run():
    rows = {"field": FIELD, "results": CASES, "search_winners": WINNERS}
    return Run({}, {name: tuple(row_of(TABLES[name], x) for x in some) for name, some in rows.items()})


def cells(table):
    """The lines of a table: head -> text and, of a dash, its reason."""
    return [dict(zip(table.head, ((cell.text, cell.why) for cell in line), strict=True)) for line in table.rows]


def test_every_cell_has_an_answer_or_its_reason(run):
    asked = cells(lay_out("field", shown.list_results(run)))
    dice, gone, good, tuned = sorted(asked, key=lambda x: (x["engine"], x["settings"][0]))
    assert [x["engine"][0] for x in (dice, gone, good, tuned)] == ["dice", "gone", "good", "good"]
    expected = {
        "same model": "yes",
        "order": "4.0",
        "error at 1 ms [m]": "1.0e-07",
        "redundant rows [m]": "2.0e-07",
        "joint forces [N]": "2.0e-03",
        "its own forces [N]": "4.0e-05",
        "repeats": "yes",
    }
    assert {head: good[head][0] for head in expected} == expected
    assert tuned["same model"] == ("off by 1e-03", "")
    assert tuned["order"] == ("-", "no order")
    assert tuned["redundant rows [m]"] == ("-", "cannot be modelled")
    assert tuned["joint forces [N]"] == ("-", "the forces are not determined")
    assert tuned["its own forces [N]"] == ("-", "none returned")
    assert dice["repeats"] == ("no, 3e-10 apart", "")
    for head in ("same model", "order", "error at 1 ms [m]", "repeats"):
        assert gone[head] == ("-", "the engine gone is not installed")


def test_an_engine_has_one_line_of_costs(run):
    table = lay_out("field_costs", shown.list_costs(run))
    _, dice, gone = cells(table)
    assert [cell.text for cell in table.rows[0]] == [
        *("good", "2.00 ms", "1.50 ms..2.50 ms", "1.00", "5.00 ms", "4.00 ms..6.00 ms", "1.00"),
        *("500 ms", "12"),
    ]
    assert dice["time within 1e-6 m"] == ("-", "not searched in this run")
    assert dice["start"] == ("-", "not timed")
    assert dice["size [MB]"] == ("-", "a part of the suite")
    for head in ("time within 0.1 mm", "start"):
        assert gone[head] == ("-", "the engine gone is not installed")


def test_costs_of_engines_in_environments_are_told_as_multiples_of_the_fastest():
    costs = {"own": 1e-3, "slow": 8e-3, "apart": 2.5e-3, "soft": math.nan}
    winners = [WINNER | {"engine": x, "accuracy": 1e-4, "seconds": seconds} for x, seconds in costs.items()]
    rows = {"field": [ASKED | {"engine": x, "status": "ok"} for x in costs], "search_winners": winners}
    lines = shown.list_costs(Run({}, {name: tuple(row_of(TABLES[name], x) for x in some) for name, some in rows.items()}))
    assert [x["coarse_over"] for x in lines[:3]] == [1.0, 8.0, 2.5]
    assert math.isnan(lines[3]["coarse_over"])
    assert shown.compare_costs(lines, ["apart", "slow", "soft"], "coarse") == (
        "To hold a tenth of a millimetre on four_bar takes these multiples of the time of `own`, the fastest engine: "
        "`apart` 2.50 and `slow` 8.00; no setting of `soft` was found."
    )
    assert shown.compare_costs(lines, ["soft"], "coarse") == ""
    assert shown.compare_costs(lines, ["apart"], "fine") == ""


def test_findings_pages_and_commands_of_engines_name_what_was_asked(run):
    (finding,) = shown.findings(run)
    assert finding.text == (
        "Two runs in two new processes agree bit by bit for 1 of 2 engines; not for `dice`. Not run twice: `gone`."
    )  # fmt: skip
    assert ([*shown.findings(Run())], shown.section(Run())) == ([], None)
    assert 'id="field"' in engines_page(run).body
    kept = [{"engine": "good", "accepted": x} for x in ("2026-01-02 another step", "2026-01-03 steps", "2026-01-02 another step")]
    assert list_changes(kept) == [
        {"date": "2026-01-03", "reason": "steps", "figures": 1},
        {"date": "2026-01-02", "reason": "another step", "figures": 2},
    ]
    page = engine_page(replace(run, accepted=tuple(kept)), "good").body
    assert all(x in page for x in ("engines.html#field", "off by 1e-03", "another step"))
    assert "is not installed" in engine_page(run, "gone").body
    ((words, command),) = list_commands(replace(run, tables={"results": run.results[5:]}), "dice")  # no setting was found
    assert words == "four_bar as shipped"
    assert command == (
        "gauss-bench simulate four_bar --scenario torque --engine dice --settings default --integrator rk4 --stabilization none "
        "--step 0.001 --at 1"
    )


def test_a_setting_whose_accelerations_are_not_the_linkages_is_named_with_its_cause(run):
    said = "Under `tuned` the relative error of accelerations at given states is 1.0e-03 in the median, where 1e-06 counts as none"
    assert list_inexact(run, "good") == [f"{said}."]
    soft = replace(run, environment={"engines": {"good": {"soft": {"tuned": "its closures are springs"}}}})
    assert list_inexact(soft, "good") == [f"{said}: its closures are springs."]
    assert list_inexact(run, "dice") == []
    one = Setting(
        "four_bar", "torque", "mujoco", 'rigid,tree="least depth"', "rk4", "none", 1e-3, math.nan, 10.0, *[math.nan] * 3, False,
        1e-5, math.nan, 1.0,
    )  # fmt: skip
    assert "--settings 'rigid,tree=\"least depth\"' --integrator rk4" in command_of(one, "torque")
    assert "--step 0.001 --at 1" in command_of(one, "torque")
    assert "\n    step=0.001,\n    at=[0.0, 1]" in write_call(one)


def test_a_setting_with_a_tolerance_is_run_with_it_and_without_a_step():
    one = Setting(
        "four_bar", "torque", "drake", "bushing", "runge_kutta3_adaptive", "none", math.nan, 1e-8, 50.0, *[math.nan] * 3, False,
        1e-5, math.nan, 1.0,
    )  # fmt: skip
    assert command_of(one, "torque").endswith(" --tolerance 1e-08 --at 1")
    assert "\n    stabilization='none',\n    tolerance=1e-08,\n    at=[0.0, 1],\n)" in write_call(one)
    assert "step" not in command_of(one, "torque") + write_call(one)


def test_evaluations_that_ended_early_have_a_smallest_step_only_if_one_of_them_has_a_step():
    early = tuple(PLACE | METHOD | {"engine": "good", "status": "diverged", "step": x} for x in (0.02, 0.01, math.nan))
    sentence = list_failures(Run({}, {"search_ladder": early}), "good")[0]
    assert sentence == "In the search 3 of 3 evaluations ended early; the smallest step among them was 0.01 s."
    assert list_failures(Run({}, {"search_ladder": early[2:]}), "good")[0] == "In the search 1 of 1 evaluation ended early."


# The run beside another


MACHINE = {
    "suite": "field",
    "date": "2026-05-04",
    "commit": "fedcba987654",
    "cpu": "a quiet machine",
    "versions": {"gauss-bench": "1"},
}
HOME = {"good": {"version": "Good 3", "settings": {"default": {"knob": 7}}, "environment": "Python 3.12.1"}}
VARIANT = PLACE | METHOD | {"engine": "good", "step": 1e-3, "status": "ok"}
FAULT = """# Good 3: one is two

**Seen with** Good 3, where `one()` is
two.

| call | value |
| --- | ---: |
| `one()` | 2 |

- first
  line
- second
"""


@pytest.fixture
def folder(tmp_path):
    """A run of two engines, and beside it a run of the field that alone has the engine good."""
    folder = tmp_path / "reports"
    beside = folder / "field"
    own = [CASE | {"engine": x, "length_error": 1e-7} for x in ("dice", "gauss")]
    curve = [{k: CASE[k] for k in METHOD} | PLACE | {"engine": "good", "step": 1e-3, "t_end": 1.0, "t": 0.1}]
    races = {"search_winners": WINNERS, "search_ladder": [VARIANT | {"position_error": 1e-7, "until": 1.0, "steps": 250.0}]}
    races["search_times"] = [VARIANT | {"seconds": 2e-3}]
    for place, tables, known in (
        (folder, {"results": own}, {"suite": "full", "date": "2026-01-01", "commit": "0123456789ab", "cpu": "cpu", "versions": {}}),
        (beside, {"field": FIELD, "results": CASES, "series": curve, **races}, MACHINE | {"engines": HOME}),
    ):
        for name, rows in tables.items():
            write_table(name, rows, place)
        write_schema(place)
        (place / "environment.json").write_text(json.dumps(known))
    (folder / "findings").mkdir()
    (folder / "findings" / "good_one_is_two.md").write_text(FAULT)
    return folder


def texts(site):
    return {path.name: path.read_text() for path in site.glob("*.html")}


def test_the_field_beside_a_run_has_its_own_pages_and_its_own_provenance(folder):
    run = read_run(folder)
    assert run.field_run is run.beside
    assert [x.title for x in shown.findings(run)] == ["Runs that repeat", "Engines in environments of their own"]
    assert list(runs_of_engines(run)) == ["dice", "gauss", "gone", "good"]
    build_report(folder)
    pages = texts(folder / "site")
    assert "suite field, 2026-05-04, commit fedcba9876, a quiet machine" in pages["engines.html"]
    assert "the suite <code>full</code>, whose times are on other pages" in pages["engines.html"]
    assert all(f'href="engine-{x}.html"' in pages["engines.html"] for x in ("dice", "gauss", "gone", "good"))
    good, own = pages["engine-good.html"], pages["engine-gauss.html"]
    assert "<footer><p>suite field · 2026-05-04 · commit fedcba9876 · a quiet machine</p></footer>" in good
    for page in (own, pages["engine-dice.html"]):  # both runs have rows of the engine dice
        assert "<footer><p>suite full · 2026-01-01 · commit 0123456789 · cpu</p></footer>" in page
    assert "This engine runs in an environment of its own: Python 3.12.1." in good
    assert "gauss-bench engines install good" in good
    assert "gauss-bench simulate four_bar --scenario torque --engine good" in good
    assert "knob" in good
    assert "Good 3: one is two" in good
    assert "one is two" not in own
    assert "suite field, 2026-05-04" in pages["cite.html"]
    assert f"rows sha256:{run.beside.checksum}" in pages["cite.html"]
    assert 'href="tables/field/field.csv"' in pages["data.html"]
    assert (folder / "site" / "tables" / "field" / "results.csv").is_file()
    kept = folder / "field"
    drop_unread(kept)  # pages read no table that is dropped
    assert not files_of("series", kept)
    assert "series.parquet" not in read_checksums(kept)
    assert json.loads((kept / "tables.json").read_text())["tables"].keys() == {*READ}
    build_report(folder)
    after = texts(folder / "site")
    # the list of files and the checksum of the run say that a table is gone
    assert {k for k in pages if after[k] != pages[k]} == {"data.html", "cite.html"}


def test_a_changed_row_of_the_field_is_refused_and_the_citation_names_both_runs(folder):
    (folder / "environment.json").write_text(json.dumps(MACHINE | {"suite": "full", "commit": "0123456789ab"}))
    text = renew("before\nidentifiers:\n  - type: other\nafter: 1\n", folder)
    assert text.startswith("before\nidentifiers:\n  - type: other\n")
    assert text.endswith("\nafter: 1\n")
    for path, commit in (("reports", "0123456789ab"), ("reports/field", "fedcba987654")):
        assert f"rows in {path}/, measured by commit {commit}" in text
        assert f'value: "sha256:{checksum_of_run(read_checksums(folder.parent / path))}"' in text
    table = folder / "field" / "field.csv"
    table.write_text(table.read_text().replace("True", "False"))
    with pytest.raises(ChangedRows, match=r"field/field\.csv: a row was changed"):
        read_run(folder)


def test_a_report_on_a_fault_becomes_a_section():
    (section,) = fault_sections({"good_one_is_two": FAULT, "goodness_x": "# other\n"}, "good")
    assert (section.title, section.anchor) == ("Good 3: one is two", "good_one_is_two")
    text, table, bullets = section.blocks
    assert text == Text("**Seen with** Good 3, where `one()` is two.")
    assert isinstance(table, Table)
    assert (table.head, table.numeric) == (["call", "value"], [1])
    assert [[cell.text for cell in row] for row in table.rows] == [["`one()`", "2"]]
    assert bullets == Bullets(["first line", "second"])


@pytest.mark.parametrize("path", sorted((REPORTS / "findings").glob("*.md")), ids=lambda x: x.stem)
def test_every_published_fault_is_on_the_page_of_its_engine(path):
    assert path.stem.partition("_")[0] in {*FOREIGN, *ELSEWHERE}
    (section,) = fault_sections({path.stem: path.read_text(encoding="utf-8")}, path.stem.partition("_")[0])
    tables = [x for x in section.blocks if isinstance(x, Table)]
    assert all(all(x.head) and all(len(row) == len(x.head) for row in x.rows) for x in tables)
    assert "](" not in path.read_text(encoding="utf-8")
    assert path.with_suffix(".py").is_file()


@pytest.mark.long
def test_two_runs_of_the_suite_give_the_same_rows_bit_by_bit(tmp_path):
    needs("llvmlite")
    suite = of_engines(read_suite("field"), ["gauss", "gauss-native"])
    for name in ("one", "other"):
        run_suite(suite, tmp_path / name, 2, costs=False)
    same = ("results.csv", "references.csv", "field.csv", "search_ladder.parquet", "search_space.csv")
    for name in same:
        one, other = ((tmp_path / x / name).read_bytes() for x in ("one", "other"))
        assert one == other, name
    assert os.path.getsize(tmp_path / "one" / "field.csv") > 200
