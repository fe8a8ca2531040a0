"""A YAML loader for files written by hand: it reads 1e-4 as a number, as YAML 1.2 does, and rejects duplicate keys."""

import re
from typing import Any

import yaml


class Loader(yaml.SafeLoader):
    """PyYAML's safe loader, with numbers as in YAML 1.2: YAML 1.1 requires a point before the exponent."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return the mapping of a node; raises `yaml.YAMLError` for a duplicate key."""
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]  # pyright: ignore
        for key in keys:
            if keys.count(key) > 1:
                raise yaml.constructor.ConstructorError(None, None, f"duplicate key {key!r}", node.start_mark)
        return super().construct_mapping(node, deep)


Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$"), list("-+.0123456789")
)


def load(text: str) -> Any:
    """Return the value of a YAML text; raises `yaml.YAMLError`."""
    return yaml.load(text, Loader)
