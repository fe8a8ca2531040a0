"""Settings of the shield."""

from typing import Annotated

from pydantic import Field

from thalweg.core.config import FiniteNonNegative, frozen_config
from thalweg.env.config import ConfigError


@frozen_config(ConfigError, numpy_scalars=True)
class ShieldConfig:
    """What the shield permits."""

    margin_m: Annotated[float, Field(ge=0, le=2)] = 0.25
    """Distance that a move must keep from what was seen to be dry, unless the vehicle is that near already."""
    lookahead: Annotated[int, Field(ge=0, le=4)] = 2
    """Steps of flight ahead, turning or not, that must be possible after a move; 0: the move alone is judged."""
    unknown_is_water: bool = True
    """Whether moves to where nothing has been seen are permitted."""
    patience: Annotated[int, Field(ge=1)] = 10
    """Vetoed moves forward in a row after which only land that was seen beyond water counts: what was never seen so may
    be a bridge."""
    floor_m: FiniteNonNegative = 3.5
    """Height above the water below which a move forward or aside must climb. Straight down a vehicle may descend
    further, to look below the trees of a bank, unless it may be over a bridge. Bridges of the levels are up to
    3.2 m high, body included."""
    spare_m: FiniteNonNegative = 0.3
    """Distance kept from the task's own limits of the height: the water level may change along a move."""
    max_turn_deg: Annotated[float, Field(gt=0, le=180)] = 80.0
    """Greatest angle between the heading and the way flown, which stands for the direction of the river; 180: any."""
