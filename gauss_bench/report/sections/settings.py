"""Every engine's version and settings, in full."""

from collections.abc import Iterator

from gauss_bench.report.content import Section, Text, blocks_of
from gauss_bench.report.rows import Row, Run

PLACE = 100
TABLES = ()


def section(run: Run) -> Section:
    return Section(
        "Settings", "settings", tuple(blocks_of("settings", list(options(run)))) or (Text("The run recorded no settings."),)
    )


def options(run: Run) -> Iterator[Row]:
    """A row for each option of each setting of each engine."""
    for name, engine in sorted(run.environment.get("engines", {}).items()):
        for label, given in sorted(engine.get("settings", {}).items()):
            for option, value in sorted(given.items()) or [("", "no options")]:
                said = value if isinstance(value, str) else repr(value)
                yield {"engine": name, "version": engine.get("version", ""), "settings": label, "option": option, "value": said}
