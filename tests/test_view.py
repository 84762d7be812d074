"""Links to look at: the content of an address, and the page that draws it, also for hostile addresses."""

import base64
import json
import random
import re
import zlib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.api.kinematics import kinematics
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.coordinates import position
from gauss_bench.report.site.view import ANGLES, INTERVALS, LIMITS, VERSION, TooLarge, pack_poses, pack_view, view_page
from tests.conftest import exhaustive
from tests.published import watch


@cache
def motion(name):
    return kinematics(name, intervals=INTERVALS)


def packed(name, text="the file"):
    """Return the fragment of the first driven motion of a linkage, and the motion."""
    made = motion(name)
    return pack_view(text, made.model, made.trajectory.q, float(made.t[-1]))[0], made


def content(fragment):
    """Return the content of a fragment."""
    body = fragment.removeprefix(VERSION)
    return dict(json.loads(zlib.decompress(base64.urlsafe_b64decode(body + "=" * (-len(body) % 4)))))


def poses(held):
    """Return the states (k, n) of a fragment, from its second differences."""
    whole = np.cumsum(np.cumsum(np.array(held["poses"]), axis=1), axis=1).T
    return whole * np.tile([held["unit"], held["unit"], 1 / ANGLES], whole.shape[1] // 3)


def packed_bytes(held):
    """Return the compressed JSON of a content, which may be hostile, or of bytes."""
    return zlib.compress(held if isinstance(held, bytes) else json.dumps(held).encode(), 9)


def fragment_of(held):
    """Return the fragment of a content or of bytes; a fragment unchanged."""
    return held if isinstance(held, str) else VERSION + base64.urlsafe_b64encode(packed_bytes(held)).decode().rstrip("=")


@pytest.mark.parametrize("name", exhaustive(["four_bar", "jansen", "shaper", "excavator"], "jansen", "excavator"))
def test_the_address_holds_the_file_and_every_pose_to_half_a_unit_and_every_point_in_its_place(name):
    """Points in the fragment, moved by its poses, are compared with the observed points of the suite's own motion."""
    text = Path(load(name).source).read_text()
    fragment, made = packed(name, text)
    held, q = content(fragment), made.trajectory.q
    states, units = poses(held), [held["unit"], held["unit"], 1 / ANGLES]
    assert held["file"] == text
    assert re.fullmatch(r"v1\.[A-Za-z0-9_-]+", fragment)
    assert len(fragment) <= LIMITS["fragment"]
    assert len(made.t) == INTERVALS + 1 <= LIMITS["poses"]
    assert (np.abs(states - q) / np.tile(units, len(held["links"]))).max() <= 0.5 + 1e-6
    assert held["unit"] < 2e-4 * np.ptp(np.delete(q, np.s_[2::3], axis=1))
    for (link, x, y), point in zip(held["paths"], made.model.whole.observed_points, strict=True):
        at = states[:, 3 * link : 3 * link + 2] @ [1, 1j] + complex(x, y) * np.exp(1j * states[:, 3 * link + 2])
        off = np.abs(at - position(q, point) @ [1, 1j]).max()
        assert off < 2 * held["unit"] + abs(complex(x, y)) / ANGLES
    links = {pin.a.link for pin in made.model.whole.pins} | {pin.b.link for pin in made.model.whole.pins}
    assert links == {round(link) for link, _, _ in held["pins"]}


def test_a_longer_file_takes_poses_away_until_none_is_left():
    chance, counts = random.Random(0), []
    made = motion("four_bar")
    for length in (0, 9000, 9500, 9800):
        text = "# " + chance.randbytes(length).hex()
        fragment, count = pack_view(text, made.model, made.trajectory.q, 2.0)
        held = content(fragment)
        assert len(fragment) <= LIMITS["fragment"]
        assert held["file"] == text
        assert len(held["poses"][0]) == count
        stride = INTERVALS // (count - 1)
        assert held["end"] == pytest.approx(2.0)
        assert np.abs(poses(held) - made.trajectory.q[::stride])[:, 2].max() < 1 / ANGLES
        counts.append(count)
    assert counts[0] == INTERVALS + 1 > counts[-1] > 1
    with pytest.raises(TooLarge, match="share the file"):
        pack_view(chance.randbytes(12_000).hex(), made.model, made.trajectory.q, 2.0)
    with pytest.raises(TooLarge, match="share the file"):
        pack_view("a" * LIMITS["unpacked"], made.model, made.trajectory.q, 2.0)
    # of 192 poses of an interrupted motion every fourth is kept: the last of them is at 188/191 of the time
    fragment, count = pack_view(random.Random(0).randbytes(9500).hex(), made.model, made.trajectory.q[:-1], 1.91)
    assert (count, content(fragment)["end"]) == (48, pytest.approx(1.88))


@pytest.mark.parametrize("place", [(0.5, 0.5), (3e3, 3e3)])
def test_a_drawing_far_from_the_origin_has_numbers_that_the_page_takes(place):
    """The motion of this link is too small to define the unit of length."""
    q = np.array([[*place, 0.0], [place[0] + 1e-7, place[1], 0.1]])
    numbers = np.array(pack_poses(q)["poses"])
    assert np.abs(np.cumsum(numbers, axis=1)).max() <= LIMITS["number"]
    assert np.abs(numbers).max() <= LIMITS["number"]


# In the browser


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "view.html"
    path.write_text(view_page()[0], encoding="utf-8")
    return path.as_uri()


def opened(browser, address, **look):
    """Return the page after it has drawn or refused its link, and a list of errors and of requests to other addresses."""
    page = browser.new_page(**({"viewport": {"width": 1200, "height": 900}, "reduced_motion": "reduce"} | look))
    wrong = watch(page, address.split("#")[0])
    page.on("dialog", lambda d: wrong.append(d.message) or d.dismiss())
    page.goto(address)
    for _ in range(200):
        if page.locator("#stage svg").count() or "This " in page.locator("#lead").inner_text():
            break
        page.wait_for_timeout(50)
    return page, wrong


def drawn_pins(page):
    """Return the drawn pins [px] as complex numbers."""
    dots = page.locator("#stage circle.pin").all()
    return np.array([float(x.get_attribute("cx")) - 1j * float(x.get_attribute("cy")) for x in dots])


@pytest.mark.long("shaper-390-dark")
@pytest.mark.slow
@pytest.mark.parametrize(("name", "width", "scheme"), [("jansen", 1200, "light"), ("shaper", 390, "dark")])
def test_a_link_shows_the_motion_that_the_suite_computed(browser, page_file, name, width, scheme):
    text = Path(load(name).source).read_text()
    fragment, made = packed(name, text)
    held, states = content(fragment), made.trajectory.q
    page, wrong = opened(browser, f"{page_file}#{fragment}", viewport={"width": width, "height": 800}, color_scheme=scheme)
    assert page.locator("h1").inner_text() == name
    assert "Drawn, not computed." in page.locator(".note").first.inner_text()
    scales = []
    for k, key in ((0, ""), (1, "ArrowRight"), (0, "ArrowLeft"), (INTERVALS, "End"), (0, "Home"), (INTERVALS, "ArrowLeft")):
        if key:
            page.keyboard.press(key)
        q = np.append(states[k], [0, 0, 0])  # the ground is link -1
        truth = np.array(
            [complex(*q[3 * i :][:2]) * (i >= 0) + complex(x, y) * np.exp(1j * q[3 * i + 2]) for i, x, y in held["pins"]]
        )
        shown = drawn_pins(page)
        (scale, shift), *_ = np.linalg.lstsq(np.column_stack([truth, np.ones_like(truth)]), shown, rcond=None)
        assert np.abs(scale * truth + shift - shown).max() < 0.3, f"pose {k}"
        assert abs(scale.imag) < 1e-3 * scale.real
        scales.append(scale.real)
    assert max(scales) < 1.001 * min(scales)
    before = drawn_pins(page)
    page.locator("#stage").click()
    assert page.locator("#play").inner_text() == "Pause"
    page.wait_for_timeout(400)
    page.keyboard.press(" ")
    assert page.locator("#play").inner_text() == "Play"
    assert np.abs(drawn_pins(page) - before).max() > 1
    page.locator("summary").click()
    assert page.locator("#file").text_content() == text
    page.locator("#copy").click()
    page.locator("#copied:not(:empty)").wait_for()
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert not wrong
    page.close()


@pytest.mark.long("1200-dark")
@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(390, "light"), (1200, "dark")])
def test_the_page_of_links_is_readable_by_eye_and_by_machine(browser, page_file, width, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    for fragment in ("", "v1.", packed("four_bar", "[links]\n" * 40)[0]):
        look = {"viewport": {"width": width, "height": 800}, "color_scheme": scheme, "bypass_csp": True}
        page, wrong = opened(browser, f"{page_file}#{fragment}", **look)
        if page.locator("summary").is_visible():
            page.locator("summary").click()
        faults = axe.run(page).response["violations"]
        assert not faults, [(x["id"], x["nodes"][0]["html"][:160]) for x in faults]
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        for part in page.locator("button, select, summary").all():
            assert not part.is_visible() or part.bounding_box()["height"] >= 44
        assert not wrong
        page.close()


def change(path, value):
    """Return a function that changes one value of the content of a link."""

    def make(held):
        *above, last = [int(x) if x.isdigit() else x for x in path.split(".")]
        inner = held
        for key in above:
            inner = inner[key]
        inner[last] = value
        return held

    return make


EMPTY = {"links": [], "poses": [], "pins": [], "paths": []}
# name -> function of the content of a good link that returns a fragment, bytes of JSON or another content; word of the answer
HOSTILE = {
    "no base64": (lambda _: "v1.<script>alert(1)</script>", "changed on its way"),
    "another version": (lambda held: fragment_of(held).replace("v1.", "v2."), "another edition"),
    "too long": (lambda _: VERSION + "A" * LIMITS["fragment"], "more than 16000 characters"),
    "cut off": (lambda held: fragment_of(held)[:-40], "cut off"),
    "followed by more": (lambda held: VERSION + base64.urlsafe_b64encode(packed_bytes(held) + b"more").decode(), ""),
    "bomb": (lambda _: b'{"file":"' + b"a" * 10_000_000 + b'"}', "unpacks to more"),
    "no UTF-8": (lambda _: b'{"name":"\xff"}', "cut off"),
    "no object": (lambda _: b"[1]", "no linkage"),
    "deep": (lambda _: b"[" * 190_000 + b"]" * 190_000, ""),
    "NaN": (change("unit", float("nan")), "changed on its way"),
    "pose not finite": (change("poses.0.3", 1e300), "number"),
    "half a unit": (change("poses.0.3", 0.5), "whole number"),
    "too many poses": (lambda held: held | {"poses": [[0] * 201 for _ in held["poses"]]}, "too long"),
    "poses of unequal length": (lambda held: held | {"poses": [x[: 9 + (i == 2)] for i, x in enumerate(held["poses"])]}, "poses"),
    "a link without poses": (lambda held: held | {"poses": held["poses"][:-1]}, "poses"),
    "too many links": (lambda held: held | {"links": held["links"] * 101}, "too long"),
    "too many places": (lambda held: held | {"links": [x | {"points": [[0, 0]] * 900} for x in held["links"]]}, "too many"),
    "a bar to a prototype": (change("links.0.bars", [["__proto__", "constructor"]]), "does not have"),
    "a pin of no link": (change("pins.0", [7, 0, 0]), "does not have"),
    "a long name": (change("name", "a" * 201), "text"),
    "no links": (lambda held: held | EMPTY, "poses"),
    **{f"without {x}": (lambda held, x=x: {k: held[k] for k in held if k != x}, "") for x in ("file", "poses", "pins", "end")},
}


@pytest.mark.slow
def test_a_hostile_link_gets_one_sentence_and_draws_nothing(browser, page_file):
    """All links are opened in one page, and before each of them a good link."""
    good = packed("four_bar")[0]
    page, wrong = opened(browser, f"{page_file}#{good}")
    for what, (make, word) in HOSTILE.items():
        assert page.locator("#stage svg").count() == 1
        page.evaluate("x => { location.hash = x }", fragment_of(make(content(good))))
        page.locator("#lead", has_text="This link cannot be shown").wait_for(timeout=10_000)
        said = page.locator("#lead").inner_text()
        assert word in said, what
        assert said.count(".") == 1, what
        assert not page.locator("#stage *").count(), what
        assert not page.locator("#shown").is_visible(), what
        assert page.locator("#file").text_content() == "", what
        assert not wrong, what
        page.evaluate("x => { location.hash = x }", good)
        page.locator("#stage svg").wait_for(timeout=10_000)
    page.close()


@pytest.mark.slow
def test_markup_in_names_is_text_and_no_script_of_others_runs(browser, page_file):
    held = content(packed("four_bar")[0])
    markup = "</title></script><img src=x onerror=alert(1)><script>alert(2)</script>"
    held |= {"name": markup, "title": markup, "scenario": markup, "file": markup}
    held["links"][0]["name"] = markup
    page, wrong = opened(browser, f"{page_file}#{fragment_of(held)}")
    assert page.locator("h1").inner_text() == markup
    assert page.locator("#file").text_content() == markup
    assert page.locator("img, iframe, main script").count() == 0
    assert not wrong
    page.evaluate("document.body.append(Object.assign(document.createElement('script'), { textContent: 'document.title = 1' }))")
    assert page.title() != "1"
    assert "Content Security Policy" in "".join(wrong)
    page.close()
