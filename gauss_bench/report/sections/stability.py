"""What a run loses with time: constraints and energy."""

from gauss_bench.report.content import Block, Picture, Section, Text
from gauss_bench.report.figures import drift, energy
from gauss_bench.report.rows import Run, grouped

WORDS = (
    "Drift is how far a run has left its constraints, computed in absolute coordinates for every engine; the energy error "
    "is what is left of the balance of energy, work and losses. Drawn at one common step, negative controls included in "
    "grey: a small drift does not make a motion right."
)


def section(run: Run, name: str) -> Section | None:
    blocks: list[Block] = []
    for scenario, rows in grouped((r for r in run.series if r["mechanism"] == name), lambda r: str(r["scenario"])).items():
        tag = f"{name}_{scenario}"
        cases = [row for row in run.of(name) if row["scenario"] == scenario]
        for kind, figure in (("drift", drift), ("energy", energy)):
            svg, step = figure(rows, cases)
            if svg:
                words = f"{kind.capitalize()} over time, {name} {scenario}"
                blocks.append(Picture(f"{kind}_{tag}", svg, words, f"At step {step:g} s, or the engine's own."))
    return Section("Drift and energy", f"{name}-drift", (Text(WORDS), *blocks)) if blocks else None
