"""Run exported files in processes that cannot import this package, and read the tables that they print."""

import csv
import io
import subprocess
import sys
from pathlib import Path

import numpy as np

from gauss_bench.engines.c_code import compiler
from gauss_bench.terms import Array
from tests.bare import ENVIRONMENT

LIMIT = 300.0
BLOCKED = """
import runpy, sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "gauss_bench":
            raise ImportError("gauss_bench is blocked")

sys.meta_path.insert(0, Blocker())
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


def output_of(*command: object, cwd: Path | None = None, env: dict[str, str] | None = None) -> str:
    """Return what a command prints; it must end with exit code 0."""
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, timeout=LIMIT, cwd=cwd, env=env, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def python_alone(file: Path, *arguments: object) -> str:
    """Return the output of a script in a process that cannot import gauss_bench, and has only installed packages on its path."""
    return output_of(sys.executable, "-I", "-c", BLOCKED, file, *arguments, cwd=file.parent, env=ENVIRONMENT)


def c_alone(file: Path, *arguments: object) -> str:
    """Compile a program in C without warnings, and return its output."""
    program = file.with_suffix(".exe")
    warnings = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter", "-Wno-unused-variable"]
    output_of(compiler(), "-O0", *warnings, file, "-o", program, "-lm")
    return output_of(program, *arguments)


def rows_of(printed: str) -> tuple[list[str], Array]:
    """Return the headings and the numbers (rows, columns) of a printed table."""
    heading, *rows = csv.reader(io.StringIO(printed))
    return heading, np.array(rows, dtype=float)
