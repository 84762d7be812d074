"""Links to look at: made in the studio, and opened in the page that the studio serves."""

import re

import numpy as np
import pytest

pytest.importorskip("tomlkit")
from gauss_bench.report.site.view import INTERVALS
from tests.studio import quick_return
from tests.test_studio_page import Page
from tests.test_view import content, poses


def test_a_link_has_the_motion_that_the_studio_shows(tmp_path):
    pen = quick_return(tmp_path)
    made = pen.ask("view")
    held = content(made["fragment"])
    assert made["page"] == "view.html"
    assert made["poses"] == INTERVALS + 1
    assert held["file"] == pen.session.text
    shown = pen.ask("motion", samples=INTERVALS)
    assert held["end"] == pytest.approx(shown["times"][-1])
    states = poses(held)
    for i, link in enumerate(held["links"]):
        turned = np.array(shown["poses"][link["name"]])[:, 2]
        assert np.abs(states[:, 3 * i + 2] - turned).max() < 1e-3


def test_what_cannot_move_is_shared_as_drawn_and_says_why(pen):
    assert "nothing is drawn" in pen.refused("view")
    pen.bar((0.0, 0.0), (0.3, 0.0))
    made = pen.ask("view")
    assert made["poses"] == 1
    assert "nothing can be driven" in made["note"]
    held = content(made["fragment"])
    assert held["end"] == 0
    assert [len(x["points"]) for x in held["links"]] == [2]


def test_a_drawing_beyond_an_address_is_refused_in_words(bars):
    before = bars.session.text
    letters = "".join(chr(0x4E00 + (k * k * 7919 + k * 31) % 20_000) for k in range(9000))
    bars.ask("set", path="title", value=letters)
    assert "share the file" in bars.refused("view")
    bars.ask("undo")
    assert bars.session.text == before


@pytest.mark.long("390-dark")
@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(1440, "light"), (390, "dark")])
def test_share_makes_a_link_that_draws(browser, studio_server, width, scheme):
    page = Page(
        browser, studio_server.address, viewport={"width": width, "height": 800}, color_scheme=scheme, reduced_motion="reduce"
    )
    page.template("four.bar")
    page.button("Share").click()
    page.button("Make a link to look at").click()
    link = page.page.get_by_role("link", name="Open it")
    link.wait_for(timeout=60_000)
    found = str(link.get_attribute("href"))
    assert len(found) < 16_384
    assert re.match(r"http://127\.0\.0\.1:\d+/view\.html#v1\.", found)
    relative = page.page.get_by_label("For others").input_value()
    assert found.endswith("/" + relative)
    assert not page.wrong
    with page.page.expect_popup() as opening:
        link.click()
    shown = opening.value
    shown.locator("#stage svg").wait_for()
    assert shown.locator("h1").inner_text() == "four_bar"
    assert shown.locator("#stage circle.pin").count() == 8
    assert "token" not in shown.url
    shown.close()
    page.page.close()


@pytest.mark.long("390-dark")
@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(1440, "light"), (390, "dark")])
def test_three_poses_placed_by_hand_become_a_sketch_in_one_step(browser, studio_server, width, scheme):
    """The poses are those of a four-bar with known pivots, which the studio finds from the pins and from the pivots."""
    page = Page(browser, studio_server.address, viewport={"width": width, "height": 850}, color_scheme=scheme)
    page.begin()
    page.button("Snap to the grid").click()
    pivots = (complex(-0.1, -0.05), complex(0.2, -0.05))
    picks = []
    for angle in (0.5, 1.2, 2.0):
        a = pivots[0] + 0.1 * np.exp(1j * angle)
        way = pivots[1] - a
        along = (0.28**2 - 0.24**2 + abs(way) ** 2) / (2 * abs(way))
        picks += [a, a + way / abs(way) * complex(along, np.sqrt(0.28**2 - along**2))]
    page.button("Poses").click()
    for at in picks:
        page.page.mouse.click(*page.pixel((at.real, at.imag)))
    bar = page.page.get_by_role("region", name="Four-bar through three poses")
    bar.get_by_text("It passes through the poses in their order, on one branch.", exact=True).wait_for()
    found = [complex(*map(float, x.get_attribute("data-pivot").split(","))) for x in page.page.locator("[data-pivot]").all()]
    # a click is a whole pixel, and the centre of a flat arc is less exact
    assert np.abs(np.array(found) - pivots).max() < 10 / page.scale()
    for at in pivots:
        page.page.mouse.click(*page.pixel((at.real, at.imag)))
    page.until(lambda: len(page.page.locator(".poses .placed").all()) == 2)
    page.settled()
    before = page.revision()
    page.button("Make it the sketch").click()
    page.changed(before)
    page.until(lambda: page.status() == ("1", "1"))
    drawn = page.stands_at()
    assert min(abs(complex(*x) - pivots[0]) for x in drawn.values()) < 2 / page.scale()
    page.until(lambda: "bar" in page.page.locator("details.drive > summary").inner_text())
    page.button("Undo").click()
    page.until(lambda: page.page.locator("g.linkage [data-link]").count() == 0)
    assert page.page.get_by_role("button", name="Undo", exact=True).is_disabled()
    assert not page.wrong
    page.page.close()


@pytest.mark.slow
def test_a_pin_with_three_places_on_a_line_slides_from_the_first_pose_to_the_third(browser, studio_server):
    page = Page(browser, studio_server.address)
    page.begin()
    page.button("Snap to the grid").click()
    page.button("Poses").click()
    along = [(-0.2, 0.0), (-0.1, 0.0), (0.05, 0.0)]  # of the first pin; the second one goes round
    for at, far in zip(along, [(-0.1, 0.1), (0.04, 0.02), (0.19, -0.02)], strict=True):
        page.page.mouse.click(*page.pixel(at))
        page.page.mouse.click(*page.pixel(far))
    bar = page.page.get_by_role("region", name="Four-bar through three poses")
    bar.get_by_text("One pin goes along a line: it becomes a slide.").wait_for()
    before = page.revision()
    page.button("Make it the sketch").click()
    page.changed(before)
    page.until(lambda: page.status() == ("1", "1") and "slide" in page.page.locator("details.drive > summary").inner_text())
    page.page.locator("[data-chart]").first.wait_for()
    assert page.page.locator(".timeline .note").count() == 0, "it does not stop on its way"
    page.page.get_by_label("Time", exact=True).focus()
    page.page.keyboard.press("End")
    places = lambda: [abs(complex(*x) - complex(*along[2])) for x in page.stands_at().values()]  # noqa: E731
    page.until(lambda: min(places()) < 2 / page.scale())
    assert not page.wrong
    page.page.close()
