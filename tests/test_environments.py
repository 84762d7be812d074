"""Engines of users in environments of their own: their imports, their offers, and environments that are refused."""

import venv
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench.bench.conformance import conformance
from gauss_bench.bench.measurements.growth import exact_state
from gauss_bench.bench.provenance import package_versions
from gauss_bench.cli import main
from gauss_bench.engines import EnvironmentFault, names, read_environments
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.runs.blocks import call_of
from gauss_bench.runs.offers import in_python, offer
from gauss_bench.trajectory import RunFailure
from tests.plugin import environment_with

TEMPLATE = Path(gauss_bench.__file__).parent / "docs" / "pages" / "template" / "trees"
STAND_IN = """
from gauss_bench.engines.interpreted import Interpreted
from importlib.util import find_spec
import platform

class Twin(Interpreted):
    integrators, stabilizations = ("rk4",), ("none",)
    def __init__(self):
        super().__init__("udwadia_kalaba")  # which needs numpy alone
    def version(self):
        there = [x for x in ("scipy", "pydantic", "casadi") if find_spec(x)]
        return f"twin on {platform.python_version()} with {', '.join(there) or 'numpy alone'}"

class Helpful(Twin):
    packages = ("twin-library", "gone")
    library_calls = {"solve": lambda mechanism, q, v: call(mechanism, q, v)}
    def in_python(self, mechanism, choice):
        return "all of it"
    def program(self, mechanism, choice):
        return f"print({mechanism.name!r}, {choice.integrator!r})"

def call(mechanism, q, v):
    from gauss_bench.engines.base import Choice, LibraryCall
    if mechanism.name == "n_four_bar_1":
        raise KeyError("one window is too few")
    model = Interpreted("udwadia_kalaba").build(mechanism, Choice(integrator="rk4"))
    return LibraryCall(lambda: model.acceleration(0.0, q, v), model.acceleration(0.0, q, v))

class Greedy(Twin):
    def build(self, mechanism, choice):
        import numpy
        self.much = numpy.ones(1 << 28)  # 2 GiB
        return super().build(mechanism, choice)
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """The interpreter of an environment that has numpy, the stand-in and the template of joint trees, and nothing else."""
    about = "Metadata-Version: 2.1\nName: twin-library\nVersion: 2.5\n"
    template = {f"my_trees/{x.name}": x.read_text(encoding="utf-8") for x in (TEMPLATE / "my_trees").glob("*.*")}
    files = {"stand_in.py": STAND_IN, "twin_library-2.5.dist-info/METADATA": about, **template}
    return environment_with(files, tmp_path_factory.mktemp("environment"))


def test_an_engine_of_another_environment_runs_there_and_sees_nothing_of_this_one(python, engines):
    engines.write_text(f'[twin]\nclass = "stand_in:Twin"\npython = "{python}"\n')
    assert "twin" in names()
    assert offer("twin").version.endswith("with numpy alone")
    there, here = (gauss_bench.simulate("four_bar", x, at=[0.0, 0.5]) for x in ("twin", "lagrange"))
    assert there.status == "ok", there.message
    assert np.abs(there.links["coupler"]["x"] - here.links["coupler"]["x"]).max() < 1e-12


@pytest.mark.long
def test_the_template_of_joint_trees_conforms_where_numpy_alone_is_installed(python, engines):
    engines.write_text(f'[trees]\nclass = "my_trees:Trees"\npython = "{python}"\n')
    checks = {x.name: x.passed for x in conformance("trees")}
    assert len(checks) > 30
    assert False not in checks.values()
    assert [*checks.values()].count(None) == 1  # driven motions


def test_an_engine_of_another_environment_offers_all_that_engines_may(python, engines, tmp_path, capsys):
    """Its program, the calls of its library and the versions of its packages come from there."""
    engines.write_text(f'[helpful]\nclass = "stand_in:Helpful"\npython = "{python}"\n')
    assert package_versions()["twin-library"] == "2.5"
    mechanism, file = load("four_bar"), tmp_path / "four_bar.py"
    assert in_python("helpful", mechanism, Choice(integrator="rk4")) == "all of it"
    assert main(["export", "four_bar", "--engine", "helpful", "--out", str(file)]) == 0
    assert file.read_text().endswith("print('four_bar', 'rk4')")
    assert main(["export", "four_bar", "--engine", "nobody", "--out", str(file)]) == 2
    assert "exudyn, casadi, c, helpful" in capsys.readouterr().err
    wanted = exact_state(2)
    made = call_of("helpful", "solve", wanted.mechanism, wanted.q, wanted.v)
    assert wanted.error(made.acceleration) < 1e-9
    with pytest.raises(RunFailure, match="one window is too few"):
        call_of("helpful", "solve", load("n_four_bar_1"), wanted.q, wanted.v)


def test_an_environment_may_have_another_limit_of_memory(python, engines):
    engines.write_text(f'[greedy]\nclass = "stand_in:Greedy"\npython = "{python}"\nmemory = 1\n')
    run = gauss_bench.simulate("four_bar", "greedy", at=[0.01])
    assert run.status != "ok"
    assert "MemoryError" in run.message or "allocate" in run.message


def test_an_interpreter_that_is_not_fit_is_told_in_one_sentence(tmp_path, engines):
    bare = tmp_path / "bare"
    venv.create(bare, with_pip=False)
    for name, python, words in (
        ("bare", bare / "bin" / "python", "needs numpy >= 2"),
        ("gone", tmp_path / "none", "cannot be started"),
    ):
        engines.write_text(f'[{name}]\nclass = "stand_in:Twin"\npython = "{python}"\n')
        found = offer(name)
        assert (found.version, found.status) == ("cannot be used", "skip")
        assert words in found.reason


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("x", "engines.toml: "),
        ('[gauss]\nclass = "other:Gauss"\npython = "/p"', "gauss: is an engine of this package"),
        ("a = 1", "a: must be a table"),
        ('["a b"]\nclass = "m:C"\npython = "/p"', "a b: an engine's name"),
        ('[a]\nclass = "m"\npython = "/p"', "a.class: must be MODULE:CLASS"),
        ('[a]\nclass = "m:C"\npython = "p"', "a.python: must be the absolute path"),
        ('[a]\nclass = "m:C"\npython = "/p"\nmemory = "x"', "a.memory: must be a number"),
        ('[a]\nclass = "m:C"\npython = "/p"\nmemory = 1e9', "a.memory: must be 0.5 to 1024 GiB"),
        ('[a]\nclass = "m:C"\npython = "/p"\nwheel = 1', "a.wheel: no such key; there are class, python, memory"),
        ("#" * 70000, "larger than"),
    ],
)
def test_a_fault_in_the_file_of_engines_is_bad_input(text, where, engines, capsys):
    engines.write_text(text)
    with pytest.raises((EnvironmentFault, OSError)):
        read_environments()
    assert main(["list"]) == 2
    told = capsys.readouterr().err
    assert str(engines) in told
    assert where in told
