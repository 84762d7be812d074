"""Generated programs against the linkage's own evaluation, and what the generator promises about rows, pivots and costs."""

import tomllib
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from gauss_bench.compiler.elimination import program as elimination
from gauss_bench.compiler.elimination.function import Function, Instruction
from gauss_bench.compiler.elimination.partition import study
from gauss_bench.compiler.elimination.program import Program, generate, partitions
from gauss_bench.compiler.elimination.rank import acceleration_error
from gauss_bench.compiler.equations.sampling import manifold_states, scales
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node
from gauss_bench.compiler.machine.graph import Graph, inline
from gauss_bench.linkage.load import built_in, load, load_document
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import CoulombFriction, Mechanism
from gauss_bench.reference.absolute import AbsoluteCoordinates
from tests.conftest import DATA, everything, exhaustive, redundant

FILES = ("all_kinds", "loaded", "pushed", "slides", "swinging_block", "wedge")
FORMULATIONS = ("gauss", "lagrange")
ROUNDING = 1e-11  # relative, after eliminations of condition up to 1e4


@cache
def linkage(name: str, scenario: str | None = None) -> Mechanism:
    match name:
        case "everything":
            return everything()
        case "redundant":
            return redundant()
        case "pendulum_4" | "pendulum_8":
            return load_document(pendulum(int(name[-1])))
    return load(DATA / f"{name}.toml" if name in FILES else name, scenario)


@cache
def program(name: str, scenario: str | None, formulation: str, drop: int = 0) -> Program:
    return generate(linkage(name, scenario), formulation, drop=drop, remembered=True)  # by whichever process asks first


def pendulum(count: int) -> dict[str, Any]:
    """A chain of bars that hangs on a pin: as many degrees of freedom as bars."""
    bar = {"points": {"A": [0.0, 0.0], "B": [1.0, 0.0]}, "bars": [["A", "B"]], "mass": 1.0}
    names = [f"bar{k}" for k in range(count)]
    joints = {f"pin{k}": {"type": "revolute", "at": [f"bar{k - 1}.B" if k else "ground.O", f"bar{k}.A"]} for k in range(count)}
    angles = {name: 10.0 * k for k, name in enumerate(names)}
    start = {"angles_deg": angles, "speeds": dict.fromkeys(names, 1.0)}
    return {
        "format": "planar-linkage/1",
        "name": f"pendulum_{count}",
        "ground": {"points": {"O": [0.0, 0.0]}},
        "links": dict.fromkeys(names, bar),
        "joints": joints,
        "assembly": {"angles_deg": angles},
        "scenarios": {"swing": {"duration": 1.0, "start": start}},
    }


# Of each linkage its free motion under most forces and one law that drives it: `cycloid` and `conservative` are the same equations
# with another law, which `test_motion_laws_drive_as_they_do_in_the_linkage` sees, and with fewer forces.
CASES = [
    (name, scenario)
    for name in built_in()
    for scenario in load(name).scenarios
    if scenario not in ("cycloid", "conservative", "settles")
]
CASES += [(name, None) for name in (*FILES, "everything", "redundant", "pendulum_4", "n_four_bar_3")]
# every kind of joint, driver and force, redundant rows, a knife edge, several freedoms; the others are long together
QUICK = {("crank_slider", "paper"), ("sleigh", "glide"), ("everything", None), ("redundant", None), ("loaded", None)}


@cache
def states(mechanism: Mechanism, seeds: range) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """States over the whole motion, other than those the pivots were chosen at."""
    found = [manifold_states(mechanism, 40, seed) for seed in seeds]
    return [(float(t), q, v) for s in found for t, q, v in zip(s.t, s.q, s.v, strict=True)]


def values(function: Function, *arguments: Any) -> list[np.ndarray]:
    return function(*(np.atleast_1d(x) for x in arguments))


def trusted(p: Program, *state: Any) -> bool:
    return bool((np.abs(values(p.acceleration, *state, p.values)[1]) >= p.thresholds).all())


@pytest.mark.long("crank_slider-driven-gauss")
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(("name", "scenario"), exhaustive(CASES, *QUICK))
def test_motion_forces_and_energy_are_those_of_the_linkage(name: str, scenario: str | None, formulation: str) -> None:
    mechanism = linkage(name, scenario)
    evaluator, truth = Evaluator(mechanism), AbsoluteCoordinates(mechanism)
    tried = states(mechanism, range(10, 11))
    t, q, v = (np.array(x) for x in zip(*tried, strict=True))
    true, served = truth.acceleration(t, q, v), np.zeros(len(tried), dtype=bool)
    for drop in range(len(study(mechanism).drops)):
        p = program(name, scenario, formulation, drop)
        a, guards = p.acceleration(t[:, None], q, v, p.values)
        (multipliers,), (energy,) = p.multipliers(t[:, None], q, v, p.values), p.energy(q, v, p.values)
        usable = (np.abs(guards) >= p.thresholds).all(axis=1)
        served |= usable
        np.testing.assert_allclose(energy[:, 0], evaluator.energy(q, v), rtol=1e-13, atol=1e-13)
        for k in np.flatnonzero(usable):
            terms = evaluator.terms(t[k], q[k], v[k])
            size = max(np.abs(true[k]).max(), np.abs(terms.Q / evaluator.mass).max())  # driven, it can stand still under gravity
            assert np.abs(a[k] - true[k]).max() <= ROUNDING * size
            force = terms.Q - evaluator.mass * a[k]
            loads = np.abs(terms.J).T @ np.abs(multipliers[k])
            assert np.abs(terms.J.T @ multipliers[k] - force).max() <= ROUNDING * max(loads.max(), np.abs(terms.Q).max())
    assert served.mean() >= 0.9


@pytest.mark.parametrize(("name", "scenario"), exhaustive(CASES, *QUICK))
def test_residuals_and_energy_hold_off_the_constraints_too(name: str, scenario: str | None, rng: np.random.Generator) -> None:
    mechanism, p = linkage(name, scenario), program(name, scenario, "gauss")
    evaluator, h = Evaluator(mechanism), Evaluator(mechanism).constraints.holonomic
    t, q, v = (np.array(x) for x in zip(*states(mechanism, range(10, 11)), strict=True))
    q, v = q + 0.2 * scales(mechanism) * rng.normal(size=q.shape), v + rng.normal(size=v.shape)
    phi, phi_dot = p.residual(t[:, None], q, v, p.values)
    terms = [evaluator.terms(*state) for state in zip(t, q, v, strict=True)]
    np.testing.assert_allclose(phi, [x.phi[:h] for x in terms], atol=1e-13)
    np.testing.assert_allclose(phi_dot, [x.phi_dot for x in terms], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(p.energy(q, v, p.values)[0][:, 0], evaluator.energy(q, v), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(("name", "scenario"), exhaustive([c for c in CASES if c[0] != "everything"], *QUICK))
def test_corrections_bring_a_state_back(name: str, scenario: str | None, formulation: str, rng: np.random.Generator) -> None:
    """A state off by h is off by h^2 after one correction, and by h^k after k with the Jacobian of the first."""
    mechanism, p = linkage(name, scenario), program(name, scenario, formulation)
    evaluator = Evaluator(mechanism)
    h = 1e-4 * scales(mechanism)
    for t, q, v in states(mechanism, range(10, 11))[::8]:
        if not trusted(p, t, q, v):
            continue
        off = q + h * rng.normal(size=len(q))
        errors = [np.abs(evaluator.terms(t, off, v).phi).max(initial=0.0)]
        moved = off
        for _ in range(4):
            change = values(p.position_correction, t, off, t, moved, p.values)[0]
            moved = moved + change
            errors.append(np.abs(evaluator.terms(t, moved, v).phi).max(initial=0.0))
        assert errors[1] <= 0.05 * errors[0] + 1e-14
        assert errors[4] <= 1e-12  # four times a factor of at most 0.05, and rounding
        speed = v + rng.normal(size=len(v))
        speed = values(p.nearest_velocity, t, moved, speed, p.values)[0]
        assert np.abs(evaluator.terms(t, moved, speed).phi_dot).max(initial=0.0) <= 1e-10


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(("name", "scenario"), [("four_bar", "torque"), ("five_bar", "spring"), ("excavator", None)])
def test_a_correction_goes_the_shortest_way(name: str, scenario: str | None, formulation: str) -> None:
    """In metres and radians under either formulation, as where formulations are interpreted; with one freedom, two, and none."""
    mechanism, p = linkage(name, scenario), program(name, scenario, formulation)
    t, q, v = states(mechanism, range(1))[5]
    J = Evaluator(mechanism).terms(t, q, v).J
    motion = np.linalg.svd(J)[2][len(J) :]
    bent, off = v + np.linspace(-1.0, 1.0, len(v)), q + 1e-3 * np.linspace(-1.0, 1.0, len(q))
    faster = values(p.nearest_velocity, t, q, bent, p.values)[0] - bent
    moved = values(p.position_correction, t, q, t, off, p.values)[0]
    for change in (faster, moved):
        assert np.abs(motion @ change).max(initial=0.0) <= 1e-12 * np.abs(change).max()


def test_redundant_rows_are_dropped_by_name_and_what_is_dropped_carries_nothing() -> None:
    for name in ("parallelogram", "redundant"):
        mechanism = linkage(name, None)
        joints = {j.name for j in mechanism.joints}
        for formulation in FORMULATIONS:
            p = program(name, None, formulation)
            assert len(p.dropped) == mechanism.redundant
            assert p.m == 2 * len(mechanism.joints) + len(mechanism.drivers) - mechanism.redundant
            assert {x.rsplit(".", 1)[0] for x in p.dropped} <= joints
            multipliers = values(p.multipliers, 0.0, mechanism.q0, mechanism.v0, p.values)[0]
            dropped = study(mechanism).drops[0].directions(len(multipliers))
            assert np.abs(dropped @ multipliers).max() <= 1e-12 * np.abs(multipliers).max()
    assert {x.rsplit(".", 1)[0] for x in program("redundant", None, "gauss").dropped} <= {"D", "again"}


def test_redundant_drivers_are_refused() -> None:
    mechanism = linkage("four_bar", "driven")
    with pytest.raises(KernelError, match="redundant"):
        generate(replace(mechanism, drivers=mechanism.drivers * 2))


def crank_slider_at(angle: float) -> np.ndarray:
    tilt = -np.arcsin(0.15 * np.sin(angle) / 0.56)
    pin = 0.15 * np.array([np.cos(angle), np.sin(angle)])
    middle = pin + 0.28 * np.array([np.cos(tilt), np.sin(tilt)])
    return np.array([*(pin / 2), angle, *middle, tilt, pin[0] + 0.56 * np.cos(tilt), 0.0, 0.0])


@pytest.mark.parametrize(("independent", "dead", "good"), [((6,), 0.0, 1.0), ((5,), np.pi / 2, 0.3), ((1,), np.pi / 2, 0.3)])
def test_the_guard_falls_where_the_partition_is_singular(independent: tuple[int, ...], dead: float, good: float) -> None:
    """Slider position: both dead centres; rod angle and crank height: crank upright."""
    mechanism = linkage("crank_slider", "paper")
    p, v = generate(mechanism, "gauss", independent=independent), np.zeros(9)

    def guard(angle: float) -> float:
        found = values(p.acceleration, 0.0, crank_slider_at(angle), v, p.values)[1]
        return float((np.abs(found) / p.thresholds).min())

    for off in (0.0, 1e-8, 1e-5):
        assert guard(dead + off) < 1.0
    for angle in (good, dead + 0.02, dead - 0.02):
        assert guard(angle) >= 1.0
        a = values(p.acceleration, 0.0, crank_slider_at(angle), v, p.values)[0]
        true = AbsoluteCoordinates(mechanism).acceleration(np.zeros(1), crank_slider_at(angle)[None], v[None])[0]
        assert np.abs(a - true).max() <= 1e-9 * np.abs(true).max()  # two or three digits are lost where the guard is near


@pytest.mark.parametrize(
    "name", ["crank_slider", *(pytest.param(x, marks=pytest.mark.long) for x in [*built_in(), "n_four_bar_3"])]
)
def test_partitions_cover_the_motion_and_begin_with_the_crank(name: str) -> None:
    mechanism = linkage(name, load(name).scenarios[-1])
    found = partitions(mechanism)
    if not mechanism.drivers:
        free = mechanism.dof - len(mechanism.knife_edges)
        assert {len(x) for x in found} == {free}
        programs = [generate(mechanism, "gauss", independent=x, drop=k) for x in found for k in range(len(study(mechanism).drops))]
        for state in states(mechanism, range(10, 11)):
            assert any(trusted(p, *state) for p in programs)
    if mechanism.dof == 1 and not mechanism.drivers:
        assert mechanism.crank is not None
        assert found[0] == (3 * mechanism.crank + 2,)


@pytest.mark.long
def test_a_large_chain_costs_as_much_a_cell_as_a_small_one() -> None:
    small, large = (program(f"n_four_bar_{n}", None, "gauss").acceleration.operations for n in (4, 24))
    assert large <= 1.1 * 6 * small
    assert program("n_four_bar_24", None, "gauss").thresholds.size <= 3 * 24  # two unknowns a window, one pivot each, some extra


PROTOTYPE = {"crank_slider": (125, 3), "six_bar": (289, 12), "shaper": (264, 7), "eight_bar": (548, 20)}  # gravity alone


@pytest.mark.parametrize("name", ["shaper", *(pytest.param(x, marks=pytest.mark.long) for x in PROTOTYPE if x != "shaper")])
@pytest.mark.usefixtures("full_search")
def test_programs_are_shorter_than_plain_elimination_in_matrix_entries(name: str) -> None:
    mechanism = replace(linkage(name, "conservative"), forces=())
    found, (most, divisions) = generate(mechanism, "gauss").acceleration.costs, PROTOTYPE[name]
    assert found.operations < most
    assert found.divisions <= divisions


@pytest.mark.long
@pytest.mark.slow
def test_auto_takes_the_cheaper_formulation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elimination, "ATTEMPTS", 12)  # fewer do not find what makes eight pendulums cheap
    taken = {}
    for name in ("four_bar", "pendulum_8"):
        both = {f: generate(linkage(name, None), f).acceleration.costs.single for f in FORMULATIONS}
        taken[name] = generate(linkage(name, None), "auto").formulation
        assert taken[name] == min(both, key=lambda f: both[f])
    assert taken == {"four_bar": "gauss", "pendulum_8": "lagrange"}  # few unknowns where few are free


def test_the_same_linkage_gives_the_same_program() -> None:
    first, second = (generate(linkage("six_bar", "torque"), "gauss").acceleration.instructions for _ in range(2))
    assert first == second


LAWS = [
    {"law": "constant", "start_deg": 20.0, "speed": 3.0},
    {"law": "sine", "start_deg": 20.0, "travel_deg": 200.0, "time": 0.6},
    {"law": "cosine", "start_deg": 20.0, "travel_deg": 200.0, "time": 0.6},
    {"law": "poly345", "start_deg": 20.0, "travel_deg": 200.0, "time": 0.6},
    {"law": "table", "start_deg": 20.0, "rows": [[0.1, 0.0], [0.2, 15.0], [0.35, 70.0], [0.5, 60.0], [0.7, 120.0]]},
]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: str(law["law"]))
def test_motion_laws_drive_as_they_do_in_the_linkage(law: dict[str, Any]) -> None:
    document = tomllib.loads(built_in()["four_bar"].read_text(encoding="utf-8"))
    document["scenarios"]["driven"]["driver"] = {"link": "crank"} | law
    mechanism = load_document(document, "driven")
    p, evaluator = generate(mechanism), Evaluator(mechanism)
    truth = AbsoluteCoordinates(mechanism)
    for t in (-0.3, 0.05, 0.12, 0.3, 0.42, 0.55, 0.65, 0.9):  # before, in every piece, and after
        q, v = evaluator.project(t, mechanism.q0, mechanism.v0)
        a = values(p.acceleration, t, q, v, p.values)[0]
        true = truth.acceleration(np.array([t]), q[None], v[None])[0]
        assert np.abs(a - true).max() <= ROUNDING * max(np.abs(true).max(), 9.81)
        phi, phi_dot = values(p.residual, t, q, v + 1.0, p.values)
        np.testing.assert_allclose(phi, evaluator.terms(t, q, v + 1.0).phi, atol=1e-13)
        np.testing.assert_allclose(phi_dot, evaluator.terms(t, q, v + 1.0).phi_dot, rtol=1e-12, atol=1e-12)


OPEN = {
    "links.crank.mass": 0.5,
    "links.rod.inertia": 0.03,
    "links.rod.com.y": 0.01,
    "points.rod.B.x": 0.6,
    "points.ground.O.y": 0.02,
    "forces.motor.value": -1.5,
    "forces.spring.k": 9.0,
    "forces.spring.rest": 0.6,
    "gravity.y": -1.6,
    "joints.guide.offset": 0.03,
}


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_open_parameters_give_the_linkage_with_other_numbers(formulation: str) -> None:
    p = generate(linkage("crank_slider", "paper"), formulation, open_parameters=tuple(OPEN))
    assert p.parameters == tuple(OPEN)
    document = tomllib.loads(built_in()["crank_slider"].read_text(encoding="utf-8"))
    document["links"]["crank"] |= {"mass": 0.5}
    document["links"]["rod"] |= {"inertia": 0.03, "com": [0.28, 0.01]}
    document["links"]["rod"]["points"]["B"] = [0.6, 0.0]
    document["ground"]["points"]["O"] = [0.0, 0.02]
    document["forces"]["motor"]["value"] = -1.5
    document["forces"]["spring"] |= {"k": 9.0, "rest": 0.6}
    document["gravity"] = [0.0, -1.6]
    document["joints"]["guide"]["offset"] = 0.03
    document["links"]["crank"]["inertia"] = 0.37 * 0.15**2 / 12  # a uniform bar's would follow its mass
    other = load_document(document, "paper")
    closed = generate(other, formulation)
    t, q, v = (np.array(x) for x in zip(*states(other, range(10, 11)), strict=True))
    numbers = np.array(list(OPEN.values()))
    found, wanted = p.acceleration(t[:, None], q, v, numbers)[0], closed.acceleration(t[:, None], q, v, np.zeros(0))[0]
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(p.energy(q, v, numbers)[0][:, 0], Evaluator(other).energy(q, v), rtol=1e-12)


def test_baumgarte_bends_the_bias_of_every_row(rng: np.random.Generator) -> None:
    alpha, beta = 12.0, 7.0
    mechanism = linkage("five_bar", "spring")
    for formulation in FORMULATIONS:
        p, evaluator = generate(mechanism, formulation, baumgarte=(alpha, beta)), Evaluator(mechanism)
        for t, q, v in states(mechanism, range(10, 11))[::8]:
            q, v = q + 1e-3 * rng.normal(size=len(q)), v + 0.1 * rng.normal(size=len(v))
            terms = evaluator.terms(t, q, v)
            a = values(p.stabilized, t, q, v, p.values)[0]
            bias = terms.gamma - 2 * alpha * terms.phi_dot - beta**2 * terms.phi
            K = np.block([[terms.M, terms.J.T], [terms.J, np.zeros((len(terms.J),) * 2)]])
            true = np.linalg.solve(K, np.concatenate([terms.Q, bias]))[: len(q)]
            np.testing.assert_allclose(a, true, atol=1e-10 * np.abs(true).max())


def test_what_cannot_be_a_kernel_is_refused() -> None:
    mechanism = linkage("four_bar", "torque")
    rubbing = CoulombFriction("rub", mechanism.joints[:1], 0.1, 0.01, 0.1)
    with pytest.raises(KernelError, match="friction"):
        generate(replace(mechanism, frictions=(rubbing,)))
    with pytest.raises(KernelError, match=r"links\.crank\.weight"):
        generate(mechanism, open_parameters=("links.crank.weight",))
    with pytest.raises(KernelError, match="formulation"):
        generate(mechanism, "newton")
    with pytest.raises(KernelError, match="1 independent"):
        generate(mechanism, "gauss", independent=(2, 5))
    with pytest.raises(KernelError, match="do not determine"):
        generate(linkage("crank_slider", "paper"), "gauss", independent=(8,))  # the slider's angle never changes


def graph_of(count: int) -> tuple[ExpressionGraph, list[Node]]:
    rng = np.random.default_rng(3)
    graph = ExpressionGraph(4)
    return graph, [graph.input("x", k, rng.normal(size=4), 1.0) for k in range(count)]


@pytest.mark.parametrize(("name", "formulation"), [("uneven_pivots_07", "lagrange"), ("uneven_pivots_50", "gauss")])
def test_pivots_that_serve_at_most_positions_alone_make_a_program(name: str, formulation: str) -> None:
    """Whatever is divided by is small somewhere on the motion: there the guard falls, and everywhere else the program is right."""
    m = load(str(DATA / f"{name}.toml"))
    made, found = generate(m, formulation), manifold_states(m, 40, seed=2)
    a, guard = made.acceleration(found.t[:, None], found.q, found.v, made.values)
    sound = (np.abs(guard) >= made.thresholds).all(axis=1)
    assert 0.25 * len(sound) < sound.sum()
    for k in np.flatnonzero(sound):
        assert acceleration_error(Evaluator(m), float(found.t[k]), found.q[k], found.v[k], a[k]) < 1e-9


def test_an_unknown_operation_is_refused_by_name() -> None:
    strange = Function((1,), (Instruction("INPUT", (0, 0)), Instruction("TANH", (0,))), ((1,),))
    g = Graph()
    for use in (lambda: strange([0.3]), lambda: inline(g, strange, [[g.leaf("%x")]], lambda x: (x, x))):
        with pytest.raises(ValueError, match="TANH"):
            use()


def test_equal_expressions_are_one_node_whatever_their_form() -> None:
    graph, (x, y, z) = graph_of(3)
    c, s = graph.cos(x), graph.sin(x)
    assert (c * c + s * s).number == 1.0
    assert (x + y) * (x - y) is x * x - y * y
    assert x * (y + z) - x * y - x * z is graph.constant(0.0)
    assert graph.total([x * 2.0, y, x * -3.0, x]) is y
    half, product = (x * 0.5) * (y * 3.0), x * y
    assert half is product * 1.5 or product is half * (1 / 1.5)
    assert (x / y) * y is x
    assert -(x - y) is y - x


def test_what_agrees_at_the_samples_alone_is_not_one_node() -> None:
    graph, (x, _) = graph_of(2)
    twin = graph.input("twin", 0, x.at[:4], 1.0)
    still = graph.input("still", 0, np.zeros(4), 1.0)
    assert twin is not x
    assert not (x - twin).zero
    assert still.number is None
    switch = graph.opaque("LE", (x, twin), (x.at <= twin.at).astype(float))
    assert switch.number is None
