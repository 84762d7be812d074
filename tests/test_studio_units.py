"""Values on the studio's page are shown in the chosen unit and saved in SI, and curves are read by mouse, keys and touch."""

import csv
import io
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tests.test_studio_page import Page, told


@pytest.fixture(scope="module")
def page(browser, studio_server):
    here = Page(browser, studio_server.address)
    yield here
    assert not here.wrong, here.wrong[:3]
    here.page.close()


def enter(page, label, text):
    field = page.page.get_by_label(label, exact=True).first
    field.fill(text)
    field.press("Enter")


def file_of(page, studio_server):
    page.save("own") if page.page.locator("h1.document[title='not saved yet']").count() else page.button("Save").click()
    page.settled()
    return tomllib.loads((studio_server.folder / "own.toml").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_lengths_and_angles_with_units_are_written_in_si_and_others_refused(page, studio_server):
    page.template("four bar")
    page.button("link crank").click()
    for unit, text, metres in (("m", "5.5in", 0.1397), ("mm", "125", 0.125), ("in", "131,5mm", 0.1315)):
        page.page.get_by_label("Unit of lengths").select_option(unit)
        before = page.revision()
        enter(page, f"Length, {unit}", text)
        page.changed(before)
        assert np.hypot(*file_of(page, studio_server)["links"]["crank"]["points"]["B"]) == pytest.approx(metres, rel=1e-9)
        field = page.page.get_by_label(f"Length, {unit}", exact=True)
        shown = float(field.input_value())
        assert shown == pytest.approx(metres / {"m": 1, "mm": 1e-3, "in": 0.0254}[unit], rel=1e-6), "shown in the unit of the label"

    revision = page.revision()
    for label, text, sentence in (
        ("Length, in", "5 kg", "is no length"),
        ("Length, in", "", "needs a value"),
        ("Angle, °", "12 mm", "is no angle"),
        ("Mass, kg", "3 N", "is no number in kg"),
    ):
        enter(page, label, text)
        field = page.page.get_by_label(label, exact=True)
        assert sentence in page.page.locator(".field .refusal").first.inner_text()
        assert field.get_attribute("aria-invalid") == "true"
        assert field.input_value() == text, "the draft stays, so that it can be mended"
        field.press("Escape")
        assert field.input_value() != text
        assert page.page.locator(".field .refusal").count() == 0
    assert page.revision() == revision, "what is refused is never sent"

    before = page.revision()
    enter(page, "Angle, °", "1.5 rad")
    page.changed(before)
    assert float(page.page.get_by_label("Angle, °", exact=True).input_value()) == pytest.approx(np.degrees(1.5), rel=1e-6)
    assert str(page.page.locator(".grid text").text_content()).strip().endswith(" in"), "the ruler too"
    page.page.reload()
    page.page.wait_for_selector("#canvas[data-revision]", timeout=60_000)
    assert page.page.get_by_label("Unit of lengths").input_value() == "in", "kept for the session"
    page.page.get_by_label("Unit of lengths").select_option("m")


@pytest.mark.long
def test_sentences_of_the_server_have_their_lengths_in_the_unit_that_is_shown(page):
    page.template("four bar")
    page.button("link coupler").click()
    page.page.get_by_label("Unit of lengths").select_option("mm")
    before = page.revision()
    enter(page, "Length, mm", "5000")
    page.changed(before)
    for unit, instead in (("mm", "5000 mm"), ("in", "196.9 in"), ("m", "5 m")):
        page.page.get_by_label("Unit of lengths").select_option(unit)
        (sentence,) = page.problems()
        assert f"instead of {instead}" in sentence
        assert page.page.locator(".inplace").inner_text() in sentence
        apart, needed = re.search(rf"stay (\S+) {unit} apart; .* of (\S+) {unit} instead", sentence).groups()
        metres = {"m": 1, "mm": 1e-3, "in": 0.0254}[unit]
        assert float(apart) * metres == pytest.approx(5 - float(needed) * metres, rel=1e-3), "the ends stay that much apart"
    page.page.get_by_label("Unit of lengths").select_option("mm")
    enter(page, "Length, mm", "1e-9")
    page.until(lambda: "at least 0.001 mm" in page.page.get_by_test_id("said").inner_text())
    page.page.get_by_label("Unit of lengths").select_option("m")
    page.button("Undo").click()


@pytest.mark.slow
def test_what_a_dialog_asks_and_is_refused_is_said_in_the_dialog(page):
    page.template("four bar")
    page.button("Release").click()
    page.button("Which engine should I take?").click()
    refusal = page.page.get_by_role("dialog").get_by_role("alert")
    assert refusal.count() == 0
    enter(page, "Position to within, m", "0")
    page.button("Recommend").click()
    refusal.wait_for()
    assert refusal.inner_text() == "say what is required: a position, an angle or a force above 0"
    page.button("Close").click()
    page.button("Save").click()
    assert refusal.count() == 0, "what another dialog was refused is over"
    page.page.locator('dialog input[name="path"]').fill("six_bar")
    page.button("Save the file").click()
    refusal.wait_for()
    assert "name of a built-in linkage" in refusal.inner_text()
    page.button("Close").click()


@pytest.mark.long
def test_a_point_that_goes_round_evenly_has_a_level_curve_on_a_scale_from_zero(page):
    """The speed changes by rounding only, which must not fill the chart."""
    page.template("four bar")
    page.button("link coupler").click()
    page.button("P").click()
    page.button("Select nothing").click()
    page.button("link crank").click()
    page.button("B").click()
    names = page.page.locator('[data-chart="v"] li')
    page.until(lambda: [x.split()[0] for x in names.all_inner_texts()] == ["crank.B"])
    marks = [float(x) for x in page.page.locator('[data-chart="v"] .scale').first.locator("span").all_inner_texts()]
    (speed,) = readings(page, "v")
    assert speed == pytest.approx(2 * np.pi * 0.12, rel=1e-3)
    assert min(marks) == 0.0
    assert len(marks) == len({*marks}) >= 3
    line = page.page.locator('[data-chart="v"] svg path[class^=curve]').get_attribute("d")
    assert len({*re.findall(r"[ML][\d.]+ ([\d.]+)", line)}) == 1, "it is level"


def readings(page, chart):
    return [float(x) for x in page.page.locator(f'[data-chart="{chart}"] li b').all_inner_texts()]


@pytest.mark.slow
def test_curves_are_read_by_mouse_keys_and_finger_and_the_table_has_all_of_them(page, studio_server):
    page.template("four bar")
    page.fitted()
    page.page.get_by_label("Unit of lengths").select_option("mm")
    for chart in ("v", "a", "torque", "transmission"):
        marks = page.page.locator(f'[data-chart="{chart}"] .scale').first.locator("span").all_inner_texts()
        assert len({*map(float, marks)}) >= 3, f"{chart}: {marks}"
    assert page.page.locator('[data-chart="v"] figcaption small').inner_text() == "mm/s"
    assert page.page.locator('[data-chart="v"] .along span').last.inner_text() == "1 s"

    with page.page.expect_download() as waiting:
        page.button("CSV").click()
    assert waiting.value.suggested_filename == "four_bar_curves.csv"
    head, *rows = csv.reader(io.StringIO(Path(waiting.value.path()).read_text(encoding="utf-8")))
    table = {name: np.array([float(row[k] or "nan") for row in rows]) for k, name in enumerate(head)}
    assert all(re.search(r"\[[^\]]+\]$", name) for name in head), "each with its unit"
    wanted = ("input crank", "x coupler.P", "speed coupler.P", "acceleration", "drive torque", "transmission angle", "pin forces A")
    for name in (*wanted, "mechanical advantage"):
        assert any(x.startswith(name) for x in head), f"{name} is not in {head}"
    page.save("curves")
    computed = told("kinematics", studio_server.folder / "curves.toml", "--intervals", str(len(rows) - 1))
    point = computed["points"]["coupler.P"]
    assert table["x coupler.P [mm]"] == pytest.approx(1e3 * np.array(point["x"]), abs=1e-6)
    assert table["time [s]"] == pytest.approx(np.array(computed["t"]))
    steps = np.gradient(table["x coupler.P [mm]"], table["time [s]"]), np.gradient(table["y coupler.P [mm]"], table["time [s]"])
    assert np.hypot(*steps)[2:-2] == pytest.approx(table["speed coupler.P [mm/s]"][2:-2], rel=0.02, abs=5.0)

    cursor = page.page.get_by_role("slider", name="Cursor of Speed")
    cursor.focus()
    page.page.keyboard.press("Home")
    for _ in range(45):
        page.page.keyboard.press("ArrowRight")
    assert readings(page, "v") == pytest.approx([table["speed coupler.P [mm/s]"][45]], rel=1e-3)
    assert f"{table['time [s]'][45]:.3g} s" in cursor.get_attribute("aria-valuetext")
    assert float(page.page.get_by_role("slider", name="Time").input_value()) == pytest.approx(table["time [s]"][45], abs=2e-3)

    box = cursor.bounding_box()
    page.page.mouse.move(box["x"] + 0.75 * box["width"], box["y"] + 20)
    at = float(np.interp(0.75, table["time [s]"], table["speed coupler.P [mm/s]"]))
    page.until(lambda: readings(page, "v") == pytest.approx([at], rel=0.01))
    assert float(page.page.get_by_role("slider", name="Time").input_value()) == pytest.approx(0.25, abs=2e-3), "it is only read"
    page.page.mouse.down()
    page.page.mouse.up()
    page.page.mouse.move(5, 5)
    assert float(page.page.get_by_role("slider", name="Time").input_value()) == pytest.approx(0.75, abs=5e-3)
    assert readings(page, "v") == pytest.approx([at], rel=0.01), "where the mouse was pressed the cursor stays"

    hand = page.page.context.new_cdp_session(page.page)
    for kind, share in (("touchStart", 0.5), ("touchMove", 0.4), ("touchMove", 0.3)):
        points = [{"x": box["x"] + share * box["width"], "y": box["y"] + 20, "id": 0}]
        hand.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    hand.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    at = float(np.interp(0.3, table["time [s]"], table["speed coupler.P [mm/s]"]))
    page.until(lambda: readings(page, "v") == pytest.approx([at], rel=0.01))
    page.page.get_by_label("Unit of lengths").select_option("m")


@pytest.mark.long
def test_two_templates_opened_in_turn_ask_nothing_and_a_changed_one_does(page):
    page.template("four bar")  # whatever was drawn before
    asked = []
    page.page.on("dialog", lambda d: asked.append(d.message))
    for name in ("four bar", "crank slider"):
        page.template(name)
        assert page.page.locator(".unsaved").count() == 0
    assert asked == []
    before = page.revision()
    enter(page, "Title", "Mine")
    page.changed(before)
    assert page.page.locator(".unsaved").count() == 1
    page.template("four bar")
    assert len(asked) == 1
    assert "crank_slider" in asked[0]
