"""Picture files: which suffix is written how. Each file appears whole, or not at all."""

from __future__ import annotations

import importlib
import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.store.staging import staged_file

if TYPE_CHECKING:
    from octobrick.renderer.image import RenderedImage

JPEG_QUALITY: Final = 92
"""Where nobody asks for another: a step of 8-bit gray at most on smooth surfaces."""
WEBP_EFFORT: Final = 4
"""Of 0 to 6: beyond it lossless files shrink by hundredths and take several times as long."""
_NO_TRANSPARENCY: Final = (
    "JPEG has no transparency, and the picture is transparent; give it a background, or choose "
    ".png or .webp"
)


@dataclass(frozen=True, slots=True)
class _Kind:
    """How files with a suffix are made.

    Attributes:
        encode: the bytes of a picture at a quality.
        takes_quality: whether anything of the file can be given up for size.
        floats: holds what the rays gathered, in float32, not the finished 8-bit picture.
        opaque: cannot hold transparency.
    """

    encode: Callable[[RenderedImage, int | None], bytes]
    takes_quality: bool = False
    floats: bool = False
    opaque: bool = False


def is_picture(path: str | os.PathLike[str]) -> bool:
    """Whether a name ends as a picture file's does."""
    return Path(path).suffix.lower() in _KINDS


def holds_floats(path: str | os.PathLike[str]) -> bool:
    """Whether a file of that name holds float32 of what the rays gathered, and no annotations."""
    kind = _KINDS.get(Path(path).suffix.lower())
    return kind is not None and kind.floats


def require_picture(
    path: str | os.PathLike[str], quality: int | None = None, *, transparent: bool = False
) -> None:
    """Refuse what `save_picture` could not write: before the work, not after it.

    Args:
        path: of the picture.
        quality: that will be asked for.
        transparent: whether the picture will have no background.

    Raises:
        InvalidInputError: no kind of picture has that suffix, or the kind has no such quality or
            no transparency.
        ResourceError: the package that writes it is not installed; the message names the extra.
    """
    kind = _kind_of(Path(path), quality)
    if transparent and kind.opaque:
        raise InvalidInputError(f"{path}: {_NO_TRANSPARENCY}", path=str(path))
    if Path(path).suffix.lower() == ".exr":
        _open_exr()
    elif not holds_floats(path):
        pillow()


def save_picture(
    image: RenderedImage, path: str | os.PathLike[str], quality: int | None = None
) -> None:
    """Write a picture to a file whose suffix says how; what is there is replaced.

    Raises:
        InvalidInputError: see `require_picture`; or a JPEG was asked of a transparent picture.
        ResourceError: the package that writes it is not installed; the message names the extra.
        DestinationError: the system refuses to write.
    """
    content = _kind_of(Path(path), quality).encode(image, quality)
    with staged_file(Path(path).resolve(), overwrite=True) as partial:
        partial.write_bytes(content)


def encoded(image: RenderedImage, suffix: str, quality: int | None = None) -> bytes:
    """The bytes of the file that `save_picture` would write.

    Args:
        image: the picture.
        suffix: of the file, such as ".webp".
        quality: 1 to 100, of formats that have one.

    Raises:
        InvalidInputError: see `require_picture`; or a JPEG was asked of a transparent picture.
        ResourceError: the package that writes it is not installed; the message names the extra.
    """
    return _kind_of(Path(f"picture{suffix}"), quality).encode(image, quality)


def png(rgba: NDArray[np.uint8]) -> bytes:
    """A picture as PNG: RGBA, or RGB where every pixel is opaque.

    Args:
        rgba: (height, width, 4), straight alpha.

    Raises:
        ResourceError: Pillow is not installed.
    """
    return _by_pillow(rgba, "PNG")


def is_opaque(rgba: NDArray[np.uint8]) -> bool:
    """Whether nothing of a picture is transparent."""
    return bool((rgba[..., 3] == 255).all())


def pillow() -> Any:
    """Pillow's module `PIL.Image`.

    Raises:
        ResourceError: it is not installed.
    """
    return required("PIL.Image", "Pillow", "writing this picture", "render")


def required(module: str, package: str, what: str, extra: str) -> Any:
    """A module of an optional package.

    Raises:
        ResourceError: it is not installed; the message names the extra that brings it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ResourceError(
            f"{what} needs {package}, which is not installed: pip install 'octobrick[{extra}]'",
            package=package.lower(),
        ) from error


def _kind_of(path: Path, quality: int | None) -> _Kind:
    kind = _KINDS.get(path.suffix.lower())
    if kind is None:
        raise InvalidInputError(
            f"{path}: no picture file ends in {path.suffix!r}; choose a name that ends in one of "
            f"{', '.join(_KINDS)}",
            path=str(path),
            suffixes=list(_KINDS),
        )
    if quality is None:
        return kind
    if not kind.takes_quality:
        lossy = [suffix for suffix, other in _KINDS.items() if other.takes_quality]
        raise InvalidInputError(
            f"{path}: quality {quality} means nothing, since these files lose nothing; leave it "
            f"out, or choose one of {', '.join(lossy)}",
            path=str(path),
            quality=quality,
        )
    if not 1 <= quality <= 100:
        raise InvalidInputError(
            f"{path}: quality is {quality}; choose a whole number from 1 to 100",
            path=str(path),
            quality=quality,
        )
    return kind


def _by_pillow(rgba: NDArray[np.uint8], format_: str, **options: Any) -> bytes:
    buffer = io.BytesIO()
    shown = rgba[..., :3] if is_opaque(rgba) else rgba
    pillow().fromarray(np.ascontiguousarray(shown)).save(buffer, format_, **options)
    return buffer.getvalue()


def _png(image: RenderedImage, _quality: int | None) -> bytes:
    return png(image.rgba)


def _webp(image: RenderedImage, quality: int | None) -> bytes:
    if quality is None:
        # exact: the colour of what is transparent, which costs little, is kept too.
        return _by_pillow(image.rgba, "WEBP", lossless=True, exact=True, method=WEBP_EFFORT)
    return _by_pillow(image.rgba, "WEBP", quality=quality, method=WEBP_EFFORT)


def _jpeg(image: RenderedImage, quality: int | None) -> bytes:
    if not is_opaque(image.rgba):
        raise InvalidInputError(_NO_TRANSPARENCY)
    # Colours at full resolution: half of it frays the edges of thin, bright structures.
    return _by_pillow(image.rgba, "JPEG", quality=quality or JPEG_QUALITY, subsampling=0)


def _npy(image: RenderedImage, _quality: int | None) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, image.premultiplied, allow_pickle=False)
    return buffer.getvalue()


def _exr(image: RenderedImage, _quality: int | None) -> bytes:
    exr = _open_exr()
    channels = {"RGBA": np.ascontiguousarray(image.premultiplied, np.float32)}
    if image.depth is not None:
        channels["Z"] = np.ascontiguousarray(image.depth, np.float32)
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    fidelity = image.fidelity
    header["comments"] = f"level {fidelity.level}, largest error {fidelity.max_error:g}"
    return _written(lambda name: exr.File(header, channels).write(name), ".exr")


def _open_exr() -> Any:
    return required("OpenEXR", "OpenEXR", "writing .exr", "exr")


def _written(write: Callable[[str], None], suffix: str) -> bytes:
    """The bytes of a library that only writes files."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"picture{suffix}")
        write(str(file))
        return file.read_bytes()


_KINDS: Final = {
    ".png": _Kind(_png),
    ".webp": _Kind(_webp, takes_quality=True),
    ".jpg": _Kind(_jpeg, takes_quality=True, opaque=True),
    ".jpeg": _Kind(_jpeg, takes_quality=True, opaque=True),
    ".exr": _Kind(_exr, floats=True),
    ".npy": _Kind(_npy, floats=True),
}
