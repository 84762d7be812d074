"""Kernels need hardly more operations than those of an earlier version, which `data/kept_operations.json` holds."""

import json
from pathlib import Path

import pytest

from gauss_bench.compiler.elimination.program import generate
from gauss_bench.linkage.load import load

# linkage -> scenario -> formulation -> number of operations of the accelerations
KEPT = json.loads(Path(__file__).with_name("data").joinpath("kept_operations.json").read_text())
CASES = [(linkage, scenario) for linkage, scenarios in KEPT.items() for scenario in scenarios]
SHORT = ("four_bar", "cycloid"), ("six_bar", "torque"), ("shaper", "torque"), ("parallelogram", "driven")


@pytest.mark.parametrize(("linkage", "scenario"), [pytest.param(*x, marks=() if x in SHORT else pytest.mark.long) for x in CASES])
@pytest.mark.usefixtures("full_search")
def test_accelerations_need_at_most_one_per_cent_or_two_operations_more(linkage: str, scenario: str) -> None:
    for formulation, kept in KEPT[linkage][scenario].items():
        operations = generate(load(linkage, scenario), formulation).acceleration.operations
        assert operations <= max(1.01 * kept, kept + 2), formulation
