"""The common part of adapters to foreign engines: refusals, and checks of what they build and return against the linkage."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.engines.tree import Tree, spanning_tree
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import (
    GROUND,
    AngleDriver,
    Law,
    LengthDriver,
    Mechanism,
    Point,
    Prismatic,
    Revolute,
    SlideDriver,
    factor_of,
    loads,
)
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status
from gauss_bench.trajectory import finite as finite  # where plug-ins look for them
from gauss_bench.trajectory import with_accelerations as with_accelerations

SPREAD = (0.0, 0.5, 1.0, 2.0, 3.0)  # rad and m about the start; 10 times that in speeds
PARALLEL = 1e-12  # sine of the angle between two axes: angles are summed in different orders


def _nothing() -> None:
    """Make nothing ready."""


@dataclass(frozen=True, eq=False)
class LibraryCall:
    """One right-hand side as a library's own experts would ask for it, without the translation of coordinates around it.

    Attributes:
        call: what is timed.
        acceleration: (n,) that it finds, in absolute coordinates.
        ready: what must come before every call, untimed.
        count: how many right-hand sides, or implicit steps, a call has.
    """

    call: Callable[[], object]
    acceleration: Array
    ready: Callable[[], None] = _nothing
    count: int = 1


def unsteady(mechanism: Mechanism, library: str) -> str | None:
    """The reason why a library that is given steady forces alone cannot have the mechanism, or None."""
    names = ", ".join(f.name for f in mechanism.varying)
    return f"force {names} varies with time or direction, which {library} is not given here" if names else None


def refused(mechanism: Mechanism, library: str) -> str | None:
    """The reason why no adapter takes the mechanism, or None.

    Raises:
        TypeError: a force of a kind that does not say what it comes to.
    """
    for force in mechanism.forces:
        if any(isinstance(x, Law) and x.inverse_square for x in ([] if factor_of(force) else loads([force]))):
            return f"force {force.name} falls with the square of a distance, for which {library} is given no element here"
    if mechanism.couplings:
        return f"{library} is given no {type(mechanism.couplings[0]).__name__} ({mechanism.couplings[0].name}) here"
    if mechanism.has_friction:
        return f"dry friction in proportion to the load of a joint is not modelled in {library} here"
    return None


def jointed(mechanism: Mechanism) -> list[AngleDriver | SlideDriver]:
    """The drivers that prescribe a link's angle or a slide, in order; lengths are no coordinates of a tree."""
    return [d for d in mechanism.drivers if not isinstance(d, LengthDriver)]


def driven_coordinates(mechanism: Mechanism, tree: Tree) -> list[int | None]:
    """For each driver the tree coordinate that it prescribes, or None where that is a sum or no coordinate."""
    hinges = {b.link: b.at for b in tree.branches if b.kind == "revolute" and b.parent == GROUND}
    slides = {b.joint.name: b.at for b in tree.branches if b.kind == "prismatic" and b.joint}
    return [hinges.get(d.link) if isinstance(d, AngleDriver) else slides.get(d.joint.name) for d in jointed(mechanism)]


def beyond_a_tree(mechanism: Mechanism, library: str) -> str | None:
    """The reason why a tree of joints that only pins may close cannot be the mechanism, or None."""
    if reason := refused(mechanism, library):
        return reason
    if mechanism.knife_edges:
        return f"{library} has no constraint on velocities alone (knife edge)"
    slide = next((j.name for j in spanning_tree(mechanism).closures if isinstance(j, Prismatic)), None)
    return slide and f"the slide {slide} closes a loop of slides, for which {library} has no constraint"


TREES = {"file order": False, "least depth": True}  # of joints, as variants call them: whether links hang near the ground


def joint_tree(mechanism: Mechanism, options: Mapping[str, Any]) -> Tree:
    """The tree of joints that the options of an engine ask for by their knob `tree`."""
    return spanning_tree(mechanism, TREES[options["tree"]])


def closing_pins(tree: Tree) -> list[tuple[Point, Point]]:
    """The pairs of points that the tree leaves apart."""
    return [(joint.a, joint.b) for joint in tree.closures if isinstance(joint, Revolute)]


def tree_states(tree: Tree, y0: Array, dy0: Array) -> Iterator[tuple[Array, Array]]:
    """The start and random tree states y, dy (n,) around it, closed or not."""
    random = np.random.default_rng(0)
    for size in SPREAD:
        yield y0 + size * random.uniform(-1.0, 1.0, tree.n), dy0 + 10.0 * size * random.uniform(-1.0, 1.0, tree.n)


@dataclass(frozen=True, eq=False)
class OpenTree:
    """The linkage at a state of its tree whose open pins may be apart, by the suite's own terms.

    With V the map from tree to absolute speeds and a0 the acceleration at rest, its own, unconstrained motion obeys

        V^T M V y'' = V^T (Q - M a0)

    Attributes:
        q: (n_q,) absolute. mass: (n, n) V^T M V. forces: (n,) V^T (Q - M a0), parts of which have the size `load`.
        gaps: (pins, 2) of the open pins, point b minus point a.
    """

    q: Array
    mass: Array
    forces: Array
    load: float
    gaps: Array


def open_tree(evaluator: Evaluator, tree: Tree, y: Array, dy: Array) -> OpenTree:
    """At a tree state y, dy (n,)."""
    q, v, a0 = tree.absolute(y, dy, np.zeros(tree.n))
    speeds = tree.absolute(np.tile(y, (tree.n, 1)), np.eye(tree.n), np.zeros((tree.n, tree.n)))[1]
    Q, inertial = evaluator.applied.generalised(q, v, 0.0), evaluator.mass * a0
    gaps = np.array([position(q, b) - position(q, a) for a, b in closing_pins(tree)]).reshape(-1, 2)
    load = float(np.abs(Q).max() + np.abs(inertial).max())
    return OpenTree(q, (speeds * evaluator.mass) @ speeds.T, speeds @ (Q - inertial), load, gaps)


def require_agreement(pairs: Mapping[str, tuple[Array, Array, float]], tolerance: float) -> None:
    """Compare what a generated model says, what the linkage says, and the size by which to judge their difference.

    Raises:
        RunFailure: they differ.
    """
    for what, (own, expected, scale) in pairs.items():
        error = np.abs(own - expected).max(initial=0.0)
        if not error <= tolerance * scale:
            raise RunFailure(Status.ERROR, f"the generated model differs from the linkage: {what} by {error:.1e} (of {scale:.1e})")


def size(x: Array) -> float:
    """The largest entry, at least 1."""
    return float(np.abs(x).max(initial=1.0))


def finite_acceleration(t: float, a: Array, library: str) -> Array:
    """The accelerations (n,).

    Raises:
        RunFailure: they are no numbers.
    """
    if not np.isfinite(a).all():
        raise RunFailure(Status.NAN, f"t = {t:.6g} s: {library}'s acceleration is not finite")
    return a


def spatial(x: Any) -> list[float]:
    """A vector of the plane (2,) in space."""
    return [float(x[0]), float(x[1]), 0.0]
