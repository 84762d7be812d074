"""Drake: a constraint with the world ends the process at the first step. This script needs pydrake alone.

python drake_world_constraint.py              all cases, each in a process of its own, and how it ended
python drake_world_constraint.py ball world   one case in this process
"""

import subprocess
import sys

CONSTRAINTS = ("none", "ball", "distance", "weld")
HOLDERS = ("world", "body welded to the world")


def step(constraint: str, holder: str) -> None:
    """Hang one free body from a point of the world, and take one step."""
    import numpy as np
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import SpatialInertia, UnitInertia
    from pydrake.systems.analysis import Simulator

    plant = MultibodyPlant(1e-3)
    inertia = SpatialInertia(1.0, np.zeros(3), UnitInertia.SolidSphere(0.1))
    body, ground = plant.AddRigidBody("body", inertia), plant.world_body()
    if holder != "world":
        ground = plant.AddRigidBody("ground", inertia)
        plant.WeldFrames(plant.world_frame(), ground.body_frame())
    x = np.array([0.1, 0.0, 0.0])
    if constraint == "ball":
        plant.AddBallConstraint(body, -x, ground, 0 * x)
    elif constraint == "distance":
        plant.AddDistanceConstraint(body, -x, ground, x, 0.2)
    elif constraint == "weld":
        plant.AddWeldConstraint(body, RigidTransform(-x), ground, RigidTransform())
    plant.Finalize()
    simulator = Simulator(plant)
    plant.SetFreeBodyPose(simulator.get_mutable_context(), body, RigidTransform(x))  # where every constraint holds
    simulator.AdvanceTo(1e-3)
    print("stepped")


def main() -> None:
    from importlib.metadata import version

    print("Drake", version("drake"))
    for constraint in CONSTRAINTS:
        for holder in HOLDERS:
            run = subprocess.run([sys.executable, __file__, constraint, holder], capture_output=True, text=True, check=False)
            last_line = (run.stdout + run.stderr).strip().splitlines()[-1:]
            ended = f"ended by signal {-run.returncode}" if run.returncode < 0 else f"exit code {run.returncode}"
            print(f"{constraint:9}{holder:26}{ended}", *last_line)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        step(sys.argv[1], sys.argv[2])
    else:
        main()
