"""Zarr arrays (version 2 and 3) and OME-Zarr images (0.1 to 0.5), in a folder or on a server."""

from __future__ import annotations

import hashlib
import json
import math
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from octobrick.codec.errors import InvalidInputError
from octobrick.store.errors import SourceNotFoundError, UnsupportedSourceError
from octobrick.store.sources.array import ArraySource, require_chunk
from octobrick.store.sources.axes import LETTERS, Axes, axes_of
from octobrick.store.sources.base import Description, Pick, Source, Vector
from octobrick.store.sources.head import parsing, printable
from octobrick.store.sources.location import Location, Url
from octobrick.store.sources.ngff import Ngff, parse_ngff
from octobrick.store.sources.voxels import clean_spacing, require_dtype

if TYPE_CHECKING:
    from octobrick.store.sources.reading import Reading
    from octobrick.store.sources.remote_store import RemoteStore

SUFFIX = ".zarr"
_METADATA = ("zarr.json", ".zgroup", ".zarray", ".zattrs")  # of one node
_LISTED = 20


def is_zarr(path: Path) -> bool:
    """Whether a folder is a Zarr array or group, by what is in it or by its name."""
    return path.is_dir() and (
        path.suffix.lower() == SUFFIX or any((path / name).is_file() for name in _METADATA[:3])
    )


def open_zarr(path: Path, pick: Pick) -> Source:
    """An array or an image in a folder; raises what `open_zarr_store` does.

    Raises:
        UnsupportedSourceError: it is no folder.
    """
    from zarr.storage import LocalStore

    if not path.is_dir():
        raise UnsupportedSourceError(
            f"{path}: is named {SUFFIX} but is no folder; unpack it, or give it another name",
            path=str(path),
        )
    return open_zarr_store(LocalStore(path, read_only=True), path, pick, root=path)


def open_zarr_store(
    store: Any,
    path: Location,
    pick: Pick,
    root: Path | None = None,
    remote: RemoteStore | None = None,
) -> Source:
    """An array, or the finest resolution of an image, of which a part may be named.

    Args:
        store: a store of zarr-python.
        path: what messages and descriptions call it.
        pick: dataset is a path in the store: of an array, of one resolution, or of a group.
        root: the folder of a store in files.
        remote: the store itself, if it is on a server.

    Raises:
        SourceError: metadata are damaged.
        SourceNotFoundError: there is no Zarr array or group.
        InvalidInputError: no such dataset, several arrays and none named, axes that do not fit.
        UnsupportedSourceError: no array at all, or a sample type that is not read.
    """
    from octobrick.store.sources.whole_blosc import checked
    from octobrick.store.sources.whole_store import WholeStore

    notes: list[str] = []
    store = WholeStore(store, path)
    with _parsing(path):
        key, array, image, attributes = _locate(store, pick.dataset, path, notes)
        if image is not None and pick.axes not in (None, image.letters):
            raise InvalidInputError(
                f"{path}: says that its axes are {image.letters}; leave out --axes",
                path=str(path),
                axes=image.letters,
            )
        letters = pick.axes or (image.letters if image else _named_axes(array))
        axes = axes_of(array.shape, letters, path)
        description = _describe(array, axes, image, notes, path)
    metadata = [array.metadata.to_dict(), attributes]
    array.store.has_blosc = _ends_in_blosc(metadata[0])
    return ZarrSource(
        path, description, axes, checked(array), metadata, root and root / key, remote
    )


class ZarrSource(ArraySource):
    """A source that is one array of zarr-python."""

    def __init__(
        self,
        path: Location,
        description: Description,
        axes: Axes,
        array: Any,
        metadata: list[Any],
        folder: Path | None,
        remote: RemoteStore | None,
    ) -> None:
        super().__init__(path, description, axes)
        self._array = array
        self._metadata = metadata
        self._folder = folder
        self._remote = remote
        self._readings: set[Reading] = set()

    @property
    def files(self) -> tuple[Path, ...]:
        """Metadata only: chunks may be millions; the fingerprint walks through them."""
        if self._folder is None or not isinstance(self.path, Path):
            return ()
        folders = dict.fromkeys((self.path, self._folder))
        paths = (folder / name for folder in folders for name in _METADATA)
        return tuple(path for path in paths if path.is_file())

    def fingerprint(self) -> dict[str, Any]:
        """The description, the metadata, and sizes and times of change.

        Those of all local files; of a server, what it says of the metadata.
        """
        text = json.dumps(self._metadata, sort_keys=True, default=str)
        digest = hashlib.blake2b(text.encode(), digest_size=16).hexdigest()
        if self._remote is not None:
            return {**self.describe(), **self._remote.stamp(), "metadata": digest}
        return {**super().fingerprint(), "metadata": digest}

    def _stat(self) -> Iterator[tuple[Path, os.stat_result]]:
        yield from super()._stat()
        if self._folder is not None:
            for parent, folders, names in os.walk(self._folder):
                folders.sort()
                for name in sorted(names):
                    path = Path(parent, name)
                    yield path, path.stat()

    def _select(self, index: tuple[int | slice, ...]) -> npt.NDArray[Any]:
        from octobrick.store.sources.reading import reading

        with reading() as current:
            self._readings.add(current)
            try:
                voxels = np.asarray(self._array[index])
            finally:
                self._readings.discard(current)
        if self._remote is not None:
            self._remote.require_unchanged()
        return voxels

    def abandon(self) -> None:
        """Cancel the requests under way."""
        for current in tuple(self._readings):
            current.abandon()

    def _close(self) -> None:
        self._array.store.close()


@contextmanager
def _parsing(path: Location) -> Iterator[None]:
    """`parsing`, deaf to what zarr-python warns of: other people's files in a folder."""
    with parsing(path, "Zarr"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _locate(
    store: Any, dataset: str | None, path: Location, notes: list[str]
) -> tuple[str, Any, Ngff | None, Any]:
    """Key and array of what is read, the image it belongs to, and the attributes of its group."""
    import zarr

    key = (dataset or "").strip("/")
    node = _node(store, key)
    if node is None:
        raise _nothing(path, key)
    if isinstance(node, zarr.Group):
        attributes = node.attrs.asdict()
        image = parse_ngff(attributes, None, notes)
        inner = _only_array(store, key, node, path) if image is None else image.dataset
        key = f"{key}/{inner}".strip("/")
        array = _node(store, key)
        if not isinstance(array, zarr.Array):
            raise _nothing(path, key)
        return key, array, image, attributes
    # An array: a resolution of the image above it, or of one higher up.
    parts = key.split("/") if key else []
    for cut in range(len(parts) - 1, -1, -1):
        above = _node(store, "/".join(parts[:cut]))
        if isinstance(above, zarr.Group):
            attributes = above.attrs.asdict()
            image = parse_ngff(attributes, "/".join(parts[cut:]), notes)
            if image is not None:
                return key, node, image, attributes
    return key, node, None, {}


def _node(store: Any, key: str) -> Any:
    """The group or array at a key; None where there is neither."""
    import zarr
    from zarr.errors import ContainsArrayError, GroupNotFoundError

    try:
        return zarr.open_group(store=store, path=key, mode="r", use_consolidated=False)
    except (GroupNotFoundError, ContainsArrayError, FileNotFoundError):
        pass
    try:
        return zarr.open_array(store=store, path=key, mode="r")
    except FileNotFoundError:
        return None


def _nothing(path: Location, key: str) -> SourceNotFoundError | InvalidInputError:
    if key:
        return InvalidInputError(
            f"{path}: no Zarr array or group at {printable(key)!r}; check --dataset",
            path=str(path),
            dataset=printable(key),
        )
    hint = "check the path"
    if isinstance(path, Url):
        hint = "check the address; files of other formats are not read from servers, copy them here"
    return SourceNotFoundError(
        f"{path}: no Zarr array or group is here (neither zarr.json nor .zarray or .zgroup); "
        f"{hint}",
        path=str(path),
    )


def _only_array(store: Any, key: str, group: Any, path: Location) -> str:
    """The path of the only array in a group without an image."""
    if isinstance(path, Url):  # most servers cannot list; what was consolidated can
        import zarr

        group = zarr.open_group(store=store, path=key, mode="r")
    found = [(name, array.shape) for name, array in group.arrays()]
    if len(found) == 1:
        return str(found[0][0])
    groups = [f"{printable(name)}/" for name, _ in group.groups()]
    arrays = [f"{printable(name)} {list(shape)}" for name, shape in sorted(found)]
    listed = ", ".join([*arrays, *sorted(groups)][:_LISTED])
    if not listed:
        raise UnsupportedSourceError(
            f"{path}: a Zarr group without arrays; name one below it with --dataset PATH",
            path=str(path),
        )
    raise InvalidInputError(
        f"{path}: is no image but a group of {listed}; choose one with --dataset PATH",
        path=str(path),
        datasets=listed,
    )


def _named_axes(array: Any) -> str | None:
    """The letters of the axes of a plain array, where it names them with ours."""
    names = getattr(array.metadata, "dimension_names", None)
    names = names or array.attrs.asdict().get("_ARRAY_DIMENSIONS")
    if not names or not all(isinstance(name, str) for name in names):
        return None
    letters = [name.lower() for name in names]
    known = all(len(letter) == 1 and letter in LETTERS for letter in letters)
    return "".join(letters) if known else None


def _ends_in_blosc(metadata: dict[str, Any]) -> bool:
    """Whether the bytes of a chunk that is read alone are blosc's; in shards none is a file."""
    codecs = metadata.get("codecs") or [metadata.get("compressor") or {}]
    last = codecs[-1] if isinstance(codecs[-1], dict) else codecs[-1].to_dict()
    return "blosc" in (last.get("name"), last.get("id"))


def _describe(
    array: Any, axes: Axes, image: Ngff | None, notes: list[str], path: Location
) -> Description:
    dtype = require_dtype(array.dtype, path)
    spacing_zyx: Vector = (1.0, 1.0, 1.0)
    origin_xyz: Vector = (0.0, 0.0, 0.0)
    channels = axes.channels
    if image is not None:
        spacing_zyx = clean_spacing(axes.of_zyx(image.scale, 1.0)[::-1], notes)
        z, y, x = axes.of_zyx(image.translation, 0.0)
        if math.isfinite(x + y + z):
            origin_xyz = (x, y, z)
        if len(image.channels) == axes.nc:
            channels = image.channels
    return Description(
        "zarr" if image is None else "ome-zarr",
        axes.shape_zyx,
        dtype,
        spacing_zyx,
        image and image.unit,
        warnings=tuple(notes),
        origin_xyz=origin_xyz,
        nt=axes.nt,
        nc=axes.nc,
        channels=channels,
        labels=image is not None and image.labels,
        # Of shards the chunks inside, which are read alone.
        chunk_zyx=require_chunk(tuple(array.chunks), dtype, axes, path),
    )
