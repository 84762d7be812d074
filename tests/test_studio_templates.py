"""Every template of the studio assembles as its file says, moves through its driven scenario, and is what its title claims."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.kinematics.singular import Curve
from gauss_bench.linkage.load import built_in, load
from gauss_bench.mechanism.coordinates import position

FOLDER = Path(gauss_bench.__file__).parent / "studio" / "templates"
FILES = sorted(FOLDER.glob("*.toml"))


def moved(name, samples=73):
    mechanism = load(FOLDER / f"{name}.toml", "driven")
    return mechanism, loop_motion(mechanism, np.linspace(0.0, mechanism.duration, samples)).q


def path(mechanism, q, point):
    return position(q, mechanism.find_point(point))


@pytest.mark.parametrize("file", FILES, ids=lambda x: x.stem)
def test_a_template_assembles_as_it_expects_and_runs_its_driven_scenario(file):
    document = tomllib.loads(file.read_text(encoding="utf-8"))
    assert {"dof", "redundant", "loops"} <= document["expect"].keys()
    assert document["name"] == file.stem
    assert file.stem not in built_in()
    assert len(document["title"]) > 20
    assert any(word in file.read_text(encoding="utf-8") for word in ("Proportions", "proportions"))
    mechanism, q = moved(file.stem, 37)
    assert len(q) == 37
    joints = Curve(mechanism).constraints if mechanism.dof == 1 else None
    assert len(FILES) >= 15
    assert joints is None or np.abs(joints(np.zeros(37), q, np.zeros_like(q)).phi).max() < 1e-12


@pytest.mark.parametrize(
    ("name", "whole"),
    [
        ("crank_rocker", {"crank"}),
        ("double_crank", {"crank", "coupler", "rocker"}),
        ("double_rocker", {"coupler"}),
        ("triple_rocker", set()),
    ],
)
def test_grashof_kinds_by_the_links_that_make_whole_turns(name, whole):
    """After one passage of the closed curve of positions, a link has made a whole turn or none."""
    mechanism = load(FOLDER / f"{name}.toml")
    curve, q = Curve(mechanism), mechanism.q0
    x = curve.tangent(q)
    for count in range(4000):
        q = curve.step(q, x)
        x = curve.tangent(q, x)
        gap = q - mechanism.q0
        gap[2::3] = np.angle(np.exp(1j * gap[2::3]))
        if count > 3 and np.linalg.norm(gap) < 0.015:
            break
    turns = (q - mechanism.q0)[2::3] / (2 * np.pi)
    assert {link.name for link, turn in zip(mechanism.links, turns, strict=True) if abs(turn) > 0.5} == whole
    assert np.abs(turns - np.round(turns)).max() < 0.01


def on_isosceles(pin, pivot, side):
    """Return the end of a coupler twice as long as its part from pin to knee; pin, knee and pivot are an isosceles triangle."""
    reach = pivot - pin
    knee = pin + reach / 2 + 1j * reach / abs(reach) * np.sqrt(side**2 - abs(reach) ** 2 / 4)
    return np.asarray(2 * knee - pin)


def test_hoeckens_line_is_as_straight_as_its_template_claims():
    """Over half a turn, the point moves on a line that is 4.18 cranks long and straight to 0.096 % of its length."""
    mechanism, q = moved("hoecken", 361)
    line = path(mechanism, q, "coupler.M")[90:271]
    length = np.ptp(line[:, 0])
    assert f"{length / 0.1:.2f} cranks" == "4.18 cranks"
    assert f"{np.ptp(line[:, 1]) / length:.3%}" == "0.096%"
    text = (FOLDER / "hoecken.toml").read_text(encoding="utf-8")
    assert "4.18 cranks" in text
    assert "0.096 %" in text


def test_the_lambda_linkage_stays_within_two_thousandths_of_its_line():
    mechanism, q = moved("chebyshev_lambda", 181)
    line = path(mechanism, q, "coupler.M")[45:136]
    assert np.ptp(line[:, 1]) / np.ptp(line[:, 0]) < 0.004


def test_whitworths_ram_goes_forth_in_two_thirds_of_a_turn():
    """The ram reverses when the pin is level with the pivot of the lever, at crank angles of -30 and 210 degrees."""
    mechanism, q = moved("whitworth", 361)
    x, angle = path(mechanism, q, "ram.C")[:, 0], np.degrees(q[:, 2])
    ends = sorted([angle[x.argmax()], angle[x.argmin()]])
    assert ends == pytest.approx([210.0, 330.0], abs=0.01)


def peaucellier(of, q):
    """Return how far the point P is off its straight line, which is longer than 0.5 m."""
    line = of("side_pb.P")
    assert np.ptp(line[:, 1]) > 0.5
    return line[:, 0] - (0.5**2 - 0.2**2) / (2 * 0.2)


def scissor_lift(of, q):
    """Return how far the level platform is off the height by Pythagoras."""
    assert np.abs(q[:, -1]).max() < 1e-13
    return of("platform.T")[:, 1] - 2 * np.sqrt(0.25 - of("foot.F")[:, 0] ** 2)


CLOSED_FORMS = {  # points, states -> a difference that is zero
    "peaucellier": peaucellier,
    "pantograph": lambda of, q: of("short.Q") - 0.4 * of("forearm.P"),
    "scotch_yoke": lambda of, q: of("yoke.Y")[:, 0] - 0.1 * np.cos(q[:, 2]),
    "scissor_lift": scissor_lift,
    "hoecken": lambda of, q: of("coupler.M") @ (1, 1j) - on_isosceles(0.1 * np.exp(1j * q[:, 2]), 0.22, 0.28),
    "chebyshev_lambda": lambda of, q: of("coupler.M") @ (1, 1j) - on_isosceles(0.1 * np.exp(1j * q[:, 2]), 0.2, 0.25),
}


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_a_template_moves_as_its_closed_form(name):
    mechanism, q = moved(name)
    assert np.abs(CLOSED_FORMS[name](lambda point: path(mechanism, q, point), q)).max() < 1e-12


def test_klanns_foot_walks():
    """The foot is near the ground for half a turn, and then rises by more than a third of its stride."""
    mechanism, q = moved("klann", 121)
    foot = path(mechanism, q, "leg.G")
    height, stride = np.sort(foot[:, 1]), np.ptp(foot[:, 0])
    assert mechanism.dof == 1
    assert height[60] - height[0] < 0.08 * stride
    assert height[-1] - height[0] > 0.33 * stride
