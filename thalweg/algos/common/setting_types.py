"""Types of settings that several algorithms share, with their bounds."""

import math
from typing import Annotated

from pydantic import Field

from thalweg.core.config import Hint

LayerSize = Annotated[int, Field(ge=1, le=65536)]
"""Numbers that a layer returns, or filters of a convolution; bounded, so that a slip of the keyboard is an error and no
allocation of memory."""
OptionalLayerSize = Annotated[int, Field(ge=0, le=65536)]
"""The same, or 0 for no layer."""
EntropyPerNumber = Annotated[float, Field(lt=math.log(2.0), allow_inf_nan=False), Hint("the entropy of -1..1 is log 2")]
"""Target entropy of a continuous policy in -1..1, in nats per dimension of the action."""
