"""The pages on the papers, the kernel and the method, made of sections, and the page of all findings."""

from types import ModuleType
from typing import Any

from gauss_bench.report import sections as room
from gauss_bench.report.content import AUTHORS, Finding, Section
from gauss_bench.report.parts import parts_of
from gauss_bench.report.rows import Run
from gauss_bench.report.sections import claim, kernel, limitations, papers, reproduction
from gauss_bench.report.site.page import Page, charts_in, plain_page

PAPERS = (claim, papers, reproduction)


def parts(run: Run, modules: tuple[ModuleType, ...]) -> list[Section]:
    made = (module.section(run) for module in modules if hasattr(module, "section"))
    return [x for x in made if x is not None]


def chapter(name: str, title: str, lead: str, contents: list[Section], **parts: Any) -> Page:
    data = {name: chart for part in contents for name, chart in charts_in(part).items()}
    return plain_page(name, title, lead, title, data, sections=contents, **parts)


def papers_page(run: Run) -> Page | None:
    """Return the page on the papers: their claim, their audited lines and the first one's example; None without data."""
    if not run.table("audit") and not run.table("kernel_claim"):
        return None
    lead = "What three papers say of few unknowns against many, line by line: as printed, and as it should read."
    return chapter("papers", "Papers", lead, parts(run, PAPERS))


def kernel_page(run: Run) -> Page | None:
    """Return the page on speed and accuracy of the compiled formulations; None if the run measured none."""
    content = kernel.section(run)
    lead = "The compiled formulations: what a step costs, how exact it is, and how near it comes to what the processor allows."
    return chapter("kernel", "Kernel", lead, list(content.parts)) if content else None


def method_page(run: Run) -> Page:
    """Return the page on the method: limitations first, then every section without a page of its own."""
    lead = "What the figures cannot tell, how they were taken, and who took them."
    elsewhere = (*PAPERS, kernel)
    modules = sorted((x for x in parts_of(room) if x not in elsewhere), key=lambda x: x is not limitations)
    return chapter("method", "Method", lead, parts(run, tuple(modules)), paragraphs=(AUTHORS,))


def findings_page(findings: list[Finding]) -> Page:
    order = ("bad", "warn", "", "good")
    ordered = sorted(findings, key=lambda x: order.index(x.tone) if x.tone in order else 2)
    lead = "Every sentence is computed from stored rows; where we lose comes first."
    return plain_page("findings", "Findings", lead, "Findings", findings=ordered)
