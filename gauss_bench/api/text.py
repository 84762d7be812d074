"""Text for people on the command line: the same objects that --json prints."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gauss_bench.advice.answer import setting_said
from gauss_bench.linkage.load import built_in, document_of
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reach import UNITS
from gauss_bench.runs.offers import offers
from gauss_bench.tables import TABLES

if TYPE_CHECKING:  # which bring all that runs a suite, for verbs that only name things
    from gauss_bench.api.diagnose import Diagnosis
    from gauss_bench.bench.differences import Clocked, Differences
    from gauss_bench.bench.gate import Verdict
    from gauss_bench.bench.subject import Check
    from gauss_bench.diagnosis.selftest import SelfTest

SHOWN = 10  # lines of a long list
SHORT_PROGRAM = 20  # lines of a program that is shown
SETTING = 56  # columns of a setting
STATE_KEYS = ("x", "y", "theta", "vx", "vy", "omega")
POINT_KEYS = ("x", "y", "vx", "vy")


def catalogue() -> dict[str, Any]:
    """Linkages with their scenarios, none of them assembled, and engines with what they offer."""
    linkages = {name: document_of(name)[0] for name in built_in()}
    engines = {
        x.name: {
            "version": x.version,
            "settings": list(x.settings),
            "integrators": list(x.integrators),
            "stabilizations": list(x.stabilizations),
            "status": str(x.status),
            "reason": x.reason,
        }
        for x in offers()
    }
    return {
        "linkages": {k: {"title": x.get("title", ""), "scenarios": list(x["scenarios"])} for k, x in linkages.items()},
        "engines": engines,
    }


def format_catalogue(catalogue: dict[str, Any]) -> str:
    lines = ["linkages"]
    lines += [f"  {k:14} {v['title']}  [{', '.join(v['scenarios'])}]" for k, v in catalogue["linkages"].items()]
    lines.append("engines")
    for name, engine in catalogue["engines"].items():
        if engine["reason"]:
            lines.append(f"  {name:14} {engine['status']}: {engine['reason']}")
            continue
        offered = "; ".join(", ".join(engine[k]) for k in ("settings", "integrators", "stabilizations"))
        lines.append(f"  {name:14} {engine['version']}  [{offered}]")
    return "\n".join(lines)


def format_checkup(checkup: dict[str, Any]) -> str:
    """Format the findings of `doctor`, one thing a line, and its verdict last."""
    lines = []
    for title in ("findings", "engines"):
        for x in checkup[title]:
            status = "" if x["status"] == "ok" else f"{x['status']}: "
            lines.append(f"  {x['name']:16} {status}{'; '.join(filter(None, (x['value'], x['message'])))}")
    return "\n".join([*lines, checkup["verdict"]])


def format_conformance(engine: str, checks: "list[Check]") -> str:
    """One line for each check, and how many failed."""
    words = {True: "ok", False: "FAILED", None: "not asked"}
    lines = [f"  {words[x.passed]:10}{': '.join(filter(None, (x.name, x.message)))}" for x in checks]
    failed = sum(x.passed is False for x in checks)
    asked = sum(x.passed is not None for x in checks)
    return "\n".join([*lines, f"{engine}: {failed} of {asked} checks failed" if failed else f"{engine}: all {asked} checks passed"])


def description(first: Mechanism, others: list[Mechanism]) -> dict[str, Any]:
    """Describe a linkage file, each scenario assembled."""
    return {
        "name": first.name,
        "title": first.title,
        "source": first.source,
        "dof": first.dof,
        "redundant": first.redundant,
        "loops": len(first.joints) - len(first.links),
        "links": {x.name: {"mass": x.mass, "inertia": x.inertia, "com": x.com, "points": dict(x.points)} for x in first.links},
        "joints": {x.name: type(x).__name__.lower() for x in first.joints},
        "knife_edges": [x.name for x in first.knife_edges],
        "welds": {x.name: [first.whole.links[i].name for i in x.beyond] for x in first.welds},
        "warnings": sorted({x for m in (first, *others) for x in m.warnings}),
        "scenarios": {
            m.scenario: {
                "duration": m.duration,
                "forces": [f.name for f in (*m.forces, *m.frictions)],
                "driven": bool(m.drivers),
                "q0": m.q0,
                "v0": m.v0,
            }
            for m in (first, *others)
        },
    }


def format_description(description: dict[str, Any]) -> str:
    counts = ", ".join(
        f"{description[k]} {word}{'' if description[k] == 1 else 's'}{rest}"
        for k, word, rest in (("dof", "degree", " of freedom"), ("loops", "loop", ""), ("redundant", "redundant row", ""))
    )
    lines = [f"{description['name']}: {description['title']}", counts, "links (mass kg, inertia kg m^2, centre of mass m)"]
    for name, link in description["links"].items():
        lines.append(f"  {name:14} {link['mass']:<12.6g} {link['inertia']:<12.6g} ({link['com'][0]:.6g}, {link['com'][1]:.6g})")
    lines.append("joints: " + ", ".join(f"{k} ({v})" for k, v in description["joints"].items()))
    for name, scenario in description["scenarios"].items():
        how = "driven" if scenario["driven"] else "free"
        lines.append(f"scenario {name}: {scenario['duration']:g} s, {how}, forces {', '.join(scenario['forces']) or 'none'}")
    lines += [f"weld {name}: holds {', '.join(held)}" for name, held in description["welds"].items()]
    lines += [f"warning: {x}" for x in description["warnings"]]
    return "\n".join(lines)


def format_simulation(result: dict[str, Any]) -> str:
    how = f"{result['engine']} ({result['settings']}), {result['integrator']}, step {result['step']:g} s"
    lines = [f"{result['mechanism']} / {result['scenario']}: {how}", f"status {result['status']} {result['message']}".rstrip()]
    if result["advice"]:
        lines.append(f"nothing is objected to up to t = {result['trusted_until']:g} s; {result['advice']}")
    for k, t in enumerate(result["t"]):
        lines.append(f"t = {t:g} s")
        for name, state in result["points"].items():
            lines.append(f"  {name:14}" + " ".join(f"{key} {state[key][k]: .9g}" for key in POINT_KEYS))
        for name, state in result["links"].items():
            if name not in (result["observed"]["links"] or [name]):
                continue  # the file says which links to look at; --json has all of them
            lines.append(f"  {name:14}" + " ".join(f"{key} {state[key][k]: .9g}" for key in STATE_KEYS))
    lines += [f"{key:22} {value:.3g}" for key, value in result["metrics"].items() if value is not None]
    return "\n".join(lines)


def format_kinematics(result: dict[str, Any]) -> str:
    lines = [f"{result['mechanism']} / {result['scenario']}: {result['method']}, {len(result['t'])} positions, {result['status']}"]
    lines.append("loops: " + "; ".join("-".join(loop) for loop in result["loops"]))
    lines.append(f"assembly: {result['branch']}")
    singular = result["singular"]
    if isinstance(singular, str):
        lines.append(f"singular positions: {singular}")
    else:
        lines += [f"{s['kind']} of {s['coordinate']} at {_input(s)}" for s in singular]
    lines += [f"{x['group']} changes sides at t = {x['t']:g} s" for x in result["branch_changes"]]
    lines.append("link units: " + ", ".join(f"{name} {kind}" for name, kind in result["link_types"].items()))
    for name in result["observed"]["links"]:
        state = result["links"][name]
        ranges = (f"{key} {min(state[key]):.6g} .. {max(state[key]):.6g}" for key in ("theta", "omega", "alpha") if state[key])
        lines.append(f"  {name:16}" + ", ".join(ranges))
    for name, state in result["points"].items():
        ranges = (
            f"{key} {min(state[key]):.6g} .. {max(state[key]):.6g}" for key in ("x", "y", "vx", "vy", "ax", "ay") if state[key]
        )
        lines.append(f"  {name:16}" + ", ".join(ranges))
    return "\n".join(lines)


def _input(singular: Mapping[str, Any]) -> str:
    """Name the place to which the linkage is driven at a singular position."""
    if singular["crank_deg"] is None:
        return f"{singular['input']} = {singular['input_value']:.8g} m"
    return f"crank angle {singular['crank_deg']:.8f} deg"


def format_export(result: dict[str, Any]) -> str:
    step = f"step {result['step']:g} s"
    lines = [f"{result['file']}: {result['mechanism']} / {result['scenario']} as {result['what']}, {step}, {result['bytes']} bytes"]
    lines += [f"not in it: {x}" for x in result["left_out"]]
    if tuning := result["tuning"]:
        errors = f"joints open by {tuning['loops_open']:.1e}, links off by {tuning['motion_error']:.1e} (m, rad)"
        aim = f"{tuning['loops_wanted']:g} and {tuning['motion_wanted']:g}"
        lines.append(f"measured over {tuning['until']:g} s: {errors}; {'held' if tuning['met'] else 'NOT HELD'}: {aim}")
    return "\n".join(lines)


def format_import(result: dict[str, Any]) -> str:
    counts = f"{result['links']} links, {result['dof']} degrees of freedom"
    lines = [f"{result['file']}: {counts}, from {result['model']} ({result['kind']})"]
    return "\n".join([*lines, *(f"not taken over: {x}" for x in result["left_out"])])


def format_run(tables: Mapping[str, Sequence[Mapping[str, Any]]], folder: Path) -> str:
    """Format how the cases of a run ended, and which of its targets were missed."""
    lines = []
    if rows := tables.get("results"):
        counts = sorted(Counter(str(row["status"]) for row in rows).items())
        said = ", ".join(f"{n} {status}" for status, n in counts)
        lines.append(f"{len(rows)} cases ({said}); {sum(bool(row.get('valid')) for row in rows)} are valid")
    aimed = [(name, row) for name, table in tables.items() for row in table if isinstance(row.get("met"), bool)]
    if aimed:
        missed = dict.fromkeys(" ".join(_names(name, row)) for name, row in aimed if not row["met"])
        lines.append(f"{sum(row['met'] for _, row in aimed)} of {len(aimed)} targets met")
        lines += [f"missed: {x}" for x in missed]
    return "\n".join([*lines, f"tables in {folder}"])


def _names(table: str, row: Mapping[str, Any]) -> list[str]:
    """The words that tell a row of a table from others."""
    keys = TABLES[table].columns[: TABLES[table].keys]
    return [str(row[c.name]) for c in keys if c.kind == "text" and row.get(c.name)]


def format_differences(differences: "Differences", there: Path) -> str:
    """Format the differences between a run and the one in the folder `there`."""
    apart = len(differences.beyond)
    lines = [f"apart: {v.case}: {v.metric} = {v.value}, there {v.baseline}" for v in differences.beyond[:SHOWN]]
    if apart > SHOWN:
        lines.append(f"and {apart - SHOWN} more")
    others = [(differences.only_here, "here only"), (differences.only_there, "there only")]
    missing = "".join(f"; {n} cases are {where}" for n, where in others if n)
    return "\n".join(
        [*lines, f"against {there}: {apart} of {differences.compared} accuracy figures lie apart beyond the gate's limits{missing}"]
    )


def format_changes(
    differences: "Differences", times: "tuple[int, tuple[Clocked, ...]]", where: tuple[dict[str, Any], dict[str, Any]]
) -> str:
    """Format the differences between two runs as Markdown for a comment: the verdict, what matters, what merely moved."""
    compared, moved = times
    matters, rest = [x for x in moved if x.matters], [x for x in moved if not x.matters]
    apart = len(differences.beyond)
    verdict = f"{apart or 'None'} of {differences.compared} accuracy figures beyond the gate's limits; " + (
        f"{len(matters) or 'none'} of {compared} ratios, targets and claims of times changed sides."
        if compared
        else "no times in common."
    )
    made = [
        f"- {name}: commit {x.get('commit') or 'unknown'}{' with changes' if x.get('dirty') else ''}, "
        f"{x.get('date') or 'no date'}, {x.get('cpu') or 'an unnamed processor'}"
        for name, x in zip(("this run", "against"), where, strict=True)
    ]
    lines = ["## What changed", "", f"**{verdict}**", "", *made]
    others = [(differences.only_here, "this run only"), (differences.only_there, "the other run only")]
    lines += [f"- {n} cases are of {whose}" for n, whose in others if n]
    if apart:
        cells = [(v.case, v.metric, v.value, v.baseline, v.limit) for v in differences.beyond]
        lines += _markdown("Accuracy", ("case", "figure", "this run", "against", "allowed"), cells)
    head = ("what", "this run", "against")
    if matters:
        lines += _markdown("Times: what changed sides", head, [x.row for x in matters])
    if rest:
        told = f"{len(rest)} ratios moved beyond their spreads and conclude the same"
        lines += ["", f"<details><summary>{told}</summary>", *_markdown("", head, [x.row for x in rest]), "", "</details>"]
    if len({x.get("cpu") for x in where}) > 1:
        lines += ["", "The machines differ: ratios are compared, times are not."]
    return "\n".join(lines)


def _markdown(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A table of at most as many rows as a comment bears."""
    lines = ["", *([f"### {title}", ""] if title else []), f"| {' | '.join(head)} |", "| --- " * len(head) + "|"]
    lines += ["| " + " | ".join(x.replace("|", "\\|") for x in row) + " |" for row in rows[:SHOWN]]
    return lines if len(rows) <= SHOWN else [*lines, "", f"and {len(rows) - SHOWN} more"]


def format_check(verdicts: "list[Verdict]", again: str) -> str:
    """Format the figures that moved, and how to accept them: by the command `again` with a reason."""
    told = [v for v in verdicts if v.outcome != "ok"]
    failed = sum(v.outcome == "fail" for v in verdicts)
    better = len(told) - failed
    lines = [str(v) for v in told]
    lines.append(f"{len(verdicts)} figures: {failed} beyond their limits, {better} better than expected")
    if failed:
        lines.append(f"If the change is meant, accept it with its reason: {again} --accept 'REASON'")
    elif better:
        lines.append(f"Keep the improvement with: {again} --accept 'REASON'")
    return "\n".join(lines)


def format_certificate(row: dict[str, Any]) -> str:
    """Format the facts that one certificate vouches for, in words."""
    name = f"{row['mechanism']} / {row['scenario']}"
    if row["status"] != "ok":
        return f"{name}: not certified. {row['message']}"
    whole = "its whole duration" if row["complete"] else f"{row['duration']:g} s were asked for"
    lines = [f"{name}: {row['digits']} digits of positions and velocities vouched for until t = {row['until']:g} s ({whole})"]
    if not row["complete"]:
        lines.append(f"it stops there: {row['message']}")
    lines.append(f"values: {row['method']}")
    lines.append(f"checked by: {row['collocation_method']}, step {row['step']:.3g} s")
    bars = (("positions", "q"), ("velocities", "v"), ("accelerations", "a"), ("joint forces", "multipliers"))
    for words, level in bars:
        bar = row[f"error_{level}"]
        lines.append(f"  {words:14} error bar {'none: left open by redundant rows' if bar is None else format(bar, '.1e')}")
    floor = row["floor_q"]
    lines.append(
        f"parameters known to 1e-16 leave positions uncertain by {'an unknown amount' if floor is None else format(floor, '.1e')}"
    )
    for words in ("taylor", "collocation"):
        off = row[f"{words}_off_closed_form"]
        lines += (
            [f"closed form: the {words} pipeline follows it to {off:.1e} until t = {row[f'{words}_until']:g} s"]
            if off is not None
            else []
        )
        lines += [f"the {words} pipeline: {row[f'{words}_stopped']}"] if row[f"{words}_stopped"] else []
    lines.append(f"written to {row['file']}" if row["file"] else "not written: give --out FILE to keep it")
    return "\n".join(lines)


def format_certificates(rows: list[dict[str, Any]]) -> str:
    lines = []
    for row in rows:
        said = f"{row['digits']} digits until {row['until']:g} s" if row["status"] == "ok" else row["status"]
        lines.append(f"{row['mechanism']:14} {row['scenario']:14} {said}  {row['message']}".rstrip())
    return "\n".join(lines)


def format_verification(rows: list[dict[str, Any]]) -> str:
    lines = []
    for row in rows:
        if row["status"] == "ok":
            errors = f"states {row['state_error']:.1e} in {row['windows']} windows, balance {row['balance_error']:.1e}"
            said = f"{'holds' if row['passed'] else 'DOES NOT HOLD'}: {errors}"
        else:
            said = f"{row['status']}: {row['message']}"
        lines.append(f"{row['mechanism']:14} {row['scenario']:14} {said}")
    return "\n".join(lines)


def format_recommendation(recommendation: dict[str, Any]) -> str:
    """The object that --json prints, as text."""
    required, certain = recommendation["required"], recommendation["known"]
    limits = " and ".join(f"{kind} {x:g} {UNITS[kind]}" for kind, x in required.items())
    known = ", ".join(f"{certain[kind]:.0e} {UNITS[kind]}" for kind in required if kind in certain)
    what = f"{recommendation['mechanism']} / {recommendation['scenario']}, {recommendation['until']:g} s"
    lines = [f"{what}: {limits}, of which settings hold half"]
    lines.append(f"truth known to {known}; {recommendation['truth']}")
    heading = "  ".join(f"{kind} error" for kind in required)
    lines.append(f"  {'engine':16} {'setting':{SETTING}} {heading:>16} {'time of a run':>14} {'ratio (5 % to 95 %)':>22}")
    lines += [_answer(answer, required) for answer in recommendation["answers"]]
    lines += [*(f"Note: {x}." for x in recommendation["remarks"]), recommendation["advice"]]
    short = next((x["snippet"] for x in recommendation["answers"] if x["snippet"]), "")
    if 0 < len(short.splitlines()) <= SHORT_PROGRAM:
        lines += ["", short.rstrip(), ""]
    return "\n".join([*lines, "Programs that run each of these settings: --out FOLDER."])


def _answer(answer: dict[str, Any], required: dict[str, float]) -> str:
    if answer["status"] != "ok":
        return f"  {answer['engine']:16} {answer['message']}"
    size = f"tolerance {answer['tolerance']:.2g}" if answer["step"] is None else f"step {answer['step']:.4g} s"
    setting = f"{setting_said(answer['settings'], answer['integrator'], answer['stabilization'])}, {size}"
    errors = "  ".join(f"{answer['errors'][kind]:.1e} {UNITS[kind]}" for kind in required)
    if answer["seconds"] is None:
        return f"  {answer['engine']:16} {setting:{SETTING}} {errors:>16} {answer['message']}"
    spread = f"{answer['ratio']:.3g} ({answer['ratio_low']:.3g} to {answer['ratio_high']:.3g})"
    return f"  {answer['engine']:16} {setting:{SETTING}} {errors:>16} {answer['seconds'] * 1e3:>11.4g} ms {spread:>22}"


def format_diagnosis(x: "Diagnosis") -> str:
    """The verdict, and the numbers behind it."""
    lines = [
        f"{x.engine} on {x.mechanism} ({x.scenario}), {x.settings}, {x.integrator}, {x.step:g} s, until {x.until:g} s",
        x.verdict,
    ]
    if not x.numbers:
        return "\n".join(lines)
    n = x.numbers
    lines.append(f"largest error {n.error:.2e} (m, rad) at t = {n.at:.4g} s; error bar of the reference {n.bar:.1e}")
    lines += [f"  {part:20} {amount:.2e}" for part, amount in x.parts.items() if amount > 0]
    by = [f"{e:.2e} by {f'tolerance {t:g}' if t else f'{h:g} s'}" for e, h, t in zip(n.errors, n.steps, n.tolerances, strict=True)]
    lines.append(f"errors {', '.join(by)}; order {n.order:.2f}; split up to t = {n.horizon:.3g} s")
    lines.append(f"loops open by {', '.join(f'{g:.1e}' for g in n.closure)} (m, rad), most at {n.closure_joint}")
    off = (("told", n.told), ("by which velocities change", n.moved))
    lines += [f"accelerations {words}: off by {', '.join(f'{e:.1e}' for e in errors)} (relative, median)" for words, errors in off]
    lines += [f"  explains {e.share:7.2%}: {e.sentence}" for e in x.explanations[:3] if e.share > 0.01]
    return "\n".join([*lines, f"truth: {x.reference}"])


def format_selftest(selftest: "SelfTest") -> str:
    """Format planted faults that were not seen, false alarms, and the smallest faults that are seen."""
    lines = [
        f"{'seen  ' if x.seen else 'MISSED'} {x.kind:12} {x.fault}{'' if x.seen else f' ({x.said})'}" for x in selftest.findings
    ]
    lines += [f"FALSE ALARM: {said}" for said in selftest.false_alarms]
    lines.append(f"{selftest.detected} of {selftest.planted} planted faults detected; {len(selftest.false_alarms)} false alarms")
    lines.append(f"{selftest.silent} checks silent on the sound suite")
    lines += [f"smallest {x.fault} error seen: {x.size:.1e} {x.unit}" for x in selftest.smallest]
    return "\n".join([*lines, f"{selftest.seconds:.1f} s of processor time"])
