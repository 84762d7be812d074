"""Build the report of a run: a summary in README.md, which is kept in git beside the rows, and a site for the browser.

Summary and site take their content from the modules in the folder `sections`, in the order of their numbers PLACE. A module has
a function `section(run)`, a function `findings(run)`, or both. Equal rows give equal files, byte for byte.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from gauss_bench.atomic import write_text
from gauss_bench.checksums import checksum_of_run, read_checksums, require_unchanged
from gauss_bench.report.content import Finding
from gauss_bench.report.field_run import folders_of
from gauss_bench.report.pages import markdown_page
from gauss_bench.report.rows import Run, sort_key
from gauss_bench.report.sections import all_sections
from gauss_bench.report.site.first import Programs
from gauss_bench.report.site.write import SITE, write_site
from gauss_bench.report.summary import summary
from gauss_bench.tables import TABLES, files_of, read_environment, read_table, refuse_foreign
from gauss_bench.untrusted import BadInput

# texts that mark a summary and a site as pages of this suite, which may be overwritten
HEADING, TITLE = "# Closed-loop planar linkages, engines side by side", "gauss_bench</title>"
FAULTS = "findings"  # folder beside the tables, with reports on faults in engines' libraries


class NoRun(BadInput, ValueError):
    """A folder has no tables of a run."""


def read_run(folder: Path) -> Run:
    """Return the run in a folder; its attribute `beside` is the run in the subfolder `field`, if there is one.

    Raises:
        NoRun: the folder has no run.
        TableError: a file is damaged, or has a later format than this version reads.
        ChangedRows: a table was changed after the run.
    """
    run, *beside = map(read_folder, folders_of(folder))
    return replace(run, beside=beside[0]) if beside else run


def read_folder(folder: Path) -> Run:
    """Return the run in a folder, without the run in its subfolder `field`; errors are those of `read_run`."""
    names = [name for name in TABLES if name != "baseline"]
    if not any(files_of(name, folder) for name in names):
        raise NoRun(f"{folder}: no run there: none of the tables that `gauss-bench run --out {folder}` writes")
    tables = {name: tuple(sorted(read_table(name, folder), key=sort_key)) for name in names}
    require_unchanged(folder)  # after reading, because `read_table` says more about a damaged file
    checksums = read_checksums(folder)
    checksum = checksum_of_run(checksums) if checksums else ""
    faults = {path.stem: path.read_text(encoding="utf-8") for path in sorted((folder / FAULTS).glob("*.md"))}
    return Run(read_environment(folder), tables, checksum, read_table("baseline", folder), faults)


def all_findings(run: Run) -> Iterator[Finding]:
    """Yield the findings of all sections, in the order of the sections."""
    for module in all_sections():
        if hasattr(module, "findings"):
            yield from module.findings(run)


def refuse_pages_of_others(folder: Path) -> None:
    """Check that a report would overwrite no page that another program or a person wrote.

    Raises:
        FileExistsError: a page there is not from an earlier report; the message names the page.
    """
    refuse_foreign({folder / "README.md": HEADING, folder / SITE / "index.html": TITLE})


def build_report(
    folder: Path, programs: Programs | None = None, say: Callable[[str], object] = lambda sentence: None
) -> list[Path]:
    """Write README.md and the site into the folder of a run, and return the written files.

    Raises:
        NoRun, TableError, ChangedRows: as in `read_run`; no file is written.
        FileExistsError: as in `refuse_pages_of_others`; no file is written.
    """
    refuse_pages_of_others(folder)
    run = read_run(folder)
    say(f"{folder}: writing the pages")
    findings = list(all_findings(run))
    page = folder / "README.md"
    write_text(page, markdown_page(run, summary(run, findings)))
    return [page, *write_site(folder, run, findings, programs)]
