"""The site in a browser, from a folder and under an address; and its numbers, computed from the rows a second time."""

import functools
import http.server
import json
import math
import re
import shutil
import threading
from html import unescape
from itertools import combinations, product
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest
from markupsafe import Markup

from gauss_bench.bench.runner import own_files
from gauss_bench.cli import main
from gauss_bench.report.build import build_report
from gauss_bench.report.content import UNMEASURED, Cell, Table, make_cell
from gauss_bench.report.palette import DARK, ENGINES, HUES, PAPER, SHAPES, assign_hues
from gauss_bench.report.rows import Run
from gauss_bench.report.sections import field
from gauss_bench.report.site.engine import engine_page, explain_time, runs_of_engines
from gauss_bench.report.site.first import CARDS, HOLDS, pack_lines
from gauss_bench.report.site.formulas import is_formula, mathml
from gauss_bench.report.site.linkage import linkage_page
from gauss_bench.report.site.page import ENVIRONMENT, HEADLINE, headline, rich, script_text, sentence_of, short_label
from gauss_bench.report.site.settings import all_settings, cheapest_stored, describe_setting
from gauss_bench.suites.read import read_suite, restrict
from tests.conftest import DOCUMENTATION
from tests.published import REPORTS, build_guide, published, published_findings, watch


def copied(folder):
    """Copy the published rows into a folder, and return their folder there."""
    return shutil.copytree(REPORTS, folder / "run", ignore=shutil.ignore_patterns("site", "local", ".run"))


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = copied(tmp_path_factory.mktemp("published"))
    build_report(folder)
    return folder


# Numbers, a second way


def table(name):
    """Return a published table with its times, as pandas reads it."""
    places = [folder / f"{name}.{kind}" for folder in (REPORTS, REPORTS / "times") for kind in ("csv", "parquet")]
    reads = {".csv": lambda p: pd.read_csv(p, keep_default_na=False, na_values=[""]), ".parquet": pd.read_parquet}
    frames = [reads[p.suffix](p) for p in places if p.exists()]
    rows = frames[0]
    for more in frames[1:]:
        rows = rows.merge(more, on=[c for c in more.columns if c in rows.columns], how="left")
    return rows


def test_every_number_of_the_cards_follows_from_the_published_files():
    run = published()
    said = {card["question"]: card for make in CARDS if (card := make(run)) is not None}
    results = table("results")
    fine = results[results.status.isin(["ok", "invalid"]) & ~results.control.astype(bool) & (results.settings == "default")]
    fine = fine[fine.stabilization.fillna("").isin(["none", ""]) & np.isclose(fine.step, 1e-3) & fine.position_drift.notna()]
    best = fine.groupby(["engine", "integrator"]).position_drift.max().groupby("engine").min()
    loops = said["Do loops hold by default?"]
    assert loops["number"] == f"{(best <= HOLDS).sum()} of {len(best)}"
    assert f"`{best.idxmax()}`, opens one by {best.max():.1e}" in loops["sentence"]

    audit = table("audit")
    paper = said["Is the paper right?"]
    assert paper["number"] == f"{(audit.verdict == 'ok').sum()} of {len(audit)}"
    assert f"and {(audit.verdict == 'wrong').sum()} wrong" in paper["sentence"]

    claim = table("kernel_claim").dropna(subset=["ratio"])
    card = said["Gauss or Lagrange?"]
    faster, slower, level = map(int, re.findall(r"on (\d+)", card["sentence"]))
    assert (faster, slower) == ((claim.ratio_low > 1).sum(), (claim.ratio_high < 1).sum())
    assert faster + slower + level == len(claim)
    assert float(card["number"]) == pytest.approx(claim.ratio.median(), abs=0.005)

    digits = table("certificates").query("status == 'ok'").digits
    assert said["Why trust this?"]["number"] == f"{digits.min():g}"
    assert f"{len(digits)} scenarios" in said["Why trust this?"]["sentence"]


def test_a_race_at_the_same_accuracy_replaces_the_estimate():
    run = published()
    winners = table("search_winners").query("required == 'position' and status == 'ok'")
    for row in winners.dropna(subset=["seconds"]).itertuples():
        one = cheapest_stored(run, row.mechanism, row.accuracy)[row.engine]
        assert one.seconds == pytest.approx(row.seconds, rel=1e-6)
        assert one.settings == row.settings


def test_the_costs_of_the_field_follow_from_its_files_and_every_engine_of_an_environment_has_a_page():
    run = published()
    folder = REPORTS / "field"
    times, rows = (
        pd.read_csv(folder / place, keep_default_na=False, na_values=[""]) for place in ("times/search_winners.csv", "field.csv")
    )
    times = times[(times.required == "position") & times.seconds.notna()]
    lines = {line["engine"]: line for line in field.list_costs(run)}
    apart = {name for name, known in run.beside.environment["engines"].items() if known.get("environment")}
    assert {"bullet", "dart", "drake", "mjx", "opensim"} <= apart < {*lines} == {*rows.engine}
    for key, limit in field.ACCURACIES.items():
        seconds = times[np.isclose(times.accuracy, limit, rtol=1e-6)].set_index("engine").seconds
        assert {name: line[key] for name, line in lines.items() if math.isfinite(line[key])} == seconds.to_dict()
    pages = runs_of_engines(run)
    for name in apart:
        assert pages[name] is run.beside
        body = engine_page(run, name).body
        assert re.search(rf"gauss-bench simulate \w+ --scenario torque --engine {name} --settings \S", body)
        assert f"gauss-bench engines install {name}" in body


# Colours


def linear(colour):
    x = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


# Ottosson (2020), Oklab: linear sRGB to cone responses, and their cube roots to a space in which a distance of 0.02 is just seen
TO_CONES = [[0.412221, 0.536333, 0.051446], [0.211903, 0.680700, 0.107397], [0.088302, 0.281719, 0.629979]]
TO_LAB = [[0.210454, 0.793618, -0.004072], [1.977998, -2.428592, 0.450594], [0.025904, 0.782772, -0.808676]]
LUMINANCE = [0.2126729, 0.7151522, 0.0721750]
VISIONS = {  # Machado, Oliveira and Fernandes (2009), severity 1
    "usual": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
}


@pytest.mark.parametrize("dark", [False, True])
def test_colours_of_engines_differ_for_the_colour_blind_and_are_legible(dark):
    colours = np.array([linear(pair[dark]) for pair in HUES.values()])
    for name, matrix in VISIONS.items():
        seen = np.cbrt(np.clip(colours @ np.transpose(matrix), 0, 1) @ np.transpose(TO_CONES)) @ np.transpose(TO_LAB)
        least = min(np.linalg.norm(a - b) for a, b in combinations(seen, 2))
        assert least > 0.05, f"{name}: two engines are only {least:.3f} apart"
    light = [float(LUMINANCE @ c) for c in (*colours, linear((PAPER, DARK["paper"])[dark]))]
    paper = light.pop()
    assert all((max(x, paper) + 0.05) / (min(x, paper) + 0.05) >= 3 for x in light)


def test_engines_of_a_figure_share_neither_colour_nor_marker():
    engines = [*list(HUES)[:7], "mine", "yours"]
    assert len(set(assign_hues(engines).values())) == len(engines)
    assert len(set(SHAPES)) == len(SHAPES) >= len(HUES)
    assert len(set(ENGINES.values())) == len(ENGINES)


# Words


def test_a_setting_is_in_the_engines_own_words():
    run = published()
    every = (x for settings in all_settings(run).values() for x in settings)
    rigid = next(x for x in every if x.engine == "mujoco" and x.settings == "rigid_slower/[0.05, 1.0]/1")
    said = describe_setting(run, rigid)
    assert said.startswith("RK4, ")
    assert "solref 0.05 1" in said
    assert "iterations 1" in said
    assert "body_invweight0_factor 1e-06" in said
    assert "jacobian" not in said, "as shipped"
    assert describe_setting(Run(), rigid) == rigid.words


def test_each_finding_is_one_sentence_and_opens_rows_with_the_same_numbers():
    for one in published_findings():
        said = sentence_of(one)
        assert len(headline(one.text)) <= HEADLINE + 1
        cells = [cell.text for table in one.behind for row in table.rows for cell in row]
        assert cells, f"{one.title}: no rows"
        assert len(re.findall(r"[.!?](?= [A-Z`])", said)) == 0, said
        figures = re.findall(r"\d+(?:\.\d+)?e-?\d+|\d+\.\d+", said)
        assert not [x for x in figures if not any(x in cell for cell in cells)], said
    counted = {x.title: (int(sentence_of(x).split()[0]), x) for x in published_findings() if sentence_of(x)[0].isdigit()}
    for title in ("Failed cases", "Ran, but not valid"):
        number, one = counted[title]
        assert number == len(one.behind[0].rows)
    (targets,) = (x for x in published_findings() if x.title == "Targets of the kernel")
    rows = targets.behind[0].rows
    missed = sum(row[-1].text == "no" for row in rows)
    start = f"{missed} of {len(rows)} targets" if missed else f"All {len(rows)} targets"
    assert sentence_of(targets).startswith(start)
    assert headline(f"7 of 9 fail: {'x, ' * 200}y.") == "7 of 9 fail."
    assert headline(f"Slower than `a` ({'x, ' * 100}) on b 0.5. It is.") == "Slower than `a` on b 0.5."


def test_a_long_cell_opens_from_a_short_label_and_no_cell_is_empty():
    long = f"not reached in 400 steps: {'because ' * 20}"
    page_table = ENVIRONMENT.get_template("blocks.html").module.table
    dashes = (Cell("-", why="no target"), Cell("-", why=long))
    made = str(page_table(Table("t", ("a", "b"), ((Cell(long), Cell("1")), (Cell("https://x.org/a"), Cell("")), dashes))))
    assert "<summary>not reached in 400 steps</summary>" in made
    assert "<td><small>- not measured</small>\n" in made
    assert "<td><small>- no target</small><td>" in made
    assert "<td><details><summary>- not reached in 400 steps</summary>" in made
    assert '<a href="https://x.org/a">x.org</a>' in made
    assert 'td:nth-child(2)::before{content:"b"}' in made
    assert short_label("word " * 30) == f"{'word ' * 8}..."


FORMULAS = {
    "J^-1": "<msup><mi>J</mi><mrow><mo>-</mo><mn>1</mn></mrow></msup>",
    "x1'": "<msup><msub><mi>x</mi><mn>1</mn></msub><mrow><mo>\N{PRIME}</mo></mrow></msup>",
    "th1^2": "<msup><msub><mi>θ</mi><mn>1</mn></msub><mrow><mn>2</mn></mrow></msup>",
    "M^(1/2)": "<msup><mi>M</mi><mrow><mn>1</mn><mo>/</mo><mn>2</mn></mrow></msup>",
    "J^- = <": "<msup><mi>J</mi><mrow><mo>-</mo></mrow></msup></math> <math><mo>=</mo><mspace></mspace><mo>&lt;</mo>",
}


def test_formulas_are_typeset_and_text_with_words_is_none():
    for text, made in FORMULAS.items():
        plain = str(mathml(text)).replace(' stretchy="false"', "").replace(' width="0.2em"', "").replace("\N{MINUS SIGN}", "-")
        assert plain == f"<math>{made}</math>"
    assert not is_formula("both as printed")
    assert not is_formula("J as printed, all entries but (6, 6)")
    assert is_formula("a = J^- g + (I - J^- J) h")
    assert sum(is_formula(str(r["printed"])) for r in published().table("audit")) > 30


def test_why_an_engine_takes_so_long_is_steps_times_time_of_a_step():
    run = published()
    said, shown = explain_time(run, "exudyn") or ("", None)
    assert "times as many steps" in said
    for row in shown.rows:
        whole, steps, each = (float(cell.sort) for cell in row[2:5])
        assert whole == pytest.approx(steps * each)
        assert whole > 1
    whole, steps, each = (math.exp(sum(math.log(float(row[i].sort)) for row in shown.rows) / len(shown.rows)) for i in (2, 3, 4))
    assert list(map(float, re.findall(r"([\d.]+) (?=times)", said))) == pytest.approx([whole, steps, each], rel=5e-3)
    assert explain_time(Run(), "exudyn") is None


# Files


def test_text_of_files_stays_text():
    hostile = "</script><img src=x onerror=alert(1)>`<b>`**<i>**\u2028"
    assert "<" not in script_text({hostile: hostile})
    assert json.loads(script_text({"x": hostile})) == {"x": hostile}
    assert "<img" not in str(rich(hostile))
    lines = pack_lines(["a\nb", "a\nc"])
    assert ["\n".join(lines["lines"][i] for i in text) for text in lines["texts"]] == ["a\nb", "a\nc"]


def test_a_users_own_linkage_is_drawn_and_turns_from_what_its_run_kept(tmp_path):
    text = (REPORTS.parent / "mechanisms" / "four_bar.toml").read_text(encoding="utf-8").replace('"four_bar"', '"mine"', 1)
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    suite = restrict(read_suite("accuracy"), {str(path): "torque", "crank_slider": "torque"})
    kept = own_files(suite)
    assert kept == {"mine": text}, "the built-in ones are not kept a second time"
    path.unlink()
    page = linkage_page(Run({"linkages": kept}), "mine", "torque")
    assert 'data-link="0"' in page.body
    assert len(page.data["turn"]["poses"]) == 3
    assert "3 moving links" in page.lead
    for damaged in ({}, {"mine": "not ["}, {"mine": 3}, ["mine"]):
        assert "<svg" not in linkage_page(Run({"linkages": damaged}), "mine", "torque").body


def test_a_dash_has_the_reason_of_its_column_or_of_the_run():
    ended, skipped = ({"status": status, "target": math.nan, "error": math.nan} for status in ("ok", "skip"))
    assert make_cell(ended, ".2g", "target").why == make_cell(skipped, ".2g", "target").why == "no target"
    assert make_cell(ended, "error", "error").why == "not measured"
    assert make_cell(skipped, "error", "error").why == "skipped"
    assert make_cell(skipped | {"missing": "not reached"}, "error", "error").why == "not reached"
    assert not make_cell({"error": 1.0}, "error", "error").why


@pytest.mark.slow
def test_every_dash_of_the_published_tables_has_a_reason_that_somebody_wrote(out):
    for page in (out / "site").glob("*.html"):
        cells = re.findall(r"<td[^>]*>(.*?)(?=<td|<tr|</tbody>)", page.read_text(encoding="utf-8"), re.DOTALL)
        bare = [x for x in cells if Markup(x).striptags() in ("", "-", f"- {UNMEASURED}")]
        assert not bare, f"{page.name}: {bare[:3]}"


def check_links(site):
    """Check that every address on the pages of a folder leads to a file, and its anchor to an id there."""
    texts = {p.resolve(): p.read_text(encoding="utf-8") for p in site.rglob("*.html") if p.name != "404.html"}
    anchors = {p: {*re.findall(r"\s(?:id|name)=\"?([^\s\">]+)", text)} for p, text in texts.items()}
    for page, text in texts.items():
        for address in re.findall(r"<(?:a|link|script|img)\b[^>]*?(?:href|src)=\"?([^\s\">]+)", text):
            name, _, anchor = unescape(address).partition("#")
            if re.match(r"[a-z]+:", name):
                continue
            target = (page.parent / unquote(name)).resolve() if name else page
            target = target / "index.html" if target.is_dir() else target
            assert target.is_file(), f"{page.name}: {address}"
            if anchor and "=" not in anchor and target in anchors and not anchor.startswith("__"):
                assert unquote(anchor) in anchors[target], f"{page.name}: {address}"


@pytest.mark.slow
def test_sizes_and_addresses(out):
    site = out / "site"
    assert sum(p.stat().st_size for p in site.rglob("*") if p.is_file()) < 8e6 - DOCUMENTATION
    assert max(p.stat().st_size for p in site.glob("*.html")) < 600e3
    check_links(site)
    for page in site.glob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert "fetch(" not in text
        assert 'type="module"' not in text
        # a screen reader lists regions by their names
        for names in (re.findall(r'\sid="([^"]+)"', text), re.findall(r'role="region" aria-label="([^"]+)"', text)):
            assert len(names) == len(set(names)), f"{page.name}: {sorted({x for x in names if names.count(x) > 1})}"
    assert {"results.csv.xz", "series.parquet", "scaling.csv"} <= {p.name for p in (site / "tables").iterdir()}


# In the browser


@pytest.fixture(scope="module")
def address(out):
    """Serve the site on this machine under an address with a path."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    handler = functools.partial(Quiet, directory=str(out.parent))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/run/site/"
        server.shutdown()


DRAWN = "!document.querySelector('[data-chart]') || document.documentElement.dataset.drawn === 'true'"


def opened(browser, url, first="", **look):
    """Return a page with all figures drawn, and a list of its errors, warnings and requests to other addresses."""
    page = browser.new_page(**({"viewport": {"width": 1440, "height": 900}} | look))
    page.add_init_script(first)
    wrong = watch(page, url.rsplit("/", 1)[0])
    page.goto(url)
    page.wait_for_function(DRAWN, timeout=30_000)
    return page, wrong


BLANK = """[...document.querySelectorAll("table")].filter(t => t.getClientRects().length).flatMap(t => [...t.rows])
  .filter(r => !r.hidden && r.getClientRects().length && !(r.getBoundingClientRect().height > 8
    && [...r.cells].every(x => x.getBoundingClientRect().width > 4 && x.textContent.trim()
      && (x.tagName === "TH" || (getComputedStyle(x).display === "table-cell") !== matchMedia("(max-width: 760px)").matches))))
  .map(r => r.textContent.slice(0, 60))"""  # on a phone a cell is a line of its own under its column's name, elsewhere none is
UNLABELLED = """[...document.querySelectorAll("tbody td")].filter(x => x.getClientRects().length
  && getComputedStyle(x, "::before").content.length < 3).map(x => x.textContent.slice(0, 40))"""
SMALL = """[...document.querySelectorAll("main button, main select, main summary, nav a, nav summary, td a, .card > a")]
  .filter(x => x.getClientRects().length && x.getBoundingClientRect().height < 43.5).map(x => x.outerHTML.slice(0, 80))"""
OPEN = """for (const x of document.querySelectorAll("main details")) x.open = true;
for (const x of document.querySelectorAll("button.more")) x.click();"""  # everything that a reader can open
SMALL_TEXT = """[...document.querySelectorAll("main *")].filter(x => x.childNodes.length && [...x.childNodes].some(y =>
  y.nodeType === 3 && y.data.trim()) && x.getClientRects().length && parseFloat(getComputedStyle(x).fontSize)
  * (x.ownerSVGElement ? Math.hypot(x.getScreenCTM().a, x.getScreenCTM().b) : 1) < 10.99).map(x => x.textContent.slice(0, 30))"""
HIDDEN = "[...document.querySelectorAll('[hidden]')].filter(x => x.getClientRects().length).length"
LOOKS = [("index", 390, "light"), ("linkage-eight_bar", 1440, "dark"), ("engine-mujoco", 390, "dark")]
EVERY_LOOK = [("", *look) for look in product((390, 1440), ("light", "dark"))]  # of all pages, with everything opened


@pytest.mark.parametrize(
    ("name", "width", "scheme"),
    [*(pytest.param(*x, marks=pytest.mark.slow) for x in LOOKS), *(pytest.param(*x, marks=pytest.mark.long) for x in EVERY_LOOK)],
)
def test_a_page_of_a_folder_is_readable_at_any_width_and_axe_finds_nothing(browser, out, name, width, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    look = {"viewport": {"width": width, "height": 800}, "color_scheme": scheme}
    every = sorted((out / "site").glob("*.html"))
    assert len(every) > 30
    for path in every if not name else [out / "site" / f"{name}.html"]:
        page, wrong = opened(browser, path.as_uri(), **look)
        assert page.evaluate("document.documentElement.scrollWidth") <= width, path.stem
        if not name:
            page.evaluate(OPEN)
            page.wait_for_timeout(100)
            assert page.evaluate("document.documentElement.scrollWidth") <= width, f"{path.stem}, all opened"
        assert page.evaluate(BLANK) == [], f"{path.stem}: rows of tables with a cell that shows nothing"
        if width < 760:
            assert page.evaluate(UNLABELLED) == [], path.stem
            assert page.evaluate(SMALL) == [], f"{path.stem}: too small for a finger"
        assert page.evaluate(SMALL_TEXT) == [], path.stem
        assert not page.evaluate(HIDDEN), path.stem
        assert not wrong, f"{path.stem}: {wrong[:3]}"
        faults = [(x["id"], x["nodes"][0]["html"][:160]) for x in axe.run(page).response["violations"]]
        assert not faults, f"{path.stem} {scheme}: {faults}"
        page.close()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the folder of the site that `make docs report` builds, with programs and documentation."""
    folder = copied(tmp_path_factory.mktemp("whole"))
    build_guide(folder / "site" / "docs")
    assert main(["report", "--out", str(folder)]) == 0
    return folder / "site"


@pytest.mark.long
def test_the_site_with_its_documentation_is_small_and_every_link_leads_somewhere(whole):
    assert sum(p.stat().st_size for p in whole.rglob("*") if p.is_file()) < 8e6
    assert 'href="docs/' in (whole / "search.html").read_text(encoding="utf-8")
    check_links(whole)


@pytest.mark.long
@pytest.mark.parametrize(("width", "scheme"), [*product((390, 1440), ("light", "dark"))])
def test_no_page_of_the_documentation_is_wider_than_its_window(browser, whole, width, scheme):
    pages = sorted({*(whole / "docs").glob("*.html")} - {whole / "docs" / "404.html"})  # its addresses begin at the root
    assert len(pages) > 10
    for path in pages:
        look = {"viewport": {"width": width, "height": 800}, "color_scheme": scheme}
        page, wrong = opened(browser, path.as_uri(), **look)
        assert not wrong, f"{path.name}: {wrong[:3]}"
        assert page.evaluate("document.documentElement.scrollWidth") <= width, path.name
        page.close()


def expected_answers():
    """Return question -> text, computed from the rows, that the linked page must contain."""
    rows = table("results").query("mechanism == 'parallelogram' and status == 'ok' and not control")
    exact = rows[rows.valid.astype(bool)].sort_values("measured_error_t2").iloc[0]
    claim = table("kernel_claim").dropna(subset=["ratio"])
    engines = {x for name in ("results", "search_ladder", "search_space") for x in table(name).engine}
    mujoco = cheapest_stored(published(), "four_bar", 1e-4)["mujoco"]
    return {
        "Which settings hold 0.1 mm in MuJoCo?": describe_setting(published(), mujoco),
        "Which engine is most accurate on redundant loops?": f"Most accurate: {exact.engine}",
        "Why is Exudyn slow here?": "Most of this comes from the",
        "Is Gauss faster than Lagrange?": f"faster on {(claim.ratio_low > 1).sum()} of {len(claim)} linkages",
        "Where may this suite be biased?": f"wrote {len(engines & {*published().own_engines})} of its {len(engines)} engines",
    }


@pytest.mark.slow
def test_five_questions_of_the_first_page_lead_to_their_answers(out):
    site = out / "site"
    index = site.joinpath("index.html").read_text(encoding="utf-8")
    links = {Markup(text).striptags(): target for target, text in re.findall(r'<a href="([^"]+)">(.*?)</a>', index, re.DOTALL)}
    for question, answer in expected_answers().items():
        name, _, anchor = links[question].partition("#")
        text = site.joinpath(name).read_text(encoding="utf-8")
        assert f'id="{anchor}"' in text
        seen = " ".join(Markup(re.sub(r"</?code>|</?strong>", "", text)).striptags().split())
        assert " ".join(answer.replace("`", "").split()) in seen, question


WATCHED = """new MutationObserver(() => {
  for (const x of ["answered", "drawn"])
    if (document.documentElement?.dataset[x] && !performance.getEntriesByName(x).length) performance.mark(x);
}).observe(document, {attributes: true, subtree: true});"""


@pytest.mark.slow
def test_a_new_user_finds_mujocos_setting_for_the_eight_bar(browser, out):
    """The answer is there before any figure is drawn, since it needs no large file."""
    page, wrong = opened(browser, (out / "site" / "index.html").as_uri(), first=WATCHED)
    at = {x: page.evaluate("x => performance.getEntriesByName(x)[0].startTime", x) for x in ("answered", "drawn")}
    assert 0 < at["answered"] < at["drawn"]
    page.select_option("#linkage", "eight_bar")
    page.select_option("#position", label="0.1 mm")
    line = page.locator("#answers li", has_text="mujoco")
    expected = cheapest_stored(published(), "eight_bar", 1e-4)["mujoco"]
    assert f"step {float(f'{1e3 * expected.step:.4g}'):g} ms" in line.inner_text()
    line.get_by_role("button", name="Code").press("Enter")
    assert "mujoco" in line.locator("pre").inner_text()
    assert "eight_bar" in line.locator("pre").inner_text()
    page.select_option("#force", label="0.001 N")
    assert page.locator("#answers li.no").count() > 0
    page.reload()
    page.wait_for_function("document.documentElement.dataset.answered")
    assert page.locator("#linkage").input_value() == "eight_bar", "an address does not bring its answer back"
    assert not wrong
    page.close()
    bare = browser.new_context(java_script_enabled=False).new_page()
    bare.goto((out / "site" / "index.html").as_uri())
    assert bare.locator("#answers li").count() >= 5
    bare.close()


@pytest.mark.slow
def test_the_player_moves_and_toggles_hide_lines_under_an_address(browser, address):
    page, wrong = opened(browser, f"{address}linkage-eight_bar.html")
    link = "#turn [data-link='0']"
    before = page.get_attribute(link, "transform")
    page.focus("#turn input[type=range]")
    page.keyboard.press("ArrowRight")
    turned = page.get_attribute(link, "transform")
    assert turned != before, "the slider turns nothing"
    page.click("#turn [data-play]")
    page.wait_for_function("x => document.querySelector(\"#turn [data-link='0']\").getAttribute('transform') !== x", arg=turned)
    page.click("#turn [data-play]")

    lines = "document.querySelectorAll('[data-chart=drift] .mark-line path').length"
    shown = page.evaluate(lines)
    assert 1 < shown <= 6
    page.locator(".toggles[data-for=drift] input:checked").first.uncheck()
    page.wait_for_function(f"{lines} === {shown - 1}")

    row = "document.querySelectorAll('#cases ~ .table tbody tr:not([hidden])').length"
    assert page.evaluate(row) <= 10
    colour = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(colour)
    page.click("#theme")
    assert page.evaluate(colour) != light
    reached = set()
    page.evaluate("document.activeElement.blur()")
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.tagName + (document.activeElement.type || '')"))
    assert {"A", "BUTTONbutton", "INPUTrange", "INPUTcheckbox", "SUMMARY"} <= reached
    assert 1 <= len(re.findall(rb"/Type\s*/Page\b", page.pdf(format="A4"))) <= 4, "printed, it fills more than four sheets"
    assert not wrong
    page.close()
