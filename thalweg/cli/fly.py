"""`thalweg fly`: the page to fly the river by hand, to watch policies and pilots fly, and to record flights."""

import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from tyro.conf import Positional

from thalweg.cli.flight_options import ChosenFlight, free_name
from thalweg.cli.options import UsageError
from thalweg.core.notices import notice

LOOPBACK = "127.0.0.1"
MOST_PORTS = 65_535


@dataclass(frozen=True)
class Fly(ChosenFlight):
    """Fly by hand in the browser, watch pilots and policies fly, and record flights. The page can choose other flights
    than that of the options."""

    policies: Positional[tuple[str, ...]] = ()
    """Runs' folders, policy files or functions (fly.py:fly) to watch beside the usual ones; the first flies first."""
    size: int = 384
    """Height and width of a frame in pixels."""
    out: Path = Path("flights")
    """Folder for saved flights, and for tables of those that ended."""
    port: int | None = None
    """Port of the page; by default 8765, or another one if that is taken. 0 takes any free one."""
    host: str = LOOPBACK
    """Address of this machine to serve on. Others than 127.0.0.1 can be reached from the network, unencrypted."""
    open: bool = False
    """Open the page in the browser."""

    def run(self) -> int:
        """Serve the page until Ctrl-C."""
        from thalweg.viewer.flight.flyers import HAND, PILOTS
        from thalweg.viewer.flight.recording import Folder
        from thalweg.viewer.server.app import bind, make_app, make_shared, serve, stop
        from thalweg.viewer.server.guard import LOOPBACK as LOOPBACKS
        from thalweg.viewer.server.guard import new_token

        self._check()
        policies = self._loaders()
        named = [given for given in self.policies if given not in PILOTS]  # whose loaders come first
        loaded = {given: load() for given, load in zip(named, policies.values(), strict=False)}
        rivers, options = self.chosen(self.size, loaded.get(self.policies[0]) if self.policies else None)
        options = self.with_actions_of(options, loaded)
        pilot = HAND
        if self.policies:
            pilot = self.policies[0] if self.policies[0] in PILOTS else next(iter(policies))
        shared = make_shared(policies, Folder(self.out), rivers=rivers, options=options, pilot=pilot)
        bound, token = bind(self.port, self.host), new_token()
        address = f"http://{_in_address(self.host)}:{bound.getsockname()[1]}/{token}/"
        hosts = LOOPBACKS if self.host in LOOPBACKS else (*LOOPBACKS, self.host)
        try:
            serve(make_app(shared, token, hosts), bound, partial(self._announce, address))
        except KeyboardInterrupt:
            notice("\nStopped.")
        finally:
            bound.close()
            stop(shared)
        return 0

    def _check(self) -> None:
        """Raise `UsageError` for an address or a folder that cannot be used."""
        if self.port is not None and not 0 <= self.port <= MOST_PORTS:
            raise UsageError(f"--port must be from 0 to {MOST_PORTS}, not {self.port}")
        if self.host in ("0.0.0.0", "::", ""):
            raise UsageError(
                f"--host {self.host} would serve on all addresses: name the one under which browsers reach this machine"
            )
        from thalweg.core.run_folder import nearest_existing

        if not (existing := nearest_existing(self.out)).is_dir():
            raise UsageError(f"--out {self.out}: {existing} is not a folder; name one for saved flights")

    def _loaders(self) -> dict[str, Callable[[], Any]]:
        """Return functions that load policies, by name; those that were named are loaded now, so that errors show."""
        from thalweg.bench.packaged import PACKAGED_POLICIES
        from thalweg.cli.evaluate import load_named_policy
        from thalweg.viewer.flight.flyers import HAND, PILOTS, REPLAY

        loaders: dict[str, Callable[[], Any]] = {}
        for given in (name for name in self.policies if name not in PILOTS):  # these are there anyway
            load = cache(partial(load_named_policy, given, self.vehicle or "uav"))
            load()
            others = (HAND, REPLAY, *PILOTS, *(name for name in PACKAGED_POLICIES if name != given))
            loaders[free_name(given, (*loaders, *others))] = load
        absent = (name for name in PACKAGED_POLICIES if name not in loaders)
        return loaders | {name: cache(partial(load_named_policy, name)) for name in absent}

    def _announce(self, address: str) -> None:
        """Print the address, and open it if that was asked for."""
        print(f"Fly at {address}\nFlights are saved in {self.out}/. Ctrl-C stops.", flush=True)
        if self.host != LOOPBACK:
            notice(f"Warning: whoever gets the address and reaches {self.host} can fly here; nothing is encrypted.")
        if self.open:
            webbrowser.open(address)


def _in_address(host: str) -> str:
    return f"[{host}]" if ":" in host else host
