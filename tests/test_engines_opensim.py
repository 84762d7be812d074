"""OpenSim, in an environment of its own: what it is given and refuses, and its errors against certificates.

What needs OpenSim is skipped without its environment, in CI too.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gauss_bench
from gauss_bench.engines import ELSEWHERE, FILE, UnknownEngine, all_names, environment_of, get, names
from gauss_bench.engines.base import Choice
from gauss_bench.engines.opensim.adapter import OpenSim
from gauss_bench.engines.opensim.translate import refusal
from gauss_bench.engines.tree import spanning_tree
from gauss_bench.linkage.load import load
from gauss_bench.reference.certificate import certificate_path, read_certificate
from gauss_bench.runs.offers import NOT_TOLD, in_python, offers
from gauss_bench.runs.worker import keep
from tests.conftest import everything

ENVIRONMENT = environment_of("opensim")


@pytest.fixture
def opensim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The adapter of this package, in the environment of OpenSim that the user's file of engines names."""
    if ENVIRONMENT is None:
        pytest.skip("there is no environment of OpenSim here")
    path = tmp_path / "engines.toml"
    path.write_text(f'[opensim]\npython = "{ENVIRONMENT.python}"\n', encoding="utf-8")
    monkeypatch.setenv(FILE, str(path))
    monkeypatch.setattr("gauss_bench.runs.offers._known", {})
    keep("opensim").stop()  # its process may have another file of engines


# crank error after 1 s in steps of 1 ms [rad]; with equal steps and redundant rows (the parallelogram) the default is noise
MEASURED = [
    ("crank_slider", "paper", "default", 1.5e-8),
    ("eight_bar", "torque", "default", 9.0e-8),
    ("crank_slider", "paper", "tight", 8.1e-9),
    ("eight_bar", "torque", "tight", 8.1e-8),
    ("parallelogram", "torque", "tight", 9.8e-11),
]


@pytest.mark.slow
@pytest.mark.usefixtures("opensim")
@pytest.mark.parametrize(("name", "scenario", "settings", "most"), MEASURED)
def test_the_crank_is_off_the_certificate_by_no_more_than_was_measured(
    name: str, scenario: str, settings: str, most: float
) -> None:
    mechanism = load(name, scenario)
    path = certificate_path(mechanism)
    assert path is not None
    certificate = read_certificate(path)
    (at,) = np.flatnonzero(certificate.t == 1.0)
    run = gauss_bench.simulate(name, "opensim", scenario, settings, step=1e-3, at=[0.0, 1.0])
    assert run.status == "ok", run.message
    crank = mechanism.crank
    assert crank is not None
    error = abs(run.links[mechanism.link_name(crank)]["theta"][-1] - certificate.q[at, 3 * crank + 2])
    assert 0.5 * most < error < 1.2 * most


@pytest.mark.usefixtures("opensim")
@pytest.mark.parametrize("name", ["crank_slider", "four_bar"])
def test_a_crank_at_constant_speed_is_prescribed(name: str) -> None:
    run = gauss_bench.simulate(name, "opensim", "driven", at=[0.0, 0.1])
    assert run.status == "ok", run.message
    assert run.links["crank"]["theta"][-1] == pytest.approx(0.2 * np.pi, abs=1e-12)
    assert run.links["crank"]["omega"][-1] == pytest.approx(2 * np.pi, abs=1e-12)


@pytest.mark.usefixtures("opensim")
def test_steps_that_opensim_chooses_are_counted_and_follow_the_tolerance() -> None:
    few, many = (
        gauss_bench.simulate("four_bar", "opensim", integrator="rk_merson_adaptive", tolerance=x, at=[0.0, 0.2])
        for x in (1e-5, 1e-9)
    )
    assert few.status == many.status == "ok"
    assert few.metrics["steps"] < many.metrics["steps"]


@pytest.mark.parametrize(
    ("force", "reason"),
    [
        ("guy", "OpenSim cannot turn the force guy with a third link"),
        ("world", "OpenSim has no spring or damper along an axis that is not a slide's (world)"),
        ("stretch", None),
        ("push", None),
        ("coil", None),
        ("motor", None),
        ("wind", None),
        ("jet", None),
        ("grease", None),
    ],
)
def test_a_force_without_an_exact_element_is_refused_by_name(force: str, reason: str | None) -> None:
    whole = everything()
    alone = replace(whole, forces=tuple(f for f in whole.forces if f.name == force))
    assert refusal(alone, spanning_tree(alone)) == reason


def test_a_damper_on_a_sum_of_coordinates_is_refused_by_name() -> None:
    pin, chain = load("crank_slider", "paper"), everything()
    assert refusal(pin, spanning_tree(pin)) is None
    (coil,) = (f for f in chain.forces if f.name == "coil")
    far = replace(chain, forces=(replace(coil, a=-1),))  # between the ground and the beam lie two hinges
    assert refusal(far, spanning_tree(far)) == "OpenSim has no spring or damper on a sum of coordinates (coil)"


@pytest.mark.parametrize(
    ("name", "scenario", "words"),
    [
        ("four_bar", "cycloid", "no motion law sine"),
        ("excavator", None, "not the length"),
        ("sleigh", None, "knife edge"),
    ],
)
def test_a_driver_or_joint_that_opensim_cannot_have_is_refused(name: str, scenario: str | None, words: str) -> None:
    mechanism = load(name, scenario)
    assert words in str(OpenSim().skip(mechanism, Choice()))


def test_without_its_environment_the_engine_is_not_listed_and_told_how_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FILE, str(tmp_path / "engines.toml"))
    monkeypatch.setattr("gauss_bench.runs.offers._known", {})
    assert not {*ELSEWHERE} & {*all_names()}
    for ask in (get, lambda name: offers([name])):
        with pytest.raises(UnknownEngine, match="engines install opensim"):
            ask("opensim")
    (tmp_path / "engines.toml").write_text('[opensim]\npython = "/nowhere/python"\n')  # which needs no class
    assert "opensim" in names()
    assert isinstance(get("opensim"), OpenSim)
    mechanism = load("four_bar")
    assert in_python("opensim", mechanism, Choice()) == ""
    (tmp_path / "engines.toml").write_text('[opensim]\nclass = "my_engine:Other"\npython = "/nowhere/python"\n')
    assert in_python("opensim", mechanism, Choice()) == NOT_TOLD  # and that class is not imported here


def test_outside_its_room_one_line_of_python_names_the_engine() -> None:
    package = Path(gauss_bench.__file__).parent
    for name in ELSEWHERE:
        files = [p for p in package.rglob("*.py") if package / "engines" / name not in p.parents]
        lines = [
            line
            for p in files
            for line in p.read_text(encoding="utf-8").splitlines()
            if re.search(rf"\b{name}\b", line, re.IGNORECASE)
        ]
        assert len(lines) == 1
        assert (package / "engines" / name / "requirements.txt").exists()
        assert "://" not in (package / "engines" / name / "requirements.txt").read_text(encoding="utf-8")
