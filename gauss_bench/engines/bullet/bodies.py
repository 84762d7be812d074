"""A linkage as free rigid bodies of Bullet, in absolute coordinates: every pin is a point-to-point constraint."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gauss_bench.engines.bullet.world import NO_SHAPE, World
from gauss_bench.engines.following import wind
from gauss_bench.engines.shared import spatial
from gauss_bench.mechanism.model import GROUND, Mechanism
from gauss_bench.mechanism.spaces import angles, places
from gauss_bench.terms import Array


class BodyWorld(World):
    """A world of Bullet in which the links of a linkage are free bodies."""

    def __init__(self, pybullet: Any, mechanism: Mechanism, options: Mapping[str, Any], closed: bool = True):
        """Add the links and the ground as rigid bodies; if `closed`, add a point-to-point constraint for every pin."""
        super().__init__(pybullet, mechanism, options)
        self.bodies = [self._add_body(link.mass, link.inertia) for link in mechanism.links]
        ground = self._add_body(0.0, 0.0)
        self._advance()  # Bullet sets the inertias of rigid bodies at the end of the first step, and ignores torques in this step
        self.angles = angles(mechanism.q0).copy()  # angles when they were last set or read: `state` counts turns from them
        for pin in mechanism.pins if closed else ():
            # Bullet's numbers of a body and of its link; -1 is the body itself
            a, b = ((ground if point.link == GROUND else self.bodies[point.link], -1) for point in (pin.a, pin.b))
            self._close(a, b, spatial(pin.a.local), spatial(pin.b.local))

    def _add_body(self, mass: float, inertia: float) -> Any:
        """Add a rigid body without a shape, fixed if its mass is 0, and return Bullet's number of the body."""
        pybullet = self.pybullet
        body = self._call(pybullet.createMultiBody, baseMass=mass, baseCollisionShapeIndex=NO_SHAPE, useMaximalCoordinates=1)
        if mass:
            self._call(pybullet.changeDynamics, body, -1, mass=mass, localInertiaDiagonal=[inertia] * 3)
            self._set_damping_and_limits(body)
        return body

    def put(self, q: Array, v: Array) -> None:
        """Set the absolute state q, v (3 links,)."""
        self.angles = angles(q).copy()
        for body, place, angle, speed, omega in zip(self.bodies, places(q), angles(q), places(v), angles(v), strict=True):
            quaternion = (0.0, 0.0, float(np.sin(angle / 2)), float(np.cos(angle / 2)))
            self._call(self.pybullet.resetBasePositionAndOrientation, body, spatial(place), quaternion)
            self._call(self.pybullet.resetBaseVelocity, body, spatial(speed), (0.0, 0.0, float(omega)))

    def state(self) -> tuple[Array, Array]:
        """Return the absolute state q, v (3 links,); between two calls, no link may turn by half a turn."""
        q, v = np.empty(3 * len(self.bodies)), np.empty(3 * len(self.bodies))
        for k, body in enumerate(self.bodies):
            place, turn = self._call(self.pybullet.getBasePositionAndOrientation, body)
            speed, spin = self._call(self.pybullet.getBaseVelocity, body)
            places(q)[k], places(v)[k] = place[:2], speed[:2]
            angles(q)[k], angles(v)[k] = 2 * np.arctan2(turn[2], turn[3]), spin[2]
        angles(q)[:] = wind(angles(q), self.angles)
        self.angles = angles(q).copy()
        return q, v

    def drive(self, joint: int, rate: float) -> None:
        """Raise TypeError, because only trees of joints have motors; `refusal` in `translate.py` refuses driven free bodies."""
        raise TypeError("free bodies have no motors")

    def step(self, forces: Sequence[float]) -> None:
        """Take a step with forces and torques (3 links,) at the centres of mass, in the world's axes."""
        for k, body in enumerate(self.bodies):
            x, y, torque = forces[3 * k : 3 * k + 3]
            if x or y:
                place, _ = self._call(self.pybullet.getBasePositionAndOrientation, body)
                self._call(self.pybullet.applyExternalForce, body, -1, (x, y, 0.0), place, self.pybullet.WORLD_FRAME)
            if torque:
                self._call(self.pybullet.applyExternalTorque, body, -1, (0.0, 0.0, torque), self.pybullet.WORLD_FRAME)
        self._advance()
