"""Sizes of layers in settings: bounded, so that a slip of the keyboard is an error and no allocation of memory."""

from typing import Annotated

from pydantic import Field

LayerSize = Annotated[int, Field(ge=1, le=65536)]
"""Numbers that a layer returns, or filters of a convolution."""
OptionalLayerSize = Annotated[int, Field(ge=0, le=65536)]
"""The same, or 0 for no layer."""
