"""The spanning tree maps states and forces to and from absolute coordinates without loss."""

import numpy as np
import pytest

from gauss_bench.engines.tree import spanning_tree
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import GROUND, Revolute

SHAPES = pytest.mark.parametrize("least_depth", [False, True], ids=["file order", "least depth"])


@SHAPES
def test_states_and_forces_go_there_and_back(least_depth, any_mechanism, rng):
    """States come back, the start lies in the tree, and forces do the same virtual work."""
    tree = spanning_tree(any_mechanism, least_depth)
    y, dy = rng.normal(size=(5, tree.n)), rng.normal(size=(5, tree.n))
    q, v, _ = tree.absolute(y, dy, 0 * y)
    for found, expected in zip(tree.relative(q, v), (y, dy), strict=True):
        assert np.abs(found - expected).max() < 1e-13
    Q = rng.normal(size=v.shape)
    assert np.abs((Q * v).sum(-1) - (tree.forces(q, Q) * dy).sum(-1)).max() < 1e-12
    y, dy = tree.relative(any_mechanism.q0, any_mechanism.v0)
    q, v, _ = tree.absolute(y, dy, 0 * y)
    assert np.abs(q - any_mechanism.q0).max() < 1e-14
    assert np.abs(v - any_mechanism.v0).max() < 1e-13


@SHAPES
def test_parents_come_first_slides_are_in_the_tree_and_every_joint_is_used_once(least_depth, any_mechanism):
    tree = spanning_tree(any_mechanism, least_depth)
    seen = {GROUND}
    for branch in tree.branches:
        assert branch.parent in seen
        seen.add(branch.link)
    assert len(seen) == len(any_mechanism.links) + 1
    assert all(isinstance(joint, Revolute) for joint in tree.closures)
    used = [b.joint for b in tree.branches if b.joint] + list(tree.closures)
    assert len(used) == len(any_mechanism.joints)
    assert {id(j) for j in used} == {id(j) for j in any_mechanism.joints}


def depths(tree):
    found = {GROUND: 0}
    for branch in tree.branches:
        found[branch.link] = found[branch.parent] + 1
    return found


@pytest.mark.parametrize("windows", [4, 64])
def test_a_chain_of_loops_hangs_from_the_ground(windows):
    """Verticals on their ground pivots, horizontals on verticals: depth 2, where file order makes a chain of horizontals."""
    mechanism = load(f"n_four_bar_{windows}")
    assert max(depths(spanning_tree(mechanism, least_depth=True)).values()) == 2
    assert max(depths(spanning_tree(mechanism)).values()) == windows + 1
