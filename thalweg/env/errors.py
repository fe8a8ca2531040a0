"""The error of configs and arguments of environments."""


class ConfigError(ValueError):
    """An unknown key of a config, or a value that is unknown or out of range."""
