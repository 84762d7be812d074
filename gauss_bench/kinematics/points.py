"""Basic points of a linkage: known points, which pivots and inputs determine, and unknown points, which determine all links.

Points and directions of the plane are complex numbers. A position of the linkage is one complex vector

    z = [1, inputs, points].

An input enters z as exp(i theta) for the driven angle of a link, as the coordinate s for a driven slide, or as the squared length
L^2 for an active bar (a bar whose length is an input).

Let A and B be two points of a link, and a and b their places in its frame. A vector s in the frame of the link is s (B - A) / (b -
a) in the world. If an input gives the direction exp(i theta) of the link, a further point C with the place c follows from A alone:
C = A + (c - a) exp(i theta). Places and directions are thus linear in z.
"""

from cmath import exp
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from gauss_bench.kinematics.topology import shared_angles
from gauss_bench.mechanism.coordinates import position, value
from gauss_bench.mechanism.model import GROUND, AngleDriver, LengthDriver, Mechanism, Point, Prismatic, SlideDriver
from gauss_bench.terms import Array, Vectors

SAME = 1e-12  # [m] distance below which two places in a file are the same up to rounding


@dataclass(frozen=True, eq=False)
class BasicPoint:
    """A point of one or more links: its place in the world is an entry of z.

    `at` gives, by index of a link, its place x + i y from the centre of mass in the frame of that link [m].
    """

    name: str
    at: Mapping[int, complex]


def place(point: Point) -> complex:
    """Return the place x + i y of a point in the frame of its link [m]."""
    return complex(*point.local)


def joint_points(mechanism: Mechanism, frames: Mapping[int, tuple[int, float]], turned: set[int]) -> list[BasicPoint]:
    """Return the basic points: pins (merged if they coincide in a link), blocks of slides, and points that show directions.

    Args:
        frames: link -> (root, phase) as from `shared_angles`.
        turned: roots whose angle is an input, and the ground; links with such a root need no second point.
    """
    basic: list[BasicPoint] = []

    def add(name: str, *ends: Point) -> None:
        """Add a point, given by its places in one or more links, or merge it with all points that share a place with it.

        The merged point has the name of the first of these.
        """
        places = {end.link: place(end) for end in ends}
        same = [x for x in basic if any(link in x.at and abs(x.at[link] - s) < SAME for link, s in places.items())]
        merged = {link: s for x in same for link, s in x.at.items()} | places
        basic[:] = [x for x in basic if x not in same] + [BasicPoint(same[0].name if same else name, merged)]

    def count(link: int) -> int:
        """Return the number of points that a link has so far."""
        return sum(link in x.at for x in basic)

    for pin in mechanism.pins:
        add(pin.joint, *pin.ends)
    for slide in mechanism.slides:
        add(slide.block.name, slide.block)
    for bar in (d for d in mechanism.drivers if isinstance(d, LengthDriver)):
        for end in (bar.a, bar.b):  # not needed on a link with two points: its other places follow from these
            if end.link != GROUND and count(end.link) < 2:
                add(end.name, end)
    for slide in mechanism.slides:  # every guide needs a point
        if not count(slide.guide.link):
            add(slide.guide.name, slide.guide)
    size = link_size(basic)
    for root in sorted({root for root, _ in frames.values()} - turned):
        members = [link for link, (r, _) in frames.items() if r == root]
        if all(count(link) < 2 for link in members):  # no two points show the direction: add one
            guide = next((j for j in mechanism.slides if j.guide.link in members), None)
            link, angle = (guide.guide.link, guide.angle) if guide else (root, 0.0)
            start = next((x.at[link] for x in basic if link in x.at), 0j)
            far = start + size * exp(1j * angle)
            add(f"{mechanism.links[link].name}.+", Point(link, np.array([far.real, far.imag]), ""))
    return basic


def link_size(points: list[BasicPoint]) -> float:
    """Return the largest distance of two points of a moving link [m]; 1 m if no link has two points."""
    largest = 0.0
    for p, q in combinations(points, 2):
        for link in p.at.keys() & q.at.keys() - {GROUND}:
            largest = max(largest, abs(p.at[link] - q.at[link]))
    return largest or 1.0


class Points:
    """The vector z (N,) of a mechanism, whose drivers are the inputs, and rows (N,) of quantities that are linear in z.

    The product of a row with z is the place of a point or the direction of a link. Below, an entry is an index into z, not a
    value. A point is known if its place follows from the ground and the inputs alone.

    Attributes:
        frames: link -> (root, phase), see `shared_angles`.
        bars: active bars by name.
        first: entry of the first basic point; the entries of the others follow.
        unknown: (u,) entries of the points that are not known.
        entries_of: link -> entries of the points of this link.
        anchor: link -> entry of the point from which the other points of this link are computed.
        turned: root whose direction is known -> entry of this direction; for the ground this is entry 0, which is 1 = exp(0 i).
        pushed, stretched: name of a driven slide or active bar -> entry of its coordinate or squared length.
        base: root whose direction is not known -> (link, entries A and B of two of its points that show the direction).
        placed_by: entry of a known point -> link from whose position the place of the point follows.
        rows: entry of a known point -> row of its place; the rows can be evaluated in this order.
        size: largest distance of two points of a link [m].
    """

    def __init__(self, mechanism: Mechanism):
        """Choose the basic points of a mechanism, and find the known ones.

        Raises:
            ValueError: a link has no joint, or a driver prescribes a quantity that another driver or the joints already determine.
        """
        self.mechanism, self.drivers = mechanism, mechanism.drivers
        self.frames = shared_angles(mechanism)
        self.bars = {d.name: d for d in mechanism.drivers if isinstance(d, LengthDriver)}
        # the driver k, counted from 1, has the entry k; `setdefault` returns the first entry of a quantity that is known already
        self.turned: dict[int, int] = {GROUND: 0}
        self.pushed: dict[str, int] = {}
        self.stretched: dict[str, int] = {}
        for entry, driver in enumerate(self.drivers, 1):
            match driver:
                case AngleDriver():
                    first = self.turned.setdefault(self.frames[driver.link][0], entry)
                case SlideDriver():
                    first = self.pushed.setdefault(driver.name, entry)
                case LengthDriver():
                    first = self.stretched.setdefault(driver.name, entry)
            if first != entry:
                raise ValueError(f"{mechanism.name}: the position of {driver.name} is known without driver {entry}")
        self.points = joint_points(mechanism, self.frames, set(self.turned))
        self.size = link_size(self.points)
        self.first = 1 + len(self.drivers)
        self.N = self.first + len(self.points)
        self.entries_of = {i: [k for k, x in enumerate(self.points, self.first) if i in x.at] for i in self.frames}
        jointless = [link for link, entries in self.entries_of.items() if not entries and link != GROUND]
        if jointless:
            raise ValueError(f"{mechanism.name}: {mechanism.link_name(jointless[0])} has no joint that could place it")
        self.anchor = {i: entries[0] for i, entries in self.entries_of.items() if entries}
        self.placed_by: dict[int, int] = {}
        self.rows: dict[int, Vectors] = {}
        self._place_known()
        self.unknown = np.array([k for k in range(self.first, self.N) if k not in self.placed_by], dtype=int)
        self.base = {root: self._choose_base(root) for root in {r for r, _ in self.frames.values()} - self.turned.keys()}
        self.anchor |= {link: A for link, A, _ in self.base.values()}

    def unit(self, entry: int) -> Vectors:
        """Return the row (N,) that selects one entry of z."""
        row = np.zeros(self.N, dtype=complex)
        row[entry] = 1.0
        return row

    def local(self, link: int, entry: int) -> complex:
        """Return the place x + i y [m], in the frame of a link, of its point with the given entry."""
        return self.points[entry - self.first].at[link]

    def direction(self, link: int) -> Vectors:
        """Return the row (N,) of exp(i theta) of a link, which follows from an input or from two points."""
        root, phase = self.frames[link]  # theta of the link is theta of the root plus `phase`
        if root in self.turned:
            return self.unit(self.turned[root]) * exp(1j * phase)
        owner, A, B = self.base[root]  # `owner` is the link with this root whose points show the direction
        turn = exp(1j * (phase - self.frames[owner][1]))
        return (self.unit(B) - self.unit(A)) * turn / (self.local(owner, B) - self.local(owner, A))

    def point(self, link: int, s: complex) -> Vectors:
        """Return the row (N,) of the world position of the place s = x + i y [m] in the frame of a link."""
        if link == GROUND:
            return self.unit(0) * s  # entry 0 of z is 1
        anchor = self.anchor[link]  # position = anchor + (s - place of the anchor) exp(i theta)
        offset = s - self.local(link, anchor)
        return self.unit(anchor) + offset * self.direction(link) if offset else self.unit(anchor)

    def block(self, slide: Prismatic) -> int:
        """Return the entry of the point in the block of a slide."""
        link = slide.block.link
        return min(self.entries_of[link], key=lambda k: abs(self.local(link, k) - place(slide.block)))

    def _place_known(self) -> None:
        """Fill `placed_by` and `rows` with the known points: those of the ground, then those of driven links.

        A link whose direction is an input is determined by one known point, which becomes its anchor.
        """
        link: int | None = GROUND
        # links whose direction is an input, and none of whose points is placed yet
        waiting = {i for i, (root, _) in self.frames.items() if root in self.turned and i != GROUND}
        while link is not None:
            for k in self.entries_of[link]:
                if k not in self.placed_by:
                    self.rows[k], self.placed_by[k] = self.point(link, self.local(link, k)), link
            # next comes a link of known direction with a point that is placed
            link = next((i for i in sorted(waiting) if self.placed_by.keys() & set(self.entries_of[i])), None)
            if link is not None:
                self.anchor[link] = next(k for k in self.entries_of[link] if k in self.placed_by)
                waiting.remove(link)

    def _choose_base(self, root: int) -> tuple[int, int, int]:
        """Return (link, A, B): the line between these points of a link gives the direction of all links with this `root`.

        A line from a known point A is preferred, then the longer line, then the smaller entry B.
        """

        def rank(pair: tuple[int, int, int]) -> tuple[bool, float, int]:
            link, A, B = pair
            return A in self.placed_by, abs(self.local(link, B) - self.local(link, A)), -B

        members = [link for link, (r, _) in self.frames.items() if r == root]
        pairs = [(link, A, B) for link in members for A, B in permutations(self.entries_of[link], 2)]
        return max(pairs, key=rank)

    def evaluate_known(self, x: Array, rate: Array, second: Array) -> Vectors:
        """Return z and its derivatives z', z'' as rows of (3, N), with zeros for the unknown points.

        `x`, `rate`, `second` (i,) are the inputs [rad, m] and their time derivatives; an active bar has its length in x, not the
        square.
        """
        Z = np.zeros((3, self.N), dtype=complex)
        Z[0, 0] = 1.0  # the constant of z
        for k, driver in enumerate(self.drivers):
            match driver:
                case AngleDriver():
                    E = exp(1j * (x[k] - self.frames[driver.link][1]))
                    Z[:, 1 + k] = E, 1j * rate[k] * E, (1j * second[k] - rate[k] ** 2) * E
                case SlideDriver():
                    Z[:, 1 + k] = x[k], rate[k], second[k]
                case LengthDriver():
                    Z[:, 1 + k] = x[k] ** 2, 2 * x[k] * rate[k], 2 * (rate[k] ** 2 + x[k] * second[k])
        for entry, row in self.rows.items():  # a known point is linear in inputs and earlier points
            Z[:, entry] = Z @ row
        return Z

    def inputs_at(self, q: Array) -> Array:
        """Return the inputs (i,) [rad, m] at a state q (n,)."""
        return np.array([float(value(driver.coordinate, q)) for driver in self.drivers])

    def unknown_at(self, q: Array) -> Array:
        """Return the coordinates (2 u,) [m] of the unknown points at a state q (n,)."""
        owners = [next(iter(self.points[k - self.first].at.items())) for k in self.unknown]  # a link of each, and its place there
        places = [position(q, Point(link, np.array([s.real, s.imag]), "")) for link, s in owners]
        return np.array(places).reshape(-1)
