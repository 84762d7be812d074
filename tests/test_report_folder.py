"""A report replaces its own files alone, and a folder without a run has no report."""

from gauss_bench.cli import main
from gauss_bench.report.build import build_report
from gauss_bench.tables import write_schema, write_table

ROW = {"mechanism": "four_bar", "first": "a", "second": "b", "position": 1e-16, "velocity": 1e-16, "acceleration": 1e-15}


def test_a_folder_without_a_run_is_refused_and_stays_as_it_is(tmp_path, capsys):
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "mine.svg").write_text("<svg/>")
    assert main(["report", "--out", str(tmp_path)]) == 2
    assert "no run there" in capsys.readouterr().err
    assert [p.name for p in tmp_path.rglob("*")] == ["figures", "mine.svg"]
    assert main(["report", "--out", str(tmp_path / "nowhere")]) == 2
    assert not (tmp_path / "nowhere").exists()


def test_files_that_gauss_bench_did_not_write_are_kept(tmp_path):
    write_table("agreement", [ROW], tmp_path)
    write_schema(tmp_path)
    site = tmp_path / "site"
    site.mkdir()
    (site / "mine.html").write_text("<p>mine</p>")
    build_report(tmp_path)
    assert (site / "mine.html").read_text() == "<p>mine</p>", "a folder that was not ours was emptied"
    (site / "engine-gone.html").write_text("")
    guide = site / "docs" / "index.html"
    guide.parent.mkdir()
    guide.write_text("the documentation")
    build_report(tmp_path)
    assert guide.read_text() == "the documentation"
    assert "docs/index.html" in (site / "index.html").read_text()
    assert not (site / "engine-gone.html").exists(), "a page of an earlier report stayed"
    assert (tmp_path / "agreement.csv").exists()
