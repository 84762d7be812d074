"""Every edit of the studio by mouse, keys and touch: on the page, in the saved file, and after undo and redo."""

import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from tests.studio import Pen, four_bar
from tests.test_studio_page import Page, studio

STEPS = 50  # of the history, at least
NAME = "means"
IDS = {"link": "name", "slide": "id", "force": "id"}  # kind of part -> key of its id in a scene
TOOLS = {"Select": "v", "Reshape": "m", "Ground pivot": "g", "Bar": "b", "Link": "l", "Slider": "s", "Spring": "k", "Damper": "d"}
TOOLS |= {"Torque": "t", "Force": "f", "Cylinder": "c", "Observe": "o"}


@pytest.fixture
def folder(tmp_path):
    """Save a four-bar with a rod that slides on the ground, and return its folder."""
    pen = four_bar(tmp_path)
    pen.bar((0.3, 0.28), (0.6, 0.0))
    pen.ask("add_slide", pin=pen.at(0.6, 0.0), guide="ground", through=[0.6, 0.0], angle_deg=0.0)
    pen.ask("save", path=NAME)
    return tmp_path


class Hand:
    """Edits by mouse; places are in metres."""

    look: dict[str, Any] = {}  # noqa: RUF012

    def __init__(self, browser, url):
        self.sheet = Page(browser, url, **self.look)
        self.page = self.sheet.page

    def use(self, tool):
        self.show_drawing()
        self.press(self.sheet.button(tool))

    def tap(self, at):
        self.page.mouse.click(*self.sheet.pixel(at))

    def end(self):
        """Close a link at its first corner."""
        self.tap((0.1, -0.05))

    def way(self, start, by):
        """Return six pixels on the way from a place by a displacement."""
        return [self.sheet.pixel((start[0] + s * by[0], start[1] + s * by[1])) for s in np.linspace(0.0, 1.0, 6)]

    def drag(self, start, by):
        way = self.way(start, by)
        self.page.mouse.move(*way[0])
        self.page.mouse.down()
        for at in way[1:]:
            self.page.mouse.move(*at)
        self.page.mouse.up()

    def press(self, what):
        what.click()

    def write(self, field, text):
        self.focus(self.page.get_by_label(field, exact=True).first)
        self.page.keyboard.press("Control+a")
        self.page.keyboard.type(text)
        self.page.keyboard.press("Enter")

    def focus(self, field):
        field.click()

    def choose(self, label, option):
        self.page.get_by_label(label, exact=True).select_option(option)

    def pick(self, part):
        """Select a part in the list of parts."""
        self.rest()
        self.show_parts()
        self.press(self.sheet.button(part))

    def delete(self):
        self.press(self.sheet.button("Delete"))

    def history(self, way):
        self.press(self.sheet.button({"undo": "Undo", "redo": "Redo"}[way]))

    def save(self):
        self.press(self.sheet.button("Save"))

    def rest(self):
        """Take the tool Select, and select nothing."""
        self.use("Select")
        nothing = self.page.locator('[aria-label="Select nothing"]')
        if nothing.count():
            self.show_parts()
            self.press(nothing)
        self.show_drawing()

    def show_parts(self): ...

    def show_drawing(self): ...


class Keys(Hand):
    """Edits by the keyboard alone, with the cross of the canvas."""

    def use(self, tool):
        self.sheet.canvas.focus()
        self.page.keyboard.press(TOOLS[tool])

    def tap(self, at):
        self._go(at)
        self.page.keyboard.press("Enter")

    def end(self):
        self.page.keyboard.press("Enter")

    def drag(self, start, by):
        """Select a pin with the cross, and move it by five steps of the grid with one arrow key."""
        assert max(map(abs, by)) == pytest.approx(5 * self._step())
        self.tap(start)
        self.page.keyboard.press(f"Shift+Arrow{'Right' if by[0] > 0 else 'Left' if by[0] < 0 else 'Up' if by[1] > 0 else 'Down'}")

    def press(self, what):
        what.focus()
        self.page.keyboard.press("Space" if what.get_attribute("type") == "checkbox" else "Enter")

    def focus(self, field):
        field.focus()

    def choose(self, label, option):
        field = self.page.get_by_label(label, exact=True)
        options = {x.get_attribute("value") or x.inner_text(): x.inner_text() for x in field.locator("option").all()}
        field.focus()
        self.page.keyboard.type(options[option])

    def delete(self):
        self.sheet.canvas.focus()
        self.page.keyboard.press("Delete")

    def history(self, way):
        self.sheet.canvas.focus()
        self.page.keyboard.press({"undo": "Control+z", "redo": "Control+Shift+Z"}[way])

    def save(self):
        self.page.keyboard.press("Control+s")

    def rest(self):
        self.use("Select")
        self.page.keyboard.press("Escape")

    def _step(self):
        """Return the fine step of the grid [m]."""
        wanted = 9 / self.sheet.scale()
        power = 10 ** np.floor(np.log10(wanted))
        return float(next(f for f in (1, 2, 5, 10) if f * power >= wanted) * power)

    def _go(self, at):
        """Move the cross to the point of the grid that is nearest to a place."""
        cross = self.page.locator(".rubber .cross")
        press, step = self.page.keyboard.press, self._step()
        if not cross.count():
            press("ArrowLeft")
        for _ in range(8):
            x, y = map(float, re.findall(r"-?[\d.]+", cross.get_attribute("d"))[:2])
            (ox, oy), scale = self.sheet.origin(), self.sheet.scale()
            lacking = [at[0] - (x + 12 - ox) / scale, at[1] - (oy - y) / scale]
            if max(map(abs, lacking)) < 0.6 * step:
                return
            for left, way in zip(lacking, (("ArrowRight", "ArrowLeft"), ("ArrowUp", "ArrowDown")), strict=True):
                key, count = way[left < 0], round(abs(left) / step)
                for _ in range(count // 5):
                    press(f"Shift+{key}")
                for _ in range(count % 5):
                    press(key)
        raise AssertionError(f"the cross does not come to {at}: {lacking}")


class Touch(Hand):
    """Edits by a finger on a phone, and by a keyboard in fields."""

    look = {"viewport": {"width": 390, "height": 844}, "has_touch": True}  # noqa: RUF012

    def tap(self, at):
        self.page.touchscreen.tap(*self.sheet.pixel(at))

    def end(self):
        self.press(self.sheet.button("Done"))

    def drag(self, start, by):
        hand = self.page.context.new_cdp_session(self.page)
        for k, (x, y) in enumerate(self.way(start, by)):
            points = [{"x": x, "y": y, "id": 0}]
            hand.send("Input.dispatchTouchEvent", {"type": "touchMove" if k else "touchStart", "touchPoints": points})
        hand.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        hand.detach()

    def press(self, what):
        what.tap()

    def focus(self, field):
        field.tap()

    def show_parts(self):
        if self.sheet.button("Properties").get_attribute("aria-expanded") != "true":
            self.sheet.button("Properties").tap()

    def show_drawing(self):
        if self.sheet.button("Properties").get_attribute("aria-expanded") == "true":
            self.sheet.button("Close properties").tap()


class Saved:
    """The content of the saved file, and its scene."""

    def __init__(self, folder):
        self.text = (folder / f"{NAME}.toml").read_text(encoding="utf-8")
        self.document = tomllib.loads(self.text)
        self.scene = Pen(folder).scene("open", text=self.text)

    def get(self, *keys):
        """Return an entry of the file, or None."""
        at = self.document
        for key in keys:
            try:
                at = at[key]
            except (KeyError, IndexError):
                return None
        return at

    def turn(self, link):
        """Return the angle of a link [rad]."""
        return float(next(x["pose"][2] for x in self.scene["links"] if x["name"] == link))

    def pin(self, id):
        return next((x for x in self.scene["pins"] if x["id"] == id), {"at": [np.inf, np.inf], "ground": False})


@dataclass(frozen=True)
class Edit:
    """One step of the history.

    Attributes:
        name: what is done.
        make: the edit by a hand.
        holds: whether a file has it.
        lock: for locks, which no file has: the part, and the button that is pressed afterwards.
    """

    name: str
    make: Callable[[Hand], object]
    holds: Callable[[Saved], bool] | None = None
    lock: tuple[str, str] | None = None


def draw(tool, *places, end=False):
    def make(hand):
        hand.use(tool)
        for at in places:
            hand.tap(at)
        if end:
            hand.end()

    return make


def write(part, field, text):
    """Return an edit that writes into a field of a part, or of the whole linkage if `part` is empty."""

    def make(hand):
        hand.pick(part) if part else (hand.rest(), hand.show_parts())
        hand.write(field, text)

    return make


def press(part, kind, name):
    def make(hand):
        hand.pick(part)
        hand.press(hand.page.get_by_role(kind, name=name, exact=True).first)

    return make


def law(field, text):
    """Return an edit that writes into a field of the driver, or chooses its law."""

    def make(hand):
        hand.rest()
        hand.press(hand.page.locator("details.drive > summary"))
        if field == "Law of motion":
            hand.choose(field, text)
        else:
            hand.write(field, text)
        hand.page.keyboard.press("Escape")
        hand.page.locator(".drive .pop").wait_for(state="hidden")

    return make


def drag(tool, pin, by):
    def make(hand):
        hand.use(tool)
        hand.drag(hand.sheet.stands_at()[pin] if isinstance(pin, str) else pin, by)

    return make


def join(pin, to):
    """Return an edit that joins a pin with another by name."""

    def make(hand):
        hand.pick(pin)
        hand.choose("Join with", to)
        hand.press(hand.sheet.button("Join"))

    return make


def delete(part):
    def make(hand):
        hand.pick(part)
        hand.delete()

    return make


def branch(hand):
    hand.rest()
    hand.show_parts()
    hand.press(hand.sheet.button("Other assemblies"))
    other = hand.page.locator("dialog ul.chips button").nth(1)
    other.wait_for(timeout=60_000)
    hand.press(other)
    hand.page.wait_for_selector("dialog", state="detached")


def near(value, wanted):
    return value is not None and value == pytest.approx(wanted, rel=1e-9, abs=1e-12)


def value(wanted, *keys):
    """Return a test whether an entry of the file has a value in SI."""
    return lambda x: near(x.get(*keys), wanted)


def driven(key, wanted):
    """Return a test whether a key of the only driver, or of the first one, has a value."""
    own = ("scenarios", "driven", "driver"), ("scenarios", "driven", "drivers", 0)
    return lambda x: any(x.get(*at, key) == (wanted if isinstance(wanted, str) else pytest.approx(wanted, rel=1e-9)) for at in own)


def there(*keys):
    return lambda x: x.get(*keys) is not None


def gone(*keys):
    return lambda x: x.get(*keys) is None


def lock(part, name):
    return Edit(f"lock {name} of {part}", press(part, "button", f"Lock {name}"), lock=(part, f"Lock {name}"))


CRANK = "Is the crank, whose angle is the motion's phase"
EDITS = [
    Edit("pivot", draw("Ground pivot", (0.5, 0.35)), there("ground", "points", "7")),
    Edit("bar", draw("Bar", (0.5, 0.35), (0.6, 0.25)), there("links", "bar5")),
    Edit("slider", draw("Slider", (0.6, 0.25), (0.55, 0.15)), there("joints", "slide2")),
    Edit("link", draw("Link", (0.1, -0.05), (0.2, -0.1), (0.3, -0.05), end=True), there("links", "plate1")),
    Edit("spring", draw("Spring", (0.3, 0.28), (0.5, 0.35)), there("forces", "spring1")),
    Edit("damper", draw("Damper", (0.0, 0.12), (0.0, 0.25)), there("forces", "damper1")),
    Edit("torque", draw("Torque", (0.35, 0.14)), there("forces", "torque1")),
    Edit("force", draw("Force", (0.2, -0.1), (0.25, 0.05)), there("forces", "force1")),
    Edit("cylinder", draw("Cylinder", (0.45, -0.1), (0.3, -0.05)), there("cylinders")),
    Edit("observe", draw("Observe", (0.3, 0.28)), there("observe", "points", 1)),
    Edit("length", write("link bar1", "Length, m", "130 mm"), value(0.13, "links", "bar1", "points", "3", 0)),
    Edit("angle", write("link bar1", "Angle, °", "95 deg"), lambda x: abs(np.degrees(x.turn("bar1")) - 95.0) < 1e-6),
    Edit("x", write("pin bar2.P", "x, m", "4.5in"), lambda x: near(x.pin("bar2.P")["at"][0], 0.1143)),
    Edit("y", write("pin bar2.P", "y, m", "290 mm"), lambda x: near(x.pin("bar2.P")["at"][1], 0.29)),
    Edit("mass per metre", write("link bar2", "Mass per metre, kg/m", "900 g/m"), value(0.9, "links", "bar2", "kg_per_m")),
    Edit("mass", write("link bar3", "Mass, kg", "700 g"), value(0.7, "links", "bar3", "mass")),
    Edit("inertia", write("link bar3", "Inertia, kg m²", "5000 kg mm²"), value(0.005, "links", "bar3", "inertia")),
    Edit("another crank", press("link bar3", "checkbox", CRANK), lambda x: bool(x.get("crank") == "bar3")),
    Edit("the crank again", press("link bar1", "checkbox", CRANK), lambda x: bool(x.get("crank") == "bar1")),
    Edit("not observed", press("link bar2", "button", "P"), lambda x: "bar2.P" not in x.get("observe", "points")),
    Edit("observed", press("link bar2", "button", "P"), lambda x: "bar2.P" in x.get("observe", "points")),
    Edit("title", write("", "Title", "By every means"), lambda x: bool(x.get("title") == "By every means")),
    Edit("gravity x", write("", "Gravity x, m/s²", "100 mm/s²"), value(0.1, "gravity", 0)),
    Edit("gravity y", write("", "Gravity y, m/s²", "-9.8"), value(-9.8, "gravity", 1)),
    Edit("stiffness", write("force spring1", "Stiffness, N/m", "0.2 N/mm"), value(200.0, "forces", "spring1", "k")),
    Edit("damping", write("force spring1", "Damping, N s/m", "3"), value(3.0, "forces", "spring1", "c")),
    Edit("length at rest", write("force spring1", "Length at rest, m", "150 mm"), value(0.15, "forces", "spring1", "rest")),
    Edit("force x", write("force force1", "Force x, N", "0.02 kN"), value(20.0, "forces", "force1", "value", 0)),
    Edit("force y", write("force force1", "Force y, N", "-7"), value(-7.0, "forces", "force1", "value", 1)),
    Edit("moment", write("force torque1", "Value, N m", "500 N mm"), value(0.5, "forces", "torque1", "value")),
    Edit("direction", write("slide slide1", "Direction, °", "5 deg"), value(5.0, "joints", "slide1", "angle_deg")),
    Edit("offset", write("slide slide1", "Offset, m", "10 mm"), value(0.01, "joints", "slide1", "offset")),
    lock("pin 4", "place"),
    Edit("a free place", press("pin 4", "button", "Lock place")),
    lock("slide slide1", "slide"),
    Edit("a free slide", press("slide slide1", "button", "Lock slide")),
    lock("link bar3", "length 4\u20132"),
    Edit("a free length", press("link bar3", "button", "Lock length 4\u20132")),
    lock("link bar3", "angle"),
    Edit("a free angle", press("link bar3", "button", "Lock angle")),
    Edit("duration", law("Duration, s", "2000 ms"), value(2.0, "scenarios", "driven", "duration")),
    Edit("speed", law("Speed, rev/min", "9 rad/s"), driven("speed", 9.0)),
    Edit("start", law("Start, °", "100 deg"), driven("start_deg", 100.0)),
    Edit("law", law("Law of motion", "cosine"), driven("law", "cosine")),
    Edit("travel", law("Travel, °", "180"), driven("travel_deg", 180.0)),
    Edit("time", law("In, s", "500 ms"), driven("time", 0.5)),
    Edit("name of a link", write("link bar3", "Name", "rocker"), there("links", "rocker")),
    Edit("name of a pin", write("pin 4", "Name", "C"), there("joints", "C")),
    Edit("name of a slide", write("slide slide1", "Name", "guide"), there("joints", "guide")),
    Edit("name of a force", write("force spring1", "Name", "main"), there("forces", "main")),
    Edit(
        "another place",
        drag("Reshape", (0.2, -0.1), (0.0, 0.05)),
        lambda x: any(np.hypot(p["at"][0] - 0.2, p["at"][1] + 0.05) < 1e-6 for p in x.scene["pins"]),
    ),
    Edit(
        "on the ground",
        press("pin plate1.11", "checkbox", "Fixed to the ground"),
        lambda x: any(p["ground"] and "plate1.11" in p["members"] for p in x.scene["pins"]),
    ),
    Edit(
        "joined",
        join("pin plate1.10", "bar2.P"),
        lambda x: any({"bar2.P", "plate1.10"} <= {*p["members"]} for p in x.scene["pins"]),
    ),
    Edit("pulled", drag("Select", "3", (0.05, 0.0)), lambda x: x.pin("3")["at"][0] > 0.0),
    Edit("delete a force", delete("force torque1"), gone("forces", "torque1")),
    Edit("delete a slide", delete("slide slide2"), gone("joints", "slide2")),
    Edit("delete a link", delete("link bar5"), gone("links", "bar5")),
    Edit("delete a plate", delete("link plate1"), gone("links", "plate1")),
    Edit("branch", branch),
]


def shown(hand):
    """Return kind -> ids of the parts on the page."""
    find = "(c, kind) => [...c.querySelectorAll(`[data-${kind}]`)].map(x => x.dataset[kind])"
    return {kind: sorted(hand.sheet.canvas.evaluate(find, kind)) for kind in IDS}


def check(hand, folder):
    """Save, check that the page shows the parts of the file, and return the file."""
    before = hand.sheet.revision()
    hand.save()
    hand.sheet.changed(before)
    saved, window, pins = Saved(folder), None, {}
    while window != (hand.sheet.scale(), hand.sheet.origin()):  # a note below the drawing may move it meanwhile
        window, pins = (hand.sheet.scale(), hand.sheet.origin()), hand.sheet.stands_at()
    scene = saved.scene
    assert shown(hand) == {kind: sorted(x[key] for x in scene[f"{kind}s"]) for kind, key in IDS.items()}
    for pin in scene["pins"]:
        if pin["id"] in pins:  # the point of a guide is not drawn as a pin
            assert np.hypot(*np.subtract(pins[pin["id"]], pin["at"])) < 1.5 / hand.sheet.scale(), pin["id"]
        else:
            assert pin["ground"], pin["id"]
    return saved


def is_locked(hand, part, button):
    hand.pick(part)
    return bool(hand.page.get_by_role("button", name=button, exact=True).first.get_attribute("aria-pressed") == "true")


def make_all(hand, folder):
    """Make all edits, check each on the page and in the file, and return the files before, between and after them."""
    sheet = hand.sheet
    sheet.button("Open").click()
    sheet.button(f"{NAME}.toml").click()
    sheet.page.wait_for_selector("dialog", state="detached")
    sheet.settled()
    curves = sheet.button("Curves")
    curves.wait_for()
    if curves.get_attribute("aria-expanded") == "true":
        curves.click()  # they would take their room in the middle of it
    sheet.fitted()
    files = [check(hand, folder)]
    for edit in EDITS:
        before = sheet.revision()
        edit.make(hand)
        refused = hand.page.locator(".prompt.refused, .field .refusal").count()
        assert refused == 0, (edit.name, sheet.page.get_by_test_id("said").inner_text())
        sheet.changed(before)
        files.append(check(hand, folder))
        if edit.holds:
            assert edit.holds(files[-1]), f"{edit.name}:\n{files[-1].text}"
            assert not edit.holds(files[-2]), f"{edit.name}: was so before"
        if edit.lock:
            assert is_locked(hand, *edit.lock), edit.name
    return files


def walk_history(hand, folder, files):
    """Undo all edits and redo them; check page and file after every step."""
    count = len(EDITS)
    steps = [*((k, "undo", EDITS[k]) for k in reversed(range(count))), *((k + 1, "redo", EDITS[k]) for k in range(count))]
    for k, way, edit in steps:
        before = hand.sheet.revision()
        hand.history(way)
        hand.sheet.changed(before)
        assert check(hand, folder).text == files[k].text, (way, edit.name)
        if edit.lock:
            assert is_locked(hand, *edit.lock) == (way == "redo"), (way, edit.name)
    assert not hand.sheet.wrong, hand.sheet.wrong[:3]


HANDS = {"mouse": Hand, "keys": Keys, "touch": Touch}


@pytest.fixture(params=HANDS)
def hand(request, browser, folder):
    with studio(folder) as running:
        opened = HANDS[request.param](browser, running.address)
        yield opened
        opened.page.close()


@pytest.mark.long
def test_every_edit_by_every_means_is_on_the_page_in_the_file_and_taken_back_over_fifty_steps(hand, folder):
    assert len(EDITS) >= STEPS
    walk_history(hand, folder, make_all(hand, folder))
