"""Formulations against motions in closed form: a singular chain of any size, and a nonholonomic body."""

import numpy as np
import pytest

from gauss_bench.mechanism.load import load
from gauss_bench.reference.exact import n_four_bar, sleigh
from gauss_bench.simulation import simulate


def test_the_closed_form_of_the_chain_solves_its_equation() -> None:
    t = np.linspace(0.0, 10.0, 4001)
    phi, w = n_four_bar(2, t)
    k = (1.5 + 2) * 9.81 / (1.0 + 2)
    energy = w**2 / 2 + k * np.cos(phi)
    assert np.ptp(energy) < 1e-12 * energy[0]
    h = t[1] - t[0]
    assert np.abs(np.gradient(phi, h, edge_order=2)[1:-1] - w[1:-1]).max() < 1e-3  # differences at 2.5 ms
    assert phi[0] == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize(("count", "engine"), [(1, "gauss"), (2, "lagrange"), (7, "gauss")])
def test_the_chain_follows_its_closed_form_up_to_the_first_singular_position(count: int, engine: str) -> None:
    at = [0.2, 0.4, 0.6]  # the bars lie on the ground line after 0.7 s
    found = simulate(f"n_four_bar_{count}", engine, step=1e-3, at=at)
    phi, w = n_four_bar(count, np.array(at))
    assert np.abs(np.pi / 2 - np.array(found["links"]["v0"]["theta"]) - phi).max() < 1e-9
    assert np.abs(-np.array(found["links"][f"v{count}"]["omega"]) - w).max() < 1e-8


def test_the_chain_passes_singular_positions_under_projection() -> None:
    at = [2.0, 5.0]
    found = simulate("n_four_bar_2", "gauss", stabilization="projection", step=1e-3, at=at)
    phi, _ = n_four_bar(2, np.array(at))
    assert np.abs(np.pi / 2 - np.array(found["links"]["v0"]["theta"]) - phi).max() < 1e-5  # the crossings cost the digits


def test_a_chain_of_forty_windows_loads_and_counts_its_loops() -> None:
    mechanism = load("n_four_bar_40")
    assert (mechanism.dof, mechanism.redundant, len(mechanism.joints) - len(mechanism.links)) == (1, 0, 40)


@pytest.mark.parametrize("engine", ["gauss", "lagrange", "udwadia_kalaba"])
def test_the_sleigh_follows_its_closed_form_for_ten_seconds(engine: str) -> None:
    at = [1.0, 5.0, 10.0]
    found = simulate("sleigh", engine, step=1e-3, at=at)
    body = load("sleigh").links[0]
    theta, place, speed = sleigh(np.array(at), body.mass, body.inertia, 0.2, 0.3, 2.0)
    edge = found["points"]["body.edge"]
    assert np.abs(np.array(found["links"]["body"]["theta"]) - theta).max() < 1e-9
    assert np.abs(np.column_stack([edge["x"], edge["y"]]) - place).max() < 1e-9
    assert np.abs(np.hypot(edge["vx"], edge["vy"]) - speed).max() < 1e-9
    assert found["metrics"]["velocity_drift"] < 1e-10


def test_five_bar_and_sleigh_are_the_same_in_gauss_and_lagrange() -> None:
    for linkage in ("five_bar", "sleigh"):
        one, other = (simulate(linkage, engine, at=[0.5, 1.0]) for engine in ("gauss", "lagrange"))
        for link, state in one["links"].items():
            for key, values in state.items():
                scale = 1.0 + np.abs(values).max()
                assert np.abs(np.array(values) - other["links"][link][key]).max() < 1e-10 * scale
