"""Pictures of a run: its curves, its table and the moving linkage, with marks on the part that is not trusted."""

import csv
import io
import itertools
import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from PIL import Image

import gauss_bench
from gauss_bench.api.history import table
from gauss_bench.cli import main
from gauss_bench.linkage.load import built_in
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import SpringDamper
from gauss_bench.report.drawings.drawing import draw, fit_canvas
from gauss_bench.report.drawings.forces import force_parts
from gauss_bench.report.drawings.history import GAP, move_apart, plot
from gauss_bench.report.drawings.pose import pose_links
from gauss_bench.report.drawings.shown import encode_film
from gauss_bench.trajectory import Group

SVG = "{http://www.w3.org/2000/svg}"
Box = tuple[float, float, float, float]


@pytest.fixture(scope="module")
def driven():
    return gauss_bench.simulate("four_bar", scenario="driven", step=5e-3)


@pytest.fixture(scope="module")
def walking():
    return gauss_bench.simulate("jansen", step=5e-3, at=[0.5])


@pytest.fixture(scope="module")
def failing():
    return gauss_bench.simulate("crank_slider", step=0.05)


def curve(result, name):
    (found,) = (x for x in gauss_bench.history(result).curves if x.name == name)
    return found.values


def overlaps(boxes):
    return [
        (a, b)
        for (a, p), (b, q) in itertools.combinations(boxes, 2)
        if min(p[2], q[2]) - max(p[0], q[0]) > 0.5 and min(p[3], q[3]) - max(p[1], q[1]) > 0.5
    ]


def written(svg):
    """Return the texts of a drawing with the boxes of their letters, in a font that is as wide as Helvetica."""
    found = []
    for x in ET.fromstring(svg).iter(f"{SVG}text"):
        size = float(x.get("font-size", 13)) * 0.9
        outline = TextPath((0, 0), x.text or "", size=size, prop=FontProperties("DejaVu Sans")).get_extents()
        left, base = float(x.attrib["x"]) - outline.width / 2, float(x.attrib["y"])
        found.append((str(x.text), (left, base - outline.y1, left + outline.width, base - outline.y0)))
    return found


@pytest.mark.long
def test_names_in_drawings_neither_meet_nor_leave_the_picture():
    for name in built_in():
        svg = draw(*pose_links(name))
        _, _, width, height = (float(x) for x in ET.fromstring(svg).attrib["viewBox"].split())
        boxes = written(svg)
        assert not overlaps(boxes), name
        assert all(b[0] >= 0 and b[1] >= 0 and b[2] <= width and b[3] <= height for _, b in boxes), name


def test_a_spring_reaches_from_point_to_point_wherever_the_linkage_is():
    mechanism, _, trace = pose_links("jansen")
    states = trace[::20]
    canvas = fit_canvas(mechanism, trace)
    found = {mark.name: mark for mark in force_parts(mechanism, states, canvas)}
    for spring in (x for x in mechanism.forces if isinstance(x, SpringDamper)):
        mark = found[spring.name]
        length = np.hypot(*(mark.reach[0, 1] - mark.reach[0, 0])) * mark.stretch
        turn = np.radians(mark.turn)
        end = mark.place + length[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        np.testing.assert_allclose(mark.place, canvas.at(position(states, spring.a)), atol=1e-9)
        np.testing.assert_allclose(end, canvas.at(position(states, spring.b)), atol=1e-6)


def test_curves_follow_their_definitions(driven):
    mechanism, x = driven.model, driven.trajectory
    b, d = (position(x.q, mechanism.point(i, name)) for i, name in ((0, "B"), (2, "D")))
    diagonal = np.hypot(*(b - d).T)
    law_of_cosines = np.degrees(np.arccos((0.36**2 + 0.3**2 - diagonal**2) / (2 * 0.36 * 0.3)))
    angle = curve(driven, "coupler-rocker.transmission")
    np.testing.assert_allclose(angle, np.minimum(law_of_cosines, 180 - law_of_cosines), atol=1e-6)
    at_end = curve(driven, "crank.torque")[-1]
    assert at_end == pytest.approx(driven.drivers["crank"][-1], rel=1e-12)
    power = curve(driven, "crank.torque") * x.v[:, 2]
    gained = curve(driven, "energy.kinetic") + curve(driven, "energy.potential")
    np.testing.assert_allclose(gained - gained[0], np.append(0, np.cumsum(np.diff(x.t) * (power[1:] + power[:-1]) / 2)), atol=2e-4)
    slide = gauss_bench.simulate("crank_slider", step=1e-2, at=[0.0])
    assert curve(slide, "rod-slider.transmission")[0] == pytest.approx(90.0, abs=1e-9)  # stretched out at the start


def test_the_table_names_units_and_keeps_an_order(walking):
    history = gauss_bench.history(walking)
    rows = list(csv.reader(io.StringIO(table(history))))
    assert rows[0][0] == "t [s]"
    assert all(re.fullmatch(r"[\w.\- ]+ \[[\w/^ ]+\]", name) for name in rows[0])
    assert [x.group for x in history.curves] == sorted((x.group for x in history.curves), key=list(Group).index)
    assert {"foot.theta [rad]", "foot.G.vx [m/s]", "energy.kinetic [J]", "motor.torque [N m]"} <= set(rows[0])
    values = np.array([[float(x) for x in row] for row in rows[1:]])
    np.testing.assert_allclose(values[:, 1:], np.column_stack([x.values for x in history.curves]), rtol=1e-9)


def test_a_failed_run_has_the_time_that_it_reached_and_the_time_up_to_which_it_is_trusted(failing):
    assert failing.status == "nan"
    assert not failing.valid
    assert {x.subject for x in failing.objections} >= {"loops", "energy"}
    assert 0.0 < failing.trusted_until < failing.metrics["until"] < 2.0
    assert failing.advice == "do not trust it; take a step smaller than 0.05 s, or stabilization projection"
    before = gauss_bench.simulate("crank_slider", step=0.05, at=[failing.trusted_until - 0.05])  # at times of the certificate
    after = gauss_bench.simulate("crank_slider", step=0.05, at=[failing.trusted_until + 0.05])
    assert (before.valid, after.valid) == (True, False)
    assert len(after.t) == 1  # shown nevertheless
    gained = curve(failing, "energy.gained")
    assert np.isfinite(gained).sum() == round(failing.trusted_until / 0.05) + 1
    held = gauss_bench.simulate("crank_slider", stabilization="projection", step=0.1)
    assert "projection" not in held.advice, "who has it is not advised to take it"


def test_names_in_plots_do_not_overlap_and_the_untrusted_part_is_shaded(walking, failing):
    for result in (walking, failing):
        figure = plot(gauss_bench.history(result), result.told())
        assert not overlaps(texts_of(figure))
        shaded = sum(bool(axes.patches) for axes in figure.axes)
        assert shaded == (0 if result.valid else len(figure.axes))
    units = [re.findall(r"\[(.*?)\]", axes.get_title(loc="left")) for axes in figure.axes]
    assert all(len(x) == 1 for x in units)
    assert {"m", "m/s", "J", "N", "N m", "deg"} == {x[0] for x in units}


def texts_of(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    inside = figure.bbox
    found = []
    for axes in figure.axes:
        for text in (*axes.texts, axes.title, axes._left_title, axes._right_title):
            if text.get_text():
                box = text.get_window_extent(canvas.get_renderer())
                assert inside.x0 <= box.x0
                assert box.x1 <= inside.x1, text.get_text()
                found.append((text.get_text(), (box.x0, box.y0, box.x1, box.y1)))
    return found


def test_names_stay_as_near_as_their_distance_allows():
    np.testing.assert_allclose(move_apart(np.array([10.0, 50.0]), GAP, 100.0), [10.0, 50.0])
    np.testing.assert_allclose(move_apart(np.array([50.0, 50.0]), 10.0, 100.0), [45.0, 55.0])
    crowded = np.sort(move_apart(np.array([0.0, 0.0, 1.0, 99.0, 100.0]), 10.0, 100.0))
    assert np.diff([-10.0, *crowded, 110.0]).min() >= 10.0 - 1e-9  # and between 0 and 100


@pytest.mark.long
def test_a_film_ends_at_the_time_up_to_which_the_run_is_trusted(failing, driven):
    told, history = failing.told(), gauss_bench.history(failing)
    moving = encode_film(".svg", told, history, failing.model, failing.trajectory).decode()
    assert "motion-film" in moving
    whole = encode_film(".html", told, history, failing.model, failing.trajectory).decode()
    assert told.verdict.split(";")[0] in whole
    assert set(re.findall(r"\w+://[^\"' )<]+", whole)) <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    pictures = Image.open(io.BytesIO(encode_film(".gif", driven.told(), history, driven.model, driven.trajectory)))
    assert getattr(pictures, "n_frames", 0) == 80


def test_files_are_written_if_the_run_reached_something(tmp_path, capsys):
    plot_file, out = tmp_path / "run.svg", tmp_path / "run.csv"
    command = ["simulate", "four_bar", "--step", "0.01", "--at", "0.2", "--json", "--plot", str(plot_file), "--out", str(out)]
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out)["status"] == "ok"
    assert out.read_text().startswith("t [s],coupler.P.x [m]")
    assert "<svg" in plot_file.read_text()
    main(["simulate", "parallelogram", "--engine", "minimal", "--at", "0.1", "--out", str(tmp_path / "none.csv")])
    assert "no file is written" in capsys.readouterr().err
    assert sorted(x.name for x in tmp_path.iterdir()) == ["run.csv", "run.svg"]
