"""The report of a run: its control is named, it has every row, and equal rows give equal files; drawings and their guide."""

import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.linkage import schema
from gauss_bench.linkage.load import built_in, load, load_document
from gauss_bench.report.build import all_findings, build_report
from gauss_bench.report.drawings.drawing import draw
from gauss_bench.report.drawings.pose import pose_links
from gauss_bench.report.rows import KEYS, Run
from gauss_bench.tables import write_schema, write_table
from tests.published import published
from tests.test_measurements_findings import row

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(("valid", "tone"), [(False, "good"), (True, "bad")])
def test_the_control_is_named_and_what_is_not_valid_ranks_nowhere(valid, tone):
    """The soft engine and the control are the cheapest by far."""
    wrong = {"control": True, "acceleration_error_median": 0.7, "acceleration_residual": 1e-13, "step_time": 1e-9}
    rows = (row(), row("mujoco", valid=False, step_time=1e-9), row("yuan_ge_eq16", valid=valid, **wrong))
    found = {x.title: x for x in all_findings(Run({}, {"results": rows}))}
    control = found["The negative control"]
    assert control.text.startswith("`yuan_ge_eq16` satisfies the acceleration constraints to 1.0e-13 and is still wrong")
    assert (control.tone, "None of its rows passes the gate" in control.text) == (tone, not valid)
    assert "Cheapest within 1e-03 rad: `gauss`" in found["four_bar, torque"].text


@pytest.mark.slow
def test_rows_in_another_order_give_the_same_pages_with_every_case(tmp_path):
    rows = published().results
    for name, turn in (("one", 1), ("other", -1)):
        write_table("results", rows[::turn], tmp_path / name)
        write_schema(tmp_path / name)
        files = build_report(tmp_path / name)
    apart = [
        path.name for path in files if path.read_bytes() != (tmp_path / "one" / path.relative_to(tmp_path / "other")).read_bytes()
    ]
    assert not apart
    pages = "".join(path.read_text() for path in (tmp_path / "one" / "site").glob("linkage-*-rows.html"))
    assert len(re.findall(r"<tr(?: hidden)?><td", pages)) == len(rows)


def test_a_run_of_an_unknown_linkage_without_an_environment_is_reported(tmp_path):
    key = ("unheard_of", "torque", "new_engine", "", "", "", math.nan, 2.0)
    write_table("results", [dict(zip(KEYS, key, strict=True)) | {"status": "crashed", "valid": False, "control": False}], tmp_path)
    write_schema(tmp_path)
    build_report(tmp_path)
    page = (tmp_path / "site" / "method.html").read_text()
    assert "crashed" in page
    assert not re.search(r"\bnan\b", page, re.IGNORECASE)


@pytest.mark.slow
def test_drawings_show_every_link_and_are_up_to_date():
    for name in built_in():
        svg = draw(*pose_links(name))
        assert all(f">{link.name}</text>" in svg for link in load(name).links)
        kept = (ROOT / "mechanisms" / f"{name}.svg").read_text()
        split = re.compile(r"-?\d+\.?\d*")
        assert split.sub("#", kept) == split.sub("#", svg), f"{name}: run make drawings"
        # half a pixel: another machine's rounding, far below what is seen
        np.testing.assert_allclose([float(x) for x in split.findall(kept)], [float(x) for x in split.findall(svg)], atol=0.5)


GUIDE = (ROOT / "mechanisms" / "README.md").read_text()


def test_the_guides_complete_file_loads_and_is_drawn_in_any_state_and_without_bars(tmp_path):
    (example,) = (x for x in re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL) if x.startswith("format"))
    document = tomllib.loads(example)
    path = tmp_path / f"{document['name']}.toml"
    path.write_text(example)
    assert {load(path, scenario).dof for scenario in document["scenarios"]} == {1}
    document["links"]["crank"] |= {"mass": 1.0, "inertia": 1.0}
    for key in ("bars", "kg_per_m"):
        document["links"]["crank"].pop(key, None)
    mechanism = load_document(document)
    assert draw(mechanism) != draw(mechanism, np.zeros(mechanism.n))
    assert draw(mechanism) == draw(mechanism, mechanism.q0)


def test_the_guide_names_every_key_of_the_grammar():
    tables = [x for x in vars(schema).values() if isinstance(x, type) and issubclass(x, schema.Table)]
    keys = {field.alias or name for table in tables for name, field in table.model_fields.items()}
    words = set(re.findall(r"\w+", GUIDE))
    assert keys - words == set()
    assert set(built_in()) <= words
