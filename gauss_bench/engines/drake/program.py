"""Write a program for Drake: the calls that build the plant, and a simulation."""

from types import SimpleNamespace
from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.engines.drake.stepping import LONGEST_STEP
from gauss_bench.engines.drake.translate import MODULES, Built, Closure
from gauss_bench.engines.programs import write_tree_program
from gauss_bench.engines.transcript import Script, python
from gauss_bench.engines.tree import Tree
from gauss_bench.mechanism.model import Mechanism

STATEMENTS = {
    "MultibodyPlant": "plant",
    "AddRigidBody": "body_",
    "AddFrame": "frame_",
    "AddJoint": "joint_",
    "ExternallyAppliedSpatialForce": "force_",
    "DiagramBuilder": "builder",
    "AddSystem": "system_",
    "Build": "diagram",
}
RUN = """    context = plant.GetMyMutableContextFromRoot(root)
    place, speed, motors = np.empty((3, len(Y0)))
    place[order], speed[order], motors[order] = Y0, DY0, MOTORS
    plant.SetPositions(context, place)
    plant.SetVelocities(context, speed)
    plant.get_applied_generalized_force_input_port().FixValue(context, motors)
    simulator.Initialize()
    for k in range(every, steps + 1, every):
        simulator.AdvanceTo(k * step)
        y, dy = plant.GetPositions(context)[order], plant.GetVelocities(context)[order]
        places = [plant.EvalBodyPoseInWorld(context, body).translation() for body in bodies]
        speeds = [plant.EvalBodySpatialVelocityInWorld(context, body).translational() for body in bodies]
        rows.append([k * step, *absolute(y, dy, places, speeds)])
"""


def write(mechanism: Mechanism, tree: Tree, choice: Choice, closure: Closure, scheme: str, accuracy: float | None) -> str:
    """Return the text of a program that runs a mechanism: the recorded calls of Built, and a simulation.

    Args:
        scheme: Drake's name of an integrator of continuous plants; empty for a discrete plant.
        accuracy: accuracy of an integrator that chooses its steps; None for steps of fixed size.
    """
    script = Script(STATEMENTS)
    library = SimpleNamespace(**{name: script.stand_in(f"drake_{name}") for name in MODULES})
    step: Any = script.stand_in("step")
    built = Built(library, mechanism, tree, 0.0 if scheme else step, closure)
    script.lines.append(f"order = {python(built.order)}  # index of each joint's coordinate in Drake's order")
    script.lines.append(f"bodies = {python([built.bodies[i] for i in range(len(mechanism.links))])}")
    script.lines.append(f"simulator = drake_analysis.Simulator({python(built.system)})")
    script.lines.append("root = simulator.get_mutable_context()")
    built.set_forces_at_points(script.stand_in("root"))
    if scheme:
        longest = "step" if accuracy is None else LONGEST_STEP
        script.lines.append(f"integrator = drake_analysis.ResetIntegratorFromFlags(simulator, {scheme!r}, {longest})")
        script.lines.append(f"integrator.set_fixed_step_mode({accuracy is None})")
        if accuracy is not None:
            script.lines.append(f"integrator.set_target_accuracy({accuracy!r})")
    imports = [f"import {module} as drake_{name}" for name, module in MODULES.items()]
    return write_tree_program(
        mechanism, tree, choice, imports=imports, numbers={"MOTORS": built.motors}, model=script.lines, run=RUN
    )
