"""Tests of the ROS 2 example against a stand-in for ROS: what it refuses, and when it stops the vehicle."""

import importlib.util
import json
import signal
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import onnxruntime
import pytest

from thalweg.deploy.onnx_policy import FORMAT
from thalweg.env.spaces import moves_in_words

EXAMPLE = Path(__file__).parents[1] / "examples" / "ros2_follow.py"
ABOUT = {
    "format": FORMAT,
    "inputs": ["image"],
    "camera": {"height_px": 2, "width_px": 2},
    "steps": {"seconds": 0.25, "vertical_m": 1, "yaw_deg": 10, "forward_m": 1, "lateral_m": 0.5},
    "memory": 0,
    "fast_step_m": 0.0,
    "action_kind": "options",
    "actions": moves_in_words("multidiscrete"),
}


class Node:
    """A node without ROS, whose clock shows 100 s."""

    def __init__(self, name: str) -> None:
        self.sent = MagicMock()

    def declare_parameter(self, name: str, value: Any) -> Any:
        return SimpleNamespace(value=value)

    def create_publisher(self, *_: Any) -> Any:
        return self.sent

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=100 * 10**9))

    def __getattr__(self, name: str) -> Any:
        return MagicMock()


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    stubs: dict[str, Any] = {"rclpy": MagicMock(), "rclpy.node": SimpleNamespace(Node=Node)}
    names = ("geometry_msgs", "geometry_msgs.msg", "rclpy.qos", "rclpy.signals", "sensor_msgs", "sensor_msgs.msg")
    for name, stub in {**stubs, **{name: MagicMock() for name in names}}.items():
        monkeypatch.setitem(sys.modules, name, stub)
    spec = importlib.util.spec_from_file_location("ros2_follow", EXAMPLE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def told(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> None:
    """Let every file have the metadata `ABOUT` with changes."""
    session = MagicMock()
    session.get_modelmeta().custom_metadata_map = {"thalweg": json.dumps({**ABOUT, **changes})}
    monkeypatch.setattr(onnxruntime, "InferenceSession", lambda *_, **__: session)


def test_policies_with_a_fast_step_are_refused(example: ModuleType, monkeypatch: pytest.MonkeyPatch):
    told(monkeypatch, fast_step_m=2.0)
    with pytest.raises(RuntimeError, match="fast step"):
        example.FollowRiver()


def test_policies_that_choose_numbers_are_refused(example: ModuleType, monkeypatch: pytest.MonkeyPatch):
    told(monkeypatch, action_kind="numbers")
    with pytest.raises(RuntimeError, match="chooses no options"):
        example.FollowRiver()


def test_files_of_another_format_are_refused(example: ModuleType, monkeypatch: pytest.MonkeyPatch):
    told(monkeypatch, format=2)
    with pytest.raises(RuntimeError, match="format is 2, not 3: export the policy again"):
        example.FollowRiver()


@pytest.mark.parametrize(
    ("options", "moves", "velocity"),
    [
        ([0, 0, 0, 0], {}, (2.0, 1.0, 2.0, np.radians(20))),
        ([2, 2, 2, 2], {}, (0.0, -1.0, -2.0, -np.radians(20))),
        ([1, 1, 2, 1], {"allow_backward": True}, (-2.0, 0.0, 0.0, 0.0)),
        ([0, 1, 1, 1], {"vehicle": "asv"}, (0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_a_velocity_is_half_that_of_the_step_that_the_options_name(
    options: list[int], moves: dict, velocity: tuple, example: ModuleType, monkeypatch: pytest.MonkeyPatch
):
    told(monkeypatch, actions=moves_in_words("multidiscrete", **moves))
    command = example.FollowRiver().velocity(np.array(options))
    found = command.linear.x, command.linear.y, command.linear.z, command.angular.z
    np.testing.assert_allclose(found, velocity, atol=1e-12)


@pytest.mark.parametrize(("second", "stops"), [(100, False), (99, True), (101, True)])
def test_the_age_of_an_image_is_that_of_its_stamp(
    second: int, stops: bool, example: ModuleType, monkeypatch: pytest.MonkeyPatch
):
    told(monkeypatch)
    node = example.FollowRiver()
    stamp = SimpleNamespace(sec=second, nanosec=0)
    node.on_image(
        SimpleNamespace(encoding="rgb8", height=2, width=2, step=6, data=bytes(12), header=SimpleNamespace(stamp=stamp))
    )
    node.choose, node.stop = MagicMock(return_value=[1, 1, 0, 1]), MagicMock()
    node.on_step()
    assert (node.stop.called, node.choose.called) == (stops, not stops)


def test_the_vehicle_is_stopped_before_ros_ends(example: ModuleType, monkeypatch: pytest.MonkeyPatch):
    told(monkeypatch)
    begun = signal.getsignal(signal.SIGTERM)
    calls: list[str] = []
    ros: Any = example.rclpy
    ros.spin.side_effect = lambda _: signal.raise_signal(signal.SIGTERM)
    ros.try_shutdown.side_effect = lambda: calls.append("shutdown")
    monkeypatch.setattr(example.FollowRiver, "stop", lambda *_: calls.append("stop"))
    try:
        example.main()
    finally:
        signal.signal(signal.SIGTERM, begun)
    assert calls == ["stop", "shutdown"]
    assert ros.init.call_args.kwargs == {"signal_handler_options": example.SignalHandlerOptions.NO}
