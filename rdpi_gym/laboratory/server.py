"""The server of the laboratory: its routes, and how it is started."""

from __future__ import annotations

import asyncio
import hmac
import json
import os
import secrets
import socket
import sys
import threading
import traceback
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from rdpi_gym.laboratory.session_jobs import Events
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import BINARY, NO_LINK, parse_json

if TYPE_CHECKING:
    from rdpi_gym.laboratory.lab import Lab

HOST = "127.0.0.1"
PAGE = Path(__file__).parent / "page"
MOST_JSON_BYTES = 2**20
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
Endpoint = Callable[["Server", Request], Awaitable[Any]]


@dataclass(frozen=True)
class Place:
    """Address of a server: a bound socket, the secret of the printed address, that of a browser's first one."""

    socket: socket.socket
    token: str
    ticket: str

    @property
    def port(self) -> int:
        """Number of the port."""
        return int(self.socket.getsockname()[1])

    # a secret stands behind the #, which no browser sends or keeps in its history

    @property
    def address(self) -> str:
        """Address that is printed."""
        return f"http://{HOST}:{self.port}/#token={self.token}"

    @property
    def first_address(self) -> str:
        """Address that a browser is started with, where others on this machine may read it."""
        return f"http://{HOST}:{self.port}/#ticket={self.ticket}"


def bind(port: int = 0) -> Place:
    """Take a port of the loopback address."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if os.name == "posix":
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((HOST, port))
        bound.listen()  # a browser that is faster than the server waits
    except (OSError, OverflowError) as error:
        bound.close()
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"--port {port} cannot be taken ({reason}); give another, or leave it out"
        ) from error
    return Place(bound, secrets.token_urlsafe(24), secrets.token_urlsafe(24))


class Guard:
    """An ASGI application behind the rules of the laboratory.

    The files of the page are for everybody on this machine. Whatever else is asked carries the token
    in a header, which no other page and no other server can send or receive: cookies go to
    every port of an address. The `ticket` of the address that a browser is started with, where every
    user of the machine may read it, is good once, for the `token`.
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


class _Uvicorn(uvicorn.Server):
    """A server whose listeners are let go when it is asked to end: they would hold it up."""

    def __init__(self, config: uvicorn.Config, events: Events) -> None:
        super().__init__(config)
        self._events = events

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._events.close()
        await super().shutdown(sockets)


def _answering(answer: Endpoint) -> Endpoint:
    """Return a route that sends what is answered as JSON, and what is refused as one line."""

    @wraps(answer)
    async def endpoint(self: Server, request: Request) -> Response:
        try:
            found = await answer(self, request)
        except InputError as error:
            return JSONResponse({"problem": error.fact}, 400)
        if isinstance(found, Response):
            return found
        body = json.dumps(found, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        return Response(body, media_type="application/json")

    return endpoint


class Server:
    """A server of one session; the page is there at once, the library is loaded behind it.

    `sources` are data to begin with, `processes` those among which a ranking is divided; -1: one a core.
    """

    def __init__(
        self, place: Place, folder: Path, sources: Sequence[Path] = (), processes: int = -1
    ) -> None:
        self.place = place
        self._folder, self._sources = folder, sources
        self._processes = processes if processes > 0 else os.cpu_count() or 1
        self._events = Events()
        self._lab: asyncio.Future[Lab] | None = None
        public = {"/", "/plotly.js", *(f"/{file.name}" for file in PAGE.iterdir())}
        config = uvicorn.Config(
            Guard(self._app(), place.token, place.ticket, place.port, public),
            log_level="warning",
            timeout_graceful_shutdown=1,
            server_header=False,
            lifespan="off",
        )
        self._uvicorn = _Uvicorn(config, self._events)

    async def run(self) -> None:
        """Serve until the process is asked to end."""
        opening = asyncio.get_running_loop().create_task(self._open())
        try:
            await self._uvicorn.serve(sockets=[self.place.socket])
        finally:
            opening.cancel()
            if self._lab is not None and self._lab.done() and not self._lab.exception():
                await asyncio.to_thread(self._lab.result().close)

    def stop(self) -> None:
        """Ask the server to end."""
        self._uvicorn.should_exit = True

    async def _open(self) -> None:
        """Load the library and the session while the page is shown already."""
        self._lab = asyncio.get_running_loop().create_future()
        try:
            lab = await asyncio.to_thread(_lab, self._folder, self._events, self._processes)
        except Exception as error:
            if not isinstance(error, InputError):
                traceback.print_exc()
            self._lab.set_exception(error)
            print(f"rdpi lab: {error}", file=sys.stderr, flush=True)
            return
        self._events.state = lab.state
        lab.start()
        self._lab.set_result(lab)
        if self._sources:
            try:
                await lab.bring(list(self._sources))
            except InputError as error:
                lab.problem = error.fact
                self._events.changed()

    async def _ready(self) -> Lab:
        while self._lab is None:
            await asyncio.sleep(0.01)
        return await asyncio.shield(self._lab)

    # routes

    def _app(self) -> Starlette:
        routes = [
            Route("/", self._page),
            Route("/plotly.js", self._plotly),
            Route("/api/state", self._state),
            Route("/api/events", self._listen),
            Route("/api/take/{name}", self._take),
            Route("/api/files/{name:path}", self._file, methods=["PUT", "DELETE"]),
            Route("/api/{question}", self._question),
            Route("/api/{action}", self._action, methods=["POST"]),
            Mount("/", StaticFiles(directory=PAGE, check_dir=False)),
        ]
        return Starlette(routes=routes, exception_handlers={Exception: _failed})

    async def _page(self, request: Request) -> Response:
        return FileResponse(PAGE / "index.html")

    async def _plotly(self, request: Request) -> Response:
        from importlib.util import find_spec

        spec = find_spec("plotly")
        assert spec is not None
        assert spec.origin is not None
        bundle = Path(spec.origin).parent / "package_data" / "plotly.min.js"
        return FileResponse(bundle, headers={"cache-control": "max-age=86400"})

    @_answering
    async def _state(self, request: Request) -> Any:
        return (await self._ready()).state()

    @_answering
    async def _listen(self, request: Request) -> Any:
        await self._ready()
        return StreamingResponse(self._events.listen(), media_type="text/event-stream")

    @_answering
    async def _question(self, request: Request) -> Any:
        lab = await self._ready()
        from rdpi_gym.laboratory.actions import QUESTIONS

        question = QUESTIONS.get(request.path_params["question"])
        if question is None:
            raise HTTPException(404)
        return await asyncio.to_thread(question, lab, request.query_params)

    @_answering
    async def _take(self, request: Request) -> Any:
        name, lab = request.path_params["name"], await self._ready()
        from rdpi_gym.laboratory.actions import take

        media_type, text = await asyncio.to_thread(take, lab, name, request.query_params)
        kept = {"content-disposition": f'attachment; filename="{name}"'}
        return Response(text.encode(), media_type=media_type, headers=kept)

    @_answering
    async def _action(self, request: Request) -> Any:
        body, lab = await _json(request), await self._ready()
        from rdpi_gym.laboratory.actions import ACTIONS

        name = request.path_params["action"]
        if name not in ACTIONS:
            raise HTTPException(404)
        if name == "parameter" and not body.get("commit"):
            return await ACTIONS[name](lab, body)
        async with lab.acting:
            return await ACTIONS[name](lab, body)

    @_answering
    async def _file(self, request: Request) -> Any:
        name, lab = request.path_params["name"], await self._ready()
        if request.method == "DELETE":
            async with lab.acting:
                return await lab.delete_file(name)
        return await lab.put_file(name, partial(_received, request))


def _lab(folder: Path, events: Events, processes: int) -> Lab:
    from rdpi_gym.laboratory.lab import Lab

    return Lab(folder, events, processes)


async def _failed(request: Request, error: Exception) -> Response:
    traceback.print_exception(error)
    line = "This failed in a way that nobody foresaw; what happened stands where `rdpi lab` runs."
    return JSONResponse({"problem": line}, 500)


async def _json(request: Request) -> Mapping[str, Any]:
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > MOST_JSON_BYTES:
            raise InputError(
                f"the request is larger than {MOST_JSON_BYTES // 2**20} MiB; send less"
            )
    try:
        found = parse_json((body or b"{}").decode(), "the request")
    except ValueError:
        raise InputError("the request is not JSON") from None
    if not isinstance(found, dict):
        raise InputError('the request is no JSON object; give one, as in {"effect": "creep"}')
    return found


async def _received(request: Request, path: Path) -> None:
    """Write what is sent to a file, up to what is allowed."""
    from rdpi_gym.laboratory.data_import import MOST_BYTES

    size = 0
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | NO_LINK | BINARY), "wb") as stream:
            async for part in request.stream():
                size += len(part)
                if size > MOST_BYTES:
                    raise InputError(
                        f"the file is larger than {MOST_BYTES // 2**20} MiB; give a smaller one"
                    )
                await asyncio.to_thread(stream.write, part)
    except ClientDisconnect:
        raise InputError("the file did not arrive whole; send it again") from None
    except OSError as error:
        raise InputError(
            f"the file cannot be written ({error.strerror}); free some space"
        ) from error


def in_thread(server: Server) -> threading.Thread:
    """Start a server in a thread of its own, as a notebook does."""
    thread = threading.Thread(target=lambda: asyncio.run(server.run()), daemon=True)
    thread.start()
    return thread
