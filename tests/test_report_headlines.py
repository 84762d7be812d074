"""Findings are computed a second time from raw rows; a figure with two different values fails."""

from itertools import product

import pytest

from gauss_bench.report.rows import Run
from tests.headlines import compared, with_raw_rows
from tests.published import REPORTS

COMPARED = {"steps", "one_value", "costs", "claim", "search"}


@pytest.mark.long
def test_every_published_headline_is_that_of_the_raw_rows() -> None:
    assert set(compared(with_raw_rows(REPORTS))) == COMPARED


WHERE = {"mechanism": "four_bar", "scenario": "torque"}
PLAIN = {"settings": "default", "integrator": "rk4", "stabilization": "none"}


def invented() -> dict[str, tuple[dict[str, object], ...]]:
    """Return a run in which a step takes 1 us in the kernel, at least 50 us in MuJoCo, and 40 and 20 us by Gauss and Lagrange."""
    times = {
        ("native_step", "gauss-native", "default"): 1e-6,
        ("native_step", "mujoco", "tuned"): 50e-6,
        ("native_step", "mujoco", "default"): 60e-6,
        ("step", "gauss", "default"): 40e-6,
        ("step", "lagrange", "default"): 20e-6,
    }
    samples = []
    for ((quantity, engine, settings), x), k in product(times.items(), range(3)):
        case = WHERE | PLAIN | {"quantity": quantity, "engine": engine, "settings": settings}
        samples.append(case | {"step": 1e-4, "process": 0, "round": k, "seconds": x})
    fine = WHERE | {"status": "ok", "message": ""}
    step = fine | {"formulation": "gauss", "stabilization": "none", "rival": "mujoco", "seconds": 1e-6}
    steps = [step | {"settings": s, "rival_seconds": x, "ratio": x / 1e-6} for s, x in (("tuned", 50e-6), ("default", 60e-6))]
    results = []
    for engine, seconds, x in (("gauss", 40e-6, 1.0), ("lagrange", 20e-6, 0.5)):
        ratio = {"step_ratio": x, "step_ratio_low": x, "step_ratio_high": x, "native_step_time": float("nan")}
        results.append(fine | PLAIN | ratio | {"engine": engine, "step_time": seconds, "control": False, "valid": False})
    races = [
        fine | {"process": k, "what": "step", "seconds": 1e-6, "rival_seconds": x * 1e-6, "ratio": x}
        for k, x in enumerate((1.29, 1.3, 1.31))
    ]
    claim = fine | {"unknowns_gauss": 1.0, "processes": 3.0, "verdict": "holds", "ratio": 1.3, "ratio_low": 1.2, "ratio_high": 1.41}
    tables = {"samples": samples, "kernel_steps": steps, "results": results, "claim_races": races, "kernel_claim": [claim]}
    return {name: tuple(rows) for name, rows in tables.items()}


def changed(table: str, **columns: object) -> Run:
    """Return the invented run with other values in the first row of a table."""
    tables = invented()
    first, *rest = tables[table]
    return Run({"baseline_engine": "gauss"}, tables | {table: (first | columns, *rest)})


def test_a_run_whose_figures_have_one_value_passes() -> None:
    assert compared(changed("results")) == ["steps", "one_value", "costs", "claim"]


@pytest.mark.parametrize(
    ("table", "columns"),
    [
        ("kernel_steps", {"ratio": 49.0}),
        ("kernel_steps", {"rival_seconds": 50.1e-6}),
        ("kernel_steps", {"seconds": 1.01e-6}),
        ("results", {"step_time": 41e-6}),
        ("kernel_claim", {"ratio": 1.35}),
        ("kernel_claim", {"verdict": "open"}),
        ("claim_races", {"rival_seconds": 0.9e-6}),
    ],
)
def test_a_figure_with_two_values_fails(table: str, columns: dict[str, object]) -> None:
    with pytest.raises(AssertionError):
        compared(changed(table, **columns))
