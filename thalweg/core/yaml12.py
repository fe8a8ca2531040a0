"""Loading of YAML: text that is too large or not plain data is an error, and so is a duplicate key.

Files written by hand are read with numbers as in YAML 1.2, in which 1e-4 is one; files that PyYAML wrote, which follow
YAML 1.1, are read by its own loader.
"""

import re
from typing import Any

import yaml

MAX_NODES = 1_000_000
"""Greatest number of values in a document, in which each alias counts as often as what it stands for."""


class Loader(yaml.SafeLoader):
    """PyYAML's safe loader, with numbers as in YAML 1.2: YAML 1.1 requires a point before the exponent,
    and takes 1:16 for a number."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return the mapping of a node; raises `yaml.YAMLError` for a duplicate key."""
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]  # pyright: ignore
        for key in keys:
            if keys.count(key) > 1:
                raise yaml.constructor.ConstructorError(None, None, f"duplicate key {key!r}", node.start_mark)
        return super().construct_mapping(node, deep)

    def construct_integer(self, node: yaml.ScalarNode) -> int:
        """Return a whole number, of which zeros in front change nothing: YAML 1.1 takes 010 for eight."""
        digits = node.value.replace("_", "")
        return int(digits, 0 if digits.lstrip("-+")[:2] in ("0b", "0o", "0x") else 10)


# YAML 1.1 takes 1:16 for 76, a number to the base of 60, and not for a range of seeds.
Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag != "tag:yaml.org,2002:int"]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
Loader.add_implicit_resolver(
    "tag:yaml.org,2002:int",
    re.compile(r"([-+]?0b[01_]+|[-+]?0o[0-7_]+|[-+]?[0-9][0-9_]*|[-+]?0x[0-9a-fA-F_]+)$"),
    list("-+0123456789"),
)
Loader.add_constructor("tag:yaml.org,2002:int", Loader.construct_integer)
Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$"), list("-+.0123456789")
)


def load(text: str, loader: type[yaml.SafeLoader] = Loader) -> Any:
    """Return the value of a YAML text; raises `yaml.YAMLError` for anything but plain data of a reasonable size."""
    reader = loader(text)
    try:
        node = reader.get_single_node()
        if node is None:
            return None
        _check_size(node)
        return reader.construct_document(node)
    except yaml.YAMLError:
        raise
    except RecursionError:
        raise yaml.YAMLError("nested too deep") from None
    except Exception as error:  # PyYAML's constructors fail in many ways: for 2020-99-99, 0b_, !!bool 3 ...
        raise yaml.YAMLError(f"a value that cannot be read: {error}") from error
    finally:
        reader.dispose()


def _check_size(root: yaml.Node) -> None:
    """Raise `yaml.YAMLError` for a document in which aliases stand for more values than `MAX_NODES`, or for what they
    are part of, and for text that is not Unicode."""
    sizes: dict[int, int] = {}

    def size_of(node: yaml.Node) -> int:
        if id(node) in sizes:
            if not sizes[id(node)]:
                raise yaml.MarkedYAMLError(None, None, "an alias of what it is part of", node.start_mark)
            return sizes[id(node)]
        sizes[id(node)] = 0  # until all of its parts are known
        total = 1 + sum(map(size_of, _parts(node)))
        if total > MAX_NODES:
            raise yaml.MarkedYAMLError(None, None, f"more than {MAX_NODES:,} values", node.start_mark)
        sizes[id(node)] = total
        return total

    size_of(root)


def _parts(node: yaml.Node) -> list[yaml.Node]:
    """Return the keys and values of a mapping, the items of a list, or nothing; raises `yaml.YAMLError` for text that
    is not Unicode."""
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    if isinstance(node, yaml.SequenceNode):
        return node.value
    try:
        node.value.encode()
    except UnicodeEncodeError:
        raise yaml.MarkedYAMLError(None, None, "text that is not Unicode", node.start_mark) from None
    return []
