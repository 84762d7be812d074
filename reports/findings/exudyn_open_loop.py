"""Exudyn: explicit solvers return True although they dropped every joint of a linkage. Needs exudyn and numpy alone.

A bar hangs on two equal, parallel cranks, which swing from rest at START. The script prints for each solver what SolveDynamic
returned, the largest gap of a pin, and the error of the crank's angle after 1 s against the pendulum's equation, to which this
linkage reduces.

python exudyn_open_loop.py
"""

import warnings

import exudyn
import numpy as np
from exudyn.itemInterface import (
    LoadMassProportional,
    MarkerBodyMass,
    MarkerBodyPosition,
    NodeRigidBody2D,
    ObjectGround,
    ObjectJointRevolute2D,
    ObjectRigidBody2D,
)

LENGTH, MASS, BAR, GRAVITY, STEPS = 0.3, 0.2, 1.0, 9.81, 1000  # [m] of a crank, [kg] of a crank and of the bar, [m/s^2], in 1 s
START = -0.3  # [rad] of the cranks
PLACES = np.array([-0.4, 0.4])  # [m] of the cranks along the ground and the bar


def swing() -> float:
    """Return the angle [rad] of the cranks after 1 s by the classical Runge-Kutta method with 4000 steps."""
    inertia = 2 * MASS * LENGTH**2 / 3 + BAR * LENGTH**2  # of both cranks about their pins, and of the bar, which does not turn
    torque = (2 * MASS / 2 + BAR) * GRAVITY * LENGTH

    def rate(x: np.ndarray) -> np.ndarray:
        return np.array([x[1], -torque / inertia * np.cos(x[0])])

    x, h = np.array([START, 0.0]), 1 / 4000
    for _ in range(4000):
        a = rate(x)
        b = rate(x + h / 2 * a)
        c = rate(x + h / 2 * b)
        d = rate(x + h * c)
        x = x + h / 6 * (a + 2 * b + 2 * c + d)
    return float(x[0])


def solve(solver: str, eliminate: bool) -> str:
    """Run the linkage for 1 s, and return the outcome in words."""
    container = exudyn.SystemContainer()
    system = container.AddSystem()

    def add_link(mass: float, inertia: float, x: float, y: float, angle: float) -> int:
        node = system.AddNode(NodeRigidBody2D(referenceCoordinates=[x, y, angle]))
        link = system.AddObject(ObjectRigidBody2D(nodeNumber=node, mass=mass, inertia=inertia))
        weight = system.AddMarker(MarkerBodyMass(bodyNumber=link))
        system.AddLoad(LoadMassProportional(markerNumber=weight, loadVector=[0.0, -GRAVITY, 0.0]))
        return link

    def add_pin(*sides: tuple[int, list[float]]) -> None:
        markers = [system.AddMarker(MarkerBodyPosition(bodyNumber=link, localPosition=[*at, 0.0])) for link, at in sides]
        system.AddObject(ObjectJointRevolute2D(markerNumbers=markers))

    ground = system.AddObject(ObjectGround())
    across, up = LENGTH * np.cos(START), LENGTH * np.sin(START)
    cranks = [add_link(MASS, MASS * LENGTH**2 / 12, x + across / 2, up / 2, START) for x in PLACES]
    bar = add_link(BAR, 0.1, across, up, 0.0)
    for crank, x in zip(cranks, PLACES, strict=True):
        add_pin((ground, [x, 0.0]), (crank, [-LENGTH / 2, 0.0]))
        add_pin((crank, [LENGTH / 2, 0.0]), (bar, [x, 0.0]))
    system.Assemble()
    exudyn.config.printToConsole = False
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = STEPS, 1.0
    settings.timeIntegration.explicit.eliminateConstraints = eliminate
    settings.solution.file.write = False
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            returned = str(system.SolveDynamic(settings, solverType=getattr(exudyn.DynamicSolverType, solver)))
        except Exception as error:
            return f"raises {type(error).__name__}"
    data = system.systemData
    q = np.array(data.GetODE2Coordinates()) + data.GetODE2Coordinates(exudyn.ConfigurationType.Reference)
    gap = max(largest_gap(q, k) for k in range(2))
    return f"returns {returned}, {len(seen)} warnings, pins open by {gap:.1e} m, crank off by {abs(q[2] - swing()):.1e} rad"


def largest_gap(q: np.ndarray, k: int) -> float:
    """Return the larger gap [m] of the two pins of crank k; q has x, y and angle of two cranks and the bar."""
    (x, y, angle), (bx, by, turn) = q[3 * k : 3 * k + 3], q[6:9]
    half = LENGTH / 2 * np.array([np.cos(angle), np.sin(angle)])
    foot = np.array([x, y]) - half - [PLACES[k], 0.0]
    head = np.array([x, y]) + half - [bx, by] - PLACES[k] * np.array([np.cos(turn), np.sin(turn)])
    return float(max(np.hypot(*foot), np.hypot(*head)))


def main() -> None:
    print("Exudyn", exudyn.config.Version(), f"{STEPS} steps; the crank ends at {swing():.3f} rad")
    for solver in ("GeneralizedAlpha", "RK44", "DOPRI5", "ExplicitMidpoint"):
        for eliminate in (True, False):
            print(f"{solver:18}eliminateConstraints={eliminate!s:6}", solve(solver, eliminate))


if __name__ == "__main__":
    main()
