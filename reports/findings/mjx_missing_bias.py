"""MJX leaves out the velocity term of a `connect` constraint, which MuJoCo has. Needs mujoco and mujoco-mjx alone.

A rod of 1 m turns about one of its ends at 2 rad/s without gravity; a `connect` holds that end, and three joints leave the rod
free. Its middle must be accelerated towards the end by 0.5 m * (2 rad/s)^2 = 2 m/s^2.
"""

from importlib.metadata import version

import jax
import mujoco
import numpy as np
from mujoco import mjx

ROD = """
<mujoco>
  <option gravity="0 0 0" timestep="1e-4"/>
  <worldbody>
    <site name="pivot"/>
    <body pos="0.5 0 0">
      <joint type="slide" axis="1 0 0"/>
      <joint type="slide" axis="0 1 0"/>
      <joint type="hinge" axis="0 0 1"/>
      <site name="end" pos="-0.5 0 0"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
    </body>
  </worldbody>
  <equality><connect site1="pivot" site2="end" solref="2e-4 1" solimp="0.9999 0.9999"/></equality>
</mujoco>
"""

jax.config.update("jax_enable_x64", True)
model = mujoco.MjModel.from_xml_string(ROD)
data = mujoco.MjData(model)
data.qvel[:] = [0.0, 1.0, 2.0]  # of the middle [m/s], and the turn [rad/s]: the held end is at rest
mujoco.mj_forward(model, data)
other = jax.jit(mjx.forward)(mjx.put_model(model), mjx.put_data(model, data))
print("expected acceleration [m/s^2, rad/s^2]", [-2.0, 0.0, 0.0])
print("mujoco", version("mujoco"), "  ", np.round(data.qacc, 6).tolist(), "aref", np.round(data.efc_aref[:2], 6).tolist())
print("mujoco-mjx", version("mujoco-mjx"), np.round(other.qacc, 6).tolist(), "aref", np.round(other._impl.efc_aref[:2], 6).tolist())
