"""Serve the studio to this machine: the page, the page's files, and one socket for each page that is open in a browser.

Threads answer requests. Requests of one page are answered in their order, except long ones. Changes by different pages are made one
after the other.
"""

import asyncio
import contextlib
import json
import signal
import socket
import sys
import threading
import webbrowser
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import quote

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol

from gauss_bench.api.telling import plain
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.linkage.load import find
from gauss_bench.linkage.load import read as read_file
from gauss_bench.report.site.view import VIEW, view_page
from gauss_bench.studio import files
from gauss_bench.studio.autosave import remove_orphans
from gauss_bench.studio.dynamics import list_engines
from gauss_bench.studio.messages import Refused
from gauss_bench.studio.requests import APART, answer
from gauss_bench.studio.security import ASKING, BESIDE, LARGEST, SOCKETS, UNREAD, WAITING, Guard, Rate, headers
from gauss_bench.studio.session import Session

PAUSE = 0.02  # [s] time until the rate of a page that sends too fast is tested again
SWITCH = 5e-4  # [s] interval of Python's thread switching, short because each frame of a drag passes three threads
PAGE = Path(__file__).parent / "page"
Unread = asyncio.Queue[str]  # messages to a page that it has not read yet


class Guarded:
    """Middleware that refuses requests that do not come from the studio's own page."""

    def __init__(self, app: ASGIApp, guard: Guard):
        """Guard the application `app` by the conditions of `guard`."""
        self.app, self.guard, self.headers = app, guard, headers(guard.port)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on to the application, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        received = Headers(scope=scope)
        hosts, origins = received.getlist("host"), received.getlist("origin")
        is_single = len(hosts) == 1 and len(origins) <= 1
        refusal = self.guard.refusal(hosts[0] if is_single else None, origins[0] if origins else None)

        async def send_guarded(message: Message) -> None:
            """Send a response with the security headers."""
            if message["type"] == "http.response.start":
                sent = MutableHeaders(scope=message)
                for name, value in self.headers.items():
                    sent.setdefault(name, value)
            await send(message)

        if not refusal:
            await self.app(scope, receive, send_guarded)
        elif scope["type"] == "http":
            await PlainTextResponse(refusal, 403, self.headers)(scope, receive, send)
        else:
            await WebSocket(scope, receive, send).close(1008)


class Connection(H11Protocol):
    """A connection to the server. If more than WAITING connections are idle when it opens, the oldest idle one is closed."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Register this connection, and close the oldest idle one if there are too many."""
        super().connection_made(transport)
        self.since = self.loop.time()
        idle = [x for x in self.connections if isinstance(x, Connection) and x.is_idle()]
        if len(idle) > WAITING:
            oldest = min(idle, key=lambda x: x.since)
            # the event loop closes the connection later; until then uvicorn would count it if it stayed in `connections`
            self.connections.discard(oldest)
            oldest.transport.abort()

    def is_idle(self) -> bool:
        """Tell whether the connection is idle: no complete request has arrived, or its response has been sent."""
        return (self.cycle is None or self.cycle.response_complete) and not self.transport.get_write_buffer_size()


class Studio:
    """The web application of one session.

    Attributes:
        session: the open document.
        guard: the conditions that a request must meet.
        pages: queue of messages to a connected page -> task that serves the page.
        revision: last revision of the drawing that has been sent to all pages.
        loop: event loop of the server; None before the server runs.
        app: the guarded application that the server runs.
    """

    def __init__(self, session: Session, guard: Guard):
        """Set up the application with its routes."""
        self.session, self.guard = session, guard
        self.pages: dict[Unread, asyncio.Task[Any] | None] = {}
        self.revision = session.revision
        self.loop: asyncio.AbstractEventLoop | None = None
        routes = [
            Route("/", self.index),
            Route("/page/{name}", self.file),
            Route(f"/{VIEW}", self.view),
            WebSocketRoute("/socket", self.socket),
        ]
        self.app = Guarded(Starlette(routes=routes, lifespan=self._lifespan), guard)

    @contextlib.asynccontextmanager
    async def _lifespan(self, app: Starlette) -> AsyncIterator[None]:
        """Prepare the event loop when the server starts, and stop all jobs when it ends."""
        self.loop = asyncio.get_running_loop()
        self.loop.set_default_executor(ThreadPoolExecutor(SOCKETS * (BESIDE + 1)))  # a thread for every request that may run
        yield
        self.session.jobs.stop_all()

    async def index(self, request: Request) -> Response:
        """Serve the page to a request with the token."""
        if not self.guard.knows(request.query_params.get("token")):
            return PlainTextResponse("the token is missing or wrong: open the address that the studio printed", 403)
        return FileResponse(PAGE / "index.html")

    async def file(self, request: Request) -> Response:
        """Serve a file of the page."""
        path = PAGE / Path(request.path_params["name"]).name
        return FileResponse(path) if path.is_file() else PlainTextResponse("there is no such file", 404)

    async def view(self, request: Request) -> Response:
        """Serve the page that shows a linkage from a URL; it needs no token, because it gets nothing of the drawing."""
        page, policy = view_page()
        return HTMLResponse(page, headers={"content-security-policy": f"{policy}; frame-ancestors 'none'"})

    async def socket(self, socket: WebSocket) -> None:
        """Serve a page until it disconnects: answer its messages in order, and long requests beside them."""
        if not self.guard.knows(socket.query_params.get("token")) or len(self.pages) >= SOCKETS:
            await socket.close(1008)  # policy violation
            return
        page, rate = Unread(UNREAD), Rate()
        self.pages[page] = asyncio.current_task()
        tasks: set[asyncio.Task[None]] = set()  # the sender, and long requests beside it
        try:
            await socket.accept()
            tasks.add(asyncio.create_task(self._send(socket, page)))
            while True:
                message = parse_message(await socket.receive_text())
                while not rate.allows():  # slow down a page that sends too fast
                    await asyncio.sleep(PAUSE)
                answering = self._answer(message, page)
                if message.get("do") not in APART:
                    await answering
                    continue
                while len(tasks) > BESIDE:
                    await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
                task = asyncio.create_task(answering)
                tasks.add(task)
                task.add_done_callback(tasks.discard)
        except (WebSocketDisconnect, KeyError, RuntimeError, asyncio.CancelledError):
            pass  # the page has disconnected, sent bytes or not read its messages, or the studio ends
        finally:
            del self.pages[page]
            for task in tasks:
                task.cancel()
            with contextlib.suppress(RuntimeError, WebSocketDisconnect, asyncio.TimeoutError):
                await asyncio.wait_for(socket.close(1003), 1.0)  # unsupported data: the reason if the page sent bytes

    async def _send(self, socket: WebSocket, page: Unread) -> None:
        """Send the queued messages of a page until it disconnects."""
        with contextlib.suppress(RuntimeError, WebSocketDisconnect, OSError):
            while True:
                await socket.send_text(await page.get())

    async def _answer(self, message: dict[str, Any], page: Unread) -> None:
        """Answer a page's message, and send the new scene to the other pages if the drawing has changed."""
        try:
            reply = NO_MESSAGE if message is NO_MESSAGE else await asyncio.to_thread(answer, self.session, message)
        except RuntimeError:  # the studio ends
            return
        await page.put(as_json(reply))
        scene = reply.get("scene")
        if scene is not None and scene["revision"] > self.revision:
            self.revision = scene["revision"]
            self._tell_all(as_json({"event": "scene", "scene": scene}), page)

    def tell(self, event: dict[str, Any]) -> None:
        """Send an event to every page. Every thread may call this function."""
        if self.loop is not None and not self.loop.is_closed():
            text = as_json(event)
            with contextlib.suppress(RuntimeError):  # the loop has ended meanwhile
                self.loop.call_soon_threadsafe(self._tell_all, text)

    def _tell_all(self, text: str, sender: Unread | None = None) -> None:
        """Queue a message for all pages except the page `sender`, and disconnect pages whose queue is full."""
        for page, task in self.pages.items():
            if page is sender:
                continue
            if not page.full():
                page.put_nowait(text)
            elif task is not None:
                task.cancel()


NO_MESSAGE: dict[str, Any] = {
    "id": None,
    "ok": False,
    "error": {"text": "a message is an object of JSON", "where": (), "field": ""},
}


def parse_message(text: str) -> dict[str, Any]:
    """Return the message that a text contains; `NO_MESSAGE` if the text is not a JSON object."""
    try:
        message = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        return NO_MESSAGE
    return message if isinstance(message, dict) else NO_MESSAGE


def as_json(item: dict[str, Any]) -> str:
    """Return an object, which may contain numpy arrays, as a text in JSON; NaN and infinite numbers become null."""
    return json.dumps(plain(item), allow_nan=False)


def _refuse_constant(word: str) -> float:
    """Raise ValueError for NaN and Infinity, which Python's reader accepts and JSON does not have."""
    raise ValueError(f"{word} is no number")


def open_session(linkage: str | None, folder: Path) -> Session:
    """Return a session with the linkage of a name or file, or with an empty drawing for None.

    The working folder is the folder of the file; without a file it is `folder`.

    Raises:
        LinkageError, Refused: the linkage cannot be read.
    """
    if linkage is None:
        return Session(folder)
    path = find(linkage)
    if linkage not in files.find_templates():
        read_file(path)  # if there is no such file or built-in linkage, this error lists the built-in linkages
    if path.suffix == ".toml" and path == Path(linkage):  # the path of a file: work in the folder of this file
        folder, linkage = path.resolve().parent, path.name
    session = Session(folder)
    text, own = files.open_document(session.folder, linkage)  # own: None for a template
    session.open(text, own, is_template=own is None)
    return session


def serve(linkage: str | None, folder: Path, port: int, browser: bool, tell: Callable[[str], object]) -> None:
    """Serve the studio until it is interrupted; port 0 is any free port.

    Raises:
        ExchangeError: the port is not available, or the file to open is refused.
        LinkageError: the linkage to open cannot be read.
    """
    try:
        session = open_session(linkage, folder)
    except Refused as error:
        raise ExchangeError(f"{linkage}: {error}") from error
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind(("127.0.0.1", port))
        listening.listen()  # a browser may connect as soon as the address is printed
    except (OSError, OverflowError) as error:
        listening.close()
        raise ExchangeError(f"--port {port}: is not available: {error}") from error
    remove_orphans()  # temporary folders of studios that were killed
    sys.setswitchinterval(SWITCH)
    guard = Guard(int(listening.getsockname()[1]))
    studio = Studio(session, guard)
    session.tell = studio.tell
    address = f"http://127.0.0.1:{guard.port}/?token={quote(guard.token)}"
    tell(f"the studio is at {address}")
    tell("press Ctrl-C to end it")
    config = uvicorn.Config(
        studio.app,
        http=Connection,
        log_level="error",
        access_log=False,
        server_header=False,
        ws="websockets-sansio",
        ws_max_size=LARGEST,
        ws_ping_interval=20.0,
        ws_ping_timeout=60.0,
        timeout_graceful_shutdown=2,
        limit_concurrency=WAITING + ASKING,  # idle connections, and those with a request in progress
    )
    # the page requests the engines first: find them in advance, in a thread that the interpreter waits for when it ends
    threading.Thread(target=list_engines).start()
    if browser:
        with contextlib.suppress(webbrowser.Error):
            webbrowser.open(address)
    with contextlib.suppress(KeyboardInterrupt), listening:
        signal.signal(signal.SIGHUP, signal.default_int_handler)  # a closed terminal ends the studio as Ctrl-C does
        uvicorn.Server(config).run(sockets=[listening])
    is_unsaved = session.is_unsaved
    with contextlib.suppress(KeyboardInterrupt):  # a second Ctrl-C
        session.close()
    if is_unsaved:
        tell("unsaved changes are kept, and are offered when the studio opens the drawing again")
