"""Compare the results and times of several releases of an engine's library, for the command `releases`."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

from gauss_bench.api.files import usable_folder
from gauss_bench.api.telling import Answer, Told
from gauss_bench.atomic import write_text
from gauss_bench.bench.journal import Journal
from gauss_bench.bench.provenance import environment
from gauss_bench.linkage.digest import source_digest
from gauss_bench.releases.asking import BUDGET, Answers, as_data, ask_release, from_data
from gauss_bench.releases.costs import race_releases
from gauss_bench.releases.environments import Release, as_engines, install_release, list_available
from gauss_bench.releases.library import Library, ReleaseFault, choose_releases, read_library, version_numbers
from gauss_bench.releases.table import SCHEMAS, make_tables, write_tables
from gauss_bench.report.what_changed import TITLE, write_page
from gauss_bench.runs.offers import check_budget
from gauss_bench.tables import refuse_foreign
from gauss_bench.trajectory import Status

LOCAL = Path("reports/local")
PAGE = "what_changed.md"
RUN = ".run"  # folder of journals in the folder of a run
QUESTIONS = ("releases/asking.py", "releases/cases.py", "releases/probes.py", "releases/linkages")
ASKED = ("engines", "runs", "mechanism", "integrate", *QUESTIONS)  # source files on which the results of a release depend
Rows = Annotated[Mapping[str, Sequence[Mapping[str, Any]]], SCHEMAS]


def releases(
    engine: str,
    first: str | None,
    last: str | None,
    only: list[str] | None,
    new: bool,
    out: Path,
    budget: float | None,
    no_costs: bool,
    told: Told,
) -> Answer[Rows]:
    """Install several releases of an engine's library, run the same computations with each, and write what changed.

    Args:
        only: the releases that are compared; None for the range from `first` to `last`, or for the list in `releases.toml`.
        new: compare the newest release of `releases.toml` with all later ones that the index of packages offers.
        budget: time [s] for the computations with one release.
    """
    library = read_library(engine)
    if new and (first or last or only):
        raise ReleaseFault("--new takes the newest listed release and all later ones; leave out --from, --to and --only")
    wanted = [library.releases[-1]] if new else choose_releases(library, first, last, only)
    usable_folder(out, LOCAL)
    refuse_foreign({out / PAGE: TITLE})
    seconds = check_budget(budget, BUDGET)
    found = [install_release(library, version, told) for version in wanted]
    if new and found[0].python:  # the newest listed release is installed, so that its pip can list the later ones
        later = [x for x in list_available(found[0], library) if version_numbers(x) > version_numbers(wanted[0])]
        found += [install_release(library, version, told) for version in sorted(later, key=version_numbers)]
    installed = [x for x in found if x.python]
    if not installed:
        raise ReleaseFault(f"no release of {engine} can be installed: {found[0].reason}")
    with as_engines(library, installed), Journal(out / RUN / f"releases-{engine}.jsonl") as journal:
        answers = [ask_or_recall(library, release, seconds, journal, told) for release in found]
        usable_versions = {x.version for x in answers if x.usable}
        usable = [x for x in installed if x.version in usable_versions]
        raced = ([], []) if no_costs or len(usable) < 2 else race_releases(library, usable, told)
    facts = environment()
    commit = f"{facts['commit']}{' with changes' if facts['dirty'] else ''}"
    tables = make_tables(engine, answers, *raced, commit, datetime.now(UTC).strftime("%Y-%m-%d"))
    files = write_tables(tables, engine, out)
    text = write_page(tables)
    write_text(out / PAGE, text)
    return Answer(tables, text=text, notices=tuple(str(x) for x in (*files, out / PAGE)))


def ask_or_recall(library: Library, release: Release, budget: float, journal: Journal, told: Told) -> Answers:
    """Return the results of a release: those that the same code stored in the file `journal`, or else results of a new run."""
    if not release.python:
        return Answers(release.version, status=str(Status.SKIP), message=release.reason)
    stamp = f"{source_digest(*ASKED)} {release.how} {budget:g}"
    stored = journal.find(release.version, stamp)
    if stored:
        return from_data(stored)
    answers = ask_release(library, release, budget, told)
    if answers.usable:
        journal.add(release.version, stamp, as_data(answers))
    return answers
