"""Depth sensors: each turns the true depth of a view into what a device would have measured."""

from __future__ import annotations

from typing import Any

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
    return SENSORS[name](**parameters)


__all__ = ["SENSORS", "Grid", "Reading", "Sensor", "sensor_of"]
