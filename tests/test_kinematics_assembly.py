"""Drawings that do not assemble: the loop that stays open, its gap, and the length that would close it."""

import copy
from dataclasses import replace

import pytest

from gauss_bench.kinematics.assembly import find_open_loop, rank_about
from gauss_bench.linkage.load import built_in, document_of, load, load_document
from gauss_bench.linkage.sketch import sketch


def place_as_drawn(mechanism, document):
    """Leave the joints open, as the sketch draws them."""
    q = sketch(mechanism, document)
    return replace(mechanism, q0=q, v0=0.0 * q)


def four_bar(**lengths):
    document = copy.deepcopy(document_of("four_bar")[0])
    for link, length in lengths.items():
        document["links"][link]["points"]["C"] = [length, 0.0]
    return document


@pytest.mark.parametrize(("lengths", "gap", "link"), [({"rocker": 0.9}, 0.02, "rocker"), ({"coupler": 1.0}, 0.18, "coupler")])
def test_a_bar_too_long_leaves_the_gap_of_the_polygon_inequality(lengths, gap, link):
    found = find_open_loop(load_document(four_bar(**lengths), place=place_as_drawn))
    assert found.alone
    assert found.apart == pytest.approx(gap, abs=1e-9)
    assert set(found.links) == {"ground", "crank", "coupler", "rocker"}
    needed = {x.link: x.needed - x.now for x in found.lengths}
    assert needed == pytest.approx({x: -gap if x == link else gap for x in found.links}, abs=1e-6)
    assert found.lengths[0].link == link
    assert f"stay {gap:.4g} m apart" in str(found)


def test_a_loop_that_only_others_keep_open_says_so():
    """The third crank of a parallelogram has another length: its loop closes alone, but not beside the other loop."""
    document = four_bar()
    document["ground"]["points"]["E"] = [0.2, -0.4]
    document["links"]["prop"] = {"points": {"E": [0.0, 0.0], "P": [0.1, 0.0]}, "bars": [["E", "P"]], "kg_per_m": 0.8}
    document["joints"]["E"] = {"type": "revolute", "at": ["ground.E", "prop.E"]}
    document["joints"]["P"] = {"type": "revolute", "at": ["prop.P", "coupler.P"]}
    document["assembly"]["sketch"]["P"] = [0.2, 0.2]
    document.pop("expect")
    found = find_open_loop(load_document(document, place=place_as_drawn))
    assert "prop" in found.links
    assert found.apart > 0.05


@pytest.mark.parametrize("name", sorted(set(built_in()) - {"sleigh"}))
def test_what_assembles_is_counted_as_the_loader_counts(name):
    mechanism = load(name)
    assert find_open_loop(mechanism) is None
    assert rank_about(mechanism, mechanism.q0) == mechanism.n - mechanism.dof
