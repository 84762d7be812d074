"""Kinematics from the command line: three ways that agree, errors that name what is wrong, pictures and tables."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.cli import main

DATA = Path(__file__).parent / "data"


def said(capsys, *arguments, code=0):
    assert main(["kinematics", *arguments, "--json"]) == code
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("law", "angles", "speed"),  # [rad] at the start, at half the time and at the end; [rad/s] at the end
    [
        ("poly345:travel=1.0,time=2.0", [0.0, 0.5, 1.0], 0.0),
        ("constant:speed=2.0,start_deg=10.0", np.radians(10.0) + np.array([0.0, 1.0, 2.0]), 2.0),
        ("table:file=law.csv", np.radians([0.0, 20.0, 60.0]), 0.0),  # clamped ends
    ],
)
def test_laws_are_given_by_name_and_keys_or_a_table(law, angles, speed, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("law.csv").write_text("# t, degrees\n0, 0\n0.5, 20\n1.0, 60\n", encoding="utf-8")
    driver = said(capsys, "four_bar", "--driver", law, "--steps", "2")["driver"]
    assert driver["angle"] == pytest.approx(angles, abs=1e-12)
    assert driver["speed"][-1] == pytest.approx(speed, abs=1e-12)


def test_a_limit_of_motion_is_told_with_what_was_reached(capsys):
    found = said(capsys, str(DATA / "pushed.toml"), "--driver", "constant:joint=guide,start=0.4,speed=0.5", "--steps", "40", code=1)
    assert found["status"] == "stopped"
    assert "limit" in found["message"]
    assert 0 < len(found["t"]) < 41


def test_tables_and_pictures_are_written_and_a_users_files_are_not_written_over(tmp_path, capsys):
    """Nothing is written where one of the files is there already; with --replace all of them are."""
    plot, film, table = (tmp_path / name for name in ("plot.svg", "film.svg", "table.csv"))
    command = ["kinematics", "four_bar", "--steps", "24", "--plot", str(plot), "--animate", str(film), "--out", str(table)]
    table.write_text("mine", encoding="utf-8")
    assert main(command) == 2
    assert "is there already" in capsys.readouterr().err
    assert table.read_text(encoding="utf-8") == "mine"
    assert not plot.exists()
    assert main([*command, "--replace"]) == 0
    rows = list(csv.DictReader(table.open(encoding="utf-8")))
    assert len(rows) == 25
    assert float(rows[6]["crank.theta [rad]"]) == pytest.approx(np.pi / 2, abs=1e-12)
    assert "<svg" in plot.read_text(encoding="utf-8")
    assert "animate" in film.read_text(encoding="utf-8")
    capsys.readouterr()
    assert main([*command[:4], "--out", "csv"]) == 0
    assert capsys.readouterr().out == table.read_text(encoding="utf-8")
