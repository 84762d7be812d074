"""Stabilisations that keep a trajectory on its constraints: none, Baumgarte's terms, or projection after each step.

Baumgarte replaces phi'' = 0 by phi'' + 2 alpha phi' + beta^2 phi = 0, so that gamma loses 2 alpha phi' + beta^2 phi. With
alpha = beta the error decays critically. Source: Baumgarte, Stabilization of constraints and integrals of motion in dynamical
systems, Comput. Methods Appl. Mech. Eng. 1 (1972), eq. (12). Projection of positions and velocities is in `evaluate.py`.
"""

from dataclasses import replace

from gauss_bench.terms import Terms

STABILIZATIONS = ("none", "baumgarte", "projection")
BAUMGARTE_RATE = 20.0  # [1/s] alpha = beta: twice the decay of a 10 rad/s linkage, and stable under RK4 up to h = 0.1 s


def baumgarte(terms: Terms, alpha: float = BAUMGARTE_RATE, beta: float = BAUMGARTE_RATE) -> Terms:
    """The same terms with the stabilised acceleration bias."""
    return replace(terms, gamma=terms.gamma - 2 * alpha * terms.phi_dot - beta**2 * terms.phi)
