"""Make and verify certificates, which are reference motions with guaranteed digits."""

from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from gauss_bench.api.files import writable
from gauss_bench.api.telling import Answer, Told, render
from gauss_bench.bench.measurements import certificates
from gauss_bench.reference.certificate import CERTIFICATES
from gauss_bench.reference.verification import Verification
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.tables import TABLES, Column, Table
from gauss_bench.verbs.formats import list_meanings

MADE = TABLES["certificates"]
FILE = Column("file", "text", "path of the certificate; null if none was written")
CERTIFIED = replace(MADE, columns=(*MADE.columns, FILE, Column("seconds", "number", "time of the computation", "s")))
NAMES = ("mechanism", "scenario")
SHARED = [c for c in MADE.columns if c.name in ("status", "message", *NAMES)]
MEASURED = [Column(x, "number", meaning) for x, meaning in list_meanings(Verification).items() if x not in NAMES]
PASSED = Column("passed", "flag", "whether the certificate holds")
VERIFIED = Table("the check of one certificate", (*SHARED, *MEASURED, FILE, PASSED))
Row = dict[str, Any]


def certify(options: Namespace, told: Told) -> Answer[Annotated[Row, CERTIFIED]] | Answer[Annotated[list[Row], CERTIFIED]]:
    """Compute the certificate of one scenario of a linkage, or those of all scenarios of all built-in linkages."""
    if options.out is not None:
        default_folder = Path(options.linkage).parent / CERTIFICATES if options.linkage else None
        writable(options.out, replace=True, usual=default_folder, suffix=".npz", source=options.linkage or "")
    if options.built_in:
        rows = certificates.certify_built_in(options.jobs)
        return Answer(rows, all(row["status"] == "ok" for row in rows), render("certificates", rows))
    if options.linkage is None:
        raise ChoiceError("certify needs a linkage, or --built-in")
    row = certificates.certify_one(options.linkage, options.scenario, options.digits, options.until, options.out, told)
    return Answer(row, row["status"] == "ok")


def verify(options: Namespace) -> Answer[Annotated[list[Row], VERIFIED]]:
    """Check certificates in double precision; return a table row for each.

    The verb fails if a certificate does not hold, or if there is no certificate.
    """
    rows = certificates.verify_all(options.certificates, options.linkage, options.jobs)
    return Answer(rows, bool(rows) and all(row.get("passed", False) for row in rows))
