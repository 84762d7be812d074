"""Each of sixty ways in which an engine can fail gives a status and a message, and leaves no process behind."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gauss_bench.runs import worker
from gauss_bench.runs.worker import Worker, WorkerFailure
from gauss_bench.trajectory import Status
from tests.faults import FAULTS, IMPORTS, LIES, alive, write_modules

SOME = "run_segfault run_loop run_memory run_child init_boom build_boom told_nan told_short told_resting lie_settings import_exit"
FINE = {"version_boom", "told_function", "lie_version", "lie_name", "lie_settings_function"}  # they spoil no motion
SLEEP = "36001.7"  # [s]
CODE = """
import atexit, json, sys
import gauss_bench
from gauss_bench.api import simulate
from gauss_bench.runs import apart, offers
from gauss_bench.runs.worker import Worker, WorkerFailure
from gauss_bench.trajectory import Status

class Lasting(Worker):
    '''A worker that serves the next engine too, where the last one has not brought it down.'''
    def stop(self): pass
    def call(self, *arguments):
        try:
            return super().call(*arguments)
        except WorkerFailure as failure:
            if failure.status is not Status.ERROR:
                super().stop()
            raise

def ask(name):
    try:
        found = gauss_bench.simulate("four_bar", name, scenario="torque", at=[0.04], step=5e-3, limit=2.0)
    except offers.ChoiceError as error:  # it cannot be asked for anything
        return ["error", str(error), False]
    return [str(found.status), found.message, bool(found.valid)]

one = Lasting()
atexit.register(Worker.stop, one)
simulate.get_worker = apart.get_worker = offers.get_worker = lambda engine: one
offers.LIMIT = 5.0
print(json.dumps({name: ask(name) for name in sys.argv[1:]}))
"""


@pytest.mark.slow
@pytest.mark.long("all")
@pytest.mark.parametrize("chosen", [SOME.split(), [*FAULTS, *LIES, *IMPORTS]], ids=["some", "all"])
def test_faults_are_typed_rows_and_leave_no_orphans(tmp_path, chosen):
    assert len(FAULTS) >= 40
    names = [x for x in write_modules(tmp_path, SLEEP) if {*x.split(":")} & {*chosen}]
    sign = f"SIGN_OF_THIS_TEST={os.urandom(8).hex()}"
    environment = os.environ | {"PYTHONPATH": f"{Path(__file__).parents[1]}:{tmp_path}"} | dict([sign.split("=")])
    command = [sys.executable, "-c", CODE, *names]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=900)
    assert done.returncode == 0, done.stderr[-2000:]
    told = {name.removeprefix("faults40:").removesuffix(":Engine"): x for name, x in json.loads(done.stdout).items()}
    assert told.keys() == set(chosen)
    for name, (status, message, valid) in told.items():
        if name in FINE:
            assert (status, valid) == ("ok", True), name
            continue
        assert status in set(Status) - {Status.OK}, (name, status, message)
        assert message, name
        assert message.isprintable(), name
        assert not valid, name
    assert told["run_segfault"][:2] == ["crashed", "the process died with signal SIGSEGV"]
    assert told["run_loop"][0] == "timeout"
    assert told["run_memory"][0] == "error"
    assert "MemoryError" in told["run_memory"][1]
    assert [told[f"told_{x}"][0] for x in ("nan", "short", "resting")] == ["nan", "incomplete", "invalid"]
    assert {told[f"run_{x}"][0] for x in ("sleep", "stop", "daemon") if f"run_{x}" in told} <= {"timeout"}
    assert not alive(sign.encode())


def burn(seconds):
    start = time.process_time()
    while time.process_time() - start < seconds:
        pass
    return seconds


def test_waiting_for_a_processor_is_not_held_against_a_task(monkeypatch):
    """The system reports how long a process waited for a processor; here it reports that it waited nearly always."""
    start = time.monotonic()
    monkeypatch.setattr(worker._Clock, "_waiting_time", lambda self: 0.99 * (time.monotonic() - start))
    with Worker() as one:
        one.call(max, (1, 2), 60.0)
        assert one.call(burn, (0.6,), 0.3) == 0.6  # 0.6 s, of which a hundredth counts
    monkeypatch.setattr(worker, "BACKSTOP", 2.0)
    with Worker() as one:
        one.call(max, (1, 2), 60.0)
        with pytest.raises(WorkerFailure, match="no answer within"):
            one.call(time.sleep, (60,), 0.3)


def test_a_thread_that_waits_for_a_processor_is_not_held_against_the_one_that_waits_for_it(monkeypatch):
    """A compiler's thread waits 3 s for a processor, the first thread 1 s: of 10 s, 6 s are left after 8 s."""
    monkeypatch.setattr(worker, "read_waits", lambda pid: {1: 1.0, 7: 5.0, 8: 2.0})
    clock = worker._Clock(1, 10.0)
    monkeypatch.setattr(worker, "read_waits", lambda pid: {1: 2.0, 7: 6.0, 8: 5.0, 9: 1.5})
    clock.start -= 8.0
    assert clock.remaining() == pytest.approx(10.0 - (8.0 - 4.0), abs=0.1)


def start_a_daemon():
    return subprocess.Popen(["sleep", "3600"], start_new_session=True).pid


def start_a_daemon_further_in():
    return int(Worker().call(start_a_daemon, (), 20.0))  # which nobody ends, as where its owner is killed


HIDDEN = """
import os, sys, time
if os.fork() == 0:
    os.setsid()
    if (pid := os.fork()) == 0:
        os.dup2(2, 1)  # the pipe that is read to its end
        os.execve("/bin/sleep", ["sleep", "3600"], {})
    os.write(1, b"%d" % pid)
os._exit(0)
"""


def start_a_daemon_without_a_mark():
    """Start a process by two forks, in a session of its own and with an empty environment, so that nothing shows its origin."""
    return int(subprocess.run([sys.executable, "-c", HIDDEN], stdout=subprocess.PIPE, check=True).stdout)


def start_an_unmarked_daemon_and_hang():
    Path(os.environ["SAID"]).write_text(str(start_a_daemon_without_a_mark()), encoding="ascii")
    time.sleep(3600)


def ends(pid):
    """Tell whether a process ends within five seconds."""
    deadline = time.monotonic() + 5.0
    while Path(f"/proc/{pid}").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    return not Path(f"/proc/{pid}").exists()


@pytest.mark.parametrize("start", [start_a_daemon, start_a_daemon_further_in, start_a_daemon_without_a_mark])
def test_what_hides_in_a_session_of_its_own_ends_with_its_worker(start):
    with Worker() as one:
        pid = one.call(start, (), 30.0)
        assert Path(f"/proc/{pid}").exists()
    assert ends(pid)


def test_what_hides_from_a_task_that_takes_too_long_ends_with_it(tmp_path, monkeypatch):
    monkeypatch.setenv("SAID", str(tmp_path / "said"))
    with Worker() as one:
        with pytest.raises(WorkerFailure, match="no answer within"):
            one.call(start_an_unmarked_daemon_and_hang, (), 3.0)
        assert ends(int((tmp_path / "said").read_text(encoding="ascii")))


@pytest.mark.parametrize("start", ["start_a_daemon_further_in", "start_a_daemon_without_a_mark"])
def test_what_a_worker_has_started_ends_with_whoever_started_the_worker(start):
    code = f"import os; from tests.test_isolation import {start} as f; from gauss_bench.runs.worker import Worker; "
    code += "os.write(1, b'%d' % Worker().call(f, (), 30.0)); os._exit(1)"
    done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, check=False, timeout=60)
    assert done.returncode == 1
    assert ends(int(done.stdout))
