"""Whatever happens in a worker is an answer: a result, or a status with a sentence."""

import ctypes
import os
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from gauss_bench.bench import tasks
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.runs.apart import Request, run_apart
from gauss_bench.runs.one_run import sampling
from gauss_bench.runs.worker import Worker, WorkerFailure
from gauss_bench.trajectory import Status


def test_a_worker_answers_and_every_task_finds_it_as_the_first_did():
    """In a process of its own, with one thread of BLAS, in the same folder, whatever a task prints."""
    with Worker() as worker:
        assert worker.call(max, (3, 7), 20.0) == 7
        first = worker.call(os.getpid, (), 20.0)
        assert first != os.getpid()
        assert worker.call(os.getpid, (), 20.0) == first
        assert worker.call(os.write, (1, b"noise\n"), 20.0) == 6
        assert worker.call(print, ("more noise",), 20.0) is None
        assert worker.call(os.getenv, ("OMP_NUM_THREADS",), 20.0) == "1"
        worker.call(os.chdir, ("/",), 20.0)
        assert worker.call(os.getcwd, (), 20.0) == os.getcwd()


@pytest.mark.parametrize(
    ("function", "arguments", "status", "sentence"),
    [
        (os.abort, (), Status.CRASHED, "SIGABRT"),
        (ctypes.string_at, (0,), Status.CRASHED, "SIGSEGV"),
        (os._exit, (7,), Status.CRASHED, "exit code 7"),
        (time.sleep, (60,), Status.TIMEOUT, "no answer within 2 s"),
        (int, ("seven",), Status.ERROR, "ValueError"),
    ],
)
def test_a_death_is_typed_and_the_next_task_is_served(function, arguments, status, sentence):
    with Worker() as worker:
        with pytest.raises(WorkerFailure, match=sentence) as caught:
            worker.call(function, arguments, 2.0)
        assert caught.value.status == status
        assert worker.call(max, (1, 2), 20.0) == 2


DEAR = {"pydantic", "scipy", "tqdm", "networkx", "gauss_bench.linkage.load", "gauss_bench.bench.journal"}
IMPORTED = "[*__import__('sys').modules]"  # a text: a function of this file would bring the file along


@pytest.mark.parametrize("engine", ["mujoco", "nobody:Nobody"])
def test_the_process_of_an_engine_imports_nothing_that_reads_linkages_or_keeps_journals(engine):
    """Every start of a worker would pay for it."""
    request = Request("four_bar", "torque", engine, Choice(), sampling(1e-2, 0.02))
    with Worker() as worker:
        run_apart(request, load("four_bar", "torque"), 20.0, worker)  # some do not know this choice: they are imported all the same
        found = {*worker.call(eval, (IMPORTED,), 20.0)}
    assert "gauss_bench.runs.apart" in found
    assert not found & DEAR


def noise_and_death(words):
    os.write(1, words.encode())
    os.abort()


def test_last_words_are_of_this_task_on_one_line_and_short():
    with Worker() as worker:
        worker.call(os.write, (1, b"of another task\n"), 20.0)
        with pytest.raises(WorkerFailure, match=r"signal SIGABRT$"):
            worker.call(os.abort, (), 20.0)
        with pytest.raises(WorkerFailure) as caught:
            worker.call(noise_and_death, ("\0and so on" * 1000,), 20.0)
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 600


def test_progress_is_a_line_now_and_then_where_stderr_is_no_terminal(monkeypatch, capsys):
    """A task every 6 s, and a line first and when more than 15 s have passed: after the third."""
    seconds = iter(range(0, 1000, 6))
    monkeypatch.setattr(tasks.time, "monotonic", lambda: float(next(seconds)))
    assert list(tasks.count_with_progress(4, "accuracy")) == [0, 1, 2, 3]
    assert capsys.readouterr().err == "accuracy: 4 to do\naccuracy: 3 of 4 done\n"


def test_a_worker_that_is_stopped_from_elsewhere_says_so_to_who_waits_for_it():
    with Worker() as worker, ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(worker.call, time.sleep, (60.0,), 60.0)
        while worker.process is None:
            time.sleep(0.001)
        worker.stop()
        with pytest.raises(WorkerFailure, match=r"^the process was stopped$"):
            waiting.result(10.0)
