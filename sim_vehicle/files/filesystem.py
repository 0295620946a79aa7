"""The files of one vehicle: what it generates when somebody reads it, and a small area to write to.

Paths are case-sensitive and absolute whether they begin with `/` or not. Directories follow from the files in
them; a part behind `?` is a query that the generated file may understand (`@PARAM/param.pck?start=10`).
"""

import errno
from collections.abc import Callable, Mapping
from dataclasses import dataclass

MOST_BYTES = 1 << 20  # of all files that were written
MOST_ENTRIES = 128  # files and directories that were written or made


class FileError(Exception):
    """A file operation failed; `number` is the errno."""

    def __init__(self, number: int) -> None:
        super().__init__(errno.errorcode[number])
        self.number = number


@dataclass(frozen=True, slots=True)
class Source:
    """A file that the vehicle provides.

    `read(query)` is the whole content (it may raise FileError), `size()` what a listing says of it [bytes],
    `write(content)` takes an uploaded file and says whether it could be used, `remove()` deletes it.
    """

    read: Callable[[str], bytes]
    size: Callable[[], int]
    write: Callable[[bytes], bool] | None = None
    remove: Callable[[], None] | None = None


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of a directory; `size` [bytes] is None for a directory."""

    name: str
    size: int | None


def constant(content: bytes) -> Source:
    """A file that never changes."""
    return Source(read=lambda _query: content, size=lambda: len(content))


class FileSystem:
    """The generated files of `sources` (looked at anew each time) and what was written under `writable`.

    `writable` are directories, without a leading `/`; files there cost memory, so their bytes and number are
    limited.
    """

    def __init__(
        self,
        sources: Callable[[], Mapping[str, Source]],
        *,
        writable: tuple[str, ...] = (),
        most_bytes: int = MOST_BYTES,
    ) -> None:
        self._sources = sources
        self._writable = writable
        self._most_bytes = most_bytes
        self._files: dict[str, bytearray] = {}
        self._made: set[str] = set()

    # -- looking -----------------------------------------------------------------------------------------

    def entries(self, path: str) -> list[Entry]:
        """What is in a directory, by name; FileError if there is none."""
        path = normal(path)
        sources = self._sources()
        if not self._is_directory(path, sources):
            raise FileError(errno.ENOTDIR if path in sources or path in self._files else errno.ENOENT)
        prefix = f"{path}/" if path else ""
        found: dict[str, int | None] = {}
        for directory in (*self._made, *self._writable):
            if directory.startswith(prefix) and directory != path:
                found[directory[len(prefix) :].split("/")[0]] = None
        for name, size in [(name, source.size()) for name, source in sources.items()] + [
            (name, len(content)) for name, content in self._files.items()
        ]:
            if name.startswith(prefix):
                first, _, rest = name[len(prefix) :].partition("/")
                found[first] = None if rest else size
        return [Entry(name, found[name]) for name in sorted(found)]

    def read(self, path: str) -> bytes:
        """The content of a file as it is now; FileError if there is none."""
        name, _, query = path.partition("?")
        name = normal(name)
        if name in self._files:
            return bytes(self._files[name])
        sources = self._sources()
        if name in sources:
            return sources[name].read(query)
        raise FileError(errno.EISDIR if self._is_directory(name, sources) else errno.ENOENT)

    def _is_directory(self, path: str, sources: Mapping[str, Source]) -> bool:
        prefix = f"{path}/"
        return (
            path == ""
            or path in self._made
            or any(f"{name}/".startswith(prefix) for name in self._writable)
            or any(name.startswith(prefix) for name in (*sources, *self._files, *self._made))
        )

    # -- changing ----------------------------------------------------------------------------------------

    def open_to_write(self, path: str, *, truncate: bool) -> str:
        """Make sure that a file can be written; its path as `write` and `close` want it."""
        path = normal(path)
        sources = self._sources()
        if path in sources:
            if sources[path].write is None:
                raise FileError(errno.EROFS)
            self._files[path] = bytearray()  # in front of the source until it is closed
            return path
        if self._is_directory(path, sources):
            raise FileError(errno.EISDIR)
        if path not in self._files:
            self._check_new(path, sources)
            self._files[path] = bytearray()
        elif truncate:
            self._files[path].clear()
        return path

    def write(self, path: str, offset: int, data: bytes) -> None:
        """Put bytes into a file that was opened; a gap before them is filled with zeros."""
        content = self._files.get(path)
        if content is None:  # removed since
            raise FileError(errno.EBADF)
        self._grow(content, offset + len(data))
        content[offset : offset + len(data)] = data

    def close(self, path: str) -> None:
        """A file open to write is complete; what was written in place of a source is handed to it."""
        source = self._sources().get(path)
        if source is None or source.write is None or path not in self._files:
            return
        if not source.write(bytes(self._files.pop(path))):
            raise FileError(errno.EINVAL)

    def truncate(self, path: str, size: int) -> None:
        path = normal(path)
        content = self._written(path)
        self._grow(content, size)
        del content[size:]

    def remove(self, path: str) -> None:
        """Remove a file."""
        path = normal(path)
        source = self._sources().get(path)
        if source is not None and source.remove is not None and path not in self._files:
            source.remove()
            return
        self._written(path)
        del self._files[path]

    def make_directory(self, path: str) -> None:
        path = normal(path)
        sources = self._sources()
        if path in self._files or path in sources or self._is_directory(path, sources):
            raise FileError(errno.EEXIST)
        self._check_new(path, sources)
        self._made.add(path)

    def remove_directory(self, path: str) -> None:
        path = normal(path)
        if path not in self._made:
            is_file = path in self._files
            is_directory = self._is_directory(path, self._sources())
            raise FileError(errno.ENOTDIR if is_file else errno.EROFS if is_directory else errno.ENOENT)
        if self.entries(path):
            raise FileError(errno.ENOTEMPTY)
        self._made.discard(path)

    def rename(self, old: str, new: str) -> None:
        """Give a written file, or a made directory with all that is in it, another name."""
        old, new = normal(old), normal(new)
        sources = self._sources()
        if new in sources or self._is_directory(new, sources):
            raise FileError(errno.EEXIST)
        if old in self._made:
            if f"{new}/".startswith(f"{old}/"):
                raise FileError(errno.EINVAL)
            self._check_place(new, sources)
            self._made = {_moved(name, old, new) for name in self._made}
            self._files = {_moved(name, old, new): content for name, content in self._files.items()}
            return
        content = self._written(old)
        self._check_place(new, sources)
        del self._files[old]
        self._files[new] = content

    def _written(self, path: str) -> bytearray:
        if path in self._files:
            return self._files[path]
        sources = self._sources()
        if path in sources:
            raise FileError(errno.EROFS)
        raise FileError(errno.EISDIR if self._is_directory(path, sources) else errno.ENOENT)

    def _check_new(self, path: str, sources: Mapping[str, Source]) -> None:
        self._check_place(path, sources)
        if len(self._files) + len(self._made) >= MOST_ENTRIES:
            raise FileError(errno.ENOSPC)

    def _check_place(self, path: str, sources: Mapping[str, Source]) -> None:
        parent = path.rpartition("/")[0]
        if not any(f"{path}/".startswith(f"{root}/") for root in self._writable):
            raise FileError(errno.EROFS)
        if parent in self._files or parent in sources:
            raise FileError(errno.ENOTDIR)
        if not self._is_directory(parent, sources):
            raise FileError(errno.ENOENT)

    def _grow(self, content: bytearray, size: int) -> None:
        more = size - len(content)
        if more > 0:
            if sum(map(len, self._files.values())) + more > self._most_bytes:
                raise FileError(errno.ENOSPC)
            content.extend(bytes(more))


def normal(path: str) -> str:
    """The path without a leading `/`, without `.` and empty parts, and with `..` resolved within the root."""
    parts: list[str] = []
    for part in path.split("/"):
        if part == "..":
            del parts[-1:]
        elif part not in ("", "."):
            parts.append(part)
    return "/".join(parts)


def _moved(name: str, old: str, new: str) -> str:
    return new + name[len(old) :] if f"{name}/".startswith(f"{old}/") else name
