"""Known limitations: those of every run, from `layouts.toml`, and the cases that this run left out."""

from gauss_bench.report.content import Bullets, Section, layouts
from gauss_bench.report.rows import Run

PLACE = 90


def section(run: Run) -> Section:
    """Return the section with the list of limitations; cases that the run left out come last."""
    return Section("Known limitations", "limitations", (Bullets((*layouts()["limitations"]["items"], *list_left_out(run))),))


def list_left_out(run: Run) -> list[str]:
    """Return a sentence with the reason for each group of cases that the suite left out."""
    sentences = []
    for rule in run.environment.get("left_out", []):
        # a rule has lists such as "linkages" and "engines"; each becomes names separated by commas
        lists = [values for key, values in rule.items() if key not in ("why", "steps")]
        words = [", ".join(f"{x:g}" if isinstance(x, float) else f"`{x}`" for x in values) for values in lists]
        if rule.get("steps"):
            words.append(f"at steps of {', '.join(f'{x:g}' for x in rule['steps'])} s")
        sentences.append(f"**Left out:** {' '.join(words)}, because {rule['why']}.")
    return sentences
