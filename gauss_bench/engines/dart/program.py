"""Write a program for DART: the calls that build the world, and a loop in Python that takes the steps."""

from collections.abc import Mapping
from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.engines.dart.translate import World, forces_of
from gauss_bench.engines.programs import force_numbers, write_tree_program
from gauss_bench.engines.shared import joint_tree
from gauss_bench.engines.transcript import Script, python
from gauss_bench.mechanism.model import Mechanism

KINDS = ("Revolute", "Prismatic", "Planar")
STATEMENTS = {
    "World": "world_",
    "Skeleton": "skeleton",
    "getDeactivationOptions": "asleep",
    **{f"create{kind}JointAndBodyNodePair": "pair_" for kind in KINDS},
    "Isometry3": "frame_",
    "getSecondaryBoxedLcpSolver": "solver",
    "BallJointConstraint": "closure_",
}
START = """place, speed = np.empty((2, len(Y0)))
place[order], speed[order] = Y0, DY0
skeleton.setPositions(place)
skeleton.setVelocities(speed)
# a closure connects the points that coincide when it is made"""
RUN = """    world.setTimeStep(step)
    for k in range(1, steps + 1):
        y, dy, command = skeleton.getPositions()[order], skeleton.getVelocities()[order], np.empty(len(Y0))
        command[order] = CONSTANT - STIFFNESS @ y - DAMPING @ dy
        for joint, law in LAWS:
            command[order[joint]] = law(k * step)[1]  # a driven joint is given its speed at the end of the step
        skeleton.setCommands(command)
        world.step(False)
        if k % every == 0:
            y, dy = skeleton.getPositions()[order], skeleton.getVelocities()[order]
            places = [body.getTransform().translation() for body in bodies]
            speeds = [body.getCOMLinearVelocity() for body in bodies]
            rows.append([k * step, *absolute(y, dy, places, speeds)])
"""


def write(mechanism: Mechanism, choice: Choice, options: Mapping[str, Any]) -> str:
    """Return the text of a program that runs a mechanism: the recorded calls of World, and a loop that takes the steps.

    Raises:
        RunFailure: a force acts at points or varies (see `force_numbers`).
    """
    tree = joint_tree(mechanism, options)
    forces = forces_of(mechanism, tree, options["joint_forces"])
    numbers = force_numbers(forces, mechanism, tree)
    script = Script(STATEMENTS)
    built = World(script.stand_in("dartpy"), mechanism, forces, options)
    script.lines.append(f"order = {python(built.order)}  # index of each joint's coordinate in DART's order")
    script.lines.append(f"world, bodies = {python(built.world)}, {python(built.bodies)}")
    script.lines.append(START)
    built.close()
    built.set_options(options["erp"])
    return write_tree_program(mechanism, tree, choice, imports=["import dartpy"], numbers=numbers, model=script.lines, run=RUN)
