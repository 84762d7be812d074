"""The first pipeline: loop coordinates, elimination, and Taylor series in 128 bit against closed forms and other coordinates."""

import copy
import tomllib
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.linkage.load import built_in, load, load_document
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.reference.build import build_reference
from gauss_bench.reference.exact import closed_form
from gauss_bench.reference.taylor.arithmetic import NUMBERS, stack_arrays
from gauss_bench.reference.taylor.equations import choose_chart, rates
from gauss_bench.reference.taylor.law_pieces import cut_pieces
from gauss_bench.reference.taylor.rows import loop_rows, start_state
from gauss_bench.reference.taylor.samples import LoopStates, sample
from gauss_bench.reference.taylor.series import taylor_motion
from gauss_bench.reference.taylor.vector_sums import LoopCoordinates, at_states
from tests.conftest import DATA, exhaustive, needs
from tests.test_reference_extended import decimals as document_of

LAST_DIGITS = 1e-28  # 33 digits, less four for a thousand steps and for the condition of a linkage
OTHER_COORDINATES = 1e-10  # double precision, DOP853 at 1e-13 and some growth


def every_linkage():
    """All scenarios of the built-in linkages and of those made for tests."""
    files = [*built_in().values(), *sorted(DATA.glob("*.toml"))]
    return [(str(path), name) for path in files for name in tomllib.loads(path.read_text(encoding="utf-8"))["scenarios"]]


def decimals(end, count):
    return [str(Decimal(end) * k / count) for k in range(count + 1)]


def motion(linkage, scenario, times, double=False):
    needs("heyoka")
    return taylor_motion(document_of(linkage, scenario), scenario, times, double)


def off(one, other):
    """Largest difference of numbers of any type, taken before they are rounded."""
    return float(np.abs(np.asarray(one - other)).astype(float).max(initial=0.0))


@pytest.mark.parametrize(
    ("linkage", "scenario"), exhaustive(every_linkage(), *every_linkage()[::4]), ids=lambda x: Path(str(x)).stem
)
def test_loop_coordinates_give_the_accelerations_of_absolute_ones(linkage, scenario):
    mechanism = load(linkage, scenario)
    if mechanism.has_friction:
        pytest.skip("friction is not for this pipeline")
    rows = loop_rows(LoopCoordinates(mechanism))
    document = document_of(linkage, scenario)
    x, v = start_state(rows, document["scenarios"][scenario], rows.coordinates.start(mechanism.q0), float)
    chart, _ = choose_chart(rows, at_states(x))
    laws = [driver.law(np.zeros(1)) for driver in mechanism.drivers]
    found = rates(rows, chart, at_states(x), list(v[:, list(chart.free)].T), laws)
    a = stack_arrays([found.acceleration.get(j, 0) for j in range(rows.coordinates.n)], np.zeros(1))
    redundant = rows.m - len(chart.order) + len(rows.coordinates.turn_gaps)
    here = sample(rows, LoopStates(np.zeros(1), x, v, a), ["0"], redundant, "", "", float)
    wanted = AbsoluteCoordinates(mechanism).acceleration(np.zeros(1), mechanism.q0[None], mechanism.v0[None])
    assert off(here.q, mechanism.q0) < 1e-14
    assert off(here.v, mechanism.v0) < 1e-13 * (1.0 + np.abs(mechanism.v0).max())
    assert off(here.a, wanted) < 1e-11 * (1.0 + np.abs(wanted).max())  # the pseudo-inverse loses some digits at light links


@pytest.mark.parametrize("law", ["sine", "cosine", "poly345", "table"])
def test_pieces_of_motion_laws_are_the_laws(law):
    rise = {"travel_deg": 40.0, "time": 0.33}
    knots = {"rows": [[0.05, 0.0], [0.2, 10.0], [0.37, 15.0], [0.45, 12.0]]}
    driver = {"link": "left", "law": law, "start_deg": 100.0, **(knots if law == "table" else rise)}
    start = {"angles_deg": {"right": 80.0}, "speeds": {"right": -1.0}}
    part = {"duration": 0.5, "drivers": [driver], "forces": ["spring"], "start": start}
    document = tomllib.loads(built_in()["five_bar"].read_text(encoding="utf-8")) | {"scenarios": {"part": part}}
    mechanism = load_document(document, "part")
    found = cut_pieces(mechanism.drivers, document["scenarios"]["part"], float)
    assert len(found) == (5 if law == "table" else 2)
    for piece in found:
        end = 0.6 if piece.end is None else piece.end
        t = np.linspace(piece.begin, end, 9)[1:-1]
        for value, wanted in zip(piece.laws(t, NUMBERS)[0], mechanism.drivers[0].law(t), strict=True):
            assert off(value + 0 * t, wanted) < 1e-13 * (1.0 + np.abs(wanted).max())


@pytest.mark.slow("n_four_bar_3-fall-0.6")
@pytest.mark.parametrize(
    ("linkage", "scenario", "end"),
    [("pendulum", "swing", "3"), ("projectile", "flight", "3"), ("sleigh", "glide", "3"), ("n_four_bar_3", "fall", "0.6")],
)
def test_motions_in_closed_form_are_met_to_28_digits(linkage, scenario, end):
    times, heyoka, mpmath = decimals(end, 6), needs("heyoka"), needs("mpmath")
    found, exact = motion(linkage, scenario, times), closed_form(load(linkage, scenario), times)
    assert found.stopped == ""
    for level in ("q", "v", "a"):
        values = getattr(exact, level)
        with mpmath.workdps(40):
            wanted = np.array([heyoka.real128(mpmath.nstr(x, 38)) for x in values.ravel()]).reshape(values.shape)
        assert off(getattr(found, level), wanted) < LAST_DIGITS * (1.0 + np.abs(wanted.astype(float)).max())


MOVING = [("shaper", "torque"), ("five_bar", "spring"), ("eight_bar", "conservative"), ("jansen", "walk"), ("squeezer", "squeeze")]
DRIVEN = [("five_bar", "driven"), ("excavator", "dig"), (str(DATA / "pushed.toml"), "push")]


@pytest.mark.parametrize(("linkage", "scenario"), exhaustive([*MOVING, ("eight_bar", "cycloid"), *DRIVEN], *DRIVEN[1:]))
def test_motions_agree_with_other_integrators_in_other_coordinates(linkage, scenario):
    mechanism = load(linkage, scenario)
    end = Decimal("0.01") if linkage == "squeezer" else Decimal("0.1")
    reference = build_reference(mechanism, float(end))
    found = motion(linkage, scenario, decimals(str(end), len(reference.t) - 1))
    assert np.allclose(reference.t, [float(t) for t in found.times], atol=1e-15)
    for level in ("q", "v", "a"):
        wanted = getattr(reference, level)
        assert off(getattr(found, level).astype(float), wanted) < OTHER_COORDINATES * (1.0 + np.abs(wanted).max())
    assert max(found.drift) < LAST_DIGITS


# a guide that moves, redundant rows, drivers of links and slides, and every kind of force and joint
@pytest.mark.parametrize(
    ("linkage", "scenario"), [MOVING[0], ("parallelogram", "torque"), *DRIVEN[1:], (str(DATA / "everything.toml"), "free")]
)
def test_multipliers_balance_the_equations_row_by_row(linkage, scenario):
    mechanism = load(linkage, scenario)
    found = motion(linkage, scenario, ["0", "0.003"], double=True)
    evaluator = Evaluator(mechanism)
    for k, t in enumerate(found.times):
        terms = evaluator.terms(float(t), found.q[k], found.v[k])
        if mechanism.redundant:
            assert found.multipliers is None
            continue
        left = terms.M @ found.a[k] + terms.J.T @ found.multipliers[k] - terms.Q
        scale = 1.0 + np.abs(terms.M @ found.a[k]).max() + np.abs(terms.J.T * found.multipliers[k]).max()
        assert np.abs(left).max() < 1e-12 * scale


@pytest.mark.long
def test_a_singular_position_is_never_passed():
    found = motion("n_four_bar_2", "fall", decimals("10", 100))
    assert "singular" in found.stopped
    assert float(found.times[-1]) < 0.75  # the bars lie on the ground line after 0.72 s
    driven = motion("n_four_bar_2", "driven", decimals("2", 100))
    assert "singular" in driven.stopped
    assert driven.times[-1] == "1.56"  # pi / 2 at 1 rad/s


def test_an_override_that_is_merged_is_not_merged_again():
    times = ["0", "0.1"]
    own = motion("crank_slider", "settles", times, double=True)
    document = copy.deepcopy(document_of("crank_slider", "settles"))
    document["forces"]["motor"]["value"] = -0.3
    assert off(taylor_motion(document, "settles", times, True).q, own.q) > 1e-3
