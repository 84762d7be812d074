"""Content of a report section for Markdown and for the site: sentences, lists, tables and figures.

`layouts.toml` defines each column of a printed table: its heading, the kind of its cells, and the column of the stored rows whose
values the cells print.
"""

import math
import tomllib
import zlib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from gauss_bench.report.cases import chose_steps, has_ended
from gauss_bench.report.rows import Row, is_known, number
from gauss_bench.report.words import NOTHING, error_text, ratio_text, round_digits, time_text

UNMEASURED = "not measured"  # reason for a dash if no other is known
TONES = {  # text of a verdict or status -> tone (colour) of its cell; "control" is a case that is wrong on purpose
    **dict.fromkeys(("holds", "pass", "ok"), "good"),
    **dict.fromkeys(("open", "not shown", "degraded", "misprint", "loose", "skip", "control"), "warn"),
    **dict.fromkeys(("reversed", "refuted", "failed", "wrong", "not valid"), "bad"),
}
TEXT_KINDS = ("text", "engine", "formula", "verdict", "remark", "status")  # kinds of cells that are aligned left


@dataclass(frozen=True)
class Cell:
    """One entry of a table.

    Attributes:
        sort: sort key in the browser, where numbers come before text.
        tone: "", "engine", "below", "bad", "warn" or "good", which set the colour, or "formula", which a page typesets.
        why: the reason why the cell has no value, if its text is NOTHING.
    """

    text: str
    sort: float | str = ""
    tone: str = ""
    why: str = ""


@dataclass(frozen=True)
class Table:
    """Rows of cells under a head.

    Attributes:
        numeric: indices of the columns of numbers, which are aligned right.
        folded: whether a page hides the table until a reader opens it.
        note: sentences below the table.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    numeric: Collection[int] = ()
    folded: bool = False
    note: str = ""
    kind = "table"  # from this name a template knows how to print the block


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
    """A title and sentences, which are computed from the rows of a run's tables.

    Attributes:
        tone: "good", "bad", "warn" or "".
        short: the finding in one sentence, for pages that show `behind`; if empty, the first sentence of `text` takes its place.
        behind: tables of the rows from which the sentences were computed.
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
        spec: Vega-Lite specification of the figure, without data.
        head: column of `rows` -> heading of this column in the table of numbers below the figure.
        toggles: engines that a reader may hide and show.
        shown: engines that are visible at first; by default all of them.
        small: whether the figure is drawn in a card (a framed box) of the first page.
        listed: rows of the table of numbers; None for all of `rows`.
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
        """Return the table of numbers below the figure."""
        numeric = {c for c in self.head if any(isinstance(row.get(c), (int, float)) for row in self.rows)}
        columns = [(words, ".4g" if c in numeric else "text", c) for c, words in self.head.items()]
        rows = self.rows if self.listed is None else self.listed
        return make_table(f"{self.title}: numbers", columns, rows, note=self.note)

    def data(self) -> dict[str, Any]:
        """Return the data from which a script of the page draws the figure."""
        return {"spec": self.spec, "lines": pack_rows(self.rows), "shown": list(self.shown or self.toggles)}


Block = Text | Bullets | Table | Chart


@dataclass(frozen=True)
class Section:
    """A title with blocks and subsections."""

    title: str
    anchor: str
    blocks: Sequence[Block] = ()
    parts: Sequence["Section"] = ()


def pack_rows(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Compress rows for a page: consecutive rows that differ only in numbers share one entry.

    Returns:
        A list of entries. Each entry is a dictionary with the key "same", the values that all rows of the entry share, and the key
        "columns", which maps the name of a column to its numbers, one for each row.
    """
    entries: list[dict[str, Any]] = []
    for row in rows:
        numbers = {k: to_json(x) for k, x in row.items() if isinstance(x, (int, float)) and not isinstance(x, bool)}
        same = {k: x for k, x in row.items() if k not in numbers}
        last = entries[-1] if entries else {}
        if numbers and last.get("same") == same and last["columns"].keys() == numbers.keys():
            for column, x in numbers.items():
                last["columns"][column].append(x)
        else:
            entries.append({"same": same, "columns": {column: [x] for column, x in numbers.items()}})
    return entries


def to_json(x: Any) -> Any:
    """Return a value for JSON: a float is rounded to five significant digits, or None if it is not finite."""
    if not isinstance(x, float):
        return x
    return round_digits(x, 5) if math.isfinite(x) else None


def text_cell(value: Any, tone: str = "") -> Cell:
    """Return a cell of text that sorts by its text."""
    text = str(value) if value not in ("", None) else NOTHING
    return Cell(text, text, tone)


def print_as(form: str) -> Callable[[float], str]:
    """Return the function that formats a number.

    Args:
        form: a name in FORMS, or a format of Python such as ".3g".
    """
    return FORMS.get(form) or (lambda x: format(x, form))


FORMS: Mapping[str, Callable[[float], str]] = {  # name of a number format in `layouts.toml` -> function that formats a number
    "error": error_text,
    "exact": lambda x: error_text(x) if x else "0",  # an error that can be exactly zero
    "times": ratio_text,
    "time": time_text,
    "percent": lambda x: f"{100 * x:.0f} %",
    "mm": lambda x: f"{1e3 * x:g}",
    "error mm": lambda x: error_text(1e3 * x),
}


def make_cell(row: Row, kind: str, key: str, bar: str = "") -> Cell:
    """Return the cell of a row's value, with the reason if it is missing; arguments as in `_value_cell`."""
    cell = _value_cell(row, kind, key, bar)
    return replace(cell, why=missing_reason(row, key)) if cell.text == NOTHING else cell


def missing_reason(row: Row, key: str) -> str:
    """Return why a row has no value in the column `key`, in a few words.

    The answer is the first of these reasons that exists:
    1. the row's entry `why_` + `key`, a reason for this cell alone;
    2. the reason for this column in `[reasons.always]` of `layouts.toml`;
    3. the row's entry `missing`, a reason for all cells of the row;
    4. the row's status, if the case did not end;
    5. the reason for this column in `[reasons.ended]` of `layouts.toml`, for cases that ended.
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


def _value_cell(row: Row, kind: str, key: str, bar: str = "") -> Cell:
    """Return the cell that shows a value of a row; the text of the cell is NOTHING if the value is missing.

    Args:
        kind: how the value is printed: one of TEXT_KINDS, "figure" (text in a column of numbers), "met" (yes or no: whether a
            target is met), "step" (a step size, or "own" if the integrator chose its steps), a number format (`print_as`), or
            "range " followed by the number format of both ends.
        key: column of the value. The column `key` + "_tone" may hold the tone (colour) of the cell.
        bar: column of the value's error bar, empty if there is none; a value below its error bar is printed as "< " and the bar.
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
            status, message = row.get("status") or "ok", row.get("message", "")
            if status == "ok":
                return text_cell(message)
            return text_cell(f"{status}: {message}", "warn" if status == "skip" else "bad")
        case ["status"]:
            return status_cell(row)
        case ["met"]:
            if not is_known(row.get("target")):
                return Cell(NOTHING)
            return text_cell("yes", "good") if value else text_cell("no", "bad")
        case ["step"]:
            # the integrator chose its steps if the row has no positive step, or if the number of steps does not match the step
            is_fixed = number(row, key) > 0 and not (has_ended(row) and chose_steps(row))
            return make_cell(row, "g", key) if is_fixed or key not in row else Cell("own", 0.0)
        case ["range", form]:
            low, high = number(row, f"{key}_low"), number(row, f"{key}_high")
            if not (is_known(low) and is_known(high)):
                return Cell(NOTHING)
            printed = print_as(form)
            return Cell(f"{printed(low)}..{printed(high)}", low)
    x, error_bar = number(row, key), number(row, bar)
    if abs(x) < error_bar:
        return Cell(f"< {error_bar:.0e}", error_bar, "below")
    return Cell(print_as(kind)(x), x) if is_known(x) else Cell(NOTHING)


def status_cell(row: Row) -> Cell:
    """Return the cell with the status of a case; an ended case is "ok", "not valid" or a negative "control"."""
    status = row["status"]
    if has_ended(row):
        status = "ok" if row["valid"] else "not valid"
        if row["control"]:
            status = "control"
    return text_cell(status, TONES.get(status, "bad"))


@cache
def layouts() -> dict[str, Any]:
    """Return `layouts.toml`: name of a table -> `title` and `columns`; optionally `words` (an introduction), `note` and `folded`.

    `empty` is the text for a table without rows. `texts` and `notes` have sentences by name; `missing_reason` describes `reasons`.
    """
    return tomllib.loads(Path(__file__).with_name("layouts.toml").read_text(encoding="utf-8"))


def make_table(title: str, columns: Sequence[Sequence[str]], rows: Iterable[Row], folded: bool = False, note: str = "") -> Table:
    """Return the table of rows.

    Args:
        columns: (head, kind of the cells, column of the rows, optionally the column of the error bar), as in `layouts.toml`.
    """
    lines = [[make_cell(row, *column[1:]) for column in columns] for row in rows]
    numeric = [i for i, (_, kind, *_) in enumerate(columns) if kind not in TEXT_KINDS]
    return Table(title, [column[0] for column in columns], lines, numeric, folded, note)


def lay_out(name: str, rows: Iterable[Row], /, title: str = "", note: str = "", **more: Any) -> Table:
    """Return the table of rows with the layout `name` of `layouts.toml`.

    Args:
        title, note: replace those of the layout if they are not empty.
        more: values of the {names} in the layout's title and heads; `folded` replaces the layout's.
    """
    layout = layouts()[name]
    folded = more.pop("folded", layout.get("folded", False))
    columns = [(head.format(**more), *cell) for head, *cell in layout["columns"]]
    own_note = layout.get("note", "")  # a text, or a key of the texts in `notes`
    note = note or layouts()["notes"].get(own_note, own_note)
    return make_table(title or layout["title"].format(**more), columns, rows, folded, note)


def blocks_of(name: str, rows: Sequence[Row], /, **more: Any) -> list[Block]:
    """Return introduction and table of the layout `name`; without rows, its text `empty` alone, or nothing if it has none."""
    layout = layouts()[name]
    if not rows:
        return [Text(layout["empty"])] if "empty" in layout else []
    words = [Text(layout["words"])] if "words" in layout else []
    return [*words, lay_out(name, rows, **more)]
