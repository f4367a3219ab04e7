"""NIfTI-1 and NIfTI-2: ``.nii``, ``.nii.gz`` and pairs ``.hdr`` with ``.img``.

nibabel takes the header apart; the voxels are read by our own readers, so that memory stays
bounded. Source: NIfTI-1.1 (nifti1.h) and NIfTI-2 (nifti2.h), https://nifti.nimh.nih.gov.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from octobrick.store.errors import (
    SourceError,
    SourceNotFoundError,
    TruncatedSourceError,
    UnsupportedSourceError,
)
from octobrick.store.sources.axes import Axes, axes_of
from octobrick.store.sources.base import Description, Direction, Rescale, Source, Vector
from octobrick.store.sources.flat import Layout
from octobrick.store.sources.gzip_stream import GzipSource
from octobrick.store.sources.head import (
    GZIP_MAGIC,
    missing_package,
    parsing,
    read_head,
    read_head_inflated,
    require_file,
)
from octobrick.store.sources.raw import RawSource
from octobrick.store.sources.voxels import (
    LPS_OF_RAS,
    clean_origin,
    clean_spacing,
    direction_of_ras,
    require_dtype,
    require_shape,
)

_DTYPE_OF_CODE = {
    2: "uint8",
    256: "int8",
    4: "int16",
    512: "uint16",
    8: "int32",
    768: "uint32",
    1024: "int64",
    1280: "uint64",
    16: "float32",
    64: "float64",
    128: "uint8",  # RGB24
    2304: "uint8",  # RGBA32
}
# Samples of one colour, which lie beside each other.
_COLOUR_OF_CODE = {128: 3, 2304: 4}
_LABEL_INTENT = 1002
_RGB_INTENTS = (2003, 2004)
# Matrices, displacements and vectors: their components are the fifth axis. Files whose only
# further axis is the fourth have them there, because some programs write them so.
_VECTOR_INTENTS = (1004, 1005, 1006, 1007, *_RGB_INTENTS)
# The lowest three bits of xyzt_units.
_UNIT_OF_CODE = {1: "meter", 2: "millimeter", 3: "micrometer"}
# pixdim and the sform say the spacing twice; files of float32 agree this well.
_SPACING_TOLERANCE = 1e-3


ByteOrder = Literal["<", ">"]
_BYTE_ORDERS: tuple[ByteOrder, ...] = ("<", ">")


class _Version(NamedTuple):
    """What tells the versions of the header apart."""

    name: str
    header_nbytes: int
    magic_offset: int
    single_magic: bytes
    pair_magic: bytes


_VERSIONS = (
    _Version("nifti-1", 348, 344, b"n+1\0", b"ni1\0"),
    _Version("nifti-2", 540, 4, b"n+2\0", b"ni2\0"),
)
HEAD_NBYTES = 540


def is_nifti(head: bytes) -> bool:
    """Whether bytes (decompressed) begin a NIfTI header."""
    return _version_of(head) is not None


def open_nifti(path: Path) -> Source:
    """A NIfTI file or pair; spacing from pixdim, direction from sform or else qform, in LPS.

    Raises:
        SourceError: the header is damaged or describes more than the file holds.
        UnsupportedSourceError: a sixth axis, fewer than three, or a sample type that is not read.
        SourceNotFoundError: half of a pair is missing.
        ResourceError: nibabel is not installed.
    """
    is_img = path.name.lower().removesuffix(".gz").endswith(".img")
    header_path = _partner(path, ".hdr") if is_img else path
    head = read_head_inflated(header_path, HEAD_NBYTES)
    version, order = _require_version(head, header_path)
    header = _parse(head[: version.header_nbytes], version, order, header_path)
    axes = _axes(header, header_path)
    description = _describe(header, version, axes, header_path)
    is_pair = head[version.magic_offset :].startswith(version.pair_magic)
    data_path = _partner(header_path, ".img") if is_pair else header_path
    least = 0 if is_pair else version.header_nbytes + 4  # four bytes tell of extensions
    offset = _offset(header, least, header_path)
    dtype = description.dtype.newbyteorder(order)
    layout = Layout(data_path, offset, dtype, strides=axes.strides())
    if is_pair:  # the first bytes of an .img are voxels, which may look like anything
        compressed = data_path.suffix.lower() == ".gz"
    else:
        compressed = read_head(data_path, len(GZIP_MAGIC)) == GZIP_MAGIC
    return (GzipSource if compressed else RawSource)(path, description, layout)


def _version_of(head: bytes) -> tuple[_Version, ByteOrder] | None:
    """The version of a header and its byte order, from its size field and magic."""
    for version in _VERSIONS:
        magic = head[version.magic_offset : version.magic_offset + 4]
        if magic in (version.single_magic, version.pair_magic):
            for order in _BYTE_ORDERS:
                if head[:4] == struct.pack(f"{order}i", version.header_nbytes):
                    return version, order
    return None


def _require_version(head: bytes, path: Path) -> tuple[_Version, ByteOrder]:
    found = _version_of(head)
    if found:
        return found
    if len(head) < _VERSIONS[0].header_nbytes:
        raise TruncatedSourceError(
            f"{path}: a NIfTI header takes at least 348 bytes, this file holds {len(head)}; "
            "copy or export it again",
            path=str(path),
            expected_nbytes=348,
            actual_nbytes=len(head),
        )
    if head[:4] in (struct.pack("<i", 348), struct.pack(">i", 348)) and head[344:348] == b"\0" * 4:
        raise UnsupportedSourceError(
            f"{path}: is Analyze 7.5, which leaves orientation open; convert it to NIfTI",
            path=str(path),
        )
    raise SourceError(
        f"{path}: not a NIfTI header: it begins with {head[:4]!r} and has magic "
        f"{head[344:348]!r}; 348 or 540 as a 32-bit number and 'n+1' or 'n+2' are expected; "
        "export the file again",
        path=str(path),
    )


def _parse(block: bytes, version: _Version, order: str, path: Path) -> Any:
    """The header as nibabel has it; nothing in it has been checked."""
    try:
        import nibabel  # in the extra "formats"
    except ImportError as error:
        raise missing_package("nibabel", path) from error
    if len(block) < version.header_nbytes:
        raise TruncatedSourceError(
            f"{path}: the {version.name} header ends after {len(block)} of "
            f"{version.header_nbytes} bytes; copy or export the file again",
            path=str(path),
            expected_nbytes=version.header_nbytes,
            actual_nbytes=len(block),
        )
    header_class = nibabel.Nifti1Header if version is _VERSIONS[0] else nibabel.Nifti2Header
    with parsing(path, "NIfTI"):
        return header_class(block, endianness=order, check=False)  # type: ignore[no-untyped-call]


def _describe(header: Any, version: _Version, axes: Axes, path: Path) -> Description:
    notes: list[str] = []
    dtype = require_dtype(_dtype_name(header), path)
    # Float32 sizes as their shortest decimals: 0.41, not 0.409999996...
    spacing_zyx = clean_spacing([float(str(size)) for size in header["pixdim"][1:4]], notes)
    direction = _direction(header, spacing_zyx[::-1], notes, path)
    origin_xyz = _origin(header, notes)
    return Description(
        version.name,
        axes.shape_zyx,
        dtype,
        spacing_zyx,
        _UNIT_OF_CODE.get(int(header["xyzt_units"]) & 7),
        direction,
        _rescale(header, path),
        tuple(notes),
        origin_xyz,
        axes.nt,
        axes.nc,
        axes.channels,
        labels=int(header["intent_code"]) == _LABEL_INTENT and dtype.kind in "iu",
    )


def _axes(header: Any, path: Path) -> Axes:
    """The axes: x, y, z, then time, then components; samples of a colour before all of them."""
    ndim, *dims = (int(size) for size in header["dim"])
    if not 1 <= ndim <= 7:
        raise SourceError(
            f"{path}: the header gives {ndim} axes; 1 to 7 are possible; export the file again",
            path=str(path),
            ndim=ndim,
        )
    sizes = dims[:ndim]
    intent, colour = int(header["intent_code"]), _COLOUR_OF_CODE.get(int(header["datatype"]))
    if ndim < 3 or any(size != 1 for size in sizes[5:]):
        require_shape(sizes, path)  # says what was found
    component = "s" if intent in _RGB_INTENTS and colour is None else "c"
    is_vector = intent in _VECTOR_INTENTS and sizes[4:5] in ([], [1])
    letters, sizes = ("xyz" + (component if is_vector else f"t{component}"))[:ndim], sizes[:5]
    if is_vector:
        sizes = sizes[:4]
    if colour is not None:
        letters, sizes = "s" + letters, [colour, *sizes]
    return axes_of(sizes[::-1], letters[::-1], path)


def _dtype_name(header: Any) -> str:
    """Our name of the sample type, or NIfTI's own for one that is not read."""
    from nibabel.nifti1 import data_type_codes

    code = int(header["datatype"])
    if code in _DTYPE_OF_CODE:
        return _DTYPE_OF_CODE[code]
    if code in data_type_codes.code:
        return str(data_type_codes.label[code])
    return f"of NIfTI datatype {code}"


def _direction(
    header: Any, spacing_xyz: tuple[float, ...], notes: list[str], path: Path
) -> Direction | None:
    """From the sform if there is one, else the qform; both map to right, anterior, superior."""
    if int(header["sform_code"]) > 0:
        affine = np.array([header["srow_x"], header["srow_y"], header["srow_z"]], np.float64)[:, :3]
        with np.errstate(all="ignore"):
            sizes = np.linalg.norm(affine, axis=0)
        if not np.allclose(sizes, spacing_xyz, rtol=_SPACING_TOLERANCE):
            notes.append(
                f"the sform has voxels of {sizes[0]:g} x {sizes[1]:g} x {sizes[2]:g}, "
                "pixdim has others; pixdim is used"
            )
    elif int(header["qform_code"]) > 0:
        with parsing(path, "NIfTI"), np.errstate(all="ignore"):
            affine = _qform(header)
    else:
        return None
    return direction_of_ras([affine[:, axis].tolist() for axis in range(3)], notes)


def _origin(header: Any, notes: list[str]) -> Vector:
    """Where the first voxel lies, from what gives the direction."""
    if int(header["sform_code"]) > 0:
        given = [header[f"srow_{axis}"][3] for axis in "xyz"]
    elif int(header["qform_code"]) > 0:
        given = [header[f"qoffset_{axis}"] for axis in "xyz"]
    else:
        return (0.0, 0.0, 0.0)
    return clean_origin([float(str(size)) for size in given], notes, to_lps=LPS_OF_RAS)


def _qform(header: Any) -> Any:
    """The rotation of quaternion (a, b, c, d), z turned round where pixdim[0] is negative."""
    b, c, d = (float(header[name]) for name in ("quatern_b", "quatern_c", "quatern_d"))
    a = np.sqrt(max(0.0, 1 - (b * b + c * c + d * d)))
    rotation = np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ]
    )
    if header["pixdim"][0] < 0:
        rotation[:, 2] *= -1
    return rotation


def _rescale(header: Any, path: Path) -> Rescale | None:
    """scl_slope and scl_inter; a slope of zero (or none) means that samples are values."""
    slope, intercept = float(str(header["scl_slope"])), float(str(header["scl_inter"]))
    if slope == 0 or not np.isfinite(slope) or int(header["datatype"]) in _COLOUR_OF_CODE:
        return None
    if not np.isfinite(intercept):
        raise SourceError(
            f"{path}: scl_slope is {slope:g} but scl_inter is {intercept}; "
            "set scl_inter to a number, or scl_slope to 0 where samples are values",
            path=str(path),
            scl_slope=slope,
        )
    return None if (slope, intercept) == (1, 0) else Rescale(slope, intercept)


def _offset(header: Any, least: int, path: Path) -> int:
    """Where the voxels begin in their file; 0 stands for right behind the header."""
    offset = float(header["vox_offset"])
    if offset == 0:
        return least
    if not least <= offset < 2**63 or offset != int(offset):
        raise SourceError(
            f"{path}: voxels are said to begin at byte {offset:g}; "
            f"a whole number of at least {least} is expected; correct vox_offset in the header",
            path=str(path),
            vox_offset=offset,
            least=least,
        )
    return int(offset)


def _partner(path: Path, suffix: str) -> Path:
    """The other half of a ``.hdr``/``.img`` pair, compressed or not."""
    gz = ".gz" if path.name.lower().endswith(".gz") else ""
    stem = path.name[: len(path.name) - len(gz)]
    base = stem.rpartition(".")[0] or stem
    spelling = suffix.upper() if stem.endswith((".HDR", ".IMG")) else suffix
    names = [f"{base}{spelling}{end}" for end in (gz, "" if gz else ".gz")]
    for candidate in (path.with_name(name) for name in names):
        if candidate.exists():
            require_file(candidate, named_by=path)
            return candidate
    raise SourceNotFoundError(
        f"{path.with_name(names[0])}: no such file, which belongs with {path}; "
        "put both in the same folder",
        path=str(path.with_name(names[0])),
    )
