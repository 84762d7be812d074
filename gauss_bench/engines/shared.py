"""Parts that adapters to libraries share: reasons to refuse a linkage, and checks of a library's model against the linkage."""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gauss_bench.engines.base import Choice, EngineDefaults
from gauss_bench.engines.base import LibraryCall as LibraryCall  # plug-ins import it from here
from gauss_bench.engines.tree import Tree, spanning_tree, turning
from gauss_bench.engines.variants import Variants, read_variants
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
from gauss_bench.trajectory import finite as finite  # plug-ins import these two from here
from gauss_bench.trajectory import with_accelerations as with_accelerations

# [rad, m] for each tree state, the largest difference of a coordinate from the start. Rates differ by up to 10 times this number
# [rad/s, m/s], so that errors of velocity terms show.
SPREAD = (0.0, 0.5, 1.0, 2.0, 3.0)
PARALLEL = 1e-12  # largest sine of the angle between axes that count as parallel: sums of angles differ by rounding
End = TypeVar("End")


class LibraryEngine(EngineDefaults):
    """The members that adapters to libraries have in common.

    `class Adapter(LibraryEngine, beside=__file__)` reads the `variants.toml` in the folder of the adapter's own file.
    """

    stabilizations: tuple[str, ...] = ("none",)
    settings: Mapping[str, Mapping[str, Any]]
    file: Variants

    def __init_subclass__(cls, file: Variants | None = None, beside: str = "") -> None:
        if file:
            warnings.warn("LibraryEngine's `file=read_variants(...)` is now `beside=__file__`", DeprecationWarning, stacklevel=2)
        if beside:
            file = read_variants(Path(beside).parent)
        if file:  # without it, a subclass of an adapter inherits that adapter's settings
            cls.file = file
            cls.settings, cls.variants, cls.knobs = file.settings, file.space, file.knobs
            cls.first, cls.soft, cls.unfinished = file.first, file.soft, file.unfinished

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return ""


def unsteady(mechanism: Mechanism, library: str) -> str | None:
    """Return the reason to refuse a mechanism if a force depends on time or on the direction of motion, else None."""
    if not mechanism.varying:
        return None
    names = ", ".join(f.name for f in mechanism.varying)
    return f"force {names} varies with time or direction, and the adapter of {library} supports constant forces only"


def common_refusal(mechanism: Mechanism, library: str) -> str | None:
    """Return the reason why no adapter that calls this function can model the mechanism, or None if there is no such reason.

    Raises:
        TypeError: a force is of a kind that cannot be expressed by loads.
    """
    for force in mechanism.forces:
        is_steady = not factor_of(force)  # a force that varies with time or direction is no sum of constant loads
        if is_steady and any(isinstance(x, Law) and x.inverse_square for x in loads([force])):
            return f"force {force.name} is an inverse square law, which the adapter of {library} does not support"
    if mechanism.couplings:
        coupling = mechanism.couplings[0]
        return f"the adapter of {library} does not support a {type(coupling).__name__} ({coupling.name})"
    if mechanism.has_friction:
        return f"the adapter of {library} does not support dry friction, which depends on the load of a joint"
    return None


def jointed(mechanism: Mechanism) -> list[AngleDriver | SlideDriver]:
    """List the drivers of angles and slides, in the order of the file; a driven length is no coordinate of a tree."""
    return [d for d in mechanism.drivers if not isinstance(d, LengthDriver)]


def driven_coordinates(mechanism: Mechanism, tree: Tree) -> list[int | None]:
    """List, for each driver of an angle or slide, the index of the driven tree coordinate; None for a sum of several."""
    # the angle of a link is a tree coordinate only if a hinge joins the link to the ground
    hinges = {b.link: b.at for b in tree.branches if b.kind == "revolute" and b.parent == GROUND}
    slides = slide_indices(tree)
    return [hinges.get(d.link) if isinstance(d, AngleDriver) else slides.get(d.joint.name) for d in jointed(mechanism)]


def undriven(mechanism: Mechanism, tree: Tree, library: str, any_law: bool = True) -> str | None:
    """Return the reason why an adapter that prescribes single tree coordinates cannot follow a driver, or None if it can.

    Args:
        any_law: whether the adapter can follow every motion law; otherwise only constant speeds.
    """
    for driver in mechanism.drivers:
        if isinstance(driver, LengthDriver):
            return f"{library} can prescribe coordinates of joints, but not the length {driver.name}"
        if not any_law and driver.law.name != "constant":
            return f"the adapter of {library} supports drivers of constant speed only, not the motion law {driver.law.name}"
    if None in driven_coordinates(mechanism, tree):
        return f"{library} can prescribe single coordinates of the tree of joints, but the driven angle is a sum of several"
    return None


def drivers_by_coordinate(mechanism: Mechanism, tree: Tree) -> dict[int, AngleDriver | SlideDriver]:
    """Return index of a tree coordinate -> the driver that prescribes it; drivers of sums of coordinates are left out."""
    pairs = zip(driven_coordinates(mechanism, tree), jointed(mechanism), strict=True)
    return {at: driver for at, driver in pairs if at is not None}


def driven_rows(mechanism: Mechanism, tree: Tree) -> tuple[Array, Array]:
    """Return rows (k, n) and constants (k,) of the k drivers of angles and slides (`jointed`).

    Driver k prescribes the driven coordinate x_k = rows[k] . y + constants[k], where y (n,) are the tree coordinates.
    """
    drivers, slides, turns = jointed(mechanism), slide_indices(tree), turning(tree)
    rows, constants = np.zeros((len(drivers), tree.n)), np.zeros(len(drivers))
    for k, driver in enumerate(drivers):
        if isinstance(driver, AngleDriver):
            rows[k], constants[k] = turns.rows[driver.link], turns.constants[driver.link]
        else:
            rows[k, slides[driver.joint.name]] = 1.0
    return rows, constants


def slide_indices(tree: Tree) -> dict[str, int]:
    """Return name of each slide in the tree -> index of its tree coordinate."""
    return {b.joint.name: b.at for b in tree.branches if b.kind == "prismatic" and b.joint}


def beyond_a_tree(mechanism: Mechanism, library: str) -> str | None:
    """Return the reason why a tree of joints, with pins as the only closures of its loops, cannot model a mechanism, or None."""
    if reason := common_refusal(mechanism, library):
        return reason
    if mechanism.knife_edges:
        return f"{library} has no constraint on velocities alone (knife edge)"
    for joint in spanning_tree(mechanism).closures:
        if isinstance(joint, Prismatic):
            return f"the slide {joint.name} closes a loop of slides, for which {library} has no constraint"
    return None


TREES = {"file order": False, "least depth": True}  # value of the knob `tree` -> `least_depth` of spanning_tree


def joint_tree(mechanism: Mechanism, options: Mapping[str, Any]) -> Tree:
    """Return the spanning tree of joints that an engine's option `tree` selects."""
    return spanning_tree(mechanism, TREES[options["tree"]])


def closing_pins(tree: Tree) -> list[tuple[Point, Point]]:
    """List the points a and b of each pin that is not in the tree; a and b must coincide to close a loop."""
    return [(joint.a, joint.b) for joint in tree.closures if isinstance(joint, Revolute)]


def measure_gaps(pins: Iterable[tuple[End, End]], place: Callable[[End], Array]) -> Array:
    """Return end b minus end a of each pin (pins, 2) [m]; `place` returns the position (2,) or (3,) [m] of an end in the world."""
    return np.array([(place(b) - place(a))[:2] for a, b in pins]).reshape(-1, 2)


def tree_states(tree: Tree, y0: Array, dy0: Array) -> Iterator[tuple[Array, Array]]:
    """Yield the start y0, dy0 (n,) in tree coordinates and rates, and random states around it, at which loops may be open."""
    random = np.random.default_rng(0)
    for size in SPREAD:
        yield y0 + size * random.uniform(-1.0, 1.0, tree.n), dy0 + 10.0 * size * random.uniform(-1.0, 1.0, tree.n)


@dataclass(frozen=True, eq=False)
class OpenTree:
    """The suite's own equations of motion of a tree without its closing pins: the reference for a library's model of the tree.

    The matrix V maps tree rates y' to absolute speeds, and a0 is the absolute acceleration if y'' = 0. The equations are

        V^T M V y'' = V^T (Q - M a0)

    Attributes:
        q: (3 links,) absolute coordinates.
        mass: (n, n) mass matrix V^T M V.
        forces: (n,) forces and velocity terms V^T (Q - M a0).
        load: largest force in Q plus the largest force in M a0, which is the scale for differences of `forces`.
        gaps: (pins, 2) point b minus point a of each closing pin [m].
    """

    q: Array
    mass: Array
    forces: Array
    load: float
    gaps: Array


def open_tree(evaluator: Evaluator, tree: Tree, y: Array, dy: Array) -> OpenTree:
    """Evaluate the suite's own equations of motion of the tree at a tree state y, dy (n,) and t = 0; loops may be open."""
    q, v, a0 = tree.absolute(y, dy, np.zeros(tree.n))
    speeds = tree.unit_speeds(y)  # (n, 3 links) V^T
    Q, inertial = evaluator.applied.generalised(q, v, 0.0), evaluator.mass * a0
    gaps = measure_gaps(closing_pins(tree), lambda point: position(q, point))
    load = float(np.abs(Q).max() + np.abs(inertial).max())
    return OpenTree(q, (speeds * evaluator.mass) @ speeds.T, speeds @ (Q - inertial), load, gaps)


def require_agreement(pairs: Mapping[str, tuple[Array, Array, float]], tolerance: float) -> None:
    """Check that the model of a library agrees with the linkage: differences are at most the tolerance times their scale.

    Args:
        pairs: name of a quantity -> its value in the model, its value in the linkage, and the scale of a difference.

    Raises:
        RunFailure: a difference is larger, or not a number.
    """
    for name, (own, expected, scale) in pairs.items():
        error = np.abs(own - expected).max(initial=0.0)
        if not error <= tolerance * scale:  # written so that NaN fails too
            raise RunFailure(Status.ERROR, f"the built model differs from the linkage: {name} by {error:.1e} (scale {scale:.1e})")


def size(x: Array) -> float:
    """Return the largest absolute entry of x, but at least 1."""
    return float(np.abs(x).max(initial=1.0))


def finite_acceleration(t: float, a: Array, library: str) -> Array:
    """Return the accelerations a (n,) that a library computed at time t [s]; a RunFailure if some are not finite."""
    if not np.isfinite(a).all():
        raise RunFailure(Status.NAN, f"t = {t:.6g} s: {library}'s acceleration is not finite")
    return a


def spatial(x: Any) -> list[float]:
    """Return a vector (2,) of the plane as a vector of space, with z = 0."""
    return [float(x[0]), float(x[1]), 0.0]
