"""Hostile messages and connections, and several pages that draw at once."""

import contextlib
import json
import os
import random
import socket as sockets
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip("uvicorn")

from gauss_bench.studio.autosave import start_of
from gauss_bench.studio.requests import VERBS, answer
from gauss_bench.studio.server import as_json
from tests.studio import Watched, ask, four_bar

HUGE = 10**400
STRANGE = [None, True, -1, 1e400, HUGE, "", "\0", "</script>", "..", "\ud800", [], {}, [[1]]]
STRANGE += [{"at": [HUGE, 0]}, {"pin": {}}]


def deep(levels):
    return [deep(levels - 1)] if levels else 1


KEYS = ("pin", "at", "from", "to", "points", "link", "guide", "value", "path", "id", "ids", "type", "coordinate", "picture", "text")
KEYS += ("name", "fragment", "index", "job", "samples", "driver", "scenario", "a", "b", "law", "kind", "point", "through", "start")


@pytest.mark.slow
def test_whatever_a_message_holds_its_answer_is_a_sentence(tmp_path):
    """Strange values for the keys of all verbs cause no fault of the studio, and a refused message changes nothing."""
    session, chance = four_bar(tmp_path).session, random.Random(0)
    for verb in sorted(VERBS.keys() - {"hello", "import", "drawing", "recommend", "release"}):
        for _ in range(20):
            given = {key: chance.choice((*STRANGE, deep(500))) for key in chance.sample(KEYS, 6)}
            before = session.text
            found = answer(session, {"id": 1, "do": verb} | given)
            as_json(found)
            assert found["ok"] or not found["error"].get("fault"), (verb, str(given)[:300], found["error"]["text"])
            assert found["ok"] or session.text == before, (verb, str(given)[:300])
            if session.text != before:
                session.undo()


def test_half_a_character_is_refused_before_it_is_in_the_drawing(pen):
    assert "half a character" in pen.refused("set", path="title", value="\ud800")
    assert "half a character" in pen.refused("open", text='name = "x\udfff"')


def test_a_process_that_has_ended_is_no_more_though_nobody_asked_how():
    """A process whose parent does not wait for it stays in the list of processes, as in some containers."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        assert start_of(process.pid)
        process.kill()
        for _ in range(500):
            if not start_of(process.pid):
                break
            time.sleep(0.01)
        assert start_of(process.pid) == ""
        assert Path(f"/proc/{process.pid}").exists() or sys.platform != "linux"


PLACES = [(0.0, 0.0), (0.1, 0.0), (0.2, 0.0), (0.4, 0.0)]
CRANKS = [((x, 0.0), (x + 0.05, 0.1)) for x in (0.0, 0.2, 0.4)]


@pytest.mark.parametrize(
    ("grounds", "bars", "plate", "dof", "redundant"),
    [
        ((0.0, 0.4), [*pairwise(PLACES)], [], 1, [0]),
        ((0.0, 0.2), [*pairwise(PLACES[:3])], [], 0, [0, 1]),
        ((0.0, 0.2, 0.4), CRANKS, [x for _, x in CRANKS], 1, [1]),
    ],
    ids=["line", "strut", "double parallelogram"],
)
def test_bars_in_one_line_are_no_freer_than_they_are_elsewhere(pen, grounds, bars, plate, dof, redundant):
    """The rows of the joints lose rank if all bars lie in one line. A double parallelogram has a redundant row everywhere."""
    for x in grounds:
        pen.pin(x, 0.0, ground=True)
    for a, b in bars:
        pen.bar(a, b)
    if plate:
        pen.plate(*plate)
    status = pen.now["status"]
    assert status["dof"] == dof
    assert status["redundant"] in redundant


@pytest.mark.long
def test_runs_where_the_caches_cannot_be_written_are_run_elsewhere(tmp_path, monkeypatch):
    (tmp_path / "taken").write_text("a file, and no folder", encoding="utf-8")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "taken"))
    pen = four_bar(tmp_path)
    assert len(pen.ask("motion", samples=4)["times"]) == 5
    watched = Watched(pen)
    pen.ask("release", until=0.01, engine="gauss")
    assert "error" not in watched.until("release_done")
    assert watched.until("release")["verdict"] == "ok"
    assert not pen.session.jobs.running


def test_jobs_stopped_at_once_leave_room_for_others(bars):
    told = []
    bars.session.tell = told.append
    for _ in range(6):
        job = bars.ask("release", until=20.0, engine="gauss")["job"]
        bars.ask("stop", job=job)
        bars.session.jobs.stop_all()
    assert not bars.session.jobs.running
    assert [x["error"] for x in told if x["event"] == "release_done"] == ["it was stopped"] * 6


def heard(socket, event):
    while True:
        found = json.loads(socket.recv(20))
        if found.get("event") == event:
            return found


@pytest.mark.long
def test_a_second_page_sees_what_the_first_one_draws(studio_server):
    with studio_server.socket() as first, studio_server.socket() as second:
        ask(first, "hello"), ask(second, "hello")
        drawn = ask(first, "template", name="four_bar")["scene"]
        assert heard(second, "scene")["scene"] == drawn
        undone = ask(second, "set", path="title", value="Theirs")["scene"]
        assert heard(first, "scene")["scene"]["title"] == undone["title"] == "Theirs"


@pytest.mark.long
def test_no_page_waits_for_the_long_requests_of_another_or_its_own(studio_server):
    """An import takes seconds in a process of its own, and other requests are answered meanwhile."""
    with studio_server.socket() as first, studio_server.socket() as second:
        ask(first, "hello"), ask(second, "hello")
        first.send(json.dumps({"id": 7, "do": "import", "text": "<mujoco><worldbody/></mujoco>"}))
        ids = []
        assert ask(second, "text")["ok"]
        first.send(json.dumps({"id": 8, "do": "text"}))
        while len(ids) < 2:
            found = json.loads(first.recv(60))
            ids += [found["id"]] if "id" in found else []
        assert ids == [8, 7]


@pytest.mark.long
def test_who_reads_nothing_holds_up_nobody(studio_server):
    """A page that never reads its replies and half-open connections do not stop another page."""
    idle = [sockets.create_connection(("127.0.0.1", studio_server.port)) for _ in range(10)]
    with studio_server.socket() as deaf, studio_server.socket() as good:
        ask(good, "template", name="four_bar")
        deaf.socket.setsockopt(sockets.SOL_SOCKET, sockets.SO_RCVBUF, 4096)
        deaf.recv_bufsize = 1
        for _ in range(100):
            deaf.send(json.dumps({"id": 1, "do": "text"}))
        for k in range(2):
            assert ask(good, "set", path="title", value=f"t{k}")["ok"]
    for connection in idle:
        connection.close()
    with studio_server.socket() as again:
        assert ask(again, "hello")["ok"]


@pytest.mark.slow
@pytest.mark.long("fresh")
@pytest.mark.parametrize("before", ["", "GET /page/none HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n"], ids=["fresh", "answered"])
def test_requests_that_never_end_leave_room_for_the_user(studio_server, before):
    """The server closes the oldest unfinished requests, answers the newest, and keeps the socket of an open page."""
    rest = f"GET /?token={studio_server.token} HTTP/1.1\r\nHost: 127.0.0.1:{studio_server.port}\r\n"
    with contextlib.ExitStack() as stack:
        page = stack.enter_context(studio_server.socket())
        half = []
        for _ in range(400):
            half.append(stack.enter_context(sockets.create_connection(("127.0.0.1", studio_server.port), timeout=20)))
            if before:
                half[-1].sendall(before.format(port=studio_server.port).encode())
                said = b""
                while not said.endswith(b"no such file"):
                    said += half[-1].recv(1 << 16)
                    assert said.startswith(b"HTTP/1.1 404")
            half[-1].sendall(rest.encode())
        assert studio_server.get(f"/?token={studio_server.token}")[0] == 200
        assert ask(page, "hello")["ok"]
        half[-1].sendall(b"\r\n")
        assert half[-1].recv(1 << 16).startswith(b"HTTP/1.1 200")
        with contextlib.suppress(ConnectionResetError):
            while half[0].recv(1 << 16):
                pass


@pytest.mark.long
def test_a_taken_port_and_a_folder_that_is_gone_are_told(tmp_path):
    with sockets.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        command = [sys.executable, "-m", "gauss_bench", "studio", "--no-browser", "--port", str(port)]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, "Traceback" in done.stderr) == (2, False)
    assert str(port) in done.stderr
    gone = tmp_path / "gone"
    gone.mkdir()
    code = f"import os, sys; os.chdir({str(gone)!r}); os.rmdir({str(gone)!r}); os.execv(sys.executable, {[*command[:-2]]!r})"
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60)
    assert (done.returncode, "Traceback" in done.stderr) == (2, False), done.stderr
