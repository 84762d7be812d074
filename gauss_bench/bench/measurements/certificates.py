"""Make and verify the certificates (reference motions with guaranteed digits) of all built-in scenarios; list them in a table."""

import hashlib
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from gauss_bench.bench.tasks import PAUSE, Context, Rows, Tables, Task, finish, place_of
from gauss_bench.engines import not_installed
from gauss_bench.linkage.load import SINGLE, built_in, built_in_folder, document_of, load
from gauss_bench.mechanism.coordinates import value
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.certificate import Certificate, CertificateError, certificate_path, check_holds, read_certificate
from gauss_bench.reference.certify import DIGITS, Uncertified, certify, write_certificate
from gauss_bench.reference.verification import verify
from gauss_bench.runs.offers import duration
from gauss_bench.suites.schema import Suite

TABLE = "certificates"
LIMIT = 3600.0  # [s] for one certificate on a slow core
CLOSED_FORMS = (*SINGLE, "n_four_bar_2")  # generated linkages whose certificates compare both computations with a closed form
LONGER = {("crank_slider", "paper"): 10.0}  # [s] end of the paper's own example, whose motion is steady by then


def certify_one(
    linkage: str,
    scenario: str | None = None,
    digits: int = DIGITS,
    until: float | None = None,
    out: Path | None = None,
    told: Callable[[str], object] = lambda sentence: None,
) -> dict[str, Any]:
    """Certify a linkage, write the file `out`, and return the row of the certificate, with status "ok" or "failed" and a message.

    Args:
        linkage, scenario: name or path of the linkage, and one of its scenarios; by default the first scenario that has a start.
        digits: number of digits that the certificate should guarantee.
        until: end of the motion [s]; by default the end of the scenario.
        out: the file to be written; None writes no file.
        told: function that is called with a sentence at the start and, if stderr is not a terminal, with a line of progress every
            PAUSE seconds.

    Raises:
        LinkageError: the linkage file has faults.
        CertificateError: the number of digits or the end time of the motion is not valid.
        ChoiceError: the end time of the motion is too late.
    """
    if not 1 <= digits <= 16:
        raise CertificateError(f"--digits must be from 1 to 16, the digits of a double, not {digits}")
    if until is not None and not (np.isfinite(until) and until > 0):
        raise CertificateError(f"--until must be a positive number of seconds, not {until}")
    mechanism = load(linkage, scenario)
    end = duration(mechanism.duration, until=until)
    told(f"{mechanism.name}, scenario {mechanism.scenario}, until {end:g} s: two independent computations")
    started = last_line = time.perf_counter()
    bar_format = "{desc} {bar} {n:.3g}/{total:.3g} s"
    with tqdm(total=end, disable=not sys.stderr.isatty(), file=sys.stderr, bar_format=bar_format) as bar:

        def report(stage: str, t: float) -> None:
            """Show that a stage of the computation has reached the time t [s] of the motion."""
            nonlocal last_line
            if bar.disable and time.perf_counter() - last_line > PAUSE:
                last_line = time.perf_counter()
                told(f"{stage}: {t:.3g} of {end:.3g} s")
            bar.set_description(stage, refresh=False)
            bar.n = t
            bar.refresh()

        try:
            certificate = certify(linkage, mechanism.scenario, digits, until, report)
        except (Uncertified, ArithmeticError, ImportError) as error:
            message = not_installed(error) if isinstance(error, ImportError) else str(error)
            return {"status": "failed", **place_of(mechanism), "message": message}
    if out:
        write_certificate(certificate, out)
    return describe(certificate, mechanism) | {"file": str(out) if out else None, "seconds": time.perf_counter() - started}


def describe(certificate: Certificate, mechanism: Mechanism) -> dict[str, Any]:
    """Return the table row of a certificate: its guaranteed digits, its error bars at the end, and how it was computed."""
    c = certificate
    row: dict[str, Any] = {"status": "ok", "message": c.stopped, "mechanism": c.name, "scenario": c.scenario}
    row |= {"digits": c.digits, "until": c.until, "duration": c.duration, "complete": c.until >= c.duration * (1 - 1e-12)}
    for bar in ("error_q", "error_v", "error_a", "error_multipliers", "floor_q", "floor_v", "floor_a"):
        known = getattr(c, bar)[np.isfinite(getattr(c, bar))]  # NaN: not computed for that sample
        row[bar] = float(known[-1]) if len(known) else None
    if not c.multipliers.size:  # a linkage without constraints
        row["error_multipliers"] = None
    row |= {
        "measured": mechanism.measured.name,
        "measured_unit": mechanism.measured.unit,
        "measured_end": float(value(mechanism.measured.coordinate, c.q[-1])),
        "samples": len(c.t),
        "step": c.facts["collocation_step"],
        "method": c.facts["method"],
    }
    for name, pipeline in zip(("taylor", "collocation"), c.facts["pipelines"], strict=True):
        row |= {f"{name}_{k}": pipeline.get(k) for k in ("until", "off_closed_form", "stopped", "method")}
        row |= {f"{name}_drift_q": pipeline["drift"][0], f"{name}_drift_v": pipeline["drift"][1]}
    return row


def scenarios_to_certify() -> list[tuple[str, str]]:
    """Return linkage and scenario of every certificate of the suite.

    These are all scenarios of the built-in linkages, and those of the linkages in CLOSED_FORMS whose motion is known in closed
    form, without scenarios with dry friction, whose motions cannot be certified.
    """
    pairs = [(name, scenario) for name in (*built_in(), *CLOSED_FORMS) for scenario in document_of(name)[0]["scenarios"]]
    # a generated linkage with a driver has no closed form
    wanted = [(name, scenario) for name, scenario in pairs if name in built_in() or scenario != "driven"]
    return [place for place in wanted if not load(*place).has_friction]


def certify_built_in(jobs: int = 2) -> list[dict[str, Any]]:
    """Compute every certificate of the suite again and overwrite its file; return one table row for each."""
    return _rows([_task(x, _certify_in_place, x) for x in scenarios_to_certify()], jobs)


def _task(place: tuple[str, str], function: Callable[..., Tables], arguments: tuple[str, ...]) -> Task:
    """Return the task that calls function(*arguments) for a certificate; `place` is the certificate's linkage and scenario."""
    start = dict(zip(("mechanism", "scenario"), place, strict=True))
    return Task("|".join((*place, *arguments)), function, arguments, "", TABLE, start, LIMIT)


def _certify_in_place(name: str, scenario: str) -> Tables:
    """Compute the certificate of a built-in linkage, and write it where the suite reads it; return its row."""
    path = certificate_path(load(name, scenario))
    return {TABLE: [certify_one(name, scenario, until=LONGER.get((name, scenario)), out=path)]}


def verify_all(files: list[Path], linkage: str | None = None, jobs: int = 2) -> list[dict[str, Any]]:
    """Verify certificate files, or those of the suite if `files` is empty; return a row for each.

    Args:
        linkage: name or path of the linkage of all files; if not given, each file belongs to the linkage that it names.
        jobs: number of files that are verified at the same time.

    Raises:
        CertificateError: a file is missing, damaged or holds for another linkage.
    """
    files = files or [path for path in (certificate_path(load(*place)) for place in scenarios_to_certify()) if path]
    tasks = []
    for path in files:
        certificate = read_certificate(path)
        # a user's linkage lies in the folder above that of its certificates; others are built in or generated
        user_file = path.resolve().parent.parent / f"{certificate.name}.toml"
        owner = linkage or (str(user_file) if user_file.is_file() else certificate.name)
        check_holds(certificate, load(owner, certificate.scenario), path)
        tasks.append(_task((certificate.name, certificate.scenario), _verify, (str(path), owner)))
    return _rows(tasks, jobs)


def _verify(path: str, linkage: str) -> Tables:
    """Verify that the certificate in a file holds for the motion of a linkage; return its row."""
    certificate = read_certificate(Path(path))
    verification = verify(certificate, load(linkage, certificate.scenario))
    names = {"mechanism": certificate.name, "scenario": certificate.scenario}
    return {TABLE: [names | {"status": "ok", "file": path, **vars(verification), "passed": verification.passed}]}


def certificates_digest() -> str:
    """Return a digest of all certificates of the suite; if it has changed, figures that depend on them are out of date."""
    digest = hashlib.sha256()
    folder = built_in_folder()
    for path in sorted((folder / "certificates").glob("*.npz")) if folder else ():
        digest.update(f"{path.name}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return a single task for the table of certificates, because certificates are quick to read."""
    return [context.task(part.table, certificate_table, ()) for part in suite.certificates]


def certificate_table() -> Tables:
    """Return a row for every scenario of `scenarios_to_certify`: its certificate, or the reason why it has none."""
    rows = []
    for name, scenario in scenarios_to_certify():
        mechanism = load(name, scenario)
        path = certificate_path(mechanism)
        try:
            if path is None:
                raise CertificateError("no place for a certificate")
            certificate = read_certificate(path)
            check_holds(certificate, mechanism, path)
            rows.append(describe(certificate, mechanism))
        except CertificateError as error:
            rows.append({"status": "failed", "mechanism": name, "scenario": scenario, "message": str(error)})
    return {TABLE: rows}


def _rows(tasks: list[Task], jobs: int) -> Rows:
    """Run tasks and return their rows of TABLE, in order; a task whose worker crashed has a row with the reason."""
    return finish(tasks, jobs, "certificates").get(TABLE, [])
