"""Colours, markers and lines, the same in every figure, table and drawing.

Colours are told apart with any usual colour blindness (after Okabe and Ito, and Tol). Files carry the light colours; a page that
takes a picture inline puts a CSS variable in their place and so can turn dark.
"""

import re
from collections.abc import Iterable, Mapping
from typing import TypeVar

T = TypeVar("T")

INK, MUTED, GRID, PAPER = "#1f2328", "#6a737d", "#dfe3e8", "#ffffff"
BODY, BODY_EDGE, CRANK, CRANK_EDGE, TRACE = "#dde6f0", "#3f5f80", "#fbdcc9", "#b4480b", "#0a7ea4"

ENGINES = {
    "gauss": "#d55e00",
    "gauss_pinv": "#e69f00",
    "lagrange": "#0072b2",
    "schur": "#56b4e9",
    "udwadia_kalaba": "#009e73",
    "pinocchio": "#cc79a7",
    "exudyn": "#a08a00",
    "mujoco": "#882255",
}
CURVES = (  # lines of one panel, in turn; as dark pages have them already
    BODY_EDGE,
    CRANK_EDGE,
    TRACE,
    ENGINES["mujoco"],
    ENGINES["udwadia_kalaba"],
    ENGINES["gauss_pinv"],
    ENGINES["pinocchio"],
    ENGINES["exudyn"],
)
OTHERS = ("#44aa99", "#332288", "#cc6677", "#117733", "#aa4499")
CONTROL = "#8b8b8b"
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
LINES = ("-", "--", ":", "-.", (0, (6, 1, 1, 1, 1, 1)), (0, (8, 3)), (0, (1, 3)), (0, (8, 2, 2, 2)))

VARIABLES = {
    INK: "ink",
    MUTED: "muted",
    GRID: "grid",
    PAPER: "paper",
    BODY: "body",
    BODY_EDGE: "body-edge",
    CRANK: "crank",
    CRANK_EDGE: "crank-edge",
    TRACE: "trace",
    CONTROL: "control",
} | {colour: f"engine-{name.replace('_', '-')}" for name, colour in ENGINES.items()}

DARK = {  # of pictures that stand alone; as the site's
    "ink": "#e6e9ed",
    "muted": "#a3acb8",
    "grid": "#2a3038",
    "paper": "#15181d",
    "body": "#2b3a4a",
    "body-edge": "#9db8d4",
    "crank": "#4a2c1a",
    "crank-edge": "#ff9b5e",
    "trace": "#58c4e6",
    "control": "#a0a0a0",
}


def engine_colours(engines: Iterable[str], controls: Iterable[str] = ()) -> dict[str, str]:
    """Engine -> colour; engines this file does not know share OTHERS in order of their names."""
    names, grey = sorted(set(engines)), set(controls)
    strangers = [name for name in names if name not in ENGINES and name not in grey]
    own = {name: OTHERS[i % len(OTHERS)] for i, name in enumerate(strangers)}
    return {name: CONTROL if name in grey else ENGINES.get(name) or own[name] for name in names}


HUES = {  # engine -> (light, dark); told apart in pairs by whoever sees red, green or neither, and legible on either page
    "gauss-native": ("#cb3e02", "#ec8341"),
    "lagrange-native": ("#1a6ed0", "#5cabff"),
    "mujoco": ("#81288b", "#b883c0"),
    "exudyn": ("#787a49", "#d7d449"),
    "pinocchio": ("#d95a95", "#fe96b6"),
    "casadi": ("#2e696e", "#2bcab9"),
    "minimal": ("#4726e0", "#8270fc"),
    "by_hand": ("#33393f", "#ececec"),
    "gauss": ("#d77c02", "#b86b1e"),
    "lagrange": ("#3e98de", "#2f70b1"),
}
PAPERS = ("#ffffff", "#15181d")  # behind them
SHAPES = (
    "circle",
    "square",
    "triangle-up",
    "diamond",
    "cross",
    "triangle-down",
    "triangle-right",
    "triangle-left",
    "stroke",
    "arrow",
)


def slots(engines: Iterable[str]) -> dict[str, str]:
    """Engine -> name of the CSS variable of its hue; strangers take hues that are not in use, and grey when none is left."""
    names = list(dict.fromkeys(engines))
    free = [f"hue-{i}" for i, name in enumerate(HUES) if name not in names]
    own = {name: f"hue-{i}" for i, name in enumerate(HUES)}
    return {name: own.get(name) or (free.pop(0) if free else "control") for name in names}


def hues(dark: bool) -> str:
    """The hues as CSS."""
    return "".join(f"--hue-{i}:{pair[dark]};" for i, pair in enumerate(HUES.values()))


def cycle(names: Iterable[str], values: tuple[T, ...]) -> Mapping[str, T]:
    """Name -> value; "default" and "rk4" come first so that the commonest case looks the same everywhere."""
    ordered = sorted(set(names), key=lambda x: (x not in ("default", "rk4"), x))
    return {name: values[i % len(values)] for i, name in enumerate(ordered)}


def inline(svg: str, prefix: str) -> str:
    """An SVG file's text for use inside a page: no prologue, its own ids, colours by CSS variable."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}-\1"', svg)
    svg = re.sub(r'(href="#|url\(#)', rf"\g<1>{prefix}-", svg)
    for colour, name in VARIABLES.items():
        svg = re.sub(rf'"{colour}"', f'"var(--{name})"', svg)
        svg = re.sub(rf"(?<=: ){colour}\b", f"var(--{name})", svg)
    return svg
