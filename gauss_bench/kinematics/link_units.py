"""Link units: the contribution of one link to the loop equations, computed from its own shape alone.

A loop passes a link from the element at which it enters to the element at which it leaves. An element lies at r in the frame of the
link; an element that moves along the link by s (the guide of a slide, the far end of an active bar) lies at r + s u. Vectors of the
plane are complex numbers, E = exp(i phi) is the direction of the link, and w is the vector from element to element in its frame:

    w = (r + s u)_leave - (r + s u)_enter
    vector unit         A = E w
    Jacobian unit       J = [dA/dphi, dA/ds, ...] = [i E w, +-E u, ...]
    Jacobian-rate unit  J' = [i E (w' + i phi' w), +-i phi' E u, ...]

The sign is + for the element at which the loop leaves. These formulas cover every type of link of the paper: links with two, three
or four pins (RR, RRR, 4R), with a pin and the block of a slide (RP1, no s) or a pin and the guide of a slide (RP2, with s), with
two slides (PP), active bars, whose length is an input (S), and the frame. A link that cannot turn has no column of phi. Table 1 of
the paper has a misprint: the first column of J' of RP2 ends there in -phi' sin phi, phi' cos phi, in place of -s' sin phi,
s' cos phi.
Source: Wang et al., Automated modeling for kinematic analysis of planar linkages based on link units, Trans. CSAM 41(2), 2010,
eqs. (6)-(10) and table 1.
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
        along: unit vector u of a GUIDE or ROD_END.
        slide: name of the coordinate s of a GUIDE or ROD_END.
    """

    pair: str
    node: str
    kind: str
    at: complex
    along: complex = 0j
    slide: str = ""


@dataclass(frozen=True, eq=False)
class LinkUnit:
    """The contribution of one link to a loop: the vector A through it and its derivatives, see the top of this file.

    Attributes:
        vector: (2,) vector A from the element at which the loop enters the link to the one at which it leaves [m].
        J: (2, C) derivatives of A by the link's C variables: its angle [m/rad] if it can turn, then its slides [-].
        J_rate: (2, C) time derivative of J.
    """

    vector: Array
    J: Array
    J_rate: Array


@dataclass(frozen=True)
class Way:
    """The path of a loop through one link, from one element to another; the reverse path has the same `LinkUnit` times -1.

    Attributes:
        link: index of the link.
        enter, leave: the two elements.
        turns: whether the angle of the link is variable.
    """

    link: int
    enter: Element
    leave: Element
    turns: bool = True

    @cached_property
    def moving(self) -> list[tuple[float, Element]]:
        """The elements that have a coordinate s: (+1 where the loop leaves, -1 where it enters; element), by the name of s."""
        # this order does not depend on the sense of the path, so that the reverse path has the same columns
        ends = [(-1.0, self.enter), (1.0, self.leave)]
        return sorted(((sign, x) for sign, x in ends if x.kind in MOVING), key=lambda end: end[1].slide)

    @property
    def slides(self) -> tuple[str, ...]:
        """The names of the coordinates s, in the order of their columns, which follow the column of the angle."""
        return tuple(element.slide for _, element in self.moving)

    def units(self, angle: float, speed: float, places: Sequence[float] | Array, speeds: Sequence[float] | Array) -> LinkUnit:
        """Return vector, Jacobian and rate of the Jacobian of this path, by the equations at the top of this file.

        Args:
            angle, speed: of the link [rad, rad/s].
            places, speeds: coordinates s of its slides [m] and their rates [m/s], in the order of `slides`.
        """
        E = cmath.exp(1j * angle)
        w = self.leave.at - self.enter.at  # from element to element in the frame of the link
        w_rate = 0j
        columns: list[complex] = []  # of J
        rates: list[complex] = []  # of J'
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
    """Return C complex numbers as columns x, y: (2, C)."""
    z = np.array(vectors, dtype=complex)
    return np.array([z.real, z.imag])


def link_type(elements: Iterable[Element], frame: bool = False) -> str:
    """Return the paper's code for the type of a link with these elements.

    The code has an R for each pin and a P for each slide; four or more of a kind are written as a number and the letter, as in 4R.
    A single P is followed by 1 for a block or 2 for a guide. The code of the frame has a 0 at the end. An active bar has the code
    S. A multiple joint counts as one pin.
    """
    kinds = list({element.node: element.kind for element in elements}.values())
    if ROD_END in kinds:
        return "S"
    slides = [kind for kind in kinds if kind != PIN]
    shape = {BLOCK: "1", GUIDE: "2"}[slides[0]] if len(slides) == 1 and not frame else ""
    return _letters("R", len(kinds) - len(slides)) + _letters("P", len(slides)) + shape + ("0" if frame else "")


def _letters(letter: str, count: int) -> str:
    """Return the letter `count` times; from four on, the count and the letter."""
    return f"{count}{letter}" if count > 3 else letter * count
