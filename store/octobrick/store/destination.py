"""Where an ingest writes: a folder beside the destination, renamed into place when complete.

Until then nothing is visible under the destination's name. The folder is locked while an ingest
runs, so two of them cannot write one volume. What one left behind that was stopped, the next takes
up if there is a checkpoint in it.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from octobrick.codec.errors import CorruptDataError, InvalidInputError, UnsupportedError
from octobrick.store.durable import explained, sync
from octobrick.store.errors import DestinationBusyError, DestinationExistsError
from octobrick.store.journal import JOURNAL_NAME, has_checkpoint

PARTIAL_SUFFIX = ".partial"
_REPLACED_SUFFIX = ".replaced"
_LOCK_NAME = ".lock"


def partial_path(dest: Path) -> Path:
    """The folder in which a volume grows until it is complete."""
    return dest.with_name(dest.name + PARTIAL_SUFFIX)


@contextlib.contextmanager
def staged(dest: Path, *, overwrite: bool) -> Iterator[Path]:
    """A locked folder that becomes ``dest`` when the block ends.

    It may hold what an ingest left that was stopped; `clear` empties it. If the block fails, the
    folder stays where another run can go on from a checkpoint in it, and vanishes otherwise.

    Raises:
        DestinationExistsError: there is something at ``dest`` and ``overwrite`` is not set, or it
            is not a volume.
        DestinationBusyError: another ingest is writing this destination.
        DestinationError: the system refuses to write (permissions, no space, read-only, …).
    """
    partial = partial_path(dest)
    with explained(dest, lambda: _what_remains(dest)):
        _refuse_existing(dest, overwrite=overwrite)
        partial.mkdir(parents=True, exist_ok=True)
        lock = _lock(dest, partial)
        try:
            try:
                yield partial
                _sync_folders(partial)
                _put_in_place(partial, dest, overwrite=overwrite)
            except BaseException as error:
                if not (has_checkpoint(partial) and _can_go_on_after(error)):
                    shutil.rmtree(partial, ignore_errors=True)
                raise
        finally:
            os.close(lock)


def _can_go_on_after(error: BaseException) -> bool:
    """Whether the same command may succeed later: what was wrong is not in the voxels or options.

    A source that the system stopped reading (a lost disk or share) may be there again; one whose
    bytes make no sense will make none the next time.
    """
    if isinstance(error, (InvalidInputError, CorruptDataError, UnsupportedError)):
        return isinstance(error.__cause__, OSError)
    return True


def _refuse_existing(dest: Path, *, overwrite: bool) -> None:
    if not dest.exists() and not dest.is_symlink():
        return
    if not overwrite:
        raise DestinationExistsError(
            f"{dest}: already exists; choose another destination or allow it to be overwritten "
            "(--overwrite)",
            path=str(dest),
        )
    if not (dest / "zarr.json").is_file() or dest.is_symlink():
        raise DestinationExistsError(
            f"{dest}: exists and is no volume, so it is not overwritten; remove it yourself or "
            "choose another destination",
            path=str(dest),
        )


def _lock(dest: Path, partial: Path) -> int:
    descriptor = os.open(partial / _LOCK_NAME, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise DestinationBusyError(
            f"{dest}: another ingest is writing this destination ({partial} is locked); wait for "
            "it or choose another destination",
            path=str(dest),
        ) from None
    return descriptor


def clear(partial: Path) -> None:
    """Empty the folder but for its lock."""
    for entry in partial.iterdir():
        if entry.name == _LOCK_NAME:
            continue
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        else:
            entry.unlink()


def _put_in_place(partial: Path, dest: Path, *, overwrite: bool) -> None:
    _refuse_existing(dest, overwrite=overwrite)
    # Last, so that whatever fails before this moment can be gone on with.
    for journal in partial.glob(f"{JOURNAL_NAME}*"):
        journal.unlink()
    (partial / _LOCK_NAME).unlink()
    replaced = dest.with_name(dest.name + _REPLACED_SUFFIX)
    if overwrite and dest.exists():
        # A folder that is not empty cannot be replaced in one step; the old volume is out of
        # sight for the moment between the two renames, and never lost before the new one stands.
        shutil.rmtree(replaced, ignore_errors=True)
        dest.rename(replaced)
    try:
        partial.rename(dest)
    except OSError as error:
        if replaced.exists() and not dest.exists():
            replaced.rename(dest)
        if error.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
            raise DestinationExistsError(
                f"{dest}: something appeared there during the ingest; remove it and run the "
                "ingest again",
                path=str(dest),
            ) from error
        raise
    sync(dest.parent)
    shutil.rmtree(replaced, ignore_errors=True)


def _what_remains(dest: Path) -> str:
    if has_checkpoint(partial_path(dest)):
        return f"It goes on from the last checkpoint, in {partial_path(dest)}"
    return "Nothing was left behind"


def _sync_folders(partial: Path) -> None:
    for folder, _, _ in os.walk(partial):
        sync(Path(folder))
