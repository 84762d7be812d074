"""What `gauss-bench recommend` says to people: a line for every engine, and one sentence to act on."""

from typing import Any

from gauss_bench.bench.recommending import setting_said
from gauss_bench.bench.search import UNITS

SHORT = 20  # lines of a program that is shown
WIDTH = 56  # of a setting


def format_recommendation(found: dict[str, Any]) -> str:
    """The object that --json prints, as text."""
    limits = " and ".join(f"{kind} {x:g} {UNITS[kind]}" for kind, x in found["required"].items())
    known = ", ".join(f"{found['known'][kind]:.0e} {UNITS[kind]}" for kind in found["required"] if kind in found["known"])
    lines = [f"{found['mechanism']} / {found['scenario']}, {found['until']:g} s: {limits}, of which settings hold half"]
    lines.append(f"truth known to {known}; {found['truth']}")
    heading = "  ".join(f"{kind} error" for kind in found["required"])
    lines.append(f"  {'engine':16} {'setting':{WIDTH}} {heading:>16} {'time of a run':>14} {'ratio (5 % to 95 %)':>22}")
    lines += [_line(answer, found["required"]) for answer in found["answers"]]
    lines += [*(f"Note: {x}." for x in found["remarks"]), found["advice"]]
    short = next((x["snippet"] for x in found["answers"] if x["snippet"]), "")
    if 0 < len(short.splitlines()) <= SHORT:
        lines += ["", short.rstrip(), ""]
    return "\n".join([*lines, "Programs that run each of these settings: --out FOLDER."])


def _line(answer: dict[str, Any], required: dict[str, float]) -> str:
    if answer["status"] != "ok":
        return f"  {answer['engine']:16} {answer['status']}: {answer['message']}"
    size = f"tolerance {answer['tolerance']:.2g}" if answer["step"] is None else f"step {answer['step']:.4g} s"
    setting = f"{setting_said(answer['settings'], answer['integrator'], answer['stabilization'])}, {size}"
    errors = "  ".join(f"{answer['errors'][kind]:.1e} {UNITS[kind]}" for kind in required)
    if answer["seconds"] is None:
        return f"  {answer['engine']:16} {setting:{WIDTH}} {errors:>16} {answer['message']}"
    spread = f"{answer['ratio']:.3g} ({answer['ratio_low']:.3g} to {answer['ratio_high']:.3g})"
    return f"  {answer['engine']:16} {setting:{WIDTH}} {errors:>16} {answer['seconds'] * 1e3:>11.4g} ms {spread:>22}"
