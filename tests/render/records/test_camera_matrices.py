"""Tests of the camera's matrices: by hand, and by points that are projected onto frames and back."""

import math

import numpy as np
import pytest

from tests.render.plain import plane
from thalweg.render import Camera, Look, Renderer
from thalweg.render.errors import RenderError
from thalweg.render.records.classes import BRIDGE, GROUND, WATER
from thalweg.render.records.pinhole import CameraMatrices
from thalweg.world.bridges import Bridge

LEVEL = Camera(128, 128, fov_deg=60.0, pitch_deg=0.0)


def project(matrices: CameraMatrices, points: np.ndarray, camera: int = 0) -> np.ndarray:
    """Columns, rows and depths [K, 3] of points [K, 3] in one of the cameras."""
    seen = points @ matrices.R[camera].T + matrices.t[camera]
    pixels = seen @ matrices.K[camera].T
    return np.column_stack([pixels[:, :2] / pixels[:, 2:], seen[:, 2]])


def unproject(matrices: CameraMatrices, depth: np.ndarray, camera: int) -> np.ndarray:
    """Points of the world [H, W, 3] that the pixels of a depth map [H, W] show."""
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]].astype(float)
    rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(matrices.K[camera]).T
    return (rays * depth[..., None] - matrices.t[camera]) @ matrices.R[camera]


def test_intrinsics_follow_from_field_of_view_and_size():
    focal = 64 / math.tan(math.radians(30))
    np.testing.assert_allclose(LEVEL.intrinsics(), [[focal, 0, 63.5], [0, focal, 63.5], [0, 0, 1]])
    wide = Camera(100, 201, fov_deg=90.0).intrinsics()
    np.testing.assert_allclose(wide, [[50, 0, 100], [0, 50, 49.5], [0, 0, 1]])
    assert wide.dtype == np.float64


def test_the_axes_of_a_camera_point_right_down_and_forward():
    poses = [[1.0, 2.0, 3.0, 0.0], [1.0, 2.0, 3.0, math.pi / 2]]
    _, rotation, translation = LEVEL.camera_matrices(poses)
    # A camera that looks east has south on its right; one that looks north has east there.
    np.testing.assert_allclose(rotation[0], [[0, -1, 0], [0, 0, -1], [1, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(rotation[1], [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(translation, [[2, 3, -1], [-1, 3, -2]], atol=1e-15)


def test_a_pitched_camera_looks_down():
    _, rotation, _ = Camera(pitch_deg=30.0).camera_matrices([[0.0, 0.0, 0.0, 0.0]])
    half, root = 0.5, math.sqrt(3) / 2
    np.testing.assert_allclose(rotation[0], [[0, -1, 0], [-half, 0, -root], [root, 0, -half]], atol=1e-15)


def test_rotations_are_proper_and_the_camera_is_where_its_pose_is():
    random = np.random.default_rng(0)
    poses = np.column_stack([random.uniform(-50, 50, (20, 3)), random.uniform(-4, 4, 20)])
    _, rotation, translation = Camera().camera_matrices(poses, random.uniform(-20, 20, 20))
    np.testing.assert_allclose(
        rotation @ rotation.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (20, 3, 3)), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0)
    np.testing.assert_allclose(-np.einsum("nji,nj->ni", rotation, translation), poses[:, :3], atol=1e-12)


@pytest.mark.parametrize(
    ("point", "pixel"),
    [
        ((10.0, 0.0, 2.0), (63.5, 63.5, 10.0)),  # straight ahead
        ((10.0, -10 * math.tan(math.radians(30)), 2.0), (127.5, 63.5, 10.0)),  # on the right edge of the last column
        ((5.0, 0.0, 2 + 5 * math.tan(math.radians(30))), (63.5, -0.5, 5.0)),  # on the upper edge of the first row
    ],
)
def test_points_lie_on_the_pixels_that_angles_say(point, pixel):
    matrices = LEVEL.camera_matrices([[0.0, 0.0, 2.0, 0.0]])
    np.testing.assert_allclose(project(matrices, np.array([point])), [pixel], atol=1e-12)


@pytest.mark.parametrize("look", [Look(), Look(pitch_deg=-7.0, fov_deg=15.0)], ids=["default", "another lens"])
def test_a_depth_map_lies_on_water_and_ground(look: Look):
    camera, poses = Camera(72, 96), np.array([[0.0, 1.0, 4.0, 0.3], [-8.0, -2.0, 6.5, 2.6], [5.0, 4.0, 3.0, -1.4]])
    world = plane(slope_y=0.06, water_level=0.25)
    layers = Renderer([world], camera).render_layers(poses, look=look, layers=("depth_m", "class_id"))
    matrices = camera.camera_matrices(poses, look.pitch_deg, look.fov_deg)
    seen = np.zeros(2, np.int64)
    for n in range(len(poses)):
        points = unproject(matrices, layers.depth_m[n], n)
        inside = np.abs(points[..., :2]).max(-1) < 45  # the ground of the world ends at 50 m
        for k, (kind, height) in enumerate(((WATER, 0.25 + 0 * points[..., 1]), (GROUND, 0.06 * points[..., 1]))):
            chosen = inside & (layers.class_id[n] == kind)
            seen[k] += chosen.sum()
            assert np.abs(points[..., 2] - height)[chosen].max(initial=0.0) < 0.02
    assert (seen > 2000).all()


def test_corners_of_a_bridge_project_onto_their_pixels():
    row = Bridge(9.0, 1.0, 1.35, 8.0, 3.0, 5.0, 0.1, 1.4, 2.2, 0.0, 0.6)
    camera, pose = Camera(240, 320), np.array([[-2.0, 0.5, 4.5, 0.1]])
    world = plane(bridges=np.array([row]), water_level=-0.1)
    bridge = Renderer([world], camera).render_layers(pose, layers=("class_id",)).class_id[0] == BRIDGE
    ends = np.array([[u, v] for u in (-row.length / 2, row.length / 2) for v in (-row.width / 2, row.width / 2)])
    cos, sin = math.cos(row.angle), math.sin(row.angle)
    corners = np.column_stack([row.x + ends @ [cos, -sin], row.y + ends @ [sin, cos], np.full(4, 2.8)])
    u, v, _ = project(camera.camera_matrices(pose), corners).T
    rows, columns = np.nonzero(bridge)
    # The corners that lie furthest to the left, right and top are those of the outline: the camera looks down.
    for corner, outermost in (
        (u.argmin(), columns.argmin()),
        (u.argmax(), columns.argmax()),
        (v.argmin(), rows.argmin()),
    ):
        edge = columns == columns[outermost] if corner != v.argmin() else rows == rows[outermost]
        found = np.column_stack([columns[edge], rows[edge]]).astype(float)
        assert np.abs(found - [u[corner], v[corner]]).max(axis=1).min() < 1.0
    assert u.min() > 0 and u.max() < 319 and v.min() > 0


def test_poses_of_another_shape_are_refused():
    with pytest.raises(RenderError, match=r"poses have shape \[4\]; they must be \[M, 4\]"):
        Camera().camera_matrices([0.0, 0.0, 0.0, 0.0])
