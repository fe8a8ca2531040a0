"""Messages of a page: small JSON objects with a `type`, each checked against a record with the same name."""

import json
from typing import Annotated, Any

from pydantic import Field

from thalweg.core.config import TupleOf, frozen_config, parse_config
from thalweg.core.suggestion import did_you_mean
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.pictures import PictureKind

MOST_BYTES = 4096
"""Longest message of a page."""
Unit = Annotated[float, Field(ge=-1, le=1, allow_inf_nan=False)]
Units = Annotated[TupleOf[Unit], Field(min_length=4, max_length=4)]
"""What a hand does, as `thalweg.viewer.flight.flyers.action_of` takes it."""
Text = Annotated[str, Field(max_length=200)]
SPEEDS = (0.25, 16.0)
"""Slowest and fastest flight, in times real time."""


@frozen_config(ViewerError)
class Start:
    """Begin a flight."""

    options: dict[str, Any]
    """Fields of `thalweg.viewer.flight.options.FlightOptions`."""


@frozen_config(ViewerError)
class Replay:
    """Begin to repeat a recorded flight."""

    name: Text


@frozen_config(ViewerError)
class Hold:
    """What the hand holds from now on."""

    action: Units


@frozen_config(ViewerError)
class Step:
    """Take one step and pause; with an action, by hand."""

    action: Units | None = None


@frozen_config(ViewerError)
class Control:
    """Hand the controls over."""

    pilot: Text


@frozen_config(ViewerError)
class Run:
    """Pause or go on, and at which speed."""

    paused: bool
    speed: Annotated[float, Field(ge=SPEEDS[0], le=SPEEDS[1])] | None = 1.0
    """Times real time. None: as fast as frames can be drawn."""


@frozen_config(ViewerError)
class View:
    """Which pictures to draw."""

    picture: PictureKind = "camera"
    mask: bool = True
    """Whether to send the water mask beside the camera's picture."""
    seen: bool = False
    """Whether to send what the policy sees, and the bird's-eye map of the water that was seen."""


@frozen_config(ViewerError)
class Record:
    """Whether each flight is saved when it ends."""

    on: bool


@frozen_config(ViewerError)
class Save:
    """Save what has been flown so far."""


@frozen_config(ViewerError)
class Drawn:
    """The page has shown a frame and can take another."""

    frame: Annotated[int, Field(ge=0)]


Message = Start | Replay | Hold | Step | Control | Run | View | Record | Save | Drawn
MESSAGES: dict[str, type] = {
    kind.__name__.lower(): kind for kind in (Start, Replay, Hold, Step, Control, Run, View, Record, Save, Drawn)
}


def parse_message(text: str | None) -> Message:
    """Return the message in a text; raises `ViewerError` for anything else, None being what is no text."""
    if text is None:
        raise ViewerError("a message must be text, not bytes")
    if len(text.encode()) > MOST_BYTES:
        raise ViewerError(f"a message has at most {MOST_BYTES} bytes, not {len(text.encode())}")
    try:
        given = json.loads(text)
    except (ValueError, RecursionError):
        raise ViewerError("a message must be JSON") from None
    if not isinstance(given, dict) or not isinstance(given.get("type"), str):
        raise ViewerError('a message must be an object with a "type"')
    kind = given.pop("type")
    if kind not in MESSAGES:
        known = ", ".join(MESSAGES)
        raise ViewerError(f"unknown type of message {kind[:40]!r}{did_you_mean(kind[:40], MESSAGES)}; known: {known}")
    return parse_config(MESSAGES[kind], given, kind)
