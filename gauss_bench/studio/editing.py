"""How an edit becomes a step of the history: the tables change, the linkage is closed again, and the file follows."""

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gauss_bench.studio.document import written
from gauss_bench.studio.drawing import Drawing
from gauss_bench.studio.edits import GEOMETRY, move
from gauss_bench.studio.errors import Refused
from gauss_bench.studio.keys import KEYS, lock_of
from gauss_bench.studio.reading import read
from gauss_bench.studio.scenarios import drive, follow, released
from gauss_bench.studio.session import Session
from gauss_bench.terms import Array

Message = Mapping[str, Any]
STAYING = ("observe", "add_force", "drive", "rename")  # edits after which everything lies where it lay
SHAPES = re.compile(r"(ground|joints|cylinders|welds|assembly)\b|links\.\w+\.points\b")  # what a linkage's places follow from


def edited(session: Session, change: Callable[[Drawing], object], still: bool = False) -> list[str]:
    """Make a change one step of the history; what it made, by ids.

    Raises:
        Refused: it cannot be made; nothing has happened then.
    """
    before = session.reading
    d = Drawing(session.document, before)
    change(d)
    if not still:
        d.sketch()
    d.tidy()
    after = read(d.document)
    if not still and after.closed:
        closed = Drawing(d.document, after)
        closed.sketch()
        closed.tidy()
        follow(d.document, before, after)
    released(d.document, after)
    session.put(written(session.text, d.document), session.locks)
    return d.made


def edit(session: Session, message: Message) -> list[str]:
    """The edit that a message asks for.

    Raises:
        Refused: it cannot be made.
    """
    verb = str(message.get("do"))
    if verb == "move":
        return edited(session, lambda d: move(d, message, session.locks))
    still = verb in STAYING or (verb == "set" and not SHAPES.match(str(message.get("path"))))
    change = (GEOMETRY | KEYS | {"drive": drive})[verb]
    return edited(session, lambda d: change(d, message), still)


def posed(session: Session, q: Array) -> None:
    """Draw the linkage at another position q (n,) that its joints allow."""

    def change(d: Drawing) -> None:
        d.poses = {name: np.array(x) for name, x in d.reading.poses(q).items()}

    edited(session, change)


def lock(session: Session, message: Message) -> None:
    """Lock or free a pin, a slide, the angle of a link or a length.

    Raises:
        Refused: there is no such thing.
    """
    id = lock_of(Drawing(session.document, session.reading), message)
    session.put(session.text, session.locks | {id} if message.get("on", True) else session.locks - {id})


def picture(session: Session, message: Message) -> None:
    """What the page shows behind the grid; kept as it is given.

    Raises:
        Refused: it is no picture.
    """
    given = message.get("picture")
    if given is not None:
        url = given.get("url") if isinstance(given, dict) else None
        kinds = tuple(f"data:image/{x};base64," for x in ("png", "jpeg", "webp", "gif"))
        if not isinstance(url, str) or not url.startswith(kinds):
            raise Refused("a picture is PNG, JPEG, WebP or GIF", field="picture")
    session.picture = given
    session.revision += 1


EDITS = (*GEOMETRY, *KEYS, "drive", "move")
