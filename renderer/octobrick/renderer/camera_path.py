"""A path between key cameras, on which a movie's camera moves.

Between two keys the target moves on a straight line; the camera turns about it on the shortest
great arc (Shoemake 1985, spherical linear interpolation of quaternions); its distance, and what
fixes the size of the picture, change by equal factors, so that zooming looks even.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.renderer.brick_source import Xyz
from octobrick.renderer.camera import Camera

_PARALLEL = 1 - 1e-9
"""Cosine from which on two orientations are one: the arc between them has no direction."""


def camera_path(keys: Sequence[Camera], nframes: int, *, closed: bool = False) -> list[Camera]:
    """Cameras from the first key to the last, evenly spaced: every part takes as many frames.

    Args:
        keys: at least two, all perspective or all orthographic. Neighbours are not opposite.
        nframes: how many cameras; the first is the first key, and the last the last key.
        closed: go on from the last key to the first, for a loop; the first key is there once.

    Raises:
        InvalidInputError: fewer keys or frames than two, or projections that differ.
    """
    if len(keys) < 2 or nframes < 2:
        raise InvalidInputError(
            f"camera path: {len(keys)} keys and {nframes} frames; give at least two of each"
        )
    if len({key.fov_degrees is None for key in keys}) > 1:
        raise InvalidInputError(
            "camera path: some keys are perspective and some orthographic; make them alike, for "
            "instance with Camera.orthographic()"
        )
    stops = [*keys, keys[0]] if closed else list(keys)
    nparts, intervals = len(stops) - 1, nframes if closed else nframes - 1
    cameras = []
    for frame in range(nframes):
        part, rest = divmod(frame * nparts, intervals)
        if part == nparts:  # the last key itself
            part, rest = nparts - 1, intervals
        cameras.append(_between(stops[part], stops[part + 1], rest / intervals))
    return cameras


def _between(start: Camera, end: Camera, share: float) -> Camera:
    """The camera at a share of the way, 0..1; exactly a key at both ends."""
    if share in (0, 1):
        return end if share else start
    target = _mixed(start.target_world_xyz, end.target_world_xyz, share)
    distance = _geometric(_distance(start), _distance(end), share)
    _right, up, forward = _matrix(_slerp(_quaternion(start), _quaternion(end), share))
    sizes = [
        None if a is None or b is None else _geometric(a, b, share)
        for a, b in ((start.fov_degrees, end.fov_degrees), (start.height_world, end.height_world))
    ]
    return Camera(_xyz(target - distance * forward), _xyz(target), _xyz(up), *sizes)


def _distance(camera: Camera) -> float:
    return math.dist(camera.eye_world_xyz, camera.target_world_xyz)


def _mixed(start: Xyz, end: Xyz, share: float) -> NDArray[np.float64]:
    return (1 - share) * np.array(start) + share * np.array(end)


def _geometric(start: float, end: float, share: float) -> float:
    return math.exp((1 - share) * math.log(start) + share * math.log(end))


def _quaternion(camera: Camera) -> NDArray[np.float64]:
    """The unit quaternion (w, x, y, z) that turns the axes x, y, z into right, up, -forward."""
    right, up, forward = camera.basis_world()
    m = np.stack([right, up, -forward], axis=1)
    # The eigenvector form (Bar-Itzhack 2000): no case distinctions, and exact for rotations.
    trace = np.trace(m)
    k = np.empty((4, 4))
    k[0, 0] = trace
    k[0, 1:] = k[1:, 0] = (m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1])
    k[1:, 1:] = m + m.T - trace * np.eye(3)
    return np.asarray(np.linalg.eigh(k)[1][:, -1])


def _slerp(
    start: NDArray[np.float64], end: NDArray[np.float64], share: float
) -> NDArray[np.float64]:
    cosine = float(start @ end)
    if cosine < 0:  # q and -q are one turn; take the one on the shorter way
        end, cosine = -end, -cosine
    if cosine > _PARALLEL:
        return start
    angle = math.acos(cosine)
    mixed = math.sin((1 - share) * angle) * start + math.sin(share * angle) * end
    return np.asarray(mixed / math.sin(angle))


def _matrix(
    quaternion: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Right, up and forward of a unit quaternion."""
    w, x, y, z = quaternion
    right = np.array((1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)))
    up = np.array((2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)))
    back = np.array((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)))
    return right, up, -back


def _xyz(vector: NDArray[np.float64]) -> Xyz:
    x, y, z = (float(component) for component in vector)
    return x, y, z
