"""What this is, who wrote it, and what the run found."""

from gauss_bench.report.content import Findings, Section, Text, count, listed
from gauss_bench.report.findings import all_findings
from gauss_bench.report.rows import Run, ok

AUTHORS = (
    "This report compares ways to compute the motion of closed-loop planar linkages: formulations of the suite's own, and other "
    "engines through adapters, all from the same file and the same start. **The authors of the suite also wrote the `gauss` "
    "formulation it compares**; it passes through the same gate, the same clock and the same tables as every other row, and the "
    "rows where it loses are printed like those where it wins."
)


def section(run: Run) -> Section:
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
