"""MJX: the model that it is given, its refusals, and, where its environment is installed, its errors against certificates.

Without MJX, MuJoCo itself stands in for it behind the same four calls: then the adapter must give MuJoCo's own motion.
"""

import copy
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
import gauss_bench.bench.conformance as rules
from gauss_bench.bench.conformance import conformance
from gauss_bench.engines.base import Choice
from gauss_bench.engines.mjx import adapter
from gauss_bench.engines.mjx.adapter import Mjx
from gauss_bench.engines.mjx.xla import Evaluated, Libraries
from gauss_bench.engines.mujoco.adapter import Mujoco, MujocoModel
from gauss_bench.linkage.load import load
from gauss_bench.trajectory import RunFailure
from tests.conftest import needs
from tests.engine_runs import linkage, moved

ENGINE = "mjx"


class OnMujoco:
    """The calls of `Device`, carried out by MuJoCo; models and states are MuJoCo's."""

    def __init__(self, libraries, model, torque):
        self.mujoco, self.torque = libraries.mujoco, torque
        self.set(model)

    def set(self, model):
        self.model = model

    def with_step(self, size):
        model = copy.copy(self.model)
        model.opt.timestep = size
        return model

    def start(self, y, dy, t):
        data = self.mujoco.MjData(self.model)
        data.qpos[:], data.qvel[:], data.time, data.qfrc_applied[:] = y, dy, t, self.torque
        return data

    def take_steps(self, model, state, count):
        state = copy.copy(state)
        for _ in range(count):
            self.mujoco.mj_step(model, state)
        return state

    def tree_state(self, state):
        return state.qpos, state.qvel

    def evaluate(self, y, dy):
        data, mass = self.start(y, dy, 0.0), np.zeros((len(y), len(y)))
        self.mujoco.mj_forward(self.model, data)
        self.mujoco.mj_fullM(self.model, data, mass)
        forces = data.qfrc_applied + data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
        gaps = np.array(data.efc_pos).reshape(-1, 3)
        return Evaluated(np.array(data.qacc), mass, forces, np.array(data.xipos), gaps)


@pytest.fixture
def stand_in(monkeypatch):
    """MuJoCo stands in for MJX."""
    mujoco = needs("mujoco")
    monkeypatch.setattr(adapter, "load_libraries", lambda: Libraries(None, mujoco, None))
    monkeypatch.setattr(adapter, "Device", OnMujoco)


@pytest.mark.usefixtures("stand_in")
@pytest.mark.parametrize(("name", "scenario"), [("loaded", None), ("crank_slider", "paper"), ("four_bar", "driven")])
@pytest.mark.parametrize("native", [True, False])
def test_where_mujoco_computes_the_motion_is_mujocos_own(name, scenario, native):
    mechanism, times = linkage(name, scenario), np.array([0.0, 0.01, 0.0137, 0.03])
    choice = Choice("tuned", "rk4", "none", 1e-3)
    given, own = (moved(model, times, native) for model in (Mjx().build(mechanism, choice), MujocoModel(mechanism, choice)))
    assert given.steps == own.steps == 10 + 4 + 17
    for a, b in ((given.q, own.q), (given.v, own.v), (given.a, own.a)):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-8 * np.abs(b).max())  # a driven hinge holds a speed in both, to 1e-9


@pytest.mark.usefixtures("stand_in")
def test_a_model_takes_another_step_and_its_softness_with_it():
    mechanism, times = load("crank_slider", "paper"), np.array([0.0, 0.02])
    resized = Mjx().build(mechanism, Choice("tuned", "rk4", "none", 1e-3))
    moved(resized, times)
    resized.choice = Choice("tuned", "rk4", "none", 2e-3)
    fresh = Mjx().build(mechanism, resized.choice)
    assert (moved(resized, times).q == moved(fresh, times).q).all()
    assert (resized.device.model.eq_solref[:, 0] == 2 * 2e-3).all()


@pytest.mark.usefixtures("stand_in")
@pytest.mark.parametrize("field", ["dof_damping", "tendon_stiffness", "actuator_gear"])
def test_a_model_that_is_not_the_linkage_is_refused(field, monkeypatch):
    def spoil(device, model):
        getattr(model, field)[...] *= 1.01
        device.model = model

    monkeypatch.setattr(OnMujoco, "set", spoil)
    with pytest.raises(RunFailure, match="differs from the linkage"):
        Mjx().build(linkage("loaded"), Choice())


def test_settings_are_those_of_mujoco_under_their_names():
    for label in ("default", "tuned"):
        assert Mjx.file.options(label) == Mujoco.file.options(label)


@pytest.mark.slow
@pytest.mark.usefixtures("elsewhere")
def test_conformance_names_the_velocity_term_that_mjx_leaves_out(monkeypatch):
    monkeypatch.setattr(rules, "CHECKS", [x for x in rules.CHECKS if x.__name__ == "check_accelerations"])
    broken = {x.name: x.message for x in conformance("mjx") if x.passed is False}
    assert "the velocity term dJ/dt v of the constraints is missing" in broken["accelerations (default, rk4, none)"]


ONCE = """
import numpy as np
from gauss_bench.engines.mjx.xla import Device, load_libraries

libraries = load_libraries()
model = libraries.mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body><joint axis='0 0 1'/><inertial pos='1 0 0' mass='1' diaginertia='1 1 1'/></body></worldbody></mujoco>"
)
device = Device(libraries, model, np.zeros(1))
state = device.start(np.array([0.25]), np.array([2.0]), 0.0)
for size in (1e-3, 5e-4):
    for _ in range(2):
        state = device.take_steps(device.with_step(size), state, 100)
    model.body_mass[1] *= 2.0
    device.set(model)
print(device._take_steps._cache_size(), float(device.tree_state(state)[0][0]))
"""


TENDON = """
import numpy as np
from gauss_bench.engines.mjx.xla import Device, load_libraries

libraries = load_libraries()
model = libraries.mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><site name='a' pos='1 1 0'/><body><joint axis='0 0 1'/><site name='b' pos='1 0 0'/>"
    "<inertial pos='1 0 0' mass='1' diaginertia='1 1 1'/></body></worldbody>"
    "<tendon><spatial stiffness='10' springlength='0.5'><site site='a'/><site site='b'/></spatial></tendon></mujoco>"
)
device, data = Device(libraries, model, np.zeros(1)), libraries.mujoco.MjData(model)
state = device.take_steps(device.with_step(1e-3), device.start(np.zeros(1), np.zeros(1), 0.0), 100)
model.opt.timestep = 1e-3
for _ in range(100):
    libraries.mujoco.mj_step(model, data)
print(float(device.tree_state(state)[0][0]), data.qpos[0])
"""


def printed_there(python, script):
    """Words that a script prints in the environment of MJX."""
    root = str(Path(gauss_bench.__file__).parents[1])
    command, where = [python, "-c", script], os.environ | {"PYTHONPATH": root}
    return subprocess.run(command, env=where, capture_output=True, text=True, check=True).stdout.split()


@pytest.mark.slow
def test_a_spring_between_points_is_stepped_as_mujoco_steps_it(elsewhere):
    """Without the types of the state kept, JAX refuses the loop."""
    angle, of_mujoco = map(float, printed_there(elsewhere, TENDON))
    assert angle == pytest.approx(of_mujoco, abs=1e-12)
    assert angle > 0.01


@pytest.mark.slow
def test_steps_are_compiled_once_for_all_sizes_numbers_and_states(elsewhere):
    compiled, angle = printed_there(elsewhere, ONCE)
    assert int(compiled) == 1
    assert float(angle) == pytest.approx(0.25 + 2.0 * (2 * 0.1 + 2 * 0.05), abs=1e-12)  # it turns freely
