"""Tests of what a page may say."""

import json

import pytest

from thalweg.viewer.errors import ViewerError
from thalweg.viewer.server.messages import MOST_BYTES, Hold, Run, Step, parse_message


def test_a_message_becomes_its_record():
    assert parse_message('{"type": "hold", "action": [0, -1, 0.5, 1]}') == Hold((0.0, -1.0, 0.5, 1.0))
    assert parse_message('{"type": "step"}') == Step(None)
    assert parse_message('{"type": "run", "paused": false, "speed": null}') == Run(False, None)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (None, "must be text, not bytes"),
        ("", "must be JSON"),
        ("[" * 3000, "must be JSON"),
        ("[1]", 'must be an object with a "type"'),
        ('{"type": 3}', 'must be an object with a "type"'),
        ('{"type": "sav"}', r"unknown type of message 'sav' \(did you mean 'save'\?\); known: start, "),
        ('{"type": "save", "path": "/etc/passwd"}', "Save has no 'path'"),
        ('{"type": "hold", "action": [0, 0, 0]}', "hold: action must "),
        ('{"type": "hold", "action": [0, 0, 0, 2]}', r"hold: action\[3\] must be .*1.*got 2"),
        ('{"type": "hold", "action": [0, 0, 0, NaN]}', r"hold: action\[3\] must be .*nan"),
        ('{"type": "run", "paused": false, "speed": 1000}', "run: speed must be .*1000"),
        ('{"type": "run", "paused": 1}', "run: paused must be .*1"),
        ('{"type": "view", "picture": "x-ray"}', "view: picture must be .*x-ray"),
        ('{"type": "drawn", "frame": -1}', "drawn: frame must be .*-1"),
    ],
)
def test_anything_else_is_refused_by_name(text: str | None, error: str):
    with pytest.raises(ViewerError, match=error):
        parse_message(text)


def test_a_long_message_is_refused_by_its_length():
    with pytest.raises(ViewerError, match=f"at most {MOST_BYTES} bytes, not "):
        parse_message(json.dumps({"type": "replay", "name": "x" * MOST_BYTES}))
