"""The server: the page's own files and a socket for each tab, behind the guard, on an address of this machine."""

import errno
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from thalweg.core.atomic_io import ON_WINDOWS
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.cockpit import Policies
from thalweg.viewer.flight.flyers import HAND
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.recording import Folder
from thalweg.viewer.flight.rivers import Rivers
from thalweg.viewer.server.guard import HEADERS, LOOPBACK, Guard
from thalweg.viewer.server.messages import MOST_BYTES
from thalweg.viewer.server.tab import Shared, Tab

FILES = {
    "": ("page.html", "text/html; charset=utf-8"),
    "page.css": ("page.css", "text/css; charset=utf-8"),
    "page.js": ("page.js", "text/javascript; charset=utf-8"),
    "map.js": ("map.js", "text/javascript; charset=utf-8"),
    "controls.js": ("controls.js", "text/javascript; charset=utf-8"),
}
"""All that is served: for each name under the token, a file of the package and its type."""
MOST_TABS = 6
"""Tabs at a time; each holds a river with its tables, some 100 MB."""
TRY_LATER = 1013
THREADS = ("thalweg-flights", "thalweg-rivers")
PATIENCE_S = 3.0
PING_S, SILENCE_S = 5.0, 10.0
"""Time between the server's pings to a page, and the greatest time without an answer to one. A connection that breaks
without a word keeps its place for the sum of both at most; the page tries again for longer, see page.js."""
USUAL_PORT = 8765


def make_shared(
    policies: Policies,
    folder: Folder,
    *,
    rivers: Rivers | None = None,
    options: FlightOptions | None = None,
    pilot: str = HAND,
) -> Shared:
    """Return what the tabs of a server share."""
    drawing, building = (ThreadPoolExecutor(1, name) for name in THREADS)
    return Shared(rivers or Rivers(), policies, folder, options or FlightOptions(), pilot, drawing, building)


def stop(shared: Shared) -> None:
    """End the threads of a server once they have done what they are at, such as saving a flight. What cannot be
    interrupted, such as a compilation, ends with the process, at the latest after `PATIENCE_S`."""
    for threads in (shared.drawing, shared.building):
        threads.shutdown(wait=False, cancel_futures=True)
    deadline = time.monotonic() + PATIENCE_S
    while any(thread.is_alive() for thread in threading.enumerate() if thread.name.startswith(THREADS)):
        if time.monotonic() > deadline:
            sys.stdout.flush()
            os._exit(0)
        time.sleep(0.02)


def make_app(shared: Shared, token: str, hosts: Iterable[str] = LOOPBACK) -> Guard:
    """Return the server's app, whose page is at /TOKEN/."""
    contents = {
        name: (files("thalweg.viewer").joinpath("page", file).read_bytes(), kind)
        for name, (file, kind) in FILES.items()
    }

    async def page(request: Request) -> Response:
        content = contents.get(request.path_params["name"])
        if content is None:
            return PlainTextResponse("not found", 404, HEADERS)
        return Response(content[0], media_type=content[1], headers=HEADERS)

    async def serve_tab(socket: WebSocket) -> None:
        await socket.accept()
        if len(shared.tabs) >= MOST_TABS:
            await socket.close(TRY_LATER, f"{MOST_TABS} tabs are open: close one")
            return
        tab = Tab(shared, socket)
        shared.tabs.add(tab)
        try:
            await tab.run()
        except WebSocketDisconnect:
            pass
        finally:
            shared.tabs.discard(tab)

    routes = [WebSocketRoute("/{token}/socket", serve_tab), Route("/{token}/{name:path}", page)]
    return Guard(Starlette(routes=routes), token, hosts)


def bind(port: int | None, host: str = LOOPBACK[0]) -> socket.socket:
    """Return a socket that is bound to a port: the given one, or the usual one, or any other if that is taken.

    Raises `ViewerError` for an address that cannot be used.
    """
    tries = [USUAL_PORT, 0] if port is None else [port]
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for each in tries:
        bound = socket.socket(family, socket.SOCK_STREAM)
        # On Windows the first of these options would share a port with a program that has it.
        reuse = "SO_EXCLUSIVEADDRUSE" if ON_WINDOWS else "SO_REUSEADDR"
        bound.setsockopt(socket.SOL_SOCKET, getattr(socket, reuse), 1)
        try:
            bound.bind((host, each))
        except (OSError, OverflowError) as error:
            bound.close()
            if each == tries[-1]:
                taken = getattr(error, "errno", None) == errno.EADDRINUSE
                why = "another program has it; --port 0 takes a free one" if taken else str(error)
                raise ViewerError(f"port {each} of {host} cannot be used: {why}") from error
        else:
            return bound
    raise AssertionError("one of the tries returns or raises")


def make_server(app: Guard) -> uvicorn.Server:
    """Return what serves an app; it closes all tabs when it is told to exit."""
    config = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        ws="websockets-sansio",
        ws_max_size=4 * MOST_BYTES,
        ws_per_message_deflate=False,
        ws_ping_interval=PING_S,
        ws_ping_timeout=SILENCE_S,
        timeout_graceful_shutdown=2,
        lifespan="off",
        server_header=False,
    )
    return uvicorn.Server(config)


def serve(app: Guard, bound: socket.socket, on_start: Callable[[], None]) -> None:
    """Serve until interrupted, then close all tabs; raises `KeyboardInterrupt` after that. `on_start` is called when
    browsers can connect."""
    server = make_server(app)
    bound.listen()
    on_start()
    server.run(sockets=[bound])
