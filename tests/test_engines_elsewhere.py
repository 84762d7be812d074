"""Engines in environments of their own: how they are found, what they refuse, and their errors against certificates.

Tests that need an engine's library are skipped without its environment, in CI too.
"""

import os
import re
from dataclasses import replace
from importlib import import_module
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench.compiler import user_cache
from gauss_bench.engines import ELSEWHERE, UnknownEngine, all_names, get, names
from gauss_bench.engines.base import Choice
from gauss_bench.engines.bullet.translate import joint_forces
from gauss_bench.engines.dart.messages import Messages
from gauss_bench.engines.dart.translate import EXPLICIT, IMPLICIT, forces_of
from gauss_bench.engines.given_forces import on_one_joint
from gauss_bench.engines.newton import kernels
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.engines.tree_loads import OnJoints
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.runs.offers import NOT_TOLD, in_python, offers
from gauss_bench.trajectory import RunFailure, Status
from tests.conftest import USERS_CACHE, everything
from tests.engine_runs import certified, linkage


def test_without_its_environment_an_engine_is_not_listed_and_told_how_to_install(engines):
    assert not {*ELSEWHERE} & {*all_names()}
    for name in ELSEWHERE:
        for ask in (get, lambda name: offers([name])):
            with pytest.raises(UnknownEngine, match=f"engines install {name}"):
                ask(name)
    engines.write_text('[opensim]\npython = "/nowhere/python"\n')  # which needs no class
    assert "opensim" in names()
    assert type(get("opensim")).__name__ == "OpenSim"
    engines.write_text('[opensim]\nclass = "my_engine:Other"\npython = "/nowhere/python"\n')
    assert in_python("opensim", load("four_bar"), Choice()) == NOT_TOLD  # and that class is not imported here


def test_a_plug_in_of_that_name_is_used_where_there_is_no_environment(engines, monkeypatch):
    point = EntryPoint("dart", "tests.faulty_engines:Sound", "gauss_bench.engines")
    monkeypatch.setattr("gauss_bench.engines._plug_ins", lambda: [point])
    assert names().count("dart") == 1
    assert type(get("dart")).__name__ == "Sound"


WORDS = {"newton": r"\bkamino\b|engines.newton"}  # where an engine has the name of laws and of methods


def test_outside_its_room_one_line_of_python_names_an_engine():
    package = Path(gauss_bench.__file__).parent
    for name in ELSEWHERE:
        files = [p for p in package.rglob("*.py") if package / "engines" / name not in p.parents]
        word = WORDS.get(name, rf"\b{name}\b")
        lines = [x for p in files for x in p.read_text("utf-8").splitlines() if re.search(word, x, re.IGNORECASE)]
        assert len(lines) == 1
        assert "://" not in (package / "engines" / name / "requirements.txt").read_text("utf-8")


def adapter(name):
    """The adapter of an engine, which needs no library."""
    module, _, kind = ELSEWHERE[name].partition(":")
    return getattr(import_module(module), kind)()


BODIES = "coordinates=bodies"
REFUSED = [  # engine, linkage, scenario, settings -> words of the refusal; None: it is taken
    *((x, "sleigh", None, "", "knife edge") for x in ("bullet", "dart", "drake", "mjx", "opensim")),
    *((x, "excavator", None, "", "not the length") for x in ("bullet", "dart", "mjx", "opensim")),
    *(("drake", x, y, "", "no joint that follows a law") for x, y in (("four_bar", "driven"), ("excavator", None))),
    ("bullet", "crank_slider", "paper", BODIES, "no slide between free bodies (guide)"),
    ("bullet", "four_bar", "cycloid", BODIES, "none between free bodies"),
    ("bullet", "four_bar", "torque", BODIES, None),
    *((x, "four_bar", "cycloid", "", "not the motion law sine") for x in ("mjx", "opensim")),
    *((x, "four_bar", "cycloid", "", None) for x in ("bullet", "dart")),
    *((x, "crank_slider", "paper", "", None) for x in ELSEWHERE),
    *(("mjx", x, None, "", None) for x in ("parallelogram", "shaper")),
    *(("newton", x, y, "", "would not follow its law") for x, y in (("four_bar", "driven"), ("excavator", None))),
    ("newton", "sleigh", None, "", "Newton has no constraint on velocities alone"),
    *(("newton", x, None, "", None) for x in ("parallelogram", "jansen")),
]


@pytest.mark.parametrize(("engine", "name", "scenario", "settings", "words"), REFUSED)
def test_what_an_engine_cannot_have_is_refused_by_name(engine, name, scenario, settings, words):
    reason = adapter(engine).skip(load(name, scenario), Choice(settings or "default"))
    assert reason is None if words is None else words in str(reason)


@pytest.mark.parametrize(("engine", "library"), [("bullet", "Bullet"), ("dart", "DART")])
def test_a_driven_link_without_a_hinge_on_the_ground_is_refused(engine, library):
    mechanism = load("four_bar", "driven")
    (driver,) = mechanism.drivers
    assert adapter(engine).skip(mechanism, Choice()) is None
    refusal = adapter(engine).skip(replace(mechanism, drivers=(replace(driver, link=1),)), Choice())
    assert refusal == f"{library} can prescribe single coordinates of the tree of joints, but the driven angle is a sum of several"


def refusal_of(engine, mechanism, *forces):
    """Return an engine's reason to refuse a mechanism with only these forces; None if it takes the mechanism."""
    alone = replace(mechanism, forces=forces)
    reason = import_module(f"gauss_bench.engines.{engine}.translate").explain_refusal(alone, spanning_tree(alone))
    return reason


@pytest.mark.parametrize(("engine", "library"), [("drake", "Drake"), ("opensim", "OpenSim")])
def test_a_force_without_an_exact_element_is_refused_by_name(engine, library):
    whole = everything()
    refused = {
        "guy": f"{library} cannot turn the force guy with a third link",
        "world": f"{library} has no spring or damper along an axis that is not a slide's (world)",
    }
    assert {x.name: reason for x in whole.forces if (reason := refusal_of(engine, whole, x))} == refused
    (coil,) = (x for x in whole.forces if x.name == "coil")
    far = replace(coil, a=-1)  # between the ground and the beam lie two hinges
    assert refusal_of(engine, whole, far) == f"{library} has no spring or damper on a sum of coordinates (coil)"


def forces_of_joints(forces, y, dy):
    """Return the forces (n,) of the springs and dampers that are elements of the library."""
    found = np.zeros_like(y)
    for x in forces.own:
        found += (x.k * (x.rest - x.row @ y - x.constant) - x.c * x.row @ dy) * x.row
    return found


def dampers_of_joints(forces, y, dy):
    """Return the forces (n,) of Bullet's joint damping, its only element."""
    return -forces.joint_damping * dy


@pytest.mark.parametrize("name", ["crank_slider", "loaded", "everything", "pushed"])
@pytest.mark.parametrize(
    ("sort", "own_forces", "has_own"),
    [
        (joint_forces, dampers_of_joints, True),
        (lambda mechanism, tree: forces_of(mechanism, tree, IMPLICIT), forces_of_joints, True),
        (lambda mechanism, tree: forces_of(mechanism, tree, EXPLICIT), forces_of_joints, False),
    ],
    ids=["bullet", "dart implicit", "dart explicit"],
)
def test_forces_that_a_library_has_and_is_given_are_all_forces(name, sort, own_forces, has_own, rng):
    """As forces on the tree coordinates, at random states and two times."""
    mechanism = everything() if name == "everything" else linkage(name)
    tree = spanning_tree(mechanism)
    forces = sort(mechanism, tree)
    assert name != "everything" or bool(forces.own) == has_own
    whole = AppliedForces(replace(mechanism, gravity=np.zeros(2)))
    for t in (0.0, 0.3):
        y, dy = rng.uniform(-1.0, 1.0, (2, tree.n))
        q, v, _ = tree.absolute(y, dy, dy)
        expected = tree.forces(q, whole.generalised(q, v, t))
        found = forces(t, y, dy) + own_forces(forces, y, dy)
        np.testing.assert_allclose(found, expected, atol=1e-12 * max(1.0, float(np.abs(expected).max())))


def test_libraries_have_springs_on_one_coordinate_of_the_tree_alone():
    assert on_one_joint(OnJoints(np.array([0.0, -1.0, 0.0]), 0.0, 1.0, 0.0, 0.0))
    assert not on_one_joint(OnJoints(np.array([1.0, -1.0, 0.0]), 0.0, 1.0, 0.0, 0.0))


# errors of the crank after 1 s, Newton's after 0.1 s [rad]: linkage, scenario, settings, step [s], and the measured error
MEASURED = {
    "bullet": [  # damping=0.04 is Bullet's own, which slows every link
        ("parallelogram", "torque", "default", 1e-3, 0.0324),
        ("crank_slider", "paper", "damping=0.04", 1e-3, 0.963),
        ("eight_bar", "torque", "bodies_direct/DANTZIG", 1e-3, 0.00287),
    ],
    "dart": [
        ("eight_bar", "torque", "explicit", 1e-3, 0.0537),
        ("parallelogram", "torque", "explicit", 1e-4, 0.00326),
        ("crank_slider", "paper", "default", 1e-3, 0.0614),
    ],
    "drake": [  # steps of a millisecond are so coarse that the judge calls two of these runs invalid
        ("crank_slider", "paper", "default", 1e-4, 1.005e-2),
        ("eight_bar", "torque", "default", 1e-3, 5.111e-2),
        ("crank_slider", "paper", "bushing_runge_kutta_adaptive/0.003", 1e-3, 1.423e-3),
    ],
    "mjx": [("crank_slider", "paper", "tuned", 1e-3, 6.4e-3), ("eight_bar", "torque", "tuned", 1e-3, 1.7e-2)],
    "newton": [("crank_slider", "paper", "default", 1e-3, 4.6e-3), ("four_bar", "torque", "dvi", 1e-3, 3.8e-3)],
    "opensim": [  # on redundant rows (the parallelogram) the error of the default is noise, 4e-8 to 2e-6
        ("eight_bar", "torque", "default", 1e-3, 9.0e-8),
        ("parallelogram", "torque", "tight", 1e-3, 9.8e-11),
    ],
}
SHARE = {"dart": (0.8, 1.2), "drake": (0.99, 1.01), "mjx": (0.5, 2.0), "opensim": (0.5, 1.2)}


@pytest.fixture
def kept_kernels(request, monkeypatch):
    """The user's machine code of Newton, which takes minutes to compile."""
    if request.node.callspec.params["engine"] == "newton":
        monkeypatch.setenv("XDG_CACHE_HOME", os.environ[USERS_CACHE])
        if not [*(user_cache.folder() / kernels.FOLDER).glob(kernels.MADE.format("*"))]:
            pytest.skip("Newton's kernels are not compiled here")


@pytest.mark.slow
@pytest.mark.usefixtures("kept_kernels", "elsewhere")
@pytest.mark.parametrize(
    ("engine", "name", "scenario", "settings", "step", "measured"), [(x, *row) for x, rows in MEASURED.items() for row in rows]
)
def test_the_crank_is_off_the_certificate_by_what_was_measured(engine, name, scenario, settings, step, measured):
    mechanism = load(name, scenario)
    true, crank = certified(mechanism, 1.0), mechanism.crank
    at = int(np.abs(true.t - (0.1 if engine == "newton" else 1.0)).argmin())
    run = gauss_bench.simulate(name, engine, scenario, settings, step=step, at=[0.0, float(true.t[at])])
    assert run.status == "ok" or (engine in ("bullet", "dart", "drake", "newton") and run.status == "invalid"), run.message
    error = abs(run.links[mechanism.link_name(crank)]["theta"][-1] - true.q[at, 3 * crank + 2])
    low, high = SHARE.get(engine, (0.9, 1.1))
    assert low * measured < error < high * measured


# The messages that DART prints become failures


@pytest.mark.usefixtures("elsewhere")
@pytest.mark.parametrize("engine", ["dart"])
def test_a_run_that_blows_up_is_a_warning_of_one_sentence(engine):
    run = gauss_bench.simulate("eight_bar", engine, "torque", "shut,lcp=PGS", at=[0.0, 1.0], step=1e-2)
    assert run.status == "warning"
    assert run.message.startswith("DART: Warning")
    assert "\x1b" not in run.message


def test_what_a_library_prints_is_a_failure_with_its_first_line_and_does_not_reach_the_streams(
    capfd,
):
    with Messages() as messages:
        messages.check()
        os.write(2, b"\x1b[1;33mWarning [X.cpp:1]\x1b[0m Non-finite\n" * 3)
        os.write(1, b"and more\n")
        with pytest.raises(RunFailure, match=r"^DART: Warning \[X.cpp:1\] Non-finite$") as caught:
            messages.check()
    assert caught.value.status is Status.WARNING
    print("after")
    assert capfd.readouterr() == ("after\n", "")
