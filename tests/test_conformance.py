"""What an adapter must keep to: sound ones do, and whoever breaks one rule is told which."""

import json
from dataclasses import replace

import numpy as np
import pytest

import gauss_bench.bench.conformance as rules
from gauss_bench.bench import agreement, subject
from gauss_bench.bench.agreement import Answer, _compare, _from_coarse_to_fine, digits, effect, find_loose, is_excusable
from gauss_bench.bench.conformance import conformance, explains_lateness, lateness, rates_fault
from gauss_bench.bench.probes import PROBE, _share, changes, numbers, probe
from gauss_bench.bench.subject import Check
from gauss_bench.cli import main
from gauss_bench.engines import SAFE, all_names
from gauss_bench.engines.base import Choice
from gauss_bench.engines.shared import open_tree
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.integrate.fixed_step import dop853_tableau
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.runs.offers import offer, offers
from gauss_bench.runs.one_run import Run, sampling_at
from gauss_bench.runs.questions import SUBSTEPS, follow_accelerations
from gauss_bench.runs.worker import Worker
from gauss_bench.trajectory import Status, Trajectory

WRONG = "yuan_ge_eq16"  # as published
LEAVES_OUT = "mjx"  # the velocity term of its constraints: its own test says so
SINGLE = "newton"  # in single precision, which keeps no rule to 1e-9
ALIKE = ("gauss_pinv", "schur", "udwadia_kalaba", "lagrange-native")  # by the adapter of another
SEEN = 1e-3  # of a relative error of any number in the accelerations: one of 1e-6 is then seen at 1e-9


def broken(name):
    return {x.name: x.message for x in conformance(name) if x.passed is False}


def only(monkeypatch, *names):
    """Ask these checks alone."""
    monkeypatch.setattr(rules, "CHECKS", [x for x in rules.CHECKS if x.__name__ in names])


@pytest.mark.long("by_hand", "casadi", "exudyn", "gauss-native", "gauss", "lagrange", "minimal", "mujoco", "pinocchio")
@pytest.mark.slow
@pytest.mark.parametrize("name", [x for x in all_names() if x not in (WRONG, LEAVES_OUT, SINGLE, *ALIKE)])
def test_built_in_engines_keep_every_rule(name):
    assert not broken(name)


@pytest.mark.long("Late-_check_derivatives-velocities and accelerations are derivatives")
@pytest.mark.long("Degrees-_check_start-the first sample is the start", "Short-_check_times-samples are at the times asked for")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "check", "rule"),
    [
        ("Remembers", "_check_repetition", "a model can run again"),
        ("Degrees", "_check_start", "the first sample is the start"),
        ("Late", "_check_derivatives", "velocities and accelerations are derivatives"),
        ("Short", "_check_times", "samples are at the times asked for"),
        ("Weightless", "check_forces", "a torque acts as defined"),
        ("Unsure", "_check_undisturbed", "an acceleration is a finite number"),
    ],
)
def test_a_broken_rule_is_named(fault, check, rule, monkeypatch):
    """By the check of that rule; that a sound engine passes all of them is told above."""
    only(monkeypatch, check)
    assert any(name.startswith(rule) for name in broken(f"tests.faulty_engines:{fault}"))


@pytest.mark.long("AllInertias", "AllMasses", "Gravity", "Entry", "Regular", WRONG)
@pytest.mark.slow
@pytest.mark.parametrize("fault", ["OneInertia", "AllInertias", "AllMasses", "Gravity", "Gamma", "Entry", "Regular", WRONG])
def test_a_wrong_model_is_seen_in_its_accelerations(fault, monkeypatch):
    only(monkeypatch, "check_accelerations")
    found = broken(fault if fault == WRONG else f"tests.faulty_engines:{fault}")
    assert "probe loaded" in found["accelerations (default, rk4, none)"]


@pytest.mark.slow
def test_what_is_declared_soft_may_miss_its_constraints_and_nothing_else(monkeypatch):
    monkeypatch.setattr(agreement, "LINKAGES", agreement.PLAIN)
    only(monkeypatch, "check_accelerations", "check_motions")
    assert not broken("tests.faulty_engines:Springs")
    only(monkeypatch, "check_accelerations")
    assert "N^T (M a - Q)" in broken("tests.faulty_engines:Excused")["accelerations (default, rk4, none)"]
    assert "J a is 0.00 of gamma" in broken("tests.faulty_engines:Gammaless")["accelerations (default, rk4, none)"]


def solved(on, shares, softness=0.0):
    """The accelerations at the states of a probe if row k of J a is shares[k] gamma, and gives way in proportion to its force."""
    evaluator, given = AbsoluteCoordinates(on.mechanism).evaluator, []
    for t, q, v in zip(on.t, on.q, on.v, strict=True):
        terms = evaluator.terms(float(t), q, v)
        K = np.block([[terms.M, terms.J.T], [terms.J, -softness * np.eye(len(terms.J))]])
        given.append(np.linalg.solve(K, np.concatenate([terms.Q, shares * terms.gamma]))[: on.mechanism.n])
    return np.array(given)


def test_constraints_without_their_velocity_term_are_named_though_loops_are_soft():
    on = probe("four_bar", "torque")
    said = "J a is {:.2f} of gamma: the velocity term dJ/dt v of the constraints is missing or wrong"
    for share in (0.01, 0.4, 1.0, -1.0):
        found = on.share_of_gamma(solved(on, share * np.ones(8)))
        assert found == pytest.approx(share, abs=1e-12)
        assert Answer(off=0.0, along=0.0, gamma=found).fault(soft=True) == ("" if share == 1.0 else said.format(share))
    for last in (1.0, 0.0):  # of gamma in the last row alone, beside soft ones
        assert on.share_of_gamma(solved(on, np.array([*np.ones(7), last]), 0.1)) == pytest.approx(last, abs=1e-9)


@pytest.mark.parametrize(("share", "softness"), [(0.0, 0.0), (0.4, 0.1), (1.0, 0.1)])
def test_the_share_of_an_engine_of_joint_trees_is_that_of_the_term_in_its_own_coordinates(share, softness):
    """Of the crank-slider's gamma it would be -9.2 and not 0: the closing pin's own term is small beside that of the whole tree."""
    on = probe("crank_slider", "paper")
    tree, evaluator = spanning_tree(on.mechanism), Evaluator(on.mechanism)
    given = []
    for t, q, v in zip(on.t, on.q, on.v, strict=True):
        y, dy = tree.relative(q, v)
        own, terms = open_tree(evaluator, tree, y, dy), evaluator.terms(float(t), q, v)
        speeds = tree.absolute(np.tile(y, (tree.n, 1)), np.eye(tree.n), np.zeros((tree.n, tree.n)))[1]
        velocity = terms.gamma - terms.J @ tree.absolute(y, dy, 0.0 * y)[2]
        closing = np.flatnonzero(np.abs(terms.J @ speeds.T).max(axis=1) > 1e-9)
        J = terms.J[closing] @ speeds.T
        K = np.block([[own.mass, J.T], [J, -softness * np.eye(len(J))]])
        ddy = np.linalg.solve(K, np.concatenate([own.forces, share * velocity[closing]]))[: tree.n]
        given.append(tree.absolute(y, dy, ddy)[2])
    assert on.share_of_gamma(np.array(given)) == pytest.approx(share, abs=1e-9)


def test_a_row_that_nothing_holds_has_no_share_and_its_loop_opens():
    """As of a spring where its loop is closed, or of a closure that is not there; the run then tells which it is."""
    on = probe("four_bar", "torque")
    mechanism, tree, evaluator = on.mechanism, spanning_tree(on.mechanism), Evaluator(on.mechanism)

    def fall(y, dy):
        own = open_tree(evaluator, tree, y, dy)
        return np.linalg.solve(own.mass, own.forces)

    states = [tree.relative(q, v) for q, v in zip(on.q, on.v, strict=True)]
    assert on.share_of_gamma(np.array([tree.absolute(*y, fall(*y))[2] for y in states])) == pytest.approx(1.0)
    y, dy = tree.relative(mechanism.q0, mechanism.v0)
    rows = [(y, dy)]
    for _ in range(100):  # steps of a millisecond
        dy = dy + 1e-3 * fall(y, dy)
        y = y + 1e-3 * dy
        rows.append((y, dy))
    q, v, a = tree.absolute(*(np.array(x) for x in zip(*rows, strict=True)), np.zeros((101, tree.n)))
    assert "nothing holds them" in find_loose(mechanism, Trajectory(1e-3 * np.arange(101), q, v, a, 100))
    assert not find_loose(mechanism, Trajectory(np.zeros(1), q[:1], v[:1], a[:1], 0))
    assert replace(on, v=0.0 * on.v).share_of_gamma(0.0 * on.a) == 1.0  # without any velocity term none is missed


def test_settings_cannot_be_unfinished_and_only_mujoco_and_exudyn_declare_anything(monkeypatch):
    only(monkeypatch, "check_declarations")
    assert "only variants" in broken("tests.faulty_engines:Hasty")["every declared inexactness has a cause"]
    assert {x.name for x in offers([*SAFE]) if x.soft or x.unfinished} == {"mujoco", "exudyn"}


class StiffSpring:
    """A mass on a spring and critical damper with a period of a millisecond: x = (1 + w t) exp(-w t) from x = 1 at rest."""

    frequency = 2 * np.pi / 1e-3  # [rad/s]

    def acceleration(self, t, q, v):
        return -2 * self.frequency * v - self.frequency**2 * q


def test_the_finer_steps_follow_a_vibration_of_a_millisecond():
    """Explicit steps of a millisecond do not."""
    start, rest, spring = np.ones(1), np.zeros(1), StiffSpring()
    true = (1 + spring.frequency * agreement.TIMES) * np.exp(-spring.frequency * agreement.TIMES)
    off = {}
    for finer in (SUBSTEPS, agreement.STIFF):
        with np.errstate(all="ignore"):
            places = follow_accelerations(dop853_tableau(), agreement.TIMES, start, rest, spring, finer=finer)[0, :, 0]
        off[finer] = np.abs(places - true).max()
    assert off[agreement.STIFF] < 1e-8
    assert not off[SUBSTEPS] < 1e-3


@pytest.mark.long
def test_second_settings_and_integrators_are_looked_at_too(monkeypatch):
    only(monkeypatch, "check_accelerations", "check_motions")
    found = broken("tests.faulty_engines:Trap")
    assert {"accelerations (tuned, rk4, none)", "accelerations (default, other, none)"} <= found.keys()
    assert "no such method" in found["a run (default, other, none; probe loaded)"]
    assert not any(name.startswith("accelerations (default, rk4") for name in found)


@pytest.mark.long("Deaf")
@pytest.mark.slow
@pytest.mark.parametrize("fault", ["TwoFaced", "Deaf"])
def test_a_run_is_held_against_what_it_should_follow(fault, monkeypatch):
    only(monkeypatch, "check_accelerations", "check_motions")
    found = broken(f"tests.faulty_engines:{fault}")
    assert found
    assert all(name.startswith("a run") for name in found)


def test_nothing_is_asked_once_the_time_is_spent(monkeypatch):
    monkeypatch.setattr(subject, "LONGEST", 0.0)
    only(monkeypatch, "check_accelerations", "check_motions", "_check_times")
    checks = conformance("tests.faulty_engines:Trap")
    assert {x.passed for x in checks[1:]} == {None}
    assert all("are used" in x.message for x in checks[1:])


def test_accelerations_agree_to_nine_digits_and_soft_ones_to_eight_along_what_is_free():
    for off, along, hard, soft in (
        (0.9e-9, 0.9e-8, True, True),
        (1.1e-9, 0.9e-8, False, True),
        (0.67, 0.0, False, True),
        (0.9e-9, 1.1e-8, False, False),
    ):
        answer = Answer(off, along)
        assert (answer.fault(soft=False) == "", answer.fault(soft=True) == "") == (hard, soft)
    assert Answer(0.0, 0.0, wrong="it raised").fault(soft=True) == "it raised"
    assert Answer().fault(soft=True) != ""


def test_errors_as_large_as_those_of_single_precision_are_said_to_be():
    """An engine that computes in float32 has errors of 1e-7 to 1e-5; a wrong number of the file has larger ones."""
    on = probe("four_bar", "torque")
    rounded = on.a.astype(np.float32).astype(float)
    assert "single precision" in Answer(on.error(rounded), on.residual_along_free(rounded)).fault(soft=False)
    for off, along in ((3e-7, 3e-7), (9e-6, 1e-9)):
        assert "single precision" in Answer(off, along).fault(soft=False)
    for off, along in ((3e-5, 1e-9), (5e-9, 1e-9), (2e-2, 2e-2)):
        assert "single precision" not in Answer(off, along).fault(soft=False)


def test_near_equilibria_an_error_counts_by_the_other_states():
    nothing_moves = [0.0, 0.0]
    cases = (([1.0, 1.0], [2.0, 10.0], 0.5), ([1.0, 1.0], [0.0, 10.0], 2.0), ([0.0, 0.0], nothing_moves, 0.0))
    for error, size, share in (*cases, ([0.0, 3.0], nothing_moves, 3.0)):
        assert _share(np.array(error), np.array(size)) == pytest.approx(share)  # a twentieth of the largest size counts at least
    assert (digits(1e-9), digits(0.0), digits(5.0)) == ("9.0 digits", "16.0 digits", "0.0 digits")


def test_variants_may_give_up_with_a_sentence_and_settings_may_not():
    asked, m = subject.Subject(offer("mujoco"), Worker(), print), probe("four_bar", "torque").mechanism
    lost = Run(Status.WARNING, "it gave up", None, None, sampling_at(1e-3, [0.0, 1e-3]))
    pairs = [("default", x) for x in (Status.WARNING, Status.SKIP, Status.RANK_LOST)]
    pairs += [("lean/rk4", x) for x in (Status.WARNING, Status.ERROR, Status.NAN)]
    found = [
        is_excusable(asked, asked.offer.choose(label, "rk4", None, 1e-3), replace(lost, status=status), m)
        for label, status in pairs
    ]
    assert found == [False, True, False, True, False, False]
    redundant = probe("parallelogram", "torque").mechanism
    assert is_excusable(asked, asked.usual, replace(lost, status=Status.RANK_LOST), redundant)


def test_a_finer_run_takes_half_the_step_or_a_tighter_tolerance():
    choice = Choice(step=1e-3)
    assert _from_coarse_to_fine(choice, adaptive=False) == [choice, Choice(step=5e-4)]
    assert [x.tolerance for x in _from_coarse_to_fine(choice, adaptive=True)] == [1e-6, None, 1e-8]


def test_a_run_may_be_off_by_what_a_finer_one_changes():
    """An error of order one, e at a step and e/2 at half of it, passes; the same error at every step does not."""
    true = np.linspace(0.0, 1.0, 6).reshape(3, 2, 1) + np.zeros((3, 2, 4))
    error = 1e-3 * np.ones_like(true)
    words = ("positions", "velocities", "accelerations")
    assert _compare(true, true + error, true + error / 2, words)[1] == ""
    assert _compare(true, true + error, true + 0.7 * error, words)[1].startswith("positions are off by")
    assert _compare(true, true + error, true + error, words[:0])[1] == ""
    assert _compare(true, true, true, words)[1] == ""


def test_flags_and_zeros_are_no_numbers_that_can_be_changed():
    document = {"links": {"rod": {"mass": 2, "com": [0.0, 0.3], "solid": True}}, "scenarios": {"loaded": {}}}
    assert [*numbers(document, "loaded")] == [("links", "rod", "mass"), ("links", "rod", "com", 1)]


@pytest.mark.slow
def test_a_number_that_an_engine_does_not_read_is_named(monkeypatch):
    only(monkeypatch, "check_changed_numbers")
    names = ("links.rod.inertia", "all inertias", "all masses", "every")
    few = {name: x for name, x in changes(PROBE, "loaded").items() if name.startswith(names)}
    monkeypatch.setattr(agreement, "changes", lambda *place: few)
    (message,) = broken("tests.faulty_engines:Fixed").values()
    assert "links.rod.inertia x 1.4" in message
    assert f"shows on 3 of {len(few)}" in message


@pytest.mark.long("1", "2", "3", "4")
@pytest.mark.slow
@pytest.mark.parametrize("part", range(5))
def test_every_number_of_the_probe_shows_in_its_accelerations_or_opens_its_joints(part):
    base = probe(PROBE, "loaded")
    single = [(name, *x.values()) for name, x in changes(PROBE, "loaded").items() if len(x) == 1]
    assert len(single) > 60
    for name, factor in single[part::5]:
        other = AbsoluteCoordinates(probe(PROBE, "loaded", name).mechanism)
        opened = np.abs(other.evaluator.constraints(base.t, base.q, base.v).phi).max()  # by where a ground pin or guide lies
        assert max(opened, base.error(other.acceleration(base.t, base.q, base.v))) > SEEN * (factor - 1), name


def test_constraint_forces_do_not_show_along_what_is_free_and_anything_else_does():
    base = probe(PROBE, "loaded")
    motion, (t, q, v, a) = AbsoluteCoordinates(base.mechanism), (base.t, base.q, base.v, base.a)
    rows = [motion.evaluator.terms(*state) for state in zip(t, q, v, strict=True)]
    pushed = a + np.array([x.J.T @ np.ones(len(x.J)) / np.diag(x.M) for x in rows])
    assert base.error(a) == 0
    assert base.error(pushed) > 0.1
    assert base.residual_along_free(pushed) < 1e-12
    along = np.array([motion.null_space(x)[:, 0] for x in q])
    work = np.array([n @ x.M @ n for n, x in zip(along, rows, strict=True)])
    loads = np.array([abs(n @ x.Q) for n, x in zip(along, rows, strict=True)])
    freed = a + (0.25 * loads / work)[:, None] * along
    assert base.residual_along_free(freed) == pytest.approx(0.25, rel=1e-9)
    assert base.error(2 * a) == pytest.approx(1.0)
    assert base.error(np.nan * a) == np.inf


def test_effects_are_told_apart_and_lateness_is_counted_in_samples():
    true = np.array([1.0, -2.0, 0.5])
    assert effect(0 * true, true) == "it has no effect"
    assert effect(-true, true) == "it acts in the opposite direction"
    assert effect(9.81 * true, true).startswith("its effect is 9.81 times")
    t = 0.01 * np.arange(100)[:, None]
    for shift in (0.0, 0.5, 1.0, -1.0):
        assert lateness(np.sin(t), np.sin(t - 0.01 * shift)) == pytest.approx(shift, abs=1e-2)


def test_a_method_of_first_order_is_told_from_samples_that_are_late():
    t = 0.01 * np.arange(630)  # a whole turn, over which sine and cosine do not mix

    def run(h, order, shift):
        """A motion sin t with the error h^order sin t, and accelerations that are early by `shift` [s]."""
        q = (1.0 + h**order) * np.sin(t)
        v = (1.0 + h**order) * np.cos(t)
        return Trajectory(t, q[:, None], v[:, None], -np.sin(t + shift)[:, None], len(t))

    steps = (0.01, 0.005, 0.0025)
    of_first_order = [run(h, 1, 0.9 * h) for h in steps]
    assert rates_fault(of_first_order[0]) == ("accelerations are 0.89 steps early", True)
    assert explains_lateness(*of_first_order)
    assert not explains_lateness(*[run(h, 4, 0.9 * h) for h in steps])
    assert not explains_lateness(*[run(h, 1, 0.01) for h in steps])
    assert not explains_lateness(of_first_order[0], None, None)


def test_a_class_that_is_not_there_is_a_check_that_failed(capsys):
    assert main(["conformance", "tests.faulty_engines:Absent", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert not found["passed"]
    assert Check(**found["checks"][0]).passed is False
    assert "Absent" in found["checks"][0]["message"]
