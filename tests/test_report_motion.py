"""Animations and curves, read back from their files: joints stay closed, and lines follow the states."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from gauss_bench.linkage.load import load
from gauss_bench.mechanism.coordinates import acceleration, position, velocity
from gauss_bench.mechanism.model import GROUND, Prismatic, Revolute
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.report.drawings.animation import FRAMES, REST, SHORTEST, Film, animate
from gauss_bench.report.drawings.canvas import make_part
from gauss_bench.report.drawings.curves import draw_curves
from gauss_bench.report.drawings.drawing import bar_ends, fit_canvas
from gauss_bench.report.drawings.pose import pose_links
from gauss_bench.report.palette import inline
from tests.conftest import exhaustive

SVG = "{http://www.w3.org/2000/svg}"
LINKAGES = exhaustive(["eight_bar", "four_bar", "jansen", "parallelogram", "shaper", "six_bar"], "shaper", "six_bar")
# [px] a bar's end is written to 0.05 in x and y, its link's place to 0.005 and its angle to 0.005 degrees, over up to 500 px
WRITTEN = 0.15
BETWEEN = 0.1  # [px] more, for straight lines between states that are a turn of 4 degrees apart


def turn(name):
    mechanism, _, states = pose_links(name)
    assert states is not None
    return mechanism, np.linspace(0.0, 1.0, len(states)), states


def film(svg):
    (found,) = (g for g in ET.fromstring(svg).iter(f"{SVG}g") if g.get("class") == "motion-film")
    return found


def groups(svg):
    """Return name of a link -> the group of the film that has its shapes."""
    return {title.text or "": g for g in film(svg) if (title := g.find(f"{SVG}title")) is not None}


def track(group, kind, parts):
    """Return the values (k, d) of an animation at parts (k,) of its loop, interpolated as a browser does."""
    (found,) = (x for x in group.findall(f"{SVG}animateTransform") if x.get("type") == kind)
    values = np.array([[float(x) for x in frame.split()] for frame in found.attrib["values"].split(";")])
    keys = found.get("keyTimes")
    at = np.array([float(x) for x in keys.split(";")]) if keys else np.linspace(0, 1, len(values))
    assert len(at) == len(values)
    assert (at[0], at[-1]) == (0, 1)
    assert np.all(np.diff(at) > 0)
    return np.stack([np.interp(parts, at, column) for column in values.T], axis=-1)


def carry(group, local, parts):
    """Return the pixels (k, 2) of a place (2,) in a link's group at parts (k,) of the loop."""
    angle = np.radians(track(group, "rotate", parts)[:, 0])
    c, s = np.cos(angle), np.sin(angle)
    turned = np.stack([c * local[0] - s * local[1], s * local[0] + c * local[1]], axis=-1)
    return track(group, "translate", parts) + turned


def numbers(text):
    return np.array([float(x) for x in re.findall(r"-?\d+\.?\d*", text)]).reshape(-1, 2)


def where(mechanism, svg, point, parts):
    """Return the pixels (k, 2) of a point at parts (k,) of the loop, or None if it is no end of a bar."""
    if point.link == GROUND:
        return None
    link, _, name = point.name.partition(".")
    bars = [x for x in groups(svg)[link].findall(f"{SVG}path") if x.get("stroke-linecap") == "round"]
    names = [name for pair in bar_ends(mechanism.links[point.link]) for name in pair]
    return carry(groups(svg)[link], numbers(bars[0].attrib["d"])[names.index(name)], parts) if bars and name in names else None


@pytest.mark.parametrize("name", LINKAGES)
def test_links_move_as_the_states_do_pins_hold_in_between_and_the_loop_closes(name):
    mechanism, t, q = turn(name)
    wrapped = q.reshape(len(q), -1, 3).copy()
    wrapped[..., 2] = (wrapped[..., 2] + np.pi) % (2 * np.pi) - np.pi
    svg = animate(mechanism, t, wrapped.reshape(q.shape), mechanism.observed_points)
    assert set(groups(svg)) == {link.name for link in mechanism.links}
    at_states, halfway = np.linspace(0, 1, len(t)), (np.arange(len(t) - 1) + 0.5) / (len(t) - 1)
    canvas = fit_canvas(mechanism, q, mechanism.observed_points)
    compared = 0
    for joint in (j for j in mechanism.joints if isinstance(j, Revolute)):
        for point in (p for p in (joint.a, joint.b) if p.link != GROUND):
            pixels = where(mechanism, svg, point, at_states)
            if pixels is not None:
                np.testing.assert_allclose(pixels, canvas.at(position(q, point)), atol=WRITTEN)
        compared += holds(mechanism, svg, joint, halfway)
    assert compared >= 1
    for group in groups(svg).values():
        place, angle = (track(group, kind, at_states) for kind in ("translate", "rotate"))
        assert np.ptp(place, axis=0).max() + np.ptp(angle) > 1
        np.testing.assert_allclose(place[0], place[-1], atol=0.01)
        turns = (angle[-1, 0] - angle[0, 0]) / 360
        assert turns == pytest.approx(round(turns), abs=1e-4)
        assert np.abs(np.diff(angle[:, 0])).max() < 20, "an angle was wrapped, which jumps by nearly a turn between two states"
    assert f'dur="{SHORTEST:g}s"' in svg
    assert "slowed 4 times" in svg


def holds(mechanism, svg, joint, parts):
    """Check that both ends of a pin coincide at parts (k,) of the loop; tell whether both are ends of bars."""
    a, b = (where(mechanism, svg, p, parts) for p in (joint.a, joint.b))
    if a is None or b is None:
        return False
    assert np.hypot(*(a - b).T).max() < 2 * (WRITTEN + BETWEEN)
    return True


@pytest.mark.parametrize("name", exhaustive(["shaper", "six_bar"], "shaper"))
def test_blocks_stay_on_their_guides(name):
    mechanism, t, q = turn(name)
    parts = (np.arange(len(t) - 1) + 0.5) / (len(t) - 1)
    lines, blocks = [], []
    for group in film(animate(mechanism, t, q)).findall(f"{SVG}g"):
        carried = group.find(f"{SVG}animateTransform") is not None
        for path in (x for x in group.findall(f"{SVG}path") if x.get("stroke-dasharray") == "9 3 2 3"):
            line = numbers(path.attrib["d"])
            lines.append([carry(group, x, parts) if carried else np.tile(x, (len(parts), 1)) for x in line])
        blocks += [carry(group, numbers(x.attrib["transform"].split(")")[0])[0], parts) for x in group.findall(f"{SVG}rect")]
    assert len(lines) == len(blocks) == sum(isinstance(j, Prismatic) for j in mechanism.joints)
    for block in blocks:
        off = []
        for a, b in lines:
            along, gap = (b - a) / np.hypot(*(b - a).T)[:, None], block - a
            off.append(np.abs(along[:, 0] * gap[:, 1] - along[:, 1] * gap[:, 0]).max())
        assert min(off) < 2 * (WRITTEN + BETWEEN)


def test_a_block_lies_along_its_guide_however_its_own_frame_is_turned():
    mechanism, t, q = turn("crank_slider")
    (slide,) = (j for j in mechanism.joints if isinstance(j, Prismatic))
    other = replace(slide, turn=slide.turn + 0.4)
    q = q.copy()
    q[:, 3 * slide.block.link + 2] += 0.4
    mechanism = replace(mechanism, joints=tuple(other if j is slide else j for j in mechanism.joints))
    group = groups(animate(mechanism, t, q))[mechanism.links[slide.block.link].name]
    (block,) = group.findall(f"{SVG}rect")
    own = float(block.attrib["transform"].split("rotate(")[1].strip(")"))
    angles = track(group, "rotate", np.linspace(0, 1, len(t))) + own
    np.testing.assert_allclose(angles, -np.degrees(slide.angle), atol=0.02)  # both are written to 0.01 degrees


def test_a_small_file_shows_points_on_their_paths_and_a_named_state_to_readers_who_prefer_less_motion():
    mechanism, t, q = turn("eight_bar")
    point = mechanism.observed_points[0]
    svg = animate(mechanism, t, q, [point])
    root = ET.fromstring(svg)
    (dotted,) = (x for x in root.iter(f"{SVG}path") if x.get("stroke-dasharray") == "1.5 4")
    (dot,) = (g for g in film(svg) if g.findtext(f"{SVG}text") == point.name.partition(".")[2])
    np.testing.assert_allclose(track(dot, "translate", np.linspace(0, 1, len(t))), numbers(dotted.attrib["d"]), atol=0.06)  # 0.1 px
    (still,) = (g for g in root.iter(f"{SVG}g") if g.get("class") == "motion-still")
    assert still.get("display") == "none"
    assert not list(still.iter(f"{SVG}animateTransform"))
    assert {link.name for link in mechanism.links} <= {x.text for x in still.iter(f"{SVG}text")}
    (rules,) = re.findall(r"prefers-reduced-motion:reduce\)\{(.*)\}$", root.findtext(f"{SVG}style") or "")
    assert set(rules.split("}")) == {".motion-film{display:none", ".motion-still{display:inline", ""}
    assert len(svg.encode()) < 100_000
    assert set(re.findall(r"\w+://[^\"' )<]+", svg)) == {"http://www.w3.org/2000/svg"}
    assert not re.search(r"<script|href|url\(|@import|\son\w+=", svg)
    assert not re.search(r"#[0-9a-f]{6}", inline(svg, "x")), "a colour has no variable and would not turn dark"


def test_a_motion_that_does_not_return_rests_at_its_end_and_keeps_time():
    mechanism, t, q = turn("four_bar")
    half = len(t) // 2
    svg = animate(mechanism, 10 * t[:half], q[:half])
    length = 10 * float(t[half - 1])
    assert f'dur="{length + REST:.6g}s"' in svg
    assert "slowed" not in svg
    for group in groups(svg).values():
        end = track(group, "rotate", np.array([length, length + REST]) / (length + REST))
        assert end[0] == pytest.approx(end[1], abs=1e-3)
        assert abs(track(group, "rotate", np.zeros(1))[0] - end[1]) > 1


@pytest.mark.slow
def test_many_states_are_thinned_by_how_far_they_turn():
    mechanism = load("four_bar", "driven")
    angles = np.linspace(0, 2 * np.pi, 3001)
    still = np.zeros_like(angles)
    q, _, _ = MinimalCoordinate(mechanism).state(angles, still, still)
    svg = animate(mechanism, angles, q)
    assert FRAMES <= svg.count(";") / svg.count("<animateTransform") < 200
    pins = [j for j in mechanism.joints if isinstance(j, Revolute)]
    assert sum(holds(mechanism, svg, joint, np.linspace(0, 1, 777)) for joint in pins) >= 1


def test_a_motion_without_states_or_points_is_refused():
    mechanism, t, q = turn("four_bar")
    for times, states in ((t[:1], q[:1]), (t[:5], q[:4]), (t[::-1], q)):
        with pytest.raises(ValueError, match="two or more states"):
            animate(mechanism, times, states)
    mechanism, t, q, v, a, points = driven(1)
    with pytest.raises(ValueError, match="a point"):
        draw_curves(mechanism, t, q, v, a, [])
    with pytest.raises(ValueError, match="at every time"):
        draw_curves(mechanism, t, q[:-1], v, a, points)


def driven(points):
    mechanism = load("eight_bar", "driven")
    t = np.linspace(0, 1, 121)
    w = np.full_like(t, 2 * np.pi)
    q, v, a = MinimalCoordinate(mechanism).state(2 * np.pi * t, w, 0 * w)
    return mechanism, t, q, v, a, [mechanism.point(0, "2"), *mechanism.observed_points][:points]


def drawn(svg, axes):
    """Return the pixels (k, 2) of each line of a panel, without axes and ticks."""
    (panel,) = (g for g in ET.fromstring(svg).iter(f"{SVG}g") if g.get("id") == f"axes_{axes}")
    lines = [g for g in panel if (g.get("id") or "").startswith("line2d_")]
    return [numbers(path.attrib["d"]) for g in lines for path in g.findall(f"{SVG}path")]


@pytest.mark.slow
def test_curves_are_the_path_velocity_and_acceleration_of_each_point_and_come_out_the_same():
    _, t, q, v, a, points = driven(2)
    svg = draw_curves(*driven(2))
    assert len(re.findall(r'id="axes_\d+"', svg)) == 3 * len(points) == 6
    assert svg == draw_curves(*driven(2))
    assert not re.search(r"<script|<image|href=\"(?!#)", svg)
    assert not re.search(r"#[0-9a-f]{6}", inline(svg, "x")), "a colour has no variable and would not turn dark"
    for row, point in enumerate(points):
        assert f">{point.name}</text>" in svg
        for panel, values in ((2, velocity(q, v, point)), (3, acceleration(q, v, a, point))):
            lines = drawn(svg, 3 * row + panel)
            assert len(lines) == 2
            seconds = [(line[:, 0] - line[0, 0]) / (line[-1, 0] - line[0, 0]) for line in lines]
            wanted = np.concatenate([np.interp(s, t, x) for s, x in zip(seconds, values.T, strict=True)])
            pixels = np.concatenate([line[:, 1] for line in lines])
            slope, shift = np.polyfit(wanted, pixels, 1)  # one scale for both components, upwards
            assert slope < 0
            assert np.abs(slope * wanted + shift - pixels).max() < 0.2  # [px]: what simplified lines may leave out
    circle = np.ptp(drawn(svg, 1)[0], axis=0)  # the path of a point of the crank
    assert circle[0] == pytest.approx(circle[1], rel=1e-3)  # 120 sides: their corners hit the extremes


@pytest.mark.parametrize(("slides", "turns"), [(True, False), (False, True), (True, True)])
def test_a_symbol_that_moves_has_the_angle_and_the_place_of_every_state(slides, turns):
    place = np.array([[10.0, 20.0], [30.0, 20.0]]) if slides else np.array([[10.0, 20.0]] * 2)
    angle = np.array([30.0, 70.0]) if turns else np.array([30.0, 30.0])
    group = ET.fromstring(Film(np.zeros((2, 3)), 'dur="1s"').draw(make_part(['<path d=""/>'], place, angle)))
    tracks = {x.attrib["type"]: (x.get("additive", "replace"), x.attrib["values"]) for x in group.findall("animateTransform")}
    # in SVG the first track replaces the transform of the group, and each track with additive="sum" multiplies the result
    assert tracks == {
        "translate": ("replace", ";".join(f"{x:.2f} {y:.2f}" for x, y in place)),
        "rotate": ("sum", ";".join(f"{x:.2f}" for x in angle)),
    }
