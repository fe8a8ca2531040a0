"""Values of JSON: which of them are numbers, and how messages show them."""

import json
import sys
from typing import Any


def is_number(value: Any) -> bool:
    """Return whether a JSON value is a number that a float holds; true and false are not, and 1e999 is infinite."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def shortened(value: Any) -> str:
    """Return a value as JSON, cut to fit in a message."""
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}..."
