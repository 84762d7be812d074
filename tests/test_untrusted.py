"""The depth of untrusted TOML is limited before it is parsed, and reading never waits for a path that is no file."""

import os
import socket
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from gauss_bench.cli import main
from gauss_bench.studio.document import parse_text
from gauss_bench.studio.messages import Refused
from gauss_bench.untrusted import DEEPEST, TooDeep, check_depth, parse_toml

MANY = 40_000


def dotted(levels, part="a"):
    return ".".join([part] * levels)


DEEP = {
    "a key": f"{dotted(MANY)} = 1",
    "a key with blanks and quotes": f"{dotted(MANY, chr(34) + '.]' + chr(34) + ' ')} = 1",
    "a key in a string's shadow": f's = """x"""""\n{dotted(MANY)} = 1',
    "a key after a string of one quote": f's = "#\\"" # \'\n{dotted(MANY)} = 1',
    "a header": f"[{dotted(MANY)}]",
    "an array of tables": f"[[{dotted(MANY)}]]",
    "lists": f"x = {'[' * MANY}{']' * MANY}",
    "lists on lines of their own": "x = " + "[# ]\n" * MANY + "]" * MANY,
    "inline tables": f"x = {'{a=' * MANY}1{'}' * MANY}",
    "a key in an inline table": f"x = [{{ y = 1, {dotted(MANY)} = 1 }}]",
}
SHALLOW = {
    "a basic string": f'x = "{dotted(MANY)} [[[ \\" {"[" * 50}"',
    "a literal string": f"x = '{dotted(MANY)} \" {'[' * 50}\\'",
    "strings of many lines": f'x = """\n{dotted(MANY)}\n\\""" "" {"[" * 50}"""""\ny = \'\'\'\'{"[" * 50}\'\'\'\'\'',
    "a comment": f"x = 1 # {dotted(MANY)} '''{'[' * 50}",
    "a quoted key": f'"{dotted(MANY)}{"[" * 50}" = 1',
    "many lists beside each other": f"x = [{'[1.5], ' * MANY}]",
    "many headers": "".join(f"[a.b{k}.c]\nd.e = {{f.g = 1.5}}\n[[z.y]]\n" for k in range(2000)),
    "as deep as may be": f"{dotted(DEEPEST + 1)} = {'[' * DEEPEST}{']' * DEEPEST}",
}


@pytest.mark.parametrize("name", DEEP)
def test_what_lies_deep_is_refused_by_its_line_before_it_is_parsed(name, monkeypatch):
    monkeypatch.setattr(tomllib, "loads", lambda *_, **__: pytest.fail("it was parsed"))
    text = "first = 1\n" + DEEP[name]
    at = DEEPEST + 2 if name == "lists on lines of their own" else 2 + DEEP[name].count("\n")
    with pytest.raises(TooDeep, match=rf"more than {DEEPEST} deep \(at line {at}\)"):
        parse_toml(text)
    with pytest.raises(Refused, match=f"at line {at}"):
        parse_text(text)


@pytest.mark.parametrize("name", SHALLOW)
def test_what_only_looks_deep_is_parsed(name):
    assert parse_toml(SHALLOW[name]) == tomllib.loads(SHALLOW[name])


@pytest.mark.parametrize("text", ['x = """a', "x = '''a", 'x = "a', "x = 'a\n", 'x = """\\"""' * 1000, '"""' * 1001, "]" * 100])
def test_a_string_that_nothing_closes_is_left_to_the_parser(text):
    check_depth(text)
    with pytest.raises(tomllib.TOMLDecodeError):
        parse_toml(text)


@pytest.mark.parametrize("levels", [20_000, 40_000])
def test_every_verb_that_reads_a_linkage_refuses_a_deep_key(levels, tmp_path, capsys):
    path = tmp_path / "deep.toml"
    path.write_text(f'name = "deep"\n{dotted(levels)} = 1\n', encoding="utf-8")
    for verb in (["show"], ["simulate"], ["kinematics"], ["export", "--engine", "c", "--out", str(tmp_path / "x.c")]):
        assert main([verb[0], str(path), *verb[1:]]) == 2
        assert capsys.readouterr().err == f"error: {path}: TOML: tables or lists lie more than {DEEPEST} deep (at line 2)\n"
    assert main(["run", "--suite", str(path), "--out", str(tmp_path / "run")]) == 2
    assert "(at line 2)" in capsys.readouterr().err
    assert main(["simulate", "four_bar", "--settings", f"default,x={'[' * 5000}", "--at", "0"]) == 2
    assert not (tmp_path / "x.c").exists()


def no_files(folder):
    """Return a path of every kind that is no regular file, such as a pipe, a socket or an endless device."""
    os.mkfifo(folder / "pipe.toml")
    (folder / "circle.toml").symlink_to("circle.toml")
    (folder / "folder.toml").mkdir()
    (folder / "linked.toml").symlink_to(folder / "pipe.toml")
    server = socket.socket(socket.AF_UNIX)
    here = os.getcwd()
    os.chdir(folder)  # names of sockets are short
    try:
        server.bind("socket.toml")
    finally:
        os.chdir(here)
        server.close()
    paths = [*sorted(folder.iterdir()), *(Path(x) for x in ("/dev/zero", "/dev/tty", "/dev/stdin", "/proc/self/mem", "/proc/kmsg"))]
    return {path.name: path for path in paths}


VERBS = """
show PATH
simulate PATH
kinematics PATH
kinematics four_bar --driver table:file=PATH
sweep PATH --vary gravity=1:2:2 --out NEW
import PATH --out NEW.toml
verify PATH
run --suite PATH --out NEW
check --baseline PATH
"""


CODE = """
import sys
from gauss_bench.cli import main
for arguments in ASKED:
    print(f"{arguments}:", file=sys.stderr)
    code = main(arguments)
    assert code == 2, code
"""


def test_what_is_no_file_is_refused_at_once(tmp_path):
    """One process calls all verbs; its time limit is far above the time that they take."""
    places = tmp_path / "places"
    places.mkdir()
    paths, new = no_files(places), str(tmp_path / "new")
    asked = {}
    for verb in VERBS.strip().splitlines():
        for path in paths.values():
            few = verb.startswith(("import", "run --suite"))  # a process for each; and suites are told by their ending
            silent = "--driver" in verb and path.name == "kmsg"  # no rows, which is told of the driver
            if not silent and (not few or path.name == "pipe.toml"):
                asked[verb, path] = [x.replace("PATH", str(path)).replace("NEW", new) for x in verb.split()]
    code = CODE.replace("ASKED", repr([*asked.values()]))
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, stdin=subprocess.PIPE, capture_output=True, text=True, check=False, timeout=100)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    for (_, path), arguments in asked.items():
        said = done.stderr.partition(f"{arguments}:\n")[2].partition("\n[")[0]
        assert str(path) in said, (arguments, said)
        assert "fault of gauss-bench" not in said
    assert not list(tmp_path.glob("new*"))
