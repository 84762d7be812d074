"""Test that unknown kinds of forces, joints and other parts are refused by name, and not silently left out."""

import copy
from dataclasses import dataclass, replace

import numpy as np
import pytest

import gauss_bench
from gauss_bench.cli import main
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.kernel import compile_kernel
from gauss_bench.engines import get, names
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.closure import gauss_newton
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import built_in, document_of, load, load_document
from gauss_bench.linkage.schema import physics_digest
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference import certify as certifying
from gauss_bench.report.drawings.pose import pose_links
from gauss_bench.runs.one_run import one_run, sampling
from gauss_bench.trajectory import Status
from tests.fuzz.files import toml


@dataclass(frozen=True)
class Unheard:
    """A part of an unknown kind."""

    name: str = "unheard"


MEETS = {
    "own terms": Evaluator,
    "compiler": compile_kernel,
    "compiler, lagrange": lambda x: compile_kernel(x, "lagrange"),
    "certificates": lambda x: certifying.certify("four_bar", "torque"),
}


@pytest.fixture
def smuggled():
    """A four-bar with a force of an unknown kind, which no constructor would accept."""
    mechanism = copy.copy(load("four_bar", "torque"))
    object.__setattr__(mechanism, "forces", (Unheard(),))
    return mechanism


@pytest.mark.parametrize("consumer", MEETS)
def test_whoever_evaluates_forces_refuses_one_that_is_unknown(consumer, smuggled, monkeypatch):
    monkeypatch.setattr(certifying, "load", lambda *_: smuggled)
    with pytest.raises((TypeError, KernelError, certifying.Uncertified), match="unheard"):
        MEETS[consumer](smuggled)


@pytest.mark.parametrize("engine", names())
def test_every_engine_refuses_a_force_that_is_unknown(engine, smuggled):
    choice = Choice(integrator=get(engine).integrators[0])
    run = one_run(get(engine), smuggled, choice, sampling(1e-3, 0.01))
    assert run.status is Status.ERROR
    assert "unheard" in run.message
    assert run.trajectory is None


def test_no_mechanism_holds_or_measures_what_is_unknown():
    mechanism = load("four_bar", "torque")
    for part in ("forces", "joints", "drivers", "knife_edges", "frictions"):
        with pytest.raises(TypeError, match="unheard: unknown kind Unheard"):
            replace(mechanism, **{part: (*getattr(mechanism, part), Unheard())})
    with pytest.raises(TypeError, match="unknown kind Unheard"):
        replace(mechanism, measured=replace(mechanism.measured, coordinate=Unheard()))


READS = {
    "load": lambda path, document: load_document(document),
    "digest": lambda path, document: physics_digest(document, "torque"),
    "drawing": lambda path, document: pose_links(path),
    "kinematics": lambda path, document: gauss_bench.kinematics(path),
    "simulate": lambda path, document: gauss_bench.simulate(path),
    "compare": lambda path, document: gauss_bench.compare(path),
    "certify": lambda path, document: gauss_bench.certify(path),
}


@pytest.mark.parametrize("reader", READS)
def test_whoever_reads_a_file_refuses_a_kind_that_is_unknown(reader, tmp_path):
    path = tmp_path / "four_bar.toml"
    for table, name in (("forces", "motor"), ("joints", "A")):
        document = copy.deepcopy(document_of("four_bar")[0])
        document[table][name]["type"] = "unheard"
        path.write_bytes(toml(document))
        with pytest.raises((LinkageError, ValueError), match="unheard"):
            READS[reader](str(path), document)


def test_a_file_of_odd_shape_is_refused_by_its_place(tmp_path, capsys):
    document, path = document_of("four_bar")[0], tmp_path / "four_bar.toml"
    law = copy.deepcopy(document)
    law["scenarios"]["driven"]["driver"]["law"] = ["constant"]
    for odd, said in ((law, "scenarios.driven.driver"), (document | {"crank": {"a": 1}}, "crank: must be text")):
        with pytest.raises(LinkageError, match=said) as caught:
            load_document(odd)
        assert len(caught.value.faults) == 1
    content = built_in()["four_bar"].read_text(encoding="utf-8")
    deep = f"[scenarios.torque]\noverride.forces{'.a' * 2000} = 1.0\n"
    path.write_text(content.replace("[scenarios.torque]\n", deep, 1), encoding="utf-8")
    with pytest.raises(LinkageError, match="deep"):
        load(str(path))
    path.write_bytes(toml(document | {"scenarios": 7}))
    assert main(["kinematics", str(path)]) == 2
    assert "scenarios: " in capsys.readouterr().err


def test_far_from_the_origin_a_root_is_found_in_as_few_steps_as_near_it():
    """Beyond 100 m the rounding of a coordinate alone is larger than the step that ends the search near the origin."""
    asked = []

    def residual(q):
        asked.append(float(q[0]))
        return q * q - 1000.3**2, np.array([[2.0 * q[0]]])

    found, error = gauss_newton(np.array([1000.0]), residual)
    assert found[0] == pytest.approx(1000.3, rel=1e-15)
    assert error < 1e-9
    assert len(asked) < 12


def test_gauss_says_nothing_on_stderr_where_masses_lie_far_apart_and_nothing_is_constrained(tmp_path, capfd):
    document = document_of("projectile")[0]
    for link in document["links"].values():
        link["inertia"] = 5e14
    path = tmp_path / "projectile.toml"
    path.write_bytes(toml(document))
    gauss_bench.simulate(str(path), "gauss", at=[0.0, 0.002])
    assert "DTRTRS" not in "".join(capfd.readouterr())
