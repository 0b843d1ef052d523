"""SMPL-X posed by the `smplx` package, from files of its format."""

from __future__ import annotations

import hashlib
import pickle  # noqa: TID251 - written here, read only by the code under test
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import smplx
import torch

from subjects.fits import model
from subjects.fits.parameters import parameters_from
from subjects.mesh import MeshError


def by_the_package(path: Path, values: dict[str, Any], **settings: Any) -> np.ndarray:
    """What a user of `smplx` gets, in single precision, the file loaded by the package itself."""
    body = smplx.create(str(path), model_type="smplx", ext="npz", gender="male", **settings)
    tensors = {name: torch.tensor(np.asarray(value)) for name, value in values.items()}
    with torch.no_grad():
        return body(**tensors).vertices[0].numpy()


class TestPose:
    def test_components_of_the_hands(self, fit: Any, models: Path) -> None:
        path = model.find_model(str(models), "male")
        posed = model.pose(path, parameters_from(fit.values, path), flat_hand_mean=False)
        expected = by_the_package(path, fit.values, num_pca_comps=12, flat_hand_mean=False)
        assert posed.shape == (10475, 3)
        assert np.abs(posed - expected).max() < 1e-5
        assert np.abs(posed - fit.body.vertices).max() < 1e-5

    @pytest.mark.parametrize("flat", [True, False])
    def test_45_values_and_flat_hands(self, fit: Any, models: Path, flat: bool) -> None:
        path = model.find_model(str(models), "male")
        hands = np.random.default_rng(1).normal(0, 0.3, (2, 1, 45)).astype(np.float32)
        values = fit.values | {"left_hand_pose": hands[0], "right_hand_pose": hands[1]}
        posed = model.pose(path, parameters_from(values, path), flat_hand_mean=flat)
        expected = by_the_package(path, values, use_pca=False, flat_hand_mean=flat)
        assert np.abs(posed - expected).max() < 1e-5
        other = by_the_package(path, values, use_pca=False, flat_hand_mean=not flat)
        assert np.abs(posed - other).max() > 1e-3

    def test_flat_components(self, fit: Any, models: Path) -> None:
        path = model.find_model(str(models), "male")
        posed = model.pose(path, parameters_from(fit.values, path), flat_hand_mean=True)
        expected = by_the_package(path, fit.values, num_pca_comps=12, flat_hand_mean=True)
        assert np.abs(posed - expected).max() < 1e-5

    def test_a_file_that_says_flat_is_believed(self, fit: Any, models: Path) -> None:
        path = model.find_model(str(models), "male")
        values = fit.values | {"flat_hand_mean": np.array(True)}
        body = model.posed(Path("fit"), str(models), "male", parameters_from(values, path), False)
        expected = by_the_package(path, fit.values, num_pca_comps=12, flat_hand_mean=True)
        assert np.abs(body.mesh.vertices - expected).max() < 1e-5
        assert body.record["flat_hand_mean"] is True
        assert body.record["model_sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()

    def test_components_and_angles_in_one_fit(self, fit: Any, models: Path) -> None:
        """One hand by components, the other by the angles that those mean."""
        path = model.find_model(str(models), "male")
        both = parameters_from(fit.values, path)
        space = fit.model["hands_componentsr"][:12]
        mixed = replace(both, right_hand_pose=(both.right_hand_pose @ space).reshape(15, 3))
        a, b = (model.pose(path, parameters, False) for parameters in (both, mixed))
        assert np.abs(a - b).max() < 1e-9

    def test_sizes_of_the_estimators(self, fit: Any, models: Path) -> None:
        """200 components of shape, 50 of expression, a transl."""
        path = model.find_model(str(models), "male")
        draw = np.random.default_rng(2).normal
        values = fit.values | {
            "betas": draw(size=(1, 200)).astype(np.float32),
            "expression": draw(size=(1, 50)).astype(np.float32),
            "transl": np.array([[1, -2, 3]], dtype=np.float32),
        }
        posed = model.pose(path, parameters_from(values, path), flat_hand_mean=False)
        expected = by_the_package(
            path, values, num_pca_comps=12, num_betas=200, num_expression_coeffs=50
        )
        assert np.abs(posed - expected).max() < 1e-5

    def test_pickled_model(self, fit: Any, models: Path, tmp_path: Path) -> None:
        path = tmp_path / "SMPLX_MALE.pkl"
        path.write_bytes(pickle.dumps(fit.model, protocol=2))
        assert model.find_model(str(tmp_path), "male") == path
        parameters = parameters_from(fit.values, path)
        a = model.pose(path, parameters, False)
        b = model.pose(model.find_model(str(models), "male"), parameters, False)
        assert np.array_equal(a, b)
        body = model.posed(Path("fit"), str(tmp_path), "male", parameters)
        assert np.array_equal(body.mesh.faces, fit.model["f"])


class TestFiles:
    def test_missing(self, tmp_path: Path) -> None:
        with pytest.raises(MeshError) as error:
            model.find_model(str(tmp_path), "neutral")
        for part in ("SMPLX_NEUTRAL.npz", "https://smpl-x.is.tue.mpg.de", f"'{tmp_path}'"):
            assert part in str(error.value)
        with pytest.raises(MeshError, match=r"subjects\.models"):
            model.find_model(None, "male")

    @pytest.mark.parametrize("below", [".", "smplx", "models/smplx"])
    def test_as_the_archive_unpacks(self, tmp_path: Path, below: str) -> None:
        path = tmp_path / below / "SMPLX_FEMALE.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
        assert model.find_model(str(tmp_path), "female") == path

    @pytest.mark.parametrize(
        ("changes", "said"),
        [
            ({"weights": None}, "no member 'weights'"),
            ({"v_template": np.zeros((6890, 3))}, r"'v_template' has shape \(6890, 3\)"),
            ({"J_regressor": np.array({"a": 1}, dtype=object)}, "'J_regressor'"),
        ],
    )
    def test_another_model(
        self, fit: Any, tmp_path: Path, changes: dict[str, Any], said: str
    ) -> None:
        members = {k: v for k, v in (fit.model | changes).items() if v is not None}
        path = tmp_path / "SMPLX_MALE.npz"
        np.savez(path, **members)
        with pytest.raises(MeshError, match=said) as error:
            model.pose(path, parameters_from(fit.values, path), False)
        assert str(error.value).startswith(f"{path}: ")

    def test_a_small_model_and_a_large_fit(self, fit: Any, tmp_path: Path) -> None:
        path = tmp_path / "SMPLX_MALE.npz"
        np.savez(path, **fit.model | {"shapedirs": fit.model["shapedirs"][..., :20]})
        values = fit.values | {"betas": np.zeros((1, 11))}
        with pytest.raises(MeshError, match="has 10 components where the fit has 11 of betas"):
            model.pose(path, parameters_from(values, path), flat_hand_mean=False)

    def test_damaged(self, fit: Any, tmp_path: Path) -> None:
        path = tmp_path / "SMPLX_MALE.npz"
        path.write_bytes(b"PK\x03\x04 no more")
        with pytest.raises(MeshError, match=r"SMPLX_MALE\.npz"):
            model.pose(path, parameters_from(fit.values, path), False)
