"""Read the linkage files of a run: built-in files by name, and files of a user from the copies in the run's `environment.json`."""

import hashlib
import tomllib
from functools import lru_cache
from pathlib import Path
from typing import Any

from gauss_bench.linkage.errors import Fault, LinkageError
from gauss_bench.linkage.load import built_in, document_of
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.report.drawings.pose import POSE_DEG, pose_document
from gauss_bench.report.rows import Run
from gauss_bench.terms import Array
from gauss_bench.untrusted import parse_toml

KEPT = "linkages"  # key of a run's environment, under which it has name -> text of the file


def document_in(run: Run, name: str) -> tuple[dict[str, Any], str, Path]:
    """Return the document, digest and path of a linkage of a run.

    Raises:
        LinkageError: the linkage is neither built in nor stored, or is damaged.
    """
    kept = run.environment.get(KEPT)
    text = kept.get(name) if isinstance(kept, dict) else None
    if isinstance(text, str):
        try:
            return parse_toml(text), hashlib.sha256(text.encode()).hexdigest(), Path(f"{name}.toml")
        except tomllib.TOMLDecodeError as error:
            raise LinkageError(name, [Fault("", f"as the run kept it, no TOML: {error}")]) from error
    if name not in built_in():
        raise LinkageError(name, [Fault("", "the run did not keep its file")])
    return document_of(name)


@lru_cache(maxsize=64)
def pose_in(run: Run, name: str, crank_deg: float = POSE_DEG) -> tuple[Mechanism, Array, Array | None]:
    """Return a linkage of a run, the state q (n,) to draw, and the states (k, n) of a full turn of its crank.

    Raises:
        LinkageError: for the same reasons as in `document_in`, or because the linkage does not load.
    """
    return pose_document(*document_in(run, name), crank_deg)
