"""Content of a report section, for Markdown and for the site: sentences, lists, tables and figures, and the format of numbers.

The layout of tables is data: `layouts.toml` gives for each column its head, its number format and its key in a row. Formats are
fixed, so that two reports differ in a line only if a number differs.
"""

import math
import tomllib
import zlib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from gauss_bench.report.rows import Row, chose_steps, group_by, has_ended, is_known, number

NOTHING = "-"
UNMEASURED = "not measured"  # the reason for a dash that has no other
AUTHORS = (
    "This report compares ways to compute the motion of closed-loop planar linkages: the suite's own formulations, and other "
    "engines through adapters. All read the same file and start from the same state. **The authors of the suite also wrote the "
    "`gauss` formulation.** It passes through the same gate, clock and tables as every other engine, and rows in which it loses "
    "are printed like those in which it wins."
)
TONES = {
    **dict.fromkeys(("holds", "pass", "ok"), "good"),
    **dict.fromkeys(("open", "not shown", "degraded", "misprint", "loose", "skip", "control"), "warn"),
    **dict.fromkeys(("reversed", "refuted", "failed", "wrong", "not valid"), "bad"),
}
ASIDE = ("text", "engine", "formula", "verdict", "remark", "status")  # kinds of cells whose columns are aligned as text


@dataclass(frozen=True)
class Cell:
    """One entry of a table.

    Attributes:
        sort: sort key in the browser; numbers come before text.
        tone: "", "engine", "below", "bad", "warn", "good", or "formula", which a page typesets.
        why: for a cell with NOTHING, the reason for which it has no value.
    """

    text: str
    sort: float | str = ""
    tone: str = ""
    why: str = ""


@dataclass(frozen=True)
class Table:
    """Rows of cells under a head.

    Attributes:
        title: the line above the table.
        numeric: indices of right-aligned columns.
        folded: whether a page hides the table until it is opened.
        note: explains abbreviations.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    numeric: Collection[int] = ()
    folded: bool = False
    note: str = ""
    kind = "table"


@dataclass(frozen=True)
class Text:
    """A paragraph with `code` and **strong** as its only markup."""

    text: str
    kind = "text"


@dataclass(frozen=True)
class Bullets:
    """A list of sentences."""

    items: Sequence[str]
    kind = "bullets"


@dataclass(frozen=True)
class Finding:
    """Sentences computed from rows, with a title.

    Attributes:
        tone: "good", "bad", "warn" or "".
        short: the finding in one sentence, if `text` lists more; the tables have the rest.
        behind: the rows from which it was computed, with the same numbers.
    """

    title: str
    text: str
    tone: str = ""
    short: str = ""
    behind: Sequence[Table] = ()

    @property
    def anchor(self) -> str:
        """The id of the finding on its page."""
        return f"finding-{zlib.crc32(self.text.encode()):08x}"


@dataclass(frozen=True)
class Chart:
    """A figure with its data.

    Attributes:
        description: one sentence about its content.
        spec: Vega-Lite specification, without data.
        head: column of `rows` -> heading in the table of its numbers.
        toggles: engines that a reader may hide and show.
        shown: engines that are visible at first.
        listed: rows of the table of its numbers, if it does not have all.
        note: below that table.
    """

    name: str
    title: str
    description: str
    spec: Mapping[str, Any]
    rows: Sequence[Mapping[str, Any]]
    head: Mapping[str, str]
    toggles: Sequence[str] = ()
    shown: Sequence[str] = ()
    small: bool = False
    listed: Sequence[Mapping[str, Any]] | None = None
    note: str = ""
    kind = "chart"

    def table(self) -> Table:
        """Return the drawn numbers, or some of them, as a table."""
        numeric = {c for c in self.head if any(isinstance(row.get(c), (int, float)) for row in self.rows)}
        columns = [(words, ".4g" if c in numeric else "text", c) for c, words in self.head.items()]
        return make_table(f"{self.title}: numbers", columns, self.rows if self.listed is None else self.listed, note=self.note)

    def data(self) -> dict[str, Any]:
        """Return the data from which the page draws the figure."""
        return {"spec": self.spec, "lines": pack(self.rows), "shown": list(self.shown)}


Block = Text | Bullets | Table | Chart


@dataclass(frozen=True)
class Section:
    """A title with blocks and subsections."""

    title: str
    anchor: str
    blocks: Sequence[Block] = ()
    parts: Sequence["Section"] = ()


def pack(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Compress rows for a page: consecutive rows that differ in numbers alone share one entry with columns of numbers."""
    lines: list[dict[str, Any]] = []
    for row in rows:
        numbers = {k: to_json(x) for k, x in row.items() if isinstance(x, (int, float)) and not isinstance(x, bool)}
        same = {k: x for k, x in row.items() if k not in numbers}
        last = lines[-1] if lines else {}
        if numbers and last.get("same") == same and last["columns"].keys() == numbers.keys():
            for k, x in numbers.items():
                last["columns"][k].append(x)
        else:
            lines.append({"same": same, "columns": {k: [x] for k, x in numbers.items()}})
    return lines


def to_json(x: Any) -> Any:
    """Return a value for JSON: NaN becomes None, and numbers have five digits, as many as a figure shows."""
    if not isinstance(x, float):
        return x
    return round_digits(x, 5) if math.isfinite(x) else None


def round_digits(x: float, digits: int) -> float:
    """Round a number to significant digits; an integral result becomes an int, which prints without a point."""
    value = float(f"{x:.{digits}g}")
    return int(value) if value.is_integer() and abs(value) < 10**digits else value


def error_text(x: float) -> str:
    """Format an error with two digits."""
    return f"{x:.1e}" if is_known(x) else NOTHING


def ratio_text(x: float) -> str:
    """Format a ratio with three digits."""
    decimals = sum(x < limit for limit in (0.01, 0.1, 1, 10, 100))
    return f"{x:.{decimals}f}" if is_known(x) else NOTHING


def time_text(seconds: float) -> str:
    """Format a duration with three digits and a unit."""
    unit, factor = next(((u, f) for u, f in (("s", 1.0), ("ms", 1e3), ("µs", 1e6)) if seconds * f >= 1), ("ns", 1e9))
    return f"{ratio_text(seconds * factor)} {unit}" if is_known(seconds) else NOTHING


def limit_text(x: float) -> str:
    """Format a required accuracy with one digit."""
    return f"{x:.0e}"


def itemise(words: Iterable[str]) -> str:
    """Join words as "a, b and c"."""
    *first, last = list(words) or [""]
    return f"{', '.join(first)} and {last}" if first else last


def count(n: int, word: str) -> str:
    """Return a number with its noun, in the plural unless the number is 1."""
    return f"{n} {word}" if n == 1 else f"{n} {word}s"


def range_text(values: Sequence[float], form: Callable[[float], str] = ratio_text) -> str:
    """Format the range of some numbers as "low to high"."""
    return " to ".join(dict.fromkeys((form(min(values)), form(max(values)))))


def list_unmeasured(rows: Sequence[Row], column: str) -> str:
    """Return a sentence on the linkages without a number in a column, with their reasons; empty if there are none."""
    measured = {r.get("mechanism") for r in rows if is_known(r.get(column))}
    missing = [r for r in rows if r.get("mechanism") and r["mechanism"] not in measured]
    reasons = group_by(missing, lambda r: r.get("message") or "no reason was told")
    parts = [f"{itemise(dict.fromkeys(r['mechanism'] for r in some))} ({why})" for why, some in reasons.items()]
    return f" Left out: {'; '.join(parts)}." if parts else ""


def text_cell(value: Any, tone: str = "") -> Cell:
    """Return a cell of text that sorts by its text."""
    text = str(value) if value not in ("", None) else NOTHING
    return Cell(text, text, tone)


def print_as(form: str) -> Callable[[float], str]:
    """Return the function that formats a number: one of FORMS by its name, or a format of Python."""
    return FORMS.get(form) or (lambda x: format(x, form))


FORMS: Mapping[str, Callable[[float], str]] = {
    "error": error_text,
    "exact": lambda x: error_text(x) if x else "0",
    "times": ratio_text,
    "time": time_text,
    "percent": lambda x: f"{100 * x:.0f} %",
    "mm": lambda x: f"{1e3 * x:g}",
    "error mm": lambda x: error_text(1e3 * x),
}


def make_cell(row: Row, kind: str, key: str, bar: str = "") -> Cell:
    """Return the cell of a row's value; arguments as `_print_value`. A cell without a value has the reason for that."""
    cell = _print_value(row, kind, key, bar)
    return replace(cell, why=missing_reason(row, key)) if cell.text == NOTHING else cell


def missing_reason(row: Row, key: str) -> str:
    """Return why a row has no value in a column, in a few words.

    The reason is that of this very cell, named `why_` and the column; else that of the column, if it never depends on the outcome;
    else the row's own, named `missing`; else its status, if the case did not end; else that of the column for cases that ended.
    """
    if row.get(f"why_{key}"):
        return str(row[f"why_{key}"])
    reasons = layouts()["reasons"]
    status = row.get("status") or "ok"
    if key in reasons["always"]:
        return str(reasons["always"][key])
    if row.get("missing"):
        return str(row["missing"])
    if status not in ("ok", "invalid"):
        return str(reasons["status"].get(status, status.replace("_", " ")))
    return str(reasons["ended"].get(key, UNMEASURED))


def _print_value(row: Row, kind: str, key: str, bar: str = "") -> Cell:
    """Return the cell of a row's value, or NOTHING.

    Args:
        kind: one of ASIDE, "figure" (text in a column of numbers), "met", "step", a number format (`print_as`), or "range " with
            the format of both ends.
        key: column of the value in the row.
        bar: column of the error bar; a smaller value is printed as below it.
    """
    value = row.get(key)
    match kind.split(maxsplit=1):
        case ["text" | "figure"]:
            return text_cell(value, row.get(f"{key}_tone", ""))
        case ["verdict"]:
            return text_cell(value, row.get(f"{key}_tone", TONES.get(str(value), "")))
        case ["engine" | "formula"]:
            return text_cell(value, kind)
        case ["remark"]:
            return remark_cell(row)
        case ["status"]:
            return status_cell(row)
        case ["met"]:
            if not is_known(row.get("target")):
                return Cell(NOTHING)
            return text_cell("yes", "good") if value else text_cell("no", "bad")
        case ["step"]:
            own = key in row and (not number(row, key) > 0 or (has_ended(row) and chose_steps(row)))
            return Cell("own", 0.0) if own else make_cell(row, "g", key)
        case ["range", form]:
            low, high = number(row, f"{key}_low"), number(row, f"{key}_high")
            known = is_known(low) and is_known(high)
            return Cell(f"{print_as(form)(low)}..{print_as(form)(high)}", low) if known else Cell(NOTHING)
    x, least = number(row, key), number(row, bar)
    if abs(x) < least:
        return Cell(f"< {least:.0e}", least, "below")
    return Cell(print_as(kind)(x), x) if is_known(x) else Cell(NOTHING)


def status_cell(row: Row) -> Cell:
    """Return the cell with the status of a case; an ended case shows whether it is valid."""
    status = row["status"]
    if has_ended(row):
        status = "control" if row["control"] else "ok" if row["valid"] else "not valid"
    return text_cell(status, TONES.get(status, "bad"))


def remark_cell(row: Row) -> Cell:
    """Return the cell with a row's message; a row that failed or was skipped names its status first."""
    status, message = row.get("status") or "ok", row.get("message", "")
    return text_cell(message) if status == "ok" else text_cell(f"{status}: {message}", "warn" if status == "skip" else "bad")


@cache
def layouts() -> dict[str, Any]:
    """Return `layouts.toml`: name of a table -> title, columns, and optional introduction, note and folding."""
    return tomllib.loads(Path(__file__).with_name("layouts.toml").read_text(encoding="utf-8"))


def make_table(title: str, columns: Sequence[Sequence[str]], rows: Iterable[Row], folded: bool = False, note: str = "") -> Table:
    """Return a table from columns as `layouts.toml` has them: (head, kind of its cells, key, optional key of the error bar)."""
    lines = [[make_cell(row, *column[1:]) for column in columns] for row in rows]
    numeric = [i for i, (_, kind, *_) in enumerate(columns) if kind not in ASIDE]
    return Table(title, [column[0] for column in columns], lines, numeric, folded, note)


def lay_out(name: str, rows: Iterable[Row], /, title: str = "", note: str = "", **more: Any) -> Table:
    """Return the table of rows with a layout; `more` fills {names} in its title and head, or overrides `folded`."""
    layout = layouts()[name]
    folded = more.pop("folded", layout.get("folded", False))
    columns = [(head.format(**more), *cell) for head, *cell in layout["columns"]]
    note = note or layouts()["notes"].get(layout.get("note"), layout.get("note", ""))
    return make_table(title or layout["title"].format(**more), columns, rows, folded, note)


def blocks_of(name: str, rows: Sequence[Row], /, **more: Any) -> list[Block]:
    """Return the introduction of a table and the table; without rows the layout's sentence for that, or nothing."""
    layout = layouts()[name]
    if not rows:
        return [Text(layout["empty"])] if "empty" in layout else []
    words = [Text(layout["words"])] if "words" in layout else []
    return [*words, lay_out(name, rows, **more)]
