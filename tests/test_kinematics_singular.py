"""Dead centres and limits of motion against plane trigonometry, far below the promised 1e-8 rad."""

from threading import Event

import numpy as np
import pytest

from gauss_bench.kinematics.singular import ChangePoint, singular_positions
from gauss_bench.linkage.load import load, load_document
from tests.four_bars import four_bar

EXACT = 1e-11  # [rad] Newton ends near rounding; a fold doubles the digits lost


def of(found, coordinate):
    return np.array([np.mod(s.crank, 2 * np.pi) for s in found if s.coordinate == coordinate])


def corner(a, b, opposite):
    """Angle between sides a and b of a triangle."""
    return float(np.arccos((a * a + b * b - opposite * opposite) / (2 * a * b)))


def test_the_rocker_reverses_where_crank_and_coupler_are_in_line():
    found = of(singular_positions(load("four_bar")), "rocker")
    expected = [corner(0.36 + 0.12, 0.40, 0.30), np.pi + corner(0.36 - 0.12, 0.40, 0.30)]
    assert np.abs(np.sort(found) - expected).max() < EXACT


def test_the_slider_reverses_at_both_ends_of_its_stroke():
    found = singular_positions(load("crank_slider"))
    assert np.abs(np.sin([s.crank for s in found])).max() < EXACT
    assert sorted(s.value for s in found) == pytest.approx([0.56 - 0.15, 0.56 + 0.15], abs=1e-14)
    assert {s.kind for s in found} == {"dead centre"}


def test_a_crank_that_cannot_turn_has_its_limits_where_coupler_and_rocker_are_in_line():
    found = [s for s in singular_positions(load_document(four_bar(0.3, 0.2, 0.25, 0.4))) if s.kind == "limit"]
    limit = corner(0.3, 0.4, 0.2 + 0.25)
    assert sorted(s.crank for s in found) == pytest.approx([-limit, limit], abs=EXACT)


def test_the_quick_return_reverses_where_the_crank_is_square_to_the_lever():
    found = of(singular_positions(load("shaper")), "lever")
    half = np.arcsin(0.10 / 0.30)  # swing of the lever: the crank circle seen from the lever's pivot
    assert np.abs(np.sort(found) - [np.pi + half, 2 * np.pi - half]).max() < EXACT


def test_a_fork_of_the_motion_is_refused_by_name():
    parallelogram = four_bar(0.2, 0.4, 0.2, 0.4)
    parallelogram["assembly"] = {"sketch": {"B": [0.1, 0.17], "C": [0.5, 0.17]}}
    with pytest.raises(ChangePoint, match=r"forks|change point"):
        singular_positions(load_document(parallelogram))


def test_a_search_that_another_thread_ends_is_over_at_once():
    ended = Event()
    ended.set()
    with pytest.raises(ChangePoint, match="was ended"):
        singular_positions(load("four_bar"), ended)


def without_crank(measure, first):
    """Return a crank-rocker without the key `crank`, its links listed from `first` on; it may name the measured coordinate."""
    document = four_bar(0.12, 0.36, 0.30, 0.40)
    del document["crank"]
    links = document["links"]
    document["links"] = {name: links[name] for name in (first, *(x for x in links if x != first))}
    document["scenarios"]["rest"]["start"] = {"angles_deg": {"a": 60.0}}
    return document | ({"measure": measure} if measure else {})


@pytest.mark.parametrize(("measure", "first", "driving"), [({"link": "a"}, "b", "a"), ({"link": "c"}, "a", "c"), (None, "c", "c")])
def test_without_a_crank_the_measured_coordinate_drives(measure, first, driving):
    """The rocker reverses where crank and coupler are in line; that is a limit where the rocker drives."""
    found = singular_positions(load_document(without_crank(measure, first)))
    known = singular_positions(load_document(four_bar(0.12, 0.36, 0.30, 0.40)))
    assert {s.driving.name for s in found} == {driving}
    assert len(found) == len(known)
    rocker = sorted(s.value for s in found if s.coordinate == "c")
    assert rocker == pytest.approx(sorted(s.value for s in known if s.coordinate == "c"), abs=EXACT)
    assert {s.kind for s in found if s.coordinate == "c"} == {"limit" if driving == "c" else "dead centre"}
    assert all(s.input == s.value for s in found if s.coordinate == driving)
