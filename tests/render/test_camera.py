"""The camera's frame, its turn and its fit, against the contract's own sentences."""

import numpy as np
import pytest

from render.camera import Camera, CameraConfig, FrameError, outermost, place_camera

CAMERA = Camera(rows=424, columns=512, pixel_size=0.005, distance=2.0, center_height=0.9)


def test_at_yaw_zero_the_camera_looks_at_the_face_from_plus_z():
    to_world = CAMERA.to_world(0.0)
    np.testing.assert_allclose(to_world[:3, :3], np.eye(3), atol=1e-15)
    np.testing.assert_allclose(to_world[:3, 3], [0, 0.9, 2.0], atol=1e-15)


@pytest.mark.parametrize("yaw_deg", [-30.0, -7.5, 12.0, 30.0])
def test_a_positive_yaw_turns_the_face_to_the_cameras_right(yaw_deg):
    yaw = np.radians(yaw_deg)
    nose = np.array([0.0, 0.9, 0.1, 1.0])
    seen = np.linalg.inv(CAMERA.to_world(yaw)) @ nose
    # The axis stays 2 m away, the nose swings by the yaw around it.
    np.testing.assert_allclose(
        seen[:3], [0.1 * np.sin(yaw), 0, -2.0 + 0.1 * np.cos(yaw)], atol=1e-12
    )


def test_the_back_camera_looks_along_the_same_lines():
    yaw = np.radians(20)
    front, back = CAMERA.to_world(yaw), CAMERA.to_world(yaw, back=True)
    np.testing.assert_allclose(front[:3, 2], -back[:3, 2], atol=1e-12)
    np.testing.assert_allclose(front[:3, 0], -back[:3, 0], atol=1e-12)
    # Both planes are as far from the axis: a point between them has depths that add up to 4 m.
    point = np.array([0.1, 1.0, -0.2, 1.0])
    z_front = -(np.linalg.inv(front) @ point)[2]
    z_back = -(np.linalg.inv(back) @ point)[2]
    assert z_front + z_back == pytest.approx(4.0, abs=1e-12)


def test_the_rectangle_holds_every_point_and_little_else():
    points = np.array([[-0.3, 0.1, 0.0], [0.25, 1.7, 0.1]])
    rows, columns = CAMERA.rectangle(points, yaw=0.0)
    assert (rows.start, rows.stop) == (212 - 160 - 1, 212 + 160 + 1)
    assert (columns.start, columns.stop) == (256 - 60 - 1, 256 + 50 + 1)


@pytest.mark.parametrize("flat", [False, True])
def test_the_outermost_points_have_the_rectangle_of_all(flat):
    points = np.random.default_rng(0).standard_normal((20_000, 3)) * (0.2, 0.4, 0.2)
    if flat:
        points[:, 2] = 0.5 * points[:, 0]
    few = outermost(points)
    assert len(few) == len(points) if flat else len(few) < 100
    for yaw in np.linspace(-np.pi, np.pi, 25):
        assert CAMERA.rectangle(few, yaw) == CAMERA.rectangle(points, yaw)


def test_a_subject_larger_than_the_frame_is_refused_with_the_size_that_fits():
    points = np.array([[0, 0, 0], [0, 2.5, 0.0]])
    with pytest.raises(FrameError, match=r"set camera.pixel_size to 0\.00596 or more, or to fit"):
        place_camera(CameraConfig(), points)
    assert place_camera(CameraConfig(pixel_size=0.00596), points).pixel_size == 0.00596


def test_fit_takes_the_smallest_pixel_that_holds_the_subject_at_every_yaw():
    points = np.array([[-1.0, 0, 0], [0.9, 1.0, 0.9]])
    camera = place_camera(CameraConfig(pixel_size="fit"), points)
    assert camera.pixel_size == pytest.approx(2 * np.hypot(0.9, 0.9) / 508)
    for yaw in np.linspace(-np.pi, np.pi, 9):
        rows, columns = camera.rectangle(points, yaw)
        assert rows.start >= 0
        assert columns.start >= 0
        assert rows.stop <= 424
        assert columns.stop <= 512


def test_a_subject_that_reaches_the_camera_plane_is_refused():
    with pytest.raises(FrameError, match=r"set camera.distance to more than 1\.20"):
        place_camera(CameraConfig(distance=1.0), np.array([[0, 0, 1.2], [0, 1, 0]]))


@pytest.mark.parametrize(
    "wrong", [{"rows": 0}, {"columns": 10**6}, {"pixel_size": -1.0}, {"distance": 0.0}]
)
def test_a_wrong_setting_is_named(wrong):
    with pytest.raises(ValueError, match=f"camera.{next(iter(wrong))}"):
        CameraConfig(**wrong)
