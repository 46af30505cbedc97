"""The decorator of compiled functions (kernels), and the cache of their machine code.

Numba's own cache renews a kernel when its file changes, not when a file changes whose kernels it calls. Here
the folder of a kernel is named by a hash of its file and of all files that this one imports. It lies in a
folder named by the versions of Python and numba and by the processor. So stale machine code is never found.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar, cast
from zlib import crc32

import numba
from numba.core import caching
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

__all__ = ["cache_folder", "code_folder", "compiling", "exclusive", "kernel"]

_F = TypeVar("_F", bound=Callable[..., Any])

_numba: Any = numba.config
_njit: Any = numba.njit
_unliteral: Any = numba.types.unliteral

_IMPORT = re.compile(r"^\s*from ([\w.]+) import", re.MULTILINE)


def kernel(function: _F) -> _F:
    """Compiles a function on first use and keeps its machine code in the cache."""
    compiled = _njit(error_model="numpy", no_cfunc_wrapper=True)(function)
    if _numba.DISABLE_JIT:
        return function
    name = f"{function.__module__}.{function.__qualname__}"
    if (folder := code_folder(Path(function.__code__.co_filename), function.__module__)) is not None:
        compiled._cache = _Cache(function, folder)
    compile_signature = compiled.compile

    def compile_once(signature: tuple[Any, ...]) -> Any:
        # Constants among the arguments would each get machine code of their own.
        types = tuple(_unliteral(each) for each in signature)
        with _clock_stopped(), global_compiler_lock, exclusive(name):
            return compile_signature(types)

    compiled.compile = compile_once
    return cast(_F, compiled)


def compiling() -> float:
    """How long this thread has waited for kernels to be compiled or loaded, s."""
    return cast(float, getattr(_waits, "total", 0.0))


@cache
def cache_folder() -> Path | None:
    """The folder with the user's compiled kernels for this processor. None: no folder can be used.

    It lies in NUMBA_CACHE_DIR if that is given, else in XDG_CACHE_HOME or ~/.cache. If that is read-only and
    has no compiled kernels, it lies in the folder of temporary files.
    """
    processor = cpu_target.target_context.codegen().magic_tuple()
    name = _hash(repr((sys.version, numba.__version__, _numba.OPT, processor)).encode())
    return next((place / name for place in _places() if _is_usable(place / name)), None)


def _places() -> Iterator[Path]:
    if _numba.CACHE_DIR:
        yield Path(_numba.CACHE_DIR, "wheelplan")
    else:
        with suppress(RuntimeError):  # there is no home
            given = Path(os.environ.get("XDG_CACHE_HOME", ""))
            yield (given if given.is_absolute() else Path.home() / ".cache") / "wheelplan" / "kernels"
    # Others can write to the folder of temporary files, and loading code from the cache runs it.
    private = Path(tempfile.gettempdir(), f"wheelplan-{os.getuid()}")
    with suppress(OSError):
        private.mkdir(mode=0o700, exist_ok=True)
        status = private.lstat()
        if status.st_uid == os.getuid() and not status.st_mode & 0o022:
            yield private / "kernels"


def _is_usable(folder: Path) -> bool:
    """Whether kernels can be kept in a folder, or a complete set of them lies in it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return any(folder.glob("ready-*"))
    return True


@cache
def code_folder(file: Path, module: str) -> Path | None:
    """Where the kernels of a module are kept. None: nowhere, or the module has no source file."""
    root, found, todo = file.parents[module.count(".")], set[Path](), [file]
    if (folder := cache_folder()) is None or not file.is_file():
        return None
    while todo:
        found.add(source := todo.pop())
        paths = (root.joinpath(*name.split(".")).with_suffix(".py") for name in _imports(source))
        todo += [path for path in paths if path not in found and path.is_file()]
    return folder / f"{module}-{_hash(*(_source(path) for path in sorted(found)))}"


@cache
def _source(file: Path) -> bytes:
    return file.read_bytes()


@cache
def _imports(file: Path) -> list[str]:
    return _IMPORT.findall(_source(file).decode())


def _hash(*parts: bytes) -> str:
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


class _Locator(caching._CacheLocator):
    """Where numba keeps the code of one function."""

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._py_file = function.__code__.co_filename
        self._line = function.__code__.co_firstlineno
        self._folder = folder

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return ""  # the folder's name has it

    def get_disambiguator(self) -> str:
        return str(self._line)


class _Cache(caching.FunctionCache):
    """Numba's cache of one function, in a given folder, which may be read-only."""

    def __init__(self, function: Any, folder: Path) -> None:
        locator = _Locator(function, folder)
        finder = SimpleNamespace(from_function=lambda *_: locator)
        self._impl_class: Any = type(
            "_Here", (caching.CompileResultCacheImpl,), {"_locator_classes": [finder]}
        )
        super().__init__(function)  # type: ignore[no-untyped-call]

    def save_overload(self, signature: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(signature, data)  # type: ignore[no-untyped-call]


_waits = threading.local()


@contextmanager
def _clock_stopped() -> Iterator[None]:
    """Counts the time of the outermost compilation of this thread."""
    _waits.depth = getattr(_waits, "depth", 0) + 1
    begin = time.perf_counter()
    try:
        yield
    finally:
        _waits.depth -= 1
        if not _waits.depth:
            _waits.total = compiling() + time.perf_counter() - begin


@contextmanager
def exclusive(name: str, wait: bool = True) -> Iterator[bool]:
    """Holds a name that no other process holds meanwhile; yields False if another does and we do not wait.

    Two processes that compile one kernel at once would mix up its files, and do the same work twice. Kernels
    do not call each other in a circle, so two processes never wait for each other.
    """
    lock, byte = _lock(), crc32(name.encode())
    try:
        if lock is not None:
            fcntl.lockf(lock, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB, 1, byte)
    except (BlockingIOError, PermissionError):
        yield False
        return
    except OSError:  # the file system knows no locks
        lock = None
    try:
        yield True
    finally:
        if lock is not None:
            fcntl.lockf(lock, fcntl.LOCK_UN, 1, byte)


@cache
def _lock() -> int | None:
    if (folder := cache_folder()) is not None:
        with suppress(OSError):
            return os.open(folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    return None
