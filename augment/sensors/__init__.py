"""Depth sensors: each turns the true depth of a view into what a device would have measured."""

from __future__ import annotations

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


def sensor_of(name: str, **parameters: Any) -> Sensor:
    """The sensor that a shard's meta names: `sensor_of(**{"name": "kinect_v2", "noise": 1.0})`.

    Raises:
        ValueError: no model has that name, or a parameter is out of bounds.
    """
    if name not in SENSORS:
        raise ValueError(f"sensor '{name}' is no model; known: {', '.join(SENSORS)}")
    known = [field.name for field in fields(SENSORS[name])]
    for parameter in parameters:
        if parameter not in known:
            raise ValueError(
                f"sensor '{name}' has no parameter '{parameter}'; it has {', '.join(known)}"
            )
    return SENSORS[name](**parameters)


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
    sensor = sensor_of(
        **{"name" if key == "model" else key: v for key, v in meta["sensor"].items()}
    )
    camera = meta["camera"]
    return sensor.sense(
        view["depth_front"],
        view["normal_front"],
        view["rgb_front"],
        view["mask"],
        Grid(camera["pixel_size"], camera["distance"]),
        seeds.generator(meta["seed"], meta["subject"], "sensor", index, draw),
    )


__all__ = [
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
    "sensor_of",
]
