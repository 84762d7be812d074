"""The documentation: its examples run, it has every key and verb, and it is built without requests to other machines."""

import json
import os
import re
import shlex
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import pytest

from gauss_bench.api.options import VERBS
from gauss_bench.cli import main
from gauss_bench.docs import pages_from_code
from gauss_bench.docs.grammar_index import heading_of, list_keys, write_index
from gauss_bench.linkage import schema
from gauss_bench.report.site.page import plain_page, render_page
from gauss_bench.report.site.search import search_page
from gauss_bench.report.site.write import asset_files
from gauss_bench.verbs.formats import find_schema, list_formats
from tests.conftest import DOCUMENTATION, needs
from tests.published import build_guide, watch

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "gauss_bench" / "docs"
PAGES = sorted((DOCS / "pages").glob("*.md"), key=lambda p: (p.name != "tutorial.md", p.name))
FENCE = re.compile(r"(?:<!-- ([^>]*?) -->\n)?```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)```", re.DOTALL)


class Block(NamedTuple):
    remark: str
    language: str
    title: str
    text: str


def blocks(text):
    return (Block(*found) for found in FENCE.findall(text))


def written(block, folder):
    """Save a block of a page as the file that its title names."""
    text = re.sub(r'--8<-- "([^"]+)"', lambda x: (DOCS / "pages" / x[1]).read_text(encoding="utf-8"), block.text)
    if block.remark.startswith("added to"):
        whole = (folder / block.remark.split()[2].rstrip(",")).read_text(encoding="utf-8").replace("linkage/1", "linkage/2")
        name = Path(block.title).stem
        whole = whole.replace('name   = "rocker"', f'name   = "{name}"')
        text = whole.replace('["motor", "brake"]', f'["motor", "brake", "{name}"]') + text
    path = folder / block.title
    path.parent.mkdir(parents=True, exist_ok=True)
    before = path.read_text(encoding="utf-8") if block.remark == "appended" else ""
    path.write_text(before + text, encoding="utf-8")


NUMBER = re.compile(r"[+-]?\b\d+(?:\.\d+)?(?:e[+-]?\d+)?\b")


def is_same(shown, printed):
    """Tell whether two lines have equal words and whole numbers, and decimals that differ by at most 1 in the last digit shown."""
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", printed).split():
        return False
    pairs = [(Decimal(x), Decimal(y)) for x, y in zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)]
    exponents = [int(x.as_tuple().exponent) for x, _ in pairs]  # of the last digit shown, 0 for a whole number
    return all(abs(x - y) <= (Decimal(1).scaleb(k) if k else 0) for (x, y), k in zip(pairs, exponents, strict=True))


def check_printed(shown, printed):
    """Check that each line that a page shows, except "...", is among the printed lines."""
    for line in filter(lambda x: x.strip() not in ("", "..."), shown.splitlines()):
        assert any(is_same(line, x) for x in printed.splitlines()), f"the page shows {line!r}; this was printed:\n{printed}"


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Return a folder with the files of the tutorial."""
    folder = tmp_path_factory.mktemp("reader")
    for block in blocks((DOCS / "pages" / "tutorial.md").read_text(encoding="utf-8")):
        if block.title:
            written(block, folder)
    return folder


@pytest.mark.long("cylinder", "engine", "settings", "tutorial")
@pytest.mark.slow
@pytest.mark.parametrize("page", [x for x in PAGES if x.name != "commands.md"], ids=lambda p: p.stem)
def test_every_example_runs(page, place, monkeypatch, capsys):
    monkeypatch.chdir(place)
    templates = [str(place / "my_engine"), str(DOCS / "pages" / "template" / "trees")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([*templates, str(ROOT)]))
    for folder in templates:
        monkeypatch.syspath_prepend(folder)
    carry_out(page.read_text(encoding="utf-8"), place, capsys)


def verbs_and_examples():
    """Return heading -> text of each section of the page of commands."""
    parts = re.split(r"^## (.+)\n", (DOCS / "pages" / "commands.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def test_every_verb_has_an_example():
    examples = verbs_and_examples()
    assert list(examples) == list(VERBS)
    for verb, text in examples.items():
        commands = [line for block in blocks(text) if block.language == "sh" for line in block.text.splitlines()]
        assert any(line.split()[:2] == ["gauss-bench", verb] for line in commands), f"no example of {verb}"


# verbs whose examples take long have tests of their own
@pytest.mark.long("atlas", "check", "conformance", "doctor", "export", "recommend", "run", "sweep", "tune", "verify")
@pytest.mark.parametrize("verb", [x for x in VERBS if x not in ("studio", "releases", "report", "certify")])
def test_the_example_of_a_verb_runs(verb, tmp_path, monkeypatch, capsys):
    """The example of `report` uses the rows of that of `run`, and the example of `verify` the certificate of that of `certify`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    for name in {"run": ("run", "report"), "verify": ("certify", "verify")}.get(verb, (verb,)):
        carry_out(verbs_and_examples()[name], tmp_path, capsys)


def carry_out(text, folder, capsys):
    """Save the files of a page, run its commands and Python code in order, and compare their output with the page."""
    printed = ""
    for block in blocks(text):
        if block.remark.startswith("needs"):
            needs(block.remark.split()[1])
        if block.title:
            written(block, folder)
        elif block.remark == "printed":
            check_printed(block.text, printed)
        elif block.language == "python":
            exec(compile(block.text, "<page>", "exec"), {})
            printed = capsys.readouterr().out
        elif block.language == "sh":
            printed = run_commands(block, capsys)
        else:
            assert block.language == "text", f"a block that nobody runs: {block.language}"


def run_commands(block, capsys):
    """Run the commands of a block and return their output; their exit code must be that in the remark of the block, or 0."""
    code = int(block.remark.removeprefix("exit code")) if block.remark.startswith("exit code") else 0
    printed = ""
    for line in block.text.splitlines():
        program, *arguments = shlex.split(line)
        assert program == "gauss-bench"
        ended = main(arguments)
        got = capsys.readouterr()
        assert ended == code, f"{line}: {got}"
        printed += got.out + got.err
    return printed


def tables_of(document):
    """Return name of a class -> properties, for all tables of a JSON Schema."""
    definitions = document.pop("$defs")
    return {name: x["properties"] for name, x in {document["title"]: document, **definitions}.items()}


LINES = (
    '| <a id="gravity"></a>`gravity` | [number, number] | m/s² | `[0.0, -9.81]` | 1 |',
    '| <a id="scenarios.hold"></a>`hold` | [link or joint, ...] |  | - | 2 |',
    '| <a id="cylinders.barrel.length"></a>`length` | number > 0 | m | required | 2 |',
    '| <a id="scenarios.start.slides"></a>`slides` | start slide → number | m | - | 1 |',
    '| <a id="ground.points.from"></a>`from` | text |  | - | 1 |',
    '| <a id="forces.joint_damping.c"></a>`c` | number >= 0 | N m s/rad or N s/m | required | 1 |',
    "## `scenarios.NAME.driver` and `scenarios.NAME.drivers[]`, law `constant` { #table.scenarios.driver.constant }",
)


def test_the_index_has_every_key_of_the_grammar_once_with_type_unit_default_and_edition():
    expected = {(name, key) for name, keys in tables_of(schema.LinkageTable.model_json_schema()).items() for key in keys}
    indexed = [(entry.table.__name__, key) for entry, key, _ in list_keys()]
    assert len(indexed) == len(set(indexed))
    assert set(indexed) == expected
    addresses = [address for _, _, address in list_keys()]
    page = write_index()
    assert re.findall(r'^\| <a id="([^"]+)"></a>`', page, re.MULTILINE) == addresses
    anchors = addresses + re.findall(r"\{ #(\S+) \}", page)
    assert len(anchors) == len(set(anchors))
    assert {*LINES} <= {*page.splitlines()}


def test_every_number_of_the_grammar_has_a_unit_that_its_explanation_names():
    guide = pages_from_code.write_grammar()
    sections = {x.splitlines()[0]: x for x in re.split(r"^### ", guide, flags=re.MULTILINE)}
    definitions = tables_of(schema.LinkageTable.model_json_schema())
    for entry, key, address in list_keys():
        has_numbers = '"number"' in json.dumps(definitions[entry.table.__name__][key])
        assert has_numbers == (key in entry.table.units), f"{address}: numbers have a unit, and nothing else has one"
        section = sections[heading_of(entry.places[0])]
        assert re.search(rf"\b{key}\b", section), f"{address} is not explained in {heading_of(entry.places[0])!r}"
        for unit in re.split(", | or ", entry.table.units.get(key, "1")):
            assert unit == "1" or unit in section, f"{address}: its explanation does not name the unit {unit}"


def test_the_pages_have_every_force_and_every_verb_and_name_files_that_exist():
    assert set(schema.FORCES) <= set(re.findall(r"`(\w+)`", pages_from_code.write_grammar()))
    page = pages_from_code.write_commands((DOCS / "pages" / "commands.md").read_text(encoding="utf-8"))
    assert all(f"## {name}\n" in page and f"usage: gauss-bench {name} " in page for name in VERBS)
    assert all(f"[{name}](formats/{name}.json)" in pages_from_code.write_formats() for name in list_formats())
    for path in PAGES:
        for name in re.findall(r"`((?:gauss_bench|tests|mechanisms)/[\w/.]+\.\w+)`", path.read_text(encoding="utf-8")):
            assert (ROOT / name).exists(), f"{path.name}: {name}"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return the folder of a site with one page, its search page, and the documentation."""
    folder = tmp_path_factory.mktemp("site")
    build_guide(folder / "docs")
    pages = [plain_page("method", "Method", "How runs are compared.")]
    pages.append(search_page(pages, folder / "docs"))
    texts = asset_files() | {page.file: render_page(page, pages, (), "docs/index.html") for page in pages}
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@pytest.mark.slow
def test_the_documentation_builds_and_loads_nothing_from_other_machines(site):
    assert sum(x.stat().st_size for x in (site / "docs").rglob("*") if x.is_file()) < DOCUMENTATION
    for name in list_formats():
        assert json.loads((site / "docs" / "formats" / f"{name}.json").read_text(encoding="utf-8")) == find_schema(name)
    built = list((site / "docs").rglob("*.html"))
    assert {x.stem for x in PAGES} <= {x.stem for x in built}
    for page in built:
        text = page.read_text(encoding="utf-8")
        asked = re.findall(r"<(?:link|script|img|iframe)\b[^>]*?(?:src|href)=\"?((?:https?:)?//[^\"> ]+)", text)
        assert not [x for x in asked if "canonical" not in x], f"{page.name}: {asked}"


@pytest.mark.slow
def test_the_search_box_of_a_page_finds_keys_verbs_and_pages_without_a_network(browser, site):
    context = browser.new_context(offline=True)
    page = context.new_page()
    wrong = watch(page, "file:")
    page.goto((site / "docs" / "drift.html").as_uri())
    page.get_by_role("search").get_by_role("searchbox").fill("kg_per_m links")
    page.keyboard.press("Enter")
    page.wait_for_url("**/search.html?ask=*")
    found = page.locator(".found li:visible")
    assert found.all_inner_texts() == ["Guide: Index of keys: links.NAME.kg_per_m"]
    found.get_by_role("link").click()
    row = page.locator("tr", has=page.locator("[id='links.kg_per_m']"))
    assert "kg/m" in row.inner_text()
    page.goto((site / "search.html").as_uri())
    listed = {"kinematics command": "Guide: Commands: kinematics", "simulate --tolerance": "Guide: Commands: simulate --tolerance"}
    for words, entry in (listed | {"method": "Method"}).items():
        page.fill("#ask", words)
        assert entry in found.all_inner_texts()
    page.fill("#ask", "no such word")
    assert found.count() == 0
    assert not wrong
    context.close()
