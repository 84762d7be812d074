"""The command line: one object on stdout, everything else on stderr, exit codes as documented."""

import json
import shlex
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.__main__ import run
from gauss_bench.cli import main
from gauss_bench.engines import all_names
from gauss_bench.linkage.load import built_in
from tests.conftest import DATA

REFUSED = tomllib.loads((DATA / "verbs" / "refused.toml").read_text(encoding="utf-8"))  # command -> a word of what is said


def said(capsys, *arguments, code=0):
    assert main(list(arguments)) == code
    return json.loads(capsys.readouterr().out)


class Interrupted:
    """A module whose import ends by an interruption."""

    def __getattr__(self, name):
        raise KeyboardInterrupt


def test_an_interruption_while_modules_are_imported_ends_quietly(monkeypatch):
    monkeypatch.setitem(sys.modules, "gauss_bench.cli", Interrupted())
    assert run() == 130


def test_list_names_every_linkage_and_engine(capsys):
    found = said(capsys, "list", "--json")
    assert found["linkages"].keys() == built_in().keys()
    assert list(found["engines"]) == all_names()


def test_free_links_have_no_loops_and_knife_edges_are_listed(capsys):
    assert main(["show", "sleigh"]) == 0
    printed = capsys.readouterr().out
    assert " 0 loops" in printed
    assert "knife edge blade" in printed


def test_show_checks_every_scenario(capsys, tmp_path):
    found = said(capsys, "show", "six_bar", "--json", "--svg", str(tmp_path / "six_bar.svg"))
    assert found["dof"] == 1
    assert set(found["scenarios"]) == {"driven", "cycloid", "torque", "conservative"}
    assert "<svg" in (tmp_path / "six_bar.svg").read_text(encoding="utf-8")
    assert main(["show", "six_bar", "--svg", str(tmp_path / "six_bar.svg")]) == 2
    assert "is there already" in capsys.readouterr().err
    assert main(["show", "six_bar"]) == 0
    assert "1 degree of freedom, 2 loops" in capsys.readouterr().out


def test_simulate_prints_one_object_with_all_that_is_promised(capsys):
    found = said(
        capsys, "simulate", "crank_slider", "--engine", "gauss", "--scenario", "paper", "--dt", "1e-3", "--at", "0,0.5,1", "--json"
    )
    assert (found["status"], found["engine"], found["mechanism"], found["scenario"]) == ("ok", "gauss", "crank_slider", "paper")
    assert found["t"] == [0.0, 0.5, 1.0]
    assert found["links"]["crank"]["alpha"][0] == pytest.approx(
        -156.57953, abs=1e-5
    )  # the paper's start, by hand in one coordinate


def test_times_off_the_step_grid_are_met_exactly(capsys):
    found = said(capsys, "simulate", "four_bar", "--dt", "1e-2", "--at", "0.0137,0.1", "--json")
    exact = said(capsys, "simulate", "four_bar", "--integrator", "dop853", "--at", "0.0137,0.1", "--json")
    assert found["t"] == [0.0137, 0.1]
    assert np.abs(np.subtract(found["links"]["crank"]["theta"], exact["links"]["crank"]["theta"])).max() < 1e-6


@pytest.mark.parametrize("asked", REFUSED)
def test_what_cannot_be_asked_ends_with_2_is_told_and_writes_nothing(asked, tmp_path, monkeypatch, capsys):
    """Whether no machine could do it, no such thing is there, or options contradict each other: every verb, before any work."""
    monkeypatch.chdir(tmp_path)
    Path("mine").write_text("mine")
    try:
        code = main(shlex.split(asked.replace("DATA", str(DATA))))
    except SystemExit as end:
        code = int(str(end.code))
    told = capsys.readouterr()
    assert code == 2
    assert REFUSED[asked] in told.err
    assert told.out == ""
    assert [x.read_text() for x in tmp_path.iterdir()] == ["mine"]
