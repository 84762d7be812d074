"""The changes between releases of each engine's library."""

from gauss_bench.report.content import Block, Bullets, Section, Text, blocks_of
from gauss_bench.report.rows import Row, Run, group_by, with_number
from gauss_bench.report.what_changed import NAMES, RULE, describe_changes, describe_unusable, newest_first

PLACE = 85
# reasons for missing values of a row, by the keys that `content.missing_reason` reads
NO_VALUE = {"missing": "no earlier release to compare with", "why_message": "no question failed"}
NO_TIME = {"missing": "one of the two was not timed", "why_verdict": "others are compared with this release"}
TITLE, ANCHOR = "What changed between releases", "releases"


def section(run: Run) -> Section | None:
    """Return the section with a subsection for each engine, or None if the run compared no releases."""
    rows = run.table("releases")
    if not rows:
        return None
    parts = [engine_section(run, engine, list(releases)) for engine, releases in group_by(rows, "engine").items()]
    return Section(TITLE, ANCHOR, (Text(RULE),), parts)


def engine_section(run: Run, engine: str, releases: list[Row]) -> Section:
    """Return the subsection of an engine: sentences on what changed, the newest release first, and the tables behind them."""
    ordered = newest_first(releases)
    # `describe_changes` takes and returns the oldest release first
    tables = {name: [row for row in run.table(name) if row["engine"] == engine] for name in NAMES} | {"releases": ordered[::-1]}
    blocks: list[Block] = []
    for heading, sentences in reversed(describe_changes(tables)):
        blocks += [Text(f"**{heading}**"), Bullets(sentences)]
    if unusable := describe_unusable(ordered):
        blocks += [Text("**without results**"), Bullets(unusable)]
    blocks += blocks_of("releases", [{**row, **NO_VALUE} for row in ordered], engine=engine)
    blocks += blocks_of("release_changes", with_number(tables["release_changes"], "difference"), engine=engine)
    blocks += blocks_of("release_costs", [{**row, **NO_TIME} for row in tables["release_costs"]], engine=engine)
    return Section(engine, f"{ANCHOR}-{engine}", blocks)
