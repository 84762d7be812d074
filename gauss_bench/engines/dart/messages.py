"""Catch the messages that DART prints: DART reports faults only by messages, and then continues.

If numbers are not finite after a step, DART sets them to zero and prints a message in every later step, perhaps 100,000 lines. The
last samples of a run that fails in this way are zeros, which look like a linkage at rest.
"""

import os
import re
import sys
import tempfile
from types import TracebackType

from gauss_bench.trajectory import RunFailure, Status, in_a_sentence

STREAMS = (1, 2)  # descriptors of standard output and standard error
COLOURS = re.compile(r"\x1b\[[0-9;]*m")  # codes for colours of a terminal
READ = 4000  # [bytes] that `check` reads of the messages


class Messages:
    """A context in which standard output and standard error go to a file; `check` raises a failure if something was printed."""

    def __enter__(self) -> "Messages":
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        self.file = tempfile.TemporaryFile()
        self.saved = [os.dup(stream) for stream in STREAMS]  # duplicates of the descriptors
        for stream in STREAMS:
            os.dup2(self.file.fileno(), stream)  # from here on, the output of this process goes to the file
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for stream, saved in zip(STREAMS, self.saved, strict=True):
            os.dup2(saved, stream)
            os.close(saved)
        self.file.close()

    def check(self) -> None:
        """Raise RunFailure with the first line of DART's messages, if there are any."""
        if os.fstat(self.file.fileno()).st_size:
            first = os.pread(self.file.fileno(), READ, 0).decode(errors="replace").strip().partition("\n")[0]
            raise RunFailure(Status.WARNING, f"DART: {in_a_sentence(COLOURS.sub('', first))}")
