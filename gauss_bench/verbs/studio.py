"""Start the studio, whose libraries are an optional extra."""

from argparse import Namespace
from pathlib import Path

from gauss_bench.api.telling import Answer, Told
from gauss_bench.engines import require


def studio(options: Namespace, told: Told) -> Answer[None]:
    """Serve the studio's page until the user interrupts it."""
    for library in ("starlette", "uvicorn", "websockets", "tomlkit"):
        require(library)
    from gauss_bench.studio.server import serve  # imports these libraries

    serve(options.linkage, Path.cwd(), options.port, not options.no_browser, told)
    return Answer(None, text="")
