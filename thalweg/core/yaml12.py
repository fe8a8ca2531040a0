"""How is YAML read that people write by hand? With 1e-4 for a number, and no key twice."""

import re
from typing import Any

import yaml


class Loader(yaml.SafeLoader):
    """Takes 1e-4 for a number, as YAML 1.2 does; in YAML 1.1 a number has a point before its exponent."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """As the parent's; raises `yaml.YAMLError` for a key that stands there twice."""
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]  # pyright: ignore
        for key in keys:
            if keys.count(key) > 1:
                raise yaml.constructor.ConstructorError(None, None, f"{key!r} stands there twice", node.start_mark)
        return super().construct_mapping(node, deep)


Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$"), list("-+.0123456789")
)


def load(text: str) -> Any:
    """What a text says; raises `yaml.YAMLError`."""
    return yaml.load(text, Loader)
