"""Test the checkup of a machine: parts that are missing or broken, and the verdict."""

import re

import pytest

from gauss_bench.api import doctor as room
from gauss_bench.api.doctor import Finding, doctor
from gauss_bench.engines.pinocchio import build as building
from gauss_bench.runs.offers import Offer, offer
from gauss_bench.trajectory import Status
from tests.conftest import needs


def looked_at(monkeypatch, *engines):
    monkeypatch.setattr(room, "offers", lambda: list(engines))
    return doctor()


def named(findings, name):
    return next(x for x in findings if x.name == name)


GAUSS = Offer("gauss", "1", integrators=("rk4",), stabilizations=("none",))


@pytest.mark.parametrize(
    ("offer", "status", "verdict"),
    [
        (Offer("exudyn", "not installed", status=Status.SKIP, reason="no module"), "missing", "usable, without .*exudyn"),
        (Offer("mujoco", "cannot be used", status=Status.CRASHED, reason="it died"), "broken", "usable, without .*mujoco"),
        (Offer("lagrange", "1", status=Status.ERROR, reason="numpy is broken"), "broken", "not usable: lagrange"),
    ],
)
def test_only_an_own_formulation_is_needed(offer, status, verdict, monkeypatch):
    found = looked_at(monkeypatch, GAUSS, offer)
    assert re.fullmatch(verdict, found.verdict)
    assert found.usable is verdict.startswith("usable")
    assert named(found.engines, "gauss").status == "ok"
    assert named(found.engines, offer.name) == Finding(offer.name, offer.version, status, offer.reason)


def test_a_cache_that_others_may_enter_is_not_used(monkeypatch, tmp_path):
    folder = tmp_path / "gauss-bench" / "kernels"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    found = named(looked_at(monkeypatch).findings, "cache")
    assert found.status == "missing"
    assert "anew" in found.message
    folder.chmod(0o700)
    assert named(looked_at(monkeypatch).findings, "cache").status == "ok"


def test_where_double_is_the_longest_number_it_is_said(monkeypatch):
    monkeypatch.setattr(room.np, "longdouble", float)
    found = named(looked_at(monkeypatch).findings, "long double")
    assert (found.value, found.status) == ("53 bits", "missing")


def test_what_is_built_once_is_there_or_not_yet_or_cannot_be(monkeypatch):
    needs("pinocchio")
    pinocchio = offer("pinocchio")
    states = {
        "built": (None, None),
        "not built yet": (None, "Pinocchio's compiled loop is not installed: it is not built yet"),
        "none": ("Pinocchio's compiled loop is not installed: there is no C++ compiler", "not built yet"),
    }
    for value, (missing, absent) in states.items():
        monkeypatch.setattr(building, "explain_missing", lambda missing=missing: missing)
        monkeypatch.setattr(building, "explain_absence", lambda absent=absent: absent)
        (found,) = room._check_builds([pinocchio])
        assert (found.name, found.value, found.status) == ("pinocchio, compiled", value, "ok" if value == "built" else "missing")
    assert "C++ compiler" in found.message
