"""Linkages the tests share: the built-in ones, one with every kind of joint and force, and one with a redundant row."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.mechanism.load import built_in, load, load_document
from gauss_bench.mechanism.model import Mechanism

DATA = Path(__file__).parent / "data"


def everything(scenario: str = "free") -> Mechanism:
    """Two chains, a guide on a moving link, a multiple joint, a knife edge and every kind of force."""
    document = tomllib.loads((DATA / "everything.toml").read_text(encoding="utf-8"))
    return load_document(document, scenario)


def redundant() -> Mechanism:
    """The four-bar with its last pin entered twice: two redundant rows."""
    document = tomllib.loads(built_in()["four_bar"].read_text(encoding="utf-8"))
    document["joints"]["again"] = document["joints"]["D"]
    document["expect"] = {"dof": 1, "redundant": 2}
    return load_document(document, "torque")


@pytest.fixture(params=["crank_slider", "four_bar", "six_bar", "eight_bar", "everything", "redundant"])
def any_mechanism(request: pytest.FixtureRequest) -> Mechanism:
    match request.param:
        case "everything":
            return everything()
        case "redundant":
            return redundant()
        case name:
            return load(name)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)
