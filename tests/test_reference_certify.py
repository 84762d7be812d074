"""Certifying end to end: how many digits, until when, and where and why it must stop."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gauss_bench.bench.measurements.certificates import scenarios_to_certify
from gauss_bench.cli import main
from gauss_bench.linkage.load import built_in, decimal_document, load
from gauss_bench.papers.published import VALUES, list_published_values
from gauss_bench.reference.certificate import as_reference, certificate_path, check_holds, read_certificate
from gauss_bench.reference.certify import certify
from gauss_bench.reference.taylor.series import taylor_motion
from tests.conftest import needs

DATA = Path(__file__).parent / "data"


@pytest.mark.parametrize(("name", "scenario"), scenarios_to_certify())
def test_every_certificate_of_the_suite_holds_and_vouches_for_twelve_digits(name: str, scenario: str) -> None:
    mechanism = load(name, scenario)
    path = certificate_path(mechanism)
    assert path is not None
    certificate = read_certificate(path)
    check_holds(certificate, mechanism, path)
    assert certificate.digits >= 12
    assert certificate.until == certificate.duration or certificate.stopped
    assert certificate.duration >= mechanism.duration
    # rounding of a thousand steps in 128 bit; of angles of hundreds of radians in long double
    for pipeline, allowed in zip(certificate.facts["pipelines"], (1e-28, 1e-16), strict=True):
        assert max(pipeline["drift"]) < allowed
        if "off_closed_form" in pipeline:  # both pipelines follow it until they stop
            assert pipeline["off_closed_form"] < allowed
            assert pipeline["until"] == certificate.duration or "singular" in pipeline["stopped"]
    bars = np.array([getattr(certificate, f"error_{x}") for x in ("q", "v", "a")])
    assert (np.diff(bars, axis=1) >= 0).all()
    assert (bars < 1e-9 * (1 + np.abs(certificate.a).max())).all()


@pytest.mark.slow
def test_the_first_acceleration_of_the_squeezer_is_the_published_one_to_27_digits() -> None:
    hy = needs("heyoka")
    motion = taylor_motion(decimal_document("squeezer"), "squeeze", ["0", "0.0001"])
    beta, theta = motion.a[0, 2], motion.a[0, 5] - motion.a[0, 2]
    # the problem's consistent start, printed with 30 digits of which the first 28 fit in the arithmetic
    assert abs(float(beta - hy.real128("14222.4439199541138705911625887"))) < 1e-23
    assert abs(float(theta + hy.real128("10666.8329399655854029433719415"))) < 1e-23


def test_published_values_of_the_squeezer_are_true_to_fewer_digits_than_printed() -> None:
    mechanism = load("squeezer")
    certificate = read_certificate(certificate_path(mechanism) or Path())
    rows = list_published_values(mechanism, as_reference(certificate, 0.03))
    assert len(rows) == 2 * len(VALUES)
    for row in rows:
        assert row["difference"] < 1e-6 * abs(float(row["certified"]))  # the same mechanism
        assert row["error_bar"] < 1e-2 * row["difference"]  # and the certificate can tell
        assert 7 <= row["true_digits"] < row["printed_digits"] - 2


def run(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> Any:
    assert main(["certify", *arguments, "--json"]) == code
    return json.loads(capsys.readouterr().out)


@pytest.fixture
def needs_heyoka() -> None:
    needs("heyoka")


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.usefixtures("needs_heyoka")
def test_a_users_linkage_is_certified_until_chaos_takes_the_digits(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "double_pendulum.toml"
    file.write_bytes((DATA / "double_pendulum.toml").read_bytes())
    out = tmp_path / "certificates" / "double_pendulum.free.npz"
    found = run(capsys, str(file), "--digits", "15", "--until", "9", "--out", str(out))
    assert not found["complete"]
    assert 1.0 < found["until"] < 9.0
    assert "small errors grow" in found["message"]
    assert read_certificate(out).until == found["until"]
    assert main(["verify", str(out)]) == 0
    assert "confirmed" in capsys.readouterr().out
    longer = round(found["until"] + 0.3, 1)
    fewer = run(capsys, str(file), "--digits", "12", "--until", str(longer))
    assert fewer["until"] == longer > found["until"]


@pytest.mark.slow
@pytest.mark.usefixtures("needs_heyoka")
def test_a_limit_of_motion_is_said_plainly(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    text = built_in()["four_bar"].read_text(encoding="utf-8").replace("[0.12, 0.0]", "[0.30, 0.0]")
    head = text[: text.index("[scenarios")].replace('"four_bar"', '"locked"')
    file = tmp_path / "locked.toml"
    over = '[scenarios.over]\ndriver = { link = "crank", law = "constant", start_deg = 60.0, speed = 3.0 }\nduration = 2.0\n'
    file.write_text(head + over, encoding="utf-8")
    found = run(capsys, str(file), "--scenario", "over")
    assert not found["complete"]
    assert "limit of its motion" in found["message"]
    assert found["until"] < 0.47  # the crank of 0.30 cannot turn on against 0.36, 0.30 and 0.40
    assert found["digits"] >= 14


@pytest.mark.slow
@pytest.mark.usefixtures("needs_heyoka")
def test_stored_doubles_are_the_nearest_to_the_exact_motion() -> None:
    mpmath = needs("mpmath")
    certificate = certify("projectile", until=0.5)
    with mpmath.workdps(40):
        t = mpmath.mpf("0.5")
        assert certificate.q[-1, 1] == float(7 * t - mpmath.mpf("9.81") * t**2 / 2)
        assert certificate.v[-1, 1] == float(7 - mpmath.mpf("9.81") * t)


def test_dry_friction_is_refused_with_its_reason(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    text = built_in()["four_bar"].read_text(encoding="utf-8").replace('name   = "four_bar"', 'name   = "rubbing"')
    friction = '[forces.dry]\ntype = "coulomb_friction"\njoint = "A"\nmu = 0.1\nradius = 0.01\nspeed = 0.01\n'
    scenario = '[scenarios.rub]\nstart = { crank_deg = 0.0, speed = 6.0 }\nduration = 0.1\nforces = ["dry"]\n'
    file = tmp_path / "rubbing.toml"
    file.write_text(f"{text}\n{friction}\n{scenario}", encoding="utf-8")
    out = tmp_path / "x.npz"
    found = run(capsys, str(file), "--scenario", "rub", "--out", str(out), code=1)
    assert "friction" in found["message"]
    assert not out.exists()
