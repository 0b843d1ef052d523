"""One form of SMPL-X parameters, whatever the file's."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from subjects.fits.parameters import Parameters, parameters_from, read_parameters
from subjects.mesh import MeshError

HERE = Path("fit.pkl")


def thuman(**changes: Any) -> dict[str, Any]:
    """Values as THuman2.0's pickles have them; None leaves one out."""
    draw = np.random.default_rng(3).normal
    values = {
        "betas": draw(size=(1, 10)),
        "global_orient": draw(size=(1, 3)),
        "body_pose": draw(0, 0.3, (1, 63)),
        "left_hand_pose": draw(size=(1, 12)),
        "right_hand_pose": draw(size=(1, 12)),
        "jaw_pose": draw(size=(1, 3)),
        "leye_pose": draw(size=(1, 3)),
        "reye_pose": draw(size=(1, 3)),
        "expression": draw(size=(1, 10)),
        "scale": np.array(0.4335),
        "translation": draw(size=3),
    }
    return {k: v for k, v in (values | changes).items() if v is not None}


def assert_same(a: Parameters, b: Parameters) -> None:
    for name, value in vars(a).items():
        other = getattr(b, name)
        if isinstance(value, np.ndarray):
            np.testing.assert_allclose(value, other, atol=1e-6, err_msg=name)
        else:
            assert value == other, name


def matrices(turns: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(np.reshape(turns, (-1, 3))).as_matrix()


class TestSchemas:
    def test_thuman2(self) -> None:
        values = thuman()
        found = parameters_from(values, HERE)
        assert found.betas.shape == (10,)
        assert found.body_pose.shape == (21, 3)
        assert found.left_hand_pose.shape == (12,)
        assert found.scale == pytest.approx(0.4335)
        assert np.array_equal(found.body_pose.ravel(), values["body_pose"].ravel())
        assert np.array_equal(found.translation, values["translation"])
        assert not found.transl.any()
        assert found.flat_hand_mean is None
        assert found.gender is None

    def test_thuman21(self) -> None:
        """Hands of 45 values, a transl that is scaled, and a scale in an array."""
        hands = np.random.default_rng(0).normal(size=(2, 1, 45))
        values = thuman(
            translation=None,
            transl=np.array([[1.0, 2, 3]]),
            scale=np.array([0.5]),
            left_hand_pose=hands[0],
            right_hand_pose=hands[1],
        )
        found = parameters_from(values, HERE)
        assert found.left_hand_pose.shape == (15, 3)
        assert np.array_equal(found.right_hand_pose.ravel(), hands[1].ravel())
        assert found.scale == 0.5
        assert np.array_equal(found.transl, [1, 2, 3])
        assert not found.translation.any()

    def test_matrices_are_the_same_turns(self) -> None:
        """PIXIE's names and shapes; a hand's matrix is its whole turn."""
        hands = np.random.default_rng(0).normal(0, 0.3, (2, 15, 3))
        by_angle = thuman(left_hand_pose=hands[0], right_hand_pose=hands[1])
        by_matrix = {
            "shape": by_angle["betas"][0],
            "exp": by_angle["expression"][0],
            "global_pose": matrices(by_angle["global_orient"]),
            "body_pose": matrices(by_angle["body_pose"]),
            "left_hand_pose": matrices(hands[0]),
            "right_hand_pose": matrices(hands[1]),
            "jaw_pose": matrices(by_angle["jaw_pose"]),
            "leye_pose": matrices(by_angle["leye_pose"]),
            "reye_pose": matrices(by_angle["reye_pose"]),
            "scale": 0.4335,
            "translation": by_angle["translation"],
            "flat_hand_mean": True,
        }
        found = parameters_from(by_matrix, HERE)
        assert_same(found, parameters_from(by_angle | {"flat_hand_mean": True}, HERE))
        by_matrix.pop("flat_hand_mean")
        assert parameters_from(by_matrix, HERE).flat_hand_mean is True

    def test_amass_has_all_joints_in_one(self) -> None:
        values = thuman(left_hand_pose=None, right_hand_pose=None)
        hands = np.random.default_rng(0).normal(0, 0.3, (2, 45))
        names = ("global_orient", "body_pose", "jaw_pose", "leye_pose", "reye_pose")
        whole = np.concatenate([*(values[name][0] for name in names), *hands])
        amass = {"poses": whole[None], "betas": values["betas"], "trans": np.ones(3)}
        amass |= {"gender": np.array("female"), "expression": values["expression"]}
        found = parameters_from(amass, HERE)
        expected = values | {
            "left_hand_pose": hands[0],
            "right_hand_pose": hands[1],
            "transl": np.ones(3),
            "translation": None,
            "scale": None,
            "gender": "female",
        }
        assert_same(found, parameters_from(expected, HERE))
        halves = expected | {"pose_hand": hands.ravel()}
        halves |= {"left_hand_pose": None, "right_hand_pose": None}
        assert_same(found, parameters_from(halves, HERE))

    def test_what_may_be_left_out(self) -> None:
        found = parameters_from({"betas": np.ones(10), "body_pose": np.zeros(63)}, HERE)
        assert found.scale is None
        assert found.expression.shape == (0,)
        assert found.left_hand_pose.shape == (15, 3)
        assert np.array_equal(found.orientation, np.eye(3))


class TestFiles:
    @pytest.mark.parametrize("kind", ["json", "npz", "npy", "pkl"])
    def test_every_format_gives_the_same(self, tmp_path: Path, kind: str) -> None:
        import pickle  # noqa: TID251 - written here

        values = thuman()
        path = tmp_path / f"fit.{kind}"
        if kind == "json":
            path.write_text(json.dumps({k: np.asarray(v).tolist() for k, v in values.items()}))
        elif kind == "npz":
            np.savez(path, **values)
        elif kind == "npy":
            np.save(path, np.array(values, dtype=object))
        else:
            path.write_bytes(pickle.dumps([values]))
        assert_same(read_parameters(path), parameters_from(values, path))

    @pytest.mark.parametrize("text", ["", "{", "[1, 2]", '{"betas": [NaN]}', "[" * 100_000])
    def test_json_that_holds_none(self, tmp_path: Path, text: str) -> None:
        path = tmp_path / "fit.json"
        path.write_text(text)
        with pytest.raises(MeshError) as error:
            read_parameters(path)
        assert str(error.value).startswith(f"{path}: ")
        assert "\n" not in str(error.value)

    def test_unknown_format(self, tmp_path: Path) -> None:
        with pytest.raises(MeshError, match=r"'\.bin' is no known format"):
            read_parameters(tmp_path / "fit.bin")

    def test_missing_file(self, tmp_path: Path) -> None:
        for kind in ("json", "npz", "npy", "pkl"):
            with pytest.raises(MeshError, match=rf"fit\.{kind}: "):
                read_parameters(tmp_path / f"fit.{kind}")


class TestWrong:
    @pytest.mark.parametrize(
        ("changes", "said"),
        [
            ({"betas": None}, "has no betas"),
            ({"body_pose": None}, "has no body_pose"),
            ({"body_pose": np.zeros((1, 32))}, "VPoser"),
            ({"body_pose": np.zeros((1, 69))}, "SMPL's, of 23 joints"),
            ({"body_pose": np.zeros((23, 3, 3))}, "SMPL's, of 23 joints"),
            ({"body_pose": np.zeros((2, 63))}, r"shape \(2, 63\).*holds one person"),
            ({"betas": np.zeros((4, 10))}, r"shape \(4, 10\).*holds one person"),
            ({"global_orient": np.zeros((1, 4))}, r"global_orient of shape \(1, 4\)"),
            ({"global_orient": np.ones((1, 3, 3))}, "no rotations"),
            ({"global_orient": -np.eye(3)[None]}, "no rotations"),
            ({"left_hand_pose": np.zeros((1, 46))}, "15 joints"),
            ({"left_hand_pose": np.zeros((2, 12))}, "15 joints"),
            ({"translation": np.zeros(2)}, "translation of shape"),
            ({"scale": np.array(-1.0)}, "scale of -1"),
            ({"scale": np.array(0.0)}, "scale of 0"),
            ({"scale": np.array([1.0, 2.0])}, "scale of shape"),
            ({"betas": np.full((1, 10), np.nan)}, "betas that is NaN"),
            ({"betas": "tall"}, "betas that is no array"),
            ({"betas": {"a": 1}}, "betas that is no array"),
            ({"expression": [[1], [2, 3]]}, "expression that is no array"),
            ({"gender": "robot"}, "gender 'robot'"),
            ({"gender": [["male"], ["female", "x"]]}, "gender 'list'"),
            ({"global_orient": np.array([[0.0, 137.0, 0.0]])}, "as if in degrees"),
            ({"scale": 10**400}, "scale that is no array"),
        ],
    )
    def test_is_said_in_one_line(self, changes: dict[str, Any], said: str) -> None:
        with pytest.raises(MeshError, match=said) as error:
            parameters_from(thuman(**changes), HERE)
        assert str(error.value).startswith("fit.pkl: ")
        assert "\n" not in str(error.value)


class TestUpright:
    @pytest.mark.parametrize("degrees", [0, 45, 80, 180, 250])
    def test_turns_with_the_pelvis(self, degrees: float) -> None:
        turn = Rotation.from_rotvec([np.radians(degrees), 0, 0])
        still = parameters_from({"betas": [0], "body_pose": np.zeros(63)}, HERE)
        values = {"betas": [0], "body_pose": np.zeros(63), "global_orient": turn.as_rotvec()}
        turned = parameters_from(values, HERE)
        np.testing.assert_allclose(still.upright, [0, 1, 0])
        np.testing.assert_allclose(turned.upright, turn.apply([0, 1, 0]), atol=1e-12)

    def test_a_bow_tilts_the_legs_least(self) -> None:
        """Bent by a right angle at the hips: the pelvis leans, thighs and shins stand."""
        pose = np.zeros((21, 3))
        pose[[0, 1], 0] = -np.pi / 2
        values = {"betas": [0], "body_pose": pose, "global_orient": [np.pi / 2, 0, 0]}
        found = parameters_from(values, HERE)
        np.testing.assert_allclose(found.orientation @ [0, 1, 0], [0, 0, 1], atol=1e-12)
        assert found.upright @ [0, 1, 0] == pytest.approx(2 / np.sqrt(5))

    def test_a_seat_tilts_the_thighs_alone(self) -> None:
        pose = np.zeros((21, 3))
        pose[[0, 1], 0] = -np.pi / 2
        pose[[3, 4], 0] = np.pi / 2
        found = parameters_from({"betas": [0], "body_pose": pose}, HERE)
        assert found.upright @ [0, 1, 0] == pytest.approx(2 / np.sqrt(5))
