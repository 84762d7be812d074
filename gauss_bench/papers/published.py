"""Compare published reference values with the certified reference of the suite, and count how many of their digits are right.

The published values are those of Andrews' squeezing mechanism at t = 0.03 s, in the angles of the problem's statement. Source:
Mazzia and Magherini, Test Set for Initial Value Problem Solvers (2008), problem II-12. The authors computed the values with the
solver PSIDE at tolerances of 1e-14; later publications copied these values.
"""

from typing import Any

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.trajectory import Reference

SQUEEZER = ("squeezer", "squeeze", 0.03)  # linkage, scenario, and time [s] of the published values

# name of an angle, its link, the link from which it is measured (None: the ground), value [rad] and rate [rad/s] as printed
VALUES = (
    ("beta", "K1", None, "15.81077119629904", "1139.920302151208"),
    ("Theta", "K2", "K1", "-15.75637105984298", "-1424.379294994111"),
    ("gamma", "K3", None, "0.04082224013073101", "11.03291221937134"),
    ("phi", "K4", "K5", "-0.5347301163226948", "19.29337464421385"),
    ("delta", "K5", None, "0.5244099658805304", "0.5735699284790808"),
    ("Omega", "K6", "K7", "0.5347301163226948", "-19.29337464421385"),
    ("epsilon", "K7", None, "1.048080741042263", "0.3231791658026955"),
)


def list_published_values(mechanism: Mechanism, reference: Reference) -> list[dict[str, Any]]:
    """Return a row for each printed value: printed and certified value, difference, and numbers of printed and of right digits.

    The row's `floor` is the change of the certified value if the numbers of the linkage are rounded to doubles. The reference must
    end at the time of the published values.
    """
    linkage, scenario, t = SQUEEZER
    assert abs(reference.t[-1] - t) < 1e-12
    index = {link.name: i for i, link in enumerate(mechanism.links)}
    rows = []
    for angle, link, base, value, rate in VALUES:
        for level, mark, text in (("q", "", value), ("v", "'", rate)):  # mark: added to the name of a rate
            state = getattr(reference, level)[-1]  # (n,) positions or rates at the end
            certified = float(angle_at(state, index[link]))
            if base:
                certified -= float(angle_at(state, index[base]))
            off = abs(float(text) - certified)
            rows.append(
                {
                    "mechanism": linkage,
                    "scenario": scenario,
                    "t": t,
                    "quantity": angle + mark,
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
