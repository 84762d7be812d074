"""Answer the requests of the page: one function for every verb (kind of request) of the protocol.

README.md lists the verbs, with the keys of their messages and of the replies.
"""

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np

from gauss_bench import __version__
from gauss_bench.engines import MissingExtra
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import built_in
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.studio import dragging, dynamics, exports, files, motion
from gauss_bench.studio.autosave import Autosave, forget
from gauss_bench.studio.document import EMPTY, write_document
from gauss_bench.studio.edits import steps
from gauss_bench.studio.edits.drawing import NAME
from gauss_bench.studio.edits.poses import describe_four_bar
from gauss_bench.studio.messages import Message, Refused, check_message, value_of
from gauss_bench.studio.reading import Reading
from gauss_bench.studio.scene import scene
from gauss_bench.studio.session import Session
from gauss_bench.trajectory import in_a_sentence

Reply = dict[str, Any]
# verbs that take long or must not wait: they run beside other requests, and take the session's lock only when they need it
APART = ("drawing", "motion", "centres", "stop", "import", "export", "view")


def list_folder(session: Session, message: Message) -> Reply:
    """Return the names of the folder's linkage files, and of those files whose unsaved changes can be recovered."""
    names = files.list_files(session.folder)
    return {"files": names, "kept": [name for name in names if Autosave(str(session.folder / name)).find_unsaved()]}


def find_recoverable(session: Session) -> dict[str, str] | None:
    """Return {"text": ...} with the unsaved text of this document that an ended process has kept; None if there is none."""
    unsaved = session.autosave.find_unsaved()
    return None if unsaved is None else {"text": unsaved.text}


def hello(session: Session, message: Message) -> Reply:
    """Return the data that a page needs when it opens."""
    return {
        "version": __version__,
        "templates": files.list_templates(),
        "linkages": [*built_in()],
        "folder": session.folder.name,
        "engines": dynamics.list_engines(),
        "recovered": find_recoverable(session),
        "scene": session.scene(),
    } | list_folder(session, message)


def open_template(session: Session, message: Message) -> None:
    """Open a template."""
    session.open(files.find_template(value_of(message, "name", str)).read_text(encoding="utf-8"), is_template=True)


def drag_begin(session: Session, message: Message) -> Reply:
    """Begin to drag a pin or point; return the poses of the links at the beginning."""
    session.drag = dragging.begin_drag(session.reading, session.locks, message)
    return {"poses": session.reading.poses(session.drag.q)}


def open_file(session: Session, message: Message) -> Reply:
    """Open the drawing that a message gives by `text` (of a linkage file), `fragment` (of a URL), or `name` (file or template)."""
    if "text" in message:
        session.open(value_of(message, "text", str))
    elif "fragment" in message:
        session.open(files.unpack_fragment(value_of(message, "fragment", str)))
    else:
        text, path = files.open_document(session.folder, value_of(message, "name", str))
        session.open(text, path, is_template=path is None)
    return {"recovered": find_recoverable(session), "scene": session.scene()}


def save(session: Session, message: Message) -> Reply:
    """Save the drawing to a file, whose name becomes the name of the linkage."""
    name = value_of(message, "path", str, session.path.name if session.path else f"{session.scene()['name']}.toml")
    path = files.resolve_inside(session.folder, name if name.endswith(".toml") else f"{name}.toml")
    if not NAME.fullmatch(path.stem):
        raise Refused("the name of a linkage, and of its file, has letters, digits and underscores", field="path")
    content = write_document(session.text, session.document | {"name": path.stem})
    files.save(path, content, bool(message.get("replace")), session.path, session.saved)
    session.save_as(path, content)
    return {"path": path.name, "scene": session.scene()}


def import_model(session: Session, message: Message) -> Reply:
    """Open a model in MJCF or URDF as a drawing, and return sentences on the parts that are left out."""
    content, left_out = files.import_file(value_of(message, "text", str))
    with session.lock:
        session.open(content)
        return {"left_out": left_out, "scene": session.scene()}


def recover(session: Session, message: Message) -> None:
    """Restore the unsaved changes of this document that an ended process has kept; with `take` false, discard them."""
    unsaved = session.autosave.find_unsaved()
    if unsaved is not None:
        if message.get("take", True):
            session.replace(unsaved.text, frozenset(unsaved.locks))
            session.set_picture(unsaved.picture)
        forget(unsaved.file)


def make_edit(session: Session, message: Message) -> Reply:
    """Make an edit.

    With `trial`, the reply has the scene after the move of a pin, and the drawing does not change. With `continues`, this edit and
    the previous one become one step of the history.
    """
    if message.get("do") == "move" and message.get("trial"):
        return {"trial": session.scene() | scene(steps.try_move(session, message), session.locks)}
    before = session.text
    made = steps.edit(session, {k: x for k, x in message.items() if k != "continues"})
    if message.get("continues") is True and session.text != before:
        session.merge_steps()
    return {"made": made, "scene": session.scene()}


def drag(session: Session, message: Message) -> Reply:
    """Drag the pin or point towards the pointer; return the poses of the links and, if `centres` is true, the instant centres."""
    if session.drag is None:
        raise Refused("nothing is being dragged")
    moved = dragging.drag_linkage(session.drag, session.reading, message)
    if message.get("centres") is True:
        with contextlib.suppress(Refused):  # with several degrees of freedom there are no instant centres
            moved["centres"] = motion.instant_centres(session.reading, moved["poses"])
    return moved


def drag_end(session: Session, message: Message) -> None:
    """End the drag, and redraw the linkage at the position that it has reached; with `keep` false the drawing stays as it was."""
    ended, session.drag = session.drag, None
    if ended is not None and message.get("keep", True):
        steps.redraw(session, ended.q)


def behind(session: Session, message: Message) -> Reply:
    """Return the id and the data URL of the picture behind the grid, both None without a picture; scenes have the id alone."""
    picture = session.picture
    return {"picture": picture and picture.id, "url": picture and picture.url}


def branches(session: Session, message: Message) -> Reply:
    """Return name and poses of all assemblies with the present angles of the input links."""
    numbered = enumerate(dragging.find_branches(session.reading))  # 0: the drawn assembly
    return {"branches": [{"name": f"branch {k}" if k else "as drawn", "poses": session.reading.poses(q)} for k, q in numbered]}


def branch(session: Session, message: Message) -> None:
    """Redraw the linkage in the assembly with the number `index` in the list of `branches`."""
    index, assemblies = message.get("index"), dragging.find_branches(session.reading)
    if not isinstance(index, int) or not 0 <= index < len(assemblies):
        raise Refused("there is no such branch", field="index")
    steps.redraw(session, assemblies[index])


def read_locked(session: Session) -> tuple[str, Reading]:
    """Return the text of the drawing, and the reading of this same text.

    Requests in APART need it: they are answered while other requests may change the drawing.
    """
    with session.lock:
        return session.text, session.reading


def move_by_law(session: Session, message: Message) -> Reply:
    """Return the motion at once, and send its singular positions later in an event, because finding them takes seconds."""
    text, reading = read_locked(session)
    mechanism, reply = motion.describe_motion(text, reading, message)
    session.motions += 1
    job = -session.motions  # jobs that are processes, which `stop` can end, have positive numbers

    def search() -> None:
        """Find the singular positions of the motion, and send them as an event to the studio's pages in browsers."""
        if session.text != text or session.ended.is_set():  # the drawing has changed, or the studio ends
            return
        try:
            positions, reason = motion.find_singular(mechanism, session.ended)
        except Exception as error:
            positions, reason = [], in_a_sentence(error)
        session.tell({"event": "singular", "job": job, "singular": positions, "note": reason or None})

    session.searches.submit(search)
    return reply | {"singular": [], "job": job}


def centres(session: Session, message: Message) -> Reply:
    """Return the instant centres at one position (`at` of the message, or as drawn), or along a motion (`along`)."""
    _, reading = read_locked(session)
    if "along" in message:
        return {"centres": motion.centres_along(reading, message["along"])}
    return {"centres": motion.instant_centres(reading, message.get("at"))}


def stop(session: Session, message: Message) -> Reply:
    """Stop the job with the number `job`."""
    session.jobs.stop(value_of(message, "job", int))
    return {}


# if a function returns None, the reply is the scene
VERBS: dict[str, Callable[[Session, Message], Reply | None]] = {
    "hello": hello,
    "files": list_folder,
    "new": lambda session, _: session.open(EMPTY),
    "template": open_template,
    "drawing": lambda _, message: {"svg": files.draw_template(value_of(message, "name", str))},
    "open": open_file,
    "undo": lambda session, _: session.undo(),
    "redo": lambda session, _: session.redo(),
    "text": lambda session, _: {"text": session.text},
    "save": save,
    "import": import_model,
    "recover": recover,
    "export": lambda session, message: exports.export_drawing(*read_locked(session), message),
    "share": lambda session, _: {"fragment": files.pack_fragment(session.text)},
    "view": lambda session, _: exports.share_view(*read_locked(session)),
    "lock": steps.lock,
    "picture": steps.set_picture,
    "behind": behind,
    "drag_begin": drag_begin,
    "drag": drag,
    "drag_end": drag_end,
    "branches": branches,
    "branch": branch,
    "motion": move_by_law,
    "centres": centres,
    "four_bar": lambda _, message: describe_four_bar(message),
    "release": dynamics.release,
    "recommend": dynamics.recommend,
    "stop": stop,
    **dict.fromkeys(steps.EDITS, make_edit),
}


@np.errstate(all="ignore")  # numbers of an unfinished linkage may overflow; the scene reports this as a problem
def answer(session: Session, message: Message) -> Reply:
    """Return the reply to a message: a result, or an error with a sentence for the user. No exception leaves this function."""
    id, verb = message.get("id"), message.get("do")
    error: dict[str, Any] = {"where": (), "field": ""}
    try:
        check_message(message)
        if not isinstance(verb, str) or verb not in VERBS:
            raise Refused(f"there is no verb {str(verb)[:40]!r}", field="do")
        # verbs in APART take the lock themselves where they need it
        with contextlib.nullcontext() if verb in APART else session.lock:
            result = VERBS[verb](session, message)
            reply = {"ok": True} | ({"scene": session.scene()} if result is None else result)
    except Refused as refused:
        error |= {"text": str(refused), "where": refused.where, "field": refused.field}
    except (ChoiceError, MissingExtra) as refused:
        error["text"] = str(refused)
    except LinkageError as faults:
        error["text"] = "; ".join(str(x) for x in faults.faults[:5])
    except Exception as fault:
        text = f"a fault of the studio, not of the drawing: {type(fault).__name__}: {in_a_sentence(fault)}"
        error |= {"text": text, "fault": True}
    if "text" in error:
        reply = {"ok": False, "error": error}
    has_id = isinstance(id, (int, str)) and not isinstance(id, bool)
    return {"id": id if has_id else None} | reply
