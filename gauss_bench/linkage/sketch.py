"""Guess a first position: place links one after the other from the points and angles that the file gives.

A link is placed by two known points, or by one known point and an angle, which the file gives or a slide determines.
The pins of a placed link are then known on the neighbouring links.
"""

from typing import Any

import numpy as np

from gauss_bench.linkage.bodies import expand_cylinders
from gauss_bench.linkage.errors import NotPlaced
from gauss_bench.mechanism.model import GROUND, Mechanism, Point
from gauss_bench.mechanism.numbers import turn_vector
from gauss_bench.terms import Array


def sketch(mechanism: Mechanism, document: dict[str, Any]) -> Array:
    """Return a first guess q (n,) of the position.

    Raises:
        NotPlaced: the file does not determine the places of some links; the error names them.
    """
    placing = _Placing(mechanism, document)
    waiting = list(range(len(mechanism.links)))
    while waiting:
        placed = [i for i in waiting if placing.place(i)]
        if not placed:
            raise NotPlaced(tuple(mechanism.links[i].name for i in waiting))
        waiting = [i for i in waiting if i not in placed]
    return np.concatenate([[*placing.centre[i], placing.theta[i]] for i in range(len(mechanism.links))])


class _Placing:
    """The links placed so far.

    Attributes:
        given: index of a body -> angle [rad] that the file gives.
        drawn: name of a point -> world position (2,) [m] that the file gives for it, its joint, or the ground point of its joint.
        theta, centre: index of a placed body -> angle [rad] and centre of mass (2,) [m].
        pin_ends: the two points (a, b) that each pin joins, and also (b, a).
    """

    def __init__(self, mechanism: Mechanism, document: dict[str, Any]):
        """Read the table `assembly` of the file; at first only the ground has a known position."""
        self.mechanism = mechanism
        assembly = document.get("assembly", {})
        angles = {name: float(np.radians(x)) for name, x in assembly.get("angles_deg", {}).items()}
        angles |= assembly.get("angles", {})
        self.given: dict[int, float] = {}
        for name, angle in angles.items():
            body, turn = mechanism.find_body(name)  # `turn` is the constant angle of the named link in its body
            self.given[body] = angle - turn
        self.drawn = self._read_points(document, assembly.get("sketch", {}))
        self.theta: dict[int, float] = {GROUND: 0.0}
        self.centre: dict[int, Array] = {GROUND: np.zeros(2)}
        self.pin_ends = [ends for pin in mechanism.pins for ends in (pin.ends, pin.ends[::-1])]

    def _read_points(self, document: dict[str, Any], drawing: dict[str, Any]) -> dict[str, Array]:
        """Return name of a point -> world position (2,) [m] that the file gives.

        All points of a joint get the position that `drawing` gives for the joint, else that of the joint's point on the ground.
        """
        points: dict[str, Any] = {}
        for name, joint in expand_cylinders(document).get("joints", {}).items():
            references = joint.get("at") or [joint["block"]]  # points of a pin, or the block point of a slide
            on_ground = next((x.partition(".")[2] for x in references if x.startswith("ground.")), None)
            if name in drawing:
                points |= dict.fromkeys(references, drawing[name])
            elif on_ground is not None:
                points |= dict.fromkeys(references, self.mechanism.ground_points[on_ground])
        points |= {reference: x for reference, x in drawing.items() if "." in reference}
        return {self.mechanism.find_point(reference).name: np.array(x, dtype=float) for reference, x in points.items()}

    def world(self, point: Point) -> Array:
        """Return the world position (2,) [m] of a point of a placed body."""
        return np.asarray(self.centre[point.link] + turn_vector(point.local, self.theta[point.link]))

    def place(self, i: int) -> bool:
        """Place body i if a point and the angle of the body are known; return whether the body was placed."""
        link = self.mechanism.links[i]
        # point of the body -> its known world position (2,) [m]
        known = {name: self.drawn[f"{link.name}.{name}"] for name in link.points if f"{link.name}.{name}" in self.drawn}
        for mine, other in self.pin_ends:
            if mine.link == i and other.link in self.theta:
                known.setdefault(mine.name.partition(".")[2], self.world(other))
        if not known:
            return False
        first = next(iter(known))  # the sketch is rough: this point is met exactly, a second point only gives the direction
        angle = self._angle(i, first, known)
        if angle is None:
            return False
        self.theta[i] = angle
        self.centre[i] = known[first] - turn_vector(link.points[first] - link.com, angle)
        return True

    def _angle(self, i: int, first: str, known: dict[str, Array]) -> float | None:
        """Return the angle [rad] of body i from the file, else a second known point, else a slide; None if unknown.

        `known` has the world positions (2,) [m] of points, `first` among them. Whole turns bring the angle nearest to the angle
        that a slide on a placed body gives.
        """
        points = self.mechanism.links[i].points
        partner_angle, angle = self._angle_by_partner(i), self.given.get(i)
        second = next((name for name in known if np.any(points[name] != points[first])), None)
        if angle is None and second is not None:
            # directions from the first to the second point, in the body's frame and in the world
            own, drawn = points[second] - points[first], known[second] - known[first]
            angle = float(np.arctan2(drawn[1], drawn[0]) - np.arctan2(own[1], own[0]))
        elif angle is None:  # a slide on a placed body, else a slide whose two points are known
            angle = self._angle_by_line(i) if partner_angle is None else partner_angle
        if angle is not None and partner_angle is not None:
            # points give angles up to whole turns, but a slide compares the angles of its links
            angle += 2 * np.pi * round((partner_angle - angle) / (2 * np.pi))
        return angle

    def _angle_by_partner(self, i: int) -> float | None:
        """Return the angle [rad] of body i from a slide that connects it to a placed body; None if no slide does."""
        for joint in self.mechanism.slides:
            if joint.block.link == i and joint.guide.link in self.theta:
                return self.theta[joint.guide.link] + joint.turn
            if joint.guide.link == i and joint.block.link in self.theta:
                return self.theta[joint.block.link] - joint.turn
        return None

    def _angle_by_line(self, i: int) -> float | None:
        """Return the angle [rad] of body i from its first slide whose guide and block points are known; None without such a slide.

        The block is taken to be on the positive side of the guide point, so that the coordinate of the slide is positive.
        """
        for joint in self.mechanism.slides:
            guide, block = self._find(joint.guide), self._find(joint.block)
            if i not in (joint.guide.link, joint.block.link) or guide is None or block is None:
                continue
            x, y = block - guide
            distance = float(np.hypot(x, y))
            if distance > abs(joint.offset):
                # the block lies beside the axis by `offset`: axis and line of both points enclose arcsin(offset / distance)
                line = float(np.arctan2(y, x)) - float(np.arcsin(joint.offset / distance)) - joint.angle
                return line if i == joint.guide.link else line + joint.turn
        return None

    def _find(self, point: Point) -> Array | None:
        """Return the world position (2,) [m] of a point, from the file or by a pin on a placed body; None if it is unknown."""
        if point.name in self.drawn:
            return self.drawn[point.name]
        shared = next((other for mine, other in self.pin_ends if mine.name == point.name and other.link in self.theta), None)
        return None if shared is None else self.world(shared)
