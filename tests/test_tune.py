"""A user's own MJCF file: judged as it stands, and given back with settings that hold an accuracy."""

import difflib
import json
import subprocess
import sys

import pytest

from gauss_bench.api.diagnose import diagnose
from gauss_bench.api.own_model import read_own_file
from gauss_bench.api.tune import tune
from gauss_bench.cli import main
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.exchange.edit_mjcf import write_settings
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.own_model import ENGINE, setting_text
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.runs.worker import Worker
from tests.conftest import DATA, needs

FOUR_BAR = DATA / "four_bar_default.xml"
# A program without the suite and without constraints: the four-bar in the one coordinate of its crank, by scipy. Beside that it
# steps a model file in plain MuJoCo, and prints the largest distance [m] of the coupler's pins from where they should be.
PROGRAM = """
import sys
import mujoco
import numpy as np
from scipy.integrate import solve_ivp

A, R, S, D = 0.1, 0.3 + 0.2j, 0.25j, 0.4 - 0.05j  # crank, pin in the coupler's and in the rocker's frame, ground pivot
LINKS = ((1.0, 0.001, 0.05), (1.5, 0.02, 0.15 + 0.1j), (0.8, 0.006, 0.125j))  # mass, inertia, centre
TORQUE, DAMPING, GRAVITY = 0.5, 0.01, 9.81

def turns(theta):  # unit vectors of crank, coupler, rocker: the pin lies where two circles cut
    b = A * np.exp(1j * theta)
    far = abs(D - b)
    along = (abs(R) ** 2 - abs(S) ** 2 + far**2) / (2 * far)
    pin = b + (D - b) / far * (along + 1j * np.sqrt(abs(R) ** 2 - along**2))
    return np.exp(1j * theta), (pin - b) / R, (pin - D) / S

def rates(theta):  # angular velocities over that of the crank: A + R w1 and S w2 move the pin alike
    e0, e1, e2 = turns(theta)
    sides = np.array([[(R * e1).real, -(S * e2).real], [(R * e1).imag, -(S * e2).imag]])
    return 1.0, *np.linalg.solve(sides, [-(A * e0).real, -(A * e0).imag])

def mass(theta):
    (e0, e1, e2), (w0, w1, w2) = turns(theta), rates(theta)
    speeds = (LINKS[0][2] * e0, A * e0 + LINKS[1][2] * e1 * w1, LINKS[2][2] * e2 * w2)
    return sum(m * abs(v) ** 2 + i * w * w for (m, i, _), v, w in zip(LINKS, speeds, (w0, w1, w2)))

def height(theta):
    e0, e1, e2 = turns(theta)
    places = (LINKS[0][2] * e0, A * e0 + LINKS[1][2] * e1, LINKS[2][2] * e2)
    return GRAVITY * sum(m * x.imag for (m, _, _), x in zip(LINKS, places))

def slope(f, x, h=1e-4):  # of order four
    return (8 * (f(x + h) - f(x - h)) - (f(x + 2 * h) - f(x - 2 * h))) / (12 * h)

def motion(t, y):
    theta, omega = y
    return omega, (TORQUE - DAMPING * omega - slope(mass, theta) * omega**2 / 2 - slope(height, theta)) / mass(theta)

model = mujoco.MjModel.from_xml_path(sys.argv[1])
until, data = float(sys.argv[2]), mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, 0)
data.ctrl[:] = TORQUE
steps = round(until / model.opt.timestep)
true = solve_ivp(motion, (0.0, until), (0.0, 0.0), "DOP853", rtol=1e-11, atol=1e-12, dense_output=True)
worst = 0.0
for k in range(steps):
    mujoco.mj_step(model, data)
    theta = true.sol((k + 1) * model.opt.timestep)[0]
    ends = A * np.exp(1j * theta), A * np.exp(1j * theta) + R * turns(theta)[1]
    coupler, pin = data.body("coupler"), data.body("coupler").xpos + data.body("coupler").xmat.reshape(3, 3) @ (0.3, 0.0, 0.2)
    worst = max(worst, *(abs(complex(x[0], x[2]) - y) for x, y in zip((coupler.xpos, pin), ends)))
print(worst)
"""


def lines_changed(before, after):
    """Return the lines that are in the second text alone."""
    return [x[1:] for x in difflib.ndiff(before.splitlines(), after.splitlines()) if x.startswith("+ ")]


def largest_error(model, until):
    """Return the error [m] that the program above finds, in a process of its own."""
    run = [sys.executable, "-I", "-c", PROGRAM, str(model), str(until)]
    return float(subprocess.run(run, capture_output=True, text=True, check=True).stdout)


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """The four-bar with settings that hold a tenth of a millimetre over half a second, and its file."""
    needs("mujoco")
    out = tmp_path_factory.mktemp("tuned") / "tuned.xml"
    return tune(str(FOUR_BAR), out, position=1e-4, until=0.5), out


def test_a_tuned_file_holds_its_tolerance_in_plain_mujoco_and_differs_in_the_attributes_named_alone(
    tuned,
):
    found, out = tuned
    assert found.succeeded
    assert found.errors["position"] <= 0.5e-4 < found.before["position"]
    assert largest_error(out, 0.5) < 1e-4 < largest_error(FOUR_BAR, 0.5)
    option, closure = lines_changed(FOUR_BAR.read_text(), out.read_text())
    assert {*found.changed} == {"integrator", "solref", "solimp", "tolerance"}
    assert option == '   <option timestep="0.001" gravity="0 0 -9.81" integrator="RK4" tolerance="1e-15"/>'
    assert closure.startswith('     <connect name="top" body1="coupler" body2="rocker" anchor="0.3 0 0.2" solref="0.002 1.0"')


def test_what_cannot_be_reached_is_exit_code_one_and_nothing_is_written(tmp_path, capsys):
    needs("mujoco")
    out = tmp_path / "tuned.xml"
    assert main(["tune", str(FOUR_BAR), "--position", "1e-13", "--until", "0.05", "--out", str(out), "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["file"] == ""
    assert answer["errors"]["position"] > 1e-13
    assert not list(tmp_path.iterdir())


def test_a_shorter_timestep_is_taken_only_where_it_is_allowed(tmp_path):
    needs("mujoco")
    out = tmp_path / "tuned.xml"
    wanted = {"position": 2e-9, "until": 0.05}
    assert not tune(str(FOUR_BAR), out, **wanted).succeeded
    tuned = tune(str(FOUR_BAR), out, **wanted, allow_step=True)
    assert tuned.succeeded
    assert tuned.step < 1e-3
    assert f'timestep="{tuned.step!r}"' in out.read_text()


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('contype="0" conaffinity="0"', "", "<geom> number 3 of coupler touches <geom> number 4 of rocker"),
        (
            '<joint name="rocker_pin"/>',
            '<joint name="rocker_pin" limited="true" range="-0.001 0.001"/>',
            '<joint name="rocker_pin">',
        ),
        ('damping="0.01"', 'frictionloss="0.01"', '<joint name="crank_pin">'),
        ('<joint name="rocker_pin"/>', '<joint name="rocker_pin" axis="1 0 0"/>', "joint rocker_pin"),
    ],
)
def test_what_no_planar_linkage_has_is_refused_by_element(tmp_path, old, new, named):
    needs("mujoco")
    model, out = tmp_path / "model.xml", tmp_path / "out.xml"
    model.write_text(FOUR_BAR.read_text().replace(old, new))
    with pytest.raises(ExchangeError, match=named):
        tune(str(model), out, position=1e-4, until=0.5)
    assert not out.exists()


@pytest.mark.long
def test_closures_of_an_included_file_take_a_default_and_the_result_stays_beside_what_it_includes(tmp_path):
    needs("mujoco")
    closures = FOUR_BAR.read_text().split("<equality>")[1].split("</equality>")[0]
    (tmp_path / "closures.xml").write_text(f"<mujoco><equality>{closures}</equality></mujoco>")
    model = tmp_path / "model.xml"
    model.write_text(FOUR_BAR.read_text().replace(f"<equality>{closures}</equality>", '<include file="closures.xml"/>'))
    tuned = tune(str(model), tmp_path / "tuned.xml", position=1e-4, until=0.1)
    assert tuned.succeeded
    assert '<equality solref="0.002 1.0"' in (tmp_path / "tuned.xml").read_text()
    (tmp_path / "elsewhere").mkdir()
    with pytest.raises(ExchangeError, match=r"closures\.xml"):
        tune(str(model), tmp_path / "elsewhere" / "tuned.xml", position=1e-4, until=0.1)
    assert not list((tmp_path / "elsewhere").iterdir())


def test_the_input_is_never_written_over(tmp_path, capsys):
    model = tmp_path / "model.xml"
    model.write_bytes(FOUR_BAR.read_bytes())
    assert main(["tune", str(model), "--position", "1e-4", "--out", str(model), "--replace"]) == 2
    assert "is the input" in capsys.readouterr().err
    assert model.read_bytes() == FOUR_BAR.read_bytes()


def test_an_edit_leaves_every_other_byte_and_reads_quotes_comments_and_entities():
    text = b"""<mujoco><!-- <option timestep='1'/> --><option  timestep = '0.002'
      integrator='Euler' /><equality><weld name="a > b &amp; c"/></equality></mujoco>"""
    edited = write_settings(text, "model.xml", {"integrator": "RK4"}, {"solref": "0.004 1.0"})
    assert edited == text.replace(b"'Euler'", b'"RK4"').replace(b'c"/>', b'c" solref="0.004 1.0"/>')
    with pytest.raises(ExchangeError, match="UTF-8"):
        write_settings(b"<mujoco>\xff</mujoco>", "model.xml", {}, {})


@pytest.mark.long
def test_a_diagnosis_of_a_model_names_its_own_softness_and_finds_none_once_it_is_tuned(tuned):
    soft = diagnose(str(FOUR_BAR), until=0.2)
    assert (soft.part, soft.step, soft.engine) == ("constraint softness", 0.001, "mujoco")
    assert any("solref 0.02 1" in x for x in soft.remarks)
    good = diagnose(str(tuned[1]), position=1e-4, until=0.2)
    assert good.numbers.error < 1e-6
    assert any("the run meets the required position error" in x for x in good.remarks)


@pytest.mark.long
def test_a_model_that_diverges_is_judged_to_the_end_and_leaves_nothing_in_the_users_folder(tmp_path, monkeypatch):
    needs("mujoco")
    monkeypatch.chdir(tmp_path)
    model = tmp_path / "model.xml"
    model.write_text(FOUR_BAR.read_text().replace('timestep="0.001"', 'timestep="0.02"').replace('ctrl="0.5"', 'ctrl="500"'))
    assert not tune(str(model), tmp_path / "tuned.xml", position=1e-4, until=0.1).succeeded
    assert [x.name for x in tmp_path.iterdir()] == ["model.xml"]


def test_a_model_file_takes_no_options_of_linkages_or_other_engines():
    needs("mujoco")
    for options, named in (
        ({"scenario": "torque"}, "--scenario"),
        ({"stabilization": "baumgarte"}, "--stabilization"),
        ({"integrator": "rk4"}, "--integrator"),
        ({"step": -1.0}, "step"),
    ):
        with pytest.raises(ChoiceError, match=named):
            diagnose(str(FOUR_BAR), **options)
    with pytest.raises(ChoiceError, match="--close"):
        diagnose("four_bar", "gauss", close=["a.b=c.d"])


def test_the_keyframe_called_start_is_judged_whatever_its_place(tmp_path):
    needs("mujoco")
    model, text = tmp_path / "model.xml", FOUR_BAR.read_text()
    home = '<key name="home" qpos="0 0 0" ctrl="0.5"/>'
    model.write_text(text.replace(home, home + '<key name="start" qpos="0 0 0" ctrl="-0.5"/>'))
    with Worker() as worker:
        file, first = (read_own_file(x, (), worker) for x in (model, FOUR_BAR))
    assert (file.key, first.key) == (1, 0)
    run = get(ENGINE).build(file.mechanism, Choice(setting_text(file.path, {}), "", "none", 1e-3))
    own = get("gauss").build(file.mechanism, Choice("default", "rk4"))
    state = 0.0, file.mechanism.q0, file.mechanism.v0
    # closures of the model are soft, so accelerations agree to a part in a hundred; with the other torque they are far off
    assert run.acceleration(*state) == pytest.approx(own.acceleration(*state), rel=0.05, abs=0.5)
