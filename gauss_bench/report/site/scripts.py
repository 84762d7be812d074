"""The scripts that draw charts, out of the wheel that carries them: Vega, Vega-Lite and Vega-Embed as one classic script."""

from functools import cache

import altair
import vl_convert


@cache
def drawing_script() -> str:
    """The bundle, which leaves `vegaEmbed` behind and nothing else; no module, no request."""
    version = ".".join(altair.SCHEMA_VERSION.lstrip("v").split(".")[:2])
    bundle = str(vl_convert.javascript_bundle("window.vegaEmbed = vegaEmbed;", vl_version=version))
    return f"(function () {{\n{bundle}\n}})();\n"
