"""Read templates and files of the working folder, save files, import models, and encode a linkage file in a URL."""

import base64
import tomllib
import zlib
from functools import cache
from pathlib import Path

from gauss_bench.api.exchange import READING
from gauss_bench.api.in_worker import answer_in_worker
from gauss_bench.atomic import write_text
from gauss_bench.engines import MissingExtra
from gauss_bench.exchange import imports
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import MAX_BYTES, built_in
from gauss_bench.linkage.load import read as read_file
from gauss_bench.report.drawings.drawing import draw
from gauss_bench.report.drawings.pose import pose_links
from gauss_bench.runs.worker import Worker
from gauss_bench.studio.autosave import temporary_file
from gauss_bench.studio.messages import Refused

SHOWN = 200  # largest number of files that are listed
CLASSICS = Path(__file__).parent / "templates"  # folder of the classic linkages


def find_templates() -> dict[str, Path]:
    """Return name -> file of all templates, the built-in linkages first."""
    return built_in() | {path.stem: path for path in sorted(CLASSICS.glob("*.toml"))}


def find_template(name: str) -> Path:
    """Return the path of a template's file."""
    if name not in find_templates():
        raise Refused(f"there is no template {name[:60]!r}")
    return find_templates()[name]


@cache
def list_templates() -> tuple[dict[str, str], ...]:
    """Return name, title and kind of every template; the page requests their drawings one by one."""
    listed = []
    for name, path in find_templates().items():
        title = tomllib.loads(path.read_text(encoding="utf-8")).get("title", name)
        listed.append({"name": name, "title": title, "kind": "classic" if path.parent == CLASSICS else "built-in"})
    return tuple(listed)


@cache
def draw_template(name: str) -> str:
    """Return a template as SVG; empty if it cannot be drawn."""
    path = find_template(name)
    try:
        return draw(*pose_links(path))
    except (LinkageError, ArithmeticError, ValueError):
        return ""


def resolve_inside(folder: Path, name: str) -> Path:
    """Return the path of a linkage file in the working folder, with symbolic links resolved; refuse a path outside the folder."""
    if not name or "\0" in name or len(name) > 200:
        raise Refused("the name of the file is missing or too long", field="path")
    try:
        path = (folder / name).resolve()
        is_inside = path.is_relative_to(folder) and path != folder
    except (OSError, ValueError, RuntimeError) as error:
        raise Refused(f"{name[:60]}: this is no valid path", field="path") from error
    if not is_inside:
        raise Refused(f"{name[:60]}: lies outside the folder that the studio was started in", field="path")
    if path.suffix != ".toml":
        raise Refused(f"{name[:60]}: a linkage file ends in .toml", field="path")
    return path


def list_files(folder: Path) -> list[str]:
    """List the names of the linkage files in the working folder, at most SHOWN of them."""
    try:
        return sorted(x.name for x in folder.glob("*.toml") if x.is_file())[:SHOWN]
    except OSError:
        return []


def open_document(folder: Path, name: str) -> tuple[str, Path | None]:
    """Return text and path of a file in the folder, or the text of a template and None."""
    if not Path(name).suffix and name in find_templates():
        return find_template(name).read_text(encoding="utf-8"), None
    path = resolve_inside(folder, name)
    read_file(path)  # raises if the file is no linkage file
    return path.read_text(encoding="utf-8"), path


def save(path: Path, text: str, replace: bool, own: Path | None, known: str) -> None:
    """Write the text to a file in one atomic step.

    Args:
        replace: whether to overwrite another file, or a file that another program has changed.
        own: file of the open document, which is overwritten without `replace` if its content is still `known`; or None.
        known: content of `own` when it was read or written last.
    """
    if path.stem in built_in():
        reason = "is the name of a built-in linkage, which commands would take instead of the file: choose another name"
        raise Refused(f"{path.stem} {reason}", field="path")
    if path.is_dir() or not path.parent.is_dir():
        raise Refused(f"{path.name}: its folder does not exist, or it is a folder itself", field="path")
    if path.exists() and path != own and not replace:
        raise Refused(f"{path.name} exists already", field="replace")
    if path.exists() and not path.stat().st_mode & 0o222:  # nobody may write the file
        raise Refused(f"{path.name} may only be read: choose another name", field="path")
    if path == own and not replace and has_changed(path, known):
        raise Refused(f"{path.name} has been changed by another program since it was opened", field="replace")
    try:
        write_text(path, text)
    except OSError as error:
        raise Refused(f"{path.name} cannot be written: {error.strerror}", field="path") from error


def has_changed(path: Path, known: str) -> bool:
    """Tell whether a file's content differs from `known`; a file that was deleted counts as unchanged."""
    try:
        return path.read_text(encoding="utf-8") != known
    except FileNotFoundError:
        return False
    except (OSError, ValueError):
        return True


def import_file(text: str) -> tuple[str, list[str]]:
    """Import a model in MJCF or URDF in a worker process.

    Return the text of a linkage file, and a sentence for each part of the model that it leaves out.
    """
    with temporary_file(text, "model", ".xml") as model:
        try:
            with Worker() as worker:
                linkage = answer_in_worker(worker, imports.import_file, (model, "imported"), READING, "the model")
        except (ExchangeError, MissingExtra) as error:
            raise Refused(str(error).replace(f"{model}: ", "")) from error
        return str(linkage["text"]).replace(str(model), "model.xml"), [str(x) for x in linkage["left_out"]]


def pack_fragment(text: str) -> str:
    """Compress a text, and return it in characters that a URL may contain."""
    packed = zlib.compress(text.encode("utf-8"), 9)
    return base64.urlsafe_b64encode(packed).decode("ascii").rstrip("=")


def unpack_fragment(fragment: str) -> str:
    """Return the text that `pack_fragment` has compressed; refuse a fragment that is damaged or too long."""
    try:
        padded = fragment + "=" * (-len(fragment) % 4)  # base64 has groups of four characters
        packed = base64.b64decode(padded, altchars=b"-_", validate=True)
        unpacking = zlib.decompressobj()
        text = unpacking.decompress(packed, MAX_BYTES + 1).decode("utf-8")
    except (ValueError, zlib.error) as error:
        raise Refused("the address contains no linkage") from error
    if not unpacking.eof or len(text) > MAX_BYTES:
        raise Refused("the address is cut off, or contains more than a linkage file")
    return text
