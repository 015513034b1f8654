"""The server of the laboratory: its routes, and how it is started."""

from __future__ import annotations

import asyncio
import json
import os
import secrets
import socket
import sys
import threading
import traceback
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from rdpi_gym.laboratory.guard import Guard
from rdpi_gym.laboratory.session_jobs import Events
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import BINARY, NO_LINK, parse_json
from rdpi_gym.support.words import quoted

if TYPE_CHECKING:
    from rdpi_gym.laboratory.lab import Lab
    from rdpi_gym.measurement import Record
    from rdpi_gym.support.arrays import Array

HOST = "127.0.0.1"
PAGE = Path(__file__).parent / "page"
MOST_JSON_BYTES = 2**20
Action = Callable[["Lab", Mapping[str, Any]], Awaitable[dict[str, Any]]]


@dataclass(frozen=True)
class Place:
    """Address of a server.

    Parameters
    ----------
    socket
        Bound, not listening yet.
    token
        Secret of the address that is printed.
    ticket
        Secret of the address that a browser is started with; good once.
    """

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


class _Uvicorn(uvicorn.Server):
    """A server whose listeners are let go when it is asked to end: they would hold it up."""

    def __init__(self, config: uvicorn.Config, events: Events) -> None:
        super().__init__(config)
        self._events = events

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._events.close()
        await super().shutdown(sockets)


class Server:
    """A server of one session; the page is there at once, the library is loaded behind it.

    Parameters
    ----------
    place
        Where it listens.
    folder
        Of the session.
    sources
        Data files and folders to begin with.
    processes
        Among which a ranking divides its candidates; -1: one a core.
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
        actions = {path: self._posted(path, action) for path, action in _ACTIONS.items()}
        routes = [
            Route("/", self._page),
            Route("/plotly.js", self._plotly),
            Route("/api/state", self._told(_state)),
            Route("/api/events", self._listen),
            Route("/api/examples", self._told(_examples)),
            Route("/api/preview", self._told(_preview)),
            Route("/api/trace", self._told(_trace)),
            Route("/api/views", self._told(_views)),
            Route("/api/brush", self._told(_brush)),
            Route("/api/take/{name}", self._take),
            Route("/api/files/{name:path}", self._file, methods=["PUT", "DELETE"]),
            *(Route(f"/api/{path}", endpoint, methods=["POST"]) for path, endpoint in actions.items()),
            Mount("/", StaticFiles(directory=PAGE, check_dir=False)),
        ]  # fmt: skip
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

    async def _listen(self, request: Request) -> Response:
        try:
            await self._ready()
        except InputError as error:
            return JSONResponse({"problem": error.fact}, 400)
        return StreamingResponse(self._events.listen(), media_type="text/event-stream")

    def _told(self, tell: Callable[[Lab, Mapping[str, str]], Any]) -> Any:
        """Answer a question in a thread."""

        async def endpoint(request: Request) -> Response:
            async def answer() -> Any:
                lab = await self._ready()
                if tell is _state:
                    return lab.state()
                return await asyncio.to_thread(tell, lab, request.query_params)

            return await _answered(answer)

        return endpoint

    def _posted(self, path: str, action: Action) -> Any:
        async def endpoint(request: Request) -> Response:
            async def answer() -> Any:
                said, lab = await _json(request), await self._ready()
                if path == "parameter" and not said.get("commit"):
                    return await action(lab, said)
                async with lab.acting:
                    return await action(lab, said)

            return await _answered(answer)

        return endpoint

    async def _take(self, request: Request) -> Response:
        from rdpi_gym.laboratory.downloads import download

        rate = request.query_params.get("rate_hz")
        try:
            lab = await self._ready()
            rate_hz = None if rate is None else _number(request.query_params, "rate_hz")
            taken = await asyncio.to_thread(
                download, lab.session, request.path_params["name"], rate_hz
            )
        except InputError as error:
            return JSONResponse({"problem": error.fact}, 400)
        return Response(
            taken.content,
            media_type=taken.media_type,
            headers={"content-disposition": f'attachment; filename="{taken.name}"'},
        )

    async def _file(self, request: Request) -> Response:
        name = request.path_params["name"]

        async def answer() -> Any:
            lab = await self._ready()
            if request.method == "DELETE":
                async with lab.acting:
                    return await lab.delete_file(name)
            return await lab.put_file(name, partial(_received, request))

        return await _answered(answer)


def _lab(folder: Path, events: Events, processes: int) -> Lab:
    from rdpi_gym.laboratory.lab import Lab

    return Lab(folder, events, processes)


async def _answered(answer: Callable[[], Awaitable[Any]]) -> Response:
    try:
        found = await answer()
    except InputError as error:
        return JSONResponse({"problem": error.fact}, 400)
    body = json.dumps(found, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return Response(body, media_type="application/json")


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


# what a request says


def _text(said: Mapping[str, Any], key: str) -> str:
    value = said.get(key)
    if not isinstance(value, str):
        raise InputError(f"{key} is {quoted(value)}; give a text")
    return value


def _number(said: Mapping[str, Any], key: str) -> float:
    value = said.get(key)
    try:
        found = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{key} is {quoted(value)}; give a number") from None
    if found != found or abs(found) == float("inf"):
        raise InputError(f"{key} is {quoted(value)}; give a finite number")
    return found


def _optional(said: Mapping[str, Any], key: str) -> float | None:
    return None if said.get(key) in (None, "") else _number(said, key)


# questions, answered in threads


def _state(lab: Lab, asked: Mapping[str, str]) -> Any:
    return lab.state()


def _examples(lab: Lab, asked: Mapping[str, str]) -> Any:
    from rdpi_gym.laboratory.examples import examples

    return [example.to_dict() for example in examples()]


def _preview(lab: Lab, asked: Mapping[str, str]) -> Any:
    from rdpi_gym.laboratory.data_import import preview

    return preview(
        lab.session.data_folder, lab.session.files, _text(asked, "file"), asked.get("separator")
    )


def _trace(lab: Lab, asked: Mapping[str, str]) -> Any:
    from rdpi_gym.laboratory import views

    data = lab.need_data()
    record = views.record_named(data, _text(asked, "record"))
    plant = lab.plant_shown(asked.get("step") or None)
    effect = asked.get("effect")
    other = lab.plant_with(effect, asked.get("step") or None) if effect else None
    part = views.stretch(record, _optional(asked, "from_s"), _optional(asked, "to_s"))
    points = int(_optional(asked, "points") or views.POINTS)
    return views.trace(
        record,
        None if plant is None else lab.displacement(plant, record.name),
        None if other is None else lab.displacement(other, record.name),
        part,
        min(max(points, 100), 20_000),
    )


def _views(lab: Lab, asked: Mapping[str, str]) -> Any:
    from rdpi_gym.laboratory.views import residual_views

    record, model_um = _modelled(lab, asked)
    return residual_views(record, model_um, lab.noise_um())


def _brush(lab: Lab, asked: Mapping[str, str]) -> Any:
    from rdpi_gym.laboratory.views import brushed

    record, model_um = _modelled(lab, asked)
    ends = (_optional(asked, "from_s"), _optional(asked, "to_s"))
    return brushed(record, model_um, asked.get("by") or "time", *ends)


def _modelled(lab: Lab, asked: Mapping[str, str]) -> tuple[Record, Array]:
    """Return a record, and what the model of a step makes of it (µm)."""
    from rdpi_gym.laboratory.views import record_named

    record = record_named(lab.need_data(), _text(asked, "record"))
    plant = lab.plant_shown(asked.get("step") or None)
    if plant is None:
        raise InputError("there is no model yet; wait for the base model")
    return record, lab.displacement(plant, record.name)


# actions, called in the loop


async def _parameter(lab: Lab, said: Mapping[str, Any]) -> dict[str, Any]:
    effect = said.get("effect") or ""
    name, value = _text(said, "parameter"), _number(said, "value")
    if not isinstance(effect, str):
        raise InputError(f"effect is {quoted(effect)}; give a text")
    if said.get("commit"):
        return await lab.set_parameter(effect, name, value)
    plant = lab.moved(effect, name, value)

    def answer() -> dict[str, Any]:
        from rdpi_gym.laboratory import views

        response = lab.respond(plant, keep=False)
        found: dict[str, Any] = {
            "errors": {
                "train_um": views.number(response.errors.train_rmse_um),
                "validation_um": views.number(response.errors.validation_rmse_um),
            },
            "trace": None,
        }
        if said.get("record"):
            record = views.record_named(lab.need_data(), _text(said, "record"))
            part = views.stretch(record, _optional(said, "from_s"), _optional(said, "to_s"))
            model_um = response.model_um[record.name]
            found["trace"] = views.trace(record, model_um, None, part)
        return found

    return await asyncio.to_thread(answer)


async def _hold(lab: Lab, said: Mapping[str, Any]) -> dict[str, Any]:
    effect = said.get("effect") or ""
    return await lab.hold(str(effect), _text(said, "parameter"), bool(said.get("held")))


async def _payoff(lab: Lab, said: Mapping[str, Any]) -> dict[str, Any]:
    reference = said.get("reference")
    if not isinstance(reference, dict):
        raise InputError(f"reference is {quoted(reference)}; give an object")
    return await lab.payoff(reference)


_ACTIONS: Mapping[str, Action] = {
    "open": lambda lab, said: lab.open(),
    "example": lambda lab, said: lab.take_example(_text(said, "key")),
    "settings": lambda lab, said: lab.set_settings(said),
    "core": lambda lab, said: lab.set_core(_text(said, "core")),
    "rank": lambda lab, said: lab.rank(),
    "cancel": lambda lab, said: lab.cancel(),
    "add": lambda lab, said: lab.add(_text(said, "effect")),
    "remove": lambda lab, said: lab.remove(_text(said, "effect")),
    "unknown": lambda lab, said: lab.add("unknown"),
    "undo": lambda lab, said: lab.undo(),
    "redo": lambda lab, said: lab.redo(),
    "go": lambda lab, said: lab.go(_text(said, "step")),
    "hold": _hold,
    "refit": lambda lab, said: lab.refit(),
    "settle": lambda lab, said: lab.settle(),
    "parameter": _parameter,
    "payoff": _payoff,
}


def in_thread(server: Server) -> threading.Thread:
    """Start a server in a thread of its own, as a notebook does."""
    thread = threading.Thread(target=lambda: asyncio.run(server.run()), daemon=True)
    thread.start()
    return thread
