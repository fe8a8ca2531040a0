"""Seeded mutations of valid files: of bytes, of trees of plain data, of tables, and of tensor files.

Each takes a random generator of Python and returns new content; the same generator gives the same content on every
machine. None knows what a file means.
"""

import copy
import io
import json
import re
import struct
import zipfile
from collections.abc import Callable
from random import Random
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import yaml

from thalweg.core import yaml12

TOKENS = (
    *(b"NaN", b"-1", b"0", b"1e999", b"-1e308", b"9" * 400, b"null", b"true", b"{}", b"[]", b"\x00", b"\xff", b'"'),
    *(b"\xed\xa0\x80", b",", b":", b"\n", b"\r", b"&a ", b"*a", b"!!python/object:os.system ", b"2020-99-99", b"0b_"),
)
"""Bytes that parsers take for something else."""
TAG = re.compile(r"<[^>]*>")
XML_VALUE = re.compile(r'(?<==")[^"]+|(?<=[>, ])[^<>=", ]+(?=[<, ])')
"""An attribute's value, or a word of the text between tags."""
LONG = "x" * 5000
DEEP_LEVELS = (3, 200, 20_000)
Edit = Callable[[Any, Random], Any]
"""A value of a tree, replaced by another."""


def mutated_bytes(content: bytes, random: Random) -> bytes:
    """Return content with one to four bytes flipped, overwritten, cut out, repeated or inserted, or with its end cut
    off."""
    data = bytearray(content)
    for _ in range(random.choice((1, 1, 2, 4))):
        at = random.randrange(len(data) + 1)
        piece = random.choice((1, 1, 4, 64, 1024))
        match random.randrange(7):
            case 0 if at < len(data):
                data[at] ^= 1 << random.randrange(8)
            case 1:
                data[at : at + piece] = random.randbytes(min(piece, len(data) - at))
            case 2:
                del data[at : at + piece]
            case 3:
                data[at:at] = data[at : at + piece] * random.choice((1, 2, 50))
            case 4:
                del data[at:]
            case 5:
                data[at : at + random.choice((0, 1, 8))] = random.choice(TOKENS)
            case _:
                data[at:at] = random.randbytes(piece)
    return bytes(data)


def nested(levels: int) -> list:
    """Return a list in a list in a list, so many levels deep."""
    value: list = []
    for _ in range(levels):
        value = [value]
    return value


def any_value(random: Random) -> Any:
    """Return a value that hardly any key expects."""
    values: tuple[Any, ...] = (None, True, False, 0, -1, 1, 7, 0.5, -0.0, 1e-300, 1e300, -1e300, 2**31, 2**63, 10**400)
    values += (float("nan"), float("inf"), "", "NaN", "1", "-1", "é\ud800", "a\nb", LONG, [], {}, [1, "a"], {"a": 1})
    return random.choice(values)


def mutated_tree(value: Any, random: Random, *, deep: bool = True) -> Any:
    """Return a copy of plain data with one to three of its values replaced, removed, renamed, repeated or nested.

    `deep` allows nesting that no recursive reader follows.
    """
    tree = [copy.deepcopy(value)]
    for _ in range(random.choice((1, 1, 2, 3))):
        if not tree:  # all of it was removed
            break
        parent, key = random.choice(_places(tree))
        if isinstance(parent, dict):
            _edit_key(parent, key, random)
        else:
            _edit_item(parent, key, random)
        if deep and random.random() < 0.02 and key in (parent if isinstance(parent, dict) else ()):
            parent[key] = nested(random.choice(DEEP_LEVELS))
    return tree[0] if tree else None


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Return container and key of all values in a tree."""
    found: list[tuple[Any, Any]] = []
    rest = [value]
    while rest:
        each = rest.pop()
        keys = list(each) if isinstance(each, dict) else range(len(each)) if isinstance(each, list) else ()
        found.extend((each, key) for key in keys)
        rest.extend(each[key] for key in keys)
    return found


def _edit_key(parent: dict, key: Any, random: Random) -> None:
    match random.randrange(5):
        case 0:
            del parent[key]
        case 1:
            parent[random.choice((f"{key}x", "", "type", f"{key}"[:-1]))] = parent.pop(key)
        case 2:
            parent[key] = _changed(parent[key], random)
        case 3:
            parent[key] = copy.deepcopy(parent[random.choice(list(parent))])
        case _:
            parent[key] = any_value(random)


def _edit_item(parent: list, index: int, random: Random) -> None:
    match random.randrange(6):
        case 0:
            del parent[index]
        case 1:
            parent.insert(index, copy.deepcopy(parent[index]))
        case 2:
            other = random.randrange(len(parent))
            parent[index], parent[other] = parent[other], parent[index]
        case 3 | 4:
            parent[index] = _changed(parent[index], random)
        case _:
            parent[index] = any_value(random)


def _changed(value: Any, random: Random) -> Any:
    """Return a value near the given one, such as another sign, scale or type."""
    if isinstance(value, bool) or value is None:
        return not value
    if isinstance(value, int | float):
        shift = random.choice((-1, 1, 0.5, 1e-9, 1000))
        return random.choice((-value, value * 10, value * 1_000_000, value / 3, value + shift, str(value), [value]))
    if isinstance(value, str):
        return random.choice((value[::-1], value.upper(), f"{value} ", value[:1], [value], value * 20))
    return random.choice(([value], str(value)[:200], list(value) * 2, list(value)[:1], {"value": value}))


def mutated_json(content: bytes, random: Random) -> bytes:
    """Return JSON of a mutated tree, sometimes with a key repeated or bytes mutated too."""
    if random.random() < 0.25:
        return mutated_bytes(content, random)
    text = dumped(mutated_tree(json.loads(content), random))
    if random.random() < 0.05:
        text = text.replace("{", '{"type": 1, ', 1)
    return text.encode("utf-8", "surrogatepass")


def mutated_yaml(content: bytes, random: Random) -> bytes:
    """Return YAML of a mutated tree, or with bytes mutated, or with anchors that refer to themselves or multiply.

    Raises the errors of PyYAML, also for a tree of anchors that multiply, and `UnicodeDecodeError`.
    """
    choice = random.random()
    if choice < 0.4:
        return mutated_bytes(content, random)
    if choice < 0.45:
        laughs = ["a: &a [x, x, x, x, x, x, x, x, x]"]
        laughs += [f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]" for a, b in zip("abcdefgh", "bcdefghi", strict=True)]
        lines = random.choice((laughs, ["arms: &a", "- *a"], ["arms: &a {algorithm: *a}"], ["run: &a", "  b: *a"]))
        return content + "\n".join(lines).encode()
    tree = mutated_tree(yaml12.load(content.decode(), yaml.SafeLoader), random, deep=False)
    return yaml.safe_dump(tree, allow_unicode=False).encode("utf-8", "surrogatepass")


def dumped(value: Any) -> str:
    """Return a tree as JSON; one that is too deep for the module is written as brackets."""
    try:
        return json.dumps(value, ensure_ascii=False)
    except RecursionError:
        depth = 100_000
        return "[" * depth + "]" * depth


def mutated_lines(content: bytes, random: Random) -> bytes:
    """Return a text with one or two of its lines removed, repeated, swapped or cut, or with bytes mutated."""
    if random.random() < 0.4:
        return mutated_bytes(content, random)
    lines = content.decode().splitlines()
    for _ in range(random.choice((1, 1, 2))):
        at = random.randrange(len(lines))
        match random.randrange(4):
            case 0:
                del lines[at]
            case 1:
                lines.insert(random.randrange(len(lines)), lines[at])
            case 2:
                other = random.randrange(len(lines))
                lines[at], lines[other] = lines[other], lines[at]
            case _:
                lines[at] = lines[at][: random.randrange(len(lines[at]) + 1)]
    return ("\n".join(lines) + "\n").encode()


def mutated_xml(content: bytes, random: Random) -> bytes:
    """Return XML with one or two of its values replaced, or of its tags removed, repeated or renamed, or with bytes
    mutated."""
    if random.random() < 0.25:
        return mutated_bytes(content, random)
    text = content.decode()
    for _ in range(random.choice((1, 1, 2))):
        match random.randrange(4):
            case 0:
                place, new = random.choice(list(TAG.finditer(text))), random.choice(("", "<b/>", "<b>", "</b>"))
                new = random.choice((new, place[0] * 2, place[0].replace("t", "u")))
            case _:
                place = random.choice(list(XML_VALUE.finditer(text)))
                new = _changed_text(place[0], random)
        text = text[: place.start()] + new + text[place.end() :]
    return text.encode("utf-8", "surrogatepass")


def _changed_text(value: str, random: Random) -> str:
    """Return the text of another value; of a number often one that is near."""
    try:
        near = str(_changed(float(value), random))
    except ValueError:
        near = str(_changed(value, random))
    return random.choice(("&#x0;", *map(escape, (near, near, near, str(any_value(random)), value + " "))))


def mutated_table(content: bytes, random: Random) -> bytes:
    """Return CSV with cells replaced, columns renamed, removed or repeated, or lines removed, repeated or cut."""
    if random.random() < 0.25:
        return mutated_bytes(content, random)
    rows = [line.split(",") for line in content.decode().splitlines()]
    for _ in range(random.choice((1, 1, 2))):
        row = random.choice(rows)
        column = random.randrange(len(row)) if row else 0
        match random.randrange(7):
            case 0 | 1 if row:
                row[column] = str(any_value(random)).replace("\ud800", "")
            case 2 if row:
                row[column] = str(_changed(row[column], random))
            case 3:
                for each in rows:
                    del each[column : column + 1]
            case 4:
                rows.insert(random.randrange(len(rows)), list(row))
            case 5 if len(rows) > 1:
                rows.remove(row)
            case _ if row:
                row.insert(column, row[column])
    return ("\n".join(map(",".join, rows)) + "\n").encode()


def mutated_safetensors(content: bytes, random: Random) -> bytes:
    """Return a safetensors file with its header mutated, with the JSON in its metadata mutated, with numbers replaced
    by NaN, or with other bytes."""
    length = struct.unpack("<Q", content[:8])[0]
    header, data = json.loads(content[8 : 8 + length]), bytearray(content[8 + length :])
    match random.randrange(6):
        case 0:
            return mutated_bytes(content, random)
        case 1:
            header = _mutated_entries(header, random)
        case 2:
            at = random.randrange(max(len(data) // 4, 1)) * 4
            numbers = (float("nan"), float("inf"), 3e38, -3e38, 1e-45)
            data[at : at + 4] = struct.pack("<f", random.choice(numbers))
        case 3:
            lie = random.choice((0, 1, length - 1, length + 1, length * 2, 2**31, 2**63, 2**64 - 1))
            return struct.pack("<Q", lie) + content[8:]
        case _:
            metadata = header.get("__metadata__", {})
            for key in metadata:
                metadata[key] = dumped(mutated_tree(json.loads(metadata[key]), random))
    text = dumped(header).encode("utf-8", "surrogatepass")
    return struct.pack("<Q", len(text)) + text + bytes(data)


def _mutated_entries(header: dict, random: Random) -> dict:
    """Return a header with one tensor's dtype, shape, place or name changed, or with any value changed."""
    names = [name for name in header if name != "__metadata__"]
    if not names or random.random() < 0.3:
        return mutated_tree(header, random, deep=False)
    name = random.choice(names)
    entry = header[name]
    match random.randrange(5):
        case 0:
            entry["dtype"] = random.choice(("F64", "F16", "BF16", "I64", "U8", "BOOL", "F8_E4M3", "I32"))
        case 1:
            entry["shape"] = random.choice((entry["shape"][::-1], [*entry["shape"], 1], [2**62], [-1], [0], []))
        case 2:
            begin, end = entry["data_offsets"]
            entry["data_offsets"] = random.choice(([begin, end + 4], [begin + 4, end], [end, begin], [0, 2**62]))
        case 3:
            header[f"{name}x"] = header.pop(name)
        case _:
            del header[name]
    return header


def mutated_npz(content: bytes, random: Random) -> bytes:
    """Return a NumPy archive with an array replaced, removed, reshaped or of another type, with its text mutated, with
    a header that claims another shape, or with other bytes."""
    if random.random() < 0.2:
        return mutated_bytes(content, random)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = random.choice(sorted(members))
    if random.random() < 0.4 and "about.npy" in members:
        about = str(np.load(io.BytesIO(members["about.npy"])))
        members["about.npy"] = _npy(
            np.array(dumped(mutated_tree(json.loads(about), random)).encode("ascii", "replace").decode())
        )
    elif random.random() < 0.2:
        del members[name]
    elif random.random() < 0.3:
        members[name] = _claiming(members[name], random)
    else:
        members[name] = _npy(_changed_array(np.load(io.BytesIO(members[name])), random))
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        for each, value in members.items():
            archive.writestr(zipfile.ZipInfo(each), value)
    return written.getvalue()


def _npy(array: np.ndarray) -> bytes:
    written = io.BytesIO()
    np.save(written, array, allow_pickle=False)
    return written.getvalue()


def _claiming(member: bytes, random: Random) -> bytes:
    """Return an array's file with another shape in its header, of the same length."""
    begin, end = member.find(b"'shape': ("), member.find(b"\n")
    if begin < 0 or end < 0:
        return mutated_bytes(member, random)
    claim = random.choice((b"(2147483647,)", b"(-1,)", b"(1000000000000,)", b"()", b"(3, 3, 3)"))
    text = member[:begin] + b"'shape': " + claim + b", }"
    return text.ljust(end)[:end] + member[end:]


def _changed_array(array: np.ndarray, random: Random) -> np.ndarray:
    """Return an array with one number replaced, of another type or of another shape."""
    if array.dtype.kind not in "iufb" or random.random() < 0.1:
        return np.array(random.choice(("text", 1 + 2j, 0.5, -1, 2**40, float("nan"))))
    match random.randrange(6):
        case 0:
            return array.astype(random.choice((np.float64, np.float32, np.int64, np.uint8, np.complex128, "<U8")))
        case 1:
            return random.choice((array[..., None], array.reshape(-1), array[:0], array[:1], array.T, array[::2]))
        case 2 if array.ndim:
            return np.concatenate([array, array])
        case _ if array.size:
            changed = array.copy()
            at = random.randrange(array.size)
            if array.dtype.kind == "f":
                changed.flat[at] = random.choice((float("nan"), float("inf"), 1e30, -1e30, 0.0, -1.0, 1e-30))
            else:
                changed.flat[at] = random.choice((0, 1, np.iinfo(array.dtype).max, np.iinfo(array.dtype).min))
            return changed
    return array
