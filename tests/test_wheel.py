"""The wheel, installed without extras: every verb works, or names the extra that it needs; never a traceback.

Building and installing takes some seconds, and each verb imports the package anew. Commands that work without an extra are short.
"""

import json
import shutil
import tomllib
from importlib.metadata import PackageNotFoundError, distribution

import pytest
from packaging.requirements import Requirement

from gauss_bench.api.options import VERBS
from gauss_bench.engines import COMPILED, DERIVED, EXTRAS, FOREIGN
from gauss_bench.linkage.load import built_in
from tests.bare import ROOT, bare

EXTRA_OF = dict.fromkeys((*COMPILED, *DERIVED), "kernel") | {name: name for name in FOREIGN}
DATA = ROOT / "tests" / "data"
CERTIFICATE = ROOT / "mechanisms" / "certificates" / "pendulum.swing.npz"
OF_ONE_VERB = ("cluster", "pinocchio-compiled")  # extras that one verb, or one engine's build, asks for itself


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    made = bare(tmp_path_factory.mktemp("bare"))
    shutil.copy(ROOT / "reports" / "baseline.csv", made.folder)
    return made


@pytest.mark.slow
def test_the_environment_is_bare(environment):
    """The environment has no extra and imports the installed package; the other tests of this file rely on it."""
    import subprocess

    wanted = {*EXTRAS, "pytest", "sympy"}
    code = f"import importlib.util as u, gauss_bench as g; print(*[x for x in {wanted} if u.find_spec(x)], g.__file__)"
    found = subprocess.run([environment.python, "-I", "-c", code], capture_output=True, text=True, check=True)
    (place,) = found.stdout.split()
    assert str(environment.python.parents[1]) in place


ASKED = tomllib.loads((DATA / "verbs" / "without_extras.toml").read_text(encoding="utf-8"))
WORKING, NEEDING = ASKED["working"], ASKED["needing"]


def words(command):
    return [x.format(data=DATA, certificate=CERTIFICATE) for x in command.split()]


@pytest.mark.long(*WORKING.keys() - {"simulate"})
@pytest.mark.slow
@pytest.mark.parametrize("verb", WORKING)
def test_verbs_that_need_no_extra_work(verb, environment):
    done = environment.run(*words(WORKING[verb]))
    assert done.returncode == 0, done.stderr
    assert done.stdout
    assert "Traceback" not in done.stderr


@pytest.mark.long
def test_a_suite_runs_and_is_reported_and_says_what_was_left_out(environment):
    engines = [x for name in ("gauss", "mujoco", "gauss-native") for x in ("--engine", name)]
    short = ["--suite", "gate", "--until", "0.05", "--no-costs", "--jobs", "1"]
    done = environment.run("run", "four_bar", *short, *engines, "--out", "made", "--json")
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)["results"]
    assert {row["engine"] for row in rows if row["status"] == "ok"} == {"gauss"}
    for row in rows:
        if row["engine"] in EXTRA_OF:
            assert row["status"] == "skip"
            assert f"pip install 'gauss-bench[{EXTRA_OF[row['engine']]}]'" in row["message"]
    reported = environment.run("report", "--out", "made")
    assert reported.returncode == 0, reported.stderr
    assert (environment.folder / "made" / "site" / "index.html").exists()


@pytest.mark.long(*EXTRA_OF.keys() - {"gauss-native"})
@pytest.mark.slow
@pytest.mark.parametrize("engine", EXTRA_OF)
def test_an_engine_that_is_missing_names_its_extra(engine, environment):
    done = environment.run("simulate", "four_bar", "--engine", engine, "--at", "0,0.01")
    assert f"pip install 'gauss-bench[{EXTRA_OF[engine]}]'" in done.stdout + done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.long(*NEEDING.keys() - {"import of MJCF"})
@pytest.mark.slow
@pytest.mark.parametrize("what", NEEDING)
def test_verbs_that_need_an_extra_name_it(what, environment):
    command, code, extra = NEEDING[what]
    done = environment.run(*words(command), limit=60.0)
    said = done.stdout + done.stderr
    assert done.returncode == code, said
    assert f"pip install 'gauss-bench[{extra}]'" in said
    assert "Traceback" not in said
    assert not (environment.folder / "kernel").exists()  # nothing half-written


def test_every_verb_is_tried_here():
    elsewhere = {"run", "report", "check", "certify", "sweep", "studio", "tune", "releases"}
    assert set(VERBS) == {words(x)[0] for x in WORKING.values()} | elsewhere


@pytest.mark.slow
def test_the_console_script_and_the_linkages_are_installed(environment):
    assert (environment.python.parent / "gauss-bench").exists()
    found = json.loads(environment.run("list", "--json").stdout)
    assert all(name in json.dumps(found) for name in built_in())


def test_every_extra_has_the_library_that_it_names():
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert set(EXTRAS.values()) == set(stated) - {"all", "dev", "docs", *OF_ONE_VERB}
    assert {*EXTRAS.values(), *OF_ONE_VERB} == Requirement(stated["all"][0]).extras
    for library, extra in EXTRAS.items():
        line = next((x for x in stated[extra] if Requirement(x).name == library), stated[extra][0])
        try:
            files = distribution(Requirement(line).name).files or []
        except PackageNotFoundError:
            continue  # its name on the index says nothing here
        assert any(str(x).startswith(f"{library}/") or f"/{library}/" in str(x) for x in files), library
