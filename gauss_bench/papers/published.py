"""Published reference values held against the certified motion: how many of their printed digits are true.

Andrews' squeezing mechanism at t = 0.03 s, in the angles of the problem's statement. Source: Mazzia and Magherini, Test Set for
Initial Value Problem Solvers (2008), problem II-12; computed there by PSIDE with both tolerances at 1e-14, and copied since.
"""

from typing import Any, NamedTuple

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import Reference


class Published(NamedTuple):
    """A value as printed, of an angle given as a sum of link angles with signs."""

    name: str
    terms: tuple[tuple[int, str], ...]
    angle: str
    rate: str


SQUEEZER = ("squeezer", "squeeze", 0.03)
VALUES = (
    Published("beta", ((1, "K1"),), "15.81077119629904", "1139.920302151208"),
    Published("Theta", ((1, "K2"), (-1, "K1")), "-15.75637105984298", "-1424.379294994111"),
    Published("gamma", ((1, "K3"),), "0.04082224013073101", "11.03291221937134"),
    Published("phi", ((1, "K4"), (-1, "K5")), "-0.5347301163226948", "19.29337464421385"),
    Published("delta", ((1, "K5"),), "0.5244099658805304", "0.5735699284790808"),
    Published("Omega", ((1, "K6"), (-1, "K7")), "0.5347301163226948", "-19.29337464421385"),
    Published("epsilon", ((1, "K7"),), "1.048080741042263", "0.3231791658026955"),
)


def list_published_values(mechanism: Mechanism, reference: Reference) -> list[dict[str, Any]]:
    """A row per printed value: itself, the certified one, their difference, the bar and the floor of the certified one.

    Raises:
        ValueError: the reference does not end at the time of the published values.
    """
    if abs(reference.t[-1] - SQUEEZER[2]) > 1e-12:
        raise ValueError(f"the reference ends at {reference.t[-1]:g} s, the published values stand at {SQUEEZER[2]:g} s")
    column = {link.name: 3 * i + 2 for i, link in enumerate(mechanism.links)}
    rows = []
    for value in VALUES:
        for level, text in (("q", value.angle), ("v", value.rate)):
            state = getattr(reference, level)[-1]
            bars = [float(getattr(reference, f"{kind}_{level}")[-1]) for kind in ("error", "floor")]
            rows.append(
                _row(
                    value.name if level == "q" else f"{value.name}'", text, sum(s * state[column[x]] for s, x in value.terms), bars
                )
            )
    return rows


def _row(name: str, text: str, certified: float, bars: list[float]) -> dict[str, Any]:
    off = abs(float(text) - certified)
    return {
        "mechanism": SQUEEZER[0],
        "scenario": SQUEEZER[1],
        "t": SQUEEZER[2],
        "quantity": name,
        "published": text,
        "certified": repr(float(certified)),
        "difference": off,
        "printed_digits": len(text.lstrip("-").replace(".", "").lstrip("0")),
        "true_digits": int(np.floor(-np.log10(off / abs(certified)))) if off else 16,
        "error_bar": bars[0],
        "floor": bars[1],
    }
