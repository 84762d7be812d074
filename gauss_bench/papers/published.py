"""Compare published reference values with the certified motion, to count how many of their printed digits are right.

Andrews' squeezing mechanism at t = 0.03 s, in the angles of the problem's statement. Source: Mazzia and Magherini, Test Set for
Initial Value Problem Solvers (2008), problem II-12; computed there by PSIDE with both tolerances at 1e-14, and copied since.
"""

from typing import Any

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import Reference

SQUEEZER = ("squeezer", "squeeze", 0.03)
VALUES = {  # angle of the problem -> (link angles to add and subtract, its printed value [rad], its printed rate [rad/s])
    "beta": (("+K1",), "15.81077119629904", "1139.920302151208"),
    "Theta": (("+K2", "-K1"), "-15.75637105984298", "-1424.379294994111"),
    "gamma": (("+K3",), "0.04082224013073101", "11.03291221937134"),
    "phi": (("+K4", "-K5"), "-0.5347301163226948", "19.29337464421385"),
    "delta": (("+K5",), "0.5244099658805304", "0.5735699284790808"),
    "Omega": (("+K6", "-K7"), "0.5347301163226948", "-19.29337464421385"),
    "epsilon": (("+K7",), "1.048080741042263", "0.3231791658026955"),
}


def list_published_values(mechanism: Mechanism, reference: Reference) -> list[dict[str, Any]]:
    """Return a row per printed value: published and certified value, their difference, and error bar and floor of the latter.

    Raises:
        ValueError: the reference does not end at the time of the published values.
    """
    linkage, scenario, t = SQUEEZER
    if abs(reference.t[-1] - t) > 1e-12:
        raise ValueError(f"the reference ends at {reference.t[-1]:g} s, the published values stand at {t:g} s")
    column = {link.name: 3 * i + 2 for i, link in enumerate(mechanism.links)}
    rows = []
    for name, (angles, *texts) in VALUES.items():
        for level, mark, text in zip("qv", ("", "'"), texts, strict=True):
            state = getattr(reference, level)[-1]
            certified = float(sum(state[column[x[1:]]] * (1 if x[0] == "+" else -1) for x in angles))
            off = abs(float(text) - certified)
            rows.append(
                {
                    "mechanism": linkage,
                    "scenario": scenario,
                    "t": t,
                    "quantity": name + mark,
                    "published": text,
                    "certified": repr(certified),
                    "difference": off,
                    "printed_digits": len(text.lstrip("-").replace(".", "").lstrip("0")),
                    "true_digits": int(np.floor(-np.log10(off / abs(certified)))) if off else 16,
                    "error_bar": float(getattr(reference, f"error_{level}")[-1]),
                    "floor": float(getattr(reference, f"floor_{level}")[-1]),
                }
            )
    return rows
