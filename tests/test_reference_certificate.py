"""Certificates: what is written is read, what has changed is refused, what is false is found."""

from dataclasses import replace
from pathlib import Path

import mpmath
import numpy as np
import pytest

from gauss_bench.cli import main
from gauss_bench.linkage.load import built_in, document_of, load, load_document
from gauss_bench.reference import certificate as certificates
from gauss_bench.reference.build import build_reference
from gauss_bench.reference.certificate import Certificate, CertificateError, as_reference, find_certified, read_certificate
from gauss_bench.reference.certify import distance, sample_times, split, write_certificate
from gauss_bench.reference.verification import verify
from gauss_bench.terms import Array


def from_doubles(name: str, scenario: str, t_end: float) -> Certificate:
    """A certificate-shaped file from the double-precision reference, to test everything but the pipelines."""
    mechanism = load(name, scenario)
    r = build_reference(mechanism, t_end)
    zeros, levels = np.zeros(len(r.t)), (r.q, r.v, r.a, np.zeros((len(r.t), 0)))
    bars = (r.error_q, r.error_v, r.error_a, zeros, zeros + 1e-15, zeros, zeros)
    facts = {"method": "two integrators in double precision"}
    return Certificate(name, scenario, mechanism.digest, r.t, *levels, *bars, 11, t_end, "", facts)


@pytest.fixture(scope="module")
def certificate() -> Certificate:
    return from_doubles("four_bar", "torque", 0.2)


def test_a_certificate_survives_its_file_and_the_same_one_gives_the_same_bytes(certificate: Certificate, tmp_path: Path) -> None:
    one, two = tmp_path / "one.npz", tmp_path / "two.npz"
    write_certificate(certificate, one)
    write_certificate(certificate, two)
    assert one.read_bytes() == two.read_bytes()
    read = read_certificate(one)
    for name, value in vars(certificate).items():
        found = getattr(read, name)
        assert (found == value).all() if isinstance(value, np.ndarray) else found == value, name
    assert {*tmp_path.iterdir()} == {one, two}


def test_a_comment_changes_nothing_and_another_mass_or_scenario_is_refused(certificate: Certificate, tmp_path: Path) -> None:
    text = built_in()["four_bar"].read_text(encoding="utf-8")
    file = tmp_path / "four_bar.toml"
    file.write_text("# a word\n" + text, encoding="utf-8")
    certificates.check_holds(certificate, load(file, "torque"), file)
    document, _, _ = document_of("four_bar")
    link = next(iter(document["links"]))
    document["links"][link]["kg_per_m"] *= 1.0000001
    with pytest.raises(CertificateError, match="has changed since"):
        certificates.check_holds(certificate, load_document(document, "torque"), file)
    with pytest.raises(CertificateError, match="not four_bar in scenario conservative"):
        certificates.check_holds(certificate, load("four_bar", "conservative"), file)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 torn", b"text"])
def test_what_is_no_certificate_is_refused_by_name(content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.npz"
    path.write_bytes(content)
    with pytest.raises(CertificateError, match=r"x\.npz"):
        read_certificate(path)
    assert main(["verify", str(path)]) == 2
    assert "not a certificate" in capsys.readouterr().err


def test_the_suite_takes_the_certificate_beside_a_linkage_file_and_names_a_stale_one(
    certificate: Certificate, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "four_bar.toml"
    file.write_bytes(built_in()["four_bar"].read_bytes())
    path = certificates.certificate_path(load(file, "torque"))
    assert path == tmp_path / "certificates" / "four_bar.torque.npz"
    write_certificate(certificate, path)
    reference = find_certified(load(file, "torque"), 0.1)
    assert reference is not None
    assert reference.t[-1] == pytest.approx(0.1)
    assert "certified" in reference.method
    assert find_certified(load(file, "torque"), 0.3) is None  # it does not reach so far
    file.write_text(file.read_text(encoding="utf-8").replace("9.81", "9.82"), encoding="utf-8")
    if load(file, "torque").digest != certificate.digest:
        assert find_certified(load(file, "torque"), 0.1) is None
        assert "has changed since" in capsys.readouterr().err


def test_the_bar_of_a_certified_reference_holds_the_rounding_of_what_is_stored(certificate: Certificate) -> None:
    reference = as_reference(replace(certificate, error_q=np.zeros_like(certificate.error_q)), 0.2)
    largest = np.maximum.accumulate(np.abs(reference.q).max(axis=-1))
    assert (reference.error_q > 0).all()
    assert (reference.error_q <= np.spacing(largest)).all()


@pytest.mark.long("four_bar-torque")
@pytest.mark.parametrize(("name", "scenario"), [("four_bar", "torque"), ("parallelogram", "driven"), ("sleigh", "glide")])
def test_a_true_certificate_is_verified_and_a_false_one_is_not(name: str, scenario: str) -> None:
    certificate, mechanism = from_doubles(name, scenario, 0.1), load(name, scenario)
    found = verify(certificate, mechanism)
    assert found.passed, found
    for level in ("q", "v", "a"):
        values: Array = getattr(certificate, level).copy()
        values[len(values) // 2 :] += 1e-7
        assert not verify(replace(certificate, **{level: values}), mechanism).passed, level  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("duration", "count"), [(0.0, 1), (0.03, 301), (1.0, 101), (2.0, 201), (10.0, 501), (60.0, 501), (0.5001, 52)]
)
def test_samples_are_exact_decimals_neither_too_many_nor_too_few(duration: float, count: int) -> None:
    times = sample_times(duration)
    assert float(times[0]) == 0.0
    assert float(times[-1]) == duration
    assert len(times) == count
    assert all(len(t) <= 8 for t in times)


def test_differences_are_right_far_below_double_precision() -> None:
    with mpmath.workdps(40):
        one = np.array([[mpmath.mpf("0.1")]])
        other = np.array([[mpmath.mpf("0.1") + mpmath.mpf("1e-25")]])
    assert distance(one, other)[0] == pytest.approx(1e-25, rel=1e-5)
    assert distance(one, np.array([[np.longdouble("0.1")]]))[0] < 1e-20
    assert split(one)[0][0, 0] == 0.1
