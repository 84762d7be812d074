"""Colours and markers from `palette.toml`, the same in every figure, table and drawing.

The colours are distinct under the common kinds of colour blindness (after Okabe and Ito, and Tol). Files have the light colours; a
page that embeds a picture replaces them by CSS variables, so that dark mode works.
"""

import re
import tomllib
from collections.abc import Iterable
from pathlib import Path

_DATA = tomllib.loads(Path(__file__).with_name("palette.toml").read_text(encoding="utf-8"))
COLOURS: dict[str, str] = _DATA["light"]  # name of a variable -> colour of files
DARK: dict[str, str] = _DATA["dark"]  # colours of pictures that are files of their own, as on the site
ENGINES: dict[str, str] = _DATA["engines"]
OTHERS: list[str] = _DATA["others"]
HUES: dict[str, list[str]] = _DATA["hues"]  # engine -> light, dark
SHAPES: list[str] = _DATA["shapes"]
INK, MUTED, GRID, PAPER, CONTROL = (COLOURS[x] for x in ("ink", "muted", "grid", "paper", "control"))
BODY, BODY_EDGE, CRANK, CRANK_EDGE, TRACE = (COLOURS[x] for x in ("body", "body-edge", "crank", "crank-edge", "trace"))
CURVES = (
    BODY_EDGE,
    CRANK_EDGE,
    TRACE,
    *(ENGINES[x] for x in _DATA["curves"]),
)  # colours of the lines of a panel, in turn, which also exist on dark pages
PAPERS = (PAPER, DARK["paper"])
VARIABLES = {colour: name for name, colour in COLOURS.items()}
VARIABLES |= {colour: f"engine-{name.replace('_', '-')}" for name, colour in ENGINES.items()}


def engine_colours(engines: Iterable[str]) -> dict[str, str]:
    """Return engine -> colour; engines outside the palette share OTHERS in order of their names."""
    names = sorted(set(engines))
    strangers = [name for name in names if name not in ENGINES]
    return {name: ENGINES.get(name) or OTHERS[strangers.index(name) % len(OTHERS)] for name in names}


def slots(engines: Iterable[str]) -> dict[str, str]:
    """Return engine -> CSS variable of its hue; engines outside the palette take unused hues, or grey when none is left.

    A name followed by a bracket or a comma has the hue of the engine before it.
    """
    names = {name: re.split(r" \(|,", name)[0] for name in engines}
    own = {name: f"hue-{i}" for i, name in enumerate(HUES)}
    free = [hue for name, hue in own.items() if name not in names.values()]
    return {name: own.get(engine) or (free.pop(0) if free else "control") for name, engine in names.items()}


def hues(dark: bool) -> str:
    """Return the hues as CSS variables."""
    return "".join(f"--hue-{i}:{pair[dark]};" for i, pair in enumerate(HUES.values()))


def inline(svg: str, prefix: str) -> str:
    """Prepare SVG text for embedding: remove the prologue, prefix ids, and replace colours by CSS variables."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}-\1"', svg)
    svg = re.sub(r'(href="#|url\(#)', rf"\g<1>{prefix}-", svg)
    for colour, name in VARIABLES.items():
        svg = re.sub(rf'"{colour}"', f'"var(--{name})"', svg)
        svg = re.sub(rf"(?<=: ){colour}\b", f"var(--{name})", svg)
    return svg
