"""MuJoCo leaves out the velocity term of curved `joint` and `tendon` equalities, which `connect` has. Needs mujoco and numpy alone.

A body of 1 kg moves without gravity on a circle about the origin, or on a parabola. Its acceleration follows from its velocity
alone, and its kinetic energy must stay. The script prints both, for three kinds of equality constraints.

python mujoco_curved_equalities.py
"""

import mujoco
import numpy as np

HARD = 'solref="2e-3 1" solimp="0.9999 0.9999"'
PLANE = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>'
BODY = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
CIRCLE_BY_CONNECT = f"""
  <worldbody><site name="centre"/>
    <body pos="1 0 0">{PLANE}<joint type="hinge"/>{BODY}<site name="end" pos="-1 0 0"/></body>
  </worldbody>
  <equality><connect site1="centre" site2="end" {HARD}/></equality>"""
CIRCLE_BY_TENDON = f"""
  <worldbody><site name="centre"/>
    <body pos="1 0 0">{PLANE}{BODY}<site name="end"/></body>
  </worldbody>
  <tendon><spatial name="rod"><site site="centre"/><site site="end"/></spatial></tendon>
  <equality><tendon tendon1="rod" {HARD}/></equality>"""
PARABOLA_BY_JOINT = f"""
  <worldbody><body>
    <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>{BODY}
  </body></worldbody>
  <equality><joint joint1="y" joint2="x" polycoef="0 0 1 0 0" {HARD}/></equality>"""
CASES = [  # q, v and the expected acceleration: v^2 / r towards the centre; on y = x^2 at its lowest point, y'' = 2 x'^2
    ("connect, circle", CIRCLE_BY_CONNECT, [0.0, 0.0, 0.0], [0.0, 2.0, 2.0], [-4.0, 0.0]),
    ("tendon, circle", CIRCLE_BY_TENDON, [0.0, 0.0], [0.0, 2.0], [-4.0, 0.0]),
    ("joint, parabola", PARABOLA_BY_JOINT, [0.0, 0.0], [2.0, 0.0], [0.0, 8.0]),
]


def kinetic_energy(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the kinetic energy [J]."""
    momentum = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, momentum, data.qvel)
    return float(data.qvel @ momentum / 2)


def main() -> None:
    print("MuJoCo", mujoco.__version__, "RK4, steps of 1 ms")
    for name, text, q, v, expected in CASES:
        head = '<mujoco><option gravity="0 0 0" timestep="1e-3" integrator="RK4"/>'
        model = mujoco.MjModel.from_xml_string(f"{head}{text}</mujoco>")
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(model, data)
        acceleration, before = (data.qacc[:2] + 0.0).round(3).tolist(), kinetic_energy(model, data)
        for _ in range(1000):
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        gap = np.abs(data.efc_pos).max()
        change = kinetic_energy(model, data) / before - 1
        told = f"expected {expected}, told {acceleration} m/s^2; after 1 s open by {gap:.0e} m, energy {100 * change:+.2g} %"
        print(f"{name:16}", told)


if __name__ == "__main__":
    main()
