"""Templates, the files of the working folder, imports, and links that contain a whole linkage."""

import base64
import tomllib
import zlib
from functools import cache
from pathlib import Path
from typing import Any

from gauss_bench.api.exchange import READING, read_there
from gauss_bench.api.in_worker import answer_in_worker
from gauss_bench.atomic import write_text
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

SHOWN = 200  # largest number of files that are listed
FOLDER = Path(__file__).parent / "templates"


def texts() -> dict[str, Path]:
    """Return the files of all templates by name, the built-in linkages first."""
    return built_in() | {path.stem: path for path in sorted(FOLDER.glob("*.toml"))}


def path_of(name: str) -> Path:
    """Return the file of a template.

    Raises:
        Refused: there is no template of that name.
    """
    if name not in texts():
        raise Refused(f"there is no template {name[:60]!r}")
    return texts()[name]


def text_of(name: str) -> str:
    """Return the text of a template.

    Raises:
        Refused: there is no template of that name.
    """
    return path_of(name).read_text(encoding="utf-8")


@cache
def list_templates() -> tuple[dict[str, Any], ...]:
    """List every template with its title and kind; the page requests their drawings one by one."""
    titles = {name: tomllib.loads(text_of(name)).get("title", name) for name in texts()}
    kinds = {name: "classic" if path.parent == FOLDER else "built-in" for name, path in texts().items()}
    return tuple({"name": name, "title": title, "kind": kinds[name]} for name, title in titles.items())


@cache
def drawing(name: str) -> str:
    """Return a template as SVG; empty if it cannot be drawn.

    Raises:
        Refused: there is no template of that name.
    """
    path = path_of(name)
    try:
        return draw(*pose_links(path))
    except (LinkageError, ArithmeticError, ValueError):
        return ""


def inside(folder: Path, name: str) -> Path:
    """Return the path of a file of the working folder, after following symbolic links.

    Raises:
        Refused: the path is outside the folder, or is no name of a linkage file.
    """
    if not name or "\0" in name or len(name) > 200:
        raise Refused("the name of the file is missing or too long", field="path")
    try:
        path = (folder / name).resolve()
        within = path.is_relative_to(folder) and path != folder
    except (OSError, ValueError, RuntimeError) as error:
        raise Refused(f"{name[:60]}: is no valid path", field="path") from error
    if not within:
        raise Refused(f"{name[:60]}: lies outside the folder that the studio was started in", field="path")
    if path.suffix != ".toml":
        raise Refused(f"{name[:60]}: a linkage file ends in .toml", field="path")
    return path


def list_files(folder: Path) -> list[str]:
    """List the names of the linkage files in the working folder."""
    try:
        return sorted(x.name for x in folder.glob("*.toml") if x.is_file())[:SHOWN]
    except OSError:
        return []


def open_document(folder: Path, name: str) -> tuple[str, Path | None]:
    """Return text and path of a file in the folder, or the text of a template and None.

    Raises:
        Refused: there is no such file, or it is outside the folder.
        LinkageError: the file cannot be read.
    """
    if not Path(name).suffix and name in texts():
        return text_of(name), None
    path = inside(folder, name)
    read_file(path)
    return path.read_text(encoding="utf-8"), path


def save(path: Path, text: str, replace: bool, own: Path | None, known: str) -> None:
    """Write the text to a file in one atomic step.

    Without `replace`, a file other than `own` is not overwritten, nor is `own` if its content is not `known`.

    Raises:
        Refused: the name is not allowed, the file exists, or it is read-only.
    """
    if path.stem in built_in():
        raise Refused(f"{path.stem} is the name of a built-in linkage: commands would take that one; choose another", field="path")
    if path.is_dir() or not path.parent.is_dir():
        raise Refused(f"{path.name}: its folder does not exist, or it is a folder itself", field="path")
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
    """Tell whether a file's content differs from the known one; a file that was deleted counts as unchanged."""
    try:
        return path.read_text(encoding="utf-8") != known
    except FileNotFoundError:
        return False
    except (OSError, ValueError):
        return True


def import_file(text: str) -> tuple[str, list[str]]:
    """Import a model in MJCF or URDF in a worker process; return a linkage file, and a sentence for each part that is left out.

    Raises:
        Refused: the text is no such model, or no planar one, or the library that reads it is not installed.
    """
    with workplace(text, "model", ".xml") as model:
        try:
            with Worker() as worker:
                linkage = answer_in_worker(worker, read_there, (str(model), "imported", []), READING, "the model")
        except (ExchangeError, MissingExtra) as error:
            raise Refused(str(error).replace(f"{model}: ", "")) from error
        return str(linkage["text"]).replace(str(model), "model.xml"), [str(x) for x in linkage["left_out"]]


def fragment(text: str) -> str:
    """Compress a text into the characters that a URL may contain."""
    packed = zlib.compress(text.encode("utf-8"), 9)
    return base64.urlsafe_b64encode(packed).decode("ascii").rstrip("=")


def unpack_fragment(given: str) -> str:
    """Return the text that `fragment` has compressed.

    Raises:
        Refused: it is no such text, or is larger than a linkage file may be.
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
