"""A program for DART: the calls by which the builder makes the world, and a step from Python for each step of a run."""

from collections.abc import Mapping
from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.engines.dart.translate import Builder, forces_of, select_pgs
from gauss_bench.engines.programs import Parts, write_tree_program
from gauss_bench.engines.shared import drivers_by_coordinate, joint_tree
from gauss_bench.engines.transcript import Script, name_laws, python
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import RunFailure, Status

KINDS = ("Revolute", "Prismatic", "Planar")
OF_WORLDS = ("setGravity", "setDeactivationOptions", "disableSelfCollisionCheck", "addSkeleton", "setOption", "setBoxedLcpSolver")
OF_JOINTS = ("setXYPlane", "setAxis", "setTransformFromParentBodyNode", "setTransformFromChildBodyNode", "setActuatorType")
OF_SPRINGS = ("setDampingCoefficient", "setSpringStiffness", "setRestPosition")
OF_BODIES = ("setName", "set_translation", "set_rotation", "setInertia")
STATEMENTS = {
    "World": "world_",
    "Skeleton": "skeleton",
    "getDeactivationOptions": "asleep",
    **{f"create{kind}JointAndBodyNodePair": "pair_" for kind in KINDS},
    "Isometry3": "frame_",
    "getSecondaryBoxedLcpSolver": "solver",
    **dict.fromkeys([*OF_WORLDS, *OF_JOINTS, *OF_SPRINGS, *OF_BODIES], ""),
}
RUN = """    place, speed = np.empty((2, len(Y0)))
    place[order], speed[order] = Y0, DY0
    skeleton.setPositions(place)
    skeleton.setVelocities(speed)
    pins = dartpy.constraint.BallJointConstraint
    pins.setErrorReductionParameter(ERP)
    pins.setConstraintForceMixing(CFM)
    pins.setMaxErrorReductionVelocity(FASTEST)
    pins.setErrorAllowance(0.0)
    for ends, body, point in closures:  # a closure takes its place from the pose in which it is made
        at = np.array(point) if body is None else body.getTransform().multiply(np.array(point))
        world.getConstraintSolver().addConstraint(pins(*ends, at))
    world.setTimeStep(step)
    for k in range(1, steps + 1):
        y, dy, command = skeleton.getPositions()[order], skeleton.getVelocities()[order], np.empty(len(Y0))
        command[order] = FORCES - STIFFNESS @ y - DAMPING @ dy
        for joint, law in LAWS:
            command[order[joint]] = law(k * step)[1]  # of a driven joint its speed at the end of the step
        skeleton.setCommands(command)
        world.step(False)
        if k % every == 0:
            y, dy = skeleton.getPositions()[order], skeleton.getVelocities()[order]
            places = [body.getTransform().translation() for body in bodies]
            speeds = [body.getCOMLinearVelocity() for body in bodies]
            rows.append([k * step, *absolute(y, dy, places, speeds)])
"""


def write(mechanism: Mechanism, choice: Choice, options: Mapping[str, Any]) -> str:
    """Return the program.

    Raises:
        RunFailure: it would need the suite's own forces at every step.
    """
    tree = joint_tree(mechanism, options)
    forces = forces_of(mechanism, tree, options["joint_forces"])
    if forces.others is not None:
        raise RunFailure(
            Status.SKIP, "the program holds forces of DART's joints alone, and none at or between points, nor any that varies"
        )
    script, laws = Script(STATEMENTS), name_laws(mechanism)
    dartpy = script.stand_in("dartpy")
    built = Builder(dartpy, mechanism, tree, forces).build()
    if options["lcp"] == "PGS":
        select_pgs(dartpy, built, options["pgs_iterations"])
    closures = [[[body for body, _ in pin if body is not None], *pin[0]] for pin in built.pins]
    script.lines.append(f"order = {python(built.order)}  # of the joints' coordinates in DART's")
    script.lines.append(f"world, bodies, closures = {python(built.world)}, {python(built.bodies)}, {python(closures)}")
    numbers = {
        "FORCES": forces.constant,
        "STIFFNESS": forces.stiffness,
        "DAMPING": forces.damping,
        "LAWS": [[at, laws[id(driver.law)]] for at, driver in drivers_by_coordinate(mechanism, tree).items()],
        "ERP": options["erp"],
        "CFM": options["cfm"],
        "FASTEST": options["max_error_reduction_velocity"],
    }
    return write_tree_program(mechanism, tree, choice, Parts(["import dartpy"], numbers, script.lines, RUN))
