"""Four-bars through three poses: against known linkages, and for branch and order against a walk along the motion."""

from cmath import phase, rect

import numpy as np
import pytest

from gauss_bench.kinematics.synthesis import NoFourBar, four_bar_of_pins, four_bar_of_pivots

CRANK_ROCKER = (0.10, 0.28, 0.24, 0.30)  # input, coupler, output, frame
DOUBLE_CRANK = (0.30, 0.20, 0.28, 0.10)
TRIPLE_ROCKER = (0.24, 0.20, 0.26, 0.45)


def pose_of(lengths, angle, side=1):
    """Return the pose of the coupler with the input at an angle, on one of two branches, or None; pivots are at 0 and `frame`."""
    a, b, c, d = lengths
    pin = rect(a, angle)
    way = d - pin
    along = (b * b - c * c + abs(way) ** 2) / (2 * abs(way))
    if abs(along) > b:
        return None
    return pin, phase(way) + side * float(np.arccos(along / b))


def poses(lengths, angles, sides=(1, 1, 1)):
    found = [pose_of(lengths, x, s) for x, s in zip(angles, sides, strict=True)]
    return [x for x in found if x is not None]


def drive(lengths, angles, sides=(1, 1, 1)):
    return four_bar_of_pins(poses(lengths, angles, sides), [0j, lengths[1] + 0j]).drives[0]


@pytest.mark.parametrize("lengths", [CRANK_ROCKER, DOUBLE_CRANK, TRIPLE_ROCKER])
def test_pins_give_the_known_pivots_and_pivots_the_known_pins(lengths):
    given = poses(lengths, (0.4, 0.7, 0.95))
    pins = [0j, lengths[1] + 0j]
    found = four_bar_of_pins(given, pins)
    assert [x.pivot for x in found.connections] == pytest.approx([0, lengths[3]], abs=1e-9)
    assert [x.length for x in found.connections] == pytest.approx([lengths[0], lengths[2]])
    back = four_bar_of_pivots(given, [0j, lengths[3] + 0j])
    assert [x.pin for x in back.connections] == pytest.approx(pins, abs=1e-9)


def test_a_pin_whose_places_lie_on_a_line_slides_and_a_pin_that_nearly_does_is_refused():
    """A crank-slider: the second pin on the line y = 0.02."""

    def slid(rise=0.0):
        pins = [rect(0.1, angle) for angle in (0.3, 0.9, 1.4)]
        return [(pin, float(np.arcsin((0.02 + rise * (k == 1) - pin.imag) / 0.3))) for k, pin in enumerate(pins)]

    found = four_bar_of_pins(slid(), [0j, 0.3 + 0j])
    first, second = found.connections
    assert first.pivot == pytest.approx(0, abs=1e-9)
    assert abs(second.direction.imag) < 1e-9
    assert found.drives[0].fault == "" == found.drives[1].fault
    with pytest.raises(NoFourBar, match="the second pin moves almost along a line"):
        four_bar_of_pins(slid(1e-6), [0j, 0.3 + 0j])


def test_poses_without_a_four_bar_are_refused_with_the_reason():
    given = poses(CRANK_ROCKER, (0.4, 0.9, 1.5))
    with pytest.raises(NoFourBar, match="the pins coincide"):
        four_bar_of_pins(given, [0.1 + 0j, 0.1 + 0j])
    turned = [(rect(0.2, x), x) for x in (0.1, 0.5, 1.2)]  # a rotation about the origin
    with pytest.raises(NoFourBar, match="the fixed pivots coincide"):
        four_bar_of_pins(turned, [0j, 0.1 + 0j])
    with pytest.raises(NoFourBar, match="the first pin is at the same place in two"):
        four_bar_of_pins([given[0], (given[0][0], 1.0), given[2]], [0j, 0.28 + 0j])
    shifted = [(0j, 0.2), (0.1 + 0j, 0.2), (0.3 + 0j, 0.2)]  # a straight translation: every fixed pivot goes along a line
    with pytest.raises(NoFourBar, match="the first fixed pivot has no pin"):
        four_bar_of_pivots(shifted, [0j, 0.3 + 0j])


def test_poses_of_two_branches_are_said_to_be():
    found = drive(CRANK_ROCKER, (0.5, 2.0, 4.0), (1, 1, -1))
    assert found.fault == "branch"
    assert "the third is on the other branch" in found.text
    assert "the second is on" in drive(CRANK_ROCKER, (0.5, 2.0, 4.0), (-1, 1, -1)).text


@pytest.mark.slow
def test_faults_agree_with_a_walk_along_the_motion():
    """The input of random linkages is stepped from pose to pose in both senses while the coupler reaches the output."""
    rng, seen = np.random.default_rng(4), []
    for _ in range(200):
        lengths = tuple(rng.uniform(0.1, 0.5, 4))
        angles, sides = tuple(rng.uniform(-np.pi, np.pi, 3)), tuple(int(x) for x in rng.choice([1, 1, 1, -1], 3))
        if len(given := poses(lengths, angles, sides)) < 3:
            continue
        try:
            found = four_bar_of_pins(given, [0j, lengths[1] + 0j]).drives[0]
        except NoFourBar:
            continue
        passed = [
            walk(lengths, angles[0], way, [(x, s == sides[0]) for x, s in zip(angles[1:], sides[1:], strict=True)])
            for way in (1, -1)
        ]
        if [0, 1] in passed:
            expected = ""
        elif {*passed[0], *passed[1]} == {0, 1}:
            expected = "order"
        else:
            expected = "branch"
        assert found.fault == expected, (lengths, angles, sides, passed)
        seen.append(expected)
    assert min(seen.count(x) for x in ("", "order", "branch")) > 5


def walk(lengths, start, way, goals):
    """Return the goals on the first pose's branch, in the order in which the input passes them in a turn, or until it stops."""
    steps = 2000
    ahead = [np.mod(way * (x - start), 2 * np.pi) for x, _ in goals]
    end = 2 * np.pi
    for k in range(steps):
        if pose_of(lengths, start + way * 2 * np.pi * k / steps) is None:
            end = 2 * np.pi * k / steps
            break
    return sorted((i for i, (_, same) in enumerate(goals) if same and ahead[i] < end), key=lambda i: ahead[i])
