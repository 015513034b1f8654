"""What the page is pushed: events to whoever listens, the whole state at most ten times a second."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from typing import Any

_OFTEN_S, _PING_S = 0.1, 15.0
_MOST_WAITING = 500


class Events:
    """Listeners, and what they are told; used in the loop of the server alone.

    Attributes
    ----------
    state : callable
        Returns the whole state.
    """

    def __init__(self) -> None:
        self.state: Callable[[], dict[str, Any]] = dict
        self._listeners: set[asyncio.Queue[str | None]] = set()
        self._waits = False

    def push(self, event: str, data: dict[str, Any]) -> None:
        """Tell all listeners of an event."""
        text = f"event: {event}\ndata: {json.dumps(data, ensure_ascii=False, allow_nan=False)}\n\n"
        for queue in [*self._listeners]:
            if queue.qsize() < _MOST_WAITING:  # a page that sleeps hears the state when it wakes
                queue.put_nowait(text)

    def changed(self) -> None:
        """Tell all listeners the whole state, soon."""
        if not self._waits:
            self._waits = True
            asyncio.get_running_loop().call_later(_OFTEN_S, self._tell)

    def close(self) -> None:
        """Let all listeners go."""
        for queue in self._listeners:
            queue.put_nowait(None)

    def _tell(self) -> None:
        self._waits = False
        if self._listeners:
            self.push("state", self.state())

    async def listen(self) -> AsyncIterator[str]:
        """Yield events as they go over the wire, the whole state first."""
        queue: asyncio.Queue[str | None] = asyncio.Queue()
        self._listeners.add(queue)
        try:
            state = json.dumps(self.state(), ensure_ascii=False, allow_nan=False)
            yield f"event: state\ndata: {state}\n\n"
            while True:
                try:
                    text = await asyncio.wait_for(queue.get(), _PING_S)
                except TimeoutError:
                    yield "event: ping\ndata: {}\n\n"
                    continue
                if text is None:
                    return
                yield text
        finally:
            self._listeners.discard(queue)
