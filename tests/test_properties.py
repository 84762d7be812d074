"""What holds of any linkage: statements over linkages that hypothesis draws, of every joint, force and driver of the grammar.

Here each is shown by a few examples, always the same; `make fuzz` draws PROPERTIES of each, by a seed that it prints.

What two ways of computing may differ by follows from the problem alone. In weighted coordinates b = M^(1/2) a, f = M^(-1/2) Q, with
rows K of J M^(-1/2) scaled to unit length, what rounding of relative size eps does to the solution of

    minimise |b - f|   subject to   K b = gamma

is at most about n eps cond(K) (|b| + |f|) (Bjorck, Numerical Methods for Least Squares Problems, 1996, section 5.1), times a number
ROOM that depends on the way and not on the problem: `Problem.rounding`.
Ways that start from the state instead of from the same terms may also take the state to be another one, by eps cond(K) of its size,
which is what closing loops in other coordinates leaves; how much the accelerations change then is tried out: `Problem.moved`.
"""

import tempfile
import tomllib
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, event, given
from hypothesis import strategies as st

from gauss_bench import metrics
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.exchange.export import export_linkage
from gauss_bench.exchange.imports import import_file
from gauss_bench.exchange.toml import toml
from gauss_bench.formulations import CONTROLS, FORMULATIONS
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.kinematics.motion import LimitOfMotion, SingularPosition
from gauss_bench.linkage.digest import content_digest
from gauss_bench.linkage.load import load_document
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.forces import Jammed, JointFriction
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status
from tests.drawn_linkages import FORCES, PARTS, UNDRIVEN, every_freedom, examples, linkages

EPS = float(np.finfo(float).eps)
SINGULAR = 1e-9  # of the largest singular value: rows below it are redundant, as where a linkage is assembled
ROOM = 32  # where two ways differ by rounding alone; 5 is the most that any way needed for 320 linkages
WORST = 1e6  # cond(K), beyond which a position counts as singular and nothing is claimed
SOUND = sorted(FORMULATIONS.keys() - CONTROLS)
INDEPENDENT = ("lagrange", "schur")  # take independent rows alone
SQUARED = ("schur",)  # solves K K^T, whose condition is the square
STEP = Choice(integrator="rk4")
EXACT = 1e-12


@dataclass(frozen=True)
class Problem:
    """A mechanism at a consistent state: the accelerations it must have, by singular values, and what rounding does."""

    mechanism: Mechanism
    t: float
    q: Array
    v: Array

    @cached_property
    def motion(self):
        return AbsoluteCoordinates(self.mechanism)

    def at(self, q, v):
        """M^(1/2) a at a state (n,)."""
        return np.asarray(self.motion.acceleration(np.array([self.t]), q[None], v[None])[0] * self.motion.root)

    @cached_property
    def b(self):
        return self.at(self.q, self.v)

    @cached_property
    def condition(self):
        K = self.motion.evaluator.constraints(self.t, self.q, self.v).J / self.motion.root
        s = np.linalg.svd(K / np.linalg.norm(K, axis=1, keepdims=True), compute_uv=False)
        return float(s[0] / s[s > SINGULAR * s[0]][-1])

    @cached_property
    def rounding(self):
        """The largest difference of |M^(1/2) a| that rounding can cause between methods with the same terms."""
        f = self.motion.evaluator.applied.generalised(self.q, self.v, self.t) / self.motion.root
        size = float(np.linalg.norm(self.b) + np.linalg.norm(f))
        settled = JointFriction.STALLED * size if self.mechanism.has_friction else 0.0  # where the loads of joints are iterated
        return ROOM * self.condition * (self.mechanism.n * EPS * size + settled)

    @cached_property
    def moved(self):
        """The same between methods that round the state differently: changes by 1e-7 in three directions show the effect."""
        rng, small = np.random.default_rng(0), 1e-7
        changes = []
        for _ in range(3):
            dq, dv = rng.normal(size=(2, self.mechanism.n))
            q, v = self.q + small * (1 + np.abs(self.q)) * dq, self.v + small * (1 + np.abs(self.v)) * dv
            q, v = self.motion.evaluator.project(self.t, q, v)
            changes.append(float(np.linalg.norm(self.at(q, v) - self.b)))
        return self.rounding + ROOM * max(changes) / small * EPS * self.condition

    def off(self, a):
        """Return the weighted distance of accelerations (n,) from the true ones."""
        return float(np.linalg.norm(a * self.motion.root - self.b))


def problem(document, seed):
    """The linkage at a consistent state drawn about its start; singular ones, and joints that jam, are passed over."""
    mechanism = load_document(document)
    motion, rng = AbsoluteCoordinates(mechanism), np.random.default_rng(seed)
    t = float(rng.uniform(0.0, 0.1))
    q, v = motion.evaluator.project(t, mechanism.q0, mechanism.v0)
    basis = motion.null_space(q)
    q, _ = motion.evaluator.project(t, q + basis @ rng.normal(0.0, 0.1, basis.shape[1]), v)
    v = mechanism.v0 + motion.null_space(q) @ rng.uniform(-3.0, 3.0, basis.shape[1])
    q, v = motion.evaluator.project(t, q, v)
    rows = motion.evaluator.terms(t, q, v)
    assume(max(np.abs(rows.phi).max(), np.abs(rows.phi_dot).max()) < 1e-12)
    found = Problem(mechanism, t, q, v)
    assume(found.condition < WORST)
    try:
        assert np.isfinite(found.b).all()
    except Jammed:
        assume(False)
    event(f"{len(mechanism.links)} bodies")
    return found


SEEDS = st.integers(0, 99)


@given(linkages(), SEEDS)
@examples(12)
def test_all_formulations_and_pinocchio_accelerate_alike(document, seed):
    x = problem(document, seed)
    for name in SOUND:
        if x.mechanism.redundant and name in INDEPENDENT:
            continue
        off = x.off(get(name).build(x.mechanism, STEP).acceleration(x.t, x.q, x.v))
        assert off <= x.rounding * (x.condition if name in SQUARED else 1.0), name
    engine = get("pinocchio")
    if find_spec("pinocchio") and engine.skip(x.mechanism, STEP) is None:
        event("by Pinocchio too")
        assert x.off(engine.build(x.mechanism, STEP).acceleration(x.t, x.q, x.v)) <= x.moved


@given(linkages())
@examples(6)
def test_energy_changes_by_the_work_of_what_has_no_potential(document):
    """The energy of a run changes by the work of dampers, friction, drivers and forces that turn or vary."""
    mechanism = load_document(document)
    model = get("gauss").build(mechanism, Choice(integrator="dop853"))
    model.prepare(np.linspace(0.0, 0.04, 33))
    try:
        model.run()
        run = model.read()
    except RunFailure as failure:
        assume(failure.status is not Status.NOT_CONVERGED)
        raise
    evaluator = Evaluator(mechanism)
    error, bar = metrics.energy_error(evaluator, run)
    assert np.abs(error).max() <= bar + TOLERANCE * metrics.energy_scale(evaluator, run)


TOLERANCE = 1e-8  # of DOP853 at 1e-10 a step, over some dozens


@given(linkages(parts=[x for x in PARTS if x != "sled"], laws=every_freedom()))
@examples(12)
def test_driven_kinematics_are_the_dynamics_of_the_same_linkage(document):
    """By closing loops, without forces: velocities and accelerations meet all rows of the dynamics, and are rates of each other."""
    mechanism = load_document(document)
    h, middle = 1e-3, 0.04  # before the first knot of any law
    times = middle + h * np.arange(-2, 3)
    try:
        found = loop_motion(mechanism, times)
    except (LimitOfMotion, SingularPosition):
        assume(False)
    x = Problem(mechanism, middle, found.q[2], found.v[2])
    assume(x.condition < WORST)
    rows = Evaluator(mechanism).terms(middle, x.q, x.v)
    closed = EPS * x.condition * mechanism.n
    size = 1 + max(np.abs(found.q).max(), np.abs(found.v).max())
    assert np.abs(rows.phi).max() <= closed * size
    assert np.abs(rows.phi_dot).max() <= closed * size
    assert x.off(found.a[2]) <= x.moved
    for values, rate in ((found.q, found.v), (found.v, found.a)):
        near, far = (values[3] - values[1]) / (2 * h), (values[4] - values[0]) / (4 * h)
        bar = np.abs(far - near) + 4 * closed * (1 + np.abs(values).max()) / h  # what h^2 leaves, and rounding over h
        assert (np.abs((4 * near - far) / 3 - rate[2]) <= bar).all()


def by_name(mechanism, order, x):
    names = [link.name for link in mechanism.links]
    return np.asarray(x.reshape(-1, 3)[[names.index(name) for name in order]])


@pytest.mark.slow
@given(
    linkages(
        parts=[x for x in PARTS if x != "sled"],
        forces=tuple(x for x in FORCES if x != "friction"),
        laws=UNDRIVEN,
        varying=False,
        twice=False,
    ),
    SEEDS,
)
@examples(4, share=0.5)
def test_what_goes_out_as_mjcf_comes_back(document, seed):
    """Masses, dimensions and the start are the same, and forces do the same work along the free motions."""
    pytest.importorskip("mujoco")
    x = problem(document, seed)
    mechanism = x.mechanism
    assume(get("mujoco").skip(mechanism, STEP) is None)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.xml"
        file.write_text(export_linkage(mechanism, "mujoco", 1e-3).text, encoding="utf-8")
        back = load_document(tomllib.loads(import_file(file, "back").text))
    order = [link.name for link in mechanism.links]
    assert sorted(order) == sorted(link.name for link in back.links)
    assert (back.dof, back.redundant) == (mechanism.dof, mechanism.redundant)
    assert by_name(back, order, back.mass) == pytest.approx(by_name(mechanism, order, mechanism.mass), rel=EXACT)
    for link, own in ((link, next(x for x in back.links if x.name == link.name)) for link in mechanism.links):
        places = np.array([place - own.com for place in own.points.values()])
        for point, place in link.points.items():  # by place: points of welded links have names of two words, which become one
            assert np.abs(places - (place - link.com)).max(axis=1).min() < EXACT, point
    moved = by_name(back, order, back.q0) - by_name(mechanism, order, mechanism.q0)
    moved[:, 2] = np.remainder(moved[:, 2] + np.pi, 2 * np.pi) - np.pi  # a file may tell an angle as pi or as -pi
    assert np.abs(moved).max() < EXACT * (1 + np.abs(mechanism.q0).max())
    speeds = by_name(mechanism, order, mechanism.v0)
    assert by_name(back, order, back.v0) == pytest.approx(speeds, abs=EXACT * (1 + np.abs(speeds).max()))
    columns = [3 * [x.name for x in back.links].index(name) + k for name in order for k in range(3)]
    q, v = np.zeros((2, mechanism.n))
    q[columns], v[columns] = x.q, x.v
    wanted, found = (Evaluator(m).applied.generalised(*at) for m, at in ((mechanism, (x.q, x.v)), (back, (q, v))))
    ways = x.motion.null_space(x.q)  # damping between links that a loop ties may be told of others that the loop ties too
    assert ways.T @ found[columns] == pytest.approx(ways.T @ wanted, abs=EXACT * (1 + np.abs(wanted).max()))


@given(linkages())
@examples(12)
def test_a_file_written_and_read_again_is_the_same_mechanism(document):
    mechanism = load_document(document)
    again = load_document(tomllib.loads(toml(document, ["A head\nof two lines."])))
    assert again.digest == mechanism.digest
    assert content_digest(again) == content_digest(mechanism)
