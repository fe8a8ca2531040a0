"""Policies that come with the package, by name."""

from pathlib import Path

PACKAGED = "packaged"
"""Name of the policy of image and mask, which suites fly too."""
PACKAGED_SEES = "rgb+mask"
"""What `PACKAGED` sees, see `thalweg.train.observations`."""
PACKAGED_POLICIES = {
    PACKAGED: Path(__file__).with_name("flight.safetensors"),
}
"""Files of the policies."""
PACKAGED_POLICY = PACKAGED_POLICIES[PACKAGED]


def policy_path(given: str) -> Path:
    """Return the file of a policy of the package, given by its name; any other text is a path itself."""
    return PACKAGED_POLICIES.get(given) or Path(given)
