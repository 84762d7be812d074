"""The studio's server answers its own page with the right token, and nobody else."""

import json
import signal
import time

import pytest

pytest.importorskip("uvicorn")
from websockets.exceptions import ConnectionClosed, InvalidStatus

from gauss_bench.report.site.view import view_page
from gauss_bench.studio.security import RATE, WINDOW, Rate
from tests.faults import alive
from tests.studio import ask, ended, started


def test_the_page_wants_its_token_and_may_run_nothing_from_elsewhere(studio_server):
    code, _, headers = studio_server.get(f"/?token={studio_server.token}")
    assert code == 200
    assert studio_server.get("/")[0] == studio_server.get("/?token=guessed")[0] == 403
    policy = headers["content-security-policy"]
    assert "default-src 'self'" in policy
    assert "unsafe" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    for token in ("", "guessed", studio_server.token[:-1]):
        with pytest.raises(InvalidStatus):
            studio_server.socket(token)
    with studio_server.socket(Origin=f"http://127.0.0.1:{studio_server.port}") as socket:
        assert ask(socket, "hello")["ok"]


OTHERS = [("Host", x) for x in ("example.org", "127.0.0.1", "127.0.0.1:1", "localhost.example.org:{port}")]
OTHERS += [("Origin", x) for x in ("http://example.org", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1")]


def test_another_host_or_origin_is_refused(studio_server):
    for header, value in OTHERS:
        given = {header: value.format(port=studio_server.port)}
        for path in (f"/?token={studio_server.token}", "/page/index.html"):
            assert studio_server.get(path, **given)[0] == 403, given
        if header == "Origin":
            with pytest.raises(InvalidStatus):
                studio_server.socket(**given)


def test_no_file_but_the_pages_own_is_served(studio_server):
    for path in ("/page/../server.py", "/page/..%2fserver.py", "/page/%2e%2e/server.py", "/page//etc/passwd", "/etc/passwd"):
        code, content, _ = studio_server.get(path)
        assert code == 404, path
        assert "import" not in content, path


def test_the_page_of_links_needs_no_token_and_may_run_its_own_script_alone(studio_server):
    code, body, headers = studio_server.get("/view.html")
    page, policy = view_page()
    assert (code, body) == (200, page)
    assert headers["content-security-policy"] == f"{policy}; frame-ancestors 'none'"
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "connect-src" not in policy
    assert headers["x-content-type-options"] == "nosniff"


def test_what_is_no_message_gets_a_sentence_and_what_is_too_large_ends_its_socket(studio_server):
    with studio_server.socket() as socket:
        for sent in ("", "{", "[1]", '{"do": 3}', '{"do": "nothing"}', '{"do": "open", "text": NaN}', "[" * 100_000):
            socket.send(sent)
            found = json.loads(socket.recv(20))
            assert not found["ok"]
            assert found["error"]["text"]
        assert ask(socket, "hello")["ok"]
        socket.send("x" * (3 << 20))
        with pytest.raises(ConnectionClosed):  # this socket alone
            socket.recv(20)
    with studio_server.socket() as socket:
        assert ask(socket, "hello")["ok"]


def test_messages_are_answered_no_faster_than_their_rate():
    rate = Rate()
    assert all(rate.allows(0.0) for _ in range(RATE))
    assert not rate.allows(0.5)
    assert rate.allows(WINDOW + 0.01)


@pytest.mark.long
def test_a_server_that_searches_for_singular_positions_ends_cleanly(tmp_path):
    running = started(tmp_path)
    with running.socket() as socket:
        for name in ("eight_bar", "four_bar"):
            ask(socket, "template", name=name)
            assert ask(socket, "motion", samples=4)["ok"]
    assert ended(running) == 0


@pytest.mark.long
def test_what_was_drawn_outlives_a_killed_server_whatever_its_port_and_nothing_a_clean_end(tmp_path):
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
        if not (left := alive(f"XDG_CACHE_HOME={tmp_path / 'cache'}\0".encode())):
            break
        time.sleep(0.1)
    assert not left
