"""Where fits lie, and the similarity beside them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from subjects.fits.fits import Fits
from subjects.fits.pattern import Place, expand, matching
from subjects.fits.similarity import compose, read_similarity
from subjects.mesh import MeshError

PLACE = Place("0525", "set/0525", "scan")


class TestPattern:
    @pytest.mark.parametrize(
        ("pattern", "path"),
        [
            ("{folder}/smplx_param.pkl", "set/0525/smplx_param.pkl"),
            ("{id}/mesh_smplx.obj", "0525/mesh_smplx.obj"),
            ("fits/{name}_{id}.json", "fits/scan_0525.json"),
            ("output.pkl", "output.pkl"),
        ],
    )
    def test_expand(self, pattern: str, path: str) -> None:
        assert expand(pattern, PLACE) == path

    def test_a_scan_in_the_root_itself(self) -> None:
        assert expand("{folder}/fit.pkl", Place("a", "", "a")) == "fit.pkl"

    @pytest.mark.parametrize("pattern", ["{id}/{id}.pkl", "{folder}/fit_{name}.pkl", "{name}.pkl"])
    def test_matching_is_expand_backwards(self, tmp_path: Path, pattern: str) -> None:
        places = [Place("a", "a", "a"), Place("b", "b", "b"), Place("c", "c", "c")]
        for place in places:
            path = tmp_path / expand(pattern, place)
            path.parent.mkdir(exist_ok=True)
            path.touch()
        (tmp_path / "other.npz").touch()
        (tmp_path / ".trash").mkdir()
        for name in (".trash/.trash.pkl", ".trash/fit_a.pkl", ".a.pkl"):
            (tmp_path / name).touch()
        assert [name for _, name in matching(pattern, tmp_path)] == ["a", "b", "c"]

    def test_a_field_is_the_same_each_time(self, tmp_path: Path) -> None:
        (tmp_path / "a").mkdir()
        (tmp_path / "a" / "b.pkl").touch()
        assert list(matching("{id}/{id}.pkl", tmp_path)) == []

    def test_letters_that_glob_knows(self, tmp_path: Path) -> None:
        (tmp_path / "a[1].pkl").touch()
        assert [name for _, name in matching("{name}[1].pkl", tmp_path)] == ["a"]

    def test_deep_folders(self, tmp_path: Path) -> None:
        (tmp_path / "x" / "y").mkdir(parents=True)
        (tmp_path / "x" / "y" / "fit.pkl").touch()
        assert [name for _, name in matching("{folder}/fit.pkl", tmp_path)] == ["x/y"]
        assert list(matching("{id}/fit.pkl", tmp_path)) == []

    @pytest.mark.parametrize(
        ("given", "key"),
        [
            ({"mesh": ["../{id}.obj"]}, "subjects.fits.mesh"),
            ({"mesh": ["/{id}.obj"]}, "subjects.fits.mesh"),
            ({"mesh": [""]}, "subjects.fits.mesh"),
            ({"mesh": ["{id}\\..\\x.obj"]}, "subjects.fits.mesh"),
            ({"parameters": ["{number}.pkl"]}, "subjects.fits.parameters"),
            ({"mesh": ["{id}.obj"], "similarity": "../x.json"}, "subjects.fits.similarity"),
            ({"parameters": ["{id}.pkl"], "similarity": "{id}.json"}, "subjects.fits.similarity"),
            ({"root": "fits"}, "subjects.fits"),
            ({"mesh": ["{folder}../{name}.obj"]}, "subjects.fits.mesh"),
            ({"mesh": ["{folder}/**body.obj"]}, "subjects.fits.mesh"),
            ({"parameters": ["fits/all.pkl"]}, "subjects.fits.parameters"),
        ],
    )
    def test_wrong_ones(self, given: dict[str, Any], key: str) -> None:
        with pytest.raises(ValueError, match=f"^{key}: ") as error:
            Fits(**given)
        assert "give" in str(error.value) or "use" in str(error.value)


class TestSimilarity:
    TURN = Rotation.from_rotvec([0.3, -1, 2]).as_matrix()

    def written(self, path: Path, values: Any) -> np.ndarray:
        path.write_text(json.dumps(values))
        return read_similarity(path)

    def test_parts_and_matrix_are_the_same(self, tmp_path: Path) -> None:
        parts = {"scale": 0.4, "rotation": self.TURN.tolist(), "translation": [1, 2, 3]}
        expected = compose(0.4, self.TURN, np.array([1, 2, 3]))
        by_parts = self.written(tmp_path / "a.json", parts)
        by_matrix = self.written(tmp_path / "b.json", {"matrix": expected.tolist()})
        np.testing.assert_allclose(by_parts, expected)
        np.testing.assert_allclose(by_matrix, expected)
        point = np.array([0.1, 0.2, 0.3, 1])
        np.testing.assert_allclose((by_parts @ point)[:3], 0.4 * self.TURN @ point[:3] + [1, 2, 3])

    @pytest.mark.parametrize(
        "values",
        [
            {"scale": -1},
            {"scale": 0},
            {"scale": "large"},
            {"rotation": np.diag([1, 1, -1]).tolist()},
            {"rotation": np.diag([1, 1, 2]).tolist()},
            {"rotation": [[1, 0], [0, 1]]},
            {"translation": [1, 2]},
            {"scale": 10**400},
            {"translation": [1, 2, None]},
            {"matrix": np.eye(3).tolist()},
            {"matrix": [*np.eye(4)[:3].tolist(), [0, 0, 1, 1]]},
        ],
    )
    def test_no_similarity(self, tmp_path: Path, values: Any) -> None:
        path = tmp_path / "s.json"
        with pytest.raises(MeshError) as error:
            self.written(path, values)
        assert str(error.value).startswith(f"{path}: ")
        assert "\n" not in str(error.value)
