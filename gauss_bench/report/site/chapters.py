"""The pages that consist of sections (papers, kernel, releases and method), and the page of all findings."""

from collections.abc import Iterable, Sequence
from types import ModuleType
from typing import Any

from gauss_bench.report.content import Chart, Finding, Section
from gauss_bench.report.rows import Run
from gauss_bench.report.sections import all_sections, bias, claim, field, kernel, limitations, papers, releases, reproduction
from gauss_bench.report.site.page import Page, plain_page, render

PAPERS = (claim, papers, reproduction)
TONES = ("bad", "warn", "", "good")  # tones of findings in the order of the page


def make_sections(run: Run, modules: Iterable[ModuleType]) -> list[Section]:
    """Return the sections of modules, without modules that have no section or no rows for it."""
    sections = [module.section(run) for module in modules if hasattr(module, "section")]
    return [section for section in sections if section is not None]


def chart_data(section: Section) -> dict[str, Any]:
    """Return name of a figure -> its data, for all figures of a section and its subsections."""
    data = {x.name: x.data() for x in section.blocks if isinstance(x, Chart)}
    for part in section.parts:
        data |= chart_data(part)
    return data


def make_chapter(name: str, title: str, lead: str, contents: Sequence[Section], **parts: Any) -> Page:
    """Return a page of sections that has its own entry in the table of contents; `parts` are further arguments of `plain_page`."""
    charts = chart_data(Section(title, name, (), contents))
    return plain_page(name, title, lead, title, charts, sections=contents, **parts)


def papers_page(run: Run) -> Page | None:
    """Return the page on the papers, with their claim, their audited lines and the first paper's example; None without rows."""
    if not run.table("audit") and not run.table("kernel_claim"):
        return None
    lead = "Three papers claim that fewer unknowns are faster. Each of their lines is computed as printed, and as it should read."
    return make_chapter("papers", "Papers", lead, make_sections(run, PAPERS))


def kernel_page(run: Run) -> Page | None:
    """Return the page on speed and accuracy of the compiled formulations, or None if the run did not measure them."""
    content = kernel.section(run)
    lead = "The compiled formulations: the cost of a step, its accuracy, and its distance from the limit of the processor."
    return make_chapter("kernel", "Kernel", lead, content.parts) if content else None


def releases_page(run: Run) -> Page | None:
    """Return the page on the releases of engines' libraries, or None if the run compared none."""
    content = releases.section(run)
    lead = "What changed between the releases of an engine, what is rounding, and what a step costs."
    return make_chapter("releases", "What changed", lead, content.parts) if content else None


def method_page(run: Run) -> Page:
    """Return the page on the method: an opening text, limitations and biases, then every section that no other page has."""
    lead = "What is compared, what counts as true, what a time is, and the limits of the comparison."
    # limitations and biases come first; the sections that are left out have pages of their own
    others = [x for x in all_sections() if x not in (*PAPERS, kernel, releases, limitations, bias, field)]
    return make_chapter("method", "Method", lead, make_sections(run, [limitations, bias, *others]), opening=render("method.html"))


def findings_page(findings: Sequence[Finding]) -> Page:
    """Return the page with all findings, the worst first."""
    ordered = sorted(findings, key=lambda x: TONES.index(x.tone))
    lead = "Every sentence is computed from the rows behind it; defeats come first."
    return plain_page("findings", "Findings", lead, "Findings", findings=ordered)
