"""Loops compiled to machine code by LLVM, kept on disk as plain object files, and run.

The name of a file is a hash of the loop's text and of the processor; it begins with the hash of its content, so that an
incomplete one is made again. A folder that other users can write is not used, because its content is executed.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import hashlib
import os
import platform
import sys
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..backend import own_folder
from ..files import whole
from . import llvm as written
from .loop import Loop

LANES = 4  # width of a vector of lanes: with more, a rig's few lanes would leave it partly idle
POINTS = 16  # width of a vector of points
_LEVEL = 1  # of the optimisation of instructions: 0 is two to three times slower, 2 and 3 gain next to nothing
# of the passes before that: they take a third of the time to compile and find little, for equal things are one thing in
# a graph, and what no entry changes is computed before the first one
_PASSES = 0
_DIGEST = 32  # bytes


@cache
def available() -> bool:
    """Whether loops can run as machine code: llvmlite is installed, and ETCFIT_KERNELS is not "jax"."""
    if os.environ.get("ETCFIT_KERNELS", "") == "jax":
        return False
    return find_spec("llvmlite") is not None


# in a large process code and constants may be more than 2 GiB apart, too far for a relative address; LLVM then ends the
# process
def _addresses() -> tuple[str, str]:
    """LLVM's code model and relocation model."""
    far = _is_x86() and sys.platform == "linux"
    return ("large", "static") if far else ("default", "pic")


def _is_x86() -> bool:
    return platform.machine().lower() in ("x86_64", "amd64")


def _target() -> Any:
    """The processor of this machine; a new object each time, because an engine owns its target."""
    import llvmlite.binding as binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    cpu, features = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    code, addresses = _addresses()
    target = binding.Target.from_default_triple()
    return target.create_target_machine(cpu=cpu, features=features, opt=_LEVEL, codemodel=code, reloc=addresses)


@cache
def processor() -> str:
    """Everything that machine code depends on except the loop's text."""
    import llvmlite
    import llvmlite.binding as binding

    features = binding.get_host_cpu_features().flatten()
    return f"{llvmlite.__version__} {binding.get_host_cpu_name()} {features} {_LEVEL} {_PASSES} {_addresses()}"


@cache
def _knows_library() -> None:
    """Give LLVM the addresses of the C library's functions: not every Python exports them to loaded code."""
    import llvmlite.binding as binding

    library = ctypes.CDLL(ctypes.util.find_library("m") or ctypes.util.find_library("msvcrt") or None)
    for name in written.LIBRARY:
        with suppress(AttributeError):
            binding.add_symbol(name, ctypes.cast(getattr(library, name), ctypes.c_void_p).value)


def _object_code(text: str) -> tuple[str, bytes]:
    """Name and content of a module's object file, from disk if it was made before."""
    name = hashlib.sha256(f"{processor()}\n{text}".encode()).hexdigest()
    if (kept := _on_disk(name)) is not None:
        return name, kept
    code, folder = compiled(text), own_folder("kernels")
    if folder is not None:
        with suppress(OSError), whole(folder / name) as draft:
            draft.write_bytes(hashlib.sha256(code).digest() + code)
    return name, code


def _on_disk(name: str) -> bytes | None:
    folder = own_folder("kernels")
    return None if folder is None else _read(folder / name)


def compiled(text: str) -> bytes:
    import llvmlite.binding as binding

    module = binding.parse_assembly(text)
    module.verify()
    options = binding.create_pipeline_tuning_options(speed_level=_PASSES)
    options.slp_vectorization = options.loop_vectorization = False  # they are vectors already
    target = _target()
    builder = binding.create_pass_builder(target, options)
    builder.getModulePassManager().run(module, builder)
    del builder  # before the target that it refers to
    return target.emit_object(module)


def _read(path: Path) -> bytes | None:
    """Object code from a file; None if it is missing or incomplete."""
    try:
        packed = path.read_bytes()
    except OSError:
        return None
    with suppress(OSError):
        os.utime(path)  # mark it as used last: the least recently used file is deleted first
    digest, code = packed[:_DIGEST], packed[_DIGEST:]
    return code if hashlib.sha256(code).digest() == digest else None


class ObjectCode(NamedTuple):
    """An object file, and the data for its caller."""

    name: str  # name of the file
    width: int  # numbers in a vector
    # records, carried, sums, stored: numbers of these, see `Loop`
    records: int
    carried: int
    sums: int
    stored: int


class Kernel:
    """A loop as machine code.

    Args:
        code: content of the file.
        about: the file.
    """

    def __init__(self, code: bytes, about: ObjectCode) -> None:
        import llvmlite.binding as binding

        self.code, self.width = about, about.width
        self.carried, self.sums, self.stored = about.carried, about.sums, about.stored
        _knows_library()
        self._engine = binding.create_mcjit_compiler(binding.parse_assembly(""), _target())
        self._engine.add_object_file(binding.ObjectFileRef.from_data(code))
        self._engine.finalize_object()
        address = self._engine.get_function_address(written.NAME)
        kinds = [ctypes.c_int64] * 2 + [ctypes.c_void_p] * (about.records + 4)
        self._function = ctypes.CFUNCTYPE(None, *kinds)(address)

    @classmethod
    def made(cls, loop: Loop, width: int) -> Kernel:
        """The kernel of a loop.

        Args:
            loop: the loop.
            width: numbers in a vector.
        """
        name, code = _object_code(written.text(loop, width, _is_x86()))
        counts = map(len, (loop.records, loop.carried, loop.sums, loop.stored))
        return cls(code, ObjectCode(name, width, *counts))

    @classmethod
    def of_object_code(cls, about: ObjectCode) -> Kernel:
        """The kernel of an object file on disk.

        Raises:
            LookupError: the file is missing or incomplete.
        """
        code = _on_disk(about.name)
        if code is None:
            raise LookupError(about.name)
        return cls(code, about)

    def run(
        self, rows: int, stride: int, records: Sequence[int], fixed: np.ndarray, begun: np.ndarray, stored: np.ndarray
    ) -> np.ndarray:
        """The sums, shape (sums, width), of `run_to_end`; arguments as there."""
        return self.run_to_end(rows, stride, records, fixed, begun, stored)[0]

    def run_to_end(
        self, rows: int, stride: int, records: Sequence[int], fixed: np.ndarray, begun: np.ndarray, stored: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Run the loop; it releases Python's lock.

        Args:
            rows: number of entries.
            stride: numbers between two columns of a record; in a common record they are neighbours.
            records: address of the first number of each record.
            fixed: parameters, one number each, or `width` numbers each for vectors of points.
            begun: the carry into the first entry, shape (carried, width).
            stored: array for the stored numbers: blocks of shape (rows, nodes, width), see `Loop.blocks`, one after the
                other.
        Returns:
            The sums, shape (sums, width), and the carry out of the last entry, shape (carried, width).
        """
        sums, carried = np.zeros((self.sums, self.width)), np.array(begun)
        self._function(rows, stride, *records, *(each.ctypes.data for each in (fixed, carried, sums, stored)))
        return sums, carried
