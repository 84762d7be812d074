"""Known limitations, written once in `layouts.toml`; they hold for every run."""

from gauss_bench.report.content import Bullets, Section, layouts
from gauss_bench.report.rows import Run

PLACE = 90


def section(run: Run) -> Section:
    """Return the list of limitations, the last ones being what this run left out."""
    return Section("Known limitations", "limitations", (Bullets((*layouts()["limitations"]["items"], *list_left_out(run))),))


def list_left_out(run: Run) -> list[str]:
    """List what the suite did not run, each with its reason."""
    sentences = []
    for rule in run.environment.get("left_out", []):
        lists = [rule[k] for k in rule if k not in ("why", "steps")]
        words = [", ".join(f"{x:g}" if isinstance(x, float) else f"`{x}`" for x in some) for some in lists]
        if rule.get("steps"):
            words.append(f"at steps of {', '.join(f'{x:g}' for x in rule['steps'])} s")
        sentences.append(f"**Left out:** {' '.join(words)}, because {rule['why']}.")
    return sentences
