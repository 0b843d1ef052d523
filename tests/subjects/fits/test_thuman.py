"""THuman2.0's layout, made here: metric, facing the camera, its body in place; and bad input."""

from __future__ import annotations

import dataclasses
import json
import os
import pickle  # noqa: TID251 - written here, read only by the code under test
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation
from trimesh.caching import tracked_array

from shards.dataset import Dataset
from subjects.fits.body import Body
from subjects.fits.fits import Fits
from subjects.mesh import MeshError
from subjects.meshfile import read_mesh
from subjects.scans import Scans

ROOT = Path(__file__).parents[3]
TURN = Rotation.from_euler("y", 127.0, degrees=True).as_matrix()
SCALE = 0.4335
SHIFT = np.array([0.11, -0.52, 0.04])


def write_scan(human: Path, folder: Path, matrix: np.ndarray) -> Path:
    """An open human as the release stores a scan: moved by `matrix` (4, 4), FOLDER/FOLDER.obj."""
    folder.mkdir(parents=True)
    lines = []
    for line in (human / "open_0000.obj").read_text().splitlines():
        if line.startswith("v "):
            place = matrix[:3, :3] @ np.array(line.split()[1:], dtype=float) + matrix[:3, 3]
            line = "v {:.9f} {:.9f} {:.9f}".format(*place)
        lines.append(line)
    path = folder / f"{folder.name}.obj"
    path.write_text("\n".join(lines) + "\n")
    shutil.copy(human / "material0.mtl", folder)
    shutil.copy(human / "material0.jpeg", folder)
    return path


def write_fit(path: Path, values: dict[str, Any]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps(values))
    return path


def write_posed(path: Path, fit: Any) -> None:
    """`mesh_smplx.obj`: the posed body in the scan's coordinates."""
    vertices = fit.body.vertices * SCALE + SHIFT
    lines = [*("v {:.9f} {:.9f} {:.9f}".format(*v) for v in vertices)]
    lines += ["f {} {} {}".format(*f) for f in fit.body.faces + 1]
    path.write_text("\n".join(lines) + "\n")


def released() -> np.ndarray:
    """(4, 4) that turns, scales and moves an open human as the release does a scan."""
    matrix = np.eye(4)
    matrix[:3, :3] = SCALE * TURN
    matrix[:3, 3] = SHIFT
    return matrix


def parameters(fit: Any, **changes: Any) -> dict[str, Any]:
    """As THuman2.0 pickles them, scale and translation as trimesh's arrays."""
    return fit.values | {
        "scale": tracked_array(np.array(SCALE)),
        "translation": tracked_array(SHIFT),
        **changes,
    }


def source(root: Path, models: Path | None, **changes: Any) -> Scans:
    fits = {
        "root": str(root / "smplx"),
        "mesh": ["{folder}/mesh_smplx.obj"],
        "parameters": ["{folder}/smplx_param.pkl"],
    }
    given: dict[str, Any] = {
        "root": str(root / "scans"),
        "up": "y",
        "front": "body",
        "unit": "body",
    }
    given["models"] = None if models is None else str(models)
    return Scans(**given | changes, fits=Fits(**fits))


@pytest.fixture(scope="module")
def thuman(open_human: Path, fit: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scans of one human: 0000 with parameters alone, 0001 with its posed body too."""
    root = tmp_path_factory.mktemp("thuman")
    for name in ("0000", "0001"):
        write_scan(open_human, root / "scans" / name, released())
        write_fit(root / "smplx" / name / "smplx_param.pkl", parameters(fit))
    write_posed(root / "smplx" / "0001" / "mesh_smplx.obj", fit)
    return root


class TestPlacement:
    @pytest.mark.parametrize("subject", ["0000", "0001"])
    def test_metric_and_facing_the_camera(
        self, thuman: Path, models: Path, open_human: Path, tmp_path: Path, subject: str
    ) -> None:
        """Every vertex is where it is in the human that the scan was made of."""
        made = source(thuman, models).make(subject, 0, tmp_path)
        matrix = made.mesh_to_world @ released()
        size = np.cbrt(np.linalg.det(matrix[:3, :3]))
        assert size == pytest.approx(1, abs=1e-3)
        turn = matrix[:3, :3] / size
        assert abs(np.degrees(np.arctan2(turn[0, 2], turn[2, 2]))) < 0.5
        assert turn[1, 1] == pytest.approx(1, abs=1e-6)

        surface, truth = made.surface(), read_mesh(open_human / "open_0000.obj")
        low, high = truth.bounds
        shift = [(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2]
        assert np.abs(surface.vertices - (truth.vertices - shift)).max() < 1e-5
        body, bare = made.body_surface(), read_mesh(open_human / "body.obj")
        assert body is not None
        np.testing.assert_allclose(body.bounds, np.array(bare.bounds) - shift, atol=2e-3)

    def test_body_of_parameters_is_the_posed_one(
        self, thuman: Path, models: Path, tmp_path: Path
    ) -> None:
        bodies = [
            source(thuman, models).make(name, 0, tmp_path / name).body_surface()
            for name in ("0000", "0001")
        ]
        assert bodies[0] is not None
        assert bodies[1] is not None
        assert np.abs(bodies[0].vertices - bodies[1].vertices).max() < 1e-5
        assert np.array_equal(bodies[0].faces, bodies[1].faces)

    def test_what_is_recorded(self, thuman: Path, models: Path, tmp_path: Path, fit: Any) -> None:
        made = source(thuman, models).make("0000", 0, tmp_path)
        record = json.loads(json.dumps(made.body_parameters))
        assert record["model"] == "smplx"
        assert record["scale"] == pytest.approx(SCALE)
        assert record["gender"] == "male"
        assert record["flat_hand_mean"] is False
        assert record["model_file"] == "SMPLX_MALE.npz"
        assert len(record["model_sha256"]) == 64
        np.testing.assert_allclose(np.array(record["body_to_scan"])[:3, 3], SHIFT)
        np.testing.assert_allclose(record["translation"], SHIFT)
        np.testing.assert_allclose(np.ravel(record["body_pose"]), fit.values["body_pose"][0])
        assert 5 < record["scan_to_body_mm"] < 35
        assert 2 < record["body_to_scan_mm"] < record["scan_to_body_mm"]
        # A changed fit is a changed subject.
        assert (tmp_path / "fit_parameters.pkl") in made.files

    def test_the_other_order_and_axes_of_2_1(
        self, open_human: Path, fit: Any, models: Path, tmp_path: Path
    ) -> None:
        """z up, hands of 45 values, (SMPL-X + transl) * scale: all told by the file."""
        axes = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
        transl = np.array([0.2, 0.1, -0.4])
        # SMPL-X turns about the pelvis, so turning its body is a turn and a shift.
        regressor = fit.model["J_regressor"][0]
        shape = np.concatenate([fit.values["betas"][0], fit.values["expression"][0]])
        shapedirs = fit.model["shapedirs"]
        dirs = np.concatenate([shapedirs[..., :10], shapedirs[..., 300:310]], axis=2)
        pelvis = regressor @ (fit.model["v_template"] + dirs @ shape)
        shift = transl + pelvis - axes @ pelvis
        matrix = np.eye(4)
        matrix[:3, :3] = SCALE * axes @ TURN
        matrix[:3, 3] = SCALE * shift
        write_scan(open_human, tmp_path / "scans" / "0526", matrix)
        hands = {
            f"{side}_hand_pose": (
                fit.values[f"{side}_hand_pose"][0] @ fit.model[f"hands_components{side[0]}"][:12]
            )
            for side in ("left", "right")
        }
        whole = axes @ Rotation.from_rotvec(fit.values["global_orient"][0]).as_matrix()
        orient = Rotation.from_matrix(whole).as_rotvec()
        values = fit.values | hands | {"global_orient": orient[None], "transl": transl}
        values |= {"scale": np.array([SCALE])}
        write_fit(tmp_path / "smplx" / "0526" / "smplx_param.pkl", values)
        (tmp_path / "neutral").mkdir()
        (tmp_path / "neutral" / "SMPLX_NEUTRAL.npz").symlink_to(models / "smplx/SMPLX_MALE.npz")
        made = source(tmp_path, tmp_path / "neutral", up="body").make("0526", 0, tmp_path / "out")
        surface, truth = made.surface(), read_mesh(open_human / "open_0000.obj")
        low, high = truth.bounds
        shift = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
        assert np.abs(surface.vertices - (truth.vertices - shift)).max() < 1e-5
        assert made.body_parameters["scan_to_body_mm"] < 20

    def test_a_metric_fit_of_a_scan_in_centimetres(
        self, open_human: Path, fit: Any, models: Path, tmp_path: Path
    ) -> None:
        """Without a scale of its own the fit takes the unit that is stated, and needs one."""
        matrix = np.eye(4)
        matrix[:3, :3] = 100 * TURN
        write_scan(open_human, tmp_path / "scans" / "a", matrix)
        write_fit(tmp_path / "smplx" / "a" / "smplx_param.pkl", fit.values)
        made = source(tmp_path, models, unit="cm").make("a", 0, tmp_path / "out")
        assert made.body_parameters["scan_to_body_mm"] < 20
        posed = Fits(
            root=str(tmp_path / "smplx"),
            mesh=["{folder}/body.obj"],
            parameters=["{folder}/smplx_param.pkl"],
        )
        shutil.copy(tmp_path / "out" / "body.obj", tmp_path / "smplx" / "a")
        both = dataclasses.replace(source(tmp_path, models, unit="cm"), fits=posed)
        again = both.make("a", 0, tmp_path / "again").body_parameters
        assert again["mesh_to_parameters_mm"] < 0.01
        surface, truth = made.surface(), read_mesh(open_human / "open_0000.obj")
        np.testing.assert_allclose(np.ptp(surface.bounds, 0), np.ptp(truth.bounds, 0), atol=1e-5)
        with pytest.raises(MeshError, match=r"without a scale; .* or the scans' subjects\.unit"):
            source(tmp_path, models).make("a", 0, tmp_path / "out")

    def test_a_unit_that_contradicts_the_fit(
        self, thuman: Path, models: Path, tmp_path: Path
    ) -> None:
        """Metres were 1, the fit says 0.4335: people of 0.75 m."""
        with pytest.raises(MeshError, match=r"scale of 0\.4335 .* give subjects\.unit: body"):
            source(thuman, models, unit="m").make("0000", 0, tmp_path)

    @pytest.mark.parametrize("up", ["z", "-z", "x", "-y"])
    def test_an_axis_that_is_not_up(
        self, thuman: Path, models: Path, tmp_path: Path, up: str
    ) -> None:
        with pytest.raises(
            MeshError, match=rf"lies or stands on its head .* subjects\.up is {up};"
        ):
            source(thuman, models, up=up).make("0000", 0, tmp_path)

    def test_a_mesh_alone_has_no_scale(self, thuman: Path, tmp_path: Path) -> None:
        shutil.copytree(thuman, tmp_path / "in")
        (tmp_path / "in" / "smplx" / "0001" / "smplx_param.pkl").unlink()
        with pytest.raises(MeshError, match=r"mesh_smplx\.obj' without a scale"):
            source(tmp_path / "in", None, front="z").make("0001", 0, tmp_path / "out")

    @pytest.mark.parametrize(
        "changes",
        [
            {"scale": np.array(1.25 * SCALE)},
            {"global_orient": np.array([[0.0, 0.3, 0.0]])},
            {"body_pose": np.zeros((1, 63))},
        ],
    )
    def test_a_posed_mesh_and_parameters_of_others(
        self, thuman: Path, models: Path, tmp_path: Path, fit: Any, changes: dict[str, Any]
    ) -> None:
        root = tmp_path / "in"
        shutil.copytree(thuman, root)
        good = source(root, models).make("0001", 0, tmp_path / "out")
        assert good.body_parameters["mesh_to_parameters_mm"] < 0.01
        write_fit(root / "smplx" / "0001" / "smplx_param.pkl", parameters(fit, **changes))
        with pytest.raises(MeshError, match=r"mesh_smplx\.obj: is \d+ mm from the body of its par"):
            source(root, models).make("0001", 0, tmp_path / "out")

    def test_two_scans_with_one_fit(self, thuman: Path, models: Path, tmp_path: Path) -> None:
        """Another OBJ lies in a scan's folder."""
        root = tmp_path / "in"
        shutil.copytree(thuman, root)
        shutil.copy(root / "scans" / "0000" / "0000.obj", root / "scans" / "0000" / "other.obj")
        found = source(root, models, pattern="*/*.obj")
        assert found.ids() == ["0000", "0000_other", "0001"]
        for name in ("0000", "0000_other"):
            with pytest.raises(MeshError, match=r"has the same fit as '0000.*subjects\.pattern"):
                found.make(name, 0, tmp_path / "out")

    def test_a_fit_that_went_wrong_is_set_aside(
        self, thuman: Path, models: Path, tmp_path: Path, fit: Any
    ) -> None:
        """Shifted by a decimetre, as early fits were."""
        root = tmp_path / "in"
        shutil.copytree(thuman, root)
        wrong = parameters(fit, translation=SHIFT + np.array([0.1 * SCALE, 0, 0]))
        write_fit(root / "smplx" / "0000" / "smplx_param.pkl", wrong)
        with pytest.raises(MeshError, match=r"is off its body.*scan to body \d+\.\d mm") as error:
            source(root, models).make("0000", 0, tmp_path / "out")
        assert "35.0 mm are allowed" in str(error.value)
        kept = source(root, models, max_scan_to_body=0.1, max_body_to_scan=0.1).make(
            "0000", 0, tmp_path / "out"
        )
        assert kept.body_parameters["scan_to_body_mm"] > 35

    def test_an_edited_fit_is_noticed(
        self, thuman: Path, models: Path, tmp_path: Path, fit: Any
    ) -> None:
        root = tmp_path / "in"
        shutil.copytree(thuman, root)
        made = source(root, models).make("0000", 0, tmp_path / "out")
        before = made.content_sha256()
        write_fit(root / "smplx" / "0000" / "smplx_param.pkl", parameters(fit, betas=np.ones(10)))
        assert made.content_sha256() != before


class Runs:
    """Unpickled without care, it makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return os.system, (f"touch {self.path}",)


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(ROOT / "pipeline.py"), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


@pytest.fixture(scope="module")
def built(
    thuman: Path, open_human: Path, fit: Any, models: Path, tmp_path_factory: Any
) -> dict[str, Any]:
    """A build of `configs/thuman2.yaml` over good and bad subjects, and one of the human itself."""
    root = tmp_path_factory.mktemp("build")
    scans, smplx = root / "THuman2.0_Release", root / "THuman2.0_smplx"
    shutil.copytree(thuman / "scans", scans)
    shutil.copytree(thuman / "smplx", smplx)

    def bad(name: str, obj: str | None = None, values: dict[str, Any] | None = None) -> Path:
        """One more subject, whole but for what is given."""
        folder = scans / name
        shutil.copytree(scans / "0000", folder)
        (folder / "0000.obj").rename(folder / f"{name}.obj")
        if obj is not None:
            (folder / f"{name}.obj").write_text(obj)
        return write_fit(smplx / name / "smplx_param.pkl", values or parameters(fit))

    ran = root / "ran"
    bad("0002").write_bytes(pickle.dumps({"betas": Runs(ran)}))
    path = bad("0003")
    path.write_bytes(path.read_bytes()[:-40])
    bad("0004").unlink()
    write_fit(smplx / "0005" / "smplx_param.pkl", parameters(fit))
    bad("0006", values=parameters(fit, body_pose=np.zeros((1, 69), dtype=np.float32)))
    bad("0007")
    Image.new("RGB", (2, 2)).save(scans / "secret.png")
    mtl = scans / "0007" / "material0.mtl"
    mtl.write_text(mtl.read_text().replace("map_Kd material0.jpeg", "map_Kd ../secret.png"))
    bad("0008", obj="v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    path = bad("0009")
    shutil.rmtree(scans / "0009")
    (scans / "0009").mkdir()
    body = json.dumps({"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "scene": 0})
    body += " " * (-len(body) % 4)
    chunk = struct.pack("<II", len(body), 0x4E4F534A) + body.encode()
    (scans / "0009" / "0009.glb").write_bytes(
        b"glTF" + struct.pack("<II", 2, 12 + len(chunk)) + chunk
    )
    bad("0010", values=parameters(fit, translation=SHIFT + np.array([0, 0, 0.1])))
    data, truth = root / "data", root / "truth"
    views = ("--views.yaw_deg", "[0, -25]", "--cycles.samples", 2, "--jobs", 1)
    call = (
        "build", "--config", ROOT / "configs" / "thuman2.yaml", "--output", data, *views,
        "--subjects.root", scans, "--subjects.fits.root", smplx,
        "--subjects.models", models, "--subjects.pattern", "[0-9]*/*",
    )  # fmt: skip
    result = run(*call)
    plain = root / "plain"
    shutil.copytree(open_human, plain / "0000", ignore=shutil.ignore_patterns("param*"))
    direct = run(
        "build", "--config", ROOT / "configs" / "scans.yaml", "--output", truth, *views,
        "--subjects.root", plain,
    )  # fmt: skip
    assert direct.returncode == 0, direct.stderr
    made = {"call": call, "smplx": smplx, "result": result}
    return made | {"data": data, "truth": truth, "ran": ran}


def checksums(dataset: Path) -> dict[str, str]:
    """Subject to the checksum that the manifest states."""
    lines = (dataset / "manifest.jsonl").read_text().splitlines()
    return {entry["subject"]: entry["sha256"] for entry in map(json.loads, lines)}


class TestBuild:
    def test_good_subjects_are_built_and_sound(self, built: dict[str, Any]) -> None:
        assert built["result"].returncode == 1
        assert Dataset(built["data"]).subjects() == ["0000", "0001"]
        verified = run("verify", built["data"])
        assert verified.returncode == 0, verified.stdout

    @pytest.mark.parametrize("subject", ["0000", "0001"])
    def test_maps_are_the_humans_own(self, built: dict[str, Any], subject: str) -> None:
        """The scan and the human it was made of give the same maps of surface and body."""
        shard = Dataset(built["data"]).shard(subject)
        truth = Dataset(built["truth"]).shard("0000_open_0000")
        differ = shard["mask"] != truth["mask"]
        assert differ.sum() < 1e-3 * truth["mask"].sum()
        both = shard["mask"] & truth["mask"]
        for name in ("depth_front", "depth_back"):
            assert np.median(np.abs(shard[name] - truth[name])[both]) < 1e-5
        body = (shard["body_depth_front"] > 0) & (truth["body_depth_front"] > 0)
        assert body.sum() > 0.99 * (truth["body_depth_front"] > 0).sum()
        for name in ("body_depth_front", "body_depth_back"):
            # SMPL-X's mesh is the body's with fewer triangles.
            off = np.abs(shard[name] - truth[name])[body]
            assert np.median(off) < 1e-3
            assert np.percentile(off, 95) < 5e-3
        # The body itself gives the maps that were rendered of it.
        camera = shard.meta["camera"]
        file = built["data"] / shard.meta["body"]
        placed = read_mesh(file).transformed(np.array(shard.meta["mesh_to_world"]))
        i, j = np.mgrid[: camera["size"][0], : camera["size"][1]]
        xy = np.stack([j + 0.5 - j.shape[1] / 2, i.shape[0] / 2 - i - 0.5], axis=-1)
        maps = Body(placed.vertices, placed.faces).depth_maps(
            xy * camera["pixel_size"], np.linalg.inv(shard["camera_to_world"][1])
        )
        for name, own in zip(("body_depth_front", "body_depth_back"), maps, strict=True):
            rendered = shard[name][1]
            assert ((own > 0) != (rendered > 0)).sum() <= 2
            both_seen = (own > 0) & (rendered > 0)
            assert np.abs(own - rendered)[both_seen].max() < 1e-4
        # How far the clothes lie before the body is known, and found again.
        known = np.median((truth["body_depth_front"] - truth["depth_front"])[body & both])
        found = np.median((shard["body_depth_front"] - shard["depth_front"])[body & both])
        assert known > 2e-3
        assert found == pytest.approx(known, abs=1e-3)

    def test_distance_is_in_the_shard_and_the_same(self, built: dict[str, Any]) -> None:
        ours = Dataset(built["data"]).shard("0000").meta["body_parameters"]
        truth = Dataset(built["truth"]).shard("0000_open_0000").meta["body_parameters"]
        assert ours["scan_to_body_mm"] == pytest.approx(truth["scan_to_body_mm"], abs=0.5)
        assert truth["model"] == "mesh"

    @pytest.mark.parametrize(
        ("subject", "said"),
        [
            ("0002", ["asks for posix.system", "nothing in it was run"]),
            ("0003", ["smplx_param.pkl", "truncated"]),
            ("0004", ["has no fit", "0004/smplx_param.pkl", "subjects.fits"]),
            ("0005", ["is a fit without a scan"]),
            ("0006", ["body_pose of shape (1, 69)", "SMPL's"]),
            ("0007", ["'../secret.png'", "outside its folder"]),
            ("0008", ["0008.obj", "names v 9, but there are 3"]),
            ("0009", ["0009.glb", "no surface"]),
            ("0010", ["is off its body", "35.0 mm are allowed"]),
        ],
    )
    def test_bad_ones_are_set_aside_in_one_line(
        self, built: dict[str, Any], subject: str, said: list[str]
    ) -> None:
        lines = (built["data"] / "failures.jsonl").read_text().splitlines()
        failures = {entry["subject"]: entry for entry in map(json.loads, lines)}
        assert len(failures) == 9
        reason = failures[subject]["reason"]
        assert failures[subject]["stage"] == "subjects"
        assert "\n" not in reason
        for part in said:
            assert part in reason
        assert "Traceback" not in built["result"].stderr

    def test_splits_are_of_scans_alone(self, built: dict[str, Any]) -> None:
        dataset = Dataset(built["data"])
        assert "0005" not in {*dataset.subjects("train"), *dataset.subjects("test")}
        assert "1 set aside beforehand" in built["result"].stderr
        assert "9 set aside" in built["result"].stdout

    def test_an_edited_fit_makes_the_subject_again(self, built: dict[str, Any], fit: Any) -> None:
        """Built once more it stays; with another fit it is made anew."""
        again = run(*built["call"])
        assert "0 made now" in again.stdout
        before = checksums(built["data"])
        values = parameters(fit, translation=SHIFT + np.array([0.002, 0, 0]))
        write_fit(built["smplx"] / "0000" / "smplx_param.pkl", values)
        edited = run(*built["call"])
        assert "1 made now" in edited.stdout
        after = checksums(built["data"])
        assert after["0000"] != before["0000"]
        assert after["0001"] == before["0001"]
        write_fit(built["smplx"] / "0000" / "smplx_param.pkl", parameters(fit))
        assert run(*built["call"]).returncode == 1
        assert checksums(built["data"]) == before

    def test_nothing_was_run(self, built: dict[str, Any]) -> None:
        assert not built["ran"].exists()

    def test_the_card_forbids_sharing(self, built: dict[str, Any]) -> None:
        card = (built["data"] / "README.md").read_text()
        assert "Redistributable: no" in card
        assert "THuman2.0 Agreement" in card


class TestPart:
    """A part of a set: fits whose scans are not there."""

    @pytest.fixture
    def part(self, thuman: Path, tmp_path: Path) -> Path:
        shutil.copytree(thuman, tmp_path / "in")
        shutil.rmtree(tmp_path / "in" / "scans" / "0000")
        return tmp_path / "in"

    def test_they_are_refused_and_no_subjects(self, part: Path) -> None:
        """So they have no say in which scans are for testing."""
        found = source(part, None)
        assert found.ids() == ["0001"]
        (reason,) = found.refused().values()
        assert list(found.refused()) == ["0000"]
        assert "0000/smplx_param.pkl: is a fit without a scan" in reason
        assert "subjects.fits.unmatched: ignored" in reason

    def test_they_may_be_ignored(self, part: Path) -> None:
        kept = source(part, None)
        ignoring = dataclasses.replace(
            kept, fits=dataclasses.replace(kept.fits, unmatched="ignored")
        )
        assert ignoring.refused() == {}

    def test_a_scan_that_the_pattern_leaves_out_is_there(self, thuman: Path) -> None:
        assert source(thuman, None, pattern="0001/*.obj").refused() == {}

    def test_a_look_at_the_first_few_is_of_scans(self, part: Path) -> None:
        assert source(part, None, limit=1).refused() == {}
