"""The arrows between rooms: who may import whom, and that no arrow closes a circle."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "gauss_bench"
LIGHT = {"terms", "trajectory", "untrusted"}
ALLOWED = {
    "terms": set(),
    "trajectory": set(),
    "tables": {"untrusted"},
    "untrusted": set(),
    "suites": {"untrusted"},
    "reach": {"trajectory"},
    "mechanism": LIGHT,
    "linkage": {"mechanism", *LIGHT},
    "formulations": {"terms"},
    "integrate": {"terms"},
    "engines": {"mechanism", "formulations", "integrate", "compiler", "gauss_bench", *LIGHT},
    "compiler": {"kinematics", "linkage", "mechanism", "integrate", *LIGHT},
    "kinematics": {"linkage", "mechanism", *LIGHT},
    "reference": {"linkage", "mechanism", *LIGHT},
    "metrics": {"mechanism", *LIGHT},
    "judge": {"mechanism", "metrics", *LIGHT},
    "papers": {"linkage", "mechanism", "formulations", "kinematics", "reference", *LIGHT},
    "runs": {"linkage", "mechanism", "engines", "integrate", "metrics", "judge", *LIGHT},
    "bench": {
        "runs",
        "linkage",
        "mechanism",
        "compiler",
        "kinematics",
        "papers",
        "engines",
        "formulations",
        "reference",
        "integrate",
        "judge",
        "metrics",
        "reach",
        "suites",
        "tables",
        *LIGHT,
    },
    "advice": {"reach", "linkage", "mechanism", "engines", "integrate", "reference", "metrics", "runs", "bench", *LIGHT},
    "diagnosis": {
        "linkage",
        "mechanism",
        "reference",
        "formulations",
        "integrate",
        "engines",
        "metrics",
        "judge",
        "runs",
        "bench",
        "tables",
        *LIGHT,
    },
    "report": {"reach", "linkage", "mechanism", "reference", "tables", *LIGHT},  # certificates, for the motion that is true
    "docs": {"api", "linkage", "mechanism", "engines", "formulations", "integrate", *LIGHT},  # and a template of an engine
    "exchange": {
        "linkage",
        "mechanism",
        "engines",
        "compiler",
        "gauss_bench",
        *LIGHT,
    },
    "atlas": {"linkage", "mechanism", "engines", "judge", "runs", "exchange", "report", *LIGHT},
    "sweep": {"linkage", "mechanism", "compiler", "engines", "judge", "metrics", "runs", "bench", "report", "tables", *LIGHT},
    "studio": {
        "advice",
        "api",
        "runs",
        "engines",
        "exchange",
        "integrate",
        "judge",
        "kinematics",
        "linkage",
        "mechanism",
        "metrics",
        "reference",
        "report",
        "tables",
        "gauss_bench",
        *LIGHT,
    },
    "api": {
        "advice",
        "linkage",
        "mechanism",
        "engines",
        "integrate",
        "compiler",
        "kinematics",
        "metrics",
        "judge",
        "runs",
        "bench",
        "diagnosis",
        "reference",
        "reach",
        "exchange",
        "tables",
        "gauss_bench",
        *LIGHT,
    },
    "verbs": {
        "advice",
        "linkage",
        "mechanism",
        "diagnosis",
        "engines",
        "exchange",
        "atlas",
        "runs",
        "bench",
        "reference",
        "report",
        "studio",
        "suites",
        "sweep",
        "tables",
        "api",
    },
    "cli": {"api", "untrusted"},
    "__init__": set(),
    "__main__": {"cli"},
}
FOREIGN = {
    "pinocchio": "engines/pinocchio/",
    "exudyn": "engines/exudyn/adapter.py",
    "mujoco": "engines/mujoco/",
    "heyoka": "reference/taylor/series.py",
    "mpmath": "reference/exact.py",
    "llvmlite": "compiler/machine/native_code.py",
    "casadi": "engines/casadi/",
    "joblib": "sweep/run.py",
    "distributed": "sweep/run.py",
    "starlette": "studio/server.py",
    "uvicorn": "studio/server.py",
    "websockets": "studio/server.py",
    "tomlkit": "studio/document.py",
}
OUTSIDE = {"formulations": {"numpy", "scipy"}, "integrate": {"numpy", "scipy"}, "terms": {"numpy"}, "trajectory": {"numpy"}}


def imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = {f"{node.module}.{alias.name}" for alias in node.names} if node.module == "gauss_bench" else {node.module}
            found |= names
    return found


def room(name: str) -> str:
    parts = name.split(".")
    return "gauss_bench" if len(parts) == 1 or parts[1] == "__version__" else parts[1]


def room_of(path: Path) -> str:
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


FILES = sorted(PACKAGE.rglob("*.py"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_file_imports_only_what_its_room_may(path: Path) -> None:
    own = room_of(path)
    for name in imports(path):
        top = name.split(".")[0]
        if top == "gauss_bench":
            assert room(name) in ALLOWED[own] | {own}, f"{own} must not import {name}"
        elif top in FOREIGN:
            assert str(path.relative_to(PACKAGE)).startswith(FOREIGN[top]), f"{name} belongs to its adapter alone"
        elif own in OUTSIDE and top not in sys.stdlib_module_names:
            assert top in OUTSIDE[own], f"{own} must not import {name}"


def test_rooms_form_no_circle() -> None:
    arrows = {
        own: {room(n) for p in FILES if room_of(p) == own for n in imports(p) if n.startswith("gauss_bench")} for own in ALLOWED
    }
    done: set[str] = set()
    while len(done) < len(arrows):
        free = {own for own, to in arrows.items() if own not in done and to - {own, "gauss_bench"} <= done}
        assert free, f"a circle among {sorted(arrows.keys() - done)}"
        done |= free


COMPILER = PACKAGE / "compiler"
CHAIN = ("expressions", "equations", "elimination", "machine", "stepping", "turns")


def compiler_arrows() -> dict[str, set[str]]:
    """File -> files of the compiler that it imports, as dotted names without the package's."""
    files = {".".join(p.relative_to(COMPILER).with_suffix("").parts): p for p in COMPILER.rglob("*.py")}
    prefix = "gauss_bench.compiler."
    arrows: dict[str, set[str]] = {}
    for own, path in files.items():
        arrows[own] = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and f"{node.module}.".startswith(prefix):
                module = f"{node.module}."[len(prefix) : -1]
                named = {f"{module}.{alias.name}".lstrip(".") for alias in node.names}
                arrows[own] |= (named & files.keys()) or {module}
    return arrows


def test_files_of_the_compiler_form_no_circle_and_few_arrows() -> None:
    arrows, done = compiler_arrows(), set[str]()
    assert sum(map(len, arrows.values())) < 100
    assert set().union(*arrows.values()) <= arrows.keys()
    while len(done) < len(arrows):
        free = {own for own, to in arrows.items() if own not in done and to <= done}
        assert free, f"a circle among {sorted(arrows.keys() - done)}"
        done |= free


def test_rooms_of_the_compiler_form_a_chain() -> None:
    """Each room knows rooms before it alone, at most four times past its neighbour; who puts them together stands above."""
    place = {name: k for k, name in enumerate(CHAIN)}
    assert {p.name for p in COMPILER.iterdir() if p.is_dir() and p.name != "__pycache__"} == set(CHAIN)
    between = {(a.split(".")[0], b.split(".")[0]) for a, to in compiler_arrows().items() for b in to}
    steps = [place[a] - place[b] for a, b in between if a in place and b in place and a != b]
    assert min(steps) > 0
    assert sum(step > 1 for step in steps) <= 4
    assert {b for a, b in between if a in place and b not in place} <= {"errors", "user_cache"}
    for name in CHAIN:
        assert (COMPILER / name / "README.md").is_file()
        assert len(list((COMPILER / name).glob("*.py"))) <= 12


def modules_after(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(*sys.modules)"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("import gauss_bench", {"numpy", "pandas", "scipy", *FOREIGN}),
        ("import gauss_bench.cli as c; c.parser(c.ACTIONS)", {"numpy", "pandas", "jinja2", *FOREIGN}),
        ("import gauss_bench.metrics", {"pandas", "scipy", *FOREIGN}),
        ("import gauss_bench.engines as e; [e.get(n) for n in e.names()]", set(FOREIGN)),
        ("import gauss_bench.report.build", set(FOREIGN)),
    ],
)
def test_importing_pulls_in_nothing_heavy(statement: str, absent: set[str]) -> None:
    assert not modules_after(statement) & absent


def test_pins_carry_hashes_and_no_address() -> None:
    pins = (PACKAGE.parent / "constraints.txt").read_text(encoding="utf-8")
    assert "://" not in pins
    assert "--index-url" not in pins
    names = [line for line in pins.splitlines() if line and line[0].isalpha()]
    assert len(names) > 30
    assert all("==" in line for line in names)
    assert pins.count("--hash=sha256:") >= len(names)
