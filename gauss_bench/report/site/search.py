"""The page that searches the site and the documentation: a list of headings, of which a script shows those that match."""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from markupsafe import Markup

from gauss_bench.report.site.page import Page, plain_page

HEADING = re.compile(r'<h[2-4] id="([^"]+)">(.*?)</h[2-4]>', re.DOTALL)
INDEX = "search/search_index.json"  # file of the documentation with its headings and the keys of the grammar


def search_page(pages: Sequence[Page], guide: Path) -> Page:
    """Return the search page; `guide` is the folder of the documentation, which need not exist."""
    found = list(dict.fromkeys((*page_headings(pages), *guide_headings(guide))))
    lead = "All pages and headings of this site and its documentation; type words to narrow the list."
    return replace(plain_page("search", "Search", lead, "Search", found=found), scripts=("search.js",))


def page_headings(pages: Sequence[Page]) -> Iterator[tuple[str, str]]:
    """Yield (address, text) of all pages and of their headings."""
    for page in pages:
        yield page.file, page.title
        for anchor, words in HEADING.findall(str(page.body)):
            yield f"{page.file}#{anchor}", f"{page.title}: {Markup(words).striptags()}"


def guide_headings(guide: Path) -> Iterator[tuple[str, str]]:
    """Yield (address, text) of the documentation's headings; nothing if it was not built."""
    if (guide / INDEX).is_file():
        for entry in json.loads((guide / INDEX).read_text(encoding="utf-8"))["docs"]:
            yield f"{guide.name}/{entry['location']}", f"Guide: {Markup(entry['title']).striptags()}"
