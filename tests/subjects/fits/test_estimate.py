"""Bodies from PIXIE's and PyMAF-X's files, where their cameras and the front's depth put them."""

from __future__ import annotations

import pickle  # noqa: TID251 - written here, read only by the code under test
import subprocess
import sys
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from shards.dataset import Dataset
from subjects.fits.estimate import Estimate, Picture, read_estimate
from subjects.fits.estimates import Estimates
from subjects.fits.fits import Fits
from subjects.fits.model import pose
from subjects.fits.parameters import parameters_from
from subjects.fits.pattern import Place
from subjects.mesh import Mesh, MeshError
from subjects.meshfile import read_mesh
from subjects.scans import Scans
from subjects.wavefront import write_mesh

ROOT = Path(__file__).parents[3]
PICTURE = Picture()
PLACE = Place("0525", "0525", "scan")
FLIP = np.diag([1.0, -1.0, -1.0])
HERE = Path("estimate.pkl")
NOBODY = Mesh(np.eye(3), np.array([[0, 1, 2]]))


def matrices(turns: Any) -> np.ndarray:
    rotations = Rotation.from_rotvec(np.reshape(turns, (-1, 3))).as_matrix()
    return rotations.astype(np.float32)


def pixie_values(fit: Any, camera: tuple[float, float, float], box: Any) -> dict[str, Any]:
    """PIXIE's dictionary for the fit's body: whole rotations, y down, z away."""
    values = fit.values
    upright = Rotation.from_matrix(FLIP) * Rotation.from_rotvec([0, -np.radians(127), 0])
    whole = upright * Rotation.from_rotvec(values["global_orient"][0])
    hands = {
        side: matrices(
            values[f"{side}_hand_pose"][0] @ fit.model[f"hands_components{side[0]}"][:12]
            + fit.model[f"hands_mean{side[0]}"]
        )
        for side in ("left", "right")
    }
    return {
        "shape": np.pad(values["betas"][0], (0, 190)),
        "exp": np.pad(values["expression"][0], (0, 40)),
        "global_pose": whole.as_matrix()[None].astype(np.float32),
        "body_pose": matrices(values["body_pose"]),
        "jaw_pose": matrices(values["jaw_pose"]),
        "left_hand_pose": hands["left"],
        "right_hand_pose": hands["right"],
        "leye_pose": matrices(values["leye_pose"]),
        "reye_pose": matrices(values["reye_pose"]),
        "head_pose": np.eye(3, dtype=np.float32)[None],
        "body_cam": np.array(camera, dtype=np.float32),
        "bbox": box,
    }


def in_pixels(points: np.ndarray) -> np.ndarray:
    """(N, 2) column and row in the picture of points in the camera's frame, metres."""
    xy = points[:, :2] / PICTURE.pixel_size
    return np.stack([xy[:, 0] + PICTURE.columns / 2, PICTURE.rows / 2 - xy[:, 1]], axis=1)


def least_squares(points: np.ndarray, pixels: np.ndarray) -> tuple[float, np.ndarray]:
    """Scale and (2,) shift that take points' x and y to pixels."""
    a = np.zeros((2 * len(points), 3))
    a[:, 0] = points[:, :2].ravel()
    a[::2, 1] = a[1::2, 2] = 1
    scale, *shift = np.linalg.lstsq(a, pixels.ravel(), rcond=None)[0]
    return float(scale), np.array(shift)


@pytest.fixture(scope="module")
def neutral(models: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The estimators' model: the neutral one."""
    folder = tmp_path_factory.mktemp("neutral")
    (folder / "SMPLX_NEUTRAL.npz").symlink_to(models / "smplx" / "SMPLX_MALE.npz")
    return folder


class TestCamera:
    def test_pixie_crop(self) -> None:
        """The crop's corners are the centres of its first and last pixels of 224."""
        values = {"betas": np.zeros(10), "body_pose": np.zeros(63)}
        parameters = parameters_from(values, HERE)
        box = np.array([100.0, 50, 200, 270])
        estimate = Estimate(HERE, "pixie", parameters, np.array([0.8, 0.1, -0.2]), NOBODY, box)
        scale, origin = estimate.in_picture(PICTURE)
        side = int(1.1 * 220)
        for x, y in [(0, 0), (0.4, -0.7)]:
            crop = (np.array([0.8 * (x + 0.1), 0.8 * (y - 0.2)]) + 1) / 2 * 224
            pixel = np.array([150 - side / 2, 160 - side / 2]) + crop * side / 223
            np.testing.assert_allclose(origin + scale * np.array([x, y]), pixel + 0.5)

    def test_pixie_without_a_crop_needs_a_square(self) -> None:
        values = {"betas": np.zeros(10), "body_pose": np.zeros(63)}
        parameters = parameters_from(values, HERE)
        estimate = Estimate(HERE, "pixie", parameters, np.array([1.0, 0, 0]), NOBODY)
        with pytest.raises(MeshError, match="not square"):
            estimate.in_picture(PICTURE)
        scale, origin = estimate.in_picture(Picture(rows=224, columns=224))
        assert scale == pytest.approx(112)
        np.testing.assert_allclose(origin, [112.5, 112.5])

    def test_pymafx_sees_the_whole_picture(self) -> None:
        values = {"betas": np.zeros(10), "body_pose": np.zeros(63)}
        camera = np.array([0.6 * 424 / 512, 0.6, 0.1, -0.3])
        estimate = Estimate(HERE, "pymafx", parameters_from(values, HERE), camera, NOBODY)
        scale, origin = estimate.in_picture(PICTURE)
        assert scale == pytest.approx(0.6 * 212)
        u = 256 * (1 + camera[0] * (0.5 + 0.1))
        v = 212 * (1 + camera[1] * (0.2 - 0.3))
        np.testing.assert_allclose(origin + scale * np.array([0.5, 0.2]), [u, v])

    def test_pymafx_of_another_picture(self) -> None:
        """It was given the picture padded to a square."""
        values = {"betas": np.zeros(10), "body_pose": np.zeros(63)}
        camera = np.array([0.5, 0.5, 0.0, 0.0])
        estimate = Estimate(HERE, "pymafx", parameters_from(values, HERE), camera, NOBODY)
        with pytest.raises(MeshError, match=r"correct subjects\.estimates\.picture"):
            estimate.in_picture(PICTURE)
        assert estimate.in_picture(Picture(rows=512))[0] == pytest.approx(128)


class TestPlacement:
    def made(
        self,
        open_human: Path,
        tmp_path: Path,
        estimates: dict[str, Any],
        models: Path,
        **changes: Any,
    ) -> Any:
        scans = tmp_path / "scans" / "0525"
        scans.mkdir(parents=True)
        for path in open_human.iterdir():
            if path.name != "body.obj":
                (scans / path.name).symlink_to(path)
        source = Scans(
            root=str(tmp_path / "scans"),
            up="y",
            front="z",
            unit="m",
            pattern="*/*.obj",
            estimates=Estimates(root=str(tmp_path / "fits"), **estimates),
            models=str(models),
            **changes,
        )
        (subject,) = [name for name in source.ids() if name.startswith("0525")]
        return source.make(subject, 0, tmp_path / "out")

    def checked(self, subject: Any, open_human: Path, fit: Any) -> None:
        """The body lies where the true one does, but for the clothes before its front."""
        truth = Mesh(fit.body.vertices @ turned(-127).T, fit.body.faces)
        place = subject.mesh_to_world[:3, 3]
        found = subject.body_surface()
        true = truth.vertices[np.unique(truth.faces)] + place
        assert found is not None
        assert len(found.vertices) == pytest.approx(len(true), abs=5)
        (low, high), (true_low, true_high) = found.bounds, (true.min(axis=0), true.max(axis=0))
        np.testing.assert_allclose(low[:2], true_low[:2], atol=2e-3)
        np.testing.assert_allclose(high[:2], true_high[:2], atol=2e-3)
        # The body's front is brought to the clothes', which lie a little before it.
        ahead = (low[2] - true_low[2] + high[2] - true_high[2]) / 2
        assert 0 < ahead < 0.03
        np.testing.assert_allclose(high - low, true_high - true_low, rtol=2e-3)

    @pytest.mark.parametrize("box", [[130.0, 20.0, 380.0, 400.0], np.array([100, 5, 420, 410])])
    def test_pixie(
        self, fit: Any, neutral: Path, open_human: Path, tmp_path: Path, box: Any
    ) -> None:
        # The model turns about its pelvis, so its own frame is shifted from the scan's.
        values = pixie_values(fit, (1.0, 0.0, 0.0), box)
        own = pose(neutral / "SMPLX_NEUTRAL.npz", parameters_from(values, HERE), False)
        bounds = read_mesh(open_human / "open_0000.obj").bounds
        true = fit.body.vertices @ turned(-127).T - (bounds[0] + bounds[1]) / 2
        scale, shift = least_squares(own, in_pixels(true))
        left, top, right, bottom = box
        side = int(1.1 * max(right - left, bottom - top))
        per = 112 * side / 223
        corner = np.array([left + right, top + bottom]) / 2 - side / 2 + 0.5
        s = scale / per
        t = ((shift - corner) / per - 1) / s
        (tmp_path / "fits").mkdir()
        values["body_cam"] = np.array([s, *t], dtype=np.float32)
        (tmp_path / "fits" / "0525_param.pkl").write_bytes(pickle.dumps(values, protocol=2))
        fits = {"files": ["{folder}_param.pkl"]}
        subject = self.made(open_human, tmp_path, fits, neutral)
        self.checked(subject, open_human, fit)
        assert subject.body_parameters["model"] == "pixie"
        assert subject.body_parameters["scan_to_body_mm"] < 35
        assert subject.body is not None
        assert subject.body.name == "estimated.obj"
        assert "fit" not in subject.body_parameters

    @pytest.mark.parametrize("batch", [1, 2, 8])
    def test_pymafx(
        self, fit: Any, neutral: Path, open_human: Path, tmp_path: Path, batch: int
    ) -> None:
        own = fit.body.vertices @ turned(-127).T @ FLIP
        middle = read_mesh(open_human / "open_0000.obj").bounds
        pixels = in_pixels(own @ FLIP - (middle[0] + middle[1]) / 2)
        root = own.mean(axis=0)
        scale, shift = least_squares(own - root, pixels)
        half = np.array([256, 212])
        camera = np.array([*(scale / half), *((shift / half - 1) / (scale / half))])
        people = 3
        names = ["other_f0_p0", "open_0000_f1_p0", "x_f2_p0"]
        draw = np.random.default_rng(0).normal

        def tensor(*shape: int) -> torch.Tensor:
            return torch.tensor(matrices(draw(0, 0.1, (int(np.prod(shape[:-2])), 3)))).reshape(
                shape
            )

        batches = [
            {
                "shape": torch.tensor(draw(size=(n, 10))),
                "body_pose": tensor(n, 24, 3, 3),
                "left_hand_pose": tensor(n, 15, 3, 3),
                "right_hand_pose": tensor(n, 15, 3, 3),
                "jaw_pose": tensor(n, 1, 3, 3),
                "leye_pose": tensor(n, 1, 3, 3),
                "reye_pose": tensor(n, 1, 3, 3),
                "expression": torch.tensor(draw(size=(n, 50))),
            }
            for n in [
                len(part) for part in np.split(np.arange(people), range(batch, people, batch))
            ]
        ]
        vertices = np.stack([draw(size=own.shape), own - root, draw(size=own.shape)])
        output = {
            "pred_cam": draw(size=(people, 3)).astype(np.float32),
            "orig_cam": np.stack([camera * 2, camera, camera / 2]).astype(np.float32),
            "smplx_verts": vertices.astype(np.float32),
            "smplx_params": batches,
            "person_ids": names,
            "frame_ids": np.arange(people),
            "bboxes": draw(size=(people, 4)),
        }
        (tmp_path / "fits").mkdir()
        joblib.dump(output, tmp_path / "fits" / "output.pkl")
        fits = {"files": ["output.pkl"]}
        subject = self.made(open_human, tmp_path, fits, neutral)
        self.checked(subject, open_human, fit)
        record = subject.body_parameters
        assert record["model"] == "pymafx"
        assert record["person"] == "open_0000_f1_p0"
        whole = np.concatenate([part["shape"].numpy() for part in batches])
        np.testing.assert_allclose(record["betas"], whole[1])

    def test_beside_an_exact_body(
        self, fit: Any, neutral: Path, open_human: Path, tmp_path: Path
    ) -> None:
        """The exact body is kept, and the picture's centre is level with it and the scan."""
        low = read_mesh(open_human / "body.obj").vertices - [0, 0.05, 0]  # feet below the floor
        write_mesh(tmp_path / "body.obj", low, read_mesh(open_human / "body.obj").faces)
        (tmp_path / "fits").mkdir()
        values = pixie_values(fit, (1.0, 0.0, 0.0), np.array([100, 5, 420, 410]))
        own = pose(neutral / "SMPLX_NEUTRAL.npz", parameters_from(values, HERE), False)
        bounds = np.array(read_mesh(open_human / "open_0000.obj").bounds)
        bounds[0, 1] = min(bounds[0, 1], low[:, 1].min())
        true = fit.body.vertices @ turned(-127).T - bounds.mean(axis=0)
        scale, shift = least_squares(own, in_pixels(true))
        side = int(1.1 * 405)
        per = 112 * side / 223
        corner = np.array([520, 415]) / 2 - side / 2 + 0.5
        values["body_cam"] = np.array([scale / per, *((shift - corner) / per - 1) / scale * per])
        (tmp_path / "fits" / "0525_param.pkl").write_bytes(pickle.dumps(values, protocol=2))
        (tmp_path / "exact").mkdir()
        (tmp_path / "exact" / "0525.obj").symlink_to(tmp_path / "body.obj")
        subject = self.made(
            open_human,
            tmp_path,
            {"files": ["{folder}_param.pkl"]},
            neutral,
            fits=Fits(root=str(tmp_path / "exact"), mesh=["{folder}.obj"]),
            max_scan_to_body=0.1,
            max_body_to_scan=0.1,
        )
        self.checked(subject, open_human, fit)
        assert subject.body.name == "estimated.obj"
        assert {"body.obj", "fit_mesh.obj", "estimate.pkl"} <= {f.name for f in subject.files}
        assert subject.body_parameters["model"] == "pixie"
        assert subject.body_parameters["fit"]["model"] == "mesh"

    @pytest.mark.parametrize("size", [0.4, 1.6])
    def test_of_another_size(
        self, fit: Any, neutral: Path, open_human: Path, tmp_path: Path, size: float
    ) -> None:
        """The picture's pixels were not what the settings say."""
        (tmp_path / "fits").mkdir()
        values = pixie_values(fit, (1.0, 0.0, 0.0), np.array([100, 5, 420, 410]))
        own = pose(neutral / "SMPLX_NEUTRAL.npz", parameters_from(values, HERE), False)
        bounds = np.array(read_mesh(open_human / "open_0000.obj").bounds)
        true = fit.body.vertices @ turned(-127).T - bounds.mean(axis=0)
        scale, shift = least_squares(own, in_pixels(true * size))
        side = int(1.1 * 405)
        per = 112 * side / 223
        corner = np.array([520, 415]) / 2 - side / 2 + 0.5
        values["body_cam"] = np.array([scale / per, *((shift - corner) / per - 1) / scale * per])
        (tmp_path / "fits" / "0525_param.pkl").write_bytes(pickle.dumps(values, protocol=2))
        with pytest.raises(
            MeshError, match=r"estimate.*another size|_param\.pkl' is of another size"
        ):
            self.made(open_human, tmp_path, {"files": ["{folder}_param.pkl"]}, neutral)

    def test_through_a_build(
        self, fit: Any, neutral: Path, open_human: Path, tmp_path: Path
    ) -> None:
        """The maps of the shard are the estimate's, the exact body is kept beside it."""
        scans = tmp_path / "scans" / "p"
        scans.mkdir(parents=True)
        for path in open_human.iterdir():
            (scans / path.name.replace("open_0000", "p")).symlink_to(path)
        values = pixie_values(fit, (1.0, 0.0, 0.0), np.array([100, 5, 420, 410]))
        own = pose(neutral / "SMPLX_NEUTRAL.npz", parameters_from(values, HERE), False)
        bounds = np.array(read_mesh(open_human / "open_0000.obj").bounds)
        body = read_mesh(open_human / "body.obj").bounds
        bounds[0, 1], bounds[1, 1] = min(bounds[0, 1], body[0][1]), max(bounds[1, 1], body[1][1])
        true = fit.body.vertices @ turned(-127).T - bounds.mean(axis=0)
        scale, shift = least_squares(own, in_pixels(true))
        side = int(1.1 * 405)
        per = 112 * side / 223
        corner = np.array([520, 415]) / 2 - side / 2 + 0.5
        values["body_cam"] = np.array([scale / per, *((shift - corner) / per - 1) / scale * per])
        (tmp_path / "pixie" / "p").mkdir(parents=True)
        pickled = pickle.dumps(values, protocol=2)
        (tmp_path / "pixie" / "p" / "p_param.pkl").write_bytes(pickled)
        data = tmp_path / "data"
        for command in (
            ["build", "--config", str(ROOT / "configs" / "scans.yaml"), "--output", str(data),
             "--subjects.root", str(tmp_path / "scans"), "--subjects.pattern", "*/p.obj",
             "--subjects.estimates.root", str(tmp_path / "pixie"), "--subjects.estimates.files",
             '["{id}/{id}_param.pkl"]', "--subjects.models", str(neutral),
             "--views.yaw_deg", "[0, 25]", "--cycles.samples", "2", "--jobs", "1"],
            ["verify", str(data)],
        ):  # fmt: skip
            result = subprocess.run(
                [sys.executable, str(ROOT / "pipeline.py"), *command],
                capture_output=True, text=True, timeout=300, check=False,
            )  # fmt: skip
            assert result.returncode == 0, result.stdout + result.stderr
        shard = Dataset(data).shard("p")
        record = shard.meta["body_parameters"]
        assert shard.meta["body"] == "subjects/p/estimated.obj"
        assert record["model"] == "pixie"
        assert record["fit"]["model"] == "mesh"
        assert (data / "subjects" / "p" / "body.obj").is_file()
        both = (shard["body_depth_front"] > 0) & shard["mask"]
        assert both.sum() > 0.95 * (shard["body_depth_front"] > 0).sum()
        # Brought to the clothes' front, half of the body's lies before it and half behind.
        ahead = (shard["depth_front"] - shard["body_depth_front"])[0][both[0]]
        assert abs(np.median(ahead)) < 2e-3

    def test_far_from_its_scan(
        self, fit: Any, neutral: Path, open_human: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "fits").mkdir()
        values = pixie_values(fit, (0.9, 5.0, 0.0), np.array([100, 5, 420, 410]))
        (tmp_path / "fits" / "0525_param.pkl").write_bytes(pickle.dumps(values, protocol=2))
        fits = {"files": ["{folder}_param.pkl"]}
        with pytest.raises(MeshError, match="does not lie over it"):
            self.made(open_human, tmp_path, fits, neutral)


class TestFiles:
    def read(self, tmp_path: Path, models: Path, **changes: Any) -> Estimate:
        path = tmp_path / "output.pkl"
        whole = {"body_pose": np.tile(np.eye(3), (2, 24, 1, 1)), "shape": np.ones((2, 10))}
        output = {
            "orig_cam": np.ones((2, 4)),
            "smplx_verts": np.zeros((2, 10475, 3)),
            "smplx_params": [whole],
            "person_ids": ["0525_f0_p0", "b_f1_p0"],
        }
        joblib.dump(output | changes, path)
        return read_estimate(path, PLACE, str(models))

    def test_the_person_of_a_picture(self, tmp_path: Path, neutral: Path) -> None:
        """By the id, which is one scan's alone, before the name."""
        names = ["scan_f0_p0", "0525_f1_p0"]
        found = self.read(tmp_path, neutral, person_ids=names)
        assert found.record["person"] == "0525_f1_p0"
        assert found.record["model_file"] == "SMPLX_NEUTRAL.npz"

    @pytest.mark.parametrize(
        ("changes", "said"),
        [
            ({"person_ids": ["a_f0_p0", "b_f1_p0"]}, "has nobody of a picture called '0525'"),
            ({"person_ids": ["0525_f0_p0", "0525_f0_p1"]}, "has 2 people of a picture"),
            ({"person_ids": ["0525_f0_p0"]}, "2 cameras and 1 person_ids"),
            ({"person_ids": None}, "2 cameras and 0 person_ids"),
            ({"orig_cam": [[1, 2], [3]]}, "orig_cam is not"),
            ({"smplx_params": [{"body_pose": [[1, 2], [3]]}]}, "not of 2 people"),
            ({"smplx_verts": np.zeros((3, 10475, 3))}, "smplx_verts is"),
            ({"smplx_verts": np.zeros((2, 6890, 3))}, r"smplx_verts is \(2, 6890, 3\)"),
            ({"smplx_params": None}, "no list of smplx_params"),
            ({"smplx_params": [{"body_pose": np.zeros((1, 24, 3, 3))}]}, "not of 2 people"),
            ({"smplx_params": [{}]}, "lack body_pose"),
            ({"orig_cam": np.full((2, 4), np.nan)}, "orig_cam is not"),
        ],
    )
    def test_damaged_output(
        self, tmp_path: Path, neutral: Path, changes: dict[str, Any], said: str
    ) -> None:
        with pytest.raises(MeshError, match=said) as error:
            self.read(tmp_path, neutral, **changes)
        assert str(error.value).startswith(f"{tmp_path / 'output.pkl'}: ")
        assert "\n" not in str(error.value)

    def test_a_fit_is_no_estimate(self, tmp_path: Path) -> None:
        path = tmp_path / "fit.npz"
        np.savez(path, betas=np.zeros(10), body_pose=np.zeros(63))
        with pytest.raises(MeshError, match=r"neither PIXIE's body_cam.*subjects\.fits"):
            read_estimate(path, PLACE, None)

    def test_no_estimate_of_a_scan(self, tmp_path: Path) -> None:
        estimates = Estimates(files=["{id}/{id}_param.pkl"], root=str(tmp_path))
        with pytest.raises(MeshError, match=r"'0525' has no estimate: '0525/0525_param\.pkl' is"):
            estimates.read(PLACE, tmp_path, None, 1)
        assert Estimates().read(PLACE, tmp_path, None, 1) is None

    def test_wrong_settings(self) -> None:
        with pytest.raises(ValueError, match=r"^subjects\.estimates\.root: "):
            Estimates(root="pixie")
        with pytest.raises(ValueError, match=r"^subjects\.estimates\.files: "):
            Estimates(files=["../{id}.pkl"])
        for name, value in (("rows", 0), ("columns", -1), ("pixel_size", 2.0)):
            with pytest.raises(ValueError, match=rf"^subjects\.estimates\.picture\.{name}: "):
                Picture(**{name: value})


def turned(degrees: float) -> np.ndarray:
    return Rotation.from_euler("y", degrees, degrees=True).as_matrix()
