"""Which requests a soak mixes, and how often each is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import _soak_clients as own
import _soak_interop as interop
import numpy as np
from _clients import Client
from _soak_guarded import ask_guarded
from _soak_remote import ask_remote

if TYPE_CHECKING:
    from _soak_run import Soak


@dataclass(frozen=True)
class Job:
    """One kind of request."""

    name: str
    weight: float
    do: Callable[[Soak, Client, str, np.random.Generator], None]


ALL_JOBS = (
    Job("metadata", 1, own.ask_metadata),
    Job("brick", 4, own.ask_brick),
    Job("gradients", 1, own.ask_gradients),
    Job("batch", 4, own.ask_batch),
    Job("select", 2, own.ask_select),
    Job("render", 1, own.ask_render),
    Job("zarr", 1, interop.ask_zarr),
    Job("zarr2", 1, interop.ask_zarr2),
    Job("precomputed", 1, interop.ask_precomputed),
    Job("client", 2, ask_remote),
    Job("token and signature", 0.5, ask_guarded),
)
