"""MuJoCo 4.0.0: accelerations are wrong where its matrices are sparse and two loops share a body. Needs mujoco and numpy alone.

A beam lies on three equal cranks, which turn at 2 rad/s under gravity; a pendulum hangs on the middle crank. The script prints the
angular acceleration of the cranks with dense and with sparse matrices, for two orders of the same bodies in the file.

python mujoco_sparse_factor.py
"""

import mujoco
import numpy as np

HARD = 'solref="4e-3 1" solimp="0.9999 0.9999"'
ANGLE, SPEED = 1.2, 2.0  # [rad], [rad/s] of the cranks
# angle and speed of each joint, against the bar that carries it; the pendulum is at rest at -1 rad
STATE = {
    "left": (ANGLE, SPEED),
    "beam": (-ANGLE, -SPEED),
    "middle": (ANGLE, SPEED),
    "pendulum": (-1.0 - ANGLE, -SPEED),
    "right": (ANGLE, SPEED),
}


def write_bar(name: str, place: float, half: float, inner: str = "") -> str:
    """Return a bar of 1 kg as MJCF, hinged at its end, with its centre at `half` [m] and what hangs on it."""
    inertia = f'<inertial pos="{half} 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>'
    return f'<body name="{name}" pos="{place} 0 0"><joint name="{name}" axis="0 0 1"/>{inertia}{inner}</body>'


def write_model(matrices: str, order: tuple[str, ...]) -> str:
    """Return the model with its cranks in an order; the cranks lie at 0, 1 and 2 m and are 1 m long."""
    cranks = {
        "left": write_bar("left", 0.0, 0.5, write_bar("beam", 1.0, 1.0)),
        "middle": write_bar("middle", 1.0, 0.5, write_bar("pendulum", 1.0, 0.5)),
        "right": write_bar("right", 2.0, 0.5),
    }
    return f"""<mujoco>
      <option gravity="0 -9.81 0" solver="Newton" tolerance="1e-10" iterations="100" jacobian="{matrices}"/>
      <worldbody>{"".join(cranks[x] for x in order)}</worldbody>
      <equality>
        <connect body1="middle" body2="beam" anchor="1 0 0" {HARD}/>
        <connect body1="beam" body2="right" anchor="2 0 0" {HARD}/>
      </equality></mujoco>"""


def main() -> None:
    print("MuJoCo", mujoco.__version__)
    for order in (("left", "middle", "right"), ("middle", "left", "right")):
        for matrices in ("dense", "sparse"):
            model = mujoco.MjModel.from_xml_string(write_model(matrices, order))
            data = mujoco.MjData(model)
            for name, (angle, speed) in STATE.items():
                joint = model.joint(name)
                data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = angle, speed
            mujoco.mj_forward(model, data)
            told = data.qacc[[model.joint(x).dofadr[0] for x in ("left", "middle", "right")]]
            iterations = int(np.ravel(data.solver_niter)[0])
            print(f"{' '.join(order):18} {matrices:7} cranks {told.round(3)} rad/s^2 after {iterations} iterations")


if __name__ == "__main__":
    main()
