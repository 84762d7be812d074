"""Export a drawing: its text, a picture, a table or an animation of its motion, or a model for another program."""

import base64
from typing import Any

from gauss_bench.api.exchange import STEP, write_file
from gauss_bench.api.history import angular_curves, observe, table
from gauss_bench.engines import MissingExtra
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.export import KINDS
from gauss_bench.mechanism.coordinates import motion_of_links
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.report.drawings.drawing import draw
from gauss_bench.report.drawings.shown import film
from gauss_bench.studio.autosave import temporary_file
from gauss_bench.studio.document import is_driven
from gauss_bench.studio.dragging import closed_mechanism
from gauss_bench.studio.errors import Refused
from gauss_bench.studio.messages import Message
from gauss_bench.studio.motion import move
from gauss_bench.studio.reading import Reading, of_links
from gauss_bench.trajectory import Caption, History, Trajectory

NOT_MEASURED = "Error: not measured here; `gauss-bench export` of the saved linkage measures it."
FORMS = ("toml", "svg", "csv", "gif", *KINDS)


def export_drawing(text: str, reading: Reading, message: Message) -> dict[str, Any]:
    """Return the reply with a file of the kind that a message gives: the file's `name`, and its `text` or its bytes in `base64`.

    Raises:
        Refused: the kind of file is unknown, or the drawing cannot be exported as this kind; the message gives the reason.
    """
    kind, name = message.get("kind"), str(reading.document.get("name", "drawing"))
    match kind:
        case "toml":
            return {"name": f"{name}.toml", "text": text}
        case "svg":
            mechanism = closed_mechanism(reading, "drawn as a picture")
            return {"name": f"{name}.svg", "text": draw(mechanism.whole, of_links(mechanism, reading.q))}
        case "csv" | "gif":
            mechanism, x, _ = move(text, reading, message)
            if kind == "csv":
                return {"name": f"{name}.csv", "text": table(curves(mechanism, x))}
            caption = Caption(mechanism.name, mechanism.scenario, "", mechanism.duration, float(x.t[-1]))
            gif = film(".gif", caption, curves(mechanism, x), mechanism.whole, motion_of_links(mechanism, x))
            return {"name": f"{name}.gif", "base64": base64.b64encode(gif).decode("ascii")}
        case str() if kind in KINDS:
            return _export_model(text, reading, kind, name)
    raise Refused(f"there is no export {str(kind)[:40]!r}; there are {', '.join(FORMS)}", field="kind")


def curves(mechanism: Mechanism, x: Trajectory) -> History:
    """Return the angles of all links and the places of observed points over time, with their rates."""
    whole, links = mechanism.whole, motion_of_links(mechanism, x)
    return History(x.t, (*angular_curves(whole, links, range(len(whole.links))), *observe(whole, links)))


def _export_model(text: str, reading: Reading, kind: str, name: str) -> dict[str, Any]:
    """Return the reply that has the drawing as a model for another program: the name and the text of a file of one of `KINDS`.

    The model has the first scenario without drivers, or the first scenario if all have drivers.

    Raises:
        Refused: there is no scenario, or a model of this kind cannot express the drawing.
    """
    scenarios = reading.document.get("scenarios", {})
    free = next((k for k, x in scenarios.items() if not is_driven(x)), None)
    chosen = free or next(iter(scenarios), None)
    if chosen is None:
        raise Refused("there is no scenario that could be exported: let it go or drive it first")
    with temporary_file(text, name) as path:
        try:
            remarks = (NOT_MEASURED,) if KINDS[kind].is_program else ()
            model = write_file(str(path), chosen, kind, KINDS[kind].choose(STEP), remarks)
        except (ExchangeError, MissingExtra) as error:
            raise Refused(str(error).replace(f"{path}: ", "")) from error
        return {"name": f"{name}{KINDS[kind].suffix}", "text": model.text.replace(str(path), path.name)}
