"""Make an edit as one step of the history: change the tables, close the joints again, and write the text of the file."""

import re
from collections.abc import Callable

from gauss_bench.studio.autosave import Picture
from gauss_bench.studio.document import write_document
from gauss_bench.studio.edits.drawing import Drawing
from gauss_bench.studio.edits.geometry import GEOMETRY, move
from gauss_bench.studio.edits.keys import KEYS, lock_of
from gauss_bench.studio.edits.poses import synthesize
from gauss_bench.studio.edits.scenarios import drive, start_released, update_starts
from gauss_bench.studio.messages import Message, Refused, number, place
from gauss_bench.studio.reading import Reading, read
from gauss_bench.studio.session import Session
from gauss_bench.terms import Array

EDITS: dict[str, Callable[[Drawing, Message], None]] = {**GEOMETRY, **KEYS, "drive": drive, "synthesize": synthesize}
STAYING = ("observe", "add_force", "drive", "rename")  # edits that move no link
LENGTH = 1e-8  # [m] largest change of a locked length that is taken as rounding in the file
SHAPES = re.compile(r"(ground|joints|cylinders|welds|assembly)\b|links\.\w+\.points\b")  # paths of keys that place the links
PICTURES = tuple(f"data:image/{x};base64," for x in ("png", "jpeg", "webp", "gif"))


def edit_document(session: Session, change: Callable[[Drawing], object], moves: bool = True) -> list[str]:
    """Make a change as one step of the history, and return the ids of the parts that it made.

    `change` edits tables and poses. If links may have moved (`moves`), the changed places are written into the sketch, the joints
    are closed again, and the start values of scenarios follow.

    Raises:
        Refused: the change cannot be made; the session is then unchanged.
    """
    before = session.reading
    d = Drawing(session.document, before)
    change(d)
    if moves:
        _check_locks(session.locks, d)
        d.write_sketch()  # writes the changed places into the document, from which `read` closes the joints
    else:
        d.tidy()
    after = read(d.document, starts=False)
    if moves and after.closed:
        Drawing(d.document, after).write_sketch()
        update_starts(d.document, before, after)
    start_released(d.document, after)
    session.replace(write_document(session.text, d.document), session.locks)
    return d.made


def edit(session: Session, message: Message) -> list[str]:
    """Make the edit that a message requests, and return the ids of the parts that it made."""
    verb = str(message.get("do"))
    moves_no_link = verb in STAYING or (verb == "set" and not SHAPES.match(str(message.get("path"))))
    if verb == "move":
        _check_pin(session.locks, message)
    return edit_document(session, lambda d: EDITS[verb](d, message), moves=not moves_no_link)


def try_move(session: Session, message: Message) -> Reading:
    """Return the drawing as it would be read after the move of a pin; the session does not change."""
    _check_pin(session.locks, message)
    d = Drawing(session.document, session.reading)
    move(d, message)
    _check_locks(session.locks, d)
    d.write_sketch()
    return read(d.document, starts=False)


def _check_pin(locks: frozenset[str], message: Message) -> None:
    """Refuse a message that names a locked pin."""
    choice = message.get("pin")  # the id of a pin, {"pin": id}, or the place of a new pin
    pin = choice.get("pin") if isinstance(choice, dict) else choice
    if f"pins.{pin}" in locks:
        raise Refused(f"pin {pin} is locked", (f"pins.{pin}",))


def _check_locks(locks: frozenset[str], d: Drawing) -> None:
    """Refuse an edit that has changed a locked length by more than LENGTH."""
    before = Drawing(d.reading.document, d.reading)
    for lock in sorted(x for x in locks if x.startswith("links.") and ":" in x):  # a locked length: "links.LINK:A-B"
        link, _, ends = lock.removeprefix("links.").partition(":")
        a, b = ends.split("-")
        if link not in before.poses or link not in d.poses:  # the edit deletes the link
            continue
        old, new = before.points(link), d.points(link)
        if {a, b} <= old.keys() & new.keys() and abs(abs(old[a] - old[b]) - abs(new[a] - new[b])) > LENGTH:
            raise Refused(f"the length {ends} of {link} is locked: free it, or drag the linkage instead", (f"links.{link}",))


def redraw(session: Session, q: Array) -> None:
    """Redraw the linkage at other positions q (n,), at which its joints are closed."""
    edit_document(session, lambda d: d.set_poses(d.reading.poses(q)))


def lock(session: Session, message: Message) -> None:
    """Lock a pin, a slide, a length or an angle; with `on` false, free it."""
    id = lock_of(Drawing(session.document, session.reading), message)
    locks = session.locks | {id} if message.get("on", True) else session.locks - {id}
    session.replace(session.text, locks)


def set_picture(session: Session, message: Message) -> None:
    """Set, move or remove the picture behind the grid."""
    entries = message.get("picture")
    if entries is None:
        session.set_picture(None)
        return
    if not isinstance(entries, dict):
        raise Refused("a picture has a place and a size", field="picture")
    at, width, height = place(entries.get("at")), number(entries, "width"), number(entries, "height")
    if not (1e-6 <= width <= 1e5 and 1e-6 <= height <= 1e5):
        raise Refused("a picture is at least 1e-6 m and at most 1e5 m wide and high", field="width")
    url = entries.get("url", session.picture and session.picture.url)  # without a URL, the present picture is moved
    if not isinstance(url, str) or not url.startswith(PICTURES):
        raise Refused("a picture is PNG, JPEG, WebP or GIF", field="picture")
    session.set_picture(Picture(url, (at.real, at.imag), width, height))
