"""Answers of two releases of MuJoCo that are neither installed nor asked."""

import numpy as np
import pytest

from gauss_bench.releases.asking import MOVING, Answers
from gauss_bench.releases.compare import Figure
from gauss_bench.releases.environments import CHECKED, Release
from gauss_bench.releases.library import Library
from gauss_bench.verbs import releases as verb


def answer(library: Library, release: Release, budget: float, told: object) -> Answers:
    """Return answers whose accelerations are twice as large before 3.7."""
    values = np.ones((1, 3)) * (2.0 if release.version == "3.6.0" else 1.0)
    moving = Figure(
        MOVING, "wide_four_bar", "default rk4", values=values, shifted=values[None] * (1 + 1e-15), error=values[0, 0] - 1
    )
    default = Figure("default", "", "option tolerance", text="1e-08" if release.version == "3.6.0" else "1e-06")
    return Answers(release.version, f"mujoco {release.version}", "3.11", "2.4", CHECKED, (moving, default))


def use_fake_releases(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the verb `releases` take these answers."""
    monkeypatch.setattr(
        verb, "install_release", lambda of, version, told: Release(of.engine, version, "/nowhere/bin/python", CHECKED)
    )
    monkeypatch.setattr(verb, "ask_release", answer)
