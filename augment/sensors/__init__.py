"""Depth sensors: each turns the true depth of a view into what a device would have measured."""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

import seeds
from augment.sensors.azure import AzureKinect
from augment.sensors.kinect_v1 import KinectV1
from augment.sensors.kinect_v2 import KinectV2
from augment.sensors.normalgan import NormalGAN
from augment.sensors.sensor import Sensor
from augment.sensors.tof import TimeOfFlight
from augment.sensors.view import Grid, Reading

SENSORS: dict[str, type[Sensor]] = {
    kind.name: kind for kind in (NormalGAN, KinectV2, TimeOfFlight, KinectV1, AzureKinect)
}
"""Every model by its name."""

MODULES = "RECTOVERSO_SENSORS"
"""The environment variable that names modules with sensors of one's own, separated by commas: every
process of a command finds them by it, and a dataset never says what is imported."""


def sensor_of(name: str, **parameters: Any) -> Sensor:
    """A sensor by its model's name: `sensor_of("kinect_v2", noise=1.0)`.

    A model of one's own is known after its import, which `MODULES` asks for.

    Raises:
        ValueError: no model has that name, or a parameter is out of bounds.
        ImportError: what `MODULES` names cannot be imported.
    """
    if name not in SENSORS:
        for module in filter(None, map(str.strip, os.environ.get(MODULES, "").split(","))):
            try:
                importlib.import_module(module)
            except ImportError as error:
                raise ImportError(f"{MODULES} names {module}: {error}") from error
    if name not in SENSORS:
        raise ValueError(
            f"sensor '{name}' is no model; known: {', '.join(SENSORS)} (of a sensor of your own, "
            f"name the module in {MODULES})"
        )
    known = [field.name for field in fields(SENSORS[name])]
    for parameter in parameters:
        if parameter not in known:
            raise ValueError(
                f"sensor '{name}' has no parameter '{parameter}'; it has {', '.join(known)}"
            )
    return SENSORS[name](**parameters)


def sensor_in(meta: Mapping[str, Any]) -> Sensor:
    """The sensor that a shard's meta names, as `sensor_of`."""
    return sensor_of(**{"name" if k == "model" else k: v for k, v in meta["sensor"].items()})


def read(
    view: Mapping[str, np.ndarray], meta: Mapping[str, Any], index: int, draw: int = 0
) -> Reading:
    """What the sensor of a shard reads of one of its views; draw 0 is what the shard holds.

    A loader may call it with another draw each epoch: every machine draws the same, and the values
    agree but for the last bits of its sines and powers.

    The device brings its own light: of a shard with a base, under another lamp, give the view and
    the meta of `shard.base`.

    Args:
        view: a shard's `depth_front`, `normal_front`, `rgb_front` and `mask` of the view.
        meta: the shard's.
        index: of the view in the shard.
        draw: which of the readings.

    Raises:
        ValueError: the shard's sensor is no model of this version, the view lacks a map, index or
            draw is none, or the colours are of another lamp than the sensor's readings.
    """
    for name in ("depth_front", "normal_front", "rgb_front", "mask"):
        if name not in view:
            raise ValueError(f"the view has no {name}, which the sensor reads; ask for it as well")
    if not (index >= 0 and draw >= 0):
        raise ValueError(f"view {index}, draw {draw}: both are counted from 0")
    if "base" in meta:
        raise ValueError(
            "the sensor read the colours of the shard's base; give the view and meta of shard.base"
        )
    camera = meta["camera"]
    return sensor_in(meta).sense(
        view["depth_front"],
        view["normal_front"],
        view["rgb_front"],
        view["mask"],
        Grid(camera["pixel_size"], camera["distance"]),
        seeds.generator(meta["seed"], meta["subject"], "sensor", index, draw),
    )


__all__ = [
    "MODULES",
    "SENSORS",
    "AzureKinect",
    "Grid",
    "KinectV1",
    "KinectV2",
    "NormalGAN",
    "Reading",
    "Sensor",
    "TimeOfFlight",
    "read",
    "sensor_in",
    "sensor_of",
]
