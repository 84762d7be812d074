"""Find a four-bar whose coupler takes three given poses, and tell whether it moves through them without being taken apart.

The coupler carries a body through three poses. A pin of the coupler is then at three places, and the centre of the circle through
these is the fixed pivot of the bar that guides the pin. In kinematic inversion, seen from the coupler, a fixed pivot is at three
places, and the centre of their circle is the pin. If the three places of a pin lie on a line, a slide guides the pin. Places are
complex numbers x + i y [m]. A pose is the place and the angle [rad] of the coupler's frame.

Source: Sandor, Erdman (1984), Advanced Mechanism Design, vol. 2; for branch and order Waldron, Kinzel (1999), Kinematics, Dynamics,
and Design of Machinery.
"""

from cmath import phase, rect
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

Pose = tuple[complex, float]
NAMES = ("first", "second")  # connections of the coupler to the ground
ORDER = ("first", "second", "third")  # poses
LINE = 1e-9  # height of a triangle, in lengths of its longest side, below which its corners lie on a line
FARTHEST = 100.0  # largest radius of the circle through the corners, in lengths of the longest side: a larger one is almost a line
SAME = 1e-6  # smallest distance of two different places, as a share of the lengths that they are compared with
DEAD = 1e-6  # largest sine of the angle between coupler and output at a dead point, which belongs to both branches


class NoFourBar(ValueError):
    """No four-bar follows from these poses and places; the message gives the reason."""


@dataclass(frozen=True)
class Connection:
    """One connection of the coupler to the ground: a bar that turns about a pivot, or a slide.

    Attributes:
        pin: place of the pin in the frame of the coupler.
        places: place of the pin at each pose.
        pivot: the fixed pivot of a bar; the pin's first place for a slide.
        direction: unit vector along a slide; None for a bar.
    """

    pin: complex
    places: tuple[complex, ...]
    pivot: complex
    direction: complex | None = None

    @property
    def length(self) -> float:
        """The length of the bar [m]; 0 for a slide."""
        return abs(self.places[0] - self.pivot)

    def input(self, place: complex) -> float:
        """Return the angle of the bar [rad], or the coordinate along the slide [m], with the pin at a place."""
        along = place - self.pivot
        return phase(along) if self.direction is None else (along * self.direction.conjugate()).real

    def pin_at(self, value: float) -> complex:
        """Return the place of the pin at a value of the input."""
        return self.pivot + (rect(self.length, value) if self.direction is None else self.direction * value)


@dataclass(frozen=True)
class Drive:
    """The motion of a four-bar through its three poses if one of its two connections to the ground is driven.

    Attributes:
        fault: "branch" if it cannot move from pose to pose without being taken apart; "order" if it passes the third pose before
            the second; else "".
        text: a sentence for the user that describes the motion or the fault.
        travel: change of the input from the first to the third pose [rad, m]; 0 if there is a fault.
    """

    fault: str
    text: str
    travel: float = 0.0


@dataclass(frozen=True)
class FourBar:
    """A four-bar through three poses: its two connections to the ground, and its motion if the first or the second is driven."""

    connections: tuple[Connection, Connection]
    drives: tuple[Drive, Drive]


def four_bar_of_pins(poses: Sequence[Pose], pins: Sequence[complex]) -> FourBar:
    """Return the four-bar whose coupler takes three poses, and has its two pins at given places in the coupler's frame.

    Raises:
        NoFourBar: a pin has no pivot, the two pins coincide, the two pivots coincide, or a pin coincides with its pivot.
    """
    connections = []
    for name, pin in zip(NAMES, pins, strict=True):
        places = tuple(place + rect(1.0, angle) * pin for place, angle in poses)
        connections.append(connect(pin, places, f"the {name} pin"))
    return join(connections[0], connections[1])


def four_bar_of_pivots(poses: Sequence[Pose], pivots: Sequence[complex]) -> FourBar:
    """Return the four-bar whose coupler takes three poses, and whose bars turn about two given fixed pivots.

    Raises:
        NoFourBar: a pivot has no pin, the two pins coincide, the two pivots coincide, or a pin coincides with its pivot.
    """
    connections = []
    for name, pivot in zip(NAMES, pivots, strict=True):
        # kinematic inversion: in the coupler's frame the pivot moves on a circle about the pin, its centre
        places_seen = tuple((pivot - place) * rect(1.0, -angle) for place, angle in poses)
        # only the centre of the circle is used: the first argument is arbitrary
        circle = connect(0j, places_seen, f"the {name} fixed pivot, seen from the coupler,")
        if circle.direction is not None:
            raise NoFourBar(f"the {name} fixed pivot has no pin: seen from the coupler its three places lie on a line")
        pin = circle.pivot
        places = tuple(place + rect(1.0, angle) * pin for place, angle in poses)
        connections.append(Connection(pin, places, pivot))
    return join(connections[0], connections[1])


def connect(pin: complex, places: tuple[complex, ...], name: str) -> Connection:
    """Return the connection that guides a pin through three places: a bar from their circle's centre, or a slide along their line.

    `pin` is the place of the pin in the frame of the coupler; `name` begins the message of an exception.

    Raises:
        NoFourBar: two of the three places coincide, or the circle through them is too large.
    """
    a, b, c = places
    sides = sorted((b - a, c - b, a - c), key=abs)
    longest = abs(sides[2])
    if abs(sides[0]) <= SAME * longest:
        raise NoFourBar(f"{name} is at the same place in two poses: move it, or the poses")
    height = cross(b - a, c - a) / longest**2
    if abs(height) < LINE:
        return Connection(pin, places, a, sides[2] / longest)
    u, v = b - a, c - a
    # the centre of the circle through a, b and c
    centre = a + 1j * (v * abs(u) ** 2 - u * abs(v) ** 2) / (-2.0 * cross(u, v))
    if abs(centre - a) > FARTHEST * longest:
        raise NoFourBar(f"{name} moves almost along a line: its circle has a radius of {abs(centre - a):.3g} m")
    return Connection(pin, places, centre)


def cross(a: complex, b: complex) -> float:
    """Return the vector product a x b of two vectors of the plane, given as complex numbers."""
    return (a.conjugate() * b).imag


def join(first: Connection, second: Connection) -> FourBar:
    """Return the four-bar that two connections form with the coupler and the ground, and its motions with either driven.

    Raises:
        NoFourBar: the coupler, the frame or a bar would have no length.
    """
    if abs(first.pin - second.pin) <= SAME * max(first.length, second.length, abs(first.pin)):
        raise NoFourBar("the pins coincide: the coupler has no length")
    both_turn = first.direction is None and second.direction is None
    if both_turn and abs(first.pivot - second.pivot) <= SAME * (first.length + second.length):
        raise NoFourBar("the fixed pivots coincide: the coupler only turns about them")
    for name, connection in zip(NAMES, (first, second), strict=True):
        if connection.direction is None and connection.length <= SAME * abs(first.pin - second.pin):
            raise NoFourBar(f"the {name} pin lies on its fixed pivot: the bar between them has no length")
    return FourBar((first, second), (check_drive(first, second, "first"), check_drive(second, first, "second")))


def check_drive(driven: Connection, other: Connection, name: str) -> Drive:
    """Check whether the four-bar passes the three poses in their order, on one branch, if the connection `driven` is driven.

    `name` is "first" or "second", for the text of the result.
    """
    coupler = abs(driven.pin - other.pin)
    driver = f"the {name} bar" if driven.direction is None else f"the {name} slide"
    # the branch, 1 or -1, at each pose; 0 at a dead point
    sides = [side_of(other, a, b, coupler) for a, b in zip(driven.places, other.places, strict=True)]
    if {1, -1} <= {*sides}:
        first_side = next(x for x in sides if x)  # a pose at a dead point belongs to both branches
        k = sides.index(-first_side)
        return Drive("branch", f"Driven by {driver}, it does not get from pose to pose: the {ORDER[k]} is on the other branch.")
    values = [driven.input(x) for x in driven.places]
    # the poses in their order: the input reaches the second pose, then the third, without changing its sense
    for sense, (second, third) in list_travels(driven, values):
        if 0 < sense * second < sense * third and stays_closed(driven, other, coupler, *sorted((values[0], values[0] + third))):
            turning = {1: "counter-clockwise", -1: "clockwise"}[sense] if driven.direction is None else "along it"
            return Drive("", f"Driven by {driver} {turning}, it takes the three poses in their order, on one branch.", third)
    # the poses in any order: the loop stays closed over some range of the input that includes all three poses
    for _, travels in list_travels(driven, values):
        back, forth = min(0.0, *travels), max(0.0, *travels)
        if stays_closed(driven, other, coupler, values[0] + back, values[0] + forth):
            return Drive("order", f"Driven by {driver}, it takes the poses in another order than given.")
    return Drive("branch", f"Driven by {driver}, it does not get from pose to pose: a dead point lies between them.")


def side_of(other: Connection, a: complex, b: complex, coupler: float) -> int:
    """Return the branch of the four-bar in a pose: 1 or -1, or 0 at a dead point, which belongs to both branches.

    It is the sign of the sine of the angle between the coupler and the bar `other`, or between the coupler and the normal of the
    slide `other`.

    Args:
        a, b: places of the pin of the driven connection, and of the other one.
        coupler: length of the coupler between its two pins [m].
    """
    if other.direction is None:
        sine = cross(b - a, other.pivot - b) / (coupler * other.length)
    else:
        sine = ((b - a) * other.direction.conjugate()).real / coupler
    if abs(sine) < DEAD:
        return 0
    return 1 if sine > 0 else -1


def list_travels(driven: Connection, values: list[float]) -> list[tuple[int, tuple[float, float]]]:
    """Return the ways in which the input can move from the first pose to the other two, as (sense +-1, two travels [rad, m]).

    A slide has one pair of travels, returned once for each sense. A bar can turn to each pose in both directions, which gives four
    pairs. `values` are those of the input at the three poses.
    """
    second, third = (x - values[0] for x in values[1:])
    if driven.direction is not None:
        return [(1, (second, third)), (-1, (second, third))]
    forward = second % (2 * pi), third % (2 * pi)
    back = forward[0] - 2 * pi, forward[1] - 2 * pi
    # last the pairs with opposite directions: they never pass the poses in their order, so that their sense does not matter
    return [(1, forward), (-1, back), (1, (forward[0], back[1])), (1, (back[0], forward[1]))]


def stays_closed(driven: Connection, other: Connection, coupler: float, start: float, end: float) -> bool:
    """Tell whether the four-bar stays closed at every input of the driven connection from `start` to the larger `end`.

    The driven pin must be neither too far from the other pivot (or line) nor too near it. This distance is extreme at `start`, at
    `end`, or where the pin is nearest or farthest between them.
    """
    inputs = [start, end]  # inputs at which the distance may be extreme
    if driven.direction is None:  # a bar
        towards = phase(other.pivot - driven.pivot) if other.direction is None else phase(1j * other.direction)
        # the driven bar points to the other pivot, or is perpendicular to the other line, or points the opposite way;
        # start and end are within 3 pi of zero (an angle, and less than a turn), and `towards` within pi
        extremes = [towards + k * pi for k in range(-4, 5)]
        inputs += [x for x in extremes if start < x < end]
    elif other.direction is None:
        nearest = driven.input(other.pivot)
        inputs += [nearest] if start < nearest < end else []
    slack = SAME * coupler
    for value in inputs:
        pin = driven.pin_at(value)
        if other.direction is not None:
            is_reached = abs(cross(other.direction, pin - other.pivot)) <= coupler + slack
        else:
            is_reached = abs(coupler - other.length) - slack <= abs(pin - other.pivot) <= coupler + other.length + slack
        if not is_reached:
            return False
    return True
