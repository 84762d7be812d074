"""The playback of runs: poses of planted runs as they are stored, and as a browser draws them."""

import numpy as np
import pytest

from gauss_bench.bench.cases import Case
from gauss_bench.bench.poses import choose_played, keep, poses, true_poses
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.report.build import build_report, read_run
from gauss_bench.report.drawings.drawing import canvas_of
from gauss_bench.report.rows import Run
from gauss_bench.report.site.playback import find_turn, in_pixels, play_pair
from gauss_bench.tables import KEY, write_schema, write_table
from gauss_bench.trajectory import Reference, Trajectory

LATE, OPEN = 0.01, 2e-3  # [rad], [m]
CASE = {"mechanism": "four_bar", "scenario": "torque", "settings": "default", "stabilization": "none", "step": 1e-3, "t_end": 0.5}
TURN = find_turn(Run(), "four_bar")
assert TURN is not None
MECHANISM, STATES = TURN.mechanism, TURN.states
HALF = len(STATES) // 2  # states of half a turn
LINK = 1  # the coupler, which is pulled off in the run that opens


def motion(crank):
    """Return states (k, n) with the crank at angles (k,), closed by Newton steps from interpolated states of a turn."""
    own = STATES[:, 3 * MECHANISM.crank + 2]
    guess = np.stack([np.interp(crank, own, x) for x in STATES.T], axis=-1)
    evaluator = Evaluator(MECHANISM)
    for _ in range(5):
        for q, angle in zip(guess, crank, strict=True):
            q[:] = evaluator.project(0.0, q, np.zeros(MECHANISM.n))[0]
            rows = evaluator.constraints(0.0, q, np.zeros(MECHANISM.n)).J
            held = np.vstack([rows, np.eye(MECHANISM.n)[3 * MECHANISM.crank + 2]])
            q += np.linalg.solve(held, [*np.zeros(len(rows)), angle - q[3 * MECHANISM.crank + 2]])
    return guess


ANGLES = STATES[0, 3 * MECHANISM.crank + 2] + np.linspace(0.3, 3.0, HALF)
TIMES = np.linspace(0.0, 0.5, HALF)
TRUE, AHEAD = motion(ANGLES), motion(ANGLES + LATE)


def truth():
    none = np.zeros(HALF)
    return Reference(TIMES, TRUE, 0 * TRUE, 0 * TRUE, none, none, none, none, none, none, "planted")


def run_of(q):
    return Trajectory(TIMES, q, 0 * q, 0 * q, HALF)


def opened():
    q = TRUE.copy()
    q[:, 3 * LINK] += OPEN
    return q


def part(rows, ends):
    return np.array([[r[f"{axis}{ends}"] for axis in ("x", "y", "angle")] for r in rows]).reshape(-1, len(MECHANISM.links), 3)


def test_a_late_run_is_ahead_without_gaps_and_an_open_one_has_the_planted_opening_as_its_gap():
    rows = poses(MECHANISM, run_of(AHEAD), truth())
    assert part(rows, "_ahead")[:, MECHANISM.crank, 2] == pytest.approx(LATE, abs=1e-12)
    assert np.abs(part(rows, "_gap")).max() < 1e-14
    rows = poses(MECHANISM, run_of(opened()), truth())
    exact, ahead, gap = part(true_poses(MECHANISM, truth()), ""), part(rows, "_ahead"), part(rows, "_gap")
    shown = (exact + ahead + gap).reshape(len(exact), -1)
    assert np.abs(np.exp(1j * shown) - np.exp(1j * opened()[:: HALF // 50])).max() < 1e-12
    evaluator = Evaluator(MECHANISM)
    for q, pulled, whole in zip((exact + ahead).reshape(shown.shape), gap.reshape(shown.shape), shown, strict=True):
        rows_there = evaluator.constraints(0.0, q, 0 * q)
        assert np.abs(rows_there.phi).max() < 1e-12
        residual = evaluator.constraints(0.0, whole, 0 * q).phi
        assert np.abs(residual).max() == pytest.approx(OPEN, rel=1e-9), "a pin of the coupler is not apart by what was planted"
        assert rows_there.J @ pulled == pytest.approx(residual, abs=OPEN**2 * 50)
    lost = opened()
    lost[10:] = np.nan
    assert len(poses(MECHANISM, run_of(lost), truth())) == 10 * len(MECHANISM.links)  # it ends early


def test_the_default_and_the_most_exact_valid_run_of_each_engine_are_stored():
    """The step is the nearest to a millisecond, and negative controls are not stored."""
    steps = (1e-2, 1e-3, 1e-4)
    cases = [Case("four_bar", "torque", "gauss", "default", i, "none", h, 0.5) for h in steps for i in ("rk4", "dop853", "euler")]
    cases += [Case("four_bar", "torque", "yuan_ge_eq16", "default", "rk4", "none", h, 0.5) for h in steps]
    chosen = choose_played(cases)
    assert {(x.engine, x.step) for x in chosen} == {("gauss", 1e-3)}
    errors = {"rk4": 1e-3, "dop853": 1e-9, "euler": 1e-12}
    gauss = CASE | {"engine": "gauss"}
    rows = [gauss | {"integrator": i, "position_error": x, "status": "ok"} for i, x in errors.items()]
    rows[-1]["status"] = "invalid"
    found = [{k: r[k] for k in KEY} | {"t": t, "link": "crank"} for r in rows for t in (0.0, 0.1)]
    assert sorted({r["integrator"] for r in keep(rows, found)}) == ["dop853", "rk4"]
    assert len(keep(rows, found)) == 4
    assert keep(rows, []) == []


@pytest.fixture(scope="module")
def planted(tmp_path_factory):
    """Return the folder of a run with a late engine and with one whose loops open."""
    folder = tmp_path_factory.mktemp("planted")
    runs = {"gauss-native": AHEAD, "mujoco": opened()}
    cases = {x: CASE | {"engine": x, "integrator": "rk4"} for x in runs}
    write_table("results", [case | {"status": "ok", "valid": True, "control": False} for case in cases.values()], folder)
    place = {k: CASE[k] for k in ("mechanism", "scenario", "t_end")}
    write_table("motions", [place | x for x in true_poses(MECHANISM, truth())], folder)
    write_table("poses", [cases[x] | row for x, q in runs.items() for row in poses(MECHANISM, run_of(q), truth())], folder)
    write_schema(folder)
    return folder


def expected(frame_at, factor, engine):
    """Return the places of the links of a planted run as drawn, (links, 3) [px, px, degrees]."""
    at = frame_at * (HALF // 50)
    canvas = canvas_of(MECHANISM, STATES)
    if engine == "gauss-native":
        return np.asarray(in_pixels(canvas, motion(ANGLES[at : at + 1] + factor * LATE))[0])
    q = TRUE[at : at + 1] + factor * (opened() - TRUE)[at : at + 1]
    return np.asarray(in_pixels(canvas, q)[0])


def test_a_page_plays_what_was_planted(planted):
    """Data have the digits of stored differences; the pulled link is off by the planted opening, others are in their places."""
    found = play_pair(read_run(planted), "four_bar", "torque")
    data = found[1]
    late, apart = sorted(data["runs"], key=lambda x: x["name"])
    assert late["ahead"] == pytest.approx([LATE] * len(late["ahead"]), rel=2e-4)
    assert not {"gap", "rest"} & set(late), "nothing of it is open, and it is in no other assembly"
    assert max(late["open"]) < 1e-9 < 1e-3 < min(late["off"])
    assert min(apart["off"]) == pytest.approx(1e3 * OPEN, rel=1e-3)
    assert 0 < max(apart["open"]) <= 1e3 * OPEN
    assert play_pair(Run(), "four_bar", "torque") is None


@pytest.mark.slow
def test_a_browser_draws_the_planted_runs_with_what_was_planted(planted, browser):
    build_report(planted)
    page = browser.new_page()
    page.goto((planted / "site" / "linkage-four_bar.html").as_uri())
    at = """([side, i]) => document.querySelector(`#pair [data-side=${side}] [data-link="${i}"]:not([data-x])`)
        .getAttribute("transform").match(/-?[\\d.]+/g).map(Number)"""

    def drawn(side):
        return np.array([page.evaluate(at, [side, i]) for i in range(len(MECHANISM.links))])

    def off(a, b):
        turns = (a - b)[:, 2] % 360
        return float(max(np.abs(a - b)[:, :2].max(), np.minimum(turns, 360 - turns).max()))

    last = len(ANGLES[:: HALF // 50]) - 1
    scale = canvas_of(MECHANISM, STATES).scale
    for place in (last, 7):
        page.evaluate(
            "x => { const s = document.querySelector('#pair input'); s.value = x; s.dispatchEvent(new Event('input')); }", place
        )
        for factor in ("1", "10"):
            page.select_option("#pair [data-factor]", factor)
            assert off(drawn("a"), expected(place, float(factor), "gauss-native")) < 0.3
            open_ = drawn("b")
            assert off(open_, expected(place, 0.0, "mujoco")) > 0.5 * float(factor) * OPEN * scale
        page.select_option("#pair [data-factor]", "1")
        assert off(drawn("b"), expected(place, 1.0, "mujoco")) < 0.1, "at 1 times a run's own pose is drawn"
    assert "loops are open by" in page.inner_text("#pair [data-side=b] p")
    page.close()
