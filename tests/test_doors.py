"""Outputs of the command: closed and full streams, characters that a stream lacks, and files that must not be replaced."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gauss_bench.api.files import FileRefused, check_files, is_of_kind, writable
from gauss_bench.cli import main

ROOT = Path(__file__).parents[1]
FOUR_BAR = ROOT / "mechanisms" / "four_bar.toml"
FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")


def run_apart(arguments, **given):
    """Run the command in a process of its own."""
    command = [sys.executable, "-m", "gauss_bench", *arguments]
    return subprocess.run(command, text=True, timeout=120, check=False, **{"stderr": subprocess.PIPE} | given)


@pytest.mark.long("kinematics")
@needs_full
@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["show", "four_bar"], ["kinematics", "four_bar", "--json"], ["--help"]], ids=lambda x: x[0])
def test_a_full_or_closed_output_is_74_and_a_sentence(arguments):
    with FULL.open("w") as full:
        ended = run_apart(arguments, stdout=full)
    assert ended.returncode == 74
    assert "error: stdout: No space left on device: results are lost" in ended.stderr
    assert "Traceback" not in ended.stderr
    closed = run_apart(arguments, preexec_fn=lambda: os.close(1))
    assert closed.returncode == 74
    assert "error: stdout is closed" in closed.stderr
    assert "Traceback" not in closed.stderr


@needs_full
@pytest.mark.slow
@pytest.mark.parametrize(("arguments", "code"), [(["show", "nosuch"], 2), (["--nosuch"], 2), (["list"], 0)], ids=str)
def test_a_full_stderr_leaves_the_exit_code_of_the_verb(arguments, code):
    with FULL.open("w") as full:
        assert run_apart(arguments, stdout=subprocess.DEVNULL, stderr=full).returncode == code


def test_help_and_pages_list_every_exit_code(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    texts = [capsys.readouterr().out.partition("Exit codes:")[2]]
    texts += [(ROOT / page).read_text(encoding="utf-8") for page in ("README.md", "gauss_bench/docs/pages/commands.md")]
    for text in texts:
        words = " ".join(text.split())
        assert all(x in words for x in ("0 done", "1 an accuracy regression", "2 bad usage", "70 a fault", "74 stdout", "130 in"))


@pytest.mark.parametrize("kilobytes", [250_000, pytest.param(300_000, marks=pytest.mark.long), 400_000])
def test_too_little_memory_is_told_before_any_library_looks_for_it(kilobytes):
    """With some limits the import of a library never ends."""
    code = f"import resource as r, sys; r.setrlimit(r.RLIMIT_AS, ({kilobytes << 10},) * 2); "
    code += "from gauss_bench.cli import main; code = main(['simulate', 'four_bar', '--engine', 'mujoco', '--at', '0.1']); "
    code += "assert 'numpy' not in sys.modules; sys.exit(code)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"error: `ulimit -v` leaves {kilobytes} kB of memory")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.slow
def test_a_reader_that_leaves_is_74_too():
    command = [sys.executable, "-m", "gauss_bench", "kinematics", "four_bar", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert process.stderr
        process.stdout.close()
        told = process.stderr.read()
        assert process.wait(120) == 74
    assert "Traceback" not in told


@pytest.mark.slow
def test_a_title_beyond_the_outputs_characters_is_escaped(tmp_path):
    file = tmp_path / "four_bar.toml"
    lines = FOUR_BAR.read_text(encoding="utf-8").splitlines()
    file.write_text("\n".join('title = "Kurbel \u00e4 \u2192"' if x.startswith("title") else x for x in lines), encoding="utf-8")
    ended = run_apart(["show", str(file)], stdout=subprocess.PIPE, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert ended.returncode == 0
    assert "Kurbel \\xe4 \\u2192" in ended.stdout


def test_a_time_that_is_none_is_bad_input(monkeypatch, capsys):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1" * 5000)
    assert main(["list"]) == 2
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "abc")
    assert main(["list"]) == 2
    assert "SOURCE_DATE_EPOCH='abc' in the environment: it must be a whole number of seconds" in capsys.readouterr().err


LINKAGE = FOUR_BAR.read_bytes()
CALLS = [
    ["simulate", "--at", "0,0.01", "--out", "x.csv"],
    ["simulate", "--at", "0,0.01", "--plot", "x.png"],
    ["kinematics", "--out", "x.csv"],
    ["show", "--svg", "x.svg"],
    ["export", "--engine", "c", "--out", "x.c"],
    ["certify", "--until", "0.01", "--out", "x.npz"],
]


@pytest.mark.parametrize("call", CALLS, ids=lambda x: f"{x[0]} {x[-1]}")
def test_no_verb_writes_over_what_it_reads_over_another_kind_of_file_or_over_a_link(call, tmp_path, monkeypatch, capsys):
    """The file is a link to the linkage that is read, another linkage with the ending of the kind, or a link to nothing."""
    monkeypatch.chdir(tmp_path)
    source, file = Path("four_bar.toml"), Path(call[-1])
    source.write_bytes(LINKAGE)
    held = {"four_bar.toml": "is the input", "": f"and no {file.suffix} file", "gone": "--replace overwrites it"}
    for target, words in held.items():
        if target:
            file.symlink_to(target)
        else:
            file.write_bytes(LINKAGE)
        if call[0] != "certify" or target != "gone":  # certificates are replaced without being asked
            replace = ["--replace"] if call[0] != "certify" and target != "gone" else []
            assert main([call[0], str(source), *call[1:], *replace]) == 2
            assert words in capsys.readouterr().err
        assert source.read_bytes() == LINKAGE
        assert file.is_symlink() if target else file.read_bytes() == LINKAGE
        file.unlink()


INTO_FOLDERS = [
    ["run", "four_bar", "--suite", "gate", "--no-costs", "--out", "run"],
    ["sweep", "crank_slider", "--vary", "links.rod.mass=0.7:0.8:2", "--engine", "gauss", "--out", "sweep"],
    ["atlas", "--out", "atlas"],
]


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder into which not even root may write")
@pytest.mark.parametrize("call", [*([x[0], "four_bar", *x[1:]] for x in CALLS), *INTO_FOLDERS], ids=lambda x: f"{x[0]} {x[-1]}")
def test_a_folder_that_takes_no_file_is_refused_before_the_work(call, capsys):
    assert main([*call[:-1], f"/proc/{call[-1]}"]) == 2
    said = capsys.readouterr().err
    reason = "No such file or directory" if call[0] == "sweep" else "nothing may be written into the folder /proc"
    assert f"/proc/{call[-1]}: {reason}" in said
    assert " steps up to " not in said, "it was found out after the work"


def test_one_file_under_two_paths_is_named_twice(tmp_path):
    (tmp_path / "folder").mkdir()
    asked = {"plot": tmp_path / "x.svg", "animate": tmp_path / "folder" / ".." / "x.svg"}
    with pytest.raises(FileRefused, match="is named twice"):
        check_files(asked, dict.fromkeys(asked, (".svg",)), replace=False)


def test_a_file_of_its_own_kind_is_replaced_where_that_is_asked_for(tmp_path):
    old = tmp_path / "old.c"
    old.write_text("int x;", encoding="utf-8")
    assert writable(old, True, suffix=".c") == old
    with pytest.raises(FileRefused, match="--replace overwrites it"):
        writable(old, False, suffix=".c")


CONTENTS = [  # ending of a kind, and how its files begin; an empty file may be of any kind
    (".csv", b"t [s],x [m]\n0,1\n"),
    (".svg", b'<?xml version="1.0"?>\n<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN">\n<svg/>\n'),
    (".svg", b'\n<?xml version="1.0"?>\n<!-- by hand -->\n<svg>'),
    (".html", b"<!doctype html>\n<html><svg/></html>"),
    (".xml", b'<mujoco model="x"><!-- svg --></mujoco>'),
    (".png", b"\x89PNG\r\n"),
    (".gif", b"GIF89a"),
    (".npz", b"PK\x03\x04"),
    (".toml", LINKAGE),
    (".c", b"/* Model, of a linkage */\nint x[3];\n"),
    (".py", b'"""One linkage: python FILE, prints t."""\nx = [1]\n'),
    ("", b""),
]


def test_the_first_bytes_of_a_file_tell_its_kind(tmp_path):
    for kind, first in CONTENTS:
        (tmp_path / "x").write_bytes(first)
        fits_all = kind in (".c", ".py", "")  # programs begin in any way, so their ending tells
        assert all(is_of_kind(tmp_path / "x", suffix) == (kind == suffix or fits_all) for suffix, _ in CONTENTS), first


ATLAS = ["atlas", "--engine", "lagrange", "--axis", "size", "--budget", "1e-9"]
SWEEP = ["sweep", "crank_slider", "--vary", "links.rod.mass=0.7:0.8:2", "--engine", "gauss", "--until", "0.01"]
TAKEN = [(call, x) for x in ("README.md", "site/index.html") for call in (["run", "four_bar", "--report"], ["report"])]
TAKEN += [(ATLAS, x) for x in ("index.html", "atlas.svg", "atlas.csv")]


@pytest.mark.parametrize(("call", "name"), TAKEN, ids=lambda x: x if isinstance(x, str) else x[0])
def test_no_verb_takes_the_place_of_a_page_or_picture_of_the_users(call, name, tmp_path, capsys):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("my own words", encoding="utf-8")
    (tmp_path / "site.css").write_text("", encoding="utf-8")
    assert main([*call, "--out", str(tmp_path)]) == 2
    assert f"{tmp_path / name}: is there already, and gauss-bench did not write it" in capsys.readouterr().err
    assert (tmp_path / name).read_text(encoding="utf-8") == "my own words"
    assert {x.name for x in tmp_path.glob("*.*")} == {"site.css", *([] if "/" in name else [name])}


def test_an_atlas_takes_the_place_of_an_earlier_one(tmp_path):
    for _ in range(2):
        assert main([*ATLAS, "--out", str(tmp_path)]) == 0


@pytest.mark.long
def test_no_sweep_takes_the_place_of_a_picture_of_the_users(tmp_path, capsys):
    picture, call = tmp_path / "s" / "summary.svg", [*SWEEP, "--out", str(tmp_path / "s")]
    assert main(call) == 0
    picture.write_text("<svg>mine</svg>", encoding="utf-8")
    assert main(call) == 2
    assert f"{picture}: is there already" in capsys.readouterr().err
    assert picture.read_text(encoding="utf-8") == "<svg>mine</svg>"
