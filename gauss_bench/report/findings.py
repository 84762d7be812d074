"""Sentences computed from rows: each function looks for one thing and returns what it found, or nothing."""

import re
from collections.abc import Callable, Iterator

from gauss_bench.report.content import Finding, count, error, listed, times
from gauss_bench.report.kernel_findings import kernel_findings
from gauss_bench.report.paper_findings import paper_findings
from gauss_bench.report.rows import (
    KEYS,
    SAME_ACCELERATION,
    Row,
    Run,
    accelerations,
    below_reference,
    costs,
    end_bar,
    end_error,
    grouped,
    known,
    label,
    method,
    number,
    ok,
    own_steps,
    plain,
    ranked,
    run_time,
)

TARGETS = (1e-3, 1e-6)  # crank errors [rad] at which costs are compared
SHRINKS = 2.0  # an error that falls by less while the step falls 4-fold does not come from the step
OWN, RIVAL = "gauss", "lagrange"
SHUT = 1e-4  # [m, rad] a gap that nobody would see
LOST = 1.0  # [rad] a crank that is somewhere else


def all_findings(run: Run) -> Iterator[Finding]:
    """Everything found, most general first."""
    yield from same_model(run)
    yield from other_model(run)
    yield from controls(run)
    yield from own_cost(run)
    for name in run.linkages:
        yield from best_of(run, name)
    yield from worst_drift(run)
    yield from wrong_though_closed(run)
    yield from not_valid(run)
    yield from failed(run)
    yield from published(run)
    yield from paper_findings(run)
    yield from kernel_findings(run)


def published(run: Run) -> Iterator[Finding]:
    """How good published reference values are."""
    off = [row for row in run.published if number(row, "difference") > 10 * max(number(row, "floor"), number(row, "error_bar"))]
    if off:
        worst = min(off, key=lambda row: number(row, "true_digits"))
        digits = f"{number(worst, 'printed_digits'):g} digits, of which {number(worst, 'true_digits'):g} are true"
        text = f"The IVP test set prints {count(len(run.published), 'value')} for Andrews' squeezing mechanism, copied ever since; "
        text += (
            f"{len(off)} are off by more than ten times what the certified motion leaves open: {worst['quantity']} is printed with "
        )
        text += f"{digits}."
        yield Finding("Published values", text, "warn")


def _settings(row: Row) -> str:
    return label(row, "settings")


def same_model(run: Run) -> Iterator[Finding]:
    """Who returns the reference's acceleration at the same state, and to what."""
    rows = [row for row in accelerations(run.results) if not row["control"]]
    worst = {name: max(number(r, "acceleration_error_median") for r in group) for name, group in grouped(rows, _settings).items()}
    same = sorted((x, name) for name, x in worst.items() if x <= SAME_ACCELERATION)
    if same:
        found = listed(f"{name} ({error(x)})" for x, name in same)
        yield Finding(
            "Same state, same acceleration",
            f"Given the same states, {found} return the reference's acceleration; in brackets the largest median relative error of "
            f"{count(len({r['mechanism'] for r in rows}), 'linkage')}.",
            "good",
        )


def other_model(run: Run) -> Iterator[Finding]:
    """Who computes another acceleration, and whether a smaller step helps."""
    rows = [row for row in accelerations(run.results) if not row["control"]]
    for (name, settings), group in grouped(rows, lambda r: (r["engine"], r["settings"])).items():
        off = [row for row in group if not row["acceleration_error_median"] <= SAME_ACCELERATION]
        if not off:
            continue
        span = _span([number(r, "acceleration_error_median") for r in off])
        text = (
            f"`{name}` (settings {settings}) computes another acceleration at the same state: median relative error {span} on "
            f"{listed(row['mechanism'] for row in off)}. A smaller step cannot change that"
        )
        yield Finding("Soft, or another model", f"{text}{_step_does_not_help(run, off)}", "warn")


def _span(values: list[float]) -> str:
    low, high = error(min(values)), error(max(values))
    return low if low == high else f"{low} to {high}"


def _step_does_not_help(run: Run, off: list[Row]) -> str:
    """Evidence from trajectories, as the end of a sentence: the flattest error over at least a 4-fold range of steps."""
    wanted = {(row["mechanism"], row["engine"], row["settings"]) for row in off}
    rows = [r for r in run.results if ok(r) and (r["mechanism"], r["engine"], r["settings"]) in wanted and known(end_error(r))]
    found = []
    for group in grouped(rows, lambda r: (r["mechanism"], r["scenario"], *method(r))).values():
        stepped = sorted((r for r in group if not own_steps(r)), key=lambda r: -number(r, "step"))
        if len(stepped) > 1 and stepped[0]["step"] >= 4 * stepped[-1]["step"] and end_error(stepped[-1]) > 0:
            found.append((end_error(stepped[0]) / end_error(stepped[-1]), stepped))
    flat = [(ratio, steps) for ratio, steps in found if ratio < SHRINKS]
    if not flat:
        return "."
    _, steps = min(flat, key=lambda x: x[0])
    first, last = steps[0], steps[-1]
    return (
        f", and does not: on {first['mechanism']} {first['scenario']} the crank error is {error(end_error(first))} rad at step "
        f"{first['step']:g} s and {error(end_error(last))} rad at {last['step']:g} s."
    )


def controls(run: Run) -> Iterator[Finding]:
    """Each negative control: that it satisfies its constraints, and that it is flagged all the same."""
    rows = [row for row in run.results if row["control"] and ok(row)]
    for name, group in grouped(rows, lambda r: r["engine"]).items():
        residuals = [number(r, "acceleration_residual") for r in group if known(r.get("acceleration_residual"))]
        errors = [number(r, "acceleration_error_median") for r in group if known(r.get("acceleration_error_median"))]
        if not errors:
            continue
        holds = f"satisfies the constraints of acceleration to {error(max(residuals))} and is" if residuals else "is"
        passed = sum(bool(row["valid"]) for row in group)
        caught = (
            "**" + f"{passed} of its {len(group)} rows pass the gate: it is too wide.**"
            if passed
            else "No row of it passes the gate."
        )
        yield Finding(
            "The negative control",
            f"`{name}` {holds} still wrong: the median relative error of its acceleration is {_span(errors)}. "
            f"{caught} Residuals alone would not have shown it.",
            "bad" if passed else "good",
        )


def own_cost(run: Run) -> Iterator[Finding]:
    """The suite's own formulation against Lagrange multipliers: the cost of a step and of an acceleration."""
    rows = costs(run.results)
    for quantity, what in (("step", "A step"), ("acceleration", "One acceleration")):
        found: dict[str, list[float]] = {}
        for row in (r for r in rows if r["engine"] == OWN):
            rival = next((r for r in rows if r["engine"] == RIVAL and _alike(r, row)), None)
            ratio = _ratio(run, row, rival, quantity) if rival is not None else []
            if ratio:  # an acceleration has no integrator: one per linkage
                found.setdefault(f"{row['mechanism']}{' ' + row['integrator'] if quantity == 'step' else ''}", ratio)
        if found:
            slower = sum(x[0] > 1 for x in found.values())
            multiples = listed(f"{name} {_with_spread(x)}" for name, x in found.items())
            yield Finding(
                f"Cost of {OWN} against {RIVAL}",
                f"{what} of `{OWN}` takes this multiple of the time of `{RIVAL}`: {multiples}; slower in {slower} of {len(found)}.",
                "warn" if slower > len(found) / 2 else "good",
            )


def _with_spread(x: list[float]) -> str:
    return f"{times(x[0])} ({times(x[1])}..{times(x[2])})" if len(x) > 1 else times(x[0])


def _alike(a: Row, b: Row) -> bool:
    return all(a[key] == b[key] for key in ("mechanism", "settings", "integrator"))


def _ratio(run: Run, own: Row, rival: Row, quantity: str) -> list[float]:
    """Ratio with low and high where the rival, or the row itself, is what ratios are taken to; else the quotient of two ratios."""
    x, low, high = (number(own, f"{quantity}_ratio{end}") for end in ("", "_low", "_high"))
    y, below, above = (number(rival, f"{quantity}_ratio{end}") for end in ("", "_low", "_high"))
    baseline = run.environment.get("baseline_engine")
    if baseline == RIVAL and y == 1 and known(low) and known(high):
        return [x, low, high]
    if baseline == OWN and x == 1 and below > 0 and above > 0:
        return [1 / y, 1 / above, 1 / below]
    return [x / y] if known(x) and y > 0 else []


def best_of(run: Run, name: str) -> Iterator[Finding]:
    """The most accurate engine of a linkage, and the cheapest at equal accuracy reached."""
    for scenario, rows in grouped((r for r in run.of(name) if ranked(r)), lambda r: r["scenario"]).items():
        with_error = [row for row in rows if known(end_error(row))]
        if not with_error:
            continue
        sentences = [_most_accurate(with_error)]
        for target in TARGETS:
            reached = [r for r in with_error if max(end_error(r), end_bar(r)) <= target and known(run_time(r))]
            if reached:
                cheapest = min(reached, key=run_time)
                sentences.append(f"Cheapest within {target:.0e} rad: {_priced(cheapest)}{_cheapest_own(reached, cheapest)}.")
        yield Finding(f"{name}, {scenario}", " ".join(sentences))


def _priced(row: Row) -> str:
    where = "in its own loop" if known(row.get("native_step_time")) else "stepped from Python"
    return f"{label(row, 'settings', 'integrator', 'stabilization', 'step')}, {run_time(row) * 1e3:.3g} ms {where}"


def _cheapest_own(reached: list[Row], cheapest: Row) -> str:
    """Where `gauss` stands among rows that reach the same accuracy."""
    own = [row for row in reached if row["engine"] == OWN]
    if not own or cheapest["engine"] == OWN:
        return ""
    row = min(own, key=run_time)
    return f"; `{OWN}` needs {run_time(row) * 1e3:.3g} ms ({times(run_time(row) / run_time(cheapest))} times as long)"


def _most_accurate(rows: list[Row]) -> str:
    below = sorted({row["engine"] for row in rows if below_reference(row)})
    if below:
        bar = max(end_bar(row) for row in rows)
        return f"Crank error below the reference's bar ({bar:.0e} rad): {listed(f'`{x}`' for x in below)}."
    best = min(rows, key=end_error)
    return f"Most accurate: {_tied(rows, best, end_error)}, crank error {error(end_error(best))} rad."


def _tied(rows: list[Row], best: Row, value: Callable[[Row], float]) -> str:
    """A case in words, with the engines that come within 5 percent of it by the same choices."""
    same = [r for r in rows if all(str(r[k]) == str(best[k]) for k in KEYS if k != "engine")]
    engines = sorted({r["engine"] for r in same if abs(value(r) - value(best)) <= 0.05 * abs(value(best))})
    choices = label(best, "settings", "integrator", "stabilization", "step").partition("` ")[2]
    return f"{listed(f'`{name}`' for name in engines)} {choices}".strip()


def worst_drift(run: Run) -> Iterator[Finding]:
    rows = [row for row in run.results if ranked(row) and known(row.get("position_drift"))]
    free = [row for row in rows if plain(row)]
    if free:
        row = max(free, key=lambda r: number(r, "position_drift"))
        what = _tied(free, row, lambda r: number(r, "position_drift"))
        yield Finding(
            "Where drift is worst",
            f"Of the valid rows without stabilisation, constraints are left farthest by {what} on {row['mechanism']} "
            f"{row['scenario']}: {error(number(row, 'position_drift'))} in position and "
            f"{error(number(row, 'velocity_drift'))} in velocity.",
        )


def wrong_though_closed(run: Run) -> Iterator[Finding]:
    """The row that is farthest off while its model is right and its loops stay shut: residuals told nothing."""
    fine = [row for row in run.results if ok(row) and not row["control"] and number(row, "position_drift") < SHUT]
    rows = [r for r in fine if number(r, "acceleration_error_median") <= run.acceleration_gate and end_error(r) > LOST]
    if rows:
        row = max(rows, key=end_error)
        yield Finding(
            "Closed loops, wrong motion",
            f"{label(row, 'settings', 'integrator', 'stabilization', 'step')} on {row['mechanism']} "
            f"{row['scenario']} keeps its loops within {error(number(row, 'position_drift'))} and its model right, raises no "
            f"warning, and ends {end_error(row):.3g} rad from the true crank angle. {count(len(rows), 'row')} of this kind "
            f"ended more than {LOST:g} rad off.",
            "warn",
        )


def not_valid(run: Run) -> Iterator[Finding]:
    rows = [row for row in run.results if ok(row) and not row["valid"] and not row["control"]]
    if rows:
        engines = grouped(rows, lambda r: str(r["engine"])).items()
        found = listed(f"`{name}` {len(group)} ({_why(group)})" for name, group in engines)
        yield Finding(
            "Ran, but not valid",
            f"{count(len(rows), 'case')} ended and may not be used: {found}. They stay in the tables, marked, "
            "and are in no figure of error against cost and in no ranking.",
            "warn",
        )


def _why(group: list[Row]) -> str:
    """The judge's words for these rows, numbers taken out, in order of how often they were said."""
    words = [re.sub(r" by \S+", "", str(row.get("flag") or "no reason given")) for row in group]
    return listed(sorted(set(words), key=lambda x: (-words.count(x), x)))


def failed(run: Run) -> Iterator[Finding]:
    rows = [row for row in run.results if row["status"] not in ("ok", "invalid", "skip")]
    if rows:
        groups = grouped(rows, lambda r: (r["engine"], r["status"])).items()
        found = "; ".join(f"`{name}` {status} in {count(len(group), 'case')}, {_first(group)}" for (name, status), group in groups)
        text = f"{count(len(rows), 'case')} of {len(run.results)} ended without a trajectory: {found}."
        yield Finding("Failed cases", text, "bad")


def _first(group: list[Row]) -> str:
    row = group[0]
    sentence = " ".join(str(row["message"]).split()).rstrip(".").replace("`", "") or "no message"
    return f'such as {row["mechanism"]} {row["scenario"]} ("{sentence}")'
