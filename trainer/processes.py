"""The processes of one training: one, or as many as torchrun started."""

from __future__ import annotations

import gc
import os

import torch
from torch import Tensor, distributed


def usable(name: str) -> torch.device:
    """A device by its name.

    Raises:
        ValueError: there is no such device here.
    """
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        raise ValueError(f"device: {name} is not to be had here; give cpu, or cuda") from error
    return device


def join(device: torch.device) -> torch.device:
    """Meet the other processes that torchrun started, if it did; the device of this one.

    Raises:
        ValueError: there are more processes here than GPUs, or one GPU is named for all.
    """
    if int(os.environ.get("WORLD_SIZE", "1")) == 1 or distributed.is_initialized():
        return device
    if device.index is not None:
        raise ValueError(f"device: {device} for several processes; give {device.type}")
    if device.type == "cuda":
        local, there = int(os.environ["LOCAL_RANK"]), torch.cuda.device_count()
        if local >= there:
            raise ValueError(
                f"{there} GPUs for more processes; give torchrun --nproc-per-node {there}"
            )
        device = torch.device("cuda", local)
        torch.cuda.set_device(device)
    distributed.init_process_group("nccl" if device.type == "cuda" else "gloo")
    return device


def leave() -> None:
    """Part from the other processes, after the last of what they share was let go.

    A `DistributedDataParallel` that outlives the group aborts now and then as the process ends.
    """
    if distributed.is_initialized():
        gc.collect()
        distributed.destroy_process_group()


def count() -> int:
    """How many there are."""
    return distributed.get_world_size() if distributed.is_initialized() else 1


def rank() -> int:
    """The number of this one, from 0."""
    return distributed.get_rank() if distributed.is_initialized() else 0


def total(values: Tensor) -> Tensor:
    """The sum over all processes, without a gradient; in one process `values` itself."""
    if count() == 1:
        return values
    values = values.detach().clone()
    distributed.all_reduce(values)
    return values


def mean(values: Tensor) -> Tensor:
    """The mean over all processes, without a gradient; in one process `values` itself."""
    return values if count() == 1 else total(values) / count()
