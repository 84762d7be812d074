"""The spanning tree maps states and forces to and from absolute coordinates without loss."""

import numpy as np

from gauss_bench.mechanism.model import GROUND, Mechanism, Revolute
from gauss_bench.mechanism.tree import spanning_tree


def test_states_go_there_and_back(any_mechanism: Mechanism, rng: np.random.Generator) -> None:
    tree = spanning_tree(any_mechanism)
    y, dy = rng.normal(size=(5, tree.n)), rng.normal(size=(5, tree.n))
    q, v, _ = tree.absolute(y, dy, 0 * y)
    for found, expected in zip(tree.relative(q, v), (y, dy), strict=True):
        assert np.abs(found - expected).max() < 1e-13


def test_the_start_lies_in_the_tree(any_mechanism: Mechanism) -> None:
    tree = spanning_tree(any_mechanism)
    y, dy = tree.relative(any_mechanism.q0, any_mechanism.v0)
    q, v, _ = tree.absolute(y, dy, 0 * y)
    assert np.abs(q - any_mechanism.q0).max() < 1e-14
    assert np.abs(v - any_mechanism.v0).max() < 1e-13


def test_rates_are_the_derivatives_of_positions(any_mechanism: Mechanism, rng: np.random.Generator) -> None:
    tree = spanning_tree(any_mechanism)
    y, dy, ddy = rng.normal(size=(3, tree.n))
    h = 1e-5
    ahead, behind = (tree.absolute(y + s * dy + h * h / 2 * ddy, dy + s * ddy, ddy) for s in (h, -h))
    _, v, a = tree.absolute(y, dy, ddy)
    assert np.abs((ahead[0] - behind[0]) / (2 * h) - v).max() < 1e-8  # differences of the second order at h = 1e-5
    assert np.abs((ahead[1] - behind[1]) / (2 * h) - a).max() < 1e-8


def test_forces_do_the_same_virtual_work(any_mechanism: Mechanism, rng: np.random.Generator) -> None:
    tree = spanning_tree(any_mechanism)
    y, dy = rng.normal(size=(5, tree.n)), rng.normal(size=(5, tree.n))
    q, v, _ = tree.absolute(y, dy, 0 * y)
    Q = rng.normal(size=v.shape)
    assert np.abs((Q * v).sum(-1) - (tree.forces(q, Q) * dy).sum(-1)).max() < 1e-12


def test_parents_come_first_slides_are_in_the_tree_and_every_joint_is_used_once(any_mechanism: Mechanism) -> None:
    tree = spanning_tree(any_mechanism)
    seen = {GROUND}
    for branch in tree.branches:
        assert branch.parent in seen
        seen.add(branch.link)
    assert len(seen) == len(any_mechanism.links) + 1
    assert all(isinstance(joint, Revolute) for joint in tree.closures)
    used = [b.joint for b in tree.branches if b.joint] + list(tree.closures)
    assert len(used) == len(any_mechanism.joints)
    assert {id(j) for j in used} == {id(j) for j in any_mechanism.joints}
