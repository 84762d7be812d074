"""Link units: the contribution of one link to the loop equations, computed from its own shape alone.

An element (a pin, guide, block or rod end) is the half of a joint that belongs to one link. A loop enters a link at one element and
leaves it at another. An element has the position r in the frame of its link. The guide of a slide and the far end of an active bar
(a bar whose length is an input) lie at r + s u, where u is a unit vector and s the coordinate along it. Vectors of the plane are
complex numbers, and E = exp(i phi) is the direction of the link. The vector w from element to element, its image A in the world,
the Jacobian J of A and its time derivative J' are

    vector in the link:   w = (r + s u)_leave - (r + s u)_enter
    vector unit:          A = E w
    Jacobian unit:        J = [dA/dphi, dA/ds, ...] = [i E w, +-E u, ...]
    Jacobian-rate unit:   J' = [i E (w' + i phi' w), +-i phi' E u, ...]

The sign is + if the loop leaves the link at the element of s, else -. A link that cannot turn lacks the first column. These
formulas cover every type of link of the paper: RR, RRR, 4R (pins), RP1 (pin and block), RP2 (pin and guide), PP (two slides), S (an
active bar), and the frame. Table 1 of the paper has a misprint: the first column of J' of RP2 ends there in -phi' sin phi, phi' cos
phi, in place of -s' sin phi, s' cos phi.

Source: Wang et al. (2010), eqs. (6)-(10) and table 1.
"""

import cmath
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gauss_bench.terms import Array

PIN, GUIDE, BLOCK, ROD_END = "pin", "guide", "block", "rod end"
MOVING = (GUIDE, ROD_END)  # elements with a coordinate s of their own


@dataclass(frozen=True)
class Element:
    """The half of a pair (a joint of two links) that belongs to one link.

    Attributes:
        pair: name of the pair.
        node: name of the joint, the same for all pairs of a multiple joint.
        kind: PIN, GUIDE, BLOCK, or ROD_END for the pin that an active bar pushes out.
        at: position r in the frame of the link [m].
        along, slide: unit vector u, and name of the coordinate s, of a GUIDE or ROD_END.
    """

    pair: str
    node: str
    kind: str
    at: complex
    along: complex = 0j
    slide: str = ""


@dataclass(frozen=True, eq=False)
class LinkUnit:
    """The vector A (2,) [m] of a link in a loop, its derivatives J (2, C) by the C variables of the link, and their rates.

    The variables are the angle of the link if it can turn, then the coordinates s of its moving elements.
    """

    vector: Array
    J: Array
    J_rate: Array


@dataclass(frozen=True)
class LinkPath:
    """The path of a loop through one link, from one of its elements to another; `turns` tells whether the link can turn.

    The reverse path has the same `LinkUnit` multiplied by -1.
    """

    link: int
    enter: Element
    leave: Element
    turns: bool = True

    @cached_property
    def moving(self) -> list[tuple[float, Element]]:
        """The elements of this path that have a coordinate s, with the sign of s u in A: +1 where the loop leaves, else -1.

        They are sorted by the name of s, so that the reverse path has the same columns.
        """
        ends = [(-1.0, self.enter), (1.0, self.leave)]
        return sorted(((sign, x) for sign, x in ends if x.kind in MOVING), key=lambda end: end[1].slide)

    @property
    def slides(self) -> tuple[str, ...]:
        """The names of the coordinates s of this path, in the order of their columns in J, after that of the angle."""
        return tuple(element.slide for _, element in self.moving)

    def link_unit(self, angle: float, speed: float, places: Sequence[float] | Array, speeds: Sequence[float] | Array) -> LinkUnit:
        """Return the vector A of this path, its Jacobian J, and the time derivative of J, by the equations at the top of this file.

        Args:
            angle, speed: angle [rad] and angular speed [rad/s] of the link.
            places, speeds: coordinates s [m] and their rates [m/s], in the order of `slides`.
        """
        E = cmath.exp(1j * angle)
        w = self.leave.at - self.enter.at  # from element to element in the frame of the link
        w_rate = 0j
        columns: list[complex] = []  # columns of J
        rates: list[complex] = []  # columns of J'
        for (sign, element), s, s_rate in zip(self.moving, places, speeds, strict=True):
            w += sign * s * element.along
            w_rate += sign * s_rate * element.along
            columns.append(sign * E * element.along)
            rates.append(1j * speed * sign * E * element.along)
        if self.turns:
            columns.insert(0, 1j * E * w)
            rates.insert(0, 1j * E * (w_rate + 1j * speed * w))
        return LinkUnit(planar([E * w])[:, 0], planar(columns), planar(rates))


def planar(vectors: Sequence[complex]) -> Array:
    """Return C complex numbers as an array (2, C): real parts above imaginary parts."""
    z = np.array(vectors, dtype=complex)
    return np.array([z.real, z.imag])


def link_type(elements: Iterable[Element], frame: bool = False) -> str:
    """Return the paper's code for the type of the link that has these elements; `frame` tells whether it is the frame.

    The code has an R for each pin and a P for each slide; more than three equal letters are written with their number, as in 4R.
    The P of the only slide of a moving link is followed by 1 for a block, or by 2 for a guide. The code of the frame ends in 0. An
    active bar has the code S. A multiple joint counts as one pin.
    """
    # elements with the same `node` belong to one multiple joint
    kinds = list({element.node: element.kind for element in elements}.values())
    if ROD_END in kinds:
        return "S"
    slides = [kind for kind in kinds if kind != PIN]
    shape = {BLOCK: "1", GUIDE: "2"}[slides[0]] if len(slides) == 1 and not frame else ""
    counts = (("R", len(kinds) - len(slides)), ("P", len(slides)))
    letters = "".join(f"{count}{letter}" if count > 3 else letter * count for letter, count in counts)
    return letters + shape + ("0" if frame else "")
