"""OpenSim: a parallelogram with a third, redundant crank loses its motion. This script needs opensim and numpy alone.

Three equal cranks carry a coupler under gravity, without friction: energy is constant. Two PointConstraints close the loops; in the
plane they are four rows of rank three. Printed are the energy before and after for several constraint tolerances, and the
acceleration of a crank when the third one is turned out of its place a little.
"""

import numpy as np
import opensim

CRANK, MASS = 0.16, 0.128  # [m], [kg] of the cranks, which are thin rods
PIVOTS = {"second": (0.4, 0.0, 0.0), "third": (0.2, 0.15, 0.0)}  # [m] from the first crank's
ANGLE, SPEED = 0.5, 10.0  # [rad], [rad/s] of the cranks at the start
STEP, DURATION = 1e-3, 3.0  # [s]


class Linkage:
    """The linkage in OpenSim, with the coordinates of the cranks and of the coupler, which hangs on the first crank."""

    def __init__(self):
        self.model, self.parts, self.coordinates = opensim.Model(), [], {}
        self.model.setGravity(opensim.Vec3(0.0, -9.81, 0.0))
        ground, first, coupler = self.model.getGround(), self.rod("first"), self.body("coupler", 1.0, 0.01)
        middle = (0.0, 0.0, 0.0)
        self.pin("first", ground, middle, first, (-CRANK / 2, 0.0, 0.0))
        self.pin("coupler", first, (CRANK / 2, 0.0, 0.0), coupler, middle)
        for name, pivot in PIVOTS.items():
            crank = self.rod(name)
            self.pin(name, ground, pivot, crank, (-CRANK / 2, 0.0, 0.0))
            end = opensim.Vec3(CRANK / 2, 0.0, 0.0)
            self.parts.append(opensim.PointConstraint(coupler, opensim.Vec3(*pivot), crank, end))
            self.model.addConstraint(self.parts[-1])
        self.model.finalizeConnections()
        self.start = self.model.initSystem()

    def body(self, name, mass, inertia):
        self.parts.append(opensim.Body(name, mass, opensim.Vec3(0.0), opensim.Inertia(inertia, inertia, inertia)))
        self.model.addBody(self.parts[-1])
        return self.parts[-1]

    def rod(self, name):
        return self.body(name, MASS, MASS * CRANK**2 / 12)

    def pin(self, name, parent, near, child, far):
        turned = opensim.Vec3(0.0)
        joint = opensim.PinJoint(name, parent, opensim.Vec3(*near), turned, child, opensim.Vec3(*far), turned)
        coordinate = joint.updCoordinate()
        coordinate.setName(name)
        coordinate.set_clamped(False)
        self.model.addJoint(joint)
        self.parts.append(joint)
        self.coordinates[name] = coordinate

    def state(self, turned=0.0):
        """Return the state at the start, with the third crank turned by an angle [rad] out of its place."""
        state = opensim.State(self.start)
        for name, coordinate in self.coordinates.items():
            sign = -1.0 if name == "coupler" else 1.0  # the coupler keeps its direction
            coordinate.setValue(state, sign * ANGLE + (turned if name == "third" else 0.0), False)
            coordinate.setSpeedValue(state, sign * SPEED)
        return state

    def acceleration(self, turned):
        """Return the acceleration of the first crank [rad/s^2] with the third one turned."""
        state = self.state(turned)
        self.model.realizeAcceleration(state)
        return self.coordinates["first"].getAccelerationValue(state)

    def motion(self, tolerance, seconds):
        """Return the speed of the first crank [rad/s] and the energy [J] after every step (steps, 2); None: as shipped."""
        manager, rows = opensim.Manager(self.model), []
        manager.setWriteToStorage(False)
        manager.setPerformAnalyses(False)
        manager.setIntegratorFixedStepSize(STEP)
        if tolerance is not None:
            manager.setIntegratorConstraintTolerance(tolerance)
        manager.initialize(self.state())
        for k in range(1, round(seconds / STEP) + 1):
            state = manager.integrate(k * STEP)
            self.model.realizeVelocity(state)
            energy = self.model.calcKineticEnergy(state) + self.model.calcPotentialEnergy(state)
            rows.append((self.coordinates["first"].getSpeedValue(state), energy))
        return np.array(rows)


if __name__ == "__main__":
    opensim.Logger.setLevelString("Off")
    linkage = Linkage()
    print("OpenSim", opensim.GetVersion())
    for tolerance in (None, 1.0, 1e-5, 1e-6, 1e-7, 1e-8, 1e-12):
        speeds, energies = linkage.motion(tolerance, DURATION).T
        losses = -np.diff(energies)
        worst = int(np.argmax(losses))
        name = "as shipped" if tolerance is None else f"{tolerance:.0e}"
        print(f"tolerance {name}: energy {energies[0]:.6f} J becomes {energies[-1]:.6f} J; most is lost in the step", end=" ")
        before, after = speeds[worst : worst + 2]
        print(f"from {(worst + 1) * STEP:.3f} s, {losses[worst]:.1e} J: {before:.4g} rad/s becomes {after:.4g} rad/s")
    for turned in (0.0, 1e-8, 1e-7, 1e-6, 1e-5, 2e-5, 3e-5, 1e-4):
        print(f"turned by {turned:.0e} rad, pin open by {CRANK * turned:.1e} m: {linkage.acceleration(turned):.6f} rad/s^2")
