"""Try some hostile files and lists of arguments; `make fuzz` tries many. Kinds that once broke a verb have tests of their own."""

import copy
import mmap
import os
from itertools import islice

import pytest

from gauss_bench import cli
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.limits import harmless, limit_faults
from gauss_bench.linkage.load import built_in, document_of, load_document
from tests.fuzz.__main__ import over_files, over_lists, warm
from tests.fuzz.calls import over_calls, simulated
from tests.fuzz.files import damaged_file
from tests.fuzz.lists import hostile_lists


def changed(**keys):
    """Return the four-bar with other values at paths, in which two underscores stand for a dot."""
    document = copy.deepcopy(document_of("four_bar")[0])
    for path, value in keys.items():
        *way, last = path.split("__")
        place = document
        for key in way:
            place = place[key]
        place[last] = value
    return document


@pytest.mark.parametrize(
    ("document", "said"),
    [
        (changed(links__crank__points__B=[1e160, 0.0]), r"links\.crank\.points\.B\[0\]: 1e\+160 is larger than 100000: joints are"),
        (changed(links__crank__kg_per_m=1e300), r"links\.crank\.kg_per_m: 1e\+300 is larger"),
        (changed(links__crank__kg_per_m=10**400), r"a number of 401 digits is larger"),
        (changed(scenarios__torque__start__crank_deg=1e12), r"scenarios\.torque\.start\.crank_deg: .* 1e-8 degrees"),
        (changed(scenarios__cycloid__driver__time=1e-300), r"scenarios\.cycloid\.driver\.time: 1e-300 is smaller than 1e-09"),
        (changed(assembly__sketch={"B": [1e9, 0.0], "C": [0.3, 0.3]}), r"assembly\.sketch\.B\[0\]: 1e\+09 is larger"),
        (changed(title="a\x00\x1b[31m"), r"title: 'a\\x00\\x1b\[31m' contains characters that cannot be printed"),
        (changed(forces={"a\x1b": 1.0}), r"forces: a key 'a\\x1b'"),
        (changed(links={f"l{i}": {} for i in range(1001)}), "links: 1001 entries; at most 1000 are read"),
        (
            changed(ground__points={f"p{i}": {"from": f"p{i + 1}", "r": 0.1} for i in range(300)} | {"p300": [0, 0]}),
            "more than 100",
        ),
        (changed(scenarios={f"s{i}": {"duration": 1.0} for i in range(101)}), "scenarios: 101 entries"),
        (
            changed(scenarios__torque__override={"forces": {"motor": {"value": 1e300}}}),
            r"scenarios\.torque\.override\.forces\.motor\.value: 1e\+300 is larger",
        ),
        (changed(ground__points={f"p{i}": {"from": f"p{(i + 1) % 300}", "r": 0.1} for i in range(300)}), "circular"),
    ],
)
def test_what_is_beyond_the_limits_is_refused_by_its_place_and_reason(document, said):
    with pytest.raises(LinkageError, match=said):
        load_document(document)


def test_nothing_that_comes_with_the_suite_is_beyond_the_limits():
    for name in (*built_in(), "n_four_bar_400", "pendulums_400"):
        assert limit_faults(document_of(name)[0]) == []


def test_a_start_many_turns_away_is_reached_by_whole_turns():
    turns = 27_000
    far = load_document(changed(scenarios__torque__start__crank_deg=360.0 * turns + 30.0))
    near = load_document(changed(scenarios__torque__start__crank_deg=30.0))
    assert far.q0[2] - near.q0[2] == pytest.approx(2 * 3.141592653589793 * turns, abs=1e-9)
    assert far.q0[:2] == pytest.approx(near.q0[:2], abs=1e-9)


def test_harmless_text_drives_no_terminal():
    assert harmless("a\x1b[31m\u202eb\ufffe\nc é 😀") == "a\\x1b[31m\\u202eb\\ufffe\nc é 😀"


@pytest.mark.parametrize("arguments", ["show \x1b[2J", "show a\x00b", "show \ud800", "import \x1b[31m.xml --out a.toml"])
def test_no_argument_comes_back_as_it_was(arguments, capsys):
    assert cli.main(arguments.split(" ")) == 2
    told = capsys.readouterr().err
    assert "error: " in told
    assert arguments.split(" ")[1] not in told


@pytest.mark.slow
def test_no_path_drives_a_terminal_wherever_it_is_told(tmp_path, capsys):
    evil = tmp_path / "\x1b[31m"
    (evil / ".run").mkdir(parents=True)
    (evil / ".run" / "journal.jsonl").write_bytes(b"garbage\n")
    assert cli.main(["check", "four_bar", "--baseline", str(evil / "b.csv")]) == 2
    run = ["run", "crank_slider", "--suite", "gate", "--no-costs", "--until", "0.01", "--steps", "0.01", "--engine", "gauss"]
    assert cli.main([*run, "--jobs", "1", "--out", str(evil)]) == 0
    told = "".join(capsys.readouterr())
    assert "1 of 1 lines are damaged" in told
    assert "tables in" in told
    assert "\x1b" not in told


def test_a_fault_of_the_program_is_a_sentence(capsys, monkeypatch):
    monkeypatch.delenv(cli.TRACE, raising=False)
    monkeypatch.setitem(cli.ACTIONS, "list", lambda options: 1 // 0)
    assert cli.main(["list"]) == 70
    assert "a fault of gauss-bench itself, not of its input: ZeroDivisionError" in capsys.readouterr().err
    monkeypatch.setenv(cli.TRACE, "1")
    with pytest.raises(ZeroDivisionError):
        cli.main(["list"])


def test_the_same_numbers_make_the_same_files_and_no_list_of_arguments_comes_twice():
    assert [damaged_file(7, i) for i in range(20)] == [damaged_file(7, i) for i in range(20)]
    assert len({damaged_file(7, i) for i in range(20)}) == 20
    made = [tuple(x) for x, _ in islice(hostile_lists(3, only=("list", "doctor")), 40)]
    assert len(set(made)) == 40
    assert {x[0] for x in made} > {"list", "doctor"}  # one word stands first that is no verb


@pytest.mark.long("30")
@pytest.mark.slow("6")
@pytest.mark.parametrize("count", [6, 30])
def test_hostile_files_and_arguments_are_refused_or_done(count, tmp_path):
    warm(tmp_path)
    (tmp_path / "files").mkdir()
    assert [x for x in over_files(3, count, tmp_path / "files") if x[1].fault] == []
    made = over_lists(3, count, tmp_path / "lists", only=("show", "kinematics", "import", "export"))
    assert [x for x in made if x[1].fault] == []


def test_memory_or_handles_that_grow_with_every_call_are_told():
    kept = []

    def leaking(number):
        pages = mmap.mmap(-1, 200_000)  # pages of the system: memory that other tests have left free in this process is not used
        pages.write(bytes(200_000))
        kept.append(pages)
        return ""

    def opening(number):
        if number % 100 == 0:
            kept.append(open(os.devnull))
        return "" if number != 7 else "wrong"

    assert [x[2] for x in over_calls(lambda number: "", 400) if x[2]] == []
    assert "bytes more" in [*over_calls(leaking, 400)][-1][2]
    *found, last = [x[2] for x in over_calls(opening, 400) if x[2]]
    assert found == ["wrong"]
    assert "handles more" in last


@pytest.mark.long
def test_calls_in_one_process_hold_no_more_at_their_end():
    assert [x for x in over_calls(simulated(3), 200) if x[2]] == []
