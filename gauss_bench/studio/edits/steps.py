"""Steps of the history made by edits: the tables change, the linkage is closed again, and the file follows."""

import re
from collections.abc import Callable

from gauss_bench.studio.autosave import Picture
from gauss_bench.studio.document import write_document
from gauss_bench.studio.edits.drawing import Drawing
from gauss_bench.studio.edits.geometry import GEOMETRY, move
from gauss_bench.studio.edits.keys import KEYS, lock_of
from gauss_bench.studio.edits.scenarios import drive, follow, release
from gauss_bench.studio.errors import Refused
from gauss_bench.studio.messages import Message, number, place
from gauss_bench.studio.reading import Reading, read
from gauss_bench.studio.session import Session
from gauss_bench.terms import Array

EDITS: dict[str, Callable[[Drawing, Message], None]] = {**GEOMETRY, **KEYS, "drive": drive}
STAYING = ("observe", "add_force", "drive", "rename")  # edits after which everything lies where it lay
LENGTH = 1e-8  # [m] by which a locked length may differ, for its digits
SHAPES = re.compile(r"(ground|joints|cylinders|welds|assembly)\b|links\.\w+\.points\b")  # what a linkage's places follow from
PICTURES = tuple(f"data:image/{x};base64," for x in ("png", "jpeg", "webp", "gif"))


def edit_document(session: Session, change: Callable[[Drawing], object], still: bool = False) -> list[str]:
    """Make a change one step of the history; what it made, by ids.

    Raises:
        Refused: it cannot be made; nothing has happened then.
    """
    before = session.reading
    d = Drawing(session.document, before)
    change(d)
    d.tidy() if still else _settle(session.locks, d)
    after = read(d.document)
    if not still and after.closed:
        Drawing(d.document, after).sketch()
        follow(d.document, before, after)
    release(d.document, after)
    session.put(write_document(session.text, d.document), session.locks)
    return d.made


def edit(session: Session, message: Message) -> list[str]:
    """The edit that a message asks for.

    Raises:
        Refused: it cannot be made.
    """
    verb = str(message.get("do"))
    still = verb in STAYING or (verb == "set" and not SHAPES.match(str(message.get("path"))))
    if verb == "move":
        _movable(session.locks, message)
    return edit_document(session, lambda d: EDITS[verb](d, message), still)


def try_edit(session: Session, message: Message) -> Reading:
    """The drawing as it would be with a pin at another place; nothing is kept of it.

    Raises:
        Refused: it cannot be there.
    """
    _movable(session.locks, message)
    d = Drawing(session.document, session.reading)
    move(d, message)
    _settle(session.locks, d)
    return read(d.document, starts=False)


def _movable(locks: frozenset[str], message: Message) -> None:
    given = message.get("pin")
    pin = given.get("pin") if isinstance(given, dict) else given
    if f"pins.{pin}" in locks:
        raise Refused(f"pin {pin} is locked", (f"pins.{pin}",))


def _settle(locks: frozenset[str], d: Drawing) -> None:
    """Write the sketch of a drawing whose locked lengths are what they were.

    Raises:
        Refused: one is not.
    """
    before = Drawing(d.reading.document, d.reading)
    for lock in sorted(x for x in locks if x.startswith("links.") and ":" in x):
        link, _, ends = lock.removeprefix("links.").partition(":")
        a, b = ends.split("-")
        was, now = (x.points(link) if link in x.poses else {} for x in (before, d))
        if {a, b} <= was.keys() & now.keys() and abs(abs(was[a] - was[b]) - abs(now[a] - now[b])) > LENGTH:
            raise Refused(f"the length {ends} of {link} is locked: free it, or drag the linkage instead", (f"links.{link}",))
    d.sketch()


def pose_sketch(session: Session, q: Array) -> None:
    """Draw the linkage at another position q (n,) that its joints allow."""
    edit_document(session, lambda d: d.lay(d.reading.poses(q)))


def lock(session: Session, message: Message) -> None:
    """Lock or free a pin, a slide, the angle of a link or a length.

    Raises:
        Refused: there is no such thing.
    """
    id = lock_of(Drawing(session.document, session.reading), message)
    session.put(session.text, session.locks | {id} if message.get("on", True) else session.locks - {id})


def picture(session: Session, message: Message) -> None:
    """Lay a picture behind the grid, put the one that is there elsewhere, or take it away.

    Raises:
        Refused: it is no picture, or has no place.
    """
    given = message.get("picture")
    if given is None:
        session.lay(None)
        return
    if not isinstance(given, dict):
        raise Refused("a picture has a place and a size", field="picture")
    at, width, height = place(given.get("at")), number(given, "width"), number(given, "height")
    if not (1e-6 <= width <= 1e5 and 1e-6 <= height <= 1e5):
        raise Refused("a picture is between 1e-6 and 1e5 m wide and high", field="width")
    url = given.get("url", session.picture and session.picture.url)
    if not isinstance(url, str) or not url.startswith(PICTURES):
        raise Refused("a picture is PNG, JPEG, WebP or GIF", field="picture")
    session.lay(Picture(url, (at.real, at.imag), width, height))
