"""Hold an open drawing with its history of texts for undo and redo, its locks, and the picture behind it."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from gauss_bench.kinematics.dragging import Drag
from gauss_bench.studio.autosave import Autosave, Picture, forget
from gauss_bench.studio.document import EMPTY, Document, parse_text
from gauss_bench.studio.jobs import Jobs
from gauss_bench.studio.reading import Reading, read
from gauss_bench.studio.scene import scene

STEPS = 200  # largest number of steps that can be undone


class Session:
    """The open document. The text of its linkage file determines the drawing.

    Attributes:
        folder: folder in which files may be opened and saved.
        lock: lock that a thread must hold when it uses the state.
        path: file from which the text was opened, or to which it was saved; or None.
        saved: text that exists elsewhere and cannot be lost: of the file or template, or EMPTY; "" for a pasted or imported text.
        done, undone: states (text, locks) before the present state and after it, for undo and redo.
        locks: ids of locked pins, slides, links, joints and lengths.
        revision: number of changes of the document so far.
        motions: number of motions computed so far.
        searches: thread that searches for singular positions, one motion after the other.
        ended: event that is set when the session ends, so that a running search ends.
        tell: function that sends an event to all pages.
    """

    def __init__(self, folder: Path):
        """Begin with an empty drawing in a working folder."""
        self.folder = folder.resolve()
        self.lock = threading.RLock()
        self.revision = 0
        self.motions, self.searches = 0, ThreadPoolExecutor(1)
        self.ended = threading.Event()
        self._set_path(None)
        self.tell: Callable[[dict[str, Any]], object] = lambda event: None
        self.jobs = Jobs(lambda event: self.tell(event))
        self._begin(EMPTY, EMPTY)

    def _set_path(self, path: Path | None) -> None:
        """Make `path` the document's file, under whose name unsaved work is kept from now on; None for a new drawing."""
        self.path = path
        self.autosave = Autosave(str(path or self.folder / "a new drawing"))

    def _begin(self, text: str, saved: str) -> None:
        """Replace the state by a text, and clear the history; `saved` is the new value of the attribute `saved`."""
        self.text, self.saved = text, saved
        self.undone: list[tuple[str, frozenset[str]]] = []
        self.done: list[tuple[str, frozenset[str]]] = []
        self.locks: frozenset[str] = frozenset()
        self.picture: Picture | None = None
        self._read: tuple[str, Reading] | None = None
        self.drag: Drag | None = None

    def open(self, text: str, path: Path | None = None, is_template: bool = False) -> None:
        """Open a text, with a new history; `path` is its file, or None. An unchanged template does not count as unsaved."""
        parse_text(text)  # raises if the text is no linkage file
        forget(self.autosave.file)
        # only a text that was pasted or imported exists nowhere else
        self._begin(text, text if path or is_template or text == EMPTY else "")
        self._set_path(path)
        self._complete_change()

    def save_as(self, path: Path, text: str) -> None:
        """Record that `text` has been saved to the file `path`: make it the present text, and delete the file of unsaved work."""
        forget(self.autosave.file)
        self.text, self.saved = text, text
        self._set_path(path)
        self._complete_change()

    @property
    def is_unsaved(self) -> bool:
        """Whether the present text exists nowhere else, so that it would be lost at the end of the session."""
        return self.text != self.saved

    @property
    def document(self) -> Document:
        """The tables of the linkage file's text, parsed anew at each access, so that an edit may change them."""
        return parse_text(self.text)

    @property
    def reading(self) -> Reading:
        """The mechanism, positions and problems that are read from the present text; read anew only if the text has changed."""
        if self._read is None or self._read[0] != self.text:
            self._read = self.text, read(self.document)
        return self._read[1]

    def replace(self, text: str, locks: frozenset[str]) -> None:
        """Replace the text of the linkage file and the set of locked parts, as one step of the history, if they differ."""
        if (text, locks) == (self.text, self.locks):
            return
        parse_text(text)  # raises if the text is no linkage file
        self.done = [*self.done, (self.text, self.locks)][-STEPS:]
        self.undone = []
        self.text, self.locks = text, locks
        self._complete_change()

    def merge_steps(self) -> None:
        """Merge the last two steps of the history into one."""
        if len(self.done) > 1:
            self.done.pop()

    def undo(self) -> None:
        """Undo the last step of the history."""
        self._step(self.done, self.undone)

    def redo(self) -> None:
        """Redo the step of the history that was undone last."""
        self._step(self.undone, self.done)

    def _step(self, source: list[tuple[str, frozenset[str]]], target: list[tuple[str, frozenset[str]]]) -> None:
        """Go one step back or forth: append the present state to the list `target`, and restore the last state of `source`."""
        if source:
            target.append((self.text, self.locks))
            self.text, self.locks = source.pop()
            self._complete_change()

    def set_picture(self, picture: Picture | None) -> None:
        """Set or remove the picture behind the grid; the history for undo and redo does not record this."""
        self.picture = picture
        self._complete_change()

    def _complete_change(self) -> None:
        """Complete a change of the document: count it, end a drag, and write unsaved work to the autosave file or delete it."""
        self.revision += 1
        self.drag = None
        if self.is_unsaved or self.picture:  # a linkage file cannot hold the picture, which therefore counts as unsaved here
            self.autosave.keep(self.text, tuple(sorted(self.locks)), self.picture)
        else:
            forget(self.autosave.file)

    def scene(self) -> dict[str, Any]:
        """Return the scene that the page draws, together with the state of the session."""
        state = {
            "revision": self.revision,
            "path": self.path and self.path.name,
            "unsaved": self.is_unsaved,
            "can_undo": bool(self.done),
            "can_redo": bool(self.undone),
            "picture": self.picture and self.picture.describe(),
        }
        return state | scene(self.reading, self.locks)

    def close(self) -> bool:
        """End the session, and return whether there are unsaved changes, which stay in the autosave file."""
        self.jobs.stop_all()
        self.ended.set()
        # wait for a running search: a thread in native code while the interpreter ends would abort the process
        self.searches.shutdown(cancel_futures=True)
        if not self.is_unsaved:
            forget(self.autosave.file)
        return self.is_unsaved
