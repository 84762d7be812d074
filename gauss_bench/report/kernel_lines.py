"""Rows of the kernel suite as lines of tables."""

from collections.abc import Callable, Sequence

from gauss_bench.report.content import Cell, Table, columns, error_cell, ratio_cells, text_cell, times
from gauss_bench.report.rows import Row, known, number

Line = Callable[[Row], tuple[Cell, ...]]

RANGE = "5..95 %"
NOTE = "Times are lower quartiles of interleaved rounds; a spread is the range from the 5 to the 95 percent point."
VERDICTS = {"holds": "good", "open": "warn", "reversed": "bad"}
BUILDING = ("generate_seconds", "compile_seconds")


def table(
    title: str, head: tuple[str, ...], first: int, rows: Sequence[Row], line: Line, last_text: int = 1, folded: bool = False
) -> Table:
    """A table of lines, numbers from column `first` on, the last `last_text` columns text again."""
    names, numeric = columns(head, first, last_text)
    note = NOTE if {"spread", RANGE} & set(head) else ""
    return Table(title, names, tuple(line(row) for row in rows), numeric, folded, note)


def claimed(row: Row) -> tuple[Cell, ...]:
    """Both formulations of a linkage."""
    kinds = ("operations", "divisions", "critical")
    costs = counts(row, *(f"{kind}_{x}" for kind in kinds for x in ("gauss", "lagrange")))
    ratios = (cell for name in ("ratio", "batch_ratio", "numpy_ratio") for cell in ratio_cells(row, name))
    found = str(row.get("verdict", "")) or remark(row).text
    return (
        *texts(row, "mechanism"),
        *counts(row, "n", "rows", "unknowns_gauss", "unknowns_lagrange"),
        *costs,
        time_of(row),
        time_of(row, "rival_seconds"),
        *ratios,
        text_cell(found, VERDICTS.get(found, "bad")),
    )


def stepped(row: Row) -> tuple[Cell, ...]:
    names = texts(row, "mechanism", "formulation", "stabilization", "settings")
    times_of = (time_of(row), span(row), time_of(row, "rival_seconds"))
    return (*names, *times_of, *ratio_cells(row, "ratio"), *goal(row), remark(row))


def solved(row: Row) -> tuple[Cell, ...]:
    """A way to a solution, or how near it came."""
    names = texts(row, "settings", "integrator", "stabilization")
    within = Cell(small(number(row, "accuracy")), number(row, "accuracy"))
    reached = (
        Cell(f"{number(row, 'step'):.3g}", number(row, "step")) if known(row.get("step")) else Cell("-"),
        error_cell(row, "error"),
        time_of(row),
        *ratio_cells(row, "ratio"),
    )
    return (*texts(row, "mechanism"), within, text_cell(row.get("engine", ""), "engine"), *names, *reached, remark(row))


def batched(row: Row) -> tuple[Cell, ...]:
    times_of = (time_of(row), span(row), time_of(row, "rival_seconds"), *ratio_cells(row, "ratio"))
    return (
        *texts(row, "mechanism"),
        *counts(row, "states", "lanes"),
        *times_of,
        exact_cell(row, "lanes_error"),
        *goal(row),
        remark(row),
    )


def asked(row: Row) -> tuple[Cell, ...]:
    names = texts(row, "mechanism", "own", "rival", "settings")
    return (*names, time_of(row), time_of(row, "rival_seconds"), *ratio_cells(row, "ratio"), *goal(row), remark(row))


def agreed(row: Row) -> tuple[Cell, ...]:
    errors = (exact_cell(row, "error"), exact_cell(row, "numpy_error"))
    return (*texts(row, "mechanism", "formulation", "place"), *counts(row, "states"), *errors, *goal(row, small), remark(row))


def ran(row: Row) -> tuple[Cell, ...]:
    drifts = (exact_cell(row, "position_drift"), exact_cell(row, "velocity_drift"))
    energies = tuple(error_cell(row, x) for x in ("energy", "energy_first", "energy_last", "energy_max"))
    order = Cell(f"{number(row, 'order'):.1f}", number(row, "order")) if known(row.get("order")) else Cell("-")
    kept = (*counts(row, "step", "t_end"), *drifts, *energies, order)
    return (*texts(row, "mechanism", "formulation"), *kept, *goal(row, small), remark(row))


def grown(row: Row) -> tuple[Cell, ...]:
    exponent = number(row, "exponent")
    return (*texts(row, "engine", "quantity"), *counts(row, "sizes"), Cell(f"{exponent:.2f}", exponent))


def sized(row: Row) -> tuple[Cell, ...]:
    times_of = (time_of(row), span(row, "low", "high"), error_cell(row, "error"))
    made = tuple(Cell(f"{number(row, x):.2f}", number(row, x)) if known(row.get(x)) else Cell("-") for x in BUILDING)
    return (*texts(row, "engine", "quantity"), *counts(row, "size", "n"), *times_of, *made, remark(row))


def turned(row: Row) -> tuple[Cell, ...]:
    values = [number(row, f"rate{end}") for end in ("", "_low", "_high")]
    rates = Cell(f"{values[0]:.3g}", values[0]) if known(values[0]) else Cell("-")
    spread = Cell(f"{values[1]:.3g}..{values[2]:.3g}", values[1]) if known(values[1]) else Cell("-")
    errors = tuple(exact_cell(row, f"{level}_error") for level in ("position", "velocity", "acceleration"))
    return (*texts(row, "mechanism", "method"), rates, spread, *errors, *goal(row, "{:.2g}".format), remark(row))


def bounded(row: Row) -> tuple[Cell, ...]:
    share = number(row, "share")
    reached = Cell(f"{100 * share:.0f} %", share) if known(share) else Cell("-")
    return (
        *texts(row, "mechanism", "quantity"),
        *counts(row, "cycles", "flops"),
        time_of(row, "bound"),
        time_of(row),
        reached,
        remark(row),
    )


def fact(row: Row) -> tuple[Cell, ...]:
    value, low, high = (number(row, f"value{end}") for end in ("", "_low", "_high"))
    return (*texts(row, "quantity"), Cell(f"{value:.3g}", value), Cell(f"{low:.3g}..{high:.3g}", low), *texts(row, "unit"))


def exact_cell(row: Row, column: str) -> Cell:
    """An error, which may be zero."""
    return Cell("0", 0.0) if number(row, column) == 0 else error_cell(row, column)


def texts(row: Row, *keys: str) -> tuple[Cell, ...]:
    return tuple(text_cell(row.get(key, "")) for key in keys)


def counts(row: Row, *keys: str) -> tuple[Cell, ...]:
    """Whole numbers, and others as short as they are."""
    return tuple(Cell(f"{number(row, key):g}", number(row, key)) if known(row.get(key)) else Cell("-") for key in keys)


def duration(seconds: float) -> str:
    """Three digits with a unit."""
    unit, factor = next(((u, f) for u, f in (("s", 1.0), ("ms", 1e3), ("µs", 1e6)) if seconds * f >= 1), ("ns", 1e9))
    return f"{times(seconds * factor)} {unit}" if known(seconds) else "-"


def time_of(row: Row, column: str = "seconds") -> Cell:
    x = number(row, column)
    return Cell(duration(x), x if known(x) else "")


def span(row: Row, low: str = "seconds_low", high: str = "seconds_high") -> Cell:
    a, b = number(row, low), number(row, high)
    return Cell(f"{duration(a)}..{duration(b)}", a) if known(a) and known(b) else Cell("-")


def goal(row: Row, written: Callable[[float], str] = times) -> tuple[Cell, Cell]:
    """A target and whether it is met; nothing where there is none."""
    x = number(row, "target")
    if not known(x):
        return Cell("-"), Cell("-")
    return Cell(written(x), x), Cell("yes", "yes", "good") if row.get("met") else Cell("no", "no", "bad")


def small(x: float) -> str:
    return f"{x:.0e}"


def remark(row: Row) -> Cell:
    status = str(row.get("status", "ok") or "ok")
    message = str(row.get("message", ""))
    return text_cell(message) if status == "ok" else text_cell(f"{status}: {message}", "warn" if status == "skip" else "bad")
