"""Sentences on the elements of a model file that a linkage file has no place for."""

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

SHOWN = 20  # names in a sentence, and sentences: a linkage file, whose head repeats the sentences, is at most 1 MiB long
LONGEST = 60  # characters of a name
FIELDS = tomllib.loads((Path(__file__).parent / "mjcf.toml").read_text(encoding="utf-8"))


def list_names(names: Sequence[str]) -> str:
    """Return names as a list in words; names that are empty are counted."""
    named = [name if len(name) <= LONGEST else f"{name[:LONGEST]}..." for name in names if name]
    nameless, more = len(names) - len(named), len(named) - SHOWN
    parts = named[:SHOWN] + ([f"{more} more"] if more > 0 else []) + ([f"{nameless} without a name"] if nameless else [])
    return ", ".join([*parts[:-2], " and ".join(parts[-2:])])


def list_elements(tag: str, names: Sequence[str], reason: str) -> str:
    """Return the sentence on all elements of a kind."""
    return f"<{tag}> {list_names(names)}{reason and ': '}{reason}"


def list_unused(root: Element) -> list[str]:
    """List the elements of an MJCF document that have no part in the motion of a linkage, and the settings of its solver."""
    return [*_list_settings(root), *_list_sections(root)]


def _list_settings(root: Element) -> Iterator[str]:
    """Yield a sentence on the attributes of each kind of element that holds settings of MuJoCo."""
    for tag, known in FIELDS["unused"]["settings"].items():
        written = {key: x for node in root.iter(tag) for key, x in node.items() if key not in known["used"]}
        if written:
            values = ", ".join(f"{key} {list_names([x])}" for key, x in written.items())
            yield f"<{tag}> {values}: {known['reason']}"
    for tag in ("visual", "statistic", "size"):
        if root.find(tag) is not None:
            yield f"<{tag}>"


def _list_sections(root: Element) -> Iterator[str]:
    """Yield a sentence on each kind of element in the sections of the document."""
    for section, tags in FIELDS["unused"]["sections"].items():
        for tag, reason in tags.items():
            names = [node.get("name", "") for part in root.findall(section) for node in part.iter(tag)]
            if names:
                yield list_elements(tag, names, reason)


def list_ignored(root: Element, used: Mapping[str, Iterable[str]]) -> list[str]:
    """Return sentences on the elements of a URDF that are not read, one for each tag; SHOWN at most, then how many are left.

    Args:
        used: tag of an element that is read -> tags of the elements in it that are read too.
    """
    ignored: dict[str, list[str]] = {}  # tag -> names of its elements; "of OWNER" for one without a name

    def look(node: Element, owner: str) -> None:
        for child in node:
            tag, name = str(child.tag), child.get("name") or child.get("reference") or ""
            if tag in used.get(str(node.tag), ()):
                look(child, name or owner)
            else:
                ignored.setdefault(tag, []).append(name if name or not owner else f"of {owner}")

    look(root, "")
    sentences = [list_elements(list_names([tag]), names, "") for tag, names in ignored.items()]
    more = len(sentences) - SHOWN
    return sentences[:SHOWN] + ([f"{more} more kinds of elements"] if more > 0 else [])
