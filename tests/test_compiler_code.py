"""From tapes to running code: sines, steps, guards, lanes, projection, the cache, and the ways without a compiler."""

import gc
import mmap
import os
import weakref
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest

from gauss_bench.compiler import user_cache
from gauss_bench.compiler.elimination import program as elimination
from gauss_bench.compiler.elimination.program import generate
from gauss_bench.compiler.elimination.rank import RankDecision
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.kernel import Kernel, compile_kernel
from gauss_bench.compiler.machine import graph, native_code, trigonometry
from gauss_bench.compiler.machine.graph import Graph
from gauss_bench.compiler.machine.llvm import write_listing
from gauss_bench.compiler.machine.native_code import Loaded, Target, address
from gauss_bench.compiler.stepping import programs, steps
from gauss_bench.compiler.stepping import rollout as loops
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import build_reference, random_states
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference
from tests.conftest import exhaustive

TRIED = ("crank_slider", "parallelogram", "sleigh", "four_bar/cycloid")  # of linkages that take long together
LINKAGES = exhaustive(("crank_slider", "parallelogram", "sleigh", "shaper", "eight_bar", "five_bar", "excavator"), *TRIED)
DRIVEN = exhaustive(("four_bar/cycloid", "eight_bar/driven", "five_bar/driven"), *TRIED)
H = 1e-4  # [s]


@cache
def mechanism(name: str) -> Mechanism:
    linkage, _, scenario = name.partition("/")
    return load(linkage, scenario) if scenario else load(linkage)


def kernel(name: str, stabilization: str = "none", backend: str = "llvm", **more: object) -> Kernel:
    return compiled(name, stabilization, backend, **more)


@cache
def compiled(name: str, stabilization: str, backend: str, **more: object) -> Kernel:
    return compile_kernel(mechanism(name), stabilization=stabilization, backend=backend, **more)  # type: ignore[arg-type]


@cache
def reference(name: str, t_end: float) -> Reference:
    return build_reference(mechanism(name), t_end)


@cache
def motion(name: str, count: int = 40, gap: int = 50) -> tuple[Array, Array]:
    """Different states along one motion."""
    m = mechanism(name)
    return kernel(name, "projection").rollout(m.q0, m.v0, H, count * gap, every=gap)


def residuals(m: Mechanism, q: Array, v: Array, t: float | Array = 0.0) -> tuple[Array, Array]:
    """Norms of phi and phi' at states (k, n)."""
    evaluator = Evaluator(m)
    rows = evaluator.constraints(t, q, v)
    return np.abs(rows.phi).max(-1), np.abs((rows.J @ v[..., None])[..., 0] + rows.phi_t).max(-1)


def evaluated(g: Graph, roots: list[int], *columns: Array) -> Array:
    """A graph whose leaves are %x0, %x1 ..., run as machine code on columns (k,)."""
    x = np.ascontiguousarray(np.array(columns).T)
    load = graph.Load("x", {g.leaf(f"%x{i}"): i for i in range(x.shape[1])})
    arrays = {"x": graph.Array(x.shape[1]), "out": graph.Array(len(roots))}
    made = graph.Routine("evaluate", g, arrays, (), (), [load, graph.Store("out", roots)], g.all(True), len(roots))
    code = native_code.compile_listing(write_listing(made, 1), cached=False)
    out = np.empty((len(x), len(roots)))
    code.call(address(x), address(out), len(x))
    return out


def ulps(found: Array, exact: list[mpmath.mpf]) -> float:
    """Largest error in units of the last place of the exact values."""
    return max(abs(mpmath.mpf(float(a)) - b) / float(np.spacing(abs(float(b)))) for a, b in zip(found, exact, strict=True))


ARGUMENTS = {
    "a few turns": np.linspace(-10.0, 10.0, 3001),
    "hundreds of turns": np.linspace(-1e3, 1e3, 3001) + 0.1,
    "to the limit": np.linspace(-trigonometry.LARGEST, trigonometry.LARGEST, 3001),
    "quarter turns, where all digits cancel": np.arange(-1500, 1500) * np.pi / 2,
    "tiny": 10.0 ** np.linspace(-300, -3, 500),
}


@pytest.mark.parametrize("arguments", ARGUMENTS.values(), ids=ARGUMENTS)
def test_sine_and_cosine_from_nothing_are_full_doubles(arguments: Array) -> None:
    """The reduction rounds twice, one ulp of r or up to 1.8 of a sine with a smaller exponent; the last sum once, half an ulp."""
    bound = 2.4
    g = Graph()
    found = evaluated(g, list(trigonometry.sincos(g, g.leaf("%x0"))), arguments)
    with mpmath.workprec(200):
        exact = [mpmath.mpf(float(x)) for x in arguments]
        assert ulps(found[:, 0], [mpmath.sin(x) for x in exact]) < bound
        assert ulps(found[:, 1], [mpmath.cos(x) for x in exact]) < bound


@pytest.mark.parametrize(
    "reach", sorted({r for reaches in steps.REACHES.values() for x in reaches[:-1] for r in (x.step, x.correction)})
)
def test_a_rotation_adds_one_rounding_of_one(reach: float, rng: np.random.Generator) -> None:
    x, d = rng.uniform(-4, 4, 2000), np.append(rng.uniform(-reach, reach, 1998), [-reach, reach])
    g = Graph()
    pair = g.leaf("%x0"), g.leaf("%x1")
    found = evaluated(g, list(trigonometry.rotate(g, pair, g.leaf("%x2"), reach)), np.sin(x), np.cos(x), d)
    with mpmath.workprec(200):
        exact = [mpmath.mpf(float(a)) + mpmath.mpf(float(b)) for a, b in zip(x, d, strict=True)]
        off = [abs(mpmath.mpf(float(s)) - mpmath.sin(a)) for (s, _), a in zip(found, exact, strict=True)]
        off += [abs(mpmath.mpf(float(c)) - mpmath.cos(a)) for (_, c), a in zip(found, exact, strict=True)]
    assert max(off) < 1.25 * 2.0**-53  # half from the pair given, half from the sum, an eighth from the series, and little else


@pytest.mark.slow("llvm-parallelogram")
@pytest.mark.parametrize("name", [*LINKAGES, *DRIVEN])
@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_accelerations_are_the_true_ones(name: str, backend: str) -> None:
    truth = random_states(mechanism(name), 40)
    found = kernel(name, backend=backend).acceleration(truth.q, truth.v, truth.t)
    scale = 1.0 + np.abs(truth.a).max(axis=1)
    # rounding times the condition of what is solved; the largest met is 1e-11, next to change points of the parallelogram
    assert (np.abs(found - truth.a).max(axis=1) / scale).max() < (1e-10 if name == "parallelogram" else 1e-12)
    alone = kernel(name, backend=backend).acceleration(truth.q[0], truth.v[0], float(truth.t[0]))
    np.testing.assert_array_equal(alone, found[0])


@pytest.mark.long("none-crank_slider-rk4", "none-shaper-rk4")
@pytest.mark.slow("baumgarte-crank_slider-rk4", "none-crank_slider-gauss_legendre", "projection-crank_slider-gauss_legendre")
@pytest.mark.parametrize(
    ("name", "integrator", "count", "least", "most"),
    [
        ("crank_slider", "rk4", 400, 3.8, 4.2),
        # a slide, and a guide that moves; it turns back within hundredths of a second: a share of order 5 is still in its error
        pytest.param("shaper", "rk4", 1600, 3.8, 4.2, marks=pytest.mark.long),
        ("crank_slider", "dop853_fixed", 20, 7.0, 9.5),
        ("crank_slider", "gauss_legendre", 20, 5.5, 6.5),
    ],
    ids=["crank_slider-rk4", "shaper-rk4", "crank_slider-dop853_fixed", "crank_slider-gauss_legendre"],
)
@pytest.mark.parametrize("stabilization", ["none", "baumgarte", "projection"])
def test_steps_have_their_order(name: str, integrator: str, count: int, least: float, most: float, stabilization: str) -> None:
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

CLOSER = str(Path(__file__).parent / "data" / "door_closer.toml")


@cache
def closing(stabilization: str = "none", backend: str | None = None, formulation: str = "gauss") -> Kernel:
    return compile_kernel(load(CLOSER, "closing"), formulation, stabilization, backend=backend)


@cache
def held() -> tuple[Array, Array]:
    """A state at which the dashpot holds the torque."""
    return closing().rollout(closing().mechanism.q0, closing().mechanism.v0, 2e-5, 2500)


@cache
def closed() -> Array:
    """The state 0.32 s later."""
    return np.concatenate(closing().rollout(*held(), 1e-5, 32_000))


@pytest.mark.long("gauss-none")
@pytest.mark.slow("gauss-projection", "lagrange-none")
@pytest.mark.parametrize(("formulation", "stabilization"), [("gauss", "none"), ("lagrange", "none"), ("gauss", "projection")])
def test_implicit_steps_are_stable_where_explicit_ones_must_be_a_hundred_times_as_short(
    formulation: str, stabilization: str
) -> None:
    """0.32 s in 8 steps, to 1e-9; RK4 leaves the motion in 800 steps, though it is smooth."""
    code = closing(stabilization, formulation=formulation)
    found = np.concatenate(code.rollout(*held(), 0.04, 8, integrator="gauss_legendre"))
    assert np.abs(found - closed()).max() < 1e-9
    assert code.switches == code.fallbacks == code.lost == 0
    explicit = np.concatenate(code.rollout(*held(), 4e-4, 800))
    assert not np.abs(explicit - closed()).max() < 1e-3


@pytest.mark.slow
def test_implicit_steps_keep_energy() -> None:
    """Symplectic: over 20 s of free turning in steps of a hundredth of a turn, what is gained and lost does not add up."""
    m = load(CLOSER, "free")
    code = compile_kernel(m, "gauss", "projection")
    q, v = code.rollout(m.q0, m.v0, 0.01, 2000, every=10, integrator="gauss_legendre")
    off = np.abs(code.energy(q, v) / code.energy(m.q0, m.v0) - 1.0)
    assert off.max() < 1e-6
    assert off[-20:].max() < 3 * off[:20].max() + 1e-12
    assert code.lost == 0


@pytest.mark.slow
def test_implicit_steps_agree_in_lanes_by_arrays_and_interpreted() -> None:
    code, (q, v) = closing("projection"), held()
    alone = np.concatenate(code.rollout(q, v, 0.02, 8, integrator="gauss_legendre"))
    many = code.rollout(np.tile(q, (9, 1)), np.tile(v, (9, 1)), 0.02, 8, integrator="gauss_legendre")
    np.testing.assert_allclose(np.concatenate(many, axis=1), np.tile(alone, (9, 1)), rtol=0, atol=1e-12)
    arrays = closing("projection", "numpy").rollout(q, v, 0.02, 8, integrator="gauss_legendre")
    np.testing.assert_allclose(np.concatenate(arrays), alone, rtol=0, atol=1e-12)
    rank = RankDecision(code.mechanism)
    for k in range(8):
        q, v = rank.step("gauss_legendre", 0.02 * k, q, v, 0.02)
    np.testing.assert_allclose(np.concatenate([q, v]), alone, rtol=0, atol=1e-10)  # another Jacobian, and the same stages


@pytest.mark.slow
def test_an_implicit_step_that_does_not_converge_is_not_counted() -> None:
    """A fifth of a turn and more in one step: the interpreted step takes over, or the trajectory is lost, never wrong by chance."""
    m = load(CLOSER, "free")
    code = compile_kernel(m, "gauss")
    found = np.concatenate(code.rollout(m.q0, m.v0, 0.4, 3, integrator="gauss_legendre"))
    assert code.fallbacks + code.lost > 0
    assert code.lost or np.isfinite(found).all()


@pytest.mark.slow
def test_fixed_and_adaptive_steps_are_those_of_the_interpreted_formulation() -> None:
    m, times = mechanism("crank_slider"), np.linspace(0.0, 0.3, 31)
    for integrator in ("semi_implicit_euler", "dop853_fixed", "dop853"):
        choice = Choice(integrator=integrator, step=2e-3)
        runs = []
        for name in ("gauss-native", "gauss"):
            model = get(name).build(m, choice)
            model.prepare(times)
            model.run()
            runs.append(model.read())
        limit = 1e-8 if integrator == "dop853" else 1e-12  # adaptive steps have other lengths, and the same tolerance
        np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=0, atol=limit)
        assert runs[0].evaluations >= (1 if integrator == "semi_implicit_euler" else 12) * runs[0].steps


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
@pytest.mark.parametrize("stabilization", ["none", "projection"])
def test_adaptive_steps_keep_their_tolerance(stabilization: str, backend: str) -> None:
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


@pytest.mark.parametrize("name", exhaustive(["four_bar/cycloid", "five_bar/driven"], *TRIED))
def test_a_driver_is_followed_in_time(name: str) -> None:
    m = mechanism(name)
    q, v = kernel(name, "projection").rollout(m.q0, m.v0, 1e-3, 300, every=30)
    t = 1e-3 * np.arange(30, 301, 30)
    phi, phi_dot = residuals(m, q, v, t)
    assert phi.max() < 1e-14
    assert phi_dot.max() < 1e-13
    later, _ = kernel(name, "projection").rollout(q[4], v[4], 1e-3, 150, t0=float(t[4]))
    np.testing.assert_allclose(later, q[-1], rtol=0, atol=1e-13)  # rounding, carried over 150 steps


@pytest.mark.parametrize("name", LINKAGES)
@pytest.mark.parametrize("stabilization", ["none", "projection"])
def test_a_lane_computes_the_bits_of_a_single_run(name: str, stabilization: str) -> None:
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


def test_samples_are_the_states_on_the_way() -> None:
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
def test_projection_leaves_rounding_after_each_step(name: str, h: float) -> None:
    m = mechanism(name)
    q, v = kernel(name, "projection").rollout(m.q0, m.v0, h, 1000, every=1)
    phi, phi_dot = residuals(m, q, v, h * np.arange(1, 1001))
    # next to a change point pivots go down to their thresholds, parts of a thousandth, and multiply rounding by their inverse
    worse = 1000 if name == "parallelogram" else 1
    assert phi.max() < worse * 1e-14 * (1 + np.abs(q).max())
    assert (phi_dot / (1 + np.abs(v).max(axis=1))).max() < worse * 1e-13


def test_projection_holds_for_a_hundred_thousand_steps() -> None:
    m = load("crank_slider", "conservative")
    code = compile_kernel(m, stabilization="projection")
    q0, v0 = turning(m)
    q, v = code.rollout(q0, v0, H, 100_000, every=1000)
    phi, phi_dot = residuals(m, q, v)
    assert np.ptp(q[:, 2]) > 1.0  # it swings
    assert phi.max() < 1e-14 * (1 + np.abs(q).max())
    assert (phi_dot / (1 + np.abs(v).max(axis=1))).max() < 1e-13
    energy = code.energy(q, v)
    # (w h)^4 / 120 a radian at w = 10 rad/s: 1e-14 a radian, for 100 rad
    assert np.abs(energy - code.energy(q0, v0)).max() < 1e-11 * np.abs(energy).max()
    assert code.switches == code.fallbacks == code.lost == 0


def turning(m: Mechanism) -> tuple[Array, Array]:
    """The start of a linkage with one degree of freedom, its crank turning with 10 rad/s."""
    direction = np.linalg.svd(Evaluator(m).constraints(0.0, m.q0, m.v0).J)[2][-1]
    assert m.crank is not None
    return m.q0, 10.0 / direction[3 * m.crank + 2] * direction


@pytest.mark.parametrize("name", exhaustive(["crank_slider", "sleigh", "six_bar"], *TRIED))
def test_baumgarte_brings_a_state_back(name: str) -> None:
    m = mechanism(name)
    rng = np.random.default_rng(3)
    q, v = m.q0 + 1e-6 * rng.standard_normal(m.n), m.v0 + 1e-6 * rng.standard_normal(m.n)
    before_q, before_v = residuals(m, q, v)
    after_q, after_v = residuals(m, *kernel(name, "baumgarte").rollout(q, v, 1e-3, 500))
    # alpha t = 10: (1 + 10) exp(-10) = 5e-4 of the start is left, and of the rate, which the position feeds, 20 times that
    assert after_v < 0.02 * (before_q * 20 + before_v)
    assert name == "sleigh" or after_q < 1e-3 * (before_q + before_v / 20)


def test_the_acceleration_asked_for_is_without_baumgarte() -> None:
    m = mechanism("crank_slider")
    q = m.q0 + np.linspace(-1e-3, 1e-3, m.n)
    plain = kernel("crank_slider").acceleration(q, m.v0)
    for backend in ("llvm", "numpy"):
        damped = kernel("crank_slider", "baumgarte", backend).acceleration(q, m.v0)
        np.testing.assert_allclose(damped, plain, rtol=0, atol=1e-13 * np.abs(plain).max())


def test_after_preparing_nothing_is_compiled_in_a_rollout() -> None:
    m = mechanism("crank_slider")
    code = compile_kernel(m, cache=False)
    code.prepare()
    code.prepare(many=True)
    seconds = code.compile_seconds
    code.rollout(m.q0, m.v0, 1e-3, 2000)
    code.rollout(np.tile(m.q0, (9, 1)), np.tile(m.v0, (9, 1)), 1e-2, 100)
    assert code.compile_seconds == seconds


def running(name: str, count: int) -> tuple[Array, Array]:
    m = mechanism(name)
    return kernel(name).rollout(m.q0, m.v0, H, count)


@pytest.mark.parametrize("stabilization", ["none", "projection"])
@pytest.mark.parametrize("every", [None, 7, 500])
def test_a_bad_partition_passes_the_dead_centre_by_a_good_one(stabilization: str, every: int | None) -> None:
    """The slider as independent coordinate cannot pass the dead centre, where it stands still; the crank can."""
    q, v = running("crank_slider", 1500)
    bad = kernel("crank_slider", stabilization, formulation="gauss", independent=(6,))
    assert bad.partitions[0] == (6,)
    found = np.concatenate(bad.rollout(q, v, H, 4000, every=every), axis=-1)
    expected = np.concatenate(kernel("crank_slider", stabilization).rollout(q, v, H, 4000, every=every), axis=-1)
    # near the dead centre a rounding of the slider moves the crank a thousand times as far, the inverse of the pivot's threshold
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    assert bad.switches >= 1
    assert bad.fallbacks == bad.lost == 0


def test_lanes_that_stop_do_not_disturb_the_others() -> None:
    q, v = motion("crank_slider")
    bad = kernel("crank_slider", formulation="gauss", independent=(6,))
    found = np.concatenate(bad.rollout(q, v, H, 1500, every=100), axis=-1)
    expected = np.concatenate(kernel("crank_slider").rollout(q, v, H, 1500, every=100), axis=-1)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    assert bad.switches > 0


def test_without_another_partition_the_rank_decides() -> None:
    q, v = running("crank_slider", 1500)
    bad = compile_kernel(mechanism("crank_slider"), "gauss", "projection", independent=(6,))
    bad._programs._more = iter(())
    found = np.concatenate(bad.rollout(q, v, H, 4000))
    expected = np.concatenate(kernel("crank_slider", "projection").rollout(q, v, H, 4000))
    # next to the dead centre a projection that keeps the slider moves the crank, up to the inverse of the pivot's threshold
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7)
    assert bad.fallbacks >= 1
    at_dead_centre = turning(mechanism("crank_slider"))  # the linkage starts there, stretched
    exact = kernel("crank_slider").acceleration(*at_dead_centre)
    np.testing.assert_allclose(bad.acceleration(*at_dead_centre), exact, rtol=0, atol=1e-12 * np.abs(exact).max())


@pytest.mark.usefixtures("full_search")  # what a short one finds may be singular where rounding decides
@pytest.mark.parametrize("formulation", ["gauss", "lagrange"])
@pytest.mark.parametrize("stabilization", ["none", "projection"])
def test_three_parallel_cranks_turn_without_a_hand_over(stabilization: str, formulation: str) -> None:
    """Whichever row is dropped, the others are singular twice a turn; not so what is left of a combination of two rows."""
    m, code = mechanism("parallelogram"), compile_kernel(mechanism("parallelogram"), formulation, stabilization)
    q, v = code.rollout(m.q0, m.v0, H, 10_000, every=100)
    assert code.switches == code.fallbacks == code.lost == 0
    cranks = q[:, [2, 5, 8]] - m.q0[[2, 5, 8]]
    assert np.abs(cranks[-1]).max() > 2 * np.pi
    assert np.ptp(cranks, axis=1).max() < 1e-10
    assert residuals(m, q, v)[0].max() < 1e-10


def test_redundant_rows_are_taken_back_where_nothing_projects() -> None:
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


def test_steps_of_their_own_choice_take_redundant_rows_back_too() -> None:
    """In 20 s the rows of three parallel cranks drift by 1e-4 m where nothing does, and there are half as many steps again."""
    m, code = mechanism("parallelogram"), kernel("parallelogram")
    found = code.integrate(m.q0, m.v0, np.linspace(0.0, 20.0, 21), 1e-6, 1e-8)
    assert residuals(m, found.q, found.v)[0].max() < 5e-6
    assert found.steps < 900


@pytest.mark.parametrize(("steps_a_second", "far"), [(160, False), (50, True)])
def test_steps_of_order_eight_turn_sines_to_either_side_of_their_middle(steps_a_second: int, far: bool) -> None:
    """As far as half a radian, from there on they come from nothing; numpy has them from nothing always."""
    m, code = mechanism("four_bar"), compile_kernel(mechanism("four_bar"), "gauss", "projection")
    exact = kernel("four_bar", "projection", backend="numpy", formulation="gauss")
    found, expected = (
        np.concatenate(x.rollout(m.q0, m.v0, 1 / steps_a_second, steps_a_second, integrator="dop853_fixed")) for x in (code, exact)
    )
    runner = code._programs.runner(0, "dop853_fixed")
    assert isinstance(runner, programs.Stepper)
    assert (runner.further is None) == far
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


def test_a_step_that_goes_too_far_is_done_by_the_exact_variant() -> None:
    """Over 0.4 rad in one step: no rotation reaches that far."""
    m = mechanism("crank_slider")
    q, v = running("crank_slider", 20_000)
    for stabilization in ("none", "projection"):
        found = kernel("crank_slider", stabilization).rollout(q, v, 1e-2, 40, every=1)
        expected = kernel("crank_slider", stabilization, "numpy").rollout(q, v, 1e-2, 40, every=1)
        assert np.abs(found[1][:, 2]).max() * 1e-2 > steps.REACHES["rk4"][1].step
        np.testing.assert_allclose(np.array(found), np.array(expected), rtol=1e-9, atol=1e-9)  # rounding, grown by coarse steps
    assert m.n == q.size


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_what_cannot_go_on_is_not_a_number(backend: str) -> None:
    m = mechanism("crank_slider")
    code = kernel("crank_slider", backend=backend)
    v = np.stack([m.v0, np.full(m.n, np.nan), m.v0 + 1e200])
    q, _ = code.rollout(np.tile(m.q0, (3, 1)), v, H, 3)
    assert np.isfinite(q[0]).all()
    assert np.isnan(q[1:]).all()
    assert code.lost == 2


@pytest.mark.parametrize("name", exhaustive(["crank_slider", *TRIED[2:], "six_bar", "excavator"], *TRIED[2:]))
@pytest.mark.parametrize("stabilization", ["none", "baumgarte", "projection"])
@pytest.mark.parametrize("integrator", ["rk4", "semi_implicit_euler"])
def test_the_way_without_a_compiler_agrees(name: str, stabilization: str, integrator: str) -> None:
    m = mechanism(name)
    native = kernel(name, stabilization)
    expected = np.concatenate(native.rollout(m.q0, m.v0, H, 300, every=70, integrator=integrator), axis=1)
    other = kernel(name, stabilization, "numpy").rollout(m.q0, m.v0, H, 300, every=70, integrator=integrator)
    np.testing.assert_allclose(np.concatenate(other, axis=1), expected, rtol=1e-11, atol=1e-11)  # rounding of 300 steps


def test_a_call_keeps_its_code_in_memory() -> None:
    g = graph.Graph()
    x, arrays = g.leaf("%x"), {"x": graph.Array(1), "y": graph.Array(1)}
    body = [graph.Load("x", {x: 0}), graph.Store("y", [g.mul(x, x)])]
    square = Loaded(lambda many: graph.Routine("square", g, arrays, (), (), body, g.all(True), 1), Target("llvm", 4, cache=False))
    call = square.single(1, 1)
    code = weakref.ref(square.codes[1])
    del square
    gc.collect()
    assert code() is not None  # else the next call would be of what is no longer there
    call.arrays[0][:] = 3.0
    call.run()
    assert call.arrays[1][0] == 9.0


def test_open_parameters_differ_from_lane_to_lane() -> None:
    m = mechanism("crank_slider")
    names = ("links.crank.mass", "gravity.y")
    code = compile_kernel(m, open_parameters=names)
    assert code.parameters == names
    p = np.array([[0.37 + 0.1 * k, -9.81 + k] for k in range(10)])
    q, v = motion("crank_slider", 10)
    together = np.concatenate(code.rollout(q, v, H, 100, parameters=p), axis=1)
    alone = [np.concatenate(code.rollout(a, b, H, 100, parameters=x)) for a, b, x in zip(q, v, p, strict=True)]
    np.testing.assert_array_equal(together, alone)
    assert np.ptp(together[:, m.n + 2]) > 0
    nominal = np.concatenate(code.rollout(q, v, H, 100), axis=1)
    fixed = np.concatenate(kernel("crank_slider").rollout(q, v, H, 100), axis=1)
    np.testing.assert_allclose(nominal, fixed, rtol=1e-11, atol=1e-11)  # the file's values, rounded in another order
    with pytest.raises(ValueError, match="2 are open"):
        code.rollout(q, v, H, 1, parameters=p[:, :1])


def test_forces_and_energy() -> None:
    m = mechanism("crank_slider")
    q, v = motion("crank_slider")
    evaluator, code = Evaluator(m), kernel("crank_slider")
    # [J] near zero the rounding of its parts remains
    np.testing.assert_allclose(code.energy(q, v), evaluator.energy(q, v), rtol=1e-13, atol=1e-16)
    a, multipliers = code.acceleration(q, v), code.forces(q, v)
    for k in range(len(q)):
        terms = evaluator.terms(0.0, q[k], v[k])
        balance = terms.M @ a[k] + terms.J.T @ multipliers[k] - terms.Q
        assert np.abs(balance).max() < 1e-11 * np.abs(multipliers[k]).max()


@pytest.mark.long("crank_slider-more0", "n_four_bar_3-more2")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "more"),
    [("crank_slider", {}), ("parallelogram", {"stabilization": "projection"}), ("n_four_bar_3", {})],
)
def test_code_that_is_soon_there_computes_the_same_bits(name: str, more: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every kind of step, alone and in lanes: tests run the former, users and the gate the latter."""
    m = mechanism(name)
    many = np.tile(m.q0, (5, 1)), m.v0 * np.linspace(0.9, 1.1, 5)[:, None]

    def results() -> Array:
        code, found = compile_kernel(m, **more), []
        for integrator in ("rk4", "semi_implicit_euler", "dop853_fixed"):
            found += code.rollout(m.q0, m.v0, 1e-3, 40, integrator=integrator)
        found += code.rollout(m.q0, m.v0, 1e-3, 40, integrator="gauss_legendre")
        chosen = code.integrate(m.q0, m.v0, np.linspace(0.0, 0.05, 6), 1e-8, 1e-10)
        found += [chosen.q, chosen.v]
        found += [*code.rollout(*many, 1e-3, 40), code.acceleration(m.q0, m.v0)]
        return np.concatenate([x.ravel() for x in found])

    soon = results()
    monkeypatch.delenv(native_code.QUICK)
    assert np.isfinite(soon).all()
    np.testing.assert_array_equal(results(), soon)


def test_it_does_not_matter_where_in_memory_code_comes_to_lie() -> None:
    """Beside libraries that take gigabytes of addresses, parts of a module would be too far apart for its short references."""
    m, taken, found = mechanism("crank_slider"), [], []
    for _ in range(3):
        found.append(compile_kernel(m, "gauss", cache=False).acceleration(m.q0, m.v0))
        taken += [mmap.mmap(-1, 3 << 30, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, prot=mmap.PROT_READ) for _ in range(3)]
    np.testing.assert_array_equal(found, [kernel("crank_slider").acceleration(m.q0, m.v0)] * 3)
    assert len(taken) == 9


def test_a_second_compilation_comes_from_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_object_code_belongs_to_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache.store("a.o", b"code")
    assert user_cache.load("a.o") == b"code"
    folder = user_cache.folder()
    (folder / "b.o").write_bytes((folder / "a.o").read_bytes())
    assert user_cache.load("b.o") is None  # a file under another name
    (folder / "a.o").write_bytes((folder / "a.o").read_bytes()[:-1])
    assert user_cache.load("a.o") is None


@pytest.mark.slow
def test_a_search_is_done_once_and_its_program_is_the_same_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no POSIX permissions")
def test_a_folder_that_others_may_enter_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    user_cache.store("a.o", b"code")
    folder = user_cache.folder()
    folder.chmod(0o755)
    assert user_cache.load("a.o") is None
    assert not user_cache.store("b.o", b"code")
    folder.chmod(0o700)
    uid = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: uid + 1)
    assert user_cache.load("a.o") is None
    assert not user_cache.store("b.o", b"code")


def test_a_link_in_place_of_the_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir(mode=0o700)
    user_cache.folder().parent.mkdir(parents=True)
    user_cache.folder().symlink_to(elsewhere)
    assert not user_cache.store("a.o", b"code")
    assert not list(elsewhere.iterdir())


def test_without_a_compiler_numpy_is_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native_code, "available", lambda: False)
    m = mechanism("crank_slider")
    assert compile_kernel(m).backend == "numpy"
    with pytest.raises(KernelError, match="llvmlite"):
        compile_kernel(m, backend="llvm")


@pytest.mark.parametrize(
    "wrong",
    [{"stabilization": "hope"}, {"backend": "fortran"}, {"formulation": "newton"}, {"open_parameters": ("links.crank.colour",)}],
)
def test_unknown_names_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(KernelError):
        compile_kernel(mechanism("crank_slider"), **wrong)  # type: ignore[arg-type]
