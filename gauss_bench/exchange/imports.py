"""Recognise the kind of a model file, read it, and return the text of a linkage file that assembles."""

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gauss_bench import __version__
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.from_mjcf import from_mjcf
from gauss_bench.exchange.from_urdf import Robot
from gauss_bench.exchange.planar import Flattened
from gauss_bench.exchange.safe_xml import read_xml
from gauss_bench.exchange.spatial import Spatial
from gauss_bench.exchange.toml import toml
from gauss_bench.linkage.errors import AssemblyError, LinkageError
from gauss_bench.linkage.load import load_document

FORMS = {"mujoco": "MJCF", "robot": "URDF"}  # root element -> kind of file


@dataclass(frozen=True)
class Imported:
    """A linkage file that is not written yet.

    Attributes:
        kind: kind of the model file that was read, "MJCF" or "URDF".
        left_out: sentences on parts of the model file that the linkage leaves out or changes.
        links, dof: numbers of links and of degrees of freedom.
        note: sentence that says that no loop is closed and how a loop can be closed; empty if the model closes a loop.
    """

    text: str
    kind: str
    left_out: tuple[str, ...]
    links: int
    dof: int
    note: str = ""


def import_file(path: Path, name: str, close: Sequence[str] = ()) -> Imported:
    """Read an MJCF or URDF file and return the linkage file `name`.toml that describes the same mechanism.

    Args:
        close: closures LINK.FRAME=LINK.FRAME of the loops of a URDF.

    Raises:
        ExchangeError: the file cannot be imported; the message names the file, the element and the reason.
        ImportError: the file is MJCF, and MuJoCo is not installed.
    """
    if not re.fullmatch("[A-Za-z0-9_]+", name):
        raise ExchangeError(f"{name}.toml: the name of a linkage file has letters, digits and underscores only")
    root = read_xml(path)
    kind = FORMS.get(str(root.tag), "")
    if not kind:
        raise ExchangeError(f"{path}: <{root.tag}>: neither MJCF (<mujoco>) nor URDF (<robot>)")
    if close and kind == "MJCF":
        raise ExchangeError(f"{path}: --close is for URDF; MJCF closes its loops by connect and weld")
    spatial = Robot(root, str(path)).read(close) if kind == "URDF" else from_mjcf(root, path)
    title = root.get("model" if kind == "MJCF" else "name") or path.stem
    try:
        document, left_out = Flattened(spatial).write_document(name, f"{title}, from {kind}")
        note = describe_open_tree(spatial, document["expect"]["dof"])
        head = [
            f"From the {kind} file {path.name}, by gauss-bench {__version__}. This file is yours, without conditions.",
            "SI units. The frame of a link is that of its first body. Angles are positive from the x axis to the y axis.",
            *(f"Left out or changed: {x}" for x in left_out),
            *([note] if note else []),
        ]
        text = toml(document, head)
        mechanism = load_document(tomllib.loads(text), None, str(path), "", name)
    except (AssemblyError, LinkageError) as error:
        raise ExchangeError(f"{path}: no linkage that can be assembled: {' '.join(str(error).split())}") from error
    return Imported(text, kind, left_out, len(mechanism.links), mechanism.dof, note)


def describe_open_tree(spatial: Spatial, dof: int) -> str:
    """Return a sentence that says that the model has no closed loop, or an empty text if it has one."""
    if spatial.closures or spatial.welds:
        return ""
    freedoms = f"{dof} degree of freedom" if dof == 1 else f"{dof} degrees of freedom"
    how_to_close = spatial.how_to_close or "<connect> in <equality> closes a loop"
    return f"No loop is closed: the linkage is an open tree with {freedoms}. {how_to_close}."
