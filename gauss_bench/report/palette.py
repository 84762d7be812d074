"""Colours and markers from `palette.toml`, the same in every figure, table and drawing.

The colours are distinct under the common kinds of colour blindness (after Okabe and Ito, and Tol). Picture files have the light
colours; a page that embeds a picture replaces them by CSS variables, which follow dark mode.
"""

import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path

_DATA = tomllib.loads(Path(__file__).with_name("palette.toml").read_text(encoding="utf-8"))
COLOURS: dict[str, str] = _DATA["light"]  # name of a CSS variable -> its light colour
DARK: dict[str, str] = _DATA["dark"]  # name of a CSS variable -> its dark colour
ENGINES: dict[str, str] = _DATA["engines"]  # engine -> colour
OTHERS: list[str] = _DATA["others"]  # colours of engines that are not in ENGINES
HUES: dict[str, list[str]] = _DATA["hues"]  # engine -> its light and its dark colour
SHAPES: list[str] = _DATA["shapes"]  # markers of engines, in turn
INK, MUTED, GRID, PAPER, CONTROL = (COLOURS[x] for x in ("ink", "muted", "grid", "paper", "control"))
BODY, BODY_EDGE, CRANK, CRANK_EDGE, TRACE = (COLOURS[x] for x in ("body", "body-edge", "crank", "crank-edge", "trace"))
CURVES = (BODY_EDGE, CRANK_EDGE, TRACE, *(ENGINES[x] for x in _DATA["curves"]))  # colours of the lines of a panel, in turn
VARIABLES = {colour: name for name, colour in COLOURS.items()}  # light colour -> name of its CSS variable
VARIABLES |= {colour: f"engine-{name.replace('_', '-')}" for name, colour in ENGINES.items()}


def engine_colours(engines: Iterable[str]) -> dict[str, str]:
    """Return engine -> colour; engines outside ENGINES get OTHERS in turn, in the order of names."""
    names = sorted(set(engines))
    others = [name for name in names if name not in ENGINES]
    return {name: ENGINES.get(name) or OTHERS[others.index(name) % len(OTHERS)] for name in names}


def assign_hues(engines: Iterable[str]) -> dict[str, str]:
    """Return label -> CSS variable with the colour of its engine; engines outside HUES get unused colours, then grey.

    Args:
        engines: labels such as "gauss", "gauss (own)" or "pinocchio, compiled", which begin with the name of an engine.
    """
    names = {label: re.split(r" \(|,", label)[0] for label in engines}  # label -> engine
    hue_of = {name: f"hue-{i}" for i, name in enumerate(HUES)}  # engine -> CSS variable
    unused = [hue for name, hue in hue_of.items() if name not in names.values()] + ["control"] * len(names)  # "control" is grey
    return {label: hue_of.get(name) or unused.pop(0) for label, name in names.items()}


def declare(colours: Mapping[str, str]) -> str:
    """Return declarations of CSS variables, such as "--ink:#1f2328;", from name -> colour."""
    return "".join(f"--{name}:{colour};" for name, colour in colours.items())


def declare_hues(dark: bool) -> str:
    """Return declarations of CSS variables with the colours HUES, for the light or the dark mode."""
    return declare({f"hue-{i}": pair[1 if dark else 0] for i, pair in enumerate(HUES.values())})


def inline(svg: str, prefix: str) -> str:
    """Prepare the text of an SVG file for a page: remove its prologue, prefix its ids, and replace its colours by CSS variables."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}-\1"', svg)
    svg = re.sub(r'(href="#|url\(#)', rf"\g<1>{prefix}-", svg)
    for colour, name in VARIABLES.items():
        svg = re.sub(rf'"{colour}"', f'"var(--{name})"', svg)  # in attributes
        svg = re.sub(rf"(?<=: ){colour}\b", f"var(--{name})", svg)  # in styles
    return svg
