"""Write a program for OpenSim: the calls that build the model, and an integration by OpenSim's manager."""

from collections.abc import Mapping
from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.engines.opensim.translate import Built, make_manager
from gauss_bench.engines.programs import write_tree_program
from gauss_bench.engines.shared import joint_tree
from gauss_bench.engines.transcript import Script, python
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
    "Manager": "manager",
}
RUN = """    for coordinate, value, rate in zip(coordinates, Y0, DY0):
        coordinate.setValue(state, value, False)  # without False OpenSim would close the loops
        coordinate.setSpeedValue(state, rate)
    manager.initialize(state)
    for k in range(every, steps + 1, every):
        state = manager.integrate(k * step)
        model.realizeVelocity(state)
        y, dy = [x.getValue(state) for x in coordinates], [x.getSpeedValue(state) for x in coordinates]
        places = [body.getPositionInGround(state).to_numpy() for body in bodies]
        speeds = [body.getVelocityInGround(state).get(1).to_numpy() for body in bodies]
        rows.append([k * step, *absolute(y, dy, places, speeds)])
"""


def write(mechanism: Mechanism, choice: Choice, options: Mapping[str, Any]) -> str:
    """Return the text of a program that runs a mechanism: the recorded calls of Built and `make_manager`, and an integration."""
    script, tree = Script(STATEMENTS), joint_tree(mechanism, options)
    opensim = script.stand_in("opensim")
    built = Built(opensim, mechanism, tree)
    script.lines.insert(0, "opensim.Logger.setLevelString('Off')")
    script.lines.append(f"coordinates = {python(built.coordinates)}")
    script.lines.append(f"bodies = {python([built.bodies[i] for i in range(len(mechanism.links))])}")
    make_manager(opensim, built.model, choice, options, script.stand_in("step"))  # `step`: the program's variable
    return write_tree_program(mechanism, tree, choice, imports=["import opensim"], numbers={}, model=script.lines, run=RUN)
