"""Name the elements of a model file that cannot be written into a linkage file."""

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

SHOWN = 20  # limit of names in a sentence, and of sentences, which a linkage file of at most 1 MiB repeats
LONGEST = 60  # limit of characters of a name
FIELDS = tomllib.loads((Path(__file__).parent / "mjcf.toml").read_text(encoding="utf-8"))


def list_names(names: Sequence[str]) -> str:
    """Return names as a list in words, followed by the number of names that are not shown and the number of empty names."""
    named = [name if len(name) <= LONGEST else f"{name[:LONGEST]}..." for name in names if name]
    parts = named[:SHOWN]
    if len(named) > SHOWN:
        parts.append(f"{len(named) - SHOWN} more")
    if len(names) > len(named):
        parts.append(f"{len(names) - len(named)} without a name")
    return ", ".join([*parts[:-2], " and ".join(parts[-2:])])


def list_elements(tag: str, names: Sequence[str], reason: str) -> str:
    """Return the sentence on all elements with a tag; if `reason` is not empty, the sentence says why they are left out."""
    return f"<{tag}> {list_names(names)}" + (f": {reason}" if reason else "")


def list_unused(root: Element) -> Iterator[str]:
    """Yield sentences on MuJoCo's settings in an MJCF document, and on elements that do not affect a linkage's motion."""
    for tag, entry in FIELDS["unused"]["settings"].items():
        unused = {key: x for node in root.iter(tag) for key, x in node.items() if key not in entry["used"]}
        if unused:
            values = ", ".join(f"{key} {list_names([x])}" for key, x in unused.items())
            yield f"<{tag}> {values}: {entry['reason']}"
    for tag in ("visual", "statistic", "size"):
        if root.find(tag) is not None:
            yield f"<{tag}>"
    for section, tags in FIELDS["unused"]["sections"].items():
        for tag, reason in tags.items():
            names = [node.get("name", "") for part in root.findall(section) for node in part.iter(tag)]
            if names:
                yield list_elements(tag, names, reason)


def list_ignored(root: Element, used: Mapping[str, Iterable[str]]) -> list[str]:
    """Return at most SHOWN sentences on the tags of a URDF that are not read; `used`: tag that is read -> tags read in it."""
    ignored: dict[str, list[str]] = {}  # tag -> names of its elements, or "of OWNER" for an element without a name

    def collect(node: Element, owner: str) -> None:
        """Add the ignored elements inside a node; `owner` is the name of the innermost named element around them."""
        for child in node:
            tag, name = str(child.tag), child.get("name") or child.get("reference") or ""
            if tag in used.get(str(node.tag), ()):
                collect(child, name or owner)
            else:
                ignored.setdefault(tag, []).append(name if name or not owner else f"of {owner}")

    collect(root, "")
    sentences = [list_elements(list_names([tag]), names, "") for tag, names in ignored.items()]
    more = len(sentences) - SHOWN
    return sentences[:SHOWN] + ([f"{more} more kinds of elements"] if more > 0 else [])
