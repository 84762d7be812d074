"""Check the files that a subcommand of the command line will write, before the subcommand starts its computation."""

import os
import re
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryFile

from gauss_bench.untrusted import BadInput, read_start

LOOKED_AT = 65_536  # bytes at the start of a file from which its kind is recognised
STARTS = {".png": rb"\x89PNG", ".gif": rb"GIF8", ".npz": rb"PK\x03\x04"}  # ending -> first bytes
ROOTS = {b"svg": ".svg", b"html": ".html", b"mujoco": ".xml"}  # root element -> ending
# the root element of an SVG, HTML or MJCF file, after declarations, comments and a doctype
ROOT = re.compile(rb"\s*<(?:[?!].*?<)*?!?(?:doctype\s+)?(svg|html|mujoco)\b", re.DOTALL | re.IGNORECASE)
TABLE = re.compile(rb"^[ \t]*\[\[?[\w.\"' -]+\]\]?[ \t]*(?:#.*)?\r?$", re.MULTILINE)  # the head of a table in TOML
NUMBERS = re.compile(rb"[^\n]+,[^\n]+\n[-+.,\d][-+.,\denaif]*\r?\n")  # the header line and the first row of a CSV file


class FileRefused(BadInput, ValueError):
    """A file that may not be written."""


def writable(
    out: str | Path, replace: bool, option: str = "--out", usual: Path | None = None, suffix: str = "", source: str | Path = ""
) -> Path:
    """Return the path `out` if a file may be written there.

    Args:
        option: the command-line option that named the path, for error texts.
        usual: the default folder of such files, which need not exist if its parent does.
        suffix: ending of the file to write; an existing file of another kind is never replaced.
        source: path of the subcommand's input file, which is never replaced.

    Raises:
        FileRefused: the path is a folder, its folder is missing or not writable, or a file exists there and may not be replaced.
    """
    path = Path(out)
    if path.is_dir() or not path.name:
        raise FileRefused(f"{out}: is a folder; {option} takes a file")
    if not path.parent.is_dir() and not (path.parent == usual and usual.parent.is_dir()):
        raise FileRefused(f"{out}: there is no folder {path.parent}")
    if os.path.lexists(path) and not replace:  # lexists: a dangling symbolic link counts as a file
        raise FileRefused(f"{out}: is there already, and may hold your changes; --replace overwrites it")
    if path.exists() and not path.is_file():
        raise FileRefused(f"{out}: is not a regular file")
    if path.exists() and source and Path(source).exists() and path.samefile(source):
        raise FileRefused(f"{out}: is the input; {option} takes another file")
    if path.exists() and suffix and (path.suffix.lower() != suffix or not is_of_kind(path, suffix)):
        raise FileRefused(f"{out}: is there already, and no {suffix} file: --replace only replaces files of the same kind")
    _check_writable(path.parent if path.parent.is_dir() else path.parent.parent, str(out))
    return path


def is_of_kind(path: Path, suffix: str) -> bool:
    """Tell whether the content of a file fits the ending `suffix`; content of an unknown kind fits every ending."""
    start = read_start(path, LOOKED_AT)
    kind = next((x for x, pattern in STARTS.items() if re.match(pattern, start)), "")
    if root := ROOT.match(start):
        kind = ROOTS[root[1].lower()]
    if not kind and TABLE.search(start):
        kind = ".toml"
    if not kind and NUMBERS.match(start):
        kind = ".csv"
    return kind in ("", suffix)


def usable_folder(out: Path, usual: Path | None = None) -> Path:
    """Return the folder `out` if it may be written; unless `out` is the default folder `usual`, its parent must exist.

    Raises:
        FileRefused: the path is a file, its parent does not exist, or writing is not permitted.
    """
    parent = out.absolute().parent
    if out.exists() and not out.is_dir():
        raise FileRefused(f"--out {out}: is a file; it takes a folder")
    if out != usual and not parent.is_dir():
        raise FileRefused(f"--out {out}: there is no folder {parent}")
    nearest = out if out.is_dir() else parent  # permission of the parent matters only if `out` does not exist yet
    if nearest.is_dir():
        _check_writable(nearest, f"--out {out}")
    return out


def _check_writable(folder: Path, named: str) -> None:
    """Raise FileRefused if no file can be written into a folder; `named` begins the message.

    The check precedes a long computation, whose result would otherwise be lost.
    """
    try:  # permissions do not suffice: for root, folders of /proc and of read-only disks look writable
        TemporaryFile(dir=folder).close()
    except OSError as error:
        raise FileRefused(f"{named}: nothing may be written into the folder {folder}") from error


def check_files(
    asked: Mapping[str, Path], kinds: Mapping[str, tuple[str, ...]], replace: bool, source: str | Path = ""
) -> dict[str, Path]:
    """Check the paths of all files that a subcommand will write, and return option -> path.

    Args:
        asked: name of an option -> path that the user gave for it.
        kinds: name of an option -> file endings that the option accepts.

    Raises:
        FileRefused: the option does not accept a file's ending, a file is named twice, or `writable` refuses a file.
    """
    files: dict[str, Path] = {}
    for name, path in asked.items():
        if path.suffix.lower() not in kinds[name]:
            raise FileRefused(f"--{name} {path}: the ending says what to write: {', '.join(kinds[name])}")
        # on a circle of symbolic links `Path.resolve` fails, and `realpath` does not
        if os.path.realpath(path) in [os.path.realpath(x) for x in files.values()]:
            raise FileRefused(f"--{name} {path}: is named twice")
        files[name] = writable(path, replace, f"--{name}", suffix=path.suffix.lower(), source=source)
    return files
