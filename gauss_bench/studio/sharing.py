"""Make a URL that contains the drawing's file and motion, for a page that shows them and needs no installation."""

from typing import Any

from gauss_bench.linkage.errors import LinkageError
from gauss_bench.mechanism.coordinates import motion_of_links
from gauss_bench.report.site.view import INTERVALS, VIEW, TooLarge, pack_view
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.studio.errors import Refused
from gauss_bench.studio.motion import move
from gauss_bench.studio.reading import Reading, of_links


def share_view(text: str, reading: Reading) -> dict[str, Any]:
    """Return the reply: `page` and `fragment` of the URL, the number of `poses` in the fragment, and a `note`.

    The note says why the motion ends early, or why the fragment has only the pose that is drawn. The note is None if the fragment
    has the whole motion.

    Raises:
        Refused: nothing is drawn, or the drawing is too large for a URL.
    """
    if reading.mechanism is None:
        raise Refused("nothing is drawn yet")
    mechanism, q, end, note = reading.mechanism, of_links(reading.mechanism, reading.q)[None], 0.0, None
    try:
        driven, x, note = move(text, reading, {"samples": INTERVALS})
        if len(x.t):
            mechanism, q, end = driven, motion_of_links(driven, x).q, float(x.t[-1])
    except (Refused, LinkageError, ChoiceError) as error:
        note = str(error)  # share the drawing without a motion
    try:
        fragment, poses = pack_view(text, mechanism, q, end)
    except TooLarge as error:
        raise Refused(str(error)) from error
    return {"page": VIEW, "fragment": fragment, "poses": poses, "note": note}
