"""Certificates: what is written is read, what has changed is refused, what is false is found."""

import json
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import mpmath
import numpy as np
import pytest

from gauss_bench.bench.measurements.certificates import scenarios_to_certify
from gauss_bench.cli import main
from gauss_bench.linkage.load import built_in, decimal_document, document_of, load, load_document
from gauss_bench.papers.published import VALUES, list_published_values
from gauss_bench.reference.build import build_reference
from gauss_bench.reference.certificate import (
    Certificate,
    CertificateError,
    as_reference,
    certificate_path,
    check_holds,
    find_certified,
    read_certificate,
)
from gauss_bench.reference.certify import certify, distance, sample_times, split, write_certificate
from gauss_bench.reference.taylor.series import taylor_motion
from gauss_bench.reference.verification import verify
from tests.conftest import DATA, needs


def from_doubles(name, scenario, t_end):
    """A certificate-shaped file from the double-precision reference, to test everything but the pipelines."""
    mechanism = load(name, scenario)
    r = build_reference(mechanism, t_end)
    zeros, levels = np.zeros(len(r.t)), (r.q, r.v, r.a, np.zeros((len(r.t), 0)))
    bars = (r.error_q, r.error_v, r.error_a, zeros, zeros + 1e-15, zeros, zeros)
    facts = {"method": "two integrators in double precision"}
    return Certificate(name, scenario, mechanism.digest, r.t, *levels, *bars, 11, t_end, "", facts)


@pytest.fixture(scope="module")
def certificate():
    return from_doubles("four_bar", "torque", 0.2)


def test_a_certificate_survives_its_file_and_the_same_one_gives_the_same_bytes(certificate, tmp_path):
    one, two = tmp_path / "one.npz", tmp_path / "two.npz"
    write_certificate(certificate, one)
    write_certificate(certificate, two)
    assert one.read_bytes() == two.read_bytes()
    with ZipFile(one) as archive:  # numpy gives every entry the same date, whenever it is written
        assert {x.date_time for x in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    read = read_certificate(one)
    for name, value in vars(certificate).items():
        found = getattr(read, name)
        assert (found == value).all() if isinstance(value, np.ndarray) else found == value, name
    assert {*tmp_path.iterdir()} == {one, two}


def test_a_comment_changes_nothing_and_another_mass_or_scenario_is_refused(certificate, tmp_path):
    text = built_in()["four_bar"].read_text(encoding="utf-8")
    file = tmp_path / "four_bar.toml"
    file.write_text("# a word\n" + text, encoding="utf-8")
    check_holds(certificate, load(file, "torque"), file)
    document, _, _ = document_of("four_bar")
    link = next(iter(document["links"]))
    document["links"][link]["kg_per_m"] *= 1.0000001
    with pytest.raises(CertificateError, match="has changed since"):
        check_holds(certificate, load_document(document, "torque"), file)
    with pytest.raises(CertificateError, match="not four_bar in scenario conservative"):
        check_holds(certificate, load("four_bar", "conservative"), file)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 torn", b"text"])
def test_what_is_no_certificate_is_refused_by_name(content, tmp_path, capsys):
    path = tmp_path / "x.npz"
    path.write_bytes(content)
    with pytest.raises(CertificateError, match=r"x\.npz"):
        read_certificate(path)
    assert main(["verify", str(path)]) == 2
    assert "not a certificate" in capsys.readouterr().err


def test_the_suite_takes_the_certificate_beside_a_linkage_file_and_names_a_stale_one(certificate, tmp_path, capsys):
    file = tmp_path / "four_bar.toml"
    file.write_bytes(built_in()["four_bar"].read_bytes())
    path = certificate_path(load(file, "torque"))
    assert path == tmp_path / "certificates" / "four_bar.torque.npz"
    write_certificate(certificate, path)
    reference = find_certified(load(file, "torque"), 0.1)
    assert reference.t[-1] == pytest.approx(0.1)
    assert "certified" in reference.method
    assert find_certified(load(file, "torque"), 0.3) is None  # it does not reach so far
    file.write_text(file.read_text(encoding="utf-8").replace("9.81", "9.82"), encoding="utf-8")
    if load(file, "torque").digest != certificate.digest:
        assert find_certified(load(file, "torque"), 0.1) is None
        assert "has changed since" in capsys.readouterr().err


def test_the_bar_of_a_certified_reference_holds_the_rounding_of_what_is_stored(certificate):
    reference = as_reference(replace(certificate, error_q=np.zeros_like(certificate.error_q)), 0.2)
    largest = np.maximum.accumulate(np.abs(reference.q).max(axis=-1))
    assert (reference.error_q > 0).all()
    assert (reference.error_q <= np.spacing(largest)).all()


@pytest.mark.long("four_bar-torque")
@pytest.mark.parametrize(("name", "scenario"), [("four_bar", "torque"), ("parallelogram", "driven"), ("sleigh", "glide")])
def test_a_true_certificate_is_verified_and_a_false_one_is_not(name, scenario):
    certificate, mechanism = from_doubles(name, scenario, 0.1), load(name, scenario)
    found = verify(certificate, mechanism)
    assert found.passed, found
    for level in ("q", "v", "a"):
        values = getattr(certificate, level).copy()
        values[len(values) // 2 :] += 1e-7
        assert not verify(replace(certificate, **{level: values}), mechanism).passed, level


@pytest.mark.parametrize(
    ("duration", "count"), [(0.0, 1), (0.03, 301), (1.0, 101), (2.0, 201), (10.0, 501), (60.0, 501), (0.5001, 52)]
)
def test_samples_are_exact_decimals_neither_too_many_nor_too_few(duration, count):
    times = sample_times(duration)
    assert float(times[0]) == 0.0
    assert float(times[-1]) == duration
    assert len(times) == count
    assert all(len(t) <= 8 for t in times)


def test_differences_are_right_far_below_double_precision():
    with mpmath.workdps(40):
        one = np.array([[mpmath.mpf("0.1")]])
        other = np.array([[mpmath.mpf("0.1") + mpmath.mpf("1e-25")]])
    assert distance(one, other)[0] == pytest.approx(1e-25, rel=1e-5)
    assert distance(one, np.array([[np.longdouble("0.1")]]))[0] < 1e-20
    assert split(one)[0][0, 0] == 0.1


# Certifying end to end: how many digits, until when, and where and why it must stop


@pytest.mark.parametrize(("name", "scenario"), scenarios_to_certify())
def test_every_certificate_of_the_suite_holds_and_vouches_for_twelve_digits(name, scenario):
    mechanism = load(name, scenario)
    path = certificate_path(mechanism)
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
def test_the_first_acceleration_of_the_squeezer_is_the_published_one_to_27_digits():
    hy = needs("heyoka")
    motion = taylor_motion(decimal_document("squeezer"), "squeeze", ["0", "0.0001"])
    beta, theta = motion.a[0, 2], motion.a[0, 5] - motion.a[0, 2]
    # the problem's consistent start, printed with 30 digits of which the first 28 fit in the arithmetic
    assert abs(float(beta - hy.real128("14222.4439199541138705911625887"))) < 1e-23
    assert abs(float(theta + hy.real128("10666.8329399655854029433719415"))) < 1e-23


def test_published_values_of_the_squeezer_are_true_to_fewer_digits_than_printed():
    mechanism = load("squeezer")
    certificate = read_certificate(certificate_path(mechanism) or Path())
    rows = list_published_values(mechanism, as_reference(certificate, 0.03))
    assert len(rows) == 2 * len(VALUES)
    for row in rows:
        assert row["difference"] < 1e-6 * abs(float(row["certified"]))  # the same mechanism
        assert row["error_bar"] < 1e-2 * row["difference"]  # and the certificate can tell
        assert 7 <= row["true_digits"] < row["printed_digits"] - 2


def run(capsys, *arguments, code=0):
    assert main(["certify", *arguments, "--json"]) == code
    return json.loads(capsys.readouterr().out)


@pytest.mark.long
def test_a_users_linkage_is_certified_until_chaos_takes_the_digits(capsys, tmp_path):
    needs("heyoka")
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
def test_a_limit_of_motion_is_said_plainly(capsys, tmp_path):
    needs("heyoka")
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
def test_stored_doubles_are_the_nearest_to_the_exact_motion():
    needs("heyoka")
    certificate = certify("projectile", until=0.5)
    with mpmath.workdps(40):
        t = mpmath.mpf("0.5")
        assert certificate.q[-1, 1] == float(7 * t - mpmath.mpf("9.81") * t**2 / 2)
        assert certificate.v[-1, 1] == float(7 - mpmath.mpf("9.81") * t)


def test_dry_friction_is_refused_with_its_reason(capsys, tmp_path):
    out = tmp_path / "x.npz"
    found = run(capsys, str(DATA / "friction.toml"), "--out", str(out), code=1)
    assert "friction" in found["message"]
    assert not out.exists()
