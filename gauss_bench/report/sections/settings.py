"""Every engine's version and settings, in full."""

from collections.abc import Iterator

from gauss_bench.report.content import Section, blocks_of
from gauss_bench.report.rows import Row, Run

PLACE = 100


def section(run: Run) -> Section:
    """Return the table of all options that an adapter sets."""
    return Section("Settings", "settings", blocks_of("settings", list(list_options(run))))


def list_options(run: Run, only: str = "") -> Iterator[Row]:
    """Yield a row for each option of each setting of each engine, or of one engine."""
    engines = run.environment.get("engines", {})
    for name, engine in sorted((k, x) for k, x in engines.items() if only in ("", k)):
        place = {"engine": name, "version": engine.get("version", "")}
        for label, options in sorted(engine.get("settings", {}).items()):
            for option, value in sorted(options.items()) or [("", "no options")]:
                text = value if isinstance(value, str) else repr(value)
                yield place | {"settings": label, "option": option, "value": text}
