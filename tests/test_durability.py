"""Torn, altered, locked, full or read-only files are reported, and no finished row is lost or doubled."""

import fcntl
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gauss_bench import cli
from gauss_bench.bench.journal import Journal, entry_of, line_of
from gauss_bench.compiler import user_cache
from gauss_bench.linkage.load import load
from gauss_bench.reference import store
from gauss_bench.reference.store import load_stored, read_reference
from tests.fuzz.kills import faults_of_the_end, over_kills

ROWS = {"results": [{"x": 0.1, "y": float("inf")}]}


def written(path, count=3):
    with Journal(path) as journal:
        for k in range(count):
            journal.add(f"case {k}", "stamp", {"results": [{"x": k + 0.123456789}]})
    return path.read_bytes()


def test_a_line_says_what_was_written_or_nothing():
    entry = {"key": 'a ", "sum": "b', "stamp": "s", "tables": ROWS}
    line = line_of(entry)
    assert json.loads(line)["key"] == entry["key"]
    assert entry_of(line) == entry
    for at in range(len(line)):
        assert entry_of(line[:at] + bytes([line[at] ^ 1]) + line[at + 1 :]) is None
    assert entry_of(b'{"key": "old", "stamp": "s", "tables": {}}\n') is None


def test_an_altered_line_is_told_and_its_task_is_run_again(tmp_path, capsys):
    path = tmp_path / "journal.jsonl"
    lines = written(path).splitlines(keepends=True)
    lines[1] = lines[1].replace(b'{"key": "case 1"', b"garbage\x00\xff{{{")
    path.write_bytes(b"".join(lines) + b'{"key": "torn')
    with Journal(path) as journal:
        assert [bool(journal.find(f"case {k}", "stamp")) for k in range(3)] == [True, False, True]
        assert "1 of 3 lines are damaged" in capsys.readouterr().err
        journal.add("case 1", "stamp", ROWS)
    with Journal(path) as journal:
        assert journal.find("case 1", "stamp") == ROWS
        assert journal.find("case 0", "stamp") == {"results": [{"x": 0.123456789}]}


@pytest.mark.parametrize("how", ["cut", "altered", "column", "text"])
def test_a_damaged_reference_is_told_and_built_again(tmp_path, how, capsys):
    mechanism = load("four_bar", "torque")
    true = load_stored(mechanism, 0.0125, tmp_path)
    (path,) = tmp_path.iterdir()
    with np.load(path) as data:
        content = {name: data[name] for name in data}
    if how == "cut":
        path.write_bytes(path.read_bytes()[:-200])
    elif how == "text":
        path.write_text("no reference")
    else:
        content = content | {"q": content["q"] + 1e-9} if how == "altered" else {k: x for k, x in content.items() if k != "v"}
        np.savez_compressed(path, **content)
    assert read_reference(path) is None
    found = load_stored(mechanism, 0.0125, tmp_path)
    assert "built again" in capsys.readouterr().err
    assert (found.q == true.q).all()
    assert [x.name for x in tmp_path.iterdir()] == [path.name]


def test_what_killed_processes_left_among_object_code_is_removed(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache.store("first", b"code")
    left = [user_cache.folder() / f"{name}.part" for name in ("old", "ahead", "new")]
    for path, age in zip(left, (-7200.0, 7200.0, 0.0), strict=True):
        path.write_bytes(b"half")
        os.utime(path, (time.time() + age,) * 2)
    assert user_cache.store("second", b"code")
    assert [path.exists() for path in left] == [False, False, True]  # somebody may be writing the last one
    assert user_cache.load("first") == user_cache.load("second") == b"code"


RUN = [sys.executable, "-m", "gauss_bench", "run", "four_bar", "--suite", "gate", "--no-costs", "--until", "0.05"]
SHORT = [*RUN[3:], "--engine", "gauss", "--steps", "0.01"]


@pytest.mark.long
@pytest.mark.parametrize("name", ["run", "sweep"])
def test_kills_at_random_moments_lose_and_double_nothing(name, tmp_path):
    """An undisturbed run by one worker, and a run by two workers that is killed again and again, write the same bytes."""
    ((_, word, fault),) = over_kills(1, 1, tmp_path, names=(name,))
    assert not fault
    assert word.startswith(f"{name} killed,")


@pytest.mark.parametrize("how", ["lost", "changed"])
def test_a_run_that_loses_or_changes_what_was_finished_is_told(tmp_path, how):
    """A script that writes the journal anew each time stands for the run."""
    script = tmp_path / "run.py"
    anew = [line_of({"key": f"case {k}", "stamp": "s", "tables": {}}) for k in range(2)][how == "lost" :]
    write = f"(place / '.run' / 'journal.jsonl').write_bytes({b''.join(anew)!r}); (place / 'results.csv').write_text({how!r})"
    script.write_text(f"import pathlib, sys; place = pathlib.Path(sys.argv[-1]); {write}", encoding="utf-8")
    place = tmp_path / "place"
    with Journal(place / ".run" / "journal.jsonl") as journal:
        journal.add("case 0", "s", {})
    asked = [sys.executable, str(script), "-m", "run", str(place)]
    found = [*faults_of_the_end(asked, place, {Path("results.csv"): b"lost"})]
    assert found == (["going on loses what was finished"] if how == "lost" else ["differs from the undisturbed one: results.csv"])


def test_nothing_is_kept_of_a_reference_that_cannot_be_written(tmp_path, monkeypatch):
    def full(file, **_):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store.np, "savez_compressed", full)
    with pytest.raises(OSError, match="No space left"):
        load_stored(load("four_bar", "torque"), 0.0125, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_a_verb_whose_disk_is_full_says_so_and_the_next_call_goes_on(tmp_path):
    """A limit on the size of files stands for the disk."""
    vary = ["--vary", "links.rod.mass=0.7:0.8:2", "--engine", "gauss", "--step", "0.01", "--until", "0.05"]
    for asked, most, results in (
        ([*RUN[:3], *SHORT], 4000, "results.csv"),
        ([*RUN[:3], "sweep", "crank_slider", *vary], 4000, "samples/part-00000.parquet"),
    ):
        whole, full = (tmp_path / f"{results[:3]} {x}" for x in ("whole", "full"))
        subprocess.run([*asked, "--out", str(whole)], check=True, capture_output=True)
        limited = ["-c", f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({most},) * 2); "]
        limited[1] += "import sys; from gauss_bench import cli; sys.exit(cli.main())"
        done = subprocess.run(
            [sys.executable, *limited, *asked[3:], "--out", str(full)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 2, done.stderr
        assert "File too large" in done.stderr.splitlines()[-1]
        assert "Traceback" not in done.stderr
        assert not [x for x in full.rglob("*") if x.suffix == ".part"]
        subprocess.run([*asked, "--out", str(full)], check=True, capture_output=True)
        assert (full / results).read_bytes() == (whole / results).read_bytes()


def test_a_second_run_into_a_folder_is_refused_by_its_verb(tmp_path, capsys):
    varied = ["--vary", "links.rod.mass=0.7:0.8:2", "--engine", "gauss", "--until", "0.01"]
    for arguments, said in ((RUN[3:], "another run"), (["sweep", "crank_slider", *varied], "another sweep")):
        locked = folder = tmp_path / arguments[0]
        folder.mkdir()
        if arguments[0] == "run":
            (folder / ".run").mkdir()
            locked = folder / ".run" / "journal.jsonl"
            locked.touch()
        held = os.open(locked, os.O_RDONLY)
        fcntl.flock(held, fcntl.LOCK_EX)
        before = sorted(folder.rglob("*"))
        assert cli.main([*arguments, "--out", str(folder)]) == 2
        assert said in capsys.readouterr().err
        assert [x for x in sorted(folder.rglob("*")) if x.name != "samples"] == before
        os.close(held)
