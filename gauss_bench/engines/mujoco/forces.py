"""Former names of functions that are now in `mjcf/forces.py` and `tree_loads.py`; a plug-in that uses one gets a warning."""

import warnings
from typing import Any

from gauss_bench.engines import tree_loads
from gauss_bench.engines.mjcf import forces
from gauss_bench.engines.tree import turning as turning

HOMES = {  # module -> names that are now there
    tree_loads: ("ALIGNED", "OnJoints", "Steady", "along_slide", "is_reaction", "on_joints", "slide_coordinate", "slide_motors"),
    forces: ("AtSite", "Native", "Tendon", "along_axis", "native_forces", "other_load", "point_force"),
}
MOVED = {name: home for home, names in HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in MOVED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = MOVED[name]
    warnings.warn(f"{__name__}.{name} is now {home.__name__}.{name}", DeprecationWarning, stacklevel=2)
    return getattr(home, name)
