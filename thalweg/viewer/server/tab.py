"""One tab of the page: its messages, and the loop that flies, draws and sends frames at its pace.

Steps and frames of all tabs are computed in one thread in turn; the loop of a tab waits for each, so that nothing of a
flight is touched from two places.
"""

import asyncio
import json
import struct
import sys
import time
import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, TypeVar

from starlette.websockets import WebSocket, WebSocketDisconnect

from thalweg.core.config import parse_config
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.cockpit import Cockpit, Policies
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.recording import Folder
from thalweg.viewer.flight.rivers import Rivers
from thalweg.viewer.server import messages
from thalweg.viewer.server.catalogue import catalogue
from thalweg.viewer.server.guard import POLICY_VIOLATION
from thalweg.viewer.server.pace import Pace

T = TypeVar("T")

FRAMES_PER_S, MOST_FRAMES_PER_S = 40.0, 150.0
"""Most frames in a second while a flight moves at a speed of its own, and at the fastest. The page answers each frame,
and has other messages too: see `MOST_A_SECOND`."""
IN_FLIGHT = 2
"""Frames that are sent before the page says that it has shown one."""
MOST_WAITING, MOST_A_SECOND = 32, 240
"""Messages that wait to be done, and that arrive in a second; a page that sends more is cut off."""


@dataclass(frozen=True)
class Shared:
    """What all tabs of a server share."""

    rivers: Rivers
    policies: Policies
    folder: Folder
    options: FlightOptions
    """Of the first flight of a tab."""
    pilot: str
    """Who flies it."""
    drawing: ThreadPoolExecutor
    """One thread for steps and frames."""
    building: ThreadPoolExecutor
    """One thread for rivers, which take seconds."""
    tabs: set["Tab"] = field(default_factory=set)
    """Tabs that are open."""


class Tab:
    """The server's side of one tab."""

    def __init__(self, shared: Shared, socket: WebSocket) -> None:
        self._shared, self._socket = shared, socket
        self._cockpit = Cockpit(shared.policies, shared.folder, shared.pilot)
        self._pace = Pace(shared.options.rules.step_s)
        self._view = messages.View()
        self._speed: float | None = 1.0
        self._waiting: deque[messages.Message] = deque()
        self._arrivals: deque[float] = deque(maxlen=MOST_A_SECOND)
        self._wake = asyncio.Event()
        self._sent = self._shown = 0
        self._changed = False
        """Whether something is to be drawn that the page has not."""
        self._next_frame = 0.0

    async def run(self) -> None:
        """Serve the tab until it is closed."""
        loop = asyncio.create_task(self._loop())
        try:
            while (event := await self._socket.receive())["type"] != "websocket.disconnect":
                if loop.done():
                    break
                if not self._accepts():
                    await self._socket.close(POLICY_VIOLATION, "too many messages")
                    break
                await self._receive(event.get("text"))
        finally:
            loop.cancel()
            await asyncio.gather(loop, return_exceptions=True)

    def _accepts(self) -> bool:
        """Return whether a message that arrives now is not one of a flood."""
        now, full = time.monotonic(), len(self._arrivals) == MOST_A_SECOND
        flood = full and now - self._arrivals[0] < 1.0
        self._arrivals.append(now)
        return not flood and len(self._waiting) < MOST_WAITING

    async def _receive(self, text: str | None) -> None:
        """Take a message; what takes time waits for the loop."""
        try:
            message = messages.parse_message(text)
        except ViewerError as error:
            await self._tell("error", message=str(error))
            return
        if isinstance(message, messages.Hold):
            self._cockpit.hand.hold(message.action)
        elif isinstance(message, messages.Drawn):
            self._shown = min(max(self._shown, message.frame), self._sent)
        else:
            self._waiting.append(message)
        self._wake.set()

    async def _loop(self) -> None:
        """Do what was asked, fly, draw and rest, over and over."""
        shared = self._shared
        await self._tell("hello", **catalogue(shared.rivers, list(shared.policies), shared.options))
        await self._tell_flights()
        await self._guarded(self._start(shared.options))
        while True:
            while self._waiting:
                await self._guarded(self._do(self._waiting.popleft()))
            if not await self._guarded(self._fly()):
                self._pace.stand()
                await self._tell_pace()
            await self._rest()

    async def _guarded(self, work: Any) -> bool:
        """Await something; returns whether it went well. The page is told of an error, and the tab goes on."""
        try:
            await work
        except WebSocketDisconnect:
            raise
        except Exception as error:
            await self._tell("error", message=in_words(error))
            return False
        return True

    async def _do(self, message: messages.Message) -> None:
        """Do what a message asks for."""
        cockpit = self._cockpit
        self._changed = True
        match message:
            case messages.Start():
                await self._start(parse_config(FlightOptions, message.options, "options"))
            case messages.Replay():
                recording = await self._in_thread(cockpit.folder.read, message.name)
                await self._start(recording.options, recording)
            case messages.Control():
                if message.pilot not in ("hand", cockpit.pilot):
                    await self._tell("busy", message=f"{message.pilot} takes over")
                await self._in_thread(cockpit.control, message.pilot)
                await self._tell_pace()
            case messages.Step(action=None):
                self._pace.stand()
                before = len(cockpit.saved)
                await self._in_thread(cockpit.advance, 1)
                await self._tell_pace()
                await self._tell_saved(before)
            case messages.Step():
                self._pace.stand()
                before = len(cockpit.saved)
                await self._in_thread(cockpit.step_by_hand, message.action)
                await self._tell_pace()
                await self._tell_saved(before)
            case messages.Run():
                self._run(message)
                await self._tell_pace()
            case messages.View():
                self._view = message
            case messages.Record():
                cockpit.saves_all = message.on
                await self._tell("record", on=message.on)
            case messages.Save():
                name = await self._in_thread(cockpit.save)
                await self._tell("saved", name=name, folder=str(cockpit.folder.path))
                await self._tell_flights()

    def _run(self, message: messages.Run) -> None:
        flight = self._cockpit.flight
        self._speed = message.speed
        if message.paused or flight is None or flight.ended:
            self._pace.stand()
        else:
            self._pace.go(time.monotonic(), self._speed)

    async def _start(self, options: FlightOptions, recording: Any = None) -> None:
        """Begin a flight with options, or the repetition of a recorded one; it stands until the page lets it go."""
        self._pace.stand()
        rivers = self._shared.rivers
        rivers.check(options.level)
        options.rules  # noqa: B018  # options that do not go together are refused before the river is built
        await self._tell("busy", message="preparing the river and its pictures")
        loop = asyncio.get_running_loop()
        world = await loop.run_in_executor(self._shared.building, rivers.world, options.level, options.world_seed)
        if recording is None:
            told = await self._in_thread(self._cockpit.start, world, options)
        else:
            told = await self._in_thread(self._cockpit.repeat, world, recording)
        self._pace = Pace(told["step_s"])
        self._changed = True
        await self._tell("started", **told)
        await self._tell_pace()

    async def _fly(self) -> None:
        """Take the steps that are due, and send a frame if there is something new and the page keeps up."""
        cockpit, now = self._cockpit, time.monotonic()
        if cockpit.flight is None or not self._page_keeps_up or now < self._next_frame:
            return
        if self._pace.moving and (due := self._pace.steps_due(now)):
            before = len(cockpit.saved)
            pilot = cockpit.pilot
            self._changed = True  # also where a step, or saving what it ended, fails
            if not await self._in_thread(cockpit.advance, due):
                self._pace.stand()
                await self._tell_pace()
            await self._tell_saved(before)
            if cockpit.pilot != pilot:
                await self._tell("busy", message=f"the recorded flight is over; {cockpit.pilot} flies")
        if self._pace.moving or self._changed:
            await self._send_frame()

    async def _tell_saved(self, before: int) -> None:
        """Tell of a flight that was saved as it ended, if there are more than so many."""
        cockpit = self._cockpit
        if len(cockpit.saved) > before:
            await self._tell("saved", name=cockpit.saved[-1], folder=str(cockpit.folder.path))
            await self._tell_flights()

    async def _send_frame(self) -> None:
        """Draw and send a frame: the length of a header, the header as JSON, and the pictures one after another."""
        view, self._changed = self._view, False
        share = self._pace.share(time.monotonic())
        began = time.monotonic()
        about, drawn = await self._in_thread(
            lambda: self._cockpit.frame(view.picture, share, mask=view.mask, seen=view.seen)
        )
        self._sent += 1
        about |= {
            "frame": self._sent,
            "moving": self._pace.moving,
            "drawn_in_ms": round(1000 * (time.monotonic() - began), 1),
            "pictures": [[kind, len(content)] for kind, content in drawn.items()],
        }
        header = json.dumps(about).encode()
        await self._socket.send_bytes(b"".join([struct.pack("<I", len(header)), header, *drawn.values()]))
        self._next_frame = began + 1.0 / (MOST_FRAMES_PER_S if self._speed is None else FRAMES_PER_S)

    async def _rest(self) -> None:
        """Wait until there is something to do: a message, the next frame, or the next step."""
        wait_s = None
        if (self._pace.moving or self._changed) and self._page_keeps_up and self._cockpit.flight is not None:
            wait_s = max(self._next_frame - time.monotonic(), 0.0)
        try:
            await asyncio.wait_for(self._wake.wait(), wait_s)
        except TimeoutError:
            return
        self._wake.clear()

    @property
    def _page_keeps_up(self) -> bool:
        return self._sent - self._shown < IN_FLIGHT

    async def _in_thread(self, work: Callable[..., T], *arguments: Any) -> T:
        """Return what a function returns in the thread of steps and frames."""
        return await asyncio.get_running_loop().run_in_executor(self._shared.drawing, work, *arguments)

    async def _tell(self, kind: str, **about: Any) -> None:
        await self._socket.send_text(json.dumps({"type": kind, **about}))

    async def _tell_pace(self) -> None:
        await self._tell("pace", moving=self._pace.moving, speed=self._speed)

    async def _tell_flights(self) -> None:
        await self._tell("flights", names=await self._in_thread(self._cockpit.folder.names))


def in_words(error: Exception) -> str:
    """Return an error as the page shows it; one that nobody expected goes to the terminal with its traceback."""
    if isinstance(error, OSError):
        return f"{error.filename or 'a file'} cannot be used: {error.strerror}"
    if type(error).__module__.split(".")[0] != "thalweg":
        traceback.print_exception(error, file=sys.stderr)
        return f"an error of the program, which the terminal shows: {type(error).__name__}: {error}"
    return str(error)
