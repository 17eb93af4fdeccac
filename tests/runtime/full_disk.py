"""A disk with little free space."""

import errno
import os


class FullDisk:
    """The file of a `RowFile` on a disk with `room` free bytes."""

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
