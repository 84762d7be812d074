"""Builds the report of a run: README.md, a summary beside the rows for the forge, and the site for the browser.

What both say is the tree of `sections`: each file is a section, each room a chapter, in the order of their PLACE. A section names
the tables that it reads, and has one function of the run (in the room `linkage` of the run and a linkage) and, where it has
something to tell at the top, another one for its findings. Built twice from the same folder, every file comes out the same byte
for byte.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from gauss_bench.report import sections as room
from gauss_bench.report.content import AUTHORS, Finding, Findings, Section, Text, count, itemise
from gauss_bench.report.errors import NoRun
from gauss_bench.report.pages import markdown_page
from gauss_bench.report.parts import parts_of
from gauss_bench.report.rows import Run, ok, order
from gauss_bench.report.site.first import Programs
from gauss_bench.report.site.write import SITE, write_site
from gauss_bench.report.summary import summary
from gauss_bench.tables import TABLES, files_of, format_of, read_environment, read_table, refuse_foreign, write_text

HEADING, TITLE = "# Closed-loop planar linkages, engines side by side", "gauss_bench</title>"  # every report's own


def all_parts(package: ModuleType = room) -> Iterator[ModuleType]:
    """Every section and chapter of a room, at every depth."""
    for module in parts_of(package):
        yield module
        if hasattr(module, "__path__"):
            yield from all_parts(module)


def tables_read() -> tuple[str, ...]:
    """The tables that the sections read, each once."""
    return tuple(dict.fromkeys(name for module in all_parts() for name in getattr(module, "TABLES", ())))


def read_run(folder: Path) -> Run:
    """The rows and the environment that a run left in a folder.

    Raises:
        NoRun: there is none.
        TableError: a file is damaged, or of a later format than is known here.
    """
    written = [name for name in TABLES if name != "baseline" and files_of(name, folder)]
    if not written:
        raise NoRun(f"{folder}: no run there: none of the tables that `gauss-bench run --out {folder}` writes")
    format_of(folder)
    tables = {name: tuple(sorted(read_table(name, folder), key=order)) for name in TABLES if name != "baseline"}
    return Run(read_environment(folder), tables)


def sections(run: Run) -> tuple[Section, ...]:
    """Everything the report says, in order."""
    return (first(run), *(part for module in parts_of(room) if (part := _section(module, run)) is not None))


def _section(module: ModuleType, run: Run) -> Section | None:
    """A section, or a chapter with the sections of its room."""
    if not hasattr(module, "__path__"):
        return _making(module.section(run)) if hasattr(module, "section") else None
    if module.__name__.endswith(".linkage"):
        chapters = []
        for name in run.linkages:
            inside = [
                part for m in parts_of(module) if hasattr(m, "section") and (part := _making(m.section(run, name))) is not None
            ]
            chapters.append(Section(name, name, parts=tuple(inside)))
    else:
        chapters = [part for m in parts_of(module) if (part := _section(m, run)) is not None]
    if not chapters and not module.NOTHING:
        return None
    return Section(module.TITLE, module.ANCHOR, () if chapters else (Text(module.NOTHING),), tuple(chapters))


def _making(section: Any) -> Section | None:
    assert section is None or isinstance(section, Section)
    return section


def first(run: Run) -> Section:
    """The opening of the summary: its subject, its authors, and what the run found."""
    engines = sorted({row["engine"] for row in run.results})
    fine = sum(ok(row) for row in run.results)
    scope = (
        f"The run has {count(len(run.results), 'case')} of {count(len(engines), 'engine')} on {count(len(run.linkages), 'linkage')}"
        f" ({itemise(f'`{name}`' for name in run.linkages)}); {fine} ended ok."
        if run.results
        else "The run has no cases."
    )
    said = Findings(tuple(all_findings(run)))
    return Section("Findings", "findings", (Text(AUTHORS), Text(scope), *((said,) if said.items else ())))


def all_findings(run: Run) -> Iterator[Finding]:
    """All findings of the sections, in their order."""
    for module in all_parts():
        if hasattr(module, "findings"):
            yield from module.findings(run)


def refuse_pages_of_others(folder: Path) -> None:
    """Let a report be written into a folder without pages, or with those of an earlier report.

    Raises:
        FileExistsError: naming a page of somebody else.
    """
    refuse_foreign({folder / "README.md": HEADING, folder / SITE / "index.html": TITLE})


def build_report(
    folder: Path, programs: Programs | None = None, told: Callable[[str], object] = lambda sentence: None
) -> list[Path]:
    """Write README.md and the site into the folder of a run; returns what was written.

    Args:
        programs: choices -> programs that run them, for the first screen; without it calls of this package stand there.
        told: is told that it begins, once every table is read.

    Raises:
        NoRun, TableError: as `read_run`; nothing is written then.
        FileExistsError: as `refuse_pages_of_others`.
    """
    refuse_pages_of_others(folder)
    run = read_run(folder)
    told(f"{folder}: writing the pages")
    findings = list(all_findings(run))
    page = folder / "README.md"
    write_text(page, markdown_page(run, summary(run, findings)))
    return [page, *write_site(folder, run, findings, programs)]
