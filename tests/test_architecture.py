"""The arrows between rooms: who may import whom, and that no arrow closes a circle."""

import ast
import inspect
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from gauss_bench.engines import OWN
from gauss_bench.linkage.schema import CONSTRAINTS, FORCES

PACKAGE = Path(__file__).parents[1] / "gauss_bench"
LIGHT = "atomic terms trajectory untrusted"
ALLOWED = {  # room -> those that it may import
    "terms": "",
    "atomic": "",
    "trajectory": "",
    "checksums": "untrusted",
    "tables": "atomic checksums untrusted",
    "untrusted": "",
    "suites": "untrusted",
    "reach": "trajectory",
    "mechanism": LIGHT,
    "linkage": f"mechanism {LIGHT}",
    "formulations": "terms",
    "integrate": "terms",
    "engines": f"compiler formulations gauss_bench integrate mechanism {LIGHT}",
    "compiler": f"integrate kinematics linkage mechanism {LIGHT}",
    "kinematics": f"linkage mechanism {LIGHT}",
    "reference": f"linkage mechanism {LIGHT}",
    "metrics": f"mechanism {LIGHT}",
    "judge": f"mechanism metrics {LIGHT}",
    "papers": f"formulations kinematics linkage mechanism reference {LIGHT}",
    "runs": f"engines integrate judge linkage mechanism metrics {LIGHT}",
    "bench": "checksums compiler engines formulations integrate judge kinematics linkage "
    f"mechanism metrics papers reach reference runs suites tables {LIGHT}",
    "advice": f"bench engines integrate linkage mechanism metrics reach reference runs {LIGHT}",
    "diagnosis": f"bench engines formulations integrate judge linkage mechanism metrics reference runs tables {LIGHT}",
    "report": f"checksums linkage mechanism reach reference tables {LIGHT}",
    "docs": f"api engines formulations integrate linkage mechanism verbs {LIGHT}",
    "releases": f"bench engines linkage mechanism metrics reference runs tables {LIGHT}",
    "exchange": f"compiler engines gauss_bench linkage mechanism {LIGHT}",
    "atlas": f"engines exchange judge linkage mechanism report runs {LIGHT}",
    "sweep": f"bench compiler engines judge linkage mechanism metrics report runs tables {LIGHT}",
    "studio": "advice api engines exchange gauss_bench integrate judge "
    f"kinematics linkage mechanism metrics reference report runs tables {LIGHT}",
    "api": "advice bench compiler diagnosis engines exchange gauss_bench integrate "
    f"judge kinematics linkage mechanism metrics reach reference runs tables {LIGHT}",
    "verbs": "advice api atlas bench diagnosis engines exchange linkage mechanism reference releases report runs studio suites "
    f"sweep tables {LIGHT}",
    "cli": "api untrusted",
    "__init__": "",
    "__main__": "cli",
}
FOREIGN = {
    "pinocchio": "engines/pinocchio/",
    "exudyn": "engines/exudyn/adapter.py",
    "mujoco": ("engines/mujoco/", "engines/mjcf/", "engines/mjx/"),  # MJX reads and writes the library's models
    "jax": "engines/mjx/",
    "opensim": "engines/opensim/",
    "dartpy": "engines/dart/",
    "pydrake": "engines/drake/",
    "pybullet": "engines/bullet/",
    "newton": "engines/newton/",
    "warp": "engines/newton/",
    "heyoka": "reference/taylor/",
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


@cache
def imports(path):
    """Dotted names that a file imports, as modules or from them."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def room(name):
    parts = name.split(".")
    return "gauss_bench" if len(parts) == 1 or parts[1] == "__version__" else parts[1]


def room_of(path):
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


FILES = sorted(PACKAGE.rglob("*.py"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_file_imports_only_what_its_room_may(path):
    own = room_of(path)
    for name in imports(path):
        top = name.split(".")[0]
        if top == "gauss_bench":
            assert room(name) in {*ALLOWED[own].split(), own}, f"{own} must not import {name}"
        elif top in FOREIGN:
            assert str(path.relative_to(PACKAGE)).startswith(FOREIGN[top]), f"{name} belongs to its adapter alone"
        elif own in OUTSIDE and top not in sys.stdlib_module_names:
            assert top in OUTSIDE[own], f"{own} must not import {name}"


ENGINES = PACKAGE / "engines"
SHARED = "mjcf"  # the room of a format, which several engines take
ROOMS = {p.name for p in ENGINES.iterdir() if (p / "__init__.py").is_file()} - {SHARED}


@pytest.mark.parametrize("path", sorted(ENGINES.rglob("*.py")), ids=lambda p: str(p.relative_to(ENGINES)))
def test_no_engine_reaches_into_the_room_of_another(path):
    """Both `from gauss_bench.engines import NAME` and imports from inside that room count."""
    rooms = {x for x in ROOMS if any(f"{name}.".startswith(f"gauss_bench.engines.{x}.") for name in imports(path))}
    assert rooms <= {path.parent.name}


def test_rooms_form_no_circle():
    arrows = {
        own: {room(n) for p in FILES if room_of(p) == own for n in imports(p) if n.startswith("gauss_bench")} for own in ALLOWED
    }
    assert_no_circle({own: to - {own, "gauss_bench"} for own, to in arrows.items()})


def assert_no_circle(arrows):
    done = set()
    while len(done) < len(arrows):
        free = {own for own, to in arrows.items() if own not in done and to <= done}
        assert free, f"a circle among {sorted(arrows.keys() - done)}"
        done |= free


def file_arrows():
    """File -> files that it imports when it is loaded, as dotted names."""
    files = {".".join(p.relative_to(PACKAGE.parent).with_suffix("").parts): p for p in FILES}
    files = {name.removesuffix(".__init__"): path for name, path in files.items()}
    arrows = {}
    for own, path in files.items():
        found = [x for x in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(x, ast.ImportFrom) and x.module]
        named = {(f"{x.module}.{alias.name}", x.module or "") for x in found for alias in x.names}
        arrows[own] = {file if file in files else module for file, module in named} & files.keys()
    return arrows


def test_files_form_no_circle():
    assert_no_circle(file_arrows())


def test_rooms_of_the_compiler_form_a_chain():
    """Each room imports from rooms before it alone, at most four times past its neighbour; `kernel.py` and others stand above."""
    compiler = PACKAGE / "compiler"
    chain = ("expressions", "equations", "elimination", "machine", "stepping", "turns")
    assert {p.name for p in compiler.iterdir() if p.is_dir() and p.name != "__pycache__"} == set(chain)

    def room(file):
        """Name of the compiler's room (or of its file outside the rooms) in which a file is; empty for files elsewhere."""
        return file.removeprefix("gauss_bench.compiler.").split(".")[0] if file.startswith("gauss_bench.compiler.") else ""

    between = {(room(a), room(b)) for a, to in file_arrows().items() for b in to if room(a) and room(b)}
    steps = [chain.index(a) - chain.index(b) for a, b in between if a in chain and b in chain and a != b]
    assert min(steps) > 0
    assert sum(step > 1 for step in steps) <= 4
    assert {b for a, b in between if a in chain and b not in chain} <= {"errors", "user_cache"}
    for name in chain:
        assert (compiler / name / "README.md").is_file()
        assert len(list((compiler / name).glob("*.py"))) <= 12


SOLVERS = {"lstsq", "solve", "pinv", "inv", "svd", "lu_solve", "cho_solve", "minimum_norm"}
MAY_ITERATE = {  # a file, or a room that ends with a stroke, and why its iterations are not those of `mechanism/close.py`
    "compiler/elimination/partition.py": "a second pass reduces rounding errors",
    "compiler/elimination/rank.py": "a second pass reduces rounding errors",
    "compiler/equations/sampling.py": "a second pass reduces rounding errors",
    "integrate/fixed_step.py": "the stages of an implicit step",
    "kinematics/root_finding.py": "methods that are compared with each other",
    "reference/": "derived again on purpose",
}


def calls(node):
    """Return the names of all functions and methods that a node calls."""
    called = [x.func for x in ast.walk(node) if isinstance(x, ast.Call)]
    return {getattr(x, "attr", getattr(x, "id", "")) for x in called}


def names(*nodes):
    """Return the names of all variables in some nodes."""
    return {x.id for node in nodes for x in ast.walk(node) if isinstance(x, ast.Name)}


def terms_added(node):
    """Yield each d of a statement x = x + d, x = x - d, x += d or x -= d; not if x is one entry of an array."""
    if isinstance(node, ast.AugAssign) and isinstance(getattr(node.target, "slice", ast.Slice()), ast.Slice):
        yield node.value
    elif isinstance(node, ast.Assign):
        sums = [x for x in ast.walk(node.value) if isinstance(x, ast.BinOp) and isinstance(x.op, (ast.Add, ast.Sub))]
        yield from (x.right for x in sums if isinstance(x.left, ast.Name) and x.left.id in names(*node.targets))


def iterates(source):
    """Tell whether a loop adds solutions of linear equations to a variable, directly or by a function of the same file.

    Solvers that are passed as arguments or imported under another name are not seen.
    """
    if not any(f"{x}(" in source for x in SOLVERS):  # most files
        return False
    tree = ast.parse(source)
    solvers = SOLVERS | {x.name for x in ast.walk(tree) if isinstance(x, ast.FunctionDef) and calls(x) & SOLVERS}
    for loop in ast.walk(tree):
        if isinstance(loop, (ast.For, ast.While)):
            solved = [x for x in ast.walk(loop) if isinstance(x, ast.Assign) and calls(x.value) & solvers]
            solutions = names(*(target for x in solved for target in x.targets))
            added = [x for node in ast.walk(loop) for x in terms_added(node)]
            if any(calls(x) & solvers or names(x) & solutions for x in added):
                return True
    return False


def test_linkages_are_closed_by_one_iteration():
    found = {str(path.relative_to(PACKAGE)) for path in FILES if iterates(path.read_text(encoding="utf-8"))}
    places = {next((x for x in MAY_ITERATE if file.startswith(x)), file) for file in found}
    assert places == MAY_ITERATE.keys()


@pytest.mark.parametrize(
    ("source", "is_newton"),
    [
        ("while bad:\n    y += np.linalg.lstsq(J, -F)[0]", True),
        ("def turn(J, F):\n    return pinv(J) @ F\nfor _ in range(9):\n    old, q = q, q - turn(J(q), F(q))", True),
        ("for k in range(9):\n    x[k] = solve(J[k], F[k])\n    k += 1", False),
        ("for x in rows:\n    y = solve(J, x)\n    total = total + x", False),
    ],
)
def test_an_iteration_is_recognised(source, is_newton):
    assert iterates(source) is is_newton


def modules_after(statement):
    code = f"import sys; {statement}; print(*sys.modules, file=sys.stderr)"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stderr.split())


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("import gauss_bench", {"numpy", "pandas", "scipy", *FOREIGN}),
        (
            "import gauss_bench.__main__, gauss_bench.cli as c; c.parser(c.ACTIONS).format_help()",
            {"numpy", "scipy", "pandas", "pyarrow", "matplotlib", "jinja2", *FOREIGN},
        ),
        ("import gauss_bench.metrics", {"pandas", "scipy", *FOREIGN}),
        ("import gauss_bench.engines as e; [e.get(n) for n in e.names()]", set(FOREIGN)),
        ("import gauss_bench.report.build", set(FOREIGN)),
    ],
)
def test_importing_pulls_in_nothing_heavy(statement, absent):
    assert not modules_after(statement) & absent


CERTIFIED = ("four_bar --at 0,0.01", "six_bar --at 0,0.01", "excavator --at 0,0.01")
FAILING = ("four_bar --step 0.05 --at 0,0.5", "four_bar --step 0.1 --at 0,1", "parallelogram --step 0.01 --at 0,2")


@pytest.mark.parametrize("engine", OWN)
def test_a_run_of_an_own_formulation_loads_forty_modules_at_most(engine):
    """Packages' own files are not counted; none of the others imports a room in a function, where it would not be seen.

    One of the forty is the formulation of the run. The judge compares every run with `gauss`, and a run without a reference with
    `lagrange` too; these are not counted if the run is by another formulation. Files of single kinds of forces and constraints are
    not counted either.
    """
    code = "import sys; from gauss_bench.cli import main\n"
    for runs in (CERTIFIED, FAILING):
        code += "".join(f"code = main('simulate {run} --engine {engine}'.split())\n" for run in runs)
        code += "print('loaded', code, *sys.modules)\n"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.splitlines()
    (good_code, *_), (failed_code, *_) = named = [line.split()[1:] for line in printed if line.startswith("loaded ")]
    assert (good_code, failed_code) == ("0", "1")  # of the last run of each group
    loaded = [{PACKAGE.parent / f"{name.replace('.', '/')}.py" for name in names} for names in named]
    good, failed = ([x for x in paths if x.is_file() and PACKAGE in x.parents] for paths in loaded)
    homes = {Path(inspect.getfile(x.read.__self__)) for x in (*FORCES.values(), *CONSTRAINTS.values())}
    apart = homes - {PACKAGE / "mechanism" / "model.py"}
    for paths in (good, failed):
        counted = [x.name for x in paths if x.parent.name != "formulations" and x not in apart]
        assert 30 < len(counted) <= 39, sorted(counted)
    for path in failed:
        functions = [x for x in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(x, ast.FunctionDef)]
        inside = [x.module or "" for f in functions for x in ast.walk(f) if isinstance(x, ast.ImportFrom)]
        assert not [x for x in inside if x.startswith("gauss_bench")], path


def test_pins_carry_hashes_and_no_address():
    pins = (PACKAGE.parent / "constraints.txt").read_text(encoding="utf-8")
    assert "://" not in pins
    assert "--index-url" not in pins
    names = [line for line in pins.splitlines() if line and line[0].isalpha()]
    assert len(names) > 30
    assert all("==" in line for line in names)
    assert pins.count("--hash=sha256:") >= len(names)
