"""Numbers, lists and counts in words. Formats are fixed, so that two reports differ in a line only if a number differs."""

from collections.abc import Callable, Iterable, Sequence

from gauss_bench.report.rows import Row, group_by, is_known

NOTHING = "-"  # text of a value that is missing


def round_digits(x: float, digits: int) -> float:
    """Round a number to significant digits; an integral result becomes an int, which prints without a point."""
    value = float(f"{x:.{digits}g}")
    return int(value) if value.is_integer() and abs(value) < 10**digits else value


def error_text(x: float) -> str:
    """Format an error with two digits, such as "1.3e-05"; NOTHING if not finite."""
    return f"{x:.1e}" if is_known(x) else NOTHING


def ratio_text(x: float) -> str:
    """Format a ratio with three digits, such as "12.3"; NOTHING if not finite."""
    decimals = sum(x < limit for limit in (0.01, 0.1, 1, 10, 100))  # the number of limits above x: 1 for 12.3, 2 for 1.23
    return f"{x:.{decimals}f}" if is_known(x) else NOTHING


def time_text(seconds: float) -> str:
    """Format a duration with three digits and a unit, such as "4.73 ms"; NOTHING if not finite."""
    if not is_known(seconds):
        return NOTHING
    unit, factor = choose_unit(seconds, (("s", 1.0), ("ms", 1e3), ("µs", 1e6), ("ns", 1e9)), least=1.0)
    return f"{ratio_text(seconds * factor)} {unit}"


def length_text(metres: float) -> str:
    """Format a length with two digits and a unit."""
    unit, factor = choose_unit(metres, (("m", 1.0), ("mm", 1e3), ("µm", 1e6), ("nm", 1e9)), least=0.1)
    return f"{metres * factor:.2g} {unit}"


def choose_unit(x: float, units: Sequence[tuple[str, float]], least: float) -> tuple[str, float]:
    """Return the first of `units`, as (name, factor), in which x is at least `least`; the last one if there is none."""
    return next((unit for unit in units if x * unit[1] >= least), units[-1])


def limit_text(x: float) -> str:
    """Format a required accuracy with one digit."""
    return f"{x:.0e}"


def itemise(words: Iterable[str]) -> str:
    """Join words as "a, b and c"."""
    *first, last = list(words) or [""]
    return f"{', '.join(first)} and {last}" if first else last


def itemise_code(names: Iterable[str]) -> str:
    """Join names, each marked as code, as "`a`, `b` and `c`"; a name that occurs again is left out."""
    return itemise(f"`{name}`" for name in dict.fromkeys(names))


def count(n: int, word: str) -> str:
    """Return a number with its noun, in the plural unless the number is 1."""
    return f"{n} {word}" if n == 1 else f"{n} {word}s"


def range_text(values: Sequence[float], form: Callable[[float], str] = ratio_text) -> str:
    """Format the range of numbers as "low to high", or as one number if both ends have the same text."""
    return " to ".join(dict.fromkeys((form(min(values)), form(max(values)))))


def list_unmeasured(rows: Sequence[Row], column: str) -> str:
    """Return a sentence on the linkages without a number in a column, with the reasons; empty if there are none."""
    measured = {r.get("mechanism") for r in rows if is_known(r.get(column))}
    missing = [r for r in rows if r.get("mechanism") and r["mechanism"] not in measured]
    parts = []
    for reason, group in group_by(missing, lambda r: r.get("message") or "no reason was given").items():
        linkages = dict.fromkeys(r["mechanism"] for r in group)  # each once
        parts.append(f"{itemise(linkages)} ({reason})")
    return f" Left out: {'; '.join(parts)}." if parts else ""
