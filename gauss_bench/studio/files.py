"""Texts to begin with, files inside the folder that the studio was started in, and a linkage as a link that carries itself."""

import base64
import tomllib
import zlib
from functools import cache
from pathlib import Path
from typing import Any

from gauss_bench.api.exchange import READING, answer_in_worker, read_there
from gauss_bench.engines import MissingExtra
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import MAX_BYTES, built_in
from gauss_bench.linkage.load import read as read_file
from gauss_bench.report.drawings.drawing import draw
from gauss_bench.report.drawings.pose import pose_links
from gauss_bench.runs.worker import Worker
from gauss_bench.studio.autosave import workplace
from gauss_bench.studio.errors import Refused
from gauss_bench.tables import write_text

SHOWN = 200  # files of the folder that are listed


FOLDER = Path(__file__).parent / "templates"


def texts() -> dict[str, Path]:
    """Name -> file; the built-in linkages first."""
    return built_in() | {path.stem: path for path in sorted(FOLDER.glob("*.toml"))}


def path_of(name: str) -> Path:
    """The file of a template.

    Raises:
        Refused: there is none of that name.
    """
    if name not in texts():
        raise Refused(f"there is no template {name[:60]!r}")
    return texts()[name]


def text_of(name: str) -> str:
    """The text of a template; Refused as by `path_of`."""
    return path_of(name).read_text(encoding="utf-8")


@cache
def list_templates() -> tuple[dict[str, Any], ...]:
    """Every template with its title and whether it is built in; drawings are asked for one by one."""
    titles = {name: tomllib.loads(text_of(name)).get("title", name) for name in texts()}
    kinds = {name: "classic" if path.parent == FOLDER else "built-in" for name, path in texts().items()}
    return tuple({"name": name, "title": title, "kind": kinds[name]} for name, title in titles.items())


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


def inside(folder: Path, name: str) -> Path:
    """The path of a file of the working folder, symbolic links followed.

    Raises:
        Refused: it lies elsewhere, or is no name of a linkage file.
    """
    if not name or "\0" in name or len(name) > 200:
        raise Refused("a file has a name", field="path")
    try:
        path = (folder / name).resolve()
        within = path.is_relative_to(folder) and path != folder
    except (OSError, ValueError, RuntimeError) as error:
        raise Refused(f"{name[:60]}: no path", field="path") from error
    if not within:
        raise Refused(f"{name[:60]}: lies outside the folder that the studio was started in", field="path")
    if path.suffix != ".toml":
        raise Refused(f"{name[:60]}: a linkage file ends in .toml", field="path")
    return path


def list_files(folder: Path) -> list[str]:
    """Linkage files of the working folder, by name."""
    try:
        return sorted(x.name for x in folder.glob("*.toml") if x.is_file())[:SHOWN]
    except OSError:
        return []


def open_document(folder: Path, name: str) -> tuple[str, Path | None]:
    """Text and path of a file of the folder; of a built-in linkage or a template its text alone.

    Raises:
        Refused: there is none, or it lies outside the folder.
        LinkageError: it cannot be read.
    """
    if not Path(name).suffix and name in texts():
        return text_of(name), None
    path = inside(folder, name)
    read_file(path)
    return path.read_text(encoding="utf-8"), path


def save(path: Path, text: str, replace: bool, own: Path | None, known: str) -> None:
    """Write the text in one move; over a file that is not `own`, or does not say what is `known` of it, only where that is wished.

    Raises:
        Refused: a name that no linkage may have, or there is a file already, or one that may only be read.
    """
    if path.stem in built_in():
        raise Refused(f"{path.stem} is the name of a built-in linkage: commands would take that one; choose another", field="path")
    if path.is_dir() or not path.parent.is_dir():
        raise Refused(f"{path.name} lies in no folder, or is one", field="path")
    if path.exists() and path != own and not replace:
        raise Refused(f"{path.name} is there already", field="replace")
    if path.exists() and not path.stat().st_mode & 0o222:
        raise Refused(f"{path.name} may only be read: choose another name", field="path")
    if path == own and not replace and has_changed(path, known):
        raise Refused(f"{path.name} has been changed by someone else since it was opened", field="replace")
    try:
        write_text(path, text)
    except OSError as error:
        raise Refused(f"{path.name} cannot be written: {error.strerror}", field="path") from error


def has_changed(path: Path, known: str) -> bool:
    """Tell whether a file says something else than what is known of it; one that is gone does not."""
    try:
        return path.read_text(encoding="utf-8") != known
    except FileNotFoundError:
        return False
    except (OSError, ValueError):
        return True


def import_file(text: str) -> tuple[str, list[str]]:
    """A model in MJCF or URDF as a linkage file, and what that lacks: sentences. Libraries read it in a process of their own.

    Raises:
        Refused: it is none, or not planar, or what reads it is not installed.
    """
    with workplace(text, "model", ".xml") as model:
        try:
            with Worker() as worker:
                linkage = answer_in_worker(worker, read_there, (str(model), "imported", []), READING, "the model")
        except (ExchangeError, MissingExtra) as error:
            raise Refused(str(error).replace(f"{model}: ", "")) from error
        return str(linkage["text"]).replace(str(model), "model.xml"), [str(x) for x in linkage["left_out"]]


def fragment(text: str) -> str:
    """The text in the characters that an address may carry."""
    packed = zlib.compress(text.encode("utf-8"), 9)
    return base64.urlsafe_b64encode(packed).decode("ascii").rstrip("=")


def of_fragment(given: str) -> str:
    """The text of `fragment`.

    Raises:
        Refused: it is none, or is larger than any linkage file.
    """
    try:
        packed = base64.b64decode(given + "=" * (-len(given) % 4), altchars=b"-_", validate=True)
        unpacking = zlib.decompressobj()
        text = unpacking.decompress(packed, MAX_BYTES + 1).decode("utf-8")
    except (ValueError, zlib.error) as error:
        raise Refused("the link carries no linkage") from error
    if not unpacking.eof or len(text) > MAX_BYTES:
        raise Refused("the link is cut off, or carries more than a linkage file")
    return text
