"""Read a user's own model file (MJCF or URDF): the linkage that it describes, and its settings."""

import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gauss_bench.api.exchange import READING
from gauss_bench.api.in_worker import answer_in_worker
from gauss_bench.engines.mujoco.own_model import find_other_constraint, read_options
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.imports import FORMS, import_file
from gauss_bench.exchange.own_model import read_own_linkage
from gauss_bench.exchange.safe_xml import read_xml
from gauss_bench.linkage.load import load_document
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.worker import Worker

ENDINGS = (".xml", ".urdf", ".mjcf")
ACTING = 60.0  # [s] time limit of the run that looks for contacts, joint limits and dry friction


@dataclass(frozen=True, eq=False)
class OwnFile:
    """The content of a model file.

    Attributes:
        path: path of the file; kind: "MJCF" or "URDF".
        mechanism: the linkage that the file describes, at its keyframe and with the keyframe's controls.
        settings: option -> value in the compiled MJCF file; empty for a URDF file, which holds no settings.
        key: number of the keyframe.
        left_out: sentences on parts of the file that the linkage lacks or changes.
    """

    path: Path
    kind: str
    mechanism: Mechanism
    settings: dict[str, Any]
    key: int
    left_out: tuple[str, ...]


def is_model_file(name: str | Path) -> bool:
    """Tell whether a file name has the ending of an MJCF or URDF file."""
    return Path(name).suffix.lower() in ENDINGS


def read_own_file(name: str | Path, close: tuple[str, ...], worker: Worker) -> OwnFile:
    """Read a model file in a worker, because MuJoCo's compiler may crash or hang.

    `close` lists pairs of points to be joined, LINK.FRAME=LINK.FRAME, for URDF files: URDF cannot express closed loops.

    Raises:
        ExchangeError: the file cannot be read, or an element cannot be part of a planar linkage.
        MissingExtra: MuJoCo is not installed.
    """
    path = Path(name).absolute()
    read = answer_in_worker(worker, read_as_plain_data, (str(path), list(close)), READING, str(name))
    mechanism = load_document(read["document"], None, str(path), "", read["document"]["name"])
    return OwnFile(path, read["kind"], mechanism, read["settings"], read["key"], tuple(read["left_out"]))


def read_as_plain_data(file: str, close: list[str]) -> dict[str, Any]:
    """Read a model file in a worker process, and return the fields of `OwnFile` as plain data.

    The content of the linkage file ("document") replaces the mechanism. The keyframe ("key") of a URDF file is 0.
    """
    path = Path(file)
    name = re.sub("[^A-Za-z0-9_]+", "_", path.stem)  # the linkage's name
    kind = FORMS.get(str(read_xml(path).tag), "")
    if kind != "MJCF" or close:  # `import_file` refuses an MJCF file with pairs to close
        imported = import_file(path, name, close)
        document, left_out = tomllib.loads(imported.text), imported.left_out
        return {"document": document, "kind": kind, "settings": {}, "key": 0, "left_out": left_out}
    linkage, settings = read_own_linkage(path, name), read_options(str(path))
    left_out = tuple(linkage.flattened.remarks)
    return {"document": linkage.document, "kind": kind, "settings": settings, "key": linkage.key, "left_out": left_out}


def refuse_what_acts(file: OwnFile, until: float, worker: Worker) -> None:
    """Refuse a model in which a contact, the end of a joint's range, or dry friction acts before the time `until` [s].

    Raises:
        ExchangeError: a contact, joint limit or dry friction acts; the message names the element, and the time when it first acts.
    """
    first = answer_in_worker(worker, find_other_constraint, (str(file.path), file.key, until), ACTING, str(file.path))
    if first["what"]:  # the first contact, limit or friction that acts, in words; "" if there is none
        raise ExchangeError(
            f"{file.path}: {first['what']} at t = {first['at']:.4g} s, which no linkage has: its motion cannot be judged"
        )


def _write_numbers(numbers: Iterable[float]) -> str:
    """Return numbers as text with blanks between them, as in an attribute of MJCF."""
    return " ".join(f"{x:g}" for x in numbers)


def describe_closures(settings: dict[str, Any]) -> list[str]:
    """Return a sentence for each group of closures of an MJCF file that have the same solref and solimp."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name, solref in settings["solref"].items():
        groups.setdefault((_write_numbers(solref), _write_numbers(settings["solimp"][name])), []).append(name)
    return [
        f"closures are springs: {', '.join(names)} with solref {solref} and solimp {solimp}"
        for (solref, solimp), names in groups.items()
    ]
