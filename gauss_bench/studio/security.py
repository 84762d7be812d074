"""Access control: the studio answers only its own page on this machine, if the page knows the token of the studio's address."""

import hmac
import secrets
import time
from collections import deque
from dataclasses import dataclass, field

LARGEST = 2 << 20  # [bytes] largest message
RATE, WINDOW = 300, 1.0  # largest number of messages of a page that are answered in WINDOW [s]; a drag sends about 60 a second
SOCKETS = 8  # largest number of pages that are connected at once
UNREAD = 64  # longest queue of messages to a page; a page is disconnected if its queue is full
BESIDE = 4  # largest number of long requests of a page that run beside its other requests
DEEPEST = 40  # largest number of levels of nesting in a message
WAITING = 128  # largest number of idle connections; the oldest one is closed if there are more
ASKING = 64  # largest number of connections that are answered at once; a request on another one gets the status 503


def headers(port: int) -> dict[str, str]:
    """Return the headers of every response, which forbid foreign scripts, framing and guesses of content types."""
    sockets = f"ws://127.0.0.1:{port} ws://localhost:{port}"
    policy = (
        f"default-src 'self'; connect-src 'self' {sockets}; img-src 'self' data: blob:; media-src 'self' blob:; object-src 'none'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return {
        "content-security-policy": policy,
        "x-content-type-options": "nosniff",
        "x-frame-options": "DENY",
        "referrer-policy": "no-referrer",
        "cross-origin-opener-policy": "same-origin",
        "cross-origin-resource-policy": "same-origin",
        "cache-control": "no-store",
    }


@dataclass(frozen=True)
class Guard:
    """The conditions that a request must meet.

    The header Host must be the address of this server. If the request has a header Origin, it must be the origin of this server.
    The request must have the token.

    Attributes:
        port: port of the server.
        token: secret text that only the address printed by the studio contains.
    """

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    @property
    def hosts(self) -> frozenset[str]:
        """The values of Host that name this server."""
        return frozenset(f"{name}:{self.port}" for name in ("127.0.0.1", "localhost"))

    def refusal(self, host: str | None, origin: str | None) -> str:
        """Return the reason to refuse a request with these headers; empty if there is none."""
        if host not in self.hosts:
            return "the studio answers only requests to its own address"
        if origin is not None and origin not in {f"http://{x}" for x in self.hosts}:
            return "the studio answers only requests from its own page"
        return ""

    def knows(self, token: str | None) -> bool:
        """Tell whether a token is the right one, in a time from which the right token cannot be guessed."""
        return token is not None and hmac.compare_digest(token.encode("utf-8", "replace"), self.token.encode())


class Rate:
    """A limit on the number of messages in a sliding window of time."""

    def __init__(self) -> None:
        self.times: deque[float] = deque()

    def allows(self, now: float | None = None) -> bool:
        """Count a message at the time `now` [s], by default the present time, and return True.

        If RATE messages have been counted in the last WINDOW seconds, return False without counting the message.
        """
        now = time.monotonic() if now is None else now
        while self.times and self.times[0] <= now - WINDOW:
            self.times.popleft()
        if len(self.times) >= RATE:
            return False
        self.times.append(now)
        return True
