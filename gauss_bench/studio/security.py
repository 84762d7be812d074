"""Access to the studio: only pages that it served itself, on this machine, with the token of its address."""

import hmac
import secrets
import time
from collections import deque
from dataclasses import dataclass, field

LARGEST = 2 << 20  # bytes of a message
RATE, WINDOW = 300, 1.0  # messages in so many seconds that are answered: drags send some 60 a second
SOCKETS = 8  # pages at once
UNREAD = 64  # messages that wait for a page to read them; one that reads none is let go
BESIDE = 4  # long requests of a page that go on while it asks others
DEEPEST = 40  # levels of a message
WAITING = 128  # connections that ask for nothing; beyond them the oldest is closed
ASKING = 64  # that are being answered; beyond them a request gets 503


def headers(port: int) -> dict[str, str]:
    """The headers of every answer: nothing from elsewhere runs, frames or is guessed."""
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
    """The demands on a request: the address of this server as Host, its own or no Origin, and the token."""

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    @property
    def hosts(self) -> frozenset[str]:
        return frozenset(f"{name}:{self.port}" for name in ("127.0.0.1", "localhost"))

    def refusal(self, host: str | None, origin: str | None) -> str:
        """The reason why a request is refused by where it comes from; "" where it is not."""
        if host not in self.hosts:
            return "the studio answers to its own address alone"
        if origin is not None and origin not in {f"http://{x}" for x in self.hosts}:
            return "the studio answers to its own page alone"
        return ""

    def knows(self, token: str | None) -> bool:
        """Tell whether this is the token of the address."""
        return token is not None and hmac.compare_digest(token.encode("utf-8", "replace"), self.token.encode())


class Rate:
    """The number of messages that came lately."""

    def __init__(self) -> None:
        self.times: deque[float] = deque()

    def allows(self, now: float | None = None) -> bool:
        """Count one more; False where there are too many."""
        now = time.monotonic() if now is None else now
        while self.times and self.times[0] <= now - WINDOW:
            self.times.popleft()
        if len(self.times) >= RATE:
            return False
        self.times.append(now)
        return True
