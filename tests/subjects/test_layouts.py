"""The layouts of public scan sets, made here, read by the calls that their pages print."""

from __future__ import annotations

import json
import pickle  # noqa: TID251 - written here, read only by the code under test
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from jsonargparse import ArgumentError, ArgumentParser
from PIL import Image
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import pipeline
from shards.archive import write_shard
from shards.dataset import DatasetWriter
from shards.licences import is_redistributable
from subjects.mesh import MeshError
from subjects.scans import Scans
from subjects.scans.folder import scan_id
from subjects.subject import Subject
from tests.shards.conftest import CONFIG, closed_form_arrays, closed_form_meta

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs" / "scans").glob("*.md"))
COLOR = (200, 120, 40)
ROOTS = ("root", "fits.root")
BARE = 0.012
"""Metres by which a body lies under its scan."""

Z_UP = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
"""From y up to the axes of THuman2.1's second batch."""


def person(inset: float = 0.0) -> trimesh.Trimesh:
    """A person of boxes, 1.7 m, y up, facing +z: a nose in front, a hand on the left, at +x."""
    boxes = [
        ((-0.25, 0, -0.15), (0.25, 1.7, 0.15)),
        ((-0.02, 1.5, 0.15), (0.02, 1.6, 0.2)),
        ((0.25, 0.7, -0.05), (0.55, 0.8, 0.05)),
    ]
    return trimesh.util.concatenate(
        [
            trimesh.creation.box(bounds=[np.array(low) + inset, np.array(high) - inset])
            for low, high in boxes
        ]
    )


def similarity(scale: float = 1.0, turn: Any = None, shift: Any = (0, 0, 0)) -> np.ndarray:
    """(4, 4) from the person to a file's coordinates."""
    matrix = np.eye(4)
    matrix[:3, :3] = scale * (np.eye(3) if turn is None else turn)
    matrix[:3, 3] = shift
    return matrix


def yaw(degrees: float) -> np.ndarray:
    turn: np.ndarray = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    return turn


def write_obj(path: Path, matrix: np.ndarray, inset: float = 0.0, mtl: str | None = None) -> None:
    """The person as OBJ; with materials from `mtl`, one pixel of which covers it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh = person(inset).apply_transform(matrix)
    lines = ["v {:.9f} {:.9f} {:.9f}".format(*vertex) for vertex in mesh.vertices]
    if mtl is None:
        lines += ["f {} {} {}".format(*face) for face in mesh.faces + 1]
    else:
        lines = [f"mtllib {mtl}", *lines, "vt 0.5 0.5", "usemtl person"]
        lines += ["f {}/1 {}/1 {}/1".format(*face) for face in mesh.faces + 1]
    path.write_text("\n".join(lines) + "\n")


def write_image(path: Path, color: tuple[int, int, int] = COLOR, side: int = 8) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (side, side), color).save(path, quality=100)


def write_textured(path: Path, matrix: np.ndarray, mtl: str, image: str) -> None:
    write_obj(path, matrix, mtl=mtl)
    (path.parent / mtl).write_text(f"newmtl person\nKd 1 1 1\nmap_Kd {image}\n")
    write_image(path.parent / image)


def write_smplx(folder: Path, matrix: np.ndarray, hands: int, **place: Any) -> None:
    """THuman's two files of one fit: the pose is the model's own but for the pelvis."""
    write_obj(folder / "mesh_smplx.obj", matrix, BARE)
    turn = matrix[:3, :3] / np.cbrt(np.linalg.det(matrix[:3, :3]))
    values = {
        "betas": np.zeros((1, 10), dtype=np.float32),
        "global_orient": Rotation.from_matrix(turn).as_rotvec()[None].astype(np.float32),
        "body_pose": np.zeros((1, 63), dtype=np.float32),
        "left_hand_pose": np.zeros((1, hands), dtype=np.float32),
        "right_hand_pose": np.zeros((1, hands), dtype=np.float32),
        **place,
    }
    (folder / "smplx_param.pkl").write_bytes(pickle.dumps(values))


def thuman2(root: Path) -> None:
    for name, scale, degrees in (("0000", 0.4335, 127), ("0525", 51.0, -60)):
        shift = np.array([0.1, -0.5, 0.04]) * scale
        matrix = similarity(scale, yaw(degrees), shift)
        scan = root / "THuman2.0_Release" / name / f"{name}.obj"
        write_textured(scan, matrix, "material0.mtl", "material0.jpeg")
        write_obj(scan.with_name("decimated.obj"), matrix)
        fit = root / "THuman2.0_smplx" / name
        write_smplx(fit, matrix, 12, scale=np.array(scale), translation=shift)


def thuman21(root: Path) -> None:
    for name, turn in (("0000", yaw(40)), ("0525", yaw(-170)), ("0526", Z_UP @ yaw(100))):
        scale, transl = 0.6, np.array([0.2, 0.1, -0.4], dtype=np.float32)
        matrix = similarity(scale, turn, scale * transl)
        scan = root / "THuman2.1" / "model" / name / f"{name}.obj"
        write_textured(scan, matrix, "material0.mtl", "material0.jpeg")
        write_obj(scan.with_name("decimated.obj"), matrix)
        fit = root / "THuman2.1" / "smplx" / name
        write_smplx(fit, matrix, 45, scale=np.array([scale]), transl=transl)


def customhumans(root: Path) -> None:
    for folder in ("0383_00070_02_00061", "0003_00012_01_00101"):
        name = f"mesh-f{folder[-5:]}"
        matrix = similarity(shift=(0, -0.9, 0))
        scans, fits = (root / "CustomHumans" / part / folder for part in ("mesh", "smplx"))
        write_textured(scans / f"{name}.obj", matrix, f"{name}.mtl", f"{name}.png")
        write_obj(fits / f"{name}_smpl.obj", matrix, BARE)
        (fits / f"{name}.json").write_text("{}")


def two_k(root: Path, scale: float = 1.0) -> None:
    matrix = similarity(scale, shift=(0.2, -0.3, 0.1))
    folder = root / "2K2K" / "train" / "00003"
    write_obj(folder / "smplx10475_rigid_mesh.obj", matrix, BARE)
    mesh = person().apply_transform(matrix)
    mesh.visual.vertex_colors = (*COLOR, 255)
    mesh.export(folder / "00003.ply")


def renderpeople(root: Path) -> None:
    for name, ending in (("rp_aaron_posed_013", "_100k.obj"), ("rp_beth_posed_002", ".OBJ")):
        folder = root / "renderpeople" / f"{name}_OBJ"
        write_obj(folder / f"{name}{ending}", similarity(100), mtl=f"{name}.mtl")
        (folder / f"{name}.mtl").write_text("newmtl person\nmap_Kd C:\\work\\tex\\diffuse.tif\n")
        write_image(folder / "tex" / f"{name}_dif_2k.jpg", (9, 9, 9))
        write_image(folder / "tex" / f"{name}_dif_8k.jpg", side=64)
        write_image(folder / "tex" / f"{name}_norm_8k.jpg", (128, 128, 255), side=96)


def glb(root: Path) -> None:
    for name in ("anna.glb", "group/ben.glb", "group/cleo.gltf"):
        path = root / "people" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        mesh = person()
        linear = ((np.array(COLOR) / 255 + 0.055) / 1.055) ** 2.4
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=[*linear, 1.0])
        mesh.visual = trimesh.visual.TextureVisuals(
            uv=np.zeros((len(mesh.vertices), 2)), material=material
        )
        mesh.export(path)


@dataclass(frozen=True)
class Layout:
    """A set: its configuration and page, what writes it, its ids, whether it has bodies.

    `first` is which of the page's calls builds it.
    """

    name: str
    write: Callable[[Path], None]
    ids: tuple[str, ...]
    bodies: bool = True
    first: int = 0


LAYOUTS = {
    layout.name: layout
    for layout in (
        Layout("thuman2", thuman2, ("0000", "0525")),
        Layout("thuman21", thuman21, ("0000", "0525", "0526")),
        Layout(
            "customhumans",
            customhumans,
            ("0003_00012_01_00101_mesh-f00101", "0383_00070_02_00061_mesh-f00061"),
        ),
        Layout("2k2k", two_k, ("00003",), first=1),
        Layout(
            "renderpeople",
            renderpeople,
            (
                "rp_aaron_posed_013_OBJ_rp_aaron_posed_013_100k",
                "rp_beth_posed_002_OBJ_rp_beth_posed_002",
            ),
            bodies=False,
        ),
        Layout("glb", glb, ("anna", "group_ben", "group_cleo"), bodies=False),
    )
}


def page(name: str) -> str:
    return (ROOT / "docs" / "scans" / f"{name}.md").read_text()


def commands(text: str) -> list[list[str]]:
    """The arguments of every build that a page prints, as a shell splits them."""
    joined = text.replace("\\\n", " ")
    lines = re.findall(r"^ {4}python pipeline\.py (build .*)$", joined, re.MULTILINE)
    return [shlex.split(line)[1:] for line in lines]


def options(text: str) -> list[str]:
    """The options with a value that a page names in its text."""
    return re.findall(r"`(--subjects\.[\w.]+[ =][^`]+)`", " ".join(text.split()))


def snippets(text: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def built(*arguments: str) -> Scans:
    """The source that the command line makes of them."""
    parser = ArgumentParser(exit_on_error=False)
    pipeline._add_build(parser)
    source = parser.instantiate(parser.parse_args(list(arguments))).subjects
    assert isinstance(source, Scans)
    return source


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder that a page's calls are made in, with the configurations."""
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def color(subject: Subject) -> np.ndarray:
    """(3,) of a subject of one colour, sRGB bytes."""
    surface = subject.surface()
    if surface.vertex_colors is not None:
        return surface.vertex_colors.mean(axis=0)
    (material,) = surface.materials
    if material.texture is not None:
        return material.texture.reshape(-1, 3).mean(axis=0)
    return 255 * np.array(material.color)


def stands(subject: Subject) -> None:
    """Every vertex is where it is in the person: metric, on its feet, facing +z, not mirrored."""
    truth = person()
    low, high = truth.bounds
    shift = [(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2]
    surface = subject.surface()
    apart, nearest = cKDTree(truth.vertices - shift).query(surface.vertices)
    assert apart.max() < 1e-4
    assert len(np.unique(truth.vertices[nearest], axis=0)) == len(np.unique(truth.vertices, axis=0))
    body = subject.body_surface()
    if body is not None:
        expected = np.array([low + BARE, high - BARE]) - shift
        np.testing.assert_allclose(body.bounds, expected, atol=1e-4)


class TestLayouts:
    @pytest.mark.parametrize("layout", LAYOUTS.values(), ids=list(LAYOUTS))
    def test_subjects_stand_in_metres_and_face_the_viewer(self, layout: Layout, home: Path) -> None:
        """By the set's page, which finds no scan and no fit but those."""
        layout.write(home)
        source = built(*commands(page(layout.name))[layout.first])
        assert source.ids() == list(layout.ids)
        assert source.refused() == {}
        for name in layout.ids:
            subject = source.make(name, 0, home / "out" / name)
            stands(subject)
            np.testing.assert_allclose(color(subject), COLOR, atol=3)
            assert (subject.body is not None) == layout.bodies
            if layout.bodies:
                assert 0 < subject.body_parameters["scan_to_body_mm"] < 20

    @pytest.mark.parametrize("name", LAYOUTS)
    def test_a_configuration_and_its_page_agree(self, name: str) -> None:
        path = ROOT / "configs" / f"{name}.yaml"
        text = path.read_text()
        assert f"docs/scans/{name}.md" in text
        settings = yaml.safe_load(text)["subjects"]
        assert settings["class_path"] == "Scans"
        # Nothing but the calls' options stands between the configuration and the set.
        assert commands(page(name))[0][:2] == ["--config", f"configs/{name}.yaml"]
        assert not is_redistributable(settings["init_args"]["licence"])

    def test_every_page_is_of_a_configuration(self) -> None:
        assert {path.stem for path in PAGES} == {*LAYOUTS, "bodies"}

    @pytest.mark.parametrize(
        "arguments",
        [
            pytest.param(arguments, id=f"{path.stem}-{number}")
            for path in PAGES
            for number, arguments in enumerate(commands(path.read_text()))
        ],
    )
    def test_every_printed_call_is_one(self, arguments: list[str], home: Path) -> None:
        source = built(*arguments)
        for root in (source.root, source.fits.root):
            assert root is None or not Path(root).is_absolute()
        assert "--output" in arguments

    @pytest.mark.parametrize(
        ("name", "option"),
        [
            pytest.param(path.stem, option, id=f"{path.stem}-{option}")
            for path in PAGES
            for option in options(path.read_text())
        ],
    )
    def test_every_option_in_the_text_is_one(self, name: str, option: str, home: Path) -> None:
        """With its value, behind the page's first call."""
        mesh = ["--subjects.fits.mesh", '["{name}.ply"]'] if "similarity" in option else []
        built(*commands(page(name))[0], *mesh, *shlex.split(option))


class TestTHuman:
    @pytest.mark.parametrize("name", ["thuman2", "thuman21"])
    def test_part_of_the_scans(self, name: str, home: Path) -> None:
        """The others' fits are no subjects, and listed but where the page says how not."""
        layout = LAYOUTS[name]
        layout.write(home)
        call = commands(page(name))[0]
        scans = Path(call[call.index("--subjects.root") + 1])
        shutil.rmtree(scans / "0525")
        assert built(*call).ids() == [each for each in layout.ids if each != "0525"]
        assert list(built(*call).refused()) == ["0525"]
        for option in ("--subjects.fits.unmatched ignored", "--subjects.limit 8"):
            assert option.split()[0] in page(name)
            assert built(*call, *option.split()).refused() == {}

    def test_parameters_alone_say_how_a_scan_stands(self, home: Path) -> None:
        """But the body then takes the model, which the message names."""
        thuman21(home)
        source = built(*commands(page("thuman21"))[0])
        for path in (home / "THuman2.1" / "smplx").glob("*/mesh_smplx.obj"):
            path.unlink()
        with pytest.raises(MeshError, match=r"SMPLX_NEUTRAL\.npz.*subjects\.models"):
            source.make("0526", 0, home / "out")

    def test_one_axis_for_both_batches_is_refused(self, home: Path) -> None:
        """What `up: body` is for: as THuman2.0 is read, the second batch lies."""
        thuman21(home)
        call = commands(page("thuman21"))[0]
        source = built(*call, "--subjects.up", "y")
        stands(source.make("0525", 0, home / "out"))
        with pytest.raises(MeshError, match=r"lies or stands on its head where subjects\.up is y"):
            source.make("0526", 0, home / "out")

    @pytest.mark.parametrize("name", ["thuman2", "thuman21"])
    def test_fits_beside_the_scans(self, name: str, home: Path) -> None:
        layout = LAYOUTS[name]
        layout.write(home)
        call = commands(page(name))[0]
        scans, fits = (Path(call[call.index(f"--subjects.{key}") + 1]) for key in ROOTS)
        for path in sorted(fits.glob("*/*")):
            path.rename(scans / path.relative_to(fits))
        call[call.index("--subjects.fits.root") + 1] = str(scans)
        source = built(*call)
        assert source.ids() == list(layout.ids)
        stands(source.make(layout.ids[-1], 0, home / "out"))


class TestCustomHumans:
    def test_both_folders_merged(self, home: Path) -> None:
        """As the owners' script leaves them: a body is no scan."""
        customhumans(home)
        merged = home / "training_dataset" / "0383"
        merged.mkdir(parents=True)
        for path in (home / "CustomHumans").glob("*/0383_*/*"):
            path.rename(merged / path.name)
        call = commands(page("customhumans"))[0]
        for key in ROOTS:
            call[call.index(f"--subjects.{key}") + 1] = "training_dataset"
        source = built(*call)
        assert source.ids() == ["0383_mesh-f00061"]
        subject = source.make("0383_mesh-f00061", 0, home / "out")
        stands(subject)
        assert subject.body is not None

    def test_another_unit_is_set_aside(self, home: Path) -> None:
        customhumans(home)
        call = commands(page("customhumans"))[0]
        source = built(*call, "--subjects.unit", "cm")
        with pytest.raises(MeshError, match=r"no person's height; correct subjects\.unit: cm"):
            source.make(source.ids()[0], 0, home / "out")


class Test2K2K:
    def test_the_unit_is_asked_for(self, home: Path) -> None:
        two_k(home)
        call = commands(page("2k2k"))[1]
        at = call.index("--subjects.unit")
        asked = "the following arguments are required: unit"
        assert asked in " ".join(page("2k2k").split())
        with pytest.raises(ArgumentError, match=asked):
            built(*call[:at], *call[at + 2 :])

    @pytest.mark.parametrize(
        ("scale", "said", "unit"), [(100, "170 m", "cm"), (1000, "1700 m", "mm"), (0.1, "0.17", 10)]
    )
    def test_the_unit_is_found_as_the_page_says(
        self, scale: float, said: str, unit: Any, home: Path
    ) -> None:
        assert f"{said}" in page("2k2k")
        two_k(home, scale)
        probe, call = commands(page("2k2k"))[:2]
        with pytest.raises(MeshError, match=f"is {said}.* high, no person's height"):
            built(*probe).make("00003", 0, home / "out")
        stands(built(*call, "--subjects.unit", str(unit)).make("00003", 0, home / "out"))

    def test_without_bodies(self, home: Path) -> None:
        """The unit is looked for without them too."""
        two_k(home)
        (home / "2K2K" / "train" / "00003" / "smplx10475_rigid_mesh.obj").unlink()
        probe, with_bodies, without = commands(page("2k2k"))
        with pytest.raises(MeshError, match="has no fit"):
            built(*with_bodies).make("00003", 0, home / "out")
        for call in (probe, without):
            subject = built(*call).make("00003", 0, home / "out")
            assert subject.body is None
            stands(subject)


class TestRenderPeople:
    def test_all_in_one_folder(self, home: Path) -> None:
        """The page's second call, once the OBJs are renamed: each has its own image."""
        tones = {"rp_aaron_posed_013": 9, "rp_beth_posed_002": 90}
        for name, tone in tones.items():
            write_obj(home / "people" / f"{name}_100k.obj", similarity(100), mtl="lost.mtl")
            write_image(home / "people" / "tex" / f"{name}_dif_8k.jpg", (tone, tone, tone))
        assert "rp_aaron_posed_013_100k.obj\n            tex/rp_aaron_posed_013_dif_8k.jpg" in page(
            "renderpeople"
        )
        (rename,) = re.findall(r"^ {4}(for .*)$", page("renderpeople"), re.MULTILINE)
        call = commands(page("renderpeople"))[1]
        with pytest.raises(MeshError, match="has no texture"):
            built(*call).make("rp_aaron_posed_013_100k", 0, home / "out")
        subprocess.run(["sh", "-c", rename], check=True)
        source = built(*call)
        assert source.ids() == list(tones)
        for name, tone in tones.items():
            subject = source.make(name, 0, home / "out" / name)
            np.testing.assert_allclose(color(subject), tone, atol=3)
            stands(subject)

    def test_turned_people_in_a_root_of_their_own(self, home: Path) -> None:
        folder = home / "renderpeople" / "rp_carla_OBJ"
        write_obj(folder / "rp_carla.obj", similarity(100, yaw(90)), mtl="lost.mtl")
        write_image(folder / "tex" / "rp_carla_dif.jpg")
        call = commands(page("renderpeople"))[0]
        stands(built(*call, "--subjects.front", "x").make("rp_carla_OBJ_rp_carla", 0, home / "out"))

    def test_a_body_of_its_own(self, home: Path) -> None:
        renderpeople(home)
        name = "rp_beth_posed_002"
        write_obj(home / "renderpeople" / f"{name}_OBJ" / "body.obj", similarity(100), BARE)
        source = built(*commands(page("renderpeople"))[0])
        assert source.ids() == list(LAYOUTS["renderpeople"].ids)
        subject = source.make(f"{name}_OBJ_{name}", 0, home / "out")
        assert subject.body is not None
        stands(subject)


class TestGLB:
    def test_people_seen_from_behind(self, home: Path) -> None:
        """The option that the page names is one, with its sign."""
        (option,) = re.findall(r"`(--subjects\.front\S+)`", page("glb"))
        mesh = person().apply_transform(similarity(turn=yaw(180)))
        (home / "people").mkdir()
        mesh.export(home / "people" / "anna.glb")
        source = built(*commands(page("glb"))[0], option)
        stands(source.make("anna", 0, home / "out"))

    def test_bodies_beside_the_people(self, home: Path) -> None:
        glb(home)
        for path in sorted((home / "people").rglob("*.gl*")):
            person(BARE).export(path.with_name(f"{path.stem}_smplx.glb"))
        source = built(*commands(page("glb"))[1])
        assert source.ids() == list(LAYOUTS["glb"].ids)
        for name in source.ids():
            subject = source.make(name, 0, home / "out" / name)
            assert subject.body is not None
            stands(subject)


class TestBodies:
    """Ways of docs/scans/bodies.md that the sets do not take."""

    def test_ids_are_as_the_page_says(self) -> None:
        said = re.findall(r"`([\w/]+\.obj)` is `(\w+)`", page("bodies"))
        assert len(said) == 2
        assert all(scan_id(Path(below)) == name for below, name in said)

    def test_posed_mesh_and_similarity(self, home: Path) -> None:
        """A body in metres, a scan in its own coordinates, a JSON file between them."""
        matrix = similarity(37.0, yaw(50), (1, 2, 3))
        write_obj(home / "scans" / "a" / "a.obj", matrix)
        write_obj(home / "scans" / "a" / "a_smpl.obj", np.eye(4), BARE)
        values = {"scale": 37.0, "rotation": yaw(50).tolist(), "translation": [1, 2, 3]}
        (home / "scans" / "a" / "a.json").write_text(json.dumps(values))
        table = dict(re.findall(r"`(--subjects\.fits\.\w+) (.*?)` \|$", page("bodies"), re.M))
        mesh = shlex.split(table["--subjects.fits.mesh"])
        to_scan = shlex.split(table["--subjects.fits.similarity"])
        source = built(
            "--config", "configs/scans.yaml", "--output", "out", "--subjects.root", "scans",
            "--subjects.pattern", "*/a.obj", "--subjects.unit", str(1 / 37.0),
            "--subjects.fits.mesh", *mesh, "--subjects.fits.similarity", *to_scan,
        )  # fmt: skip
        subject = source.make("a", 0, home / "out")
        # `front: z` is not where this person looks: its body turns with it.
        assert subject.body is not None
        body, scan = subject.body_surface(), subject.surface()
        assert body is not None
        truth = person(BARE).apply_transform(subject.mesh_to_world @ matrix)
        assert cKDTree(truth.vertices).query(body.vertices)[0].max() < 1e-4
        assert np.ptp(scan.vertices[:, 1]) == pytest.approx(1.7, abs=1e-4)

    @pytest.fixture
    def dataset(self, home: Path) -> Callable[..., Path]:
        def build(folder: str, **changes: Any) -> Path:
            """A finished dataset of two subjects of one view that is not turned."""
            with DatasetWriter(home / folder, CONFIG, ["a", "b"], 7, {"numpy": "1"}) as writer:
                for subject, yaw_deg in (("a", 0.0), ("b", changes.get("yaw_deg", 0.0))):
                    turned = {"yaw_deg": np.array([yaw_deg], dtype="<f4")}
                    meta = closed_form_meta(subject, 1)
                    meta["mesh"] = f"subjects/{subject}.obj"
                    (home / folder / meta["mesh"]).write_text(subject)
                    meta["body_parameters"] = {"scan_to_body_mm": 17.4, "body_to_scan_mm": 5.0}
                    arrays = closed_form_arrays(1) | turned
                    written = write_shard(writer.shard_path(subject), arrays, meta)
                    writer.add(subject, *written, 1.0, "CC0-1.0")
                writer.finish()
            return home / folder

        return build

    @pytest.mark.parametrize("key", ["max_scan_to_body", "max_body_to_scan"])
    def test_the_bounds_are_those_of_the_page(self, key: str) -> None:
        assert f"`--subjects.{key}`, {1000 * getattr(Scans, key):g} mm" in page("bodies")

    def test_pictures_of_the_fronts(self, home: Path, dataset: Callable[..., Path]) -> None:
        dataset("out/plain")
        exec(snippets(page("bodies"))[0], {})
        mask = closed_form_arrays(1)["mask"][0]
        for subject in ("a", "b"):
            with Image.open(home / "out" / "pictures" / f"{subject}.png") as image:
                picture = np.asarray(image)
            assert (picture[mask] == COLOR).all()
            assert (picture[~mask] == 128).all()

    def test_no_pictures_of_turned_people(self, home: Path, dataset: Callable[..., Path]) -> None:
        dataset("out/plain", yaw_deg=30.0)
        with pytest.raises(AssertionError, match="b is turned"):
            exec(snippets(page("bodies"))[0], {})

    @pytest.mark.parametrize(
        ("name", "number", "folder", "printed"),
        [
            ("bodies", 1, "out/thuman2", "a 17.4 5.0\nb 17.4 5.0\n"),
            ("2k2k", 0, "out/unit", "1.20 to 1.20 m high\n"),
        ],
    )
    def test_what_the_snippets_print(
        self,
        name: str,
        number: int,
        folder: str,
        printed: str,
        dataset: Callable[..., Path],
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        dataset(folder)
        exec(snippets(page(name))[number], {})
        assert capsys.readouterr().out == printed
