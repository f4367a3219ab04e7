"""What a command writes for other programs: under a temporary name, then put in place at once.

Nothing is visible under the name that was asked for until all of it is on the disk, and nothing
stays behind when it fails.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from octobrick.store.durable import explained, sync
from octobrick.store.errors import DestinationExistsError

_SUFFIX = ".partial"


@contextlib.contextmanager
def staged_file(out: Path, *, overwrite: bool) -> Iterator[Path]:
    """An empty file that becomes ``out`` when the block ends, and vanishes if it fails.

    Its name ends as that of ``out`` does, for writers that go by the suffix.

    Raises:
        DestinationExistsError: there is something at ``out`` and ``overwrite`` is not set, or it
            is not a file.
        DestinationError: the system refuses to write (permissions, no space, read-only, …).
    """
    with explained(out):
        _refuse_existing(out, overwrite=overwrite, is_folder=False)
        descriptor, name = tempfile.mkstemp(f"{_SUFFIX}-{out.name}", ".octobrick-", out.parent)
        os.fchmod(descriptor, 0o666 & ~_umask())
        os.close(descriptor)
        partial = Path(name)
        try:
            yield partial
            sync(partial)
            _put_file(partial, out, overwrite=overwrite)
        finally:
            partial.unlink(missing_ok=True)
        sync(out.parent)


@contextlib.contextmanager
def staged_folder(out: Path, *, overwrite: bool, marker: str) -> Iterator[Path]:
    """An empty folder that becomes ``out`` when the block ends, and vanishes if it fails.

    Args:
        out: the folder to be.
        overwrite: replace what is there, if it is a folder with the ``marker`` in it.
        marker: a file by whose name a folder of the same kind is known.

    Raises:
        DestinationExistsError: there is something at ``out`` that is not to be replaced.
        DestinationError: the system refuses to write (permissions, no space, read-only, …).
    """
    with explained(out):
        _refuse_existing(out, overwrite=overwrite, is_folder=True, marker=marker)
        partial = Path(tempfile.mkdtemp(f"{_SUFFIX}-{out.name}", ".octobrick-", out.parent))
        partial.chmod(0o777 & ~_umask())
        try:
            yield partial
            _sync_tree(partial)
            _put_folder(partial, out, overwrite=overwrite)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
        sync(out.parent)


def _refuse_existing(out: Path, *, overwrite: bool, is_folder: bool, marker: str = "") -> None:
    if not out.exists() and not out.is_symlink():
        return
    if not overwrite:
        raise _exists(out)
    alike = (out / marker).is_file() if is_folder else out.is_file()
    if out.is_symlink() or not alike:
        what = f"folder with a {marker}" if is_folder else "file"
        raise DestinationExistsError(
            f"{out}: exists and is no {what}, so it is not overwritten; remove it yourself or "
            "choose another name",
            path=str(out),
        )


def _exists(out: Path) -> DestinationExistsError:
    return DestinationExistsError(
        f"{out}: already exists; choose another name or allow it to be overwritten (--overwrite)",
        path=str(out),
    )


def _put_file(partial: Path, out: Path, *, overwrite: bool) -> None:
    if not overwrite:
        try:
            os.link(partial, out)  # unlike a rename, never replaces what appeared meanwhile
            return
        except FileExistsError:
            raise _exists(out) from None
        except OSError:  # a file system without hard links
            _refuse_existing(out, overwrite=False, is_folder=False)
    partial.replace(out)


def _put_folder(partial: Path, out: Path, *, overwrite: bool) -> None:
    # A folder that is not empty cannot be replaced in one step: the old one is out of sight for
    # the moment between two renames, and is not lost before the new one stands.
    replaced = partial.with_name(f"{partial.name}.replaced")
    if overwrite and out.exists():
        out.rename(replaced)
    try:
        partial.rename(out)
    except OSError as error:
        if replaced.exists() and not out.exists():
            replaced.rename(out)
        if error.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
            raise _exists(out) from error
        raise
    shutil.rmtree(replaced, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def _sync_tree(folder: Path) -> None:
    for parent, _, names in os.walk(folder):
        for name in names:
            sync(Path(parent) / name)
        sync(Path(parent))
