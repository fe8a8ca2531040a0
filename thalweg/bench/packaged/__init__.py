"""Policies that come with the package, by name."""

from pathlib import Path

PACKAGED, PACKAGED_RGB = "packaged", "packaged-rgb"
"""Names of the policy of image and mask, which suites fly too, and of that of the image alone."""
PACKAGED_SEES = "rgb+mask"
"""What `PACKAGED` sees, see `thalweg.train.observations`."""
PACKAGED_POLICIES = {
    PACKAGED: Path(__file__).with_name("flight.safetensors"),
    PACKAGED_RGB: Path(__file__).with_name("flight_rgb.safetensors"),
}
"""Files of the policies."""
PACKAGED_POLICY = PACKAGED_POLICIES[PACKAGED]


def policy_path(given: str) -> Path:
    """Return the file of a policy of the package, given by its name; any other text is a path itself."""
    return PACKAGED_POLICIES.get(given) or Path(given)
