"""A disk that takes so many bytes and no more."""

import errno
import os


class FullDisk:
    """The file of a RowFile, with `room` (bytes) for what is written from now on."""

    def __init__(self, file, room):
        self._file, self.room = file, room

    def write(self, data):
        if not self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        count = self._file.write(data[: self.room])
        self.room -= count
        return count

    def __getattr__(self, name):
        return getattr(self._file, name)


def fill(rows, room):
    rows._file = FullDisk(rows._file, room)
    return rows._file
