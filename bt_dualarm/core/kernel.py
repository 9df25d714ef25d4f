"""Compiled kernels: the decorator for numba functions, and the cache of their machine code.

Modules with kernels are named ``…_kernels.py`` and are imported where a kernel is called, because
importing numba takes 0.3 s; the same holds for this module. Kernels are compiled for the baseline
processor of the architecture, without fused multiply-add or reordering, so results do not depend on
the processor. The machine code is stored in the user's cache directory, under a digest of the
kernel's module and of all kernel modules that it imports: it serves every installation of the same
sources, writable or not, and a changed module also invalidates the kernels that call it, but no
others. Constants and field orders that are compiled in are therefore defined in files with
``kernel`` in their names.

Numba optimizes and translates a function for every one of its callers, and once more for itself,
with two functions around it by which Python and C could call it. For what kernels call that takes
half of the time to compile them, and nobody uses it: here a function that is compiled for a kernel
is handed to it as it is.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib
import json
import logging
import os
import pickle
import shutil
import subprocess
import sys
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache, cached_property
from io import BytesIO
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar, cast
from uuid import uuid4

import numba
from llvmlite import binding
from numba.core import codegen, compiler, environment, registry, typed_passes, types
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    NullCache,
    UserWideCacheLocator,
)
from numba.core.compiler_machinery import register_pass
from numba.core.environment import _rebuild_env
from numba.core.runtime import nrt
from numba.core.serialize import dumps

from bt_dualarm.core.share import code_folder, digest_of_code, digest_of_kernels

_LOG: Final = logging.getLogger(__name__)
_NO_CACHE: Final = "cannot cache function"
_SUM_BYTES = 4

Given = ParamSpec("Given")
Returned = TypeVar("Returned")


def kernel(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Compile a function on its first call, or load its machine code from the cache.

    Without a writable cache it is compiled in every process.
    """
    if _config().DISABLE_JIT:
        return function
    return cast("Callable[Given, Returned]", Kernel(function))


class InnerLibrary(codegen.JITCodeLibrary):
    """Code that other kernels include: it is simplified, and neither translated nor loaded."""

    @property
    def codegen(self) -> Any:  # numba has no types
        """The generator of code, which need not link constants of code that is not loaded."""
        return _Unlinked(self._codegen)

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002 - numba calls it so
        """Returns no address: nobody calls it."""
        self._ensure_finalized()  # type: ignore[no-untyped-call]
        return 0

    def _optimize_final_module(self) -> None:
        generator: Any = self._codegen  # numba has no types
        passes, builder = generator._module_pass_manager(
            loop_vectorize=False, slp_vectorize=False, opt=generator._opt_level, cost="cheap"
        )
        passes.run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
        self._finalized = True


class _Unlinked:
    """A generator of code that does not set the address of a function's environment."""

    def __init__(self, generator: Any) -> None:  # numba has no types
        self._generator = generator

    def __getattr__(self, name: str) -> Any:  # numba has no types
        return getattr(self._generator, name)

    def set_env(self, name: str, environment: object) -> None:
        """Does nothing."""


@register_pass(mutates_CFG=True, analysis_only=False)  # type: ignore[no-untyped-call]
class InnerLowering(typed_passes.NativeLowering):
    """Lowers to a library for other kernels."""

    _name = "inner_lowering"

    def run_pass(self, state: Any) -> bool:  # numba has no types
        """Lower as numba does, into a library of ours."""
        generator = state.targetctx.codegen()
        library: Any = InnerLibrary
        state.library = library(generator, state.func_id.func_qualname)
        return bool(super().run_pass(state))  # type: ignore[no-untyped-call]


class InnerCompiler(compiler.CompilerBase):
    """Compiles functions that only other kernels call."""

    def define_pipelines(self) -> list[Any]:  # numba has no types
        """Returns numba's passes with our lowering."""
        builder: Any = compiler.DefaultPassBuilder  # numba has no types
        passes = builder.define_nopython_pipeline(self.state)
        passes.passes = [
            (InnerLowering if step is typed_passes.NativeLowering else step, name)
            for step, name in passes.passes
        ]
        passes._finalized = False
        passes.finalize()
        return [passes]


_OPTIONS: Final = {"nopython": True, "boundscheck": None, "no_cfunc_wrapper": True}


class Kernel(registry.CPUDispatcher):
    """A kernel as Python calls it; other kernels get its code to include.

    What only some kernels need is made on demand: most are called by other kernels alone, whose
    code is in the cache.

    Args:
        function: The function in Python.
    """

    def __init__(self, function: Callable[..., object]) -> None:
        self._kept: Any = None  # numba has no types
        super().__init__(function, targetoptions=_OPTIONS)

    @property
    def _cache(self) -> Any:  # numba has no types
        """Where numba looks for machine code before it compiles, and stores it afterwards."""
        if self._kept is None:
            self._kept = _cache_of(self.py_func)
        return self._kept

    @_cache.setter
    def _cache(self, cache: object) -> None:
        """Ignore the empty cache with which numba begins."""

    @cached_property
    def _included(self) -> Any:  # numba has no types
        """The function as other kernels include it."""
        return registry.CPUDispatcher(
            self.py_func,
            targetoptions=_OPTIONS | {"no_cpython_wrapper": True},
            pipeline_class=InnerCompiler,
        )

    @property
    def _numba_type_(self) -> Any:  # numba has no types
        return types.Dispatcher(self._included)


@cache
def _config() -> Any:  # a module whose attributes are created at run time
    """Settings of numba, which compiles for our processor from now on."""
    os.environ.setdefault("NUMBA_CPU_NAME", _BASELINE)
    config: Any = numba.config
    config.reload_config()  # another package may have imported it before
    return config


_BASELINE: Final = "generic"

Groups = Mapping[str, Sequence[str]]
"""Functions that call all kernels of a group with arguments of the types used later, by the group's
name: ``package.module:function``."""


def compile_once(groups: Groups) -> None:
    """Compile groups of kernels before they are needed; logs a message if that takes time.

    The groups are compiled by one process per core. Processes that start at once share the work,
    and each of them waits for the others. Does nothing if numba's JIT is disabled.
    """
    if _config().DISABLE_JIT:
        return
    target = _target()
    left = {name: group for name, group in groups.items() if not _mark(name, target).exists()}
    if not left:
        _note_use(_mark(name, target) for name in groups)
        return
    is_kept = _is_kept()
    often = "once on this machine"
    if not is_kept:
        often = f"in every run: {code_folder()} cannot be written"
    _LOG.info("Compiling kernels, %s: up to a minute", often)
    helpers = _helpers(left) if is_kept and _is_baseline() else []
    try:
        compile_groups(left)
    finally:
        for helper in helpers:
            helper.wait()
    _remove_old_code()


def compile_groups(groups: Groups) -> None:
    """Compile groups of kernels, except those that other processes compile, and wait for these."""
    target = _target()
    for waits in (False, True):
        for name, group in groups.items():
            mark = _mark(name, target)
            if mark.exists():
                continue
            with _alone(name, waits=waits) as is_mine:
                if not is_mine or mark.exists():
                    continue
                for path in group:
                    module, _, function = path.partition(":")
                    getattr(importlib.import_module(module), function)()
                with suppress(OSError):
                    mark.touch()


_PROGRAM: Final = (
    "import json, sys; from bt_dualarm.core.kernel import compile_groups;"
    "compile_groups(json.loads(sys.argv[1]))"
)


def _helpers(groups: Groups) -> list[subprocess.Popen[bytes]]:
    """Start a process for every other core and group, which begin with the last groups.

    Each ends by itself; if one cannot be started or dies, its groups are left to this process.
    """
    started = []
    names = list(groups)[::-1]
    paths = os.pathsep.join(filter(None, sys.path))
    for _ in range(min(_cores(), len(groups)) - 1):
        order = json.dumps({name: groups[name] for name in names})
        names = names[1:] + names[:1]
        with suppress(OSError):
            started.append(
                subprocess.Popen(  # noqa: S603 - this interpreter, a fixed program
                    [sys.executable, "-P", "-c", _PROGRAM, order],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    env=os.environ | {"PYTHONPATH": paths},
                )
            )
    return started


def _cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _mark(name: str, target: str) -> Path:
    """File that exists once a group of kernels is compiled, for these sources and this target."""
    whole = f"{digest_of_kernels()}-{sys.implementation.cache_tag}-{target}"
    return code_folder() / f"compiled-{name}-{whole}"


def _target() -> str:
    """Digest of numba's version and target processor; the latter is fixed by its first user."""
    return f"{numba.__version__}-{hashlib.sha256(str(_processor()).encode()).hexdigest()[:8]}"


def _is_baseline() -> bool:
    """Whether other processes compile for the same processor as this one."""
    return _BASELINE in _processor()


def _processor() -> tuple[str, ...]:
    processor: tuple[str, ...] = registry.cpu_target.target_context.codegen().magic_tuple()
    return processor


def _is_kept() -> bool:
    """Whether the next process will find the code that is compiled now."""
    with suppress(OSError):
        code_folder().mkdir(parents=True, exist_ok=True)
    return os.access(code_folder(), os.W_OK)


_UNUSED_S: Final = 7 * 86_400.0
"""Time after which code of other sources is removed, s."""


def _remove_old_code() -> None:
    """Remove code that was compiled some time ago for sources other than the current ones.

    Several versions may be in use side by side, each with its own code.
    """
    current = {digest_of_code(path) for path in _kernel_modules()} | {digest_of_kernels()}
    with suppress(OSError):
        for path in code_folder().iterdir():
            is_current = any(digest in path.name for digest in current) or path.suffix == ".lock"
            if is_current or time.time() - path.stat().st_mtime < _UNUSED_S:
                continue
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


def _note_use(marks: Iterable[Path]) -> None:
    """Update the date of the cached code of the current sources, at most once per day."""
    now = time.time()
    with suppress(OSError):
        late = [mark for mark in marks if now - mark.stat().st_mtime > _UNUSED_S / 7]
        for path in (*late, *(_folder_of(module) for module in _kernel_modules() if late)):
            os.utime(path)


def _kernel_modules() -> list[Path]:
    return sorted(Path(__file__).parents[1].rglob("*_kernels.py"))


def _folder_of(module: Path) -> Path:
    """Folder of the machine code of a module of kernels."""
    return code_folder() / f"{module.stem}-{digest_of_code(module)}"


@contextmanager
def _alone(name: str, *, waits: bool) -> Iterator[bool]:
    """Hold the lock of a group in the block, if it is free or can be waited for.

    Yields:
        Whether this process may compile the group: it holds the lock, or none can be written.
    """
    try:
        file = (code_folder() / f"{name}.lock").open("w")
    except OSError:
        yield True
        return
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX if waits else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
            return
        yield True


class KernelFiles:
    """Cache files of one kernel, one per signature.

    Each begins with a checksum: numba would raise, or LLVM would end the process, on a file that
    was truncated by a full disk or a power failure. Without write access nothing is stored.

    Args:
        place: Folder of the files.
        name: Prefix of their names.
    """

    def __init__(self, place: Path, name: str) -> None:
        self._place = place
        self._name = name

    def load(self, key: object) -> object:
        """Returns the data stored under a key; None if there are none or they are damaged."""
        try:
            whole = self._path(key).read_bytes()
        except OSError:
            return None
        content = whole[_SUM_BYTES:]
        if whole[:_SUM_BYTES] != _check_sum(content):
            return None
        kept_under, data = _Reader(BytesIO(content)).load()
        return data if kept_under == key else None

    def save(self, key: object, data: object) -> None:
        """Store machine code atomically."""
        content: bytes = dumps((key, data))  # type: ignore[no-untyped-call]  # numba has no types
        path = self._path(key)
        part = path.with_name(f"{path.name}.{uuid4().hex}")
        with suppress(OSError):
            try:
                part.write_bytes(_check_sum(content) + content)
                part.replace(path)
            finally:
                part.unlink(missing_ok=True)

    def flush(self) -> None:
        """Delete the code of all signatures."""
        with suppress(OSError):
            for path in self._place.glob(f"{self._name}.*"):
                path.unlink(missing_ok=True)

    def _path(self, key: object) -> Path:
        """Path of the file of a key: a signature and the target processor."""
        digest = hashlib.sha256(f"{numba.__version__} {key}".encode()).hexdigest()
        return self._place / f"{self._name}.{digest[:16]}.nbc"


class _Reader(pickle.Unpickler):  # of the user's own cache
    """Reads machine code without the modules of numba that were needed to compile it.

    Environments, which hold the constants of a function, name the module of the function, and numba
    imports it for code in Python; compiled code uses the constants only.
    """

    def find_class(self, module: str, name: str) -> Any:  # any class
        """Returns what a name stands for."""
        if name == _rebuild_env.__name__ and module == _rebuild_env.__module__:
            return _environment
        return super().find_class(module, name)


def _environment(module: str, constants: list[object], name: str) -> object:
    """The environment of a name, which functions share."""
    found: object = environment.lookup_environment(name)  # type: ignore[no-untyped-call]
    if found is None:
        imported = sys.modules.get(module)
        made: Any = environment.Environment(
            {"__name__": module} if imported is None else vars(imported)
        )
        made.consts[:] = constants
        made.env_name = name
        environment.Environment._memo[name] = made
        found = made
    return found


def _check_sum(content: bytes) -> bytes:
    return zlib.crc32(content).to_bytes(_SUM_BYTES, "big")


class KernelPlace(UserWideCacheLocator):
    """Cache locator with one folder for all installations of the same sources.

    Numba's own locators add the file's location, so each installation would compile again, and they
    do not use a folder that has the code but is not writable.
    """

    def get_cache_path(self) -> str:
        """Returns the folder of these sources."""
        return str(self._folder())

    def get_source_stamp(self) -> str:
        """Returns a stamp of all sources that are compiled in, rather than of this file alone."""
        return self._folder().name

    def ensure_cache_path(self) -> None:
        """Create the folder; an existing one is at least readable.

        Raises:
            OSError: It does not exist and cannot be created.
        """
        self._folder().mkdir(parents=True, exist_ok=True)

    def _folder(self) -> Path:
        return _folder_of(Path(self._py_file))


class KernelCode(CompileResultCacheImpl):
    """Machine code of a kernel as it is stored: without what numba needs to include it in others.

    Kernels include each other from their sources. To read the code in LLVM's own form would take
    most of the time to load a kernel, and memory for as long as the process lives.
    """

    def reduce(self, data: Any) -> object:  # numba has no types
        """Returns what is stored of a compiled function."""
        (name, kind, (machine_code, _)), description, *rest = super().reduce(data)  # type: ignore[no-untyped-call]
        return (name, kind, (machine_code, symbol_alone(description))), description, *rest


@cache
def _add_symbols() -> None:
    """Let loaded code find numba's functions in C."""
    runtime: Any = nrt  # numba has no types
    for name, address in runtime._nrt.c_helpers.items():
        binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


def symbol_alone(description: Any) -> bytes:  # numba has no types
    """A module in LLVM's form that defines only the name by which Python calls a function."""
    name = description.llvm_cpython_wrapper_name
    code: bytes = binding.parse_assembly(f'define void @"{name}"() {{ ret void }}').as_bitcode()
    return code


class KernelCache(FunctionCache):
    """Machine code of one kernel, per signature.

    Numba's cache also compares the byte code, which differs without docstrings (``-OO``), so
    everything would be compiled twice. Here the folder identifies the sources.
    """

    _impl_class = KernelCode

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]  # numba has no types
        files: Any = KernelFiles(Path(self.cache_path), self._impl.filename_base)
        self._cache_file = files  # numba itself uses two per signature

    def load_overload(
        self,
        sig: object,
        target_context: Any,  # numba has no types
    ) -> Any:  # numba has no types
        """Machine code of a signature; None if there is none.

        Numba first imports all that it could need to compile, and compiles functions for its memory
        management, which every kernel contains already. That takes most of the time to load the
        kernels of a run, and 50 MB: code that is loaded needs symbols only.
        """
        _add_symbols()
        return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]

    def _index_key(
        self,
        sig: object,
        codegen: Any,  # numba has no types
    ) -> tuple[object, ...]:
        return sig, codegen.magic_tuple()


def _cache_of(function: Callable[..., object]) -> Any:  # numba has no types
    """Cache of a kernel; an empty one if its folder does not exist and cannot be created."""
    config = _config()
    before = config.CACHE_LOCATOR_CLASSES  # other packages keep their cache location
    config.CACHE_LOCATOR_CLASSES = "bt_dualarm.core.kernel.KernelPlace"
    try:
        return KernelCache(function)
    except RuntimeError as error:
        if _NO_CACHE not in str(error):
            raise
        return NullCache()
    finally:
        config.CACHE_LOCATOR_CLASSES = before
