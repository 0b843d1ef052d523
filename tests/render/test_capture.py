"""Maps that Blender renders against surfaces whose depth and normals are known in closed form."""

import numpy as np
import pytest
import trimesh

from render.camera import Camera, CameraConfig, place_camera
from render.capture import Capture, CaptureError, capture
from render.cycles import CyclesConfig
from subjects.mesh import Material, Mesh

LIGHT = (0.0, 0.0, 0.0)
CYCLES = CyclesConfig(samples=4)
CENTER = np.array([0.07, 0.9, 0.05])
# Cycles' single-precision rays pass within this of the pixel's centre (metres, across the ray).
RAY = 1e-6


def pixel_centers(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) each: x and y of every pixel's centre in the camera frame."""
    i, j = np.mgrid[: camera.rows, : camera.columns]
    p = camera.pixel_size
    return (j + 0.5 - camera.columns / 2) * p, (camera.rows / 2 - i - 0.5) * p


def shoot(in_worker, mesh: Mesh, yaw_deg: list[float], body: Mesh | None = None) -> Capture:
    """A capture of `mesh` in a process of its own."""
    camera = place_camera(CameraConfig(), mesh.vertices)
    return in_worker(capture, mesh, body, camera, np.radians(yaw_deg), LIGHT, CYCLES, 2)


def box(sides: list[float]) -> Mesh:
    """A box with hard edges: four vertices of their own for each face."""
    solid = trimesh.creation.box(sides)
    corners = solid.vertices[solid.faces].reshape(-1, 3) + CENTER
    return Mesh(corners, np.arange(len(corners)).reshape(-1, 3))


@pytest.fixture(scope="module")
def sphere(in_worker) -> tuple[Capture, float, float]:
    """Its capture, its radius, and how far the polyhedron's faces lie inside it (metres)."""
    radius = 0.6
    ball = trimesh.creation.icosphere(subdivisions=7, radius=radius)
    sagitta = radius - np.linalg.norm(ball.triangles_center, axis=1).min()
    seen = shoot(in_worker, Mesh(ball.vertices + CENTER, ball.faces), [0.0, 25.0])
    return seen, radius, sagitta


@pytest.mark.parametrize("view", [0, 1])
def test_a_sphere_has_the_depth_and_the_normals_of_a_sphere(sphere, view):
    seen, radius, sagitta = sphere
    x, y = pixel_centers(seen.camera)
    center = np.linalg.inv(seen.camera_to_world[view]) @ [*CENTER, 1]
    dx, dy = x - center[0], y - center[1]
    squared = radius**2 - dx**2 - dy**2
    # A pixel of slack at the rim, where the polyhedron's silhouette is not the circle.
    inside = squared > (2 * radius * 0.002)
    assert seen.mask[view][inside].all()
    assert not seen.mask[view][squared < 0].any()

    height = np.sqrt(squared[inside])
    for depth, normal, sign in (
        (seen.depth_front, seen.normal_front, 1),
        (seen.depth_back, seen.normal_back, -1),
    ):
        # The chord of a 4.8 mm edge lies 5 micrometres inside the sphere.
        expected = -(center[2] + sign * height)
        slant = radius / height
        assert (np.abs(depth[view][inside] - expected) / slant).max() < sagitta + RAY
        exact = np.stack([dx[inside], dy[inside], sign * height], axis=-1) / radius
        angle = np.degrees(np.arccos(np.clip((normal[view][inside] * exact).sum(-1), -1, 1)))
        assert np.median(angle) < 0.1
        assert angle.max() < 0.5


def test_front_and_back_share_one_silhouette_and_the_background_is_zero(sphere):
    seen = sphere[0]
    for name in ("depth_front", "depth_back"):
        np.testing.assert_array_equal(getattr(seen, name) > 0, seen.mask)
    assert (seen.depth_back[seen.mask] >= seen.depth_front[seen.mask]).all()
    for name in ("normal_front", "normal_back", "radiance_front", "radiance_back"):
        assert not getattr(seen, name)[~seen.mask].any()
    assert (seen.normal_front[seen.mask][:, 2] >= 0).all()
    assert (seen.normal_back[seen.mask][:, 2] <= 0).all()


def test_direct_light_follows_lamberts_law(sphere):
    """Radiance of a matte surface: albedo / pi x P / (4 pi d^2) x cos, and that per watt."""
    seen, radius, _ = sphere
    x, y = pixel_centers(seen.camera)
    center = (np.linalg.inv(seen.camera_to_world[0]) @ [*CENTER, 1])[:3]
    mask = ((x - center[0]) ** 2 + (y - center[1]) ** 2) < (0.7 * radius) ** 2
    point = np.stack([x[mask], y[mask], -seen.depth_front[0][mask]], axis=-1)
    distance = np.linalg.norm(point, axis=-1)
    cosine = (seen.normal_front[0][mask] * -point).sum(-1) / distance
    intensity = seen.radiance_front[0][mask][:, 0] * distance**2 / cosine
    albedo = ((0.8 + 0.055) / 1.055) ** 2.4  # of the default material, sRGB 0.8
    assert np.quantile(np.abs(intensity / (albedo / (4 * np.pi**2)) - 1), 0.99) < 0.01


def test_a_tilted_plane_is_flat(in_worker):
    # z = 0.3 x - 0.5 (y - 0.9) + 0.05 in the world, one metre wide.
    xy = np.array([[-0.5, 0.4], [0.5, 0.4], [0.5, 1.4], [-0.5, 1.4]])
    z = 0.3 * xy[:, 0] - 0.5 * (xy[:, 1] - 0.9) + 0.05
    mesh = Mesh(np.column_stack([xy, z]), [[0, 1, 2], [0, 2, 3]])
    seen = shoot(in_worker, mesh, [0.0])
    x, y = pixel_centers(seen.camera)
    mask = seen.mask[0]
    # Centres half a pixel inside every edge: 200 x 200 of them.
    assert mask.sum() == 200 * 200
    world_y = y + seen.camera.center_height
    expected = 2.0 - (0.3 * x - 0.5 * (world_y - 0.9) + 0.05)
    normal = np.array([-0.3, 0.5, 1.0]) / np.linalg.norm([-0.3, 0.5, 1.0])
    assert np.abs(seen.depth_front[0] - expected)[mask].max() < RAY / normal[2]
    assert np.abs(seen.depth_back[0] - expected)[mask].max() < RAY / normal[2]
    np.testing.assert_allclose(seen.normal_front[0][mask], np.tile(normal, (40000, 1)), atol=1e-6)
    np.testing.assert_allclose(seen.normal_back[0][mask], np.tile(-normal, (40000, 1)), atol=1e-6)


def test_a_box_at_thirty_degrees_shows_two_faces(in_worker):
    mesh = box([0.6, 1.0, 0.4])
    seen = shoot(in_worker, mesh, [30.0])
    mask = seen.mask[0]
    turn = np.radians(30)
    # +30 degrees turns the front face towards the camera's right and shows the subject's
    # right-hand side (-x) on the left of the image.
    front = np.array([np.sin(turn), 0, np.cos(turn)])
    side = np.array([-np.cos(turn), 0, np.sin(turn)])
    to_front = np.abs(seen.normal_front[0] - front).max(-1) < 1e-5
    to_side = np.abs(seen.normal_front[0] - side).max(-1) < 1e-5
    assert (to_front | to_side)[mask].all()
    columns = np.broadcast_to(np.arange(mask.shape[1]), mask.shape)
    assert columns[to_front & mask].min() > columns[to_side & mask].max()

    x, y = pixel_centers(seen.camera)
    to_camera = np.linalg.inv(seen.camera_to_world[0])
    reach = np.array([0.3, 0, 0.2])
    right, left = CENTER + reach, CENTER - reach
    corner = (to_camera @ [*right, 1])[:3]
    for normal, where in ((front, to_front & mask), (side, to_side & mask)):
        # The plane through a corner: n . (p - corner) = 0, solved for the depth -z.
        anchor = corner if normal is front else (to_camera @ [*left, 1])[:3]
        z = anchor[2] - (normal[0] * (x - anchor[0]) + normal[1] * (y - anchor[1])) / normal[2]
        assert where.sum() > 1000
        assert np.abs(seen.depth_front[0] + z)[where].max() < RAY / normal[2]
    assert np.abs(mask.sum() * seen.camera.pixel_size**2 - 1.0 * (0.6 * np.cos(turn) + 0.2)) < 0.01


def test_the_body_lies_in_the_same_grid(in_worker):
    outer = box([0.6, 1.0, 0.4])
    inner = box([0.5, 0.9, 0.3])
    seen = shoot(in_worker, outer, [0.0, -20.0], body=inner)
    at_front = seen.body_depth_front[0] > 0
    assert at_front.sum() == 100 * 180
    assert seen.mask[0][at_front].all()
    np.testing.assert_allclose(
        (seen.body_depth_front[0] - seen.depth_front[0])[at_front], 0.05, atol=2 * RAY
    )
    np.testing.assert_allclose(
        (seen.depth_back[0] - seen.body_depth_back[0])[at_front], 0.05, atol=2 * RAY
    )


def test_without_a_body_its_maps_are_empty(sphere):
    seen = sphere[0]
    assert not seen.body_depth_front.any()
    assert not seen.body_depth_back.any()


def test_colours_arrive_at_their_faces(in_worker):
    """Texture corners, upright and unmirrored, and per-vertex colours, front and back."""
    texture = np.zeros((4, 4, 3), dtype=np.uint8)
    texture[:2, :2], texture[:2, 2:] = (255, 0, 0), (0, 255, 0)  # upper left, upper right
    texture[2:, :2], texture[2:, 2:] = (0, 0, 255), (255, 255, 255)
    corners = np.array([[-0.5, 0.4, 0], [0.5, 0.4, 0], [0.5, 1.4, 0], [-0.5, 1.4, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)[faces]
    textured = Mesh(corners, faces, uv=uv, materials=(Material(texture=texture),))
    seen = shoot(in_worker, textured, [0.0])
    rows, columns = (212 - 60, 212 + 60), (256 - 60, 256 + 60)
    for image in (seen.radiance_front[0], seen.radiance_back[0]):
        # The back map is in the front camera's grid, so both read alike on a sheet.
        left, right = columns
        assert np.argmax(image[rows[0], left]) == 0
        assert np.argmax(image[rows[0], right]) == 1
        assert np.argmax(image[rows[1], left]) == 2
        np.testing.assert_allclose(image[rows[1], right], image[rows[1], right, 0], rtol=1e-5)

    painted = Mesh(corners, faces, vertex_colors=np.tile([[188, 0, 0]], (4, 1)).astype(np.uint8))
    red = shoot(in_worker, painted, [0.0]).radiance_front[0][212, 256]
    white = Mesh(corners, faces, materials=(Material(color=(1.0, 1.0, 1.0)),))
    full = shoot(in_worker, white, [0.0]).radiance_front[0][212, 256]
    # sRGB 188 is 0.5029 in linear light.
    assert red[0] / full[0] == pytest.approx(0.5029, abs=1e-3)
    assert not red[1:].any()


def test_no_neighbours_light_is_in_a_pixel(in_worker):
    """Two colours that meet where pixels do keep to their sides, to the last pixel."""
    corners = np.array([[x, y, 0] for y in (0.4, 1.4) for x in (-0.5, 0.0, 0.5)])
    left, right = [[0, 1, 4], [0, 4, 3]], [[1, 2, 5], [1, 5, 4]]
    halves = Mesh(
        corners,
        np.array(left + right),
        materials=(Material(color=(1.0, 0.0, 0.0)), Material(color=(0.0, 0.0, 1.0))),
        face_material=np.array([0, 0, 1, 1], dtype=np.int32),
    )
    seen = shoot(in_worker, halves, [0.0])
    for image in (seen.radiance_front[0], seen.radiance_back[0]):
        rows = image[160:260]
        assert rows[:, 255, 0].min() > 0 == rows[:, 255, 2].max()
        assert rows[:, 256, 2].min() > 0 == rows[:, 256, 0].max()


def test_a_surface_that_one_side_alone_sees_is_refused():
    """Two silhouettes that differ by more than grazing rays are an error, not a small mask."""
    from render.capture import _silhouette

    front = np.zeros((100, 100), dtype=bool)
    front[10:90, 10:90] = True
    back = front.copy()
    back[10, 10] = False
    assert _silhouette(front, back, 0.0)[1] == 1
    back[10, 10:12] = False
    with pytest.raises(CaptureError, match=r"front and back disagree in 2 of 6398 pixels"):
        _silhouette(front, back, 0.0)
    with pytest.raises(CaptureError, match="nothing is seen"):
        _silhouette(front, ~front, 0.0)


def test_renderer_and_verify_drop_as_many_pixels_at_most():
    from render.capture import MAX_DROPPED
    from shards.schema import DROPPED_LIMIT

    assert MAX_DROPPED == DROPPED_LIMIT


def test_the_number_of_threads_does_not_show_in_the_bytes(in_worker):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    mesh = Mesh(ball.vertices + CENTER, ball.faces)
    camera = place_camera(CameraConfig(), mesh.vertices)
    few, many = (
        in_worker(capture, mesh, mesh, camera, np.radians([5.0]), LIGHT, CYCLES, threads)
        for threads in (2, 5)
    )
    for name in ("mask", "depth_front", "normal_back", "radiance_front", "body_depth_back"):
        assert getattr(few, name).tobytes() == getattr(many, name).tobytes(), name
