"""Who may ask the server: this machine alone, with the token of the address, from our own page."""

from __future__ import annotations

import hmac
from typing import Any
from urllib.parse import parse_qs

COOKIE = "rdpi_lab"
ADDRESS_NEEDED = "Open the address that `rdpi lab` printed."
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

    Parameters
    ----------
    app
        What is guarded.
    token
        Of the address.
    port
        That the server listens on.
    """

    def __init__(self, app: Any, token: str, port: int) -> None:
        self._app, self._token = app, token.encode()
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
                if scope["path"].startswith("/api") or scope["path"] == "/":
                    own.append((b"cache-control", b"no-store"))
                message = {**message, "headers": own}
            await send(message)

        if (refused := self._refused(scope, headers)) is not None:
            await _answer(guarded, *refused)
            return
        if scope["path"] == "/" and (given := _token_in(scope)) is not None:
            if hmac.compare_digest(given, self._token):
                cookie = b"%s=%s; HttpOnly; SameSite=Strict; Path=/" % (
                    COOKIE.encode(),
                    self._token,
                )
                await _answer(guarded, 303, "", (b"location", b"/"), (b"set-cookie", cookie))
            else:
                await _answer(guarded, 403, ADDRESS_NEEDED)
            return
        if not hmac.compare_digest(_cookie(headers), self._token):
            await _answer(guarded, 403, ADDRESS_NEEDED)
            return
        await self._app(scope, receive, guarded)

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


def _token_in(scope: Any) -> bytes | None:
    found = parse_qs(scope["query_string"].decode("latin-1")).get("token")
    return None if not found else found[0].encode()


def _cookie(headers: dict[bytes, bytes]) -> bytes:
    for part in headers.get(b"cookie", b"").split(b";"):
        name, _, value = part.strip().partition(b"=")
        if name == COOKIE.encode():
            return value
    return b""


async def _answer(send: Any, status: int, line: str, *headers: tuple[bytes, bytes]) -> None:
    body = f"{line}\n".encode() if line else b""
    kind = (b"content-type", b"text/plain; charset=utf-8")
    length = (b"content-length", str(len(body)).encode())
    await send(
        {"type": "http.response.start", "status": status, "headers": [kind, length, *headers]}
    )
    await send({"type": "http.response.body", "body": body})
