"""Write a program for Bullet: the calls that build the tree of joints, and a loop in Python that takes the steps."""

from collections.abc import Mapping
from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.engines.bullet.translate import joint_forces
from gauss_bench.engines.bullet.world import TreeWorld
from gauss_bench.engines.programs import force_numbers, write_tree_program
from gauss_bench.engines.shared import joint_tree
from gauss_bench.engines.transcript import Script
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, Status

STATEMENTS = {"connect": "client", "createMultiBody": "body", "createConstraint": "closure_"}
RUN = """    joints = range(len(Y0))

    def state():
        states = pybullet.getJointStates(body, joints, physicsClientId=client)
        return np.array([x[0] for x in states]), np.array([x[1] for x in states])

    for k in range(1, steps + 1):
        y, dy = state()
        for joint, law in LAWS:  # at this rate the joint reaches the law's position at the end of the step
            rate = {"targetVelocity": (law(k * step)[0] - y[joint]) / step, "velocityGain": 1.0, "force": 1e9 / step}
            pybullet.setJointMotorControl2(body, joint, pybullet.VELOCITY_CONTROL, **rate, physicsClientId=client)
        forces = (CONSTANT - STIFFNESS @ y - DAMPING @ dy).tolist()  # Bullet forgets them after every step
        pybullet.setJointMotorControlArray(body, joints, pybullet.TORQUE_CONTROL, forces=forces, physicsClientId=client)
        pybullet.stepSimulation(physicsClientId=client)
        if k % every == 0:
            looks = {"computeLinkVelocity": 1, "computeForwardKinematics": 1, "physicsClientId": client}
            links = [pybullet.getLinkState(body, joint, **looks) for joint in CARRIERS]
            rows.append([k * step, *absolute(*state(), [x[0] for x in links], [x[6] for x in links])])
    pybullet.disconnect(client)
"""


def write(mechanism: Mechanism, choice: Choice, options: Mapping[str, Any]) -> str:
    """Return the text of a program that runs a mechanism: the recorded calls of TreeWorld, and a loop that takes the steps.

    Raises:
        RunFailure: the links are free bodies, or a force acts at points or varies (see `force_numbers`).
    """
    tree = joint_tree(mechanism, options)
    forces = joint_forces(mechanism, tree)
    if options["coordinates"] == "bodies":
        raise RunFailure(Status.SKIP, "a program needs a tree of joints, and with coordinates=bodies every link is a free body")
    numbers = force_numbers(forces, mechanism, tree)
    script = Script(STATEMENTS)
    world = TreeWorld(script.stand_in("pybullet"), mechanism, tree, options)
    world.damp(forces.joint_damping)
    world.put(*tree.relative(mechanism.q0, mechanism.v0))
    step: Any = script.stand_in("step")  # the program's variable for the length of a step
    world.set_step(step)
    # CARRIERS: for each link of the linkage, its index in Bullet
    numbers["CARRIERS"] = [world.carriers[i] for i in range(len(mechanism.links))]
    return write_tree_program(mechanism, tree, choice, imports=["import pybullet"], numbers=numbers, model=script.lines, run=RUN)
