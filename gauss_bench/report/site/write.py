"""Write the site of a run into a folder; equal rows give equal files, byte for byte.

Pages contain their texts and tables. The data of figures is in classic scripts beside the pages, so that a page opens from a folder
or from any address, without requests to other servers.
"""

import shutil
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path

import vl_convert

from gauss_bench.atomic import write_text
from gauss_bench.report.content import Finding
from gauss_bench.report.field_run import FOLDER as BESIDE
from gauss_bench.report.pages import list_facts
from gauss_bench.report.palette import declare_hues
from gauss_bench.report.rows import Run
from gauss_bench.report.site.chapters import findings_page, kernel_page, method_page, papers_page, releases_page
from gauss_bench.report.site.charts import GRAMMAR, VEGA_LITE
from gauss_bench.report.site.engine import engine_page, engines_page, runs_of_engines
from gauss_bench.report.site.first import Programs, first_page
from gauss_bench.report.site.linkage import linkage_page, rows_page
from gauss_bench.report.site.page import Page, render_page, script_text
from gauss_bench.report.site.search import search_page
from gauss_bench.report.site.settings import scenarios
from gauss_bench.report.site.tables_page import FOLDER, cite_page, data_page, write_data
from gauss_bench.report.site.view import VIEW, view_page

SITE, GUIDE = "site", "docs"  # folder of the site, and in it the folder of the documentation, which `make docs` writes
SCRIPTS = ("theme.js", "site.js", "charts.js", "chooser.js", "player.js", "search.js")


def write_site(out: Path, run: Run, findings: Sequence[Finding] = (), programs: Programs | None = None) -> list[Path]:
    """Write the site of a run to `out`/site, replacing an earlier site, and return the written files."""
    folder = out / SITE
    if (folder / "site.css").is_file():  # only an earlier site is emptied, no other folder; the documentation in it stays
        for old in folder.iterdir():
            if old.is_file():
                old.unlink()
            elif old.name != GUIDE:
                shutil.rmtree(old)
    guide = f"{GUIDE}/index.html" if (folder / GUIDE / "index.html").is_file() else ""
    pages = all_pages(run, findings, programs)
    pages.append(search_page(pages, folder / GUIDE))
    texts = asset_files()
    for page in pages:
        texts[page.file] = render_page(page, pages, page.facts or list_facts(run), guide)
        data = {page.name: dict(page.data)} if page.data else {}
        if page.data.get("charts"):
            data[page.name] |= {"config": GRAMMAR["config"]}
        # `page.later`: further files, which a script of the page loads on demand
        for name, content in (data | dict(page.later)).items():
            texts[f"data/{name}.js"] = f"site.put({script_text(content)});\n"
    for name, text in texts.items():
        write_text(folder / name, text)
    # then the tables of this run and, if there is one, of the run of the suite `field`
    tables = write_data(folder / FOLDER, run.tables)
    tables += write_data(folder / FOLDER / BESIDE, run.beside.tables) if run.beside else []
    return [*(folder / name for name in texts), *tables]


def asset_files() -> dict[str, str]:
    """Return name -> text of the files that every site has."""
    assets = files("gauss_bench.report.site") / "assets"
    texts = {name: (assets / name).read_text(encoding="utf-8") for name in (*SCRIPTS, "THIRD_PARTY.md", "site.css")}
    for mode, is_dark in (("light", False), ("dark", True)):
        texts["site.css"] = texts["site.css"].replace(f"/*{mode}*/", declare_hues(is_dark))
    return texts | {"vega.js": drawing_script(), VIEW: view_page()[0]}  # [0]: the page; [1] is its content security policy


@cache
def drawing_script() -> str:
    """Return Vega, Vega-Lite and Vega-Embed as one classic script that defines only `vegaEmbed`."""
    bundle = str(vl_convert.javascript_bundle("window.vegaEmbed = vegaEmbed;", vl_version=VEGA_LITE))
    return f"(function () {{\n{bundle}\n}})();\n"


def all_pages(run: Run, findings: Sequence[Finding], programs: Programs | None) -> list[Page]:
    """Return all pages in the order of the table of contents."""
    names = scenarios(run)
    pages: list[Page | None] = [
        first_page(run, findings, programs),
        *(linkage_page(run, name, scenario) for name, scenario in names.items()),
        *(rows_page(run, name) for name in names),
        engines_page(run),
        *(engine_page(run, name) for name in runs_of_engines(run)),
        papers_page(run),
        kernel_page(run),
        releases_page(run),
        method_page(run),
        findings_page(findings),
        data_page(run),
        cite_page(run),
    ]
    return [page for page in pages if page is not None]
