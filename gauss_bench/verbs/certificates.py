"""Verbs that make certificates and verify them."""

from argparse import Namespace
from pathlib import Path

from gauss_bench.api.files import writable
from gauss_bench.api.telling import Answer, Told, render
from gauss_bench.bench.measurements import certificates
from gauss_bench.reference.certificate import CERTIFICATES
from gauss_bench.runs.offers import ChoiceError


def certify(options: Namespace, told: Told) -> Answer:
    """Certify one scenario, or every one of the built-in linkages."""
    if options.out is not None:
        beside = Path(options.linkage).parent / CERTIFICATES if options.linkage else None
        writable(options.out, replace=True, usual=beside, suffix=".npz", source=options.linkage or "")
    if options.built_in:
        rows = certificates.certify_built_in(options.jobs)
        return Answer(rows, all(row["status"] == "ok" for row in rows), render("certificates", rows))
    if options.linkage is None:
        raise ChoiceError("certify needs a linkage, or --built-in")
    row = certificates.certify_one(options.linkage, options.scenario, options.digits, options.until, options.out, told)
    return Answer(row, row["status"] == "ok")


def verify(options: Namespace) -> Answer:
    """Check certificates in double precision."""
    rows = certificates.verify_all(options.certificates, options.linkage, options.jobs)
    return Answer(rows, bool(rows) and all(row.get("passed", False) for row in rows))
