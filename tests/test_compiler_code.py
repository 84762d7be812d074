"""From programs to running code: sines, steps, guards, lanes, projection, the cache, and numpy where there is no compiler."""

import gc
import mmap
import os
import weakref
from dataclasses import dataclass, replace
from functools import cache

import mpmath
import numpy as np
import pytest

from gauss_bench.compiler import user_cache
from gauss_bench.compiler.elimination import program as elimination
from gauss_bench.compiler.elimination.program import generate
from gauss_bench.compiler.elimination.rank import RankDecision, acceleration_error
from gauss_bench.compiler.equations.links import Tie, tie_angles
from gauss_bench.compiler.equations.sampling import manifold_states
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.kernel import compile_kernel
from gauss_bench.compiler.machine import native_code, routine, trigonometry
from gauss_bench.compiler.machine.graph import Graph
from gauss_bench.compiler.machine.llvm import write_listing
from gauss_bench.compiler.machine.native_code import Loaded, Target, address
from gauss_bench.compiler.stepping import rollout as loops
from gauss_bench.compiler.stepping import steps
from gauss_bench.compiler.stepping.driver import INTEGRATORS
from gauss_bench.formulations.lagrange import lagrange
from gauss_bench.linkage.load import load, load_document
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Angle
from gauss_bench.mechanism.spaces import angles
from gauss_bench.reference.build import build_reference, random_states
from gauss_bench.reference.exact import closed_form
from tests.conftest import DATA, exhaustive
from tests.drawn_linkages import random_linkage
from tests.engine_runs import by_gauss

TRIED = ("crank_slider", "parallelogram", "sleigh", "four_bar/cycloid")  # of linkages that take long together
LINKAGES = exhaustive(("crank_slider", "parallelogram", "sleigh", "shaper", "eight_bar", "five_bar", "excavator"), *TRIED)
DRIVEN = exhaustive(("four_bar/cycloid", "eight_bar/driven", "five_bar/driven"), *TRIED)
H = 1e-4  # [s]


@cache
def mechanism(name):
    linkage, _, scenario = name.partition(":" if name.startswith("/") else "/")
    return load(linkage, scenario or None)


@cache
def compiled(name, stabilization, backend, more):
    return compile_kernel(mechanism(name), stabilization=stabilization, backend=backend, **dict(more))


def kernel(name, stabilization="none", backend="llvm", **more):
    return compiled(name, stabilization, backend, tuple(more.items()))


@cache
def reference(name, t_end):
    return build_reference(mechanism(name), t_end)


def running(name, count, h=H):
    m = mechanism(name)
    return kernel(name).rollout(m.q0, m.v0, h, count)


@cache
def motion(name, count=40, gap=50):
    """Different states along one motion."""
    m = mechanism(name)
    return kernel(name, "projection").rollout(m.q0, m.v0, H, count * gap, every=gap)


def residuals(m, q, v, t=0.0):
    """Norms of phi and phi' at states (k, n)."""
    evaluator = Evaluator(m)
    rows = evaluator.constraints(t, q, v)
    return np.abs(rows.phi).max(-1), np.abs((rows.J @ v[..., None])[..., 0] + rows.phi_t).max(-1)


def evaluated(g, roots, *columns):
    """A graph whose leaves are %x0, %x1 ..., run as machine code on columns (k,)."""
    x = np.ascontiguousarray(np.array(columns).T)
    load = routine.Load("x", {g.leaf(f"%x{i}"): i for i in range(x.shape[1])})
    arrays = {"x": routine.Array(x.shape[1]), "out": routine.Array(len(roots))}
    made = routine.Routine("evaluate", g, arrays, (), (), [load, routine.Store("out", roots)], g.all(True), len(roots))
    code = native_code.NativeCode(write_listing(made, 1), cached=False)
    out = np.empty((len(x), len(roots)))
    code.call(address(x), address(out), len(x))
    return out


def ulps(found, exact):
    """Largest error in units of the last place of the exact values."""
    return max(abs(mpmath.mpf(float(a)) - b) / float(np.spacing(abs(float(b)))) for a, b in zip(found, exact, strict=True))


def test_sine_and_cosine_from_nothing_are_full_doubles():
    """The reduction rounds twice, one ulp of r or up to 1.8 of a sine with a smaller exponent; the last sum once, half an ulp."""
    bound, g = 2.4, Graph()
    turns = np.linspace(-1.0, 1.0, 401)
    quarters = np.arange(-200, 200) * np.pi / 2  # where all digits cancel
    arguments = np.concatenate([10 * turns, 1e3 * turns + 0.1, trigonometry.LARGEST * turns, quarters, 10.0 ** np.arange(-300, -2)])
    found = evaluated(g, list(trigonometry.sincos(g, g.leaf("%x0"))), arguments)
    with mpmath.workprec(200):
        exact = [mpmath.mpf(float(x)) for x in arguments]
        assert ulps(found[:, 0], [mpmath.sin(x) for x in exact]) < bound
        assert ulps(found[:, 1], [mpmath.cos(x) for x in exact]) < bound


@pytest.mark.parametrize(
    "reach", sorted({r for reaches in steps.REACHES.values() for x in reaches[:-1] for r in (x.step, x.correction)})
)
def test_a_rotation_adds_one_rounding_of_one(reach, rng):
    x, d = rng.uniform(-4, 4, 400), np.append(rng.uniform(-reach, reach, 398), [-reach, reach])
    g = Graph()
    pair = g.leaf("%x0"), g.leaf("%x1")
    found = evaluated(g, list(trigonometry.rotate(g, pair, g.leaf("%x2"), reach)), np.sin(x), np.cos(x), d)
    with mpmath.workprec(200):
        exact = [mpmath.mpf(float(a)) + mpmath.mpf(float(b)) for a, b in zip(x, d, strict=True)]
        off = [abs(mpmath.mpf(float(s)) - mpmath.sin(a)) for s, a in zip(found[:, 0], exact, strict=True)]
        off += [abs(mpmath.mpf(float(c)) - mpmath.cos(a)) for c, a in zip(found[:, 1], exact, strict=True)]
    assert max(off) < 1.25 * 2.0**-53  # half from the pair given, half from the sum, an eighth from the series, and little else


@pytest.mark.slow("llvm-parallelogram")
@pytest.mark.parametrize("name", [*LINKAGES, *DRIVEN])
@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_accelerations_are_the_true_ones(name, backend):
    truth = random_states(mechanism(name), 40)
    found = kernel(name, backend=backend).acceleration(truth.q, truth.v, truth.t)
    scale = 1.0 + np.abs(truth.a).max(axis=1)
    # rounding times the condition of what is solved; the largest met is 1e-11, next to change points of the parallelogram
    assert (np.abs(found - truth.a).max(axis=1) / scale).max() < (1e-10 if name == "parallelogram" else 1e-12)
    alone = kernel(name, backend=backend).acceleration(truth.q[0], truth.v[0], float(truth.t[0]))
    np.testing.assert_array_equal(alone, found[0])


@dataclass(frozen=True)
class Stiff:
    """A coupling that keeps an angle between two links constant, as a slide does."""

    name: str
    held: tuple[tuple[Angle, float], ...]


def test_links_whose_angle_a_coupling_holds_share_one_sine():
    free = load(DATA / "double_pendulum.toml")
    turn = float(np.diff(angles(free.q0))[0])
    tied = replace(free, couplings=(Stiff("stiff", ((Angle(0, 1), turn),)),), dof=1)
    assert tie_angles(tied) == (Tie(0, 0.0), Tie(0, turn))
    q, v = tied.q0, np.zeros(tied.n)
    found = compile_kernel(tied, backend="numpy").acceleration(q, v, 0.0)
    np.testing.assert_allclose(found, lagrange(Evaluator(tied).terms(0.0, q, v)).a, rtol=1e-12, atol=1e-12)


@pytest.mark.slow("crank_slider-gauss_legendre-projection")
@pytest.mark.parametrize(
    ("name", "integrator", "stabilization", "count", "least", "most"),
    [
        pytest.param(name, integrator, x, count, *limits, id=f"{name}-{integrator}-{x}", marks=[pytest.mark.long] * (x in more))
        for name, integrator, count, limits, more in (
            ("crank_slider", "rk4", 400, (3.8, 4.2), ("none", "baumgarte")),
            # a slide, and a guide that moves; it turns back within hundredths of a second: a share of order 5 is still in its error
            ("shaper", "rk4", 1600, (3.8, 4.2), ("none", "baumgarte", "projection")),
            ("crank_slider", "dop853_fixed", 20, (7.0, 9.5), ("none", "baumgarte")),
            ("crank_slider", "gauss_legendre", 20, (5.5, 6.5), ("none", "baumgarte")),
        )
        for x in ("none", "baumgarte", "projection")
    ],
)
def test_steps_have_their_order(name, integrator, stabilization, count, least, most):
    """Errors over 0.4 s of `count` steps and of twice as many; the reference is exact beside them."""
    m, exact, errors = mechanism(name), reference(name, 0.4), []
    for n in (count, 2 * count):
        every = max(1, n // 40)
        q, v = kernel(name, stabilization, formulation="gauss").rollout(m.q0, m.v0, 0.4 / n, n, every=every, integrator=integrator)
        at = np.linspace(0, 40, len(q) + 1).round().astype(int)[1:]
        errors.append(max(np.abs(q - exact.q[at]).max(), np.abs(v - exact.v[at]).max()))
    assert errors[1] > 10 * (exact.error_q.max() + exact.error_v.max())
    assert least < np.log2(errors[0] / errors[1]) < most


# Implicit steps: a torque against a dashpot that takes speeds away within 1e-4 s

CLOSER = f"{DATA / 'door_closer.toml'}:closing"


@pytest.fixture(scope="module")
def held():
    """A state at which the dashpot holds the torque."""
    return running(CLOSER, 2500, h=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("formulation", "stabilization"), [("lagrange", "none"), ("gauss", "projection")])
def test_implicit_steps_are_stable_where_explicit_ones_must_be_a_hundred_times_as_short(formulation, stabilization, held):
    """0.32 s in 8 steps, to 1e-9; RK4 leaves the motion in 800 steps, though it is smooth."""
    code, exact = kernel(CLOSER, stabilization, formulation=formulation), kernel(CLOSER).rollout(*held, 1e-5, 32_000)
    assert np.abs(np.array(code.rollout(*held, 0.04, 8, integrator="gauss_legendre")) - exact).max() < 1e-9
    assert code.switches == code.fallbacks == code.lost == 0
    assert not np.abs(np.array(code.rollout(*held, 4e-4, 800)) - exact).max() < 1e-3


@pytest.mark.slow
def test_implicit_steps_agree_in_lanes_by_arrays_and_interpreted(held):
    code, (q, v) = kernel(CLOSER, "projection"), held
    alone = np.concatenate(code.rollout(q, v, 0.02, 8, integrator="gauss_legendre"))
    many = code.rollout(np.tile(q, (9, 1)), np.tile(v, (9, 1)), 0.02, 8, integrator="gauss_legendre")
    np.testing.assert_allclose(np.concatenate(many, axis=1), np.tile(alone, (9, 1)), rtol=0, atol=1e-12)
    arrays = kernel(CLOSER, "projection", "numpy").rollout(q, v, 0.02, 8, integrator="gauss_legendre")
    np.testing.assert_allclose(np.concatenate(arrays), alone, rtol=0, atol=1e-12)
    rank = RankDecision(code.mechanism)
    for k in range(8):
        q, v = rank.step("gauss_legendre", 0.02 * k, q, v, 0.02)
    np.testing.assert_allclose(np.concatenate([q, v]), alone, rtol=0, atol=1e-10)  # another Jacobian, and the same stages


@pytest.mark.parametrize(("stabilization", "backend"), [("none", "llvm"), ("projection", "numpy")])
def test_adaptive_steps_keep_their_tolerance(stabilization, backend):
    """A thousandth of the tolerance gives less than a hundredth of the error; a motion may multiply it, but not a thousandfold."""
    m, exact = mechanism("crank_slider"), reference("crank_slider", 0.4)
    stepped, errors, steps, at = kernel("crank_slider", stabilization, backend), [], [], slice(None, None, 20)
    for tolerance in (1e-4, 1e-7):
        found = stepped.integrate(m.q0, m.v0, exact.t[at], tolerance, tolerance / 100)
        errors.append(np.abs(found.q - exact.q[at]).max())
        steps.append(found.steps)
        assert errors[-1] < 1e3 * tolerance
    assert errors[1] < 0.01 * errors[0]
    assert steps[0] < steps[1]
    np.testing.assert_allclose(found.q[0], m.q0, rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", LINKAGES)
@pytest.mark.parametrize("stabilization", ["none", "projection"])
def test_a_lane_computes_the_bits_of_a_single_run(name, stabilization):
    """Lanes go over to a longer reach together, where the last bit may differ; corrections of the excavator's bars do that."""
    code = kernel(name, stabilization, lanes=8)
    q, v = motion(name, 11)  # not a multiple of the lanes
    together = np.concatenate(code.rollout(q, v, H, 200), axis=1)
    alone = np.array([np.concatenate(code.rollout(*state, H, 200)) for state in zip(q, v, strict=True)])
    if (name, stabilization) == ("excavator", "projection"):
        np.testing.assert_allclose(together, alone, rtol=4e-15, atol=1e-18)
    else:
        np.testing.assert_array_equal(together, alone)
    np.testing.assert_array_equal(together, np.concatenate(code.rollout(q, v, H, 200, threads=2), axis=1))


def test_samples_are_the_states_on_the_way():
    m, code = mechanism("crank_slider"), kernel("crank_slider", "projection")
    q, v = code.rollout(m.q0, m.v0, H, 100, every=30)
    assert q.shape == v.shape == (4, m.n)  # after 30, 60, 90 and 100 steps
    for k, count in enumerate((30, 60, 90, 100)):
        np.testing.assert_array_equal(np.concatenate(code.rollout(m.q0, m.v0, H, count)), np.append(q[k], v[k]))
    many, _ = code.rollout(np.tile(m.q0, (3, 1)), np.tile(m.v0, (3, 1)), H, 100, every=30)
    np.testing.assert_array_equal(many, np.tile(q, (3, 1, 1)))


@pytest.mark.slow("0.001-parallelogram")
@pytest.mark.parametrize("name", exhaustive(["crank_slider", "parallelogram", "six_bar", "eight_bar", "excavator"], *TRIED))
@pytest.mark.parametrize("h", [1e-3, 1e-4])
def test_projection_leaves_rounding_after_each_step(name, h):
    m = mechanism(name)
    q, v = kernel(name, "projection").rollout(m.q0, m.v0, h, 1000, every=1)
    phi, phi_dot = residuals(m, q, v, h * np.arange(1, 1001))
    # next to a change point pivots go down to their thresholds, parts of a thousandth, and multiply rounding by their inverse
    worse = 1000 if name == "parallelogram" else 1
    assert phi.max() < worse * 1e-14 * (1 + np.abs(q).max())
    assert (phi_dot / (1 + np.abs(v).max(axis=1))).max() < worse * 1e-13


def test_the_acceleration_asked_for_is_without_baumgarte():
    m = mechanism("crank_slider")
    q = m.q0 + np.linspace(-1e-3, 1e-3, m.n)
    plain = kernel("crank_slider").acceleration(q, m.v0)
    for backend in ("llvm", "numpy"):
        damped = kernel("crank_slider", "baumgarte", backend).acceleration(q, m.v0)
        np.testing.assert_allclose(damped, plain, rtol=0, atol=1e-13 * np.abs(plain).max())


def test_after_preparing_nothing_is_compiled_in_a_rollout():
    m = mechanism("crank_slider")
    code = compile_kernel(m, cache=False)
    code.prepare()
    code.prepare(many=True)
    seconds = code.compile_seconds
    code.rollout(m.q0, m.v0, 1e-3, 2000)
    code.rollout(np.tile(m.q0, (9, 1)), np.tile(m.v0, (9, 1)), 1e-2, 100)
    assert code.compile_seconds == seconds


@pytest.mark.parametrize("stabilization", ["none", "projection"])
def test_a_bad_coordinate_passes_the_dead_centre_by_a_good_one(stabilization):
    """The slider as independent coordinate cannot pass the dead centre, where it stands still; the crank can.

    Alone and in lanes, of which those that stop do not disturb the others.
    """
    bad, good = kernel("crank_slider", stabilization, formulation="gauss", independent=(6,)), kernel("crank_slider", stabilization)
    assert bad.partitions[0] == (6,)
    for state, count, every in ((running("crank_slider", 1500), 4000, None), (motion("crank_slider"), 1500, 7)):
        found, expected = (np.concatenate(x.rollout(*state, H, count, every=every), axis=-1) for x in (bad, good))
        # near the dead centre a rounding of the slider moves the crank a thousand times as far, the pivot's inverse threshold
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
        assert bad.switches >= 1
        assert bad.fallbacks == bad.lost == 0


def test_without_another_partition_the_rank_decides():
    q, v = running("crank_slider", 1500)
    bad = compile_kernel(mechanism("crank_slider"), "gauss", "projection", independent=(6,))
    bad._programs._more = iter(())
    found = np.concatenate(bad.rollout(q, v, H, 4000))
    expected = np.concatenate(kernel("crank_slider", "projection").rollout(q, v, H, 4000))
    # next to the dead centre a projection that keeps the slider moves the crank, up to the inverse of the pivot's threshold
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7)
    assert bad.fallbacks >= 1
    m = mechanism("crank_slider")  # it starts at a dead centre
    direction = 10 * np.linalg.svd(Evaluator(m).constraints(0.0, m.q0, m.v0).J)[2][-1]
    exact = kernel("crank_slider").acceleration(m.q0, direction)
    np.testing.assert_allclose(bad.acceleration(m.q0, direction), exact, rtol=0, atol=1e-12 * np.abs(exact).max())


@pytest.mark.usefixtures("full_search")  # what a short one finds may be singular where rounding decides
@pytest.mark.long("lagrange-projection")
@pytest.mark.parametrize(("formulation", "stabilization"), [("gauss", "none"), ("lagrange", "projection")])
def test_three_parallel_cranks_turn_without_a_hand_over(formulation, stabilization):
    """Whichever row is dropped, the others are singular twice a turn; not so what is left of a combination of two rows."""
    m, code = mechanism("parallelogram"), compile_kernel(mechanism("parallelogram"), formulation, stabilization)
    q, v = code.rollout(m.q0, m.v0, H, 10_000, every=100)
    assert code.switches == code.fallbacks == code.lost == 0
    cranks = q[:, [2, 5, 8]] - m.q0[[2, 5, 8]]
    assert np.abs(cranks[-1]).max() > 2 * np.pi
    assert np.ptp(cranks, axis=1).max() < 1e-10
    assert residuals(m, q, v)[0].max() < 1e-10


def test_redundant_rows_are_taken_back_where_nothing_projects():
    """Five seconds at steps of 1 ms drift by 1e-6 m; one lane, many and arrays of numpy take the state back at the same steps."""
    m, code = mechanism("parallelogram"), kernel("parallelogram")
    q, v = code.rollout(m.q0, m.v0, 1e-3, 5000, every=100)
    assert residuals(m, q, v)[0].max() < 2e-9
    together = np.concatenate(code.rollout(np.tile(m.q0, (2, 1)), np.tile(m.v0, (2, 1)), 1e-3, 200), axis=1)
    np.testing.assert_array_equal(together, np.tile(np.concatenate(code.rollout(m.q0, m.v0, 1e-3, 200)), (2, 1)))
    plain = np.concatenate(kernel("parallelogram", backend="numpy").rollout(m.q0, m.v0, 1e-3, 200))
    np.testing.assert_allclose(together[0], plain, rtol=1e-12, atol=1e-12)
    q, v = code.rollout(m.q0, m.v0, H, 32 * loops.SETTLED, every=loops.SETTLED, integrator="semi_implicit_euler")
    assert residuals(m, q, v)[0].max() < 1e-14  # in between 2e-6


@pytest.mark.parametrize(
    ("integrator", "h", "far"),
    [("rk4", 1e-4, False), ("rk4", 1e-2, True), ("dop853_fixed", 6e-3, False), ("dop853_fixed", 0.015, True)],
)
def test_a_step_that_goes_too_far_is_done_by_the_exact_variant(integrator, h, far):
    """Numpy computes all sines from scratch; in steps of order 8 they are rotated to either side of the middle."""
    q, v = running("crank_slider", 20_000)
    code = compile_kernel(mechanism("crank_slider"), "gauss", "projection")
    exact = kernel("crank_slider", "projection", "numpy", formulation="gauss")
    found, expected = (np.array(x.rollout(q, v, h, 10, every=1, integrator=integrator)) for x in (code, exact))
    assert (code._programs.runner(0, integrator).further is None) == far
    reach = steps.REACHES[integrator][0].step * (2 if integrator == "dop853_fixed" else 1)
    assert (np.abs(found[1][:, 2]).max() * h > reach) == far
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)  # rounding, grown by coarse steps


def test_what_cannot_go_on_is_not_a_number():
    m = mechanism("crank_slider")
    v = np.stack([m.v0, np.full(m.n, np.nan), m.v0 + 1e200])
    for code in (kernel("crank_slider"), kernel("crank_slider", backend="numpy")):
        q, _ = code.rollout(np.tile(m.q0, (3, 1)), v, H, 3)
        assert np.isfinite(q).all(axis=1).tolist() == [True, False, False]
        assert np.isnan(q[1:]).all()
        assert code.lost == 2


@pytest.mark.parametrize("name", exhaustive(["crank_slider", *TRIED[2:], "six_bar", "excavator"], *TRIED[2:]))
@pytest.mark.parametrize(
    ("stabilization", "integrator"), [("none", "semi_implicit_euler"), ("baumgarte", "rk4"), ("projection", "semi_implicit_euler")]
)
def test_numpy_steps_as_native_code_does(name, stabilization, integrator):
    m = mechanism(name)
    found, expected = (
        kernel(name, stabilization, backend).rollout(m.q0, m.v0, H, 100, every=30, integrator=integrator)
        for backend in ("numpy", "llvm")
    )
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)  # rounding of 100 steps


SEEDS = [*range(3), *(pytest.param(seed, marks=pytest.mark.long) for seed in (4, 5, 7, 10))]


@pytest.mark.long("2-none", "2-projection", "4-none", "4-projection", "7-none")
@pytest.mark.slow("0-none", "0-projection")
@pytest.mark.parametrize("stabilization", ["none", "projection"])
@pytest.mark.parametrize("seed", SEEDS)
def test_native_steps_are_as_exact_as_interpreted_ones_whatever_the_linkage(seed, stabilization):
    """Linkages drawn by lot, in a hundred steps of 1 ms."""
    m = load_document(random_linkage(seed))
    times = 1e-2 * np.arange(11)
    exact = by_gauss(m, times, integrator="dop853_fixed", stabilization="projection").q
    numpy = by_gauss(m, times, integrator="rk4", stabilization=stabilization).q
    q, _ = compile_kernel(m, "gauss", stabilization).rollout(m.q0, m.v0, 1e-3, 100, every=10)
    assert np.abs(q - exact[1:]).max() <= 1.5 * np.abs(numpy - exact).max() + 1e-13


# Large linkages: the same physics, in code that grows in proportion to the linkage

LARGE = [("n_four_bar_12/driven", "gauss"), ("n_four_bar_12/fall", "gauss"), ("pendulums_9", "gauss"), ("pendulums_32", "gauss")]
LARGE += [(name, "lagrange") for name, _ in LARGE]  # the cheapest pivots of 32 pendulums lose digits


@pytest.mark.slow
@pytest.mark.parametrize(("name", "formulation"), exhaustive(LARGE, ("pendulums_9", "lagrange")))
def test_accelerations_of_large_linkages_are_those_of_the_linkage(name, formulation):
    """Relative errors of 1e-13 are usual; pivots as small as the guard's thousandth of their row may cost three digits more."""
    m, code = mechanism(name), kernel(name, formulation=formulation)
    evaluator, states = Evaluator(m), manifold_states(m, 7, seed=5)
    found = code.acceleration(states.q, states.v, states.t)
    for t, q, v, a in zip(states.t, states.q, states.v, found, strict=True):
        assert acceleration_error(evaluator, float(t), q, v, a) <= 1e-10
        np.testing.assert_array_equal(code.acceleration(q, v, float(t)), a)


@pytest.mark.long("1-0.5", "64-0.5", "16-1.5")
@pytest.mark.slow("4-0.5")
@pytest.mark.parametrize(("count", "end"), [(1, "0.5"), (4, "0.5"), (64, "0.5"), (1, "1.5"), (16, "1.5")])
def test_n_four_bars_fall_as_their_closed_form_says(count, end):
    """All bars lie on the ground line at about 0.73 s; the branch that is left there is the parallelogram's."""
    code = kernel(f"n_four_bar_{count}", formulation="gauss")
    motion = closed_form(code.mechanism, [end])
    q, v = code.rollout(code.mechanism.q0, code.mechanism.v0, 1e-3, round(1e3 * float(end)))
    assert code.lost == 0
    assert (code.fallbacks > 0) == (end == "1.5")
    # the method's own error is h^4 = 1e-12 in the units of the linkage; a step from singular, rounding grows a million times
    assert np.abs(q - motion.q[0].astype(float)).max() < (1e-11 if end == "0.5" else 1e-7)
    assert end == "1.5" or np.abs(v - motion.v[0].astype(float)).max() < 1e-11


@pytest.mark.parametrize("stabilization", ["none", "projection"])
def test_a_loop_over_stages_takes_the_steps_that_are_written_out(stabilization, monkeypatch):
    """The loop is chosen where an acceleration has more operations than the threshold, and its code is less than half as long."""
    m = mechanism("n_four_bar_2")
    ends, lengths = [], []
    operations = compile_kernel(m, "gauss", stabilization).operations
    for threshold in (operations, operations - 1):
        monkeypatch.setattr(steps, "LONG", threshold)
        code = compile_kernel(m, "gauss", stabilization)
        ends.append(code.rollout(np.tile(m.q0, (3, 1)), np.tile(m.v0, (3, 1)), 1e-3, 300))
        np.testing.assert_allclose(code.rollout(m.q0, m.v0, 1e-3, 300), [x[0] for x in ends[-1]], rtol=0, atol=1e-12)
        first = code._programs.codes[0]
        lengths.append(sum(body.operations for body in loops.bodies(first, "rk4", steps.reaches(first, "rk4")[-1:])))
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-12)
    assert lengths[1] < (0.5 if stabilization == "none" else 1.0) * lengths[0]


def test_a_call_keeps_its_code_in_memory():
    g = Graph()
    x, arrays = g.leaf("%x"), {"x": routine.Array(1), "y": routine.Array(1)}
    body = [routine.Load("x", {x: 0}), routine.Store("y", [g.mul(x, x)])]
    square = Loaded(lambda many: routine.Routine("square", g, arrays, (), (), body, g.all(True), 1), Target("llvm", 4, cache=False))
    call = square.single(1, 1)
    code = weakref.ref(square.codes[1])
    del square
    gc.collect()
    assert code() is not None  # else the next call would be of what is no longer there
    call.arrays[0][:] = 3.0
    call.run()
    assert call.arrays[1][0] == 9.0


@pytest.mark.slow
@pytest.mark.parametrize("name", exhaustive(["crank_slider", "parallelogram", "n_four_bar_3"], "crank_slider"))
def test_code_that_compiles_sooner_computes_the_same_bits(name, monkeypatch):
    """Tests run the code that compiles sooner, users and the gate the faster one."""
    m = mechanism(name)
    many = np.tile(m.q0, (5, 1)), m.v0 * np.linspace(0.9, 1.1, 5)[:, None]

    def results():
        code, found = compile_kernel(m, stabilization="projection"), []
        for integrator in INTEGRATORS:
            found += code.rollout(m.q0, m.v0, 1e-3, 40, integrator=integrator)
        chosen = code.integrate(m.q0, m.v0, np.linspace(0.0, 0.05, 6), 1e-8, 1e-10)
        found += [chosen.q, chosen.v]
        found += [*code.rollout(*many, 1e-3, 40), code.acceleration(m.q0, m.v0)]
        return np.concatenate([x.ravel() for x in found])

    soon = results()
    monkeypatch.delenv(native_code.QUICK)
    assert np.isfinite(soon).all()
    np.testing.assert_array_equal(results(), soon)


def test_it_does_not_matter_where_in_memory_code_comes_to_lie():
    """Beside libraries that take gigabytes of addresses, parts of a module would be too far apart for its short references."""
    m, taken, found = mechanism("crank_slider"), [], []
    for _ in range(3):
        found.append(compile_kernel(m, "gauss", cache=False).acceleration(m.q0, m.v0))
        taken += [mmap.mmap(-1, 3 << 30, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, prot=mmap.PROT_READ) for _ in range(3)]
    np.testing.assert_array_equal(found, [kernel("crank_slider").acceleration(m.q0, m.v0)] * 3)
    assert len(taken) == 9


def test_a_second_compilation_comes_from_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    m = mechanism("crank_slider")
    first = compile_kernel(m)
    second = compile_kernel(m)
    assert (first.from_cache, second.from_cache) == (False, True)
    assert (tmp_path / "gauss-bench" / "kernels").stat().st_mode & 0o777 == 0o700
    expected = first.rollout(m.q0, m.v0, H, 50)
    np.testing.assert_array_equal(expected, second.rollout(m.q0, m.v0, H, 50))
    for file in (tmp_path / "gauss-bench" / "kernels").iterdir():
        content = bytearray(file.read_bytes())
        content[len(content) // 2] ^= 1
        file.write_bytes(content)
    third = compile_kernel(m)
    assert not third.from_cache
    np.testing.assert_array_equal(expected, third.rollout(m.q0, m.v0, H, 50))
    assert compile_kernel(m).from_cache  # rebuilt in place


def test_object_code_belongs_to_its_name(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache.store("a.o", b"code")
    assert user_cache.load("a.o") == b"code"
    folder = user_cache.folder()
    (folder / "b.o").write_bytes((folder / "a.o").read_bytes())
    assert user_cache.load("b.o") is None  # a file under another name
    (folder / "a.o").write_bytes((folder / "a.o").read_bytes()[:-1])
    assert user_cache.load("a.o") is None


@pytest.mark.slow
def test_a_search_is_done_once_and_its_program_is_the_same_again(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    m, searches = mechanism("four_bar"), []
    search = elimination.cheapest
    monkeypatch.setattr(elimination, "cheapest", lambda *asked: (searches.append(asked), search(*asked))[1])
    first, again = generate(m, remembered=True), generate(m, remembered=True)
    assert len(searches) == 1
    assert again.acceleration.instructions == first.acceleration.instructions
    assert again.residual.instructions == first.residual.instructions
    assert generate(m).acceleration.instructions == first.acceleration.instructions
    heavier = replace(m, links=(replace(m.links[0], mass=2 * m.links[0].mass), *m.links[1:]))
    assert generate(heavier, remembered=True).acceleration.instructions != first.acceleration.instructions
    generate(m, "lagrange", remembered=True)
    assert len(searches) == 4
    generate(replace(m, title="another", source="elsewhere.toml"), remembered=True)
    assert len(searches) == 4  # words are no numbers


@pytest.mark.parametrize(("errors", "taken"), [((1e-10, 1e-12), 1), ((1e-10, 2e-10), 0)])
def test_the_more_accurate_of_two_eliminations_is_taken_and_remembered(errors, taken, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made, left, search = [], iter((*errors, errors[taken])), elimination.cheapest
    found_by_chance = [elimination.Search(noise=3.0)]
    monkeypatch.setattr(elimination, "cheapest", lambda *asked: elimination.try_settings(search(*asked).work, found_by_chance)[0])
    monkeypatch.setattr(elimination, "error_of", lambda program, _: (made.append(program), next(left))[1])
    first, again = (generate(mechanism("four_bar"), remembered=True) for _ in range(2))
    assert first is made[taken]
    assert len(made) == 3  # what was remembered is not eliminated twice
    assert again.acceleration.instructions == first.acceleration.instructions


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no POSIX permissions")
@pytest.mark.parametrize("fault", ["open to others", "of another user", "a link"])
def test_a_folder_that_others_may_enter_is_refused(fault, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    user_cache.store("a.o", b"code")
    folder = user_cache.folder()
    if fault == "open to others":
        folder.chmod(0o755)
    elif fault == "of another user":
        uid = os.getuid()
        monkeypatch.setattr(os, "getuid", lambda: uid + 1)
    else:
        folder.symlink_to(folder.rename(tmp_path / "elsewhere"))
    assert user_cache.load("a.o") is None
    assert not user_cache.store("b.o", b"code")
    assert not [*tmp_path.rglob("b.o")]


def test_without_a_compiler_numpy_is_chosen(monkeypatch):
    monkeypatch.setattr(native_code, "available", lambda: False)
    m = mechanism("crank_slider")
    assert compile_kernel(m).backend == "numpy"
    with pytest.raises(KernelError, match="llvmlite"):
        compile_kernel(m, backend="llvm")


def test_unknown_names_are_refused_and_a_form_of_code_warns_and_has_no_effect():
    for name, value in (("stabilization", "hope"), ("backend", "fortran")):
        with pytest.raises(KernelError, match=value):
            compile_kernel(mechanism("crank_slider"), **{name: value})
    m = mechanism("pendulum")
    with pytest.warns(DeprecationWarning, match="straight-line"):
        old = compile_kernel(m, form="looped")
    np.testing.assert_array_equal(old.acceleration(m.q0, m.v0), kernel("pendulum").acceleration(m.q0, m.v0))
