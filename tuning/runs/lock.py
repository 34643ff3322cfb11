"""One process at a time on a run folder.

FOLDER/.lock   held, by `flock`, as long as the process lives; it says who that is

A lock falls with its process, however that ends: a file that a kill left behind locks nothing.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import socket
import sys
import weakref
from pathlib import Path

from tuning.files.errors import input_error

NAME = ".lock"
_BUSY = {errno.EAGAIN, errno.EACCES, errno.EWOULDBLOCK}
_SHOWN = 200


class FolderLock:
    """A lock on a folder; released when nobody in this process refers to it any more."""

    def __init__(self, folder: Path, descriptor: int):
        self.folder = folder
        self.descriptor = descriptor
        self.release = weakref.finalize(self, _release, folder / NAME, descriptor, os.getpid())

    @property
    def holds(self) -> bool:
        """Whether it is still the lock of that folder, which may have been removed and made again."""
        return self.release.alive and _is_same(self.folder / NAME, self.descriptor)


_HELD: weakref.WeakValueDictionary[Path, FolderLock] = weakref.WeakValueDictionary()
"""A process that opens a folder twice has it already."""


def lock_folder(folder: Path) -> FolderLock:
    """Return the lock of a folder that is there.

    Raises:
        InputError: another process holds it, or the folder cannot be written to.
    """
    place = folder.resolve()
    held = _HELD.get(place)
    if held is not None and held.holds:
        return held
    lock = FolderLock(place, _take(folder))
    _HELD[place] = lock
    return lock


def _take(folder: Path) -> int:
    path = folder / NAME
    while True:
        try:
            # No link is followed, and a pipe does not make this process wait.
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)
        except OSError as error:
            problem = f"cannot be locked: {path.name} cannot be written ({error.strerror})"
            raise input_error(folder, problem, f"check the folder and the disk, or remove {path}") from None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in _BUSY:
                holder = _holder(descriptor)
                os.close(descriptor)
                fix = "wait until that has ended, then go on with --resume, or name another folder with -o"
                raise input_error(folder, f"is in use by {holder}", fix) from None
            print(f"note: {folder} cannot be locked ({error.strerror}): run one process on it", file=sys.stderr)
            return descriptor
        # The process before this one may have removed it in between.
        if _is_same(path, descriptor):
            _sign(descriptor)
            return descriptor
        os.close(descriptor)


def _sign(descriptor: int) -> None:
    """Say in the lock who holds it; on a full disk it holds all the same."""
    with contextlib.suppress(OSError):
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, json.dumps({"pid": os.getpid(), "host": socket.gethostname()}).encode(), 0)


def _holder(descriptor: int) -> str:
    try:
        said = json.loads(os.pread(descriptor, _SHOWN, 0))
        return f"process {int(said['pid'])} on {said['host']!s:.60}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process"


def _is_same(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.lstat(), os.fstat(descriptor))
    except OSError:
        return False


def _release(path: Path, descriptor: int, owner: int) -> None:
    """Remove a lock and let go of it, in this order; a process that was forked off has not got it."""
    if os.getpid() == owner and _is_same(path, descriptor):
        path.unlink(missing_ok=True)
    with contextlib.suppress(OSError):
        os.close(descriptor)
