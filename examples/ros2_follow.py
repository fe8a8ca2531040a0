"""ROS 2 node that follows a river by an exported policy: images in, velocities out, and a stop if either fails.

It was tested against a stand-in for ROS only: no robot, and no ROS, has run it. Try it with the propellers off.

    python examples/ros2_follow.py --ros-args -p policy:=policy.onnx -p speed:=0.5

The policy sees `image` (sensor_msgs/Image, rgb8 or bgr8) and, if it takes one, `mask` (mono8, 255 where water is seen).
It chooses a step every `steps.seconds` of the file's metadata, which becomes a velocity on `cmd_vel`
(geometry_msgs/Twist in m/s and rad/s: x forward, y left, z up, yaw to the left). `speed`, from 0 to 1, is the share of
the velocity that the step has in the simulator; `patience_s` is the greatest age of an image in seconds, by the
stamp of its message. The camera should have the field of view and the pitch of the metadata. The node refuses policies
of tasks with a fast step, policies that choose numbers instead of options, and files with another format of metadata.
"""

import json
import math
import signal
from typing import Any

import numpy as np
import onnxruntime
import rclpy
from geometry_msgs.msg import Twist
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Image

FORMAT = 3
"""Format of the metadata that this node reads: older ones do not say what each option does."""
BRANCHES = ("vertical", "yaw", "longitudinal", "lateral")


class FollowRiver(Node):
    """Publishes the velocity of the policy's step for the newest image, at the rate of steps, or a stop."""

    def __init__(self) -> None:
        super().__init__("follow_river")
        path = self.declare_parameter("policy", "policy.onnx").value
        self.speed = min(max(float(self.declare_parameter("speed", 0.5).value), 0.0), 1.0)
        self.patience_s = float(self.declare_parameter("patience_s", 0.5).value)
        self.session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        self.about = json.loads(self.session.get_modelmeta().custom_metadata_map["thalweg"])
        if self.about.get("format") != FORMAT:
            raise RuntimeError(
                f"the file's format is {self.about.get('format')}, not {FORMAT}: export the policy again"
            )
        if "proprioception" in self.about["inputs"]:
            raise RuntimeError("this node measures no proprioception: export a policy that takes none")
        if self.about["fast_step_m"] != 0:
            raise RuntimeError("the policy has a fast step: export one without")
        if self.about["action_kind"] != "options":
            raise RuntimeError("the policy chooses no options: export one of options")
        camera, self.step = self.about["camera"], self.about["steps"]
        self.amounts = amounts_of(self.step)
        self.size = camera["height_px"], camera["width_px"]
        self.memory = np.zeros((1, self.about["memory"]), np.float32)
        self.last = np.full((1, len(BRANCHES)), -1, np.int64)
        self.fresh = True
        self.seen: dict[str, tuple[float, np.ndarray]] = {}
        self.commands = self.create_publisher(Twist, "cmd_vel", 1)
        self.create_subscription(Image, "image", self.on_image, qos_profile_sensor_data)
        if "mask" in self.about["inputs"]:
            self.create_subscription(Image, "mask", self.on_mask, qos_profile_sensor_data)
        self.create_timer(self.step["seconds"], self.on_step)

    def on_image(self, message: Image) -> None:
        """Keep the newest picture."""
        picture = self.pixels(message, 3)
        if picture is not None:
            self.seen["image"] = stamp_of(message), picture[..., ::-1] if message.encoding == "bgr8" else picture

    def on_mask(self, message: Image) -> None:
        """Keep the newest mask."""
        mask = self.pixels(message, 1)
        if mask is not None:
            self.seen["mask"] = stamp_of(message), np.where(mask[..., 0] > 127, 255, 0)

    def on_step(self) -> None:
        """Publish the velocity of the next step, or a stop."""
        wanted = [name for name in ("image", "mask") if name in self.about["inputs"]]
        ages = {name: self.now() - self.seen.get(name, (-math.inf, None))[0] for name in wanted}
        late = [name for name, age in ages.items() if abs(age) > self.patience_s]  # nor from another clock's future
        if late:
            self.stop(f"no {' and no '.join(late)} for {self.patience_s} s")
            return
        try:
            options = self.choose({name: self.seen[name][1] for name in wanted})
        except Exception as error:  # the vehicle must stop for every error
            self.stop(f"the policy failed: {error}")
            return
        self.commands.publish(self.velocity(options))

    def choose(self, seen: dict[str, np.ndarray]) -> np.ndarray:
        """Return the options [4] of the next step, and keep memory and last action.

        `seen` has an image [H, W, 3] and a mask [H, W] by name.
        """
        given: dict[str, Any] = {name: np.ascontiguousarray(each[None], np.uint8) for name, each in seen.items()}
        given |= {"fresh": np.array([self.fresh]), "memory": self.memory, "last_action": self.last}
        names = [output.name for output in self.session.get_outputs()]
        inputs = {name: given[name] for name in self.about["inputs"]}
        found = dict(zip(names, self.session.run(names, inputs), strict=True))
        self.memory, self.last, self.fresh = found.get("next_memory", self.memory), found["action"], False
        return found["action"][0]

    def velocity(self, options: np.ndarray) -> Twist:
        """Return the velocity of a step by its options [4], by the metadata's words for what each of them does."""
        moves = {
            branch: self.about["actions"][branch][option] for branch, option in zip(BRANCHES, options, strict=True)
        }
        rate = self.speed / self.step["seconds"]
        command = Twist()
        command.linear.x = self.amounts[moves["longitudinal"]] * rate
        command.linear.y = self.amounts[moves["lateral"]] * rate
        command.linear.z = self.amounts[moves["vertical"]] * rate
        command.angular.z = self.amounts[moves["yaw"]] * rate
        return command

    def stop(self, reason: str) -> None:
        """Publish a stop; the policy forgets its memory and last action."""
        self.fresh = True
        self.commands.publish(Twist())
        self.get_logger().warning(f"stopped: {reason}", throttle_duration_sec=1.0)

    def pixels(self, message: Image, channels: int) -> np.ndarray | None:
        """Return the middle of a message's picture in the policy's size [H, W, C] uint8; None for another encoding."""
        if message.encoding not in (("rgb8", "bgr8") if channels == 3 else ("mono8", "8UC1")):
            self.stop(f"pictures are {message.encoding}, not of {channels} channels of a byte")
            return None
        rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
        picture = rows[:, : message.width * channels].reshape(message.height, message.width, channels)
        height, width = self.size
        side = min(message.height / height, message.width / width)
        down = (message.height - side * height) / 2 + side * (np.arange(height) + 0.5)
        right = (message.width - side * width) / 2 + side * (np.arange(width) + 0.5)
        return picture[down.astype(int)][:, right.astype(int)]

    def now(self) -> float:
        """Return the time in seconds by the node's clock."""
        return self.get_clock().now().nanoseconds * 1e-9


def amounts_of(step: dict[str, float]) -> dict[str, float]:
    """Return metres forward, to the left or up, or radians to the left, of each word for a move."""
    pairs = {
        ("up", "down"): step["vertical_m"],
        ("turn left", "turn right"): math.radians(step["yaw_deg"]),
        ("forward", "backward"): step["forward_m"],
        ("left", "right"): step["lateral_m"],
    }
    signed = {
        name: sign * amount for pair, amount in pairs.items() for name, sign in zip(pair, (1.0, -1.0), strict=True)
    }
    return {"none": 0.0, **signed}


def stamp_of(message: Image) -> float:
    """Return the time in seconds at which a message's picture was taken."""
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def interrupt(*_: Any) -> None:
    """End the node as Ctrl-C does."""
    raise KeyboardInterrupt


def main() -> None:
    """Run the node until it is interrupted or terminated, and stop the vehicle."""
    # ROS's own handlers end the context first, after which no stop could be published.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, interrupt)
    node = FollowRiver()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        if rclpy.ok():
            node.stop("the node ends")
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
