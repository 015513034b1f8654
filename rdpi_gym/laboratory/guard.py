"""Access control of the server: this machine alone, with the token of the address, from our own page."""

from __future__ import annotations

import hmac
import json
from collections.abc import Collection
from typing import Any

ADDRESS_NEEDED = "Open the address that `rdpi lab` printed."
TICKET_USED = (
    "This address has been opened already. If that was not you, end the laboratory: somebody else on this "
    "machine has opened it. Else open the address that `rdpi lab` printed."
)
_KINDS = (b"application/json", b"application/octet-stream")
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self'; font-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = (
    (b"content-security-policy", _POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
)


class Guard:
    """An ASGI application behind the rules of the laboratory.

    The files of the page are for everybody on this machine. Whatever else is asked carries the token
    in a header, which no other page and no other server can send or receive: cookies go to
    every port of an address.

    Parameters
    ----------
    app
        The application.
    token
        Secret of the address that is printed, good as long as the server runs.
    ticket
        Secret of the address that a browser is started with, where every user of the machine may
        read it; good once, for the token.
    port
        Port that the server listens on.
    public
        Paths of the page's own files.
    """

    def __init__(
        self, app: Any, token: str, ticket: str, port: int, public: Collection[str]
    ) -> None:
        self._app, self._token, self._ticket, self._public = app, token, ticket, public
        self._hosts = {f"{name}:{port}".encode() for name in ("127.0.0.1", "localhost")}

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Let a request through, or answer it with 403 or 415 and one line."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        headers = dict(scope["headers"])

        async def guarded(message: Any) -> None:
            if message["type"] == "http.response.start":
                own = [*message["headers"], *_HEADERS]
                if scope["path"] not in self._public or scope["path"] == "/":
                    own.append((b"cache-control", b"no-store"))
                message = {**message, "headers": own}
            await send(message)

        if (refused := self._refused(scope, headers)) is not None:
            await _answer(guarded, *refused)
            return
        if scope["path"] not in self._public:
            given = headers.get(b"authorization", b"")
            if scope["path"] == "/api/token":
                await self._exchange(given, guarded)
                return
            if not hmac.compare_digest(given, f"Bearer {self._token}".encode()):
                await _answer(guarded, 403, ADDRESS_NEEDED)
                return
        await self._app(scope, receive, guarded)

    async def _exchange(self, given: bytes, send: Any) -> None:
        """Answer the first who shows the ticket with the token."""
        if self._ticket and hmac.compare_digest(given, f"Ticket {self._ticket}".encode()):
            self._ticket = ""
            await _answer(send, 200, json.dumps({"token": self._token}), b"application/json")
        else:
            await _answer(send, 403, json.dumps({"problem": TICKET_USED}), b"application/json")

    def _refused(self, scope: Any, headers: dict[bytes, bytes]) -> tuple[int, str] | None:
        """Return why a request is refused whoever sends it; None where it is not."""
        host, origin = headers.get(b"host", b""), headers.get(b"origin")
        if host not in self._hosts:
            return 403, "This server answers at 127.0.0.1 and localhost alone."
        if origin is not None and origin.removeprefix(b"http://") not in self._hosts:
            return 403, "Another page may not ask this server."
        if scope["method"] in ("POST", "PUT"):
            kind = headers.get(b"content-type", b"").split(b";")[0].strip().lower()
            if kind not in _KINDS:
                return 415, "Send application/json or application/octet-stream."
        return None


async def _answer(
    send: Any, status: int, line: str, kind: bytes = b"text/plain; charset=utf-8"
) -> None:
    body = f"{line}\n".encode()
    headers = [(b"content-type", kind), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
