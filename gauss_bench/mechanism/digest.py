"""What a motion depends on, as one digest: a comment or a title may change, a mass or a start may not."""

import hashlib
import json
from decimal import Decimal
from typing import Any

PHYSICS = ("gravity", "ground", "links", "joints", "constraints", "crank", "assembly")
SCENARIO = ("start", "driver", "drivers", "forces")


def physics_digest(document: dict[str, Any], scenario: str) -> str:
    """SHA-256 of everything in a document, its scenario's override already merged, that the motion of the scenario follows from."""
    chosen = {k: v for k, v in document["scenarios"][scenario].items() if k in SCENARIO}
    acting = {name: document["forces"][name] for name in chosen.get("forces", [])}
    physics = {k: v for k, v in document.items() if k in PHYSICS} | {"forces": acting, "scenario": chosen}
    return hashlib.sha256(json.dumps(_canonical(physics), sort_keys=True).encode()).hexdigest()


def _canonical(item: Any) -> Any:
    """Numbers as one decimal text, however they are written."""
    if isinstance(item, dict):
        return {str(k): _canonical(v) for k, v in item.items()}
    if isinstance(item, (list, tuple)):
        return [_canonical(v) for v in item]
    if isinstance(item, (int, float, Decimal)) and not isinstance(item, bool):
        return str(Decimal(repr(float(item))).normalize() + 0)
    return item
