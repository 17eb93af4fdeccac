"""A disk with little free space."""

import errno
import os
import tempfile


class LimitedFile:
    """A file on a disk with `room[0]` free bytes."""

    def __init__(self, file, room):
        self._file, self._room = file, room

    def write(self, data):
        if not self._room[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        count = self._file.write(data[: self._room[0]])
        self._room[0] -= count
        return count

    def __getattr__(self, name):
        return getattr(self._file, name)


def limit_disk(monkeypatch, room):
    """Limit the room for temporary files, bytes; return a list with the room that is left."""
    left, create = [room], tempfile.TemporaryFile
    monkeypatch.setattr(tempfile, "TemporaryFile", lambda **o: LimitedFile(create(**o), left))
    return left
