"""Export a drawing: its text, a picture, a table or animation of its motion, a model, or a URL that holds file and motion."""

import base64
from typing import Any

from gauss_bench.api.exchange import STEP, write_file
from gauss_bench.api.history import angular_curves, point_curves, table
from gauss_bench.engines import MissingExtra
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.export import KINDS
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import load
from gauss_bench.linkage.references import items
from gauss_bench.mechanism.coordinates import motion_of_links
from gauss_bench.report.drawings.drawing import draw
from gauss_bench.report.drawings.shown import encode_film
from gauss_bench.report.site.view import INTERVALS, VIEW, TooLarge, pack_view
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.studio.autosave import temporary_file
from gauss_bench.studio.document import is_driven
from gauss_bench.studio.dragging import closed_mechanism
from gauss_bench.studio.messages import Message, Refused
from gauss_bench.studio.motion import move
from gauss_bench.studio.reading import Reading, positions_of_links
from gauss_bench.trajectory import Caption, History

# comment in an exported program, where `gauss-bench export` writes the measured error
NOT_MEASURED = "Error: not measured here; `gauss-bench export` of the saved linkage measures it."
FORMS = ("toml", "svg", "csv", "gif", *KINDS)


def export_drawing(text: str, reading: Reading, message: Message) -> dict[str, Any]:
    """Return the reply with a file of the `kind` (one of FORMS) in a message: `name`, and `text` or `base64` of its bytes."""
    kind, name = message.get("kind"), str(reading.document.get("name", "drawing"))
    match kind:
        case "toml":
            return {"name": f"{name}.toml", "text": text}
        case "svg":
            mechanism = closed_mechanism(reading, "drawn as a picture")
            return {"name": f"{name}.svg", "text": draw(mechanism.whole, positions_of_links(mechanism, reading.q))}
        case "csv" | "gif":
            mechanism, trajectory, _ = move(text, reading, message)
            whole, links = mechanism.whole, motion_of_links(mechanism, trajectory)
            angles = angular_curves(whole, links, range(len(whole.links)))
            curves = History(links.t, (*angles, *point_curves(whole, links)))
            if kind == "csv":
                return {"name": f"{name}.csv", "text": table(curves)}
            caption = Caption(mechanism.name, mechanism.scenario, "", mechanism.duration, float(links.t[-1]))
            gif = encode_film(".gif", caption, curves, whole, links)
            return {"name": f"{name}.gif", "base64": base64.b64encode(gif).decode("ascii")}
        case str() if kind in KINDS:
            return _export_model(text, reading, kind, name)
    raise Refused(f"there is no export {str(kind)[:40]!r}; there are {', '.join(FORMS)}", field="kind")


def _export_model(text: str, reading: Reading, kind: str, name: str) -> dict[str, Any]:
    """Return the reply with the drawing as a model for another program: the name and the text of a file.

    The model has the first scenario without drivers, or the first scenario if all have drivers.
    """
    scenarios = dict(items(reading.document, "scenarios"))
    if not scenarios:
        raise Refused("there is no scenario that could be exported: release the linkage or drive it first")
    free = [scenario for scenario, entry in scenarios.items() if not is_driven(entry)]
    with temporary_file(text, name) as path:
        try:
            remarks = (NOT_MEASURED,) if KINDS[kind].is_program else ()
            model = write_file(load(str(path), [*free, *scenarios][0]), kind, KINDS[kind].choose(STEP), remarks)
        except (ExchangeError, MissingExtra) as error:
            raise Refused(str(error).replace(f"{path}: ", "")) from error
        return {"name": f"{name}{KINDS[kind].suffix}", "text": model.text.replace(str(path), path.name)}


def share_view(text: str, reading: Reading) -> dict[str, Any]:
    """Return the reply with a URL that holds the file and its motion: `page` and `fragment` of the URL, `poses` and a `note`.

    `poses` is the number of poses in the fragment. The note says why the motion ends early, or why the fragment has only the pose
    that is drawn. The note is None if the fragment has the whole motion.
    """
    if reading.mechanism is None:
        raise Refused("nothing is drawn yet")
    mechanism, end = reading.mechanism, 0.0
    q = positions_of_links(mechanism, reading.q)[None]  # (poses, n)
    try:
        driven, trajectory, note = move(text, reading, {"samples": INTERVALS})
        if len(trajectory.t):
            mechanism, q, end = driven, motion_of_links(driven, trajectory).q, float(trajectory.t[-1])
    except (Refused, LinkageError, ChoiceError) as error:
        note = str(error)  # share the drawing without a motion
    try:
        fragment, poses = pack_view(text, mechanism, q, end)
    except TooLarge as error:
        raise Refused(str(error)) from error
    return {"page": VIEW, "fragment": fragment, "poses": poses, "note": note}
