"""A user's MJCF file as an engine: the linkage that it describes, and MuJoCo's model of the very file to step it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mujoco.adapter import Mujoco
from gauss_bench.engines.mujoco.compiled import Compiled, DoesNotCompile, compile_file
from gauss_bench.engines.mujoco.own_model import INTEGRATORS, OwnModelRun, Seen
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.from_mjcf import Reader
from gauss_bench.exchange.planar import Flattened
from gauss_bench.exchange.safe_xml import read_xml, refuse_bulk
from gauss_bench.mechanism.model import Mechanism

ENGINE = "gauss_bench.exchange.own_model:OwnModel"  # as `engines.get` takes it


def read_own_model(path: Path) -> tuple[Element, Compiled]:
    """Return the document of a file, with what it includes in place, and the compiled model.

    Raises:
        ExchangeError: the file cannot be read, is too large, or MuJoCo does not compile it.
        ImportError: MuJoCo is not installed.
    """
    root = splice_includes(read_xml(path), path, path.parent, {path.resolve()})
    refuse_bulk(root, path)
    try:
        return root, compile_file(path)
    except DoesNotCompile as error:
        raise ExchangeError(f"{path}: MuJoCo does not compile it: {' '.join(str(error).split())}") from error


def splice_includes(root: Element, path: Path, folder: Path, seen: set[Path]) -> Element:
    """Put the elements of included files in the place of each <include>; their names are relative to the model's folder.

    Raises:
        ExchangeError: a file is included twice, or cannot be read.
    """
    for parent in list(root.iter()):
        children: list[Element] = []
        for child in parent:
            if child.tag != "include":
                children.append(child)
                continue
            file = folder / child.get("file", "")
            if file.resolve() in seen:
                raise ExchangeError(f"{path}: <include>: {child.get('file')!r} is included twice")
            seen.add(file.resolve())
            children += splice_includes(read_xml(file), file, folder, seen)
        parent[:] = children
    return root


def see(flattened: Flattened, mechanism: Mechanism) -> Seen:
    """Return how the links of the linkage that `flattened` became are seen in the model."""
    spatial, plane = flattened.spatial, flattened.plane
    turns = np.zeros((len(flattened.links), len(spatial.joints)))
    places = []
    for link, g in enumerate(flattened.links):
        body, com = spatial.bodies[g], flattened.to_plane(g, complex(*mechanism.links[link].com))
        away = com - plane.flat(body.origin)
        places.append(body.turn.T @ (away.real * plane.x + away.imag * plane.y))
        for k, turn in flattened.hinges_under(g):
            turns[link, k] += turn
    refs = np.array([joint.ref for joint in spatial.joints])
    angles = np.array([flattened.frames[g][1] for g in flattened.links]) - turns @ refs
    axes = np.array([plane.x, plane.y, plane.normal])
    return Seen(tuple(flattened.links), np.array(places), axes, angles, turns)


@dataclass(frozen=True, eq=False)
class OwnLinkage:
    """The linkage that a file describes: its document, how it was flattened, and the number of the keyframe at which it starts."""

    document: dict[str, Any]
    flattened: Flattened
    key: int


def own_linkage(path: Path, name: str) -> OwnLinkage:
    """Read the linkage of an MJCF file.

    Raises:
        ExchangeError, ImportError: as `read_own_model`; or an element cannot be part of a planar linkage.
    """
    root, compiled = read_own_model(path)
    reader = Reader(compiled, str(path))
    flattened = Flattened(reader.spatial())
    document, _ = flattened.document(name, f"{root.get('model') or path.stem}, from MJCF")
    return OwnLinkage(document, flattened, reader.key)


def setting_text(path: Path, changes: Mapping[str, Any]) -> str:
    """Return the settings of a choice that asks for the model of a file with some options changed."""
    return json.dumps({"model": str(path), "changes": changes})


class OwnModel:
    """The engine that steps the model of a user's file; a choice names the file by `setting_text`."""

    name = "mujoco"
    integrators = ("", *INTEGRATORS)  # empty: the file's own
    stabilizations = ("none",)
    settings: Mapping[str, Mapping[str, object]] = {"as it stands": {}}
    native_loop = True
    python_loop = False

    def version(self) -> str:
        return Mujoco().version()

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        return None

    def in_python(self, mechanism: Mechanism, choice: Choice) -> str:
        return ""

    def build(self, mechanism: Mechanism, choice: Choice) -> OwnModelRun:
        asked = json.loads(choice.settings)
        path = Path(asked["model"])
        linkage = own_linkage(path, "model")
        changes = asked["changes"] | {"timestep": choice.step}
        return OwnModelRun(path, see(linkage.flattened, mechanism), linkage.key, changes, choice)
