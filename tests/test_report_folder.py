"""A report touches nothing that is not its own, and is not made of nothing."""

from pathlib import Path

import pytest

from gauss_bench.cli import main
from gauss_bench.report.build import build_report
from gauss_bench.tables import write_schema, write_table

ROW = {"mechanism": "four_bar", "first": "a", "second": "b", "position": 1e-16, "velocity": 1e-16, "acceleration": 1e-15}


def test_a_folder_without_a_run_is_refused_and_stays_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "mine.svg").write_text("<svg/>")
    assert main(["report", "--out", str(tmp_path)]) == 2
    assert "no run there" in capsys.readouterr().err
    assert [p.name for p in tmp_path.rglob("*")] == ["figures", "mine.svg"]
    assert main(["report", "--out", str(tmp_path / "nowhere")]) == 2
    assert not (tmp_path / "nowhere").exists()


def test_figures_of_others_are_never_taken_away(tmp_path: Path) -> None:
    write_table("agreement", [ROW], tmp_path)
    write_schema(tmp_path)
    figures = tmp_path / "figures"
    figures.mkdir()
    (figures / "mine.svg").write_text("<svg/>")
    (figures / "manifest.json").write_text('{"figures": ["../agreement.csv", "old.svg", 3]}')
    (figures / "old.svg").write_text("<svg/>")
    build_report(tmp_path)
    assert (figures / "mine.svg").read_text() == "<svg/>"
    assert not (figures / "old.svg").exists()  # which an earlier report had listed as its own
    assert (tmp_path / "agreement.csv").exists()


@pytest.mark.parametrize("manifest", ["", "[]", '{"figures": "mine.svg"}', '{"figures": null}'])
def test_a_damaged_list_of_figures_takes_nothing_away(manifest: str, tmp_path: Path) -> None:
    write_table("agreement", [ROW], tmp_path)
    write_schema(tmp_path)
    figures = tmp_path / "figures"
    figures.mkdir()
    (figures / "mine.svg").write_text("<svg/>")
    (figures / "manifest.json").write_text(manifest)
    build_report(tmp_path)
    assert (figures / "mine.svg").exists()
