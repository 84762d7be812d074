"""Ask engines for the programs that they write (`program` in `engines/base.py`), in the engine's process, and check the programs.

An engine's process imports this file and may have no package but numpy.
"""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gauss_bench.engines import get, not_installed
from gauss_bench.engines.base import Choice, ask
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.offers import has_method, interpreter_of
from gauss_bench.runs.worker import Worker
from gauss_bench.trajectory import RunFailure, Status, in_a_sentence

LONGEST = 1 << 20  # characters of a program


def writes_programs(engine: str) -> bool:
    """Tell whether an engine writes programs itself; an unknown engine writes none."""
    return has_method(engine, "program")


def program_there(engine: str, mechanism: Mechanism, choice: Choice) -> dict[str, Any]:
    """Ask an engine, in its process, for a Python program that computes the mechanism's motion.

    Return {"text": program}, or {"refused": why there is none}.
    """
    try:
        adapter = get(engine)
        if reason := adapter.skip(mechanism, choice):
            return {"refused": in_a_sentence(reason)}
        return {"text": ask(adapter, "program")(mechanism, choice)}
    except RunFailure as failure:
        return {"refused": in_a_sentence(failure)}
    except ImportError as error:
        return {"refused": f"{engine} is {not_installed(error)}"}


def run_there(text: str, seconds: float) -> dict[str, Any]:
    """Run a program under this interpreter; return {"printed": its output} or {"failed": why it failed}.

    The program sees only the packages of the interpreter's environment, and is stopped after `seconds` [s].
    """
    with TemporaryDirectory() as folder:
        file = Path(folder, "linkage.py")
        file.write_text(text, encoding="utf-8")
        try:
            command = [sys.executable, "-I", str(file)]
            done = subprocess.run(command, capture_output=True, text=True, timeout=seconds, cwd=folder, check=False)
        except subprocess.TimeoutExpired:
            return {"failed": f"the program took longer than {round(seconds, 1):g} s"}
    if done.returncode:
        errors = done.stderr.strip().splitlines() or [f"the program ended with code {done.returncode}"]
        return {"failed": in_a_sentence(errors[-1])}
    return {"printed": done.stdout}


def ask_program(worker: Worker, engine: str, mechanism: Mechanism, choice: Choice, limit: float) -> str:
    """Return the program that an engine writes in a worker, which may take `limit` [s].

    Raises:
        RunFailure: as in `read_program`.
        WorkerFailure: the engine's process failed.
    """
    asked = worker.under(interpreter_of(engine)).call(program_there, (engine, mechanism, choice), limit)
    return read_program(engine, asked)


def read_program(engine: str, answer: object) -> str:
    """Return the program in the answer of `program_there`.

    Raises:
        RunFailure: the engine refused, or its answer is not a Python program.
    """
    match answer:
        case {"refused": str(reason)}:
            raise RunFailure(Status.SKIP, reason)
        case {"text": str(text)} if text.strip() and len(text) <= LONGEST:
            try:
                compile(text, f"program of {engine}", "exec")
            except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
                raise RunFailure(Status.ERROR, f"the text from {engine} is no program in Python: {in_a_sentence(error)}") from error
            return text
    raise RunFailure(Status.ERROR, f"the text from {engine} is no program of at most {LONGEST} characters")
