"""README: every number of its first screen is computed from the stored rows, by other code than that of the report."""

import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from xml.etree import ElementTree

import pytest

from gauss_bench.api.options import VERBS
from gauss_bench.engines import AUTHORED
from gauss_bench.report.first_table import renew
from gauss_bench.report.pictures import FOLDER, write_pictures
from gauss_bench.report.rows import Run
from gauss_bench.report.words import length_text
from gauss_bench.tables import read_table
from tests.published import published

ROOT = Path(__file__).parents[1]
ROWS = ROOT / "reports"


@pytest.fixture(scope="module")
def page():
    return (ROOT / "README.md").read_text(encoding="utf-8")


def three(x):
    return f"{x:#.3g}" if x < 100 else f"{x:.0f}"


def between(values):
    low, high = three(min(values)), three(max(values))
    return low if low == high else f"{low} to {high}"


def seconds():
    """Return linkage -> engine, for Pinocchio with its loop -> time [s] of the engine's cheapest setting within 1e-6 m."""
    times = defaultdict(dict)
    for r in read_table("search_winners", ROWS):
        if (r["required"], r["accuracy"], r["status"]) == ("position", 1e-6, "ok"):
            loop = (", compiled" if r["settings"].startswith("compiled") else ", called from Python") * (r["engine"] == "pinocchio")
            times[r["mechanism"]][r["engine"] + loop] = r["seconds"]
    return times


def multiples():
    """Return engine and its loop -> the range of its multiples of the fastest engine, in words."""
    found = defaultdict(list)
    for times in seconds().values():
        for engine, x in times.items():
            found[engine].append(x / min(times.values()))
    return {engine: between(x) for engine, x in found.items()}


def losses():
    """Return the sentences on the comparisons that the suite's own formulations lose."""
    natives = {x: min(v for k, v in y.items() if k in ("gauss-native", "lagrange-native")) for x, y in seconds().items()}
    minimal, by_hand = ([y[e] / natives[x] for x, y in seconds().items() if e in y] for e in ("minimal", "by_hand"))
    assert max(minimal) < 1
    timed = defaultdict(dict)  # engine -> linkage -> time of a step over that of `gauss`
    for r in read_table("results", ROWS):
        if (r["integrator"], r["stabilization"]) == ("rk4", "none") and r["step_ratio"] > 0:
            timed[r["engine"]][r["mechanism"]] = r["step_ratio"]
    pinv, lagrange = timed["gauss_pinv"], timed["lagrange"]
    formula = [pinv[x] / lagrange[x] for x in pinv if x in lagrange]
    claim = [r for r in read_table("kernel_claim", ROWS) if r["status"] == "ok"]
    few, many = ([r for r in claim if (r["unknowns_gauss"] == 1) is one] for one in (True, False))
    won = [sum(r[f"{what}verdict"] == "holds" for r in some) for some, what in ((few, ""), (many, ""), (many, "projected_"))]
    soft = [r for r in read_table("results", ROWS) if (r["engine"], r["settings"]) == ("mujoco", "default")]
    return [
        f"is faster than both compiled formulations on all {len(minimal)} linkages that it runs on. `by_hand`, equations derived "
        f"by hand in C, is faster on {sum(x < 1 for x in by_hand)} of {len(by_hand)}.",
        f"`gauss_pinv`, takes {between(formula)} times as long as one of `lagrange`, both in numpy.",
        f"A step of `gauss` in numpy takes {between([1 / x for x in lagrange.values()])} times as long as one of `lagrange`.",
        f"n - m unknowns are faster than n + m beyond the spread on {won[0]} of {len(few)} linkages with one free coordinate, on "
        f"{won[1]} of {len(many)} with more, and with projection on {won[2]} of those.",
        f"MuJoCo has {sum(bool(r['valid']) for r in soft)} usable cases of {len(soft)} in the suite `full`.",
    ]


def test_numbers_of_the_first_screen_follow_from_the_rows(page):
    screen = page[: page.index("## Install")]
    lines = [x.strip("| ").split(" | ") for x in screen.splitlines() if x.startswith("| ")][2:]
    told = {x[0].removesuffix(" (own)"): x[-1] for x in lines}
    assert multiples().items() <= told.items()
    assert told.keys() - multiples().keys() <= {"pinocchio, called from Python"}, "a dearer loop has times, and wins nothing"
    assert {x[0].removesuffix(" (own)") for x in lines if "(own)" in x[0]} == {*AUTHORED} & multiples().keys()
    assert all(sentence in " ".join(screen.split()) for sentence in losses())
    assert len(screen.splitlines()) < 45


def test_the_first_table_is_what_publishing_writes(page):
    assert renew(page, published()) == page, f"renew it: python -m gauss_bench.report.pictures {ROWS} README.md"


def test_pictures_are_made_from_the_rows_and_are_small(page, tmp_path):
    made = write_pictures(published(), tmp_path)
    for path in made:
        assert path.read_bytes() == (ROOT / FOLDER / path.name).read_bytes(), f"{path.name}: renew it, as the first table"
        assert f"]({FOLDER}/{path.name})" in page
        text = path.read_text(encoding="utf-8")
        ElementTree.fromstring(text)
        assert "prefers-color-scheme:dark" in text
        assert "<script" not in text
        assert "http" not in text.replace("http://www.w3.org/2000/svg", "")
    assert sum(x.stat().st_size for x in (ROOT / FOLDER).iterdir()) < 300e3


def test_lengths_have_a_unit():
    assert [length_text(x) for x in (1.5, 5.9e-4, 1.6e-7, 2e-9)] == ["1.5 m", "0.59 mm", "0.16 µm", "2 nm"]


@pytest.mark.long("diagnose")
@pytest.mark.slow
@pytest.mark.parametrize("verb", ["show", "diagnose"])
def test_commands_print_what_the_page_shows(page, verb):
    """Figures are not compared. `recommend` is left out, because it takes long and its figures are those of a race."""
    block = page[page.index("## Three commands") :].split("```")[1].split("$ gauss-bench ")[1:]
    shown = {x.split()[0]: x.splitlines() for x in block}[verb]
    done = subprocess.run(
        [sys.executable, "-m", "gauss_bench", *shown[0].split()], capture_output=True, text=True, check=True, cwd=ROOT
    )
    told, printed = (
        [re.sub(r"[\d.]+(e-\d+)?( [num]?s)?\b", "#", x.rstrip()) for x in y] for y in (shown[1:], done.stdout.splitlines())
    )
    assert {*told} - {"", "..."} <= {*printed}, done.stdout


def test_runs_that_recorded_no_own_engines_had_those_of_their_time():
    assert {"gauss", "gauss-native", "lagrange-native", "minimal", "by_hand"} <= set(Run().own_engines) <= set(AUTHORED)
    assert Run({"own_engines": ["x"]}).own_engines == ("x",)


def test_every_verb_is_in_one_table(page):
    assert re.findall(r"^\| `([a-z-]+)` \| [^|]+ \|$", page[page.index("| `list` |") :], re.MULTILINE) == list(VERBS)


def test_links_of_the_page_lead_to_files(page):
    for target in re.findall(r"\]\(([^)#:]+)\)", page):
        assert target.startswith("../../actions/") or (ROOT / target).exists(), target


MAP = ROOT / "gauss_bench/README.md"


def test_the_map_names_files_that_exist_and_each_once():
    named = re.findall(r"`((?:gauss_bench|mechanisms)/[\w/.]+)`", MAP.read_text())
    assert len(named) > 20
    assert [x for x in named if not (ROOT / x).is_file()] == []
    assert [x for x in set(named) if named.count(x) > 1] == []


def test_every_room_has_a_line_among_at_most_fourteen(page):
    table = page[page.index("| rooms of `gauss_bench/`") :].split("\n\n")[0].splitlines()[2:]
    assert len(table) <= 14
    named = [x for line in table for x in re.findall(r"`(\w+)/`", line.split("|")[1])]
    rooms = {x.parent.name for x in (ROOT / "gauss_bench").glob("*/__init__.py")}
    assert sorted(named) == sorted(rooms | {"docs"})
