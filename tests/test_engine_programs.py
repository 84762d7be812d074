"""Programs of engines that live in environments: recorded calls of their builders, run alone and judged by their own numbers."""

import ast
import builtins
import csv
import re
import subprocess
import sys

import numpy as np
import pytest

import gauss_bench
from gauss_bench.api.program_error import ProgramFailed, read_rows, run_python
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice, ask
from gauss_bench.engines.programs import coordinates, plan, rates
from gauss_bench.engines.transcript import Script, python
from gauss_bench.linkage.load import load
from gauss_bench.runs.programs import run_there
from gauss_bench.runs.worker import Interpreter
from gauss_bench.trajectory import RunFailure
from tests.conftest import needs

LIBRARIES = {"drake": {"pydrake"}, "bullet": {"pybullet"}, "dart": {"dartpy"}, "opensim": {"opensim"}, "mjx": {"jax", "mujoco"}}
LINKAGES = [("four_bar", "torque"), ("crank_slider", "paper"), ("parallelogram", "torque"), ("crank_slider", "driven")]


def write(engine, mechanism, settings="default", integrator="", tolerance=None):
    """The program of an engine that takes the linkage; Drake's, Bullet's, DART's and OpenSim's need no library to be written."""
    adapter = get(engine)
    choice = Choice(settings, integrator or adapter.integrators[0], tolerance=tolerance)
    assert adapter.skip(mechanism, choice) is None
    return str(ask(adapter, "program")(mechanism, choice))


@pytest.fixture
def adapters(engines):
    """The adapters by name, though no environment is installed."""
    engines.write_text("".join(f'[{name}]\npython = "{sys.executable}"\n' for name in LIBRARIES), encoding="utf-8")


def list_undefined(text):
    """Names that a program uses and does not have."""
    known, used = {*dir(builtins), "__name__"}, set[str]()
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Import(names) | ast.ImportFrom(names=names):
                known |= {(x.asname or x.name).partition(".")[0] for x in names}
            case ast.FunctionDef(name=name, args=arguments):
                known |= {name, *(x.arg for x in arguments.args)}
            case ast.Lambda(args=arguments):
                known |= {x.arg for x in arguments.args}
            case ast.Name(name, context):
                (known if isinstance(context, ast.Store) else used).add(name)
    return used - known


@pytest.mark.usefixtures("adapters")
@pytest.mark.parametrize("engine", LIBRARIES)
@pytest.mark.parametrize(("name", "scenario"), LINKAGES)
def test_a_program_has_all_that_it_names_and_needs_its_library_alone(engine, name, scenario):
    if engine == "mjx":
        needs("mujoco")
    mechanism = load(name, scenario)
    if get(engine).skip(mechanism, Choice()):
        pytest.skip("the engine does not take it")
    text = write(engine, mechanism)
    assert not list_undefined(text)
    packages = set(re.findall(r"^ *(?:import|from) (\w+)", text, re.MULTILINE))
    assert packages == {"math", "numpy", "sys", *LIBRARIES[engine]}
    for link in mechanism.links:
        assert repr(float(link.mass)) in text
    assert python(mechanism.q0.tolist()) in text


@pytest.mark.usefixtures("adapters")
def test_every_setting_of_drake_has_its_closure_and_integrator():
    mechanism = load("four_bar", "torque")
    assert "AddBallConstraint" in write("drake", mechanism)
    chosen = write("drake", mechanism, "bushing", "runge_kutta3_adaptive", tolerance=1e-7)
    for words in ("MultibodyPlant(0.0)", "LinearBushingRollPitchYaw", "set_fixed_step_mode(False)", "set_target_accuracy(1e-07)"):
        assert words in chosen
    assert not list_undefined(chosen)


@pytest.mark.usefixtures("adapters")
def test_what_no_program_holds_is_refused_with_the_reason():
    for engine, name, settings, words in (
        ("bullet", "four_bar", "coordinates=bodies", "every link is a free body"),
        ("bullet", "jansen", "default", "no forces at points or between points"),
        ("dart", "jansen", "default", "no forces at points or between points"),
    ):
        with pytest.raises(RunFailure, match=words):
            write(engine, load(name), settings)


def test_a_transcript_has_a_line_for_each_call_in_the_order_of_the_calls():
    script = Script({"Add": "item_", "System": "system"})
    library = script.stand_in("library")
    system = library.System()
    first = system.Add(library.Body(mass=0.1, name='a"b'))
    second = system.Add(library.Body(place=np.array([1.0, -0.0])))
    system.options[0].solver = library.Kind.FAST
    system.Connect(1.0 / first.rate, [second * 2 + first, library.FixedFrame(3)])
    assert script.lines == [
        "system = library.System()",
        "item_1 = system.Add(library.Body(mass=0.1, name='a\"b'))",
        "item_2 = system.Add(library.Body(place=np.array([1.0, -0.0])))",
        "system.options[0].solver = library.Kind.FAST",
        "system.Connect(1.0 / item_1.rate, [item_2 * 2 + item_1, library.FixedFrame(3)])",
    ]
    with pytest.raises(TypeError, match="function"):
        system.Add(lambda: 0)


def test_rows_are_at_most_a_hundred_and_no_step_is_longer_than_asked():
    assert plan(1.0, 0.25) == (4, 1)
    assert plan(1.0, 0.3) == (4, 1)
    assert plan(1.0, 1e-3) == (1000, 10)
    assert plan(1.0, 1 / 1001) == (1001, 11)


# How a program is run


def table(mechanism):
    """Return a program that prints a library's greeting, then a heading and two rows: zeros, and all coordinates at 2."""
    heading = ",".join(["t", *coordinates(mechanism), *rates(mechanism)])
    n = 2 * mechanism.n
    return f"print('library 1.0')\nprint({heading!r})\nprint(0.0, *[0.0] * {n}, sep=',')\nprint(1.0, *[2.0] * {n}, sep=',')\n"


def test_the_table_of_a_program_is_read_below_what_its_library_prints():
    mechanism = load("four_bar", "torque")
    rows, why = run_python(table(mechanism), mechanism, Interpreter(), 60.0)
    assert why == ""
    assert rows.t.tolist() == [0.0, 1.0]
    assert rows.q.tolist() == rows.v.tolist() == [[0.0] * mechanism.n, [2.0] * mechanism.n]


def test_a_program_sees_no_package_but_those_of_its_interpreter(tmp_path, monkeypatch):
    (tmp_path / "neighbour.py").write_text("", encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert "No module named 'neighbour'" in run_there("import neighbour\n", 60.0)["failed"]


ENDS = {"raise ValueError('no such joint')": "no such joint", "exit(3)": "code 3", "import time; time.sleep(60)": "longer than 4 s"}


@pytest.mark.parametrize(("program", "words"), ENDS.items())
def test_a_program_that_does_not_end_well_says_why(program, words):
    with pytest.raises(ProgramFailed, match=words):
        run_python(program, load("four_bar", "torque"), Interpreter(), 5.0)


@pytest.mark.parametrize("rows", [["0,1,nan"], [], ["0,1,x"], ["0,1"]])
def test_numbers_that_are_none_or_not_finite_are_no_motion(rows):
    with pytest.raises(ProgramFailed, match=r"not finite|no numbers"):
        read_rows(rows, 1)


# In the environments


EULER = "semi_implicit_euler"
RUNS = [  # runs with chosen steps end where the program's rows end, so that their steps differ
    ("drake", "four_bar", "torque", Choice("default", "sap"), 1e-9),
    ("drake", "squeezer", "squeeze", Choice("bushing", "runge_kutta3_adaptive", tolerance=1e-6), 1e-4),
    ("bullet", "four_bar", "cycloid", Choice("direct/0.2", EULER), 1e-9),
    ("dart", "four_bar", "cycloid", Choice("explicit", EULER), 1e-9),
    ("opensim", "squeezer", "squeeze", Choice("tight", "rk_merson_adaptive", tolerance=1e-8), 1e-6),
    ("opensim", "crank_slider", "driven", Choice("default", "verlet"), 1e-9),
    ("mjx", "crank_slider", "driven", Choice("default", "rk4"), 1e-6),
]


@pytest.mark.slow
@pytest.mark.parametrize(("engine", "name", "scenario", "choice", "tolerance"), RUNS)
def test_a_program_moves_as_the_engines_run(engine, name, scenario, choice, tolerance, elsewhere, tmp_path):
    """The program runs in the engine's environment, which has no gauss_bench."""
    mechanism, file = load(name, scenario), tmp_path / "linkage.py"
    file.write_text(ask(get(engine), "program")(mechanism, choice), encoding="utf-8")
    done = subprocess.run([elsewhere, "-I", str(file), "0.1"], capture_output=True, text=True, check=True, cwd=tmp_path)
    last = [line for line in csv.reader(done.stdout.splitlines()) if len(line) > 1][-1]  # libraries print among the rows
    asked = {"settings": choice.settings, "integrator": choice.integrator, "tolerance": choice.tolerance}
    run = gauss_bench.simulate(name, engine, scenario, at=[0.0, 0.1], **asked)
    wanted = [run.links[link.name][key][-1] for link in mechanism.links for key in ("x", "y", "theta")]
    assert float(last[0]) == pytest.approx(0.1)
    np.testing.assert_allclose([float(x) for x in last[1 : 1 + mechanism.n]], wanted, rtol=0, atol=tolerance)
