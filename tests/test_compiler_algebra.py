"""Generated programs against the linkage's own evaluation, and what the generator promises about rows, pivots and costs."""

import tomllib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gauss_bench.compiler.elimination.partition import study
from gauss_bench.compiler.elimination.program import PRECISE, error_of, generate, partitions
from gauss_bench.compiler.elimination.rank import CHECKED, acceleration_error
from gauss_bench.compiler.equations.sampling import manifold_states, scales
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import ExpressionGraph
from gauss_bench.linkage.load import built_in, load, load_document
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import CoulombFriction
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.reference.minimal import MinimalCoordinate
from tests.conftest import DATA, everything, exhaustive, redundant
from tests.engine_runs import changed

FILES = ("all_kinds", "loaded", "pushed", "slides", "swinging_block", "wedge")
OWN = {"everything": everything, "redundant": redundant}
FORMULATIONS = ("gauss", "lagrange")
ROUNDING = 1e-11  # relative, after eliminations of condition up to 1e4


@cache
def linkage(name, scenario=None):
    if name in OWN:
        return OWN[name]()
    return load(DATA / f"{name}.toml" if name in FILES else name, scenario)


@cache
def program(name, scenario, formulation, drop=0):
    return generate(linkage(name, scenario), formulation, drop=drop, remembered=True)  # by whichever process asks first


# Of each linkage its free motion under most forces and one law that drives it: `cycloid` and `conservative` are the same equations
# with another law, which `test_motion_laws_drive_as_they_do_in_the_linkage` sees, and with fewer forces.
CASES = [
    (name, scenario)
    for name in built_in()
    for scenario in load(name).scenarios
    if scenario not in ("cycloid", "conservative", "settles")
]
CASES += [(name, None) for name in (*FILES, *OWN, "pendulums_4", "n_four_bar_3")]
# every kind of joint, driver and force, redundant rows, a knife edge, several freedoms; the others are long together
QUICK = {("crank_slider", "paper"), ("sleigh", "glide"), ("everything", None), ("redundant", None), ("loaded", None)}


@cache
def states(mechanism, seeds):
    """States over the whole motion, other than those the pivots were chosen at."""
    found = [manifold_states(mechanism, 40, seed) for seed in seeds]
    return [(float(t), q, v) for s in found for t, q, v in zip(s.t, s.q, s.v, strict=True)]


def values(function, *arguments):
    return function(*(np.atleast_1d(x) for x in arguments))


def trusted(p, *state):
    return bool((np.abs(values(p.acceleration, *state, p.values)[1]) >= p.thresholds).all())


@pytest.mark.long("crank_slider-driven-gauss")
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(("name", "scenario"), exhaustive(CASES, *QUICK))
def test_motion_forces_and_energy_are_those_of_the_linkage(name, scenario, formulation):
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


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(("name", "scenario"), exhaustive([c for c in CASES if c[0] != "everything"], *QUICK))
def test_corrections_bring_a_state_back(name, scenario, formulation, rng):
    """A state that is off by h is off by h^2 after one correction, and by h^k after k corrections with the same Jacobian."""
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


SHORTEST = [("four_bar", "torque", "gauss"), ("four_bar", "torque", "lagrange"), ("five_bar", "spring", "lagrange")]


@pytest.mark.parametrize(("name", "scenario", "formulation"), [*SHORTEST, ("excavator", None, "gauss")])
def test_a_correction_goes_the_shortest_way(name, scenario, formulation):
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


def test_redundant_rows_are_dropped_by_name_and_what_is_dropped_carries_nothing():
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


@pytest.mark.parametrize(("independent", "dead", "good"), [((6,), 0.0, 1.0), ((5,), np.pi / 2, 0.3)])
def test_the_guard_falls_where_the_independent_coordinate_rests(independent, dead, good):
    """The slider's position rests at both dead centres, the rod's angle where the crank is upright."""
    mechanism, turn = linkage("crank_slider", "paper"), MinimalCoordinate(linkage("crank_slider", "paper"))
    p, v = generate(mechanism, "gauss", independent=independent), np.zeros(mechanism.n)
    angles = np.array([dead, dead + 1e-8, dead + 1e-5, good, dead + 0.02, dead - 0.02])
    q = turn.geometry(angles)[0]
    a, guards = p.acceleration(np.zeros((len(q), 1)), q, np.tile(v, (len(q), 1)), p.values)
    usable = (np.abs(guards) >= p.thresholds).all(axis=1)
    assert usable.tolist() == [False] * 3 + [True] * 3
    true = AbsoluteCoordinates(mechanism).acceleration(np.zeros(3), q[3:], np.tile(v, (3, 1)))
    assert np.abs(a[3:] - true).max() <= 1e-9 * np.abs(true).max()  # two or three digits are lost where the guard is near


@pytest.mark.parametrize("name", exhaustive([*built_in(), "n_four_bar_3"], "crank_slider"))
def test_partitions_cover_the_motion_and_begin_with_the_crank(name):
    mechanism = linkage(name, load(name).scenarios[-1])
    found = partitions(mechanism)
    if not mechanism.drivers:
        free = mechanism.dof - len(mechanism.knife_edges)
        assert {len(x) for x in found} == {free}
        programs = [generate(mechanism, "gauss", independent=x, drop=k) for x in found for k in range(len(study(mechanism).drops))]
        for state in states(mechanism, range(10, 11)):
            assert any(trusted(p, *state) for p in programs)
    if mechanism.dof == 1 and not mechanism.drivers:
        assert found[0] == (3 * mechanism.crank + 2,)


LAWS = [
    {"law": "constant", "start_deg": 20.0, "speed": 3.0},
    {"law": "sine", "start_deg": 20.0, "travel_deg": 200.0, "time": 0.6},
    {"law": "cosine", "start_deg": 20.0, "travel_deg": 200.0, "time": 0.6},
    {"law": "poly345", "start_deg": 20.0, "travel_deg": 200.0, "time": 0.6},
    {"law": "table", "start_deg": 20.0, "rows": [[0.1, 0.0], [0.2, 15.0], [0.35, 70.0], [0.5, 60.0], [0.7, 120.0]]},
]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: str(law["law"]))
def test_motion_laws_drive_as_they_do_in_the_linkage(law):
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


OPEN = {"links.crank.mass": 0.5, "links.rod.inertia": 0.03, "links.rod.com.y": 0.01, "points.rod.B.x": 0.6, "gravity.y": -1.6}
OPEN |= {"points.ground.O.y": 0.02, "joints.guide.offset": 0.03}
OPEN |= {"forces.motor.value": -1.5, "forces.spring.k": 9.0, "forces.spring.rest": 0.6}
FILE = {name: x for name, x in OPEN.items() if not name.endswith((".x", ".y"))}  # the same numbers as a file has them
FILE |= {"links.rod.com": [0.28, 0.01], "links.rod.points.B": [0.6, 0.0], "ground.points.O": [0.0, 0.02], "gravity": [0.0, -1.6]}
FILE |= {"links.crank.inertia": 0.37 * 0.15**2 / 12}  # a uniform bar's would follow its mass


def test_open_parameters_give_the_linkage_with_other_numbers():
    """At states near the start of the other linkage, which its loops close."""
    p, other = generate(linkage("crank_slider", "paper"), "gauss", (*OPEN,)), changed("crank_slider", "paper", FILE)
    assert p.parameters == tuple(OPEN)
    motion, numbers = MinimalCoordinate(other), np.array(list(OPEN.values()))
    q, v, true = motion.free_state(other.q0[2] + np.linspace(0.5, 1.0, 6), np.linspace(-3.0, 3.0, 6))
    np.testing.assert_allclose(p.acceleration(np.zeros((6, 1)), q, v, numbers)[0], true, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(p.energy(q, v, numbers)[0][:, 0], Evaluator(other).energy(q, v), rtol=1e-12)


def test_baumgarte_bends_the_bias_of_every_row(rng):
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


def test_what_cannot_be_a_kernel_is_refused():
    mechanism = linkage("four_bar", "torque")
    rubbing = CoulombFriction("rub", mechanism.joints[:1], 0.1, 0.01, 0.1)
    driven, slider = linkage("four_bar", "driven"), linkage("crank_slider", "paper")
    for asked, options, text in (
        (replace(mechanism, frictions=(rubbing,)), {}, "friction"),
        (mechanism, {"open_parameters": ("links.crank.weight",)}, r"links\.crank\.weight"),
        (mechanism, {"formulation": "newton"}, "formulation"),
        (mechanism, {"formulation": "gauss", "independent": (2, 5)}, "1 independent"),
        (slider, {"formulation": "gauss", "independent": (8,)}, "velocities at no sample"),  # the slider's angle never changes
        (replace(driven, drivers=driven.drivers * 2), {}, "redundant"),
    ):
        with pytest.raises(KernelError, match=text):
            generate(asked, **options)


@pytest.mark.parametrize("name", ["acceleration", "residual", "energy"])
def test_a_program_that_is_wrong_is_refused(name):
    p = program("crank_slider", "paper", "gauss")
    right = getattr(p, name)
    first = len(right.instructions) // 2 if name == "energy" else right.outputs[0][1]  # another value of the function
    wrong = replace(right, outputs=((first, *right.outputs[0][1:]), *right.outputs[1:]))
    mechanism = linkage("crank_slider", "paper")
    assert error_of(p, mechanism) < PRECISE
    assert error_of(replace(p, **{name: wrong}), mechanism) > CHECKED


@pytest.mark.parametrize(
    ("name", "formulation"),
    exhaustive([("uneven_pivots_07", "lagrange"), ("uneven_pivots_50", "gauss")], ("uneven_pivots_07", "lagrange")),
)
def test_pivots_that_serve_at_most_positions_alone_make_a_program(name, formulation):
    """Whatever is divided by is small somewhere on the motion: there the guard falls, and everywhere else the program is right."""
    m = load(str(DATA / f"{name}.toml"))
    made, found = generate(m, formulation), manifold_states(m, 40, seed=2)
    a, guard = made.acceleration(found.t[:, None], found.q, found.v, made.values)
    sound = (np.abs(guard) >= made.thresholds).all(axis=1)
    assert 0.25 * len(sound) < sound.sum()
    for k in np.flatnonzero(sound):
        assert acceleration_error(Evaluator(m), float(found.t[k]), found.q[k], found.v[k], a[k]) < 1e-9


def test_equal_expressions_are_one_node_whatever_their_form_and_others_are_not(rng):
    graph = ExpressionGraph(4)
    x, y, z = (graph.input("x", k, rng.normal(size=4), 1.0) for k in range(3))
    c, s = graph.cos(x), graph.sin(x)
    assert (c * c + s * s).number == 1.0
    assert (x + y) * (x - y) is x * x - y * y
    assert x * (y + z) - x * y - x * z is graph.constant(0.0)
    assert graph.total([x * 2.0, y, x * -3.0, x]) is y
    half, product = (x * 0.5) * (y * 3.0), x * y
    assert half is product * 1.5 or product is half * (1 / 1.5)
    assert (x / y) * y is x
    assert -(x - y) is y - x
    # what agrees at the samples alone
    twin = graph.input("twin", 0, x.values[:4], 1.0)
    still = graph.input("still", 0, np.zeros(4), 1.0)
    assert twin is not x
    assert not (x - twin).is_zero
    assert still.number is None
    switch = graph.opaque("LE", x, twin)
    assert switch.number is None
