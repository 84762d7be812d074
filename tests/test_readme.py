"""README's first screen: every number in it is worked out here from the stored rows, by other code than the report's."""

import re
from collections import defaultdict
from pathlib import Path
from statistics import median

import pytest

from gauss_bench.api.options import VERBS
from gauss_bench.tables import read_table

ROOT = Path(__file__).parents[1]
ROWS = ROOT / "reports"


@pytest.fixture(scope="module")
def page() -> str:
    return (ROOT / "README.md").read_text(encoding="utf-8")


def three(x: float) -> str:
    return f"{x:#.3g}" if x < 100 else f"{x:.0f}"


def between(values: list[float]) -> str:
    low, high = three(min(values)), three(max(values))
    return low if low == high else f"{low} to {high}"


def results() -> list[str]:
    """Lines of the table: each engine's times over those of the cheaper compiled formulation, from the times of the winners."""
    times: dict[str, dict[str, float]] = defaultdict(dict)
    missed: dict[str, int] = defaultdict(int)
    for r in read_table("search_winners", ROWS):
        if r["required"] == "position" and r["accuracy"] == 1e-6:
            missed[r["engine"]] += r["status"] in ("not reached", "cannot reach")  # which older rows say
            if r["status"] == "ok":
                times[r["engine"]][r["mechanism"]] = r["ratio"]
    own = {"gauss-native", "lagrange-native"}
    engines = sorted(missed.keys() - own, key=lambda x: median(times[x].values()) if times[x] else float("inf"))
    lines = []
    for x in engines:
        if times[x] or missed[x]:
            failed = f"; not reached on {missed[x]}" if missed[x] else ""
            lines.append(f"| `{x}` | {len(times[x])}{failed} | {between(list(times[x].values()))} |")
    return lines


def losses() -> list[str]:
    """Sentences about what the suite's own formulations lose."""
    minimal, by_hand = (
        [
            r["ratio"]
            for r in read_table("search_winners", ROWS)
            if (r["engine"], r["required"], r["accuracy"], r["status"]) == (engine, "position", 1e-6, "ok")
        ]
        for engine in ("minimal", "by_hand")
    )
    assert max(minimal) < 1
    steps = {
        r["mechanism"]: 1 / r["step_ratio"]
        for r in read_table("results", ROWS)
        if (r["engine"], r["integrator"], r["stabilization"]) == ("lagrange", "rk4", "none") and r["step_ratio"] > 0
    }
    claim = [r for r in read_table("kernel_claim", ROWS) if r["status"] == "ok"]
    few, many = ([r for r in claim if (r["unknowns_gauss"] == 1) is one] for one in (True, False))
    won = [sum(r[f"{what}verdict"] == "holds" for r in some) for some, what in ((few, ""), (many, ""), (many, "projected_"))]
    soft = [r for r in read_table("results", ROWS) if (r["engine"], r["settings"]) == ("mujoco", "default")]
    return [
        f"`minimal`, one explicit equation for one degree of freedom, is faster on all {len(minimal)} linkages that it runs on, "
        f"and `by_hand`, equations derived by hand in C, on {sum(x < 1 for x in by_hand)} of {len(by_hand)};",
        f"a step of `gauss` in numpy takes {between(list(steps.values()))} times as long as one of `lagrange`;",
        f"n - m unknowns against n + m, compiled alike, are faster beyond their spread on {won[0]} of {len(few)} linkages with "
        f"one free coordinate, on {won[1]} of {len(many)} with more, and with projection on {won[2]} of those.",
        f"Of MuJoCo's cases with its loops as shipped, {sum(bool(r['valid']) for r in soft)} of {len(soft)} may be used.",
    ]


def unwrapped(text: str) -> str:
    return " ".join(text.split())


def test_the_first_screen_says_what_the_rows_say(page: str) -> None:
    screen = page[: page.index("## Install")]
    assert [x for x in screen.splitlines() if x.startswith("| `")] == results()
    assert all(sentence in unwrapped(screen) for sentence in losses())
    assert len(screen.splitlines()) < 45


def test_every_verb_is_in_one_table(page: str) -> None:
    assert re.findall(r"^\| `([a-z]+)` \| [^|]+ \|$", page[page.index("| `gauss-bench` |") :], re.MULTILINE) == list(VERBS)


def test_what_the_page_links_to_is_there(page: str) -> None:
    for target in re.findall(r"\]\(([^)#:]+)\)", page):
        assert target.startswith("../../actions/") or (ROOT / target).exists(), target
