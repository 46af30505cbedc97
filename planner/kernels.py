"""The decorator of compiled functions, and their compilation before the first plan."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from shutil import rmtree
from typing import Any

import numba

from drives.kernels import cache_folder, code_folder, compiling, exclusive, kernel

__all__ = ["assume_ready", "compiling", "kernel", "make_ready"]

_SHARES = 2
"""Processes that compile at once, at most."""

_POLL = 0.5
"""Seconds between two reports of progress."""

_UNUSED = 30 * 86400.0
"""Machine code that no process has used for so long is deleted, s."""

_CHILD = "import sys; sys.path[:] = {}; from planner.warm_up import compile_share; compile_share({}, {})"

_KERNEL = re.compile(r"^@kernel$", re.MULTILINE)

_numba: Any = numba.config
_lock = threading.Lock()
_ready = False


def make_ready(progress: Callable[[int, int], object] = lambda done, total: None) -> None:
    """Compiles all kernels that the cache lacks, in processes of their own. Returns at once if it lacks none.

    progress: told how many of how many kernels are compiled, every half second. If the cache is
    read-only, nothing is compiled here; each process then compiles what it uses.
    """
    if _ready:
        return
    with _lock:
        folder = cache_folder()
        if not _ready and not _numba.DISABLE_JIT and folder is not None:
            kernels = _kernels()
            names = sorted(code.name for code in kernels)
            marker = folder / f"ready-{hashlib.sha256(repr(names).encode()).hexdigest()[:16]}"
            if not marker.exists() and os.access(folder, os.W_OK):
                _compile(marker, kernels, progress)
                _delete_unused(folder.parent)
                _delete_unused(folder)
            for used in (folder, marker, *kernels):
                with suppress(OSError):
                    os.utime(used)
        assume_ready()


def assume_ready() -> None:
    """From now on this process compiles or loads each kernel on first use."""
    global _ready
    _ready = True


def _kernels() -> dict[Path, int]:
    """The folders of machine code, and how many kernels belong there."""
    root, found = Path(__file__).parents[1], dict[Path, int]()
    for package in ("drives", "planner"):
        for file in sorted((root / package).glob("*.py")):
            count = len(_KERNEL.findall(file.read_text("utf-8")))
            code = code_folder(file, f"{package}.{file.stem}") if count else None
            if code is not None:
                found[code] = count
    return found


def _compile(marker: Path, kernels: dict[Path, int], progress: Callable[[int, int], object]) -> None:
    """Compiles, or waits for another process that does."""
    total = sum(kernels.values())

    def report() -> None:
        progress(min(sum(len(list(code.glob("*.nbi"))) for code in kernels), total - 1), total)
        time.sleep(_POLL)

    while not marker.exists():
        with exclusive("ready", wait=False) as held:
            if not held:
                report()
            elif not marker.exists():
                compilers = [_compiler(share) for share in range(_SHARES)]
                try:
                    while any(compiler.poll() is None for compiler in compilers):
                        report()
                finally:
                    for compiler in compilers:
                        compiler.kill()
                        compiler.communicate()
                if any(compiler.returncode for compiler in compilers):
                    warnings.warn("kernels could not be compiled beforehand", RuntimeWarning, stacklevel=2)
                    return
                marker.touch()
    progress(total, total)


def _compiler(share: int) -> subprocess.Popen[bytes]:
    """A process that compiles a share of the kernels. It ends with this process, by the end of its input."""
    command = [sys.executable, "-c", _CHILD.format(sys.path, share, _SHARES)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    if _numba.CACHE_DIR:
        environment["NUMBA_CACHE_DIR"] = _numba.CACHE_DIR
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, env=environment)


def _delete_unused(folder: Path) -> None:
    for entry in folder.iterdir():
        with suppress(OSError):
            if entry.name != "lock" and entry.stat().st_mtime < time.time() - _UNUSED:
                rmtree(entry) if entry.is_dir() else entry.unlink()
