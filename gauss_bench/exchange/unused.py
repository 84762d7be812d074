"""Phrases that name the elements of a model file that cannot be written into a linkage file."""

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

SHOWN = 20  # most names in a sentence, and most sentences, because a linkage file repeats them and is limited to 1 MiB
LONGEST = 60  # most characters of a name
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


def list_unused(root: Element) -> list[str]:
    """Return sentences on the settings of the solver in an MJCF document, and on elements that do not affect a linkage's motion."""
    return [*_list_settings(root), *_list_sections(root)]


def _list_settings(root: Element) -> Iterator[str]:
    """Yield a sentence for each tag that holds settings of MuJoCo, with those attributes that the import does not use."""
    for tag, known in FIELDS["unused"]["settings"].items():
        unused = {key: x for node in root.iter(tag) for key, x in node.items() if key not in known["used"]}
        if unused:
            values = ", ".join(f"{key} {list_names([x])}" for key, x in unused.items())
            yield f"<{tag}> {values}: {known['reason']}"
    for tag in ("visual", "statistic", "size"):
        if root.find(tag) is not None:
            yield f"<{tag}>"


def _list_sections(root: Element) -> Iterator[str]:
    """Yield a phrase for each MJCF tag of the document that has no effect on a linkage's motion.

    mjcf.toml lists these tags: section of MJCF -> tag -> reason why the import leaves elements with this tag out.
    """
    for section, tags in FIELDS["unused"]["sections"].items():
        for tag, reason in tags.items():
            names = [node.get("name", "") for part in root.findall(section) for node in part.iter(tag)]
            if names:
                yield list_elements(tag, names, reason)


def list_ignored(root: Element, used: Mapping[str, Iterable[str]]) -> list[str]:
    """Return a sentence for each tag of a URDF that is not read: at most SHOWN sentences, then the number of further tags.

    Args:
        used: tag that is read -> tags inside it that are read too.
    """
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
