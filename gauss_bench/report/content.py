"""Parts of a section, the same for the forge and for the browser: sentences, lists, tables, pictures; and how numbers print.

Number formats are fixed, so that two runs differ in a line only where a number does.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from gauss_bench.report.rows import KEYS, Row, group_rows, is_known, label, number, ok, own_steps

NOTHING = "-"
RANGE = "range"
NOTE = (
    "Times are lower quartiles of interleaved rounds, and the median of the processes that raced; a range is where a second race "
    "of as many processes falls, or, in one process alone, that from the 5 to the 95 percent point of the rounds."
)
BELOW_LEGEND = "`< x` means below x, the reference's own error bar or the floor of rounded parameters: it cannot be told from 0."
AUTHORS = (
    "This report compares ways to compute the motion of closed-loop planar linkages: formulations of the suite's own, and other "
    "engines through adapters, all from the same file and the same start. **The authors of the suite also wrote the `gauss` "
    "formulation it compares**; it passes through the same gate, the same clock and the same tables as every other row, and the "
    "rows where it loses are printed like those where it wins."
)


@dataclass(frozen=True)
class Cell:
    """One entry of a table.

    Attributes:
        sort: what the browser sorts by; numbers before text.
        tone: "", "engine", "below", "bad", "warn", "good", or "formula", which a page typesets.
    """

    text: str
    sort: float | str = ""
    tone: str = ""


@dataclass(frozen=True)
class Table:
    """Rows of cells under a head.

    Attributes:
        title: one line above, which also anchors a diff.
        numeric: indices of right-aligned columns.
        folded: whether the forge's page hides it until asked.
        note: what abbreviations mean.
    """

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    numeric: frozenset[int] = frozenset()
    folded: bool = False
    note: str = ""
    kind: Literal["table"] = "table"


@dataclass(frozen=True)
class Text:
    """A paragraph; `code` and **strong** are understood."""

    text: str
    kind: Literal["text"] = "text"


@dataclass(frozen=True)
class Bullets:
    """A list of sentences."""

    items: tuple[str, ...]
    kind: Literal["bullets"] = "bullets"


@dataclass(frozen=True)
class Finding:
    """A sentence computed from rows, under a few words; tone: "good", "bad", "warn" or ""."""

    title: str
    text: str
    tone: str = ""


@dataclass(frozen=True)
class Findings:
    """The findings of a run, sentence by sentence."""

    items: tuple[Finding, ...]
    kind: Literal["findings"] = "findings"


@dataclass(frozen=True)
class Chart:
    """A figure: what it is called, what it shows in a sentence, how it is drawn and of which rows.

    Attributes:
        head: column of `rows` -> heading of the table of its numbers.
        toggles: values of the column `engine` that a reader may take away and bring back; none where that has no sense.
        shown: those of them that are there at first.
    """

    name: str
    title: str
    description: str
    spec: Mapping[str, Any]
    rows: tuple[Mapping[str, Any], ...]
    head: Mapping[str, str]
    toggles: tuple[str, ...] = ()
    shown: tuple[str, ...] = ()
    small: bool = False
    kind: Literal["chart"] = "chart"

    def table(self) -> Table:
        """The numbers that are drawn."""
        rows = tuple(tuple(_figure(row.get(column)) for column in self.head) for row in self.rows)
        numeric = {i for i, c in enumerate(self.head) if any(isinstance(row.get(c), (int, float)) for row in self.rows)}
        return Table(f"{self.title}: numbers", tuple(self.head.values()), rows, frozenset(numeric))

    def data(self) -> dict[str, Any]:
        """The data that the page draws."""
        return {"spec": self.spec, "lines": pack(self.rows), "shown": list(self.shown)}


def pack(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows as a page keeps them: of rows in sequence that differ in numbers alone, what is the same, and each number's column."""
    lines: list[dict[str, Any]] = []
    for row in rows:
        numbers = {k: seen(x) for k, x in row.items() if isinstance(x, (int, float)) and not isinstance(x, bool)}
        same = {k: x for k, x in row.items() if k not in numbers}
        last = lines[-1] if lines else {}
        if numbers and last.get("same") == same and last["columns"].keys() == numbers.keys():
            for k, x in numbers.items():
                last["columns"][k].append(x)
        else:
            lines.append({"same": same, "columns": {k: [x] for k, x in numbers.items()}})
    return lines


def seen(x: Any) -> Any:
    """A value as JSON has it: no NaN, and digits that can be seen."""
    if isinstance(x, bool) or not isinstance(x, float):
        return x
    return short(x, 5) if math.isfinite(x) else None


def short(x: float, digits: int) -> float:
    """A number in few digits; a whole one is written without a point."""
    value = float(f"{x:.{digits}g}")
    return int(value) if value.is_integer() and abs(value) < 10**digits else value


def _figure(x: Any) -> Cell:
    if isinstance(x, bool):
        return Cell("yes" if x else "no")
    if isinstance(x, (int, float)):
        return Cell(f"{x:.4g}", float(x)) if is_known(x) else Cell(NOTHING)
    return Cell(str(x) if x not in ("", None) else NOTHING, str(x or ""))


Block = Text | Bullets | Table | Findings | Chart


@dataclass(frozen=True)
class Section:
    """A title with its blocks and, for a linkage, sections below it."""

    title: str
    anchor: str
    blocks: tuple[Block, ...] = ()
    parts: tuple["Section", ...] = field(default=())


Line = Callable[[Row], tuple[Cell, ...]]


def error(x: float) -> str:
    """Two digits of an error."""
    return f"{x:.1e}" if is_known(x) else NOTHING


def times(x: float) -> str:
    """A ratio with three digits."""
    if not is_known(x):
        return NOTHING
    decimals = next((n for limit, n in ((0.01, 5), (0.1, 4), (1, 3), (10, 2), (100, 1)) if x < limit), 0)
    return f"{x:.{decimals}f}"


def microseconds(seconds: float) -> str:
    if not is_known(seconds):
        return NOTHING
    x = 1e6 * seconds
    return f"{x:.2f}" if x < 10 else f"{x:.1f}" if x < 100 else f"{x:.0f}"


def itemise(words: Iterable[str]) -> str:
    """a, b and c."""
    parts = list(words)
    return " and ".join([", ".join(parts[:-1]), parts[-1]]) if len(parts) > 1 else "".join(parts)


def count(n: int, word: str) -> str:
    return f"{n} {word}" if n == 1 else f"{n} {word}s"


def text_cell(value: Any, tone: str = "") -> Cell:
    text = str(value) if value not in ("", None) else NOTHING
    return Cell(text, text, tone)


def engine_cell(row: Row) -> Cell:
    return text_cell(row["engine"], "engine")


def error_cell(row: Row, column: str, bar: float = 0.0) -> Cell:
    """An error, or the reference's error bar where it is below that."""
    x, limit = number(row, column), bar
    if not is_known(x):
        return Cell(NOTHING)
    if abs(x) < limit:
        return Cell(f"< {limit:.0e}", limit, "below")
    return Cell(error(x), x)


def ratio_cells(row: Row, name: str) -> tuple[Cell, Cell]:
    """A ratio and its spread low..high."""
    x, low, high = (number(row, f"{name}{end}") for end in ("", "_low", "_high"))
    spread = f"{times(low)}..{times(high)}" if is_known(low) and is_known(high) else NOTHING
    return Cell(times(x), x if is_known(x) else ""), Cell(spread, low if is_known(low) else "")


def time_cell(row: Row, column: str) -> Cell:
    x = number(row, column)
    return Cell(microseconds(x), x if is_known(x) else "")


def step_cell(row: Row) -> Cell:
    """The step [s], or that the integrator chose it."""
    step = number(row, "step")
    return Cell("own", 0.0) if (ok(row) and own_steps(row)) or not step > 0 else Cell(f"{step:g}", step)


def status_cell(row: Row) -> Cell:
    """A cell with the end of a case, and whether it may count."""
    if row["status"] == "skip":
        return Cell("skip", "skip", "warn")
    if row["status"] not in ("ok", "invalid"):
        return Cell(row["status"], row["status"], "bad")
    if row["control"]:
        return Cell("control", "control", "warn")
    return Cell("ok", "ok", "good") if row["valid"] else Cell("not valid", "not valid", "bad")


def columns(head: Sequence[str], first_numeric: int, last_text: int = 0) -> tuple[tuple[str, ...], frozenset[int]]:
    """Head and the indices of its numeric columns: from `first_numeric` up to the last `last_text` columns."""
    return tuple(head), frozenset(range(first_numeric, len(head) - last_text))


def exact_cell(row: Row, column: str) -> Cell:
    """An error, which may be zero."""
    return Cell("0", 0.0) if number(row, column) == 0 else error_cell(row, column)


def texts(row: Row, *keys: str) -> tuple[Cell, ...]:
    return tuple(text_cell(row.get(key, "")) for key in keys)


def counts(row: Row, *keys: str) -> tuple[Cell, ...]:
    """Whole numbers, and others as short as they are."""
    return tuple(Cell(f"{number(row, key):g}", number(row, key)) if is_known(row.get(key)) else Cell("-") for key in keys)


def duration(seconds: float) -> str:
    """Three digits with a unit."""
    unit, factor = next(((u, f) for u, f in (("s", 1.0), ("ms", 1e3), ("µs", 1e6)) if seconds * f >= 1), ("ns", 1e9))
    return f"{times(seconds * factor)} {unit}" if is_known(seconds) else "-"


def time_of(row: Row, column: str = "seconds") -> Cell:
    x = number(row, column)
    return Cell(duration(x), x if is_known(x) else "")


def span(row: Row, low: str = "seconds_low", high: str = "seconds_high") -> Cell:
    a, b = number(row, low), number(row, high)
    return Cell(f"{duration(a)}..{duration(b)}", a) if is_known(a) and is_known(b) else Cell("-")


def goal(row: Row, written: Callable[[float], str] = times) -> tuple[Cell, Cell]:
    """A target and whether it is met; nothing where there is none."""
    x = number(row, "target")
    if not is_known(x):
        return Cell("-"), Cell("-")
    return Cell(written(x), x), Cell("yes", "yes", "good") if row.get("met") else Cell("no", "no", "bad")


def small(x: float) -> str:
    return f"{x:.0e}"


def remark(row: Row) -> Cell:
    status = str(row.get("status", "ok") or "ok")
    message = str(row.get("message", ""))
    return text_cell(message) if status == "ok" else text_cell(f"{status}: {message}", "warn" if status == "skip" else "bad")


def table_with_title(
    title: str, head: tuple[str, ...], first: int, rows: Sequence[Row], line: Line, last_text: int = 1, folded: bool = False
) -> Table:
    """A table of lines, numbers from column `first` on, the last `last_text` columns text again."""
    names, numeric = columns(head, first, last_text)
    note = NOTE if {"spread", RANGE} & set(head) else ""
    return Table(title, names, tuple(line(row) for row in rows), numeric, folded, note)


def part(
    title: str, words: str, rows: Sequence[Row], head: tuple[str, ...], first: int, line: Line, shown: Sequence[Row] | None = None
) -> Section | None:
    """A section of a table; where only some rows are `shown`, another one, folded, has all of them."""
    if not rows:
        return None
    blocks: list[Block] = [Text(words), table_with_title(title, head, first, rows if shown is None else shown, line)]
    if shown is not None and len(shown) < len(rows):
        blocks.append(table_with_title(f"{title}: all of it", head, first, rows, line, folded=True))
    return Section(title, f"kernel-{title.lower().replace(' ', '-')}", tuple(blocks))


def list_unmeasured(rows: Sequence[Row], column: str) -> str:
    """A sentence about the linkages that a figure leaves out, each with its reason; nothing where it leaves out none."""
    told = {str(r["mechanism"]) for r in rows if is_known(r.get(column))}
    missing = [r for r in rows if r.get("mechanism") and str(r["mechanism"]) not in told]
    reasons = group_rows(missing, lambda r: str(r.get("message") or "no reason was told"))
    said = [f"{itemise(dict.fromkeys(str(r['mechanism']) for r in some))} ({why})" for why, some in reasons.items()]
    return f" Left out: {'; '.join(said)}." if said else ""


def run_of_numbers(values: Sequence[float]) -> str:
    low, high = times(min(values)), times(max(values))
    return low if low == high else f"{low} to {high}"


def tie(rows: list[Row], best: Row, value: Callable[[Row], float]) -> str:
    """A case in words, with the engines that come within 5 percent of it by the same choices."""
    same = [r for r in rows if all(str(r[k]) == str(best[k]) for k in KEYS if k != "engine")]
    engines = sorted({r["engine"] for r in same if abs(value(r) - value(best)) <= 0.05 * abs(value(best))})
    choices = label(best, "settings", "integrator", "stabilization", "step").partition("` ")[2]
    return f"{itemise(f'`{name}`' for name in engines)} {choices}".strip()
