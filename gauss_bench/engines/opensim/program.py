"""Write a program for OpenSim: the calls that build the model, and an integration by OpenSim's manager."""

from collections.abc import Mapping
from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.engines.opensim.translate import Built
from gauss_bench.engines.programs import write_tree_program
from gauss_bench.engines.transcript import Script, python
from gauss_bench.engines.tree import Tree
from gauss_bench.mechanism.model import Mechanism

SPRINGS = ("SpringGeneralizedForce", "PointToPointSpring", "ExpressionBasedPointToPointForce")
STATEMENTS = {
    "Model": "model",
    "Body": "body_",
    **dict.fromkeys(["PinJoint", "SliderJoint", "PlanarJoint"], "joint_"),
    "updCoordinate": "coordinate_",
    **dict.fromkeys(["CoordinateActuator", *SPRINGS, "PrescribedForce"], "force_"),
    "PointConstraint": "closure_",
    "initSystem": "state",
}
RUN = """    for coordinate, value, rate in zip(coordinates, Y0, DY0):
        coordinate.setValue(state, value, False)  # without False OpenSim would close the loops
        coordinate.setSpeedValue(state, rate)
    manager = opensim.Manager(model)
    manager.setWriteToStorage(False)
    manager.setPerformAnalyses(False)
    manager.setIntegratorMethod(opensim.Manager.$METHOD)
    manager.setIntegratorAccuracy(ACCURACY)
$FURTHER    manager.initialize(state)
    for k in range(every, steps + 1, every):
        state = manager.integrate(k * step)
        model.realizeVelocity(state)
        y, dy = [x.getValue(state) for x in coordinates], [x.getSpeedValue(state) for x in coordinates]
        places = [body.getPositionInGround(state).to_numpy() for body in bodies]
        speeds = [body.getVelocityInGround(state).get(1).to_numpy() for body in bodies]
        rows.append([k * step, *absolute(y, dy, places, speeds)])
"""


def write(mechanism: Mechanism, tree: Tree, choice: Choice, options: Mapping[str, Any], method: str, accuracy: float | None) -> str:
    """Return the text of a program that runs a mechanism: the recorded calls of Built, and an integration.

    Args:
        method: name of Simbody's integrator, a member of `opensim.Manager`.
        accuracy: accuracy of an integrator that chooses its steps. With steps of fixed size `accuracy` is None, and the option
            "accuracy" only decides when the integrator projects states onto the constraints.
    """
    script = Script(STATEMENTS)
    built = Built(script.stand_in("opensim"), mechanism, tree)
    script.lines.insert(0, "opensim.Logger.setLevelString('Off')")
    script.lines.append(f"coordinates = {python(built.coordinates)}")
    script.lines.append(f"bodies = {python([built.bodies[i] for i in range(len(mechanism.links))])}")
    further = [] if accuracy else ["manager.setIntegratorFixedStepSize(step)"]
    if tolerance := options["constraint_tolerance"]:
        further.append(f"manager.setIntegratorConstraintTolerance({tolerance!r})")
    run = RUN.replace("$METHOD", method).replace("$FURTHER", "".join(f"    {line}\n" for line in further))
    numbers = {"ACCURACY": accuracy or options["accuracy"]}
    return write_tree_program(mechanism, tree, choice, imports=["import opensim"], numbers=numbers, model=script.lines, run=run)
