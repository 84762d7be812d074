"""The date and machine of a run, and the versions of its packages."""

from gauss_bench.report.content import Section, blocks_of
from gauss_bench.report.rows import Run

PLACE = 110
FACTS = ("suite", "hours", "date", "commit", "dirty", "python", "platform", "cpu", "cores", "threads", "blas", "baseline_engine")


def section(run: Run) -> Section:
    """Return the section with the table of facts and versions."""
    facts = {name.replace("_", " "): _print_fact(name, run.environment.get(name)) for name in FACTS}
    facts |= dict(sorted(run.environment.get("versions", {}).items()))
    for name, engine in sorted(run.environment.get("engines", {}).items()):
        if where := engine.get("environment"):
            facts[name] = f"{engine['version']}, in an environment of its own: {where}"
    rows = [{"what": name, "value": value} for name, value in facts.items() if value is not None]
    return Section("Environment", "environment", blocks_of("environment", rows))


def _print_fact(name: str, value: object) -> object:
    """Return a fact as it is printed: a truth value becomes yes or no."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return value
