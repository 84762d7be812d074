"""Beginnings of a drawing: the built-in linkages, and the classics of templates/."""

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import built_in
from gauss_bench.report.drawings.drawing import draw
from gauss_bench.report.drawings.pose import pose_links
from gauss_bench.studio.errors import Refused

FOLDER = Path(__file__).parent / "templates"


def files() -> dict[str, Path]:
    """Name -> file; the built-in linkages first."""
    return built_in() | {path.stem: path for path in sorted(FOLDER.glob("*.toml"))}


def path_of(name: str) -> Path:
    """The file of a template.

    Raises:
        Refused: there is none of that name.
    """
    path = files().get(name)
    if path is None:
        raise Refused(f"there is no template {name[:60]!r}")
    return path


def text_of(name: str) -> str:
    """The text of a template.

    Raises:
        Refused: as `path_of`.
    """
    return path_of(name).read_text(encoding="utf-8")


@cache
def list_templates() -> tuple[dict[str, Any], ...]:
    """Every template with its title and whether it is built in; drawings are asked for one by one."""
    templates = []
    for name, path in files().items():
        title = str(tomllib.loads(path.read_text(encoding="utf-8")).get("title", ""))
        templates.append({"name": name, "title": title or name, "kind": "classic" if path.parent == FOLDER else "built-in"})
    return tuple(templates)


@cache
def drawing(name: str) -> str:
    """A template as SVG; empty where it cannot be drawn.

    Raises:
        Refused: as `path_of`.
    """
    path = path_of(name)
    try:
        return draw(*pose_links(path))
    except (LinkageError, ArithmeticError, ValueError):
        return ""
