"""Builds the report of a run: README.md, a summary for the forge, and for the browser index.html with its figures, and the site.

The page is the tree of `sections`: each file is a section, each room a chapter, in the order of their PLACE. A section names the
tables that it reads, and has one function of the run (in the room `linkage` of the run and a linkage) and, where it has something
to tell at the top, another one for its findings. Built twice from the same folder, every file comes out the same byte for byte.
What was written is listed in `figures/manifest.json`, and nothing else is ever taken away.
"""

import json
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import Any

from gauss_bench.report import sections as room
from gauss_bench.report.content import AUTHORS, Block, Finding, Findings, Picture, Section, Text, count, listed
from gauss_bench.report.errors import NoRun
from gauss_bench.report.pages import html_page, markdown_page
from gauss_bench.report.rows import Run, ok, order
from gauss_bench.report.site.write import write_site
from gauss_bench.report.summary import summary
from gauss_bench.tables import FORMAT, TABLES, files_of, format_of, read_environment, read_table, write_text

MANIFEST = "manifest.json"


def parts_of(package: ModuleType) -> list[ModuleType]:
    """The sections and chapters of a room, in order."""
    names = (module.name for module in iter_modules(package.__path__))
    return sorted((import_module(f"{package.__name__}.{name}") for name in names), key=lambda m: (m.PLACE, m.__name__))


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
    tables = {name: tuple(sorted(read_table(name, folder), key=order)) for name in tables_read()}
    return Run(read_environment(folder), tables)


def sections(run: Run) -> tuple[Section, ...]:
    """Everything the report says, in order."""
    return (first(run), *(part for module in parts_of(room) if (part := _section(module, run)) is not None))


def _section(module: ModuleType, run: Run) -> Section | None:
    """A section, or a chapter with the sections of its room."""
    if not hasattr(module, "__path__"):
        return _made(module.section(run))
    if module.__name__.endswith(".linkage"):
        chapters = []
        for name in run.linkages:
            inside = [part for m in parts_of(module) if (part := _made(m.section(run, name))) is not None]
            chapters.append(Section(name, name, parts=tuple(inside)))
    else:
        chapters = [part for m in parts_of(module) if (part := _section(m, run)) is not None]
    if not chapters and not module.NOTHING:
        return None
    return Section(module.TITLE, module.ANCHOR, () if chapters else (Text(module.NOTHING),), tuple(chapters))


def _made(section: Any) -> Section | None:
    assert section is None or isinstance(section, Section)
    return section


def first(run: Run) -> Section:
    """What this is, who wrote it, and what the run found."""
    engines = sorted({row["engine"] for row in run.results})
    fine = sum(ok(row) for row in run.results)
    scope = (
        f"The run has {count(len(run.results), 'case')} of {count(len(engines), 'engine')} on {count(len(run.linkages), 'linkage')}"
        f" ({listed(f'`{name}`' for name in run.linkages)}); {fine} ended ok."
        if run.results
        else "The run has no cases."
    )
    said = Findings(tuple(all_findings(run)))
    return Section("Findings", "findings", (Text(AUTHORS), Text(scope), *((said,) if said.items else ())))


def all_findings(run: Run) -> Iterator[Finding]:
    """What the sections found, in their order."""
    for module in all_parts():
        if hasattr(module, "findings"):
            yield from module.findings(run)


def build_report(folder: Path) -> list[Path]:
    """Write README.md, index.html, figures/*.svg and the site into the folder of a run; returns what was written.

    Figures that an earlier report wrote there and this one does not are taken away; other files are left alone.

    Raises:
        NoRun, TableError: as `read_run`; nothing is written then.
    """
    run = read_run(folder)
    content = sections(run)
    pictures = {picture.name: picture.svg for section in content for picture in _pictures(section)}
    figures = folder / "figures"
    files = {figures / f"{name}.svg": svg for name, svg in sorted(pictures.items())}
    files[folder / "README.md"] = markdown_page(run, summary(run, all_findings(run)))
    files[folder / "index.html"] = html_page(run, content)
    before = manifest(figures)
    for path, text in files.items():
        write_text(path, text)
    names = sorted(path.name for path in files if path.parent == figures)
    if names or before:
        write_text(figures / MANIFEST, json.dumps({"format": FORMAT, "figures": names}, indent=1) + "\n")
    for stale in before - set(names):
        (figures / stale).unlink(missing_ok=True)
    return [*files, *write_site(folder, run)]


def manifest(figures: Path) -> set[str]:
    """Names of the figures that an earlier report says to have written; none where it does not say so clearly."""
    try:
        names = json.loads((figures / MANIFEST).read_text(encoding="utf-8"))["figures"]
    except (OSError, ValueError, KeyError, TypeError):
        return set()
    return (
        {x for x in names if isinstance(x, str) and Path(x).name == x and x.endswith(".svg")} if isinstance(names, list) else set()
    )


def _pictures(section: Section) -> list[Picture]:
    blocks: list[Block] = [*section.blocks]
    return [b for b in blocks if isinstance(b, Picture)] + [p for part in section.parts for p in _pictures(part)]
