"""Explain wrong accelerations: each explanation predicts the error of the accelerations that a fault would cause.

y (k, n) is the error of the engine's accelerations at k of its own states, and x (k, n) is the error that a fault of unit amount
would cause. The amount c of a fault, its size relative to the unit amount, is fitted by least squares in the metric of the mass
matrix, as in Gauss's principle. The share of the squared error that the fault explains is

    share = 1 - |y - c x|^2 / |y|^2

A fault that is either present or not, such as a missing joint, is accepted only if its c is near 1. The amount of a wrong mass,
inertia or entry of J, which changes the accelerations nonlinearly, is refined by Gauss-Newton steps.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from gauss_bench.diagnosis.causes import Cause
from gauss_bench.diagnosis.motion import OwnMotion
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Force, PointForce, Torque, turns_only
from gauss_bench.mechanism.spaces import angles
from gauss_bench.terms import Array
from gauss_bench.trajectory import States

SMALL = 1e-4  # relative change of a parameter for which its effect is computed
REFINEMENTS = 8  # largest number of Gauss-Newton steps
LEAST_AMOUNT, MOST_AMOUNT = -0.95, 20.0  # limits of an amount that is refined; the first keeps masses positive
SCREENED = 0.5  # an exact explanation is considered only if its linear fit leaves at most this share of |y|^2
NUMBERS = ("value", "k", "c", "rest")  # attributes of forces that may be wrong
ONCE = 0.15  # largest |c - 1| of a fault that is present or not; errors of the integrator disturb the fit
EXACTLY = 0.015  # largest difference of an amount from -1 ("left out") or -2 ("has the wrong sign")
ADDED_GRAVITY = 9.81  # [m/s^2] size of a wrong gravity in a linkage without gravity
# faults of all links at once: name, cause, attributes of links that are wrong by the same factor
SCALED = (
    ("all inertias", Cause.INERTIA, ["inertia"]),
    ("all masses", Cause.MASS, ["mass"]),
    ("all masses and inertias", Cause.MASS, ["mass", "inertia"]),
)
COORDINATES = ("x", "y", "theta")
ORDINALS = ("first", "second", "third")  # of the rows of a joint


@dataclass(frozen=True, eq=False)
class Explanation:
    """One possible fault.

    Attributes:
        what: the fault in words, such as "inertia of crank".
        effect: (k, n) change of the accelerations for an amount of 1, or a function amount -> (k, n) if it is not proportional.
        template: sentence on the fault, with the placeholder {is}, {are} or {amount}, which `tell` replaces.
        once: whether the fault is either present or not, such as a missing joint, so that its fitted amount must be about 1.
        exact: whether the fault must reproduce the error to within the noise, because some of many faults fit a part by chance.
    """

    cause: Cause
    what: str
    effect: Array | Callable[[float], Array]
    template: str
    once: bool = False
    exact: bool = False

    def effect_of(self, amount: float) -> Array:
        """Return the change (k, n) of the accelerations that a fault of this amount causes."""
        return self.effect(amount) if callable(self.effect) else amount * self.effect


@dataclass(frozen=True)
class Explained:
    """The fit of one possible fault to an engine's wrong accelerations.

    Attributes:
        cause: the cause of the error to which the fault belongs.
        what: the fault in words, such as "inertia of crank".
        amount: size of the fault that fits best; share: share of the squared error that a fault of this size explains, at most 1.
        sentence: a sentence on the fault and its size.
        residual: relative error of the accelerations that remains if a fault of this size is taken into account.
    """

    cause: Cause
    what: str
    amount: float
    share: float
    sentence: str
    residual: float = np.nan


def tell(template: str, amount: float) -> str:
    """Return the sentence `template` with {amount} as a number, and {is} or {are} as a relative change in words.

    A relative change of -1 is "left out", and one of -2 "has the wrong sign".
    """
    off = f"{abs(100 * amount):.3g} % too {'large' if amount > 0 else 'small'}"
    words = {"amount": f"{amount:.2g}"}
    for be, have in (("is", "has"), ("are", "have")):
        words[be] = f"{be} {off}"
        if abs(amount + 1) < EXACTLY:
            words[be] = f"{be} left out"
        elif abs(amount + 2) < EXACTLY:
            words[be] = f"{have} the wrong sign"
    return template.format(**words)


def explain(y: Array, mass: Array, tried: Iterator[Explanation], a: Array | None = None, noise: float = 0.0) -> list[Explained]:
    """Fit possible faults to errors y (k, n) of accelerations; return the fits within the noise, then the others, the best first.

    Faults without an effect are left out, and also `exact` faults whose residual exceeds the noise.

    Args:
        mass: (n,) diagonal of the mass matrix, by which squared errors are weighted.
        a: (k, n) correct accelerations, by whose size residuals are divided; by default by the size of y.
        noise: relative error that correct accelerations may have.
    """
    root = np.sqrt(mass)
    target = (y * root).ravel()
    norm = float(np.linalg.norm(y * root if a is None else a * root)) or 1.0
    fits: dict[str, Explained] = {}  # by sentence: of faults with the same sentence, the first counts
    for explanation in tried:
        fit = _fit(explanation, target, root, norm)
        if fit is not None and (fit.residual <= noise or not explanation.exact):
            fits.setdefault(fit.sentence, fit)
    # fits within the noise keep their order; of the others, the largest share comes first
    return sorted(fits.values(), key=lambda x: -np.inf if x.residual <= noise else -x.share)


def candidates(explanations: list[Explained], noise: float) -> list[Explained]:
    """Return those of the fitted faults that reproduce the engine's wrong accelerations to within the numerical noise."""
    return [x for x in explanations if x.residual <= noise]


def _fit(x: Explanation, target: Array, root: Array, norm: float) -> Explained | None:
    """Fit the amount of a possible fault to errors of accelerations; return None if the fault has no effect or does not fit.

    `target` (k n,) has the errors times the square roots `root` (n,) of the masses. The residual is divided by `norm`.
    """

    def effect(amount: float) -> Array:
        """Return the change (k n,) of the accelerations that a fault causes, weighted like `target`."""
        return np.asarray((x.effect_of(amount) * root).ravel())

    unit = SMALL if callable(x.effect) else 1.0
    column = effect(unit) / unit  # the effect of an amount of 1 if the effect is proportional; else its derivative at zero
    column_square, target_square = float(column @ column), float(target @ target)
    if not (np.isfinite(column_square) and column_square > 0 and target_square > 0):
        return None
    amount = float(column @ target) / column_square
    residual = target - column * amount
    # this avoids the refinement of most exact explanations, which are many
    if x.exact and float(residual @ residual) > SCREENED * target_square:
        return None
    if callable(x.effect):  # not proportional to the amount; the refinement starts at a factor 1 + amount of 0.1 to 10
        amount, residual = _refine(effect, target, float(np.clip(amount, -0.9, 9.0)))
    share = 1.0 - float(residual @ residual) / target_square
    if not np.isfinite(share) or (x.once and abs(amount - 1.0) > ONCE):
        return None
    relative_residual = float(np.linalg.norm(target - effect(1.0 if x.once else amount))) / norm
    return Explained(x.cause, x.what, amount, share, tell(x.template, amount), relative_residual)


def _refine(effect: Callable[[float], Array], target: Array, amount: float) -> tuple[float, Array]:
    """Refine the amount of a fault by Gauss-Newton steps from a guess; return the amount and the residual (k n,).

    `effect` maps an amount to the weighted change (k n,) of the accelerations.
    """
    residual = target - effect(amount)
    for _ in range(REFINEMENTS):
        slope = (effect(amount + SMALL) - effect(amount - SMALL)) / (2 * SMALL)
        change = float(slope @ residual) / max(float(slope @ slope), 1e-300)
        new_amount = float(np.clip(amount + change, LEAST_AMOUNT, MOST_AMOUNT))
        new_residual = target - effect(new_amount)
        if not float(new_residual @ new_residual) < float(residual @ residual):
            break
        amount, residual = new_amount, new_residual
    return amount, residual


def parameter_explanations(own: OwnMotion, x: States) -> Iterator[Explanation]:
    """Yield the possible faults with a wrong parameter of a link, gravity or a force; x has the k states of the errors."""
    mechanism, parts = own.mechanism, own.parts(x)

    def change_by(**changes: Any) -> Array:
        """Return the change (k, n) of the accelerations if attributes of the mechanism are replaced."""
        changed = Evaluator(replace(mechanism, **changes))
        return parts.effect(mass=changed.mass, Q=changed.applied.generalised(x.q, x.v, x.t))

    def scale_links(names: Sequence[str], keys: Sequence[str], c: float) -> Array:
        """Return the change (k, n) of the accelerations if attributes `keys` of the named links are multiplied by 1 + c."""
        links: list[Any] = list(mechanism.links)
        scaled = [replace(x, **{key: getattr(x, key) * (1 + c) for key in keys}) if x.name in names else x for x in links]
        return change_by(links=tuple(scaled))

    def change_force(number: int, **changes: Any) -> Array:
        """Return the change (k, n) of the accelerations if attributes of the force with this number are replaced."""
        return change_by(forces=tuple(replace(f, **changes) if k == number else f for k, f in enumerate(mechanism.forces)))

    names = [link.name for link in mechanism.links]
    for name in names:
        for key, cause in (("inertia", Cause.INERTIA), ("mass", Cause.MASS)):
            yield Explanation(cause, f"{key} of {name}", partial(scale_links, [name], [key]), f"the {key} of {name} {{is}}")
    for what, cause, keys in SCALED:
        yield Explanation(cause, what, partial(scale_links, names, keys), f"{what} {{are}}")
    yield from force_explanations(own, x)
    # two links with exchanged masses and inertias
    for i, j in combinations(range(len(names)), 2):
        links, both = list(mechanism.links), f"{names[i]} and {names[j]}"
        for k, other in ((i, mechanism.links[j]), (j, mechanism.links[i])):
            links[k] = replace(links[k], mass=other.mass, inertia=other.inertia)
        swapped = change_by(links=tuple(links))
        yield Explanation(Cause.ORDER, f"masses of {both}", swapped, f"{both} have each other's mass and inertia", once=True)
    # gravity of a wrong size, or with an additional part in another direction
    g = np.asarray(mechanism.gravity, dtype=float)
    if g.any():
        yield Explanation(Cause.GRAVITY, "gravity", change_by(gravity=2 * g), "gravity {is}")
        directions = {"across itself": np.array([-g[1], g[0]])}
    else:
        directions = {"along x": np.array([ADDED_GRAVITY, 0.0]), "along y": np.array([0.0, ADDED_GRAVITY])}
    for name, vector in directions.items():
        template = f"gravity has an additional component {name}, {{amount}} times {float(np.hypot(*vector)):.3g} m/s^2"
        yield Explanation(Cause.GRAVITY, f"gravity {name}", change_by(gravity=g + vector), template)
    # one force with a wrong number, on a wrong link or in a wrong direction
    for number, force in enumerate(mechanism.forces):
        for key in NUMBERS:
            value = getattr(force, key, 0.0)
            if np.any(value):
                doubled, what = change_force(number, **{key: 2 * value}), f"{key} of force {force.name}"
                yield Explanation(Cause.FORCE, what, doubled, f"{key} of the force {force.name} {{is}}")
        if isinstance(force, Torque):
            for k in {*range(len(names))} - {force.link}:
                template = f"the torque {force.name} acts on {names[k]} instead of {mechanism.link_name(force.link)}"
                yield Explanation(Cause.ORDER, f"link of torque {force.name}", change_force(number, link=k), template, once=True)
        if isinstance(force, PointForce):
            turned = change_force(number, value=np.array([-force.value[1], force.value[0]]))
            template = f"the force {force.name} has another direction"
            yield Explanation(Cause.FORCE, f"direction of force {force.name}", turned, template)


def force_explanations(own: OwnMotion, x: States) -> Iterator[Explanation]:
    """Yield the possible faults in which a force or a sum of forces has a wrong factor; an amount of -1 leaves them out."""
    mechanism, parts = own.mechanism, own.parts(x)

    def force_of(*forces: Force) -> Array:
        """Return the generalised force (k, n) of the given forces alone, without gravity and other forces."""
        alone = Evaluator(replace(mechanism, forces=forces, gravity=0 * np.asarray(mechanism.gravity)))
        return alone.applied.generalised(x.q, x.v, x.t)

    angular = [f for f in mechanism.forces if turns_only(f)]
    moments = np.zeros_like(parts.Q)
    angles(moments)[...] = angles(parts.Q)  # the entries of Q that belong to angles
    sums = {"all angular forces": force_of(*angular), "all moments on links": moments}
    sums |= {"all forces but gravity": force_of(*mechanism.forces), "all forces and gravity": parts.Q}
    sums |= {f"all of the force {f.name}": force_of(f) for f in mechanism.forces}
    for what, Q in sums.items():  # an amount of 1: the sum Q acts once more
        yield Explanation(Cause.FORCE, what, parts.effect(Q=parts.Q + Q), f"{what} {{are}}", exact=True)  # {are}: see `tell`


def entry_explanations(own: OwnMotion, x: States) -> Iterator[Explanation]:
    """Yield the possible faults with a wrong factor on velocity terms, or on entries or rows of J; -1 leaves them out."""
    mechanism, parts = own.mechanism, own.parts(x)
    # `part`: which held coordinate of a joint the row belongs to; empty for couplings, drivers and knife edges
    names = [f"{row.owner}, {ORDINALS[row.place]} row" if row.part else row.owner for row in mechanism.row_names]
    columns = [f"{coordinate} of {link.name}" for link in mechanism.links for coordinate in COORDINATES]
    bias = parts.gamma - own.second_rates(x)  # (k, m) velocity terms -J' v
    rows = {"the velocity terms of the constraints (J' v)": slice(None)}
    rows |= {f"the velocity terms (J' v) of {name}": slice(k, k + 1) for k, name in enumerate(names)}
    for what, selected in rows.items():
        gamma = parts.gamma.copy()
        gamma[:, selected] += bias[:, selected]  # the velocity terms count twice: an amount of 1
        yield Explanation(Cause.VELOCITY_TERMS, what, parts.effect(gamma=gamma), f"{what} {{are}}", exact=True)

    def scale_entries(row: int, column: Any, c: float) -> Array:
        """Return the change (k, n) of the accelerations if the entries of J in this row and column are multiplied by 1 + c."""
        J = parts.J.copy()
        J[:, row, column] *= 1 + c
        return parts.effect(J=J)

    for row, name in enumerate(names):
        wrong: list[tuple[Any, str]] = [(slice(None), f"row of {name}")]  # columns that are wrong, and words for them
        wrong += [(k, f"entry ({name}; {columns[k]})") for k in np.flatnonzero(parts.J[:, row].any(axis=0))]
        for column, what in wrong:
            template = f"the Jacobian's {what} {{is}}"
            yield Explanation(Cause.JACOBIAN, f"Jacobian's {what}", partial(scale_entries, row, column), template, exact=True)


def constraint_explanations(own: OwnMotion, x: States, before: States, start: States) -> Iterator[Explanation]:
    """Yield the possible faults in which an engine leaves out constraints or some of their terms, or uses terms of another state.

    For constraint data of an earlier step, the amount is their age in steps. All other faults are present or not.

    Args:
        x: states at which the accelerations are compared; before: states one step earlier.
        start: the start state, repeated once for each state of `x`.
    """
    mechanism, parts = own.mechanism, own.parts(x)
    rows = own.evaluator.constraints

    def with_gamma(columns: Any, value: Array | float) -> Array:
        """Return the change (k, n) of the accelerations if these columns of gamma (k, m) are set to `value`."""
        gamma = parts.gamma.copy()
        gamma[:, columns] = value
        return parts.effect(gamma=gamma)

    rows_of: dict[str, list[int]] = {}  # name of a joint -> its rows; a pin through several links is several joints of one name
    first = 0  # the first row of a joint
    for joint in mechanism.joints:
        rows_of.setdefault(joint.joint, []).extend(range(first, first + len(joint.held)))
        first += len(joint.held)
    closing = sorted(row for joint in spanning_tree(mechanism).closures for row in rows_of[joint.joint])
    # constraints that are left out: name, verb of the sentence, rows
    dropped = [(f"the joint {name}", "is", indices) for name, indices in rows_of.items()]
    dropped += [("the loops' closing joints", "are", closing), ("all constraints", "are", list(range(rows.m)))]
    for what, be, indices in dropped:
        effect: Array = parts.without(indices).accelerations() - parts.unaltered
        yield Explanation(Cause.IGNORED, what, effect, f"{what} {be} left out", once=True)
    second = own.second_rates(x)  # (k, m), zero except for drivers
    for row, driver in enumerate(mechanism.drivers, rows.joint_rows):
        effect = with_gamma(row, parts.gamma[:, row] - second[:, row])
        template = f"the second time derivative of what {driver.name} prescribes is left out"
        yield Explanation(Cause.SECOND_RATE, f"second derivative of {driver.name}", effect, template, once=True)
    # velocity terms that are left out; gamma without velocity terms is `second`, which is zero for joints
    position = slice(0, rows.holonomic)
    terms = {"all constraints": ("the constraints (J' v)", with_gamma(position, second[:, position]))}
    terms |= {f"joint {name}": (f"the joint {name} (J' v)", with_gamma(indices, 0.0)) for name, indices in rows_of.items()}
    for what, (whose, effect) in terms.items():
        template = f"the velocity terms of {whose} are left out"
        yield Explanation(Cause.VELOCITY_TERMS, f"velocity terms of {what}", effect, template, once=True)
    # constraint data of an earlier state; {amount} in a sentence is filled in by `tell`
    for when, then, age in (("the start", start, "stays that of the start"), ("earlier steps", before, "is {amount} steps old")):
        old = own.parts(then)
        for what, effect in (("Jacobian", parts.effect(J=old.J)), ("Jacobian and bias", parts.effect(J=old.J, gamma=old.gamma))):
            template = f"the constraints' {what.lower()} {age}"
            yield Explanation(Cause.STALE, f"{what} of {when}", effect, template, once=then is start)


def every_explanation(own: OwnMotion, x: States, before: States, start: States) -> Iterator[Explanation]:
    """Yield every fault whose effect is fitted to the errors; the arguments are those of `constraint_explanations`."""
    yield from parameter_explanations(own, x)
    yield from constraint_explanations(own, x, before, start)
    yield Explanation(Cause.ACCELERATIONS, "all accelerations", own.accelerations(x), "every acceleration {is}")
    yield from entry_explanations(own, x)
