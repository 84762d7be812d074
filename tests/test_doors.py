"""Outputs of the command: closed and full streams, characters that a stream lacks, and files that must not be replaced."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from gauss_bench.api.files import FileRefused, is_of_kind, writable
from gauss_bench.cli import main

ROOT = Path(__file__).parents[1]
FOUR_BAR = ROOT / "mechanisms" / "four_bar.toml"
FULL = Path("/dev/full")


def run_apart(arguments: list[str], **given: object) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    command = [sys.executable, "-m", "gauss_bench", *arguments]
    return subprocess.run(command, stderr=subprocess.PIPE, text=True, timeout=120, check=False, **given)  # type: ignore[call-overload]


@pytest.mark.long("kinematics")
@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["show", "four_bar"], ["kinematics", "four_bar", "--json"], ["--help"]], ids=lambda x: x[0])
def test_a_full_or_closed_output_is_74_and_a_sentence(arguments: list[str]) -> None:
    if not FULL.exists():
        pytest.skip("this system has no /dev/full")
    with FULL.open("w") as full:
        ended = run_apart(arguments, stdout=full)
    assert ended.returncode == 74
    assert "error: stdout: No space left on device: results are lost" in ended.stderr
    assert "Traceback" not in ended.stderr
    closed = run_apart(arguments, preexec_fn=lambda: os.close(1))
    assert closed.returncode == 74
    assert "error: stdout is closed" in closed.stderr
    assert "Traceback" not in closed.stderr


@pytest.mark.slow
@pytest.mark.parametrize(("arguments", "code"), [(["show", "nosuch"], 2), (["--nosuch"], 2), (["list"], 0)], ids=str)
def test_a_full_stderr_leaves_the_exit_code_of_the_verb(arguments: list[str], code: int) -> None:
    if not FULL.exists():
        pytest.skip("this system has no /dev/full")
    command = [sys.executable, "-m", "gauss_bench", *arguments]
    with FULL.open("w") as full:
        ended = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=full, timeout=120, check=False)
    assert ended.returncode == code


def test_help_and_pages_list_every_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    texts = [capsys.readouterr().out.partition("Exit codes:")[2]]
    texts += [(ROOT / page).read_text(encoding="utf-8") for page in ("README.md", "gauss_bench/docs/pages/commands.md")]
    for text in texts:
        words = " ".join(text.split())
        assert all(x in words for x in ("0 done", "1 an accuracy regression", "2 bad usage", "70 a fault", "74 stdout", "130 in"))


@pytest.mark.parametrize("kilobytes", [250_000, pytest.param(300_000, marks=pytest.mark.long), 400_000])
def test_too_little_memory_is_told_before_any_library_looks_for_it(kilobytes: int) -> None:
    """With some limits the import of a library never ends."""
    code = f"import resource as r, sys; r.setrlimit(r.RLIMIT_AS, ({kilobytes << 10},) * 2); "
    code += "from gauss_bench.cli import main; code = main(['simulate', 'four_bar', '--engine', 'mujoco', '--at', '0.1']); "
    code += "assert 'numpy' not in sys.modules; sys.exit(code)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"error: a limit leaves {kilobytes} kB of memory (`ulimit -v`)")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.slow
def test_a_reader_that_leaves_is_74_too() -> None:
    command = [sys.executable, "-m", "gauss_bench", "kinematics", "four_bar", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert process.stderr
        process.stdout.close()
        told = process.stderr.read()
        assert process.wait(120) == 74
    assert "Traceback" not in told


@pytest.mark.slow
def test_a_title_beyond_the_outputs_characters_is_escaped(tmp_path: Path) -> None:
    file = tmp_path / "four_bar.toml"
    lines = FOUR_BAR.read_text(encoding="utf-8").splitlines()
    file.write_text("\n".join('title = "Kurbel \u00e4 \u2192"' if x.startswith("title") else x for x in lines), encoding="utf-8")
    ended = run_apart(["show", str(file)], stdout=subprocess.PIPE, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert ended.returncode == 0
    assert "Kurbel \\xe4 \\u2192" in ended.stdout


def test_a_time_that_is_none_is_bad_input(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1" * 5000)
    assert main(["list"]) == 2
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "abc")
    assert main(["list"]) == 2
    assert "SOURCE_DATE_EPOCH='abc' in the environment: it must be a whole number of seconds" in capsys.readouterr().err


@pytest.mark.parametrize(
    "call",
    [["export", "--engine", "c"], ["certify", "--until", "0.01"]],
    ids=lambda x: x[0],
)
@pytest.mark.parametrize("spelling", ["itself", "a link to it", "another toml"])
def test_no_verb_writes_over_what_it_reads_or_over_another_kind_of_file(
    call: list[str], spelling: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    linkage, out = tmp_path / "four_bar.toml", tmp_path / "four_bar.toml"
    shutil.copy(FOUR_BAR, linkage)
    if spelling == "a link to it":
        out = tmp_path / "link.c"
        out.symlink_to(linkage)
    if spelling == "another toml":
        out = tmp_path / "pyproject.toml"
        out.write_text("[project]\n", encoding="utf-8")
    before = out.read_bytes()
    assert main([*call, str(linkage), "--out", str(out), *(["--replace"] if call[0] == "export" else [])]) == 2
    said = capsys.readouterr().err
    assert "is the input" in said or "files of the same kind" in said
    assert (linkage.read_bytes(), out.read_bytes()) == (FOUR_BAR.read_bytes(), before)


def test_no_picture_takes_the_place_of_the_linkage_that_it_shows_or_of_a_link(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    linkage = shutil.copy(FOUR_BAR, tmp_path)
    for target, words, replace in (
        (linkage, "is the input", ["--replace"]),
        (tmp_path / "gone.svg", "--replace writes over it", []),
    ):
        link = tmp_path / f"{Path(target).stem}_link.svg"
        link.symlink_to(target)
        assert main(["show", str(linkage), "--svg", str(link), *replace]) == 2
        assert words in capsys.readouterr().err
        assert link.is_symlink()


def test_a_file_of_its_own_kind_is_replaced_where_that_is_asked_for(tmp_path: Path) -> None:
    old = tmp_path / "old.c"
    old.write_text("int x;", encoding="utf-8")
    assert writable(old, True, suffix=".c") == old
    with pytest.raises(FileRefused, match="--replace writes over it"):
        writable(old, False, suffix=".c")


LINKAGE = FOUR_BAR.read_bytes()
CONTENTS = {
    ".csv": b"t [s],x [m]\n0,1\n",
    ".svg": b'<?xml version="1.0"?>\n<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN">\n<svg/>\n',
    ".html": b"<!doctype html>\n<html><svg/></html>",
    ".xml": b'<mujoco model="x"><!-- svg --></mujoco>',
    ".png": b"\x89PNG\r\n",
    ".gif": b"GIF89a",
    ".npz": b"PK\x03\x04",
    ".toml": LINKAGE,
    ".c": b"/* Model, of a linkage */\nint x[3];\n",
    ".py": b'"""One linkage: python FILE, prints t."""\nx = [1]\n',
}


@pytest.mark.parametrize("suffix", CONTENTS)
def test_the_first_bytes_of_a_file_tell_its_kind(suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"x{suffix}"
    for content, first in CONTENTS.items():
        file.write_bytes(first)
        is_program = content in (".c", ".py")  # programs begin in any way, so their ending tells
        assert is_of_kind(file, suffix) == (content == suffix or is_program)


def test_pictures_begin_in_several_ways(tmp_path: Path) -> None:
    file = tmp_path / "x.svg"
    for start in (b"<svg>", b'\n<?xml version="1.0"?>\n<!-- by hand -->\n<svg>', b""):
        file.write_bytes(start)
        assert is_of_kind(file, ".svg")


@pytest.mark.parametrize(
    "call",
    [
        ["simulate", "four_bar", "--at", "0,0.01", "--out", "x.csv"],
        ["simulate", "four_bar", "--at", "0,0.01", "--plot", "x.png"],
        ["kinematics", "four_bar", "--out", "x.csv"],
        ["show", "four_bar", "--svg", "x.svg"],
        ["export", "four_bar", "--engine", "c", "--out", "x.c"],
    ],
    ids=lambda x: f"{x[0]} {x[-1]}",
)
def test_a_linkage_with_the_ending_of_another_kind_is_not_replaced(
    call: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    file = Path(call[-1])
    file.write_bytes(LINKAGE)
    assert main([*call, "--replace"]) == 2
    assert f"{file}: is there already, and no {file.suffix} file" in capsys.readouterr().err
    assert file.read_bytes() == LINKAGE


@pytest.mark.parametrize("page", ["README.md", "site/index.html"])
def test_no_report_takes_the_place_of_a_page_of_the_users(page: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / page).parent.mkdir(exist_ok=True)
    (tmp_path / page).write_text("my own words", encoding="utf-8")
    (tmp_path / "site.css").write_text("", encoding="utf-8")
    for call in (["run", "four_bar", "--report"], ["report"]):
        assert main([*call, "--out", str(tmp_path)]) == 2
        assert f"{tmp_path / page}: is there already, and gauss-bench did not write it" in capsys.readouterr().err
    assert (tmp_path / page).read_text(encoding="utf-8") == "my own words"
    assert not [*tmp_path.glob("*.csv")]


@pytest.mark.parametrize("name", ["index.html", "atlas.svg", "atlas.csv"])
def test_no_atlas_takes_the_place_of_a_file_of_the_users(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call = ["atlas", "--engine", "lagrange", "--axis", "size", "--budget", "1e-9", "--out", str(tmp_path)]
    assert main(call) == 0
    assert main(call) == 0, "its own files are written over"
    (tmp_path / name).write_text("my own", encoding="utf-8")
    capsys.readouterr()
    assert main(call) == 2
    assert f"{tmp_path / name}: is there already" in capsys.readouterr().err
    assert (tmp_path / name).read_text(encoding="utf-8") == "my own"


@pytest.mark.long
def test_no_sweep_takes_the_place_of_a_picture_of_the_users(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "s"
    call = [
        *["sweep", "crank_slider", "--vary", "links.rod.mass=0.7:0.8:2", "--engine", "gauss", "--until", "0.01", "--out"],
        str(out),
    ]
    assert main(call) == 0
    (out / "summary.svg").write_text("<svg>mine</svg>", encoding="utf-8")
    capsys.readouterr()
    assert main(call) == 2
    assert f"{out / 'summary.svg'}: is there already" in capsys.readouterr().err
    assert (out / "summary.svg").read_text(encoding="utf-8") == "<svg>mine</svg>"
