"""The rows of CONTRIBUTING.md as worked examples: each is done as it says, and what it promises holds."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.new_engine import ADAPTER, LIBRARY

ROOT = Path(__file__).parents[1]


def conformance(folder: Path, chosen: str, path: list[Path]) -> int:
    """How many conformance tests over all engines pass, in a process of its own; none may fail."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")}
    environment["PYTHONPATH"] = os.pathsep.join(map(str, path))
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "tests/test_engines.py", "-k", chosen]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment, check=False)
    assert done.returncode == 0, done.stdout[-3000:]
    assert "s" not in done.stdout.split()[0], "none is skipped"
    return done.stdout.split()[0].count(".")


def test_a_new_engine_is_a_room_and_a_line(tmp_path: Path) -> None:
    for name in ("gauss_bench", "tests", "mechanisms"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "library").mkdir()
    (tmp_path / "library" / "heuns.py").write_text(LIBRARY, encoding="utf-8")
    room = tmp_path / "gauss_bench" / "engines" / "heuns"
    room.mkdir()
    (room / "__init__.py").write_text('"""Heun\'s method."""\n', encoding="utf-8")
    (room / "adapter.py").write_text(ADAPTER.replace("NAME", "heuns"), encoding="utf-8")
    register = tmp_path / "gauss_bench" / "engines" / "__init__.py"
    line = '    "heuns": "gauss_bench.engines.heuns.adapter:heuns",\n'
    text = register.read_text(encoding="utf-8")
    register.write_text(text.replace("FOREIGN = {\n", "FOREIGN = {\n" + line, 1), encoding="utf-8")
    passed = conformance(tmp_path, "heuns", [tmp_path, tmp_path / "library"])
    assert passed >= 8  # states of four linkages, a linkage of others, what it skips, a missing library, a planted fault


def test_a_new_engine_in_a_package_of_its_own_is_an_entry_point(tmp_path: Path) -> None:
    (tmp_path / "outside_heuns.py").write_text(ADAPTER.replace("NAME", "heuns"), encoding="utf-8")
    (tmp_path / "heuns.py").write_text(LIBRARY, encoding="utf-8")
    info = tmp_path / "outside_heuns-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: outside-heuns\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text("[gauss_bench.engines]\nheuns = outside_heuns:heuns\n", encoding="utf-8")
    passed = conformance(ROOT, "heuns and same_state", [ROOT, tmp_path])
    assert passed >= 4  # the states of four linkages
