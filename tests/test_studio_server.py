"""The studio's server as a browser meets it: a page with a token, one socket, and nobody else."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("uvicorn")
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from gauss_bench.studio.security import RATE, WINDOW, Rate


@dataclass(frozen=True)
class Running:
    process: "subprocess.Popen[str]"
    port: int
    token: str
    folder: Path

    def get(self, path: str, **headers: str) -> tuple[int, str, Any]:
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{path}", headers=headers)
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return answer.status, answer.read().decode(), answer.headers
        except urllib.error.HTTPError as error:
            return error.code, error.read().decode(), error.headers

    def socket(self, token: str | None = None, **headers: str) -> ClientConnection:
        address = f"ws://127.0.0.1:{self.port}/socket?token={self.token if token is None else token}"
        return connect(address, additional_headers=headers, max_size=None, open_timeout=20)


def started(folder: Path, *arguments: str) -> Running:
    environment = os.environ | {"XDG_CACHE_HOME": str(folder / "cache"), "PYTHONUNBUFFERED": "1"}
    command = [sys.executable, "-m", "gauss_bench", "studio", "--no-browser", *arguments]
    process = subprocess.Popen(command, cwd=folder, env=environment, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    for line in process.stderr:
        if found := re.search(r"http://127\.0\.0\.1:(\d+)/\?token=(\S+)", line):
            return Running(process, int(found[1]), found[2], folder)
    raise AssertionError("the studio did not say where it is")


def ended(running: Running, by: int = signal.SIGINT) -> int:
    running.process.send_signal(by)
    code = running.process.wait(30)
    assert running.process.stderr is not None
    running.process.stderr.close()
    return code


def ask(socket: ClientConnection, do: str, **more: Any) -> dict[str, Any]:
    socket.send(json.dumps({"id": 1, "do": do} | more))
    while True:
        found: dict[str, Any] = json.loads(socket.recv(60))
        if "event" not in found:
            return found


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    found = started(tmp_path_factory.mktemp("studio"))
    yield found
    if found.process.poll() is None:
        assert ended(found) == 0


def test_the_page_wants_its_token_and_may_run_nothing_from_elsewhere(running: Running) -> None:
    code, _, headers = running.get(f"/?token={running.token}")
    assert code == 200
    assert running.get("/")[0] == running.get("/?token=guessed")[0] == 403
    policy = headers["content-security-policy"]
    assert "default-src 'self'" in policy
    assert "unsafe" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    for token in ("", "guessed", running.token[:-1]):
        with pytest.raises(InvalidStatus):
            running.socket(token)
    with running.socket(Origin=f"http://127.0.0.1:{running.port}") as socket:
        assert ask(socket, "hello")["ok"]


@pytest.mark.parametrize(
    ("header", "value"),
    [
        *(("Host", x) for x in ("example.org", "127.0.0.1", "127.0.0.1:1", "localhost.example.org:{port}")),
        *(("Origin", x) for x in ("http://example.org", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1")),
    ],
)
def test_another_host_or_origin_is_refused(running: Running, header: str, value: str) -> None:
    given = {header: value.format(port=running.port)}
    assert running.get(f"/?token={running.token}", **given)[0] == running.get("/page/index.html", **given)[0] == 403
    if header == "Origin":
        with pytest.raises(InvalidStatus):
            running.socket(**given)


@pytest.mark.parametrize(
    "path", ["/page/../server.py", "/page/..%2fserver.py", "/page/%2e%2e/server.py", "/page//etc/passwd", "/etc/passwd"]
)
def test_no_file_but_the_pages_own_is_served(running: Running, path: str) -> None:
    code, content, _ = running.get(path)
    assert code == 404
    assert "import" not in content


def test_what_is_no_message_gets_a_sentence_and_what_is_too_large_ends_its_socket(running: Running) -> None:
    with running.socket() as socket:
        for sent in ("", "{", "[1]", '{"do": 3}', '{"do": "nothing"}', '{"do": "open", "text": NaN}', "[" * 100_000):
            socket.send(sent)
            found = json.loads(socket.recv(20))
            assert not found["ok"]
            assert found["error"]["text"]
        assert ask(socket, "hello")["ok"]
        socket.send("x" * (3 << 20))
        with pytest.raises(ConnectionClosed):  # this socket alone
            socket.recv(20)
    with running.socket() as socket:
        assert ask(socket, "hello")["ok"]


def test_messages_are_answered_no_faster_than_their_rate() -> None:
    rate = Rate()
    assert all(rate.allows(0.0) for _ in range(RATE))
    assert not rate.allows(0.5)
    assert rate.allows(WINDOW + 0.01)


@pytest.mark.long
def test_what_was_drawn_outlives_a_killed_server_whatever_its_port_and_nothing_a_clean_end(tmp_path: Path) -> None:
    cache = tmp_path / "cache" / "gauss-bench" / "studio"
    first = started(tmp_path)
    with first.socket() as socket:
        drawn = ask(socket, "add_pin", at=[0.1, 0.2], ground=True)["scene"]["pins"]
        job = ask(socket, "template", name="four_bar")["ok"] and ask(socket, "release", until=20.0, engine="gauss")["job"]
        assert job == 1
        kept = ask(socket, "set", path="title", value="Not saved")["scene"]["title"]
        behind = {"url": "data:image/gif;base64,R0lGODlhAQABAAAAACw=", "at": [0.0, 0.0], "width": 0.2, "height": 0.1}
        ask(socket, "picture", picture=behind)
    assert len(drawn) == 1
    workers = [int(x.name.split(".")[1]) for x in cache.glob("run.*")]
    assert workers == [first.process.pid]
    assert ended(first, signal.SIGKILL) == -signal.SIGKILL
    assert len([*cache.glob("*.json")]) == 1
    second = started(tmp_path)
    assert not [*cache.glob("run.*")]
    with second.socket() as socket:
        assert kept in ask(socket, "hello")["recovered"]["text"]
        found = ask(socket, "recover", take=True)["scene"]
        assert (found["title"], found["picture"]["width"]) == ("Not saved", 0.2)
        assert ask(socket, "behind")["url"] == behind["url"]
        assert ask(socket, "hello")["recovered"] is None
        ask(socket, "save", path="saved")
        assert ask(socket, "files")["kept"] == []
        ask(socket, "set", path="title", value="More than was saved")
    assert ended(second, signal.SIGKILL) == -signal.SIGKILL
    assert second.port != first.port
    third = started(tmp_path)
    with third.socket() as socket:
        told = ask(socket, "hello")
        assert (told["files"], told["kept"], told["recovered"]) == (["saved.toml"], ["saved.toml"], None)
        assert "More than was saved" in ask(socket, "open", name="saved.toml")["recovered"]["text"]
        ask(socket, "recover", take=False)
        assert ask(socket, "files")["kept"] == []
    assert ended(third) == 0
    assert [*cache.iterdir()] == []
    for _ in range(100):  # what ran ends with the server that began it
        if not (left := of_the_studio(tmp_path)):
            break
        time.sleep(0.1)
    assert not left


def of_the_studio(folder: Path) -> list[str]:
    """Processes that were started with this folder's cache."""
    sign, found = f"XDG_CACHE_HOME={folder / 'cache'}".encode(), []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            if sign in path.read_bytes().split(b"\0"):
                found.append(path.parent.name)
    return found
