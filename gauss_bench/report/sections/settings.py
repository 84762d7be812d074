"""The version and all settings of every engine."""

from collections.abc import Iterator

from gauss_bench.report.content import Section, blocks_of
from gauss_bench.report.rows import Row, Run

PLACE = 100


def section(run: Run) -> Section:
    """Return the section with the table of all options that adapters set."""
    return Section("Settings", "settings", blocks_of("settings", list(list_options(run))))


def list_options(run: Run, only: str = "") -> Iterator[Row]:
    """Yield a row for each option of each setting of each engine, or of the engine `only` if it is named."""
    for name, engine in sorted(run.environment.get("engines", {}).items()):
        if only not in ("", name):
            continue
        place = {"engine": name, "version": engine.get("version", "")}
        for label, options in sorted(engine.get("settings", {}).items()):
            for option, value in sorted(options.items()) or [("", "no options")]:
                text = value if isinstance(value, str) else repr(value)
                yield place | {"settings": label, "option": option, "value": text}
