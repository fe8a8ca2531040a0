"""The footprint of the boat, an oriented rectangle, against circles and other rectangles. Touching counts as a hit."""

import math

from thalweg.core.compute.jit import kernel


@kernel(fastmath=False, allocates=False)
def meets_circle(x, y, yaw, half_length, half_beam, centre_x, centre_y, radius):
    """Return whether a rectangle at x, y with a heading touches a circle: its nearest point is within the radius."""
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    dx = centre_x - x
    dy = centre_y - y
    past_end = max(abs(dx * cos + dy * sin) - half_length, 0.0)
    past_side = max(abs(dy * cos - dx * sin) - half_beam, 0.0)
    return past_end * past_end + past_side * past_side <= radius * radius


@kernel(fastmath=False, allocates=False)
def meets_rectangle(
    x, y, yaw, half_length, half_beam, other_x, other_y, other_cos, other_sin, other_along, other_across
):
    """Return whether two rectangles touch; the other one's first axis is (other_cos, other_sin), and it reaches
    `other_along` and `other_across` metres to either side of its centre.

    Two convex bodies are apart if and only if a line along one of their sides separates them (separating axes;
    Gottschalk et al., "OBBTree", 1996, section 5).
    """
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    dx = other_x - x
    dy = other_y - y
    # Cosine and sine of the angle from the heading to the other one's first axis.
    along = abs(cos * other_cos + sin * other_sin)
    across = abs(cos * other_sin - sin * other_cos)
    if abs(dx * cos + dy * sin) > half_length + other_along * along + other_across * across:
        return False
    if abs(dy * cos - dx * sin) > half_beam + other_along * across + other_across * along:
        return False
    if abs(dx * other_cos + dy * other_sin) > other_along + half_length * along + half_beam * across:
        return False
    return abs(dy * other_cos - dx * other_sin) <= other_across + half_length * across + half_beam * along
