"""Pages that are whole chapters of the report: the papers, the kernel, the method, and every finding."""

from types import ModuleType

from markupsafe import Markup

from gauss_bench.report import sections as room
from gauss_bench.report.content import AUTHORS, Finding, Section
from gauss_bench.report.parts import parts_of
from gauss_bench.report.rows import Run
from gauss_bench.report.sections import claim, kernel, limitations, linkage, papers, reproduction
from gauss_bench.report.site.page import Page, charts_in, finding, join_blocks, paragraph, section

PAPERS = (claim, papers, reproduction)


def parts(run: Run, modules: tuple[ModuleType, ...]) -> list[Section]:
    made = (module.section(run) for module in modules)
    return [x for x in made if x is not None]


def chapter(name: str, title: str, lead: str, contents: list[Section], first: tuple[str, ...] = ()) -> Page:
    data = {x.name: x.data() for part in contents for x in charts_in(part)}
    body = [*map(paragraph, first), *map(section, contents)]
    return Page(name, title, lead, join_blocks(body), {"charts": data} if data else {}, title)


def papers_page(run: Run) -> Page | None:
    """The papers' claim, their lines, and the first one's example; nothing where a run looked at none."""
    if not run.table("audit") and not run.table("kernel_claim"):
        return None
    lead = "What three papers say of few unknowns against many, line by line: as printed, and as it should read."
    return chapter("papers", "Papers", lead, parts(run, PAPERS))


def kernel_page(run: Run) -> Page | None:
    """The page on how fast, exact and near the machine's limit the compiled formulations are; nothing where a run measured none."""
    contents = parts(run, tuple(parts_of(kernel)))
    if not contents or not any(run.table(name) for name in kernel.MEASURED if name != "kernel_claim"):
        return None
    return chapter(
        "kernel",
        "Kernel",
        "The compiled formulations: what a step costs, how exact it is, and how near it comes to what the processor allows.",
        contents,
    )


def method_page(run: Run) -> Page:
    """Limits first, then every section that has no page of its own."""
    lead = "What the figures cannot tell, how they were taken, and who took them."
    elsewhere = (*PAPERS, kernel, linkage)
    modules = sorted((x for x in parts_of(room) if x not in elsewhere), key=lambda x: x is not limitations)
    return chapter("method", "Method", lead, parts(run, tuple(modules)), (AUTHORS,))


def findings_page(findings: list[Finding]) -> Page:
    order = ("bad", "warn", "", "good")
    ordered = sorted(findings, key=lambda x: order.index(x.tone) if x.tone in order else 2)
    body = Markup('<ul class="findings">{}</ul>').format(join_blocks(finding(x, 2) for x in ordered))
    return Page(
        "findings", "Findings", "Every sentence is computed from stored rows; where we lose comes first.", body, group="Findings"
    )
