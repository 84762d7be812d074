"""The page that searches the site and the documentation: a list of all headings, of which a script shows the matching ones."""

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from markupsafe import Markup

from gauss_bench.report.site.page import Page, plain_page

HEADING = re.compile(r'<h[2-4] id="([^"]+)">(.*?)</h[2-4]>', re.DOTALL)
INDEX = "search/search_index.json"  # file of the documentation with its headings and the keys of the grammar


def search_page(pages: Sequence[Page], guide: Path) -> Page:
    """Return the search page; `guide` is the folder of the documentation, which need not exist."""
    entries = []  # (address, text) of all pages and headings
    for page in pages:
        headings = HEADING.findall(str(page.body))
        entries.append((page.file, page.title))
        entries += [(f"{page.file}#{anchor}", f"{page.title}: {Markup(words).striptags()}") for anchor, words in headings]
    if (guide / INDEX).is_file():
        headings = json.loads((guide / INDEX).read_text(encoding="utf-8"))["docs"]
        entries += [(f"{guide.name}/{x['location']}", f"Guide: {Markup(x['title']).striptags()}") for x in headings]
    lead = "All pages and headings of this site and its documentation; type words to narrow the list."
    page = plain_page("search", "Search", lead, "Search", headings=list(dict.fromkeys(entries)))
    return replace(page, scripts=("search.js",))
