"""Every engine's version and settings, in full."""

from gauss_bench.report.content import Section, Table, Text, columns, text_cell
from gauss_bench.report.rows import Run

PLACE = 100
TABLES = ()


def section(run: Run) -> Section:
    head, numeric = columns(("engine", "version", "settings", "option", "value"), 5)
    lines = []
    for name, engine in sorted(run.environment.get("engines", {}).items()):
        for label, options in sorted(engine.get("settings", {}).items()):
            for option, value in sorted(options.items()) or [("", "no options")]:
                start = (text_cell(name, "engine"), text_cell(engine.get("version", "")), text_cell(label))
                lines.append((*start, text_cell(option), text_cell(value if isinstance(value, str) else repr(value))))
    if not lines:
        return Section("Settings", "settings", (Text("The run recorded no settings."),))
    words = "All options an adapter sets; everything else is the engine's own default in the version printed."
    return Section("Settings", "settings", (Text(words), Table("Settings of every engine", head, tuple(lines), numeric)))
