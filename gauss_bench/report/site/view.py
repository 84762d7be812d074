"""The page `view.html`, which draws a linkage from its own address (URL), and the fragment of such an address: the text after #.

The fragment is `v1.` followed by JSON, compressed with zlib and encoded as base64url: the linkage file, the points of all links in
their own frames, and sampled poses. Positions are whole multiples of `unit` [m], angles of 1/`ANGLES` rad; poses are stored as
second differences over time, which are small for smooth motions. Since anybody can write an address, the page checks everything
against LIMITS.
"""

import base64
import hashlib
import json
import zlib
from importlib.resources import files
from typing import Any

import numpy as np

from gauss_bench.mechanism.model import LengthDriver, Mechanism, Point, SpringDamper
from gauss_bench.mechanism.spaces import angles, places
from gauss_bench.report.palette import COLOURS, DARK, declare
from gauss_bench.terms import Array

VIEW = "view.html"
VERSION = "v1."  # beginning of a fragment
INTERVALS = 192  # intervals between the poses of a motion, which can be halved six times
FINENESS = 8192  # units of length in the range of all x and y together; a unit is about a tenth of a pixel
ANGLES = 4096  # units of angle in a radian
LIMITS = {  # largest values that the page accepts
    "fragment": 16_000,  # characters of the fragment: the whole address stays below 16 kB
    "unpacked": 400_000,  # bytes of JSON
    "links": 300,
    "places": 2000,  # points, bars, pins, slides, ties and paths together
    "poses": 200,  # poses of a link
    "name": 200,  # characters of a name
    "number": 1_000_000_000,  # magnitude of a number
}


class TooLarge(ValueError):
    """A linkage is too long to be encoded in an address (URL)."""


def pack_view(text: str, mechanism: Mechanism, q: Array, end: float) -> tuple[str, int]:
    """Return the fragment (text after #) of an address that shows a linkage, and the number of poses in it.

    While the fragment is too long, every second pose is left out.

    Args:
        q: (k, n) positions of the links of `mechanism.whole`, at equal intervals of time.
        end: time of the last position [s].

    Raises:
        TooLarge: the fragment is too long even with a single pose, or there are too many links or points.
    """
    named = {"name": mechanism.name, "scenario": mechanism.scenario}
    linkage = {key: name[: LIMITS["name"]] for key, name in named.items()} | {"title": mechanism.title, "file": text}
    shape = describe_shape(mechanism)
    count = sum(len(x["points"]) + len(x["bars"]) for x in shape["links"])
    count += sum(len(shape[key]) for key in ("pins", "slides", "ties", "paths"))
    if len(shape["links"]) > LIMITS["links"] or count > LIMITS["places"]:
        raise TooLarge(f"an address can hold a linkage of at most {LIMITS['links']} links and {LIMITS['places']} points")
    stride, intervals = 1, max(len(q) - 1, 0)
    while True:
        poses = q[::stride]
        covered = intervals // stride * stride  # intervals up to the last of these poses
        motion = {"end": end * covered / intervals if intervals else 0.0} | pack_poses(poses)
        fragment = compress(linkage | shape | motion)
        if len(fragment) <= LIMITS["fragment"]:
            return fragment, len(poses)
        if len(poses) == 1:
            raise TooLarge(
                f"the linkage takes {len(fragment)} characters; an address can hold {LIMITS['fragment']}: share the file"
            )
        stride *= 2


def compress(content: dict[str, Any]) -> str:
    """Return an object as a fragment of an address.

    Raises:
        TooLarge: the JSON of the object has more bytes than the page accepts.
    """
    packed = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode("utf-8")
    if len(packed) > LIMITS["unpacked"]:
        raise TooLarge(f"the linkage takes {len(packed)} bytes; an address can hold {LIMITS['unpacked']}: share the file")
    return VERSION + base64.urlsafe_b64encode(zlib.compress(packed, 9)).decode("ascii").rstrip("=")


def describe_shape(mechanism: Mechanism) -> dict[str, Any]:
    """Return links, pins, slides, paths (observed points) and ties (springs and cylinders) of a linkage."""
    whole = mechanism.whole
    links = []
    for i, link in enumerate(whole.links):
        index = {name: k for k, name in enumerate(link.points)}
        points = [round_place(x - link.com) for x in link.points.values()]
        bars = [[index[a], index[b]] for a, b in link.bars]
        links.append({"name": link.name[: LIMITS["name"]], "points": points, "bars": bars, "crank": i == whole.crank})
    slides = [
        [x.guide.link, *round_place(x.guide.local), round(x.angle, 5), x.block.link, *round_place(x.block.local)]
        for x in whole.slides
    ]
    # a dictionary, because a joint of three links has the same end twice
    pins = {place_of(end): None for pin in whole.pins for end in pin.ends}
    stretched = [x for x in (*whole.drivers, *whole.forces) if isinstance(x, (LengthDriver, SpringDamper))]
    ties = [[*place_of(x.a), *place_of(x.b)] for x in stretched]
    paths = [place_of(x) for x in whole.observed_points]
    return {"links": links, "pins": [*pins], "slides": slides, "ties": ties, "paths": paths}


def place_of(point: Point) -> tuple[float, ...]:
    """Return (link, x, y) of a point, x and y in the frame of its link [m]."""
    return point.link, *round_place(point.local)


def round_place(place: Array) -> list[float]:
    """Round coordinates to five significant digits."""
    return [float(f"{x:.5g}") for x in place]


def pack_poses(q: Array) -> dict[str, Any]:
    """Return the entries `unit` [m] and `poses` of a fragment, from positions (k, n) at k times.

    `poses` has for each of the n coordinates (x, y and angle of each link) the k second differences over time of whole numbers: x
    and y as multiples of `unit`, an angle as multiples of 1/ANGLES rad. Two cumulative sums restore them.
    """
    xy = places(q)  # (k, links, 2) [m]
    # units are coarser for a small drawing far from the origin: whole numbers stay below LIMITS["number"]
    extent = max(float(np.ptp(xy)), 1e-4 * float(np.abs(xy).max()), 1e-6)
    unit = float(f"{extent / FINENESS:.3g}")
    units = np.empty_like(q)  # (k, n) the unit of each number
    places(units)[...], angles(units)[...] = unit, 1 / ANGLES
    numbers = np.rint(q / units).astype(np.int64)  # (k, n)
    # two zeros before the first pose, so that two cumulative sums give the poses back
    before = np.zeros((2, q.shape[1]), np.int64)
    return {"unit": unit, "poses": np.diff(numbers, n=2, axis=0, prepend=before).T.tolist()}


def view_page() -> tuple[str, str]:
    """Return the HTML of `view.html` with script and style, and its content security policy."""
    assets = files("gauss_bench.report.site") / "assets"
    texts = {name: (assets / name).read_text(encoding="utf-8") for name in (VIEW, "view.js", "view.css")}
    script = texts["view.js"].replace("/*limits*/", json.dumps(LIMITS | {"angles": ANGLES, "version": VERSION}))
    style = texts["view.css"].replace("/*light*/", declare(COLOURS)).replace("/*dark*/", declare(DARK))
    policy = (
        f"default-src 'none'; script-src '{digest(script)}'; style-src '{digest(style)}'; img-src data:; base-uri 'none'; "
        "form-action 'none'"
    )
    page = texts[VIEW].replace("/*policy*/", policy)
    return page.replace("/*style*/", style).replace("/*script*/", script), policy


def digest(text: str) -> str:
    """Return the digest with which a content security policy allows a script or style."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode('utf-8')).digest()).decode('ascii')}"
