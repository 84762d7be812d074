"""One row of the reproduction: a number with its unit and uncertainty, or a claim with its verdict, and a sentence."""

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Quantity:
    """What the report quotes.

    Attributes:
        group: chapter of the table; key: short name by which the report finds the row, unique.
        quantity: in words; value: None for a claim or an omission; unit.
        bracket: what the value is uncertain by, None where it is exact to rounding.
        verdict: of a claim: "refuted", "holds" or "not shown".
    """

    group: str
    key: str
    quantity: str
    value: float | None = None
    unit: str = ""
    bracket: float | None = None
    verdict: str = ""
    statement: str = ""

    def row(self) -> dict[str, Any]:
        return asdict(self)
