"""Accelerations that are wrong, and what would make them so: every explanation predicts the difference at the same states.

The engine's accelerations minus the linkage's own, y (k, n), are held against what each explanation says they would be: a link's
mass or inertia, gravity, a number of a force, a torque on another link, two links' masses exchanged, velocity terms or a driver's
second derivative left out, a joint left out, constraint data of the step before or of the start, all accelerations too large by a
factor. An explanation has one free amount c, found by least squares in the metric of the mass matrix (as in Gauss's principle):

    share = 1 - |y - c x|^2 / |y|^2

What is left out or exchanged is so once or not at all: there c must be near 1. Masses and inertias enter nonlinearly, so that their
amount is refined on the accelerations themselves.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from gauss_bench.diagnosis.causes import Cause
from gauss_bench.diagnosis.motion import OwnMotion
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Angle, Force, Link, Mechanism, PointForce, Torque
from gauss_bench.mechanism.tree import spanning_tree
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

SMALL = 1e-4  # relative change of a parameter by which its effect is measured
REFINEMENTS = 8
SCREENED = 0.5  # of the squares: what a straight line leaves where it is worth while to follow the curve
NUMBERS = ("value", "k", "c", "rest")  # of forces
ONCE = 0.15  # what is left out once has an amount of 1, within what an integrator's error spoils
GIVEN = 9.81  # [m/s^2] gravity where the linkage has none

Effect = Callable[[float], Array]


@dataclass(frozen=True, eq=False)
class Explanation:
    """One thing that may be wrong.

    Attributes:
        cause: of the error.
        what: in words, such as "inertia of crank".
        effect: amount -> (k, n), what it changes of the accelerations.
        once: whether it is so or not, with no amount between.
        linear: whether the effect is proportional to the amount.
        sentence: amount -> what is to be said of it.
        exact: whether it is believed only where it leaves nothing but noise: one of so many numbers fits anything a little.
    """

    cause: Cause
    what: str
    effect: Effect
    sentence: Callable[[float], str]
    once: bool = False
    linear: bool = True
    exact: bool = False


@dataclass(frozen=True)
class Explained:
    """How well one explanation does.

    Attributes:
        cause, what: of the explanation; amount: that fits best; share: of the squared difference that it explains, at most 1.
        sentence: what is to be said.
        residual: of the accelerations, relative, when the cause is planted by that amount.
    """

    cause: Cause
    what: str
    amount: float
    share: float
    sentence: str
    residual: float = np.nan


def explain(y: Array, mass: Array, some: Iterator[Explanation], a: Array | None = None, noise: float = 0.0) -> list[Explained]:
    """All explanations of differences y (k, n) from accelerations a, the best first; none of what has no effect.

    Those that leave no more than `noise` (relative to a) cannot be told apart and stand in the order in which they were tried.
    """
    root = np.sqrt(mass)
    target = (y * root).ravel()
    whole = float(np.linalg.norm(y * root if a is None else a * root)) or 1.0
    explanations: list[Explained] = []
    for one in some:
        fit = _fit(one, target, root, whole)
        if fit is None or (one.exact and not fit.residual <= noise):
            continue
        if all(fit.sentence != x.sentence for x in explanations):
            explanations.append(fit)
    return sorted(explanations, key=lambda x: -np.inf if x.residual <= noise else -x.share)


def candidates(explanations: list[Explained], noise: float) -> list[Explained]:
    """Those that reproduce the accelerations within their noise when they are planted by the amount named."""
    return [x for x in explanations if x.residual <= noise]


def _fit(one: Explanation, target: Array, root: Array, size_of_all: float) -> Explained | None:
    def effect(amount: float) -> Array:
        return np.asarray((one.effect(amount) * root).ravel())

    unit = 1.0 if one.linear else SMALL
    column = effect(unit) / unit
    size, whole = float(column @ column), float(target @ target)
    if not (np.isfinite(size) and size > 0 and whole > 0):
        return None
    amount = float(column @ target) / size
    left = target - column * amount
    if one.exact and float(left @ left) > SCREENED * whole:
        return None
    if not one.linear:
        amount, left = _refine(effect, target, float(np.clip(amount, -0.9, 9.0)))
    share = 1.0 - float(left @ left) / whole
    if not np.isfinite(share) or (one.once and abs(amount - 1.0) > ONCE):
        return None
    planted = 1.0 if one.once else amount
    residual = float(np.linalg.norm(target - effect(planted))) / size_of_all
    return Explained(one.cause, one.what, amount, share, one.sentence(amount), residual)


def _refine(effect: Effect, target: Array, amount: float) -> tuple[float, Array]:
    """The amount of least squares and what is left, by Gauss and Newton's steps; a parameter stays positive."""
    left = target - effect(amount)
    for _ in range(REFINEMENTS):
        slope = (effect(amount + SMALL) - effect(amount - SMALL)) / (2 * SMALL)
        better = float(np.clip(amount + (slope @ left) / max(float(slope @ slope), 1e-300), -0.95, 20.0))
        after = target - effect(better)
        if not float(after @ after) < float(left @ left):
            break
        amount, left = better, after
    return amount, left


def of_parameters(own: OwnMotion, x: States) -> Iterator[Explanation]:
    """Explanations by wrong numbers of a linkage, at states x."""
    mechanism, parts = own.mechanism, own.parts(x)
    base = parts.accelerations()

    def modelled(altered: Mechanism) -> Array:
        there = Evaluator(altered)
        return replace(parts, mass=there.mass, Q=there.applied.generalised(x.q, x.v, x.t)).accelerations() - base

    def of_link(k: int, key: str) -> Effect:
        return lambda c: modelled(with_link(mechanism, k, key, 1 + c))

    for k, link in enumerate(mechanism.links):
        for key, cause in (("inertia", Cause.INERTIA), ("mass", Cause.MASS)):
            what = f"{key} of {link.name}"
            yield Explanation(cause, what, of_link(k, key), partial_words(f"the {what}"), linear=False)
    for keys, cause, what in OF_ALL_LINKS:

        def of_links(c: float, keys: tuple[str, ...] = keys) -> Array:
            links = tuple(replace(link, **{key: getattr(link, key) * (1 + c) for key in keys}) for link in mechanism.links)
            return modelled(replace(mechanism, links=links))

        yield Explanation(cause, what, of_links, plural_words(what), linear=False)
    yield from of_all_forces(own, x)
    for i, j in combinations(range(len(mechanism.links)), 2):
        names = f"{mechanism.links[i].name} and {mechanism.links[j].name}"
        swapped = modelled(exchange(mechanism, i, j))
        yield once(Cause.ORDER, f"masses of {names}", swapped, f"{names} have each other's mass and inertia")
    yield from of_gravity(mechanism, modelled)
    for at, force in enumerate(mechanism.forces):
        for key in NUMBERS:
            value = np.asarray(getattr(force, key, 0.0), dtype=float)
            if value.any():
                scaled = modelled(with_force(mechanism, at, replace(force, **{key: 2 * getattr(force, key)})))
                what = f"{key} of force {force.name}"
                yield Explanation(Cause.FORCE, what, proportional(scaled), partial_words(f"{key} of the force {force.name}"))
        if isinstance(force, Torque):
            for k, link in enumerate(mechanism.links):
                if k != force.link:
                    elsewhere = modelled(with_force(mechanism, at, replace(force, link=k)))
                    said = f"the torque {force.name} acts on {link.name} instead of {mechanism.link_name(force.link)}"
                    yield once(Cause.ORDER, f"link of torque {force.name}", elsewhere, said)
        if isinstance(force, PointForce):
            turned = modelled(with_force(mechanism, at, replace(force, value=np.array([-force.value[1], force.value[0]]))))
            yield Explanation(
                Cause.FORCE,
                f"direction of force {force.name}",
                proportional(turned),
                partial_direction(force.name),
            )


COORDINATES = ("x", "y", "theta")
OF_ALL_LINKS = (
    (("inertia",), Cause.INERTIA, "all inertias"),
    (("mass",), Cause.MASS, "all masses"),
    (("mass", "inertia"), Cause.MASS, "all masses and inertias"),
)


def of_all_forces(own: OwnMotion, x: States) -> Iterator[Explanation]:
    """Forces of one kind, or all of them, of another size or sign."""
    mechanism, parts = own.mechanism, own.parts(x)
    base = parts.accelerations()

    def pushed(forces: tuple[Force, ...]) -> Array:
        alone = Evaluator(replace(mechanism, forces=forces, gravity=0 * np.asarray(mechanism.gravity)))
        return alone.applied.generalised(x.q, x.v, x.t)

    angular = tuple(f for f in mechanism.forces if all(isinstance(getattr(y, "coordinate", None), Angle) for y in f.lowered()))
    moments = np.where(np.arange(mechanism.n) % 3 == 2, parts.Q, 0.0)
    sums = [("all angular forces", pushed(angular)), ("all moments on links", moments)]
    sums += [("all forces but gravity", pushed(mechanism.forces)), ("all forces and gravity", parts.Q)]
    sums += [(f"all of the force {f.name}", pushed((f,))) for f in mechanism.forces]
    for what, Q in sums:
        effect = replace(parts, Q=parts.Q + Q).accelerations() - base
        yield Explanation(Cause.FORCE, what, proportional(effect), plural_words(what), exact=True)


def of_numbers_of_constraints(own: OwnMotion, x: States) -> Iterator[Explanation]:
    """Entries, rows and velocity terms of the constraints of another size."""
    mechanism, parts = own.mechanism, own.parts(x)
    base, rows = parts.accelerations(), own.evaluator.constraints
    names = [f"{joint.name}, {part}" for joint in mechanism.joints for part in ("first row", "second row")]
    names += [x.name for x in mechanism.couplings for _ in x.held]
    names += [driver.name for driver in mechanism.drivers] + [edge.name for edge in mechanism.knife_edges]
    second = np.zeros_like(parts.gamma)
    for row, law in enumerate(rows.laws, rows.joint_rows):
        second[:, row] = np.asarray(law(x.t)[2])
    bias = parts.gamma - second
    several = [("the velocity terms of the constraints (J' v)", slice(None))]
    several += [(f"the velocity terms (J' v) of {name}", slice(k, k + 1)) for k, name in enumerate(names)]
    for what, some in several:
        more = parts.gamma.copy()
        more[:, some] += bias[:, some]
        effect = replace(parts, gamma=more).accelerations() - base
        yield Explanation(Cause.VELOCITY_TERMS, what, proportional(effect), plural_words(what), exact=True)

    def scaled(row: int, column: int | slice) -> Effect:
        def effect(c: float) -> Array:
            J = parts.J.copy()
            J[:, row, column] *= 1 + c
            return replace(parts, J=J).accelerations() - base

        return effect

    for row, name in enumerate(names):
        what = f"Jacobian's row of {name}"
        yield Explanation(Cause.JACOBIAN, what, scaled(row, slice(None)), partial_words(f"the {what}"), linear=False, exact=True)
        for column in np.flatnonzero(parts.J[:, row].any(axis=0)):
            what = f"Jacobian's entry ({name}; {COORDINATES[column % 3]} of {mechanism.links[column // 3].name})"
            yield Explanation(
                Cause.JACOBIAN, what, scaled(row, int(column)), partial_words(f"the {what}"), linear=False, exact=True
            )


def of_gravity(mechanism: Mechanism, modelled: Callable[[Mechanism], Array]) -> Iterator[Explanation]:
    """Gravity of another size or sign; where there is none, some along x or y."""
    g = np.asarray(mechanism.gravity, dtype=float)
    if g.any():
        doubled = modelled(replace(mechanism, gravity=2 * g))

        def words(c: float) -> str:
            if abs(c + 2) < ONCE:
                return f"gravity has the wrong sign: it acts along ({0 - g[0]:g}, {0 - g[1]:g}) m/s^2, not ({g[0]:g}, {g[1]:g})"
            return "gravity is left out" if abs(c + 1) < ONCE / 10 else f"gravity is {percent(c)}"

        yield Explanation(Cause.GRAVITY, "gravity", proportional(doubled), words)
    across = [(np.array([-g[1], g[0]]), "across itself")] if g.any() else [(GIVEN * axis, name) for axis, name in AXES]
    for vector, name in across:
        added = modelled(replace(mechanism, gravity=g + vector))
        yield Explanation(
            Cause.GRAVITY,
            f"gravity {name}",
            proportional(added),
            words_of("gravity has a part {:.3g} m/s^2 " + name + " that it should not have", float(np.hypot(*vector))),
        )


AXES = ((np.array([1.0, 0.0]), "along x"), (np.array([0.0, 1.0]), "along y"))


def of_constraints(own: OwnMotion, x: States, before: States, start: States) -> Iterator[Explanation]:
    """Explanations by wrong constraints, at states x: left out, without velocity terms, old."""
    mechanism, parts = own.mechanism, own.parts(x)
    base, rows = parts.accelerations(), own.evaluator.constraints

    def changed(J: Array = parts.J, gamma: Array = parts.gamma) -> Array:
        return replace(parts, J=J, gamma=gamma).accelerations() - base

    held: dict[str, list[int]] = {}
    for k, joint in enumerate(mechanism.joints):
        held.setdefault(joint.joint, []).extend([2 * k, 2 * k + 1])
    closing = sorted(row for joint in spanning_tree(mechanism).closures for row in held[joint.joint])
    dropped = {f"the joint {name} is": some for name, some in held.items()} | {"the loops' closing joints are": closing}
    dropped |= {"all constraints are": list(range(rows.m))}
    for name, some in dropped.items():
        free = parts.without(some).accelerations() - base
        said = f"{name} left out: nothing holds what it should"
        yield once(Cause.IGNORED, name.removesuffix(" is").removesuffix(" are"), free, said)
    bare = parts.gamma.copy()
    second = np.zeros_like(bare)
    for row, law in enumerate(rows.laws, rows.joint_rows):
        second[:, row] = np.asarray(law(x.t)[2])
        one = parts.gamma.copy()
        one[:, row] -= second[:, row]
        name = mechanism.drivers[row - rows.joint_rows].name
        said = f"the second time derivative of what {name} prescribes is left out"
        yield once(Cause.SECOND_RATE, f"second derivative of {name}", changed(gamma=one), said)
    bare[:, : rows.holonomic] = second[:, : rows.holonomic]
    said = "the velocity terms of the constraints (J' v) are left out"
    yield once(Cause.VELOCITY_TERMS, "velocity terms of all constraints", changed(gamma=bare), said)
    for name, some in held.items():
        one = parts.gamma.copy()
        one[:, some] = 0.0
        said = f"the velocity terms (J' v) of the joint {name} are left out"
        yield once(Cause.VELOCITY_TERMS, f"velocity terms of joint {name}", changed(gamma=one), said)
    old, first = own.parts(before), own.parts(start)
    J0, gamma0 = np.broadcast_to(first.J, parts.J.shape), np.broadcast_to(first.gamma, parts.gamma.shape)
    for what, effect in (("Jacobian", changed(J=J0)), ("Jacobian and bias", changed(J0, gamma0))):
        yield once(Cause.STALE, f"{what} of the start", effect, f"the constraints' {what.lower()} stays that of the start")
    for what, effect in (("Jacobian", changed(J=old.J)), ("Jacobian and bias", changed(old.J, old.gamma))):
        yield Explanation(
            Cause.STALE,
            f"{what} of earlier steps",
            proportional(effect),
            words_of("the constraints' " + what.lower() + " is {:.2g} steps old"),
        )


def of_all(own: OwnMotion, x: States) -> Iterator[Explanation]:
    """All accelerations too large or too small."""
    yield Explanation(
        Cause.ACCELERATIONS, "all accelerations", proportional(own.accelerations(x)), partial_words("every acceleration")
    )


def proportional(effect: Array) -> Effect:
    return lambda c: c * effect


def once(cause: Cause, what: str, effect: Array, sentence: str) -> Explanation:
    """An explanation that is so or not, without a size."""
    return Explanation(cause, what, proportional(effect), lambda c: sentence, once=True)


def partial_direction(name: str) -> Callable[[float], str]:
    said = f"the force {name} has another direction"
    return lambda c: said


def words_of(text: str, unit: float = 1.0) -> Callable[[float], str]:
    """A sentence with the amount, in some unit, where the text has a place for it."""
    return lambda c: text.format(c * unit)


def percent(c: float) -> str:
    """A relative change in words."""
    return f"{abs(100 * c):.3g} % too {'large' if c > 0 else 'small'}"


def partial_words(what: str) -> Callable[[float], str]:
    def words(c: float) -> str:
        if abs(c + 1) < ONCE / 10:
            return f"{what} is left out"
        return f"{what} has the wrong sign" if abs(c + 2) < ONCE / 10 else f"{what} is {percent(c)}"

    return words


def plural_words(what: str) -> Callable[[float], str]:
    def words(c: float) -> str:
        if abs(c + 1) < ONCE / 10:
            return f"{what} are left out"
        return f"{what} have the wrong sign" if abs(c + 2) < ONCE / 10 else f"{what} are {percent(c)}"

    return words


def with_link(mechanism: Mechanism, at: int, key: str, factor: float) -> Mechanism:
    links = [replace(x, **{key: getattr(x, key) * factor}) if k == at else x for k, x in enumerate(mechanism.links)]
    return replace(mechanism, links=tuple(links))


def exchange(mechanism: Mechanism, i: int, j: int) -> Mechanism:
    """Two links with each other's mass and inertia."""
    links = list(mechanism.links)
    links[i], links[j] = with_masses_of(links[i], links[j]), with_masses_of(links[j], links[i])
    return replace(mechanism, links=tuple(links))


def with_masses_of(link: Link, other: Link) -> Link:
    return replace(link, mass=other.mass, inertia=other.inertia)


def with_force(mechanism: Mechanism, at: int, force: object) -> Mechanism:
    forces = [force if k == at else x for k, x in enumerate(mechanism.forces)]
    return replace(mechanism, forces=tuple(forces))  # type: ignore[arg-type]
