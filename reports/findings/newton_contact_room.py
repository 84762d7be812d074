"""Processor time of a step of Newton's solver Kamino with its own room for contacts, and with room for one. Needs newton alone.

A parallelogram of two cranks of 1 m and a coupler of 2 m falls over, without any shape: nothing can touch anything.
"""

import time
from importlib.metadata import version

import newton
import numpy as np
import warp

STEP, STEPS = 1e-3, 50
TURNED = warp.quat_from_axis_angle(warp.vec3(0.0, 0.0, 1.0), np.pi / 2)


def at(x: float, y: float = 0.0, turn: warp.quat | None = None) -> warp.transform:
    """Return the transform to a point [m], turned by a quaternion."""
    return warp.transform(warp.vec3(x, y, 0.0), turn or warp.quat_identity())


def build(room: int | None) -> newton.Model:
    """Return the model; `room` is the number of contacts that there is room for, None for what Newton makes itself."""
    builder = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=(5.0, -8.0, 0.0))
    inertia = warp.mat33(*np.eye(3).ravel())
    poses = [at(0.0, 0.5, TURNED), at(1.0, 1.0), at(2.0, 0.5, TURNED)]
    left, coupler, right = (builder.add_link(xform=x, mass=1.0, inertia=inertia, lock_inertia=True) for x in poses)
    pins = [(-1, left, 0.0, -0.5), (left, coupler, 0.5, -1.0), (coupler, right, 1.0, 0.5), (-1, right, 2.0, -0.5)]
    joints = [builder.add_joint_revolute(a, b, parent_xform=at(x), child_xform=at(y), axis=newton.Axis.Z) for a, b, x, y in pins]
    builder.add_articulation(joints[:3])
    model = builder.finalize(device="cpu")
    if room is not None:
        model.rigid_contact_max = room
    return model


def measure(room: int | None, solver: str) -> tuple[int, float, float, np.ndarray]:
    """Return the room for contacts, the time of a step called from Python and of a recorded one [s], and the poses at the end."""
    model = build(room)
    kamino = newton.solvers.SolverKamino(model, config=newton.solvers.SolverKamino.Config(dynamics_solver=solver))
    state, control = model.state(), model.control()
    kamino.step(state, state, control, None, STEP)  # compiles or loads the kernels
    started = time.process_time()
    for _ in range(STEPS):
        kamino.step(state, state, control, None, STEP)
    called = (time.process_time() - started) / STEPS
    with warp.ScopedCapture(device="cpu") as capture:
        kamino.step(state, state, control, None, STEP)
    started = time.process_time()
    for _ in range(STEPS):
        warp.capture_launch(capture.graph)
    recorded = (time.process_time() - started) / STEPS
    return model.rigid_contact_max, called, recorded, state.body_q.numpy().copy()


warp.config.quiet = True
print("newton", version("newton"), "warp", version("warp-lang"))
for solver in ("padmm", "dvi"):
    own, one = measure(None, solver), measure(1, solver)
    for room, called, recorded, _ in (own, one):
        print(f"{solver}, room for {room} contacts: a step takes {1e3 * called:.2f} ms, a recorded one {1e3 * recorded:.2f} ms")
    print(f"{solver}: the poses differ by {np.abs(own[3] - one[3]).max():.1e} (m, rad)")
