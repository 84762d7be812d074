"""An engine that steps MuJoCo's model of a user's MJCF file, and the linkage that this file describes."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mujoco.adapter import Mujoco
from gauss_bench.engines.mujoco.compiled import compile_file
from gauss_bench.engines.mujoco.own_model import INTEGRATORS, LinkMap, OwnModelRun
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.from_mjcf import make_reader
from gauss_bench.exchange.planar import Flattened
from gauss_bench.exchange.safe_xml import read_xml, refuse_bulk
from gauss_bench.mechanism.model import Mechanism

ENGINE = "gauss_bench.exchange.own_model:OwnModel"  # name by which `engines.get` finds the engine


def splice_includes(root: Element, path: Path, folder: Path, seen: set[Path]) -> Element:
    """Replace each <include> in a document by the elements of the included file, and return the document.

    The names of included files are relative to `folder`. Each included file is added to `seen`.

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


def locate_links(flattened: Flattened, mechanism: Mechanism) -> LinkMap:
    """Return how the poses of a mechanism's links follow from the state of the MuJoCo model that was imported."""
    spatial, plane = flattened.spatial, flattened.plane
    # angles of the links = angles when all joint coordinates are zero + turns @ joint coordinates; a slide has a column of zeros
    turns = np.zeros((len(flattened.links), len(spatial.joints)))
    places = []  # centres of mass of the links, each (3,) in the frame of the link's first body [m]
    for row, (link, built) in enumerate(zip(flattened.links, mechanism.links, strict=True)):
        body = spatial.bodies[link]
        offset = flattened.to_plane(link, complex(*built.com)) - plane.project(body.origin)  # x + i y in the plane
        places.append(body.turn.T @ (offset.real * plane.x + offset.imag * plane.y))  # `body.turn` is a rotation matrix
        for k, sign in flattened.list_hinges(link):
            turns[row, k] += sign
    refs = np.array([joint.ref for joint in spatial.joints])  # joint coordinates in the configuration of the file
    at_refs = np.array([flattened.frames[link][1] for link in flattened.links])  # angles of the links in this configuration
    axes = np.array([plane.x, plane.y, plane.normal])
    return LinkMap(tuple(flattened.links), locals=np.array(places), plane=axes, angles=at_refs - turns @ refs, turns=turns)


@dataclass(frozen=True, eq=False)
class OwnLinkage:
    """The linkage that an MJCF file describes.

    Attributes:
        document: tables of the linkage file.
        flattened: the mechanism of the file in its plane, from which the document was made.
        key: index of the keyframe at which the linkage starts.
    """

    document: dict[str, Any]
    flattened: Flattened
    key: int


def read_own_linkage(path: Path, name: str) -> OwnLinkage:
    """Read an MJCF file as the linkage `name`.

    Raises:
        ExchangeError: the file cannot be read or compiled, or an element cannot be part of a planar linkage.
        ImportError: MuJoCo is not installed.
    """
    root = splice_includes(read_xml(path), path, path.parent, {path.resolve()})
    refuse_bulk(root, path)
    reader = make_reader(lambda: compile_file(path), path)
    flattened = Flattened(reader.read())
    document, _ = flattened.write_document(name, f"{root.get('model') or path.stem}, from MJCF")
    return OwnLinkage(document, flattened, reader.key)


def setting_text(path: Path, changes: Mapping[str, Any]) -> str:
    """Return the text for `Choice.settings` that names a file and the options to change in MuJoCo's model of it."""
    return json.dumps({"model": str(path), "changes": changes})


class OwnModel:
    """The engine that simulates a user's own MJCF file; `setting_text` puts the file's name into `Choice.settings`."""

    name = "mujoco"
    integrators = ("", *INTEGRATORS)  # empty: the file's own
    stabilizations = ("none",)
    settings: Mapping[str, Mapping[str, object]] = {"as it stands": {}}
    native_loop = True
    python_loop = False

    def version(self) -> str:
        return Mujoco().version()

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        return None  # MuJoCo simulates the file itself, not a model of the linkage

    def build(self, mechanism: Mechanism, choice: Choice) -> OwnModelRun:
        """Return MuJoCo's model of the file that `choice.settings` names, with the changed options and the step of the choice."""
        settings = json.loads(choice.settings)  # as `setting_text` writes them
        path = Path(settings["model"])
        linkage = read_own_linkage(path, "model")
        changes = settings["changes"] | {"timestep": choice.step}
        return OwnModelRun(path, locate_links(linkage.flattened, mechanism), linkage.key, changes, choice)
