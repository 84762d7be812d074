"""Every linkage keeps its equations of motion: terms and accelerations at stored states, on and off the constraints."""

from dataclasses import replace

import numpy as np
import pytest

from tests.kept.physics import TERMS, cases, load_case, read, terms_at

KEPT = read()
SAME = 1e-12  # of the largest of a term's numbers over all states: sums in another order move the last digits
ROUNDING = 1e-13  # of the largest acceleration, times the condition of the weighted rows


def condition(M, J):
    """Return the condition of J M^(-1/2) over the singular values that count, which multiplies rounding in the accelerations."""
    sizes = np.linalg.svd(J / np.sqrt(np.diag(M)), compute_uv=False)
    counted = sizes[sizes > 1e-9 * sizes.max(initial=0.0)]
    return counted.max(initial=1.0) / counted.min(initial=1.0)


def test_every_linkage_and_scenario_is_stored():
    assert set(cases()) == KEPT.keys()


@pytest.mark.parametrize("case", KEPT)
def test_terms_and_accelerations_stay(case):
    kept = KEPT[case]
    found = terms_at(load_case(case), kept["t"], kept["q"], kept["v"])
    for name in TERMS:
        scale = np.abs(kept[name]).max(initial=0.0)
        assert np.abs(found[name] - kept[name]).max(initial=0.0) <= SAME * scale, name
    known = np.isfinite(kept["a"]).all(axis=1)
    for k in np.flatnonzero(known):
        allowed = ROUNDING * condition(kept["M"][0], kept["J"][k]) * np.abs(kept["a"][k]).max()
        assert np.abs(found["a"][k] - kept["a"][k]).max() <= allowed, k
    assert (np.isnan(found["a"]).any(axis=1) == ~known).all()  # where no formulation has an answer, it says so still


def test_one_changed_mass_is_seen():
    case = "mechanisms/four_bar/torque"
    mechanism, kept = load_case(case), KEPT[case]
    largest = int(np.argmax([link.mass for link in mechanism.links]))
    links = tuple(replace(x, mass=x.mass * (1 + 1e-9)) if k == largest else x for k, x in enumerate(mechanism.links))
    found = terms_at(replace(mechanism, links=links), kept["t"][:1], kept["q"][:1], kept["v"][:1])
    assert np.abs(found["M"] - kept["M"]).max() > SAME * np.abs(kept["M"]).max()
