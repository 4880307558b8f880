"""The one place that compiles kernels, and keeps what is compiled.

`@kernel` stands for numba's `njit` without the GIL. What is compiled is kept in a folder of the user, under a name that
is the digest of everything the machine code is made of: the bytecode of the function and of all kernels that it calls,
the values of the constants that they use, wherever those come from, the options, the types, the processor and the
versions. So a kernel of changed sources is never found again, and editing one file compiles only what rests on it.

A kept kernel is loaded without numba's tables for typing, which take ten times as long as the kernel itself. What is
compiled may therefore use numbers, tuples, arrays and numpy's functions of them, but no strings, dictionaries or sets.

A wheel may bring kernels that were compiled when it was built, for every processor of a family (`BASELINE`): they serve
where the user's folder has none.
"""

from __future__ import annotations

import contextlib
import enum
import functools
import hashlib
import pickle
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeAlias, TypeVar, overload

from workbench.user_folder import end_turn, folder, forget, keep, take_turn

DIGEST = hashlib.sha256
SHIPPED = Path(__file__).parent / "shipped" / "kernels"  # in a wheel of `make wheel`
# Processor and features that shipped kernels are compiled for: what x86-64-v3 means, 2013 and later.
BASELINE = (
    "x86-64-v3",
    "+avx,+avx2,+bmi,+bmi2,+cmov,+cx16,+cx8,+f16c,+fma,+fxsr,+lzcnt,+mmx,+movbe,+popcnt,+sahf,+sse,+sse2,+sse3,+sse4.1,"
    "+sse4.2,+ssse3,+xsave",
)

F = TypeVar("F", bound=Callable[..., Any])


@overload
def kernel(function: F, /) -> F: ...
@overload
def kernel(**options: Any) -> Callable[[F], F]: ...
def kernel(function: Callable[..., Any] | None = None, /, **options: Any) -> Any:
    """Compile a function of numbers and arrays on its first call; keep the machine code for the next process.

    Args:
        function: what follows numba's rules; its types are those of its arguments, so callers give each argument one
            type (a float, not now 1 and now 0.5): every other combination is compiled again.
        options: of `numba.njit`: `error_model`, `fastmath`, `inline`.

    Example:
        >>> @kernel
        ... def larger(a: float, b: float) -> float:
        ...     return a if a > b else b
        >>> larger(1.0, 2.5)
        2.5
    """
    return Kernel(function, options) if function else lambda one: Kernel(one, options)


class Kernel:
    """A function that is compiled when it is first called; until then nothing of numba is loaded."""

    _building = threading.RLock()

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.function, self.options = function, options

    def __call__(self, *arguments: Any) -> Any:
        """Of numbers and arrays."""
        return self.compiled(*arguments)

    def __getattr__(self, name: str) -> Any:
        """What numba asks a function that another one calls, and the compiled function itself on first use."""
        if name != "compiled":
            return getattr(self.compiled, name)
        with Kernel._building:
            if "compiled" not in vars(self):
                vars(self)["compiled"] = _compiled(self)
            return vars(self)["compiled"]

    def __reduce__(self) -> str:
        """Other processes import it."""
        return str(self.function.__qualname__)


def _compiled(one: Kernel) -> Any:
    """numba's function, which keeps its machine code here."""
    from numba import njit

    _known_to_numba()
    compiled = njit(nogil=True, **one.options)(one.function)
    if hasattr(compiled, "_cache"):  # not where NUMBA_DISABLE_JIT is set
        compiled._cache = Kept(compiled)
        compiled.get_call_template = functools.partial(_called_with_types, compiled.get_call_template)
    return compiled


def _called_with_types(compile_for: Callable[..., Any], arguments: Any, keywords: Any) -> Any:
    """A kernel that another one calls with 0 or False takes an integer or a boolean; numba would compile for each."""
    from numba.core import types

    plain: Callable[[Any], Any] = types.unliteral
    return compile_for([plain(one) for one in arguments], {name: plain(one) for name, one in keywords.items()})


@functools.cache
def _known_to_numba() -> None:
    """A kernel that another one calls has the type of what is compiled of it."""
    from numba.core import types
    from numba.extending import typeof_impl

    @typeof_impl.register(Kernel)
    def _(value: Kernel, _: Any) -> Any:
        return types.Dispatcher(value.compiled)


class Kept:
    """The compiled forms of one kernel in the folder; what numba asks for before and after it compiles."""

    def __init__(self, compiled: Any) -> None:
        self.compiled = compiled
        self.name = f"{compiled.py_func.__module__}.{compiled.py_func.__qualname__}"

    @property
    def cache_path(self) -> str | None:
        """The folder, for numba's own statistics."""
        return str(folder().path) if folder().path else None

    @functools.cached_property
    def source(self) -> str:
        """The digest of what the kernel is made of."""
        return source_digest(self.compiled)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The kernel for these types, or None: nothing kept, or damaged."""
        found, name = self._load(signature, target), self._file(signature, target.codegen().magic_tuple())
        if found is None and take_turn(name) and (found := self._load(signature, target)) is not None:
            end_turn(name)  # another process has just made it
        if found is None:
            for tell in [*_watching]:
                tell()
        return found

    def _load(self, signature: Any, target: Any) -> Any:
        from llvmlite.binding import parse_bitcode
        from numba.core.compiler import CompileResult
        from numba.core.runtime.nrt import rtsys

        data = next(filter(None, map(_whole, self._places(signature, target.codegen().magic_tuple()))), None)
        if data is None:
            return None
        rtsys.initialize(target)  # memory of arrays; all that a finished kernel needs of the target
        (name, kind, (machine_code, bitcode)), function, *rest = pickle.loads(data)
        # Only a kernel that is compiled and calls this one needs the bitcode; reading it takes longer than all else.
        target.codegen()._engine._defined_symbols.add(function.llvm_cpython_wrapper_name)
        library = name, kind, (machine_code, _empty_bitcode())
        found = CompileResult._rebuild(target, library, function, *rest)  # type: ignore[no-untyped-call]
        found.library._get_module_for_linking = functools.cache(functools.partial(parse_bitcode, bitcode))
        return found

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep what was compiled; a folder that has become full or read-only costs the next process time, no more."""
        from numba.core.serialize import dumps

        where, name = folder().path, self._file(signature, result.codegen.magic_tuple())
        if where and not (result.lifted or result.library.has_dynamic_globals):
            # Without the environments of functions that it calls: loading those imports the modules that define them.
            data = dumps((*result._replace(type_annotation="")._reduce()[:-1], ()))  # type: ignore[no-untyped-call]
            keep(where / name, DIGEST(data).digest() + data)
            forget(f"{self.name}-*.kernel")
        end_turn(name)

    def _places(self, signature: Any, processor: tuple[str, str, str]) -> Iterator[Path]:
        """Where the kernel may be, the form for this very processor first."""
        where, (system, _, features) = folder().path, processor
        if where:
            yield where / self._file(signature, processor)
        if set(BASELINE[1].split(",")) <= set(features.split(",")):
            yield SHIPPED / self._file(signature, (system, *BASELINE))

    def _file(self, signature: Any, processor: tuple[str, str, str]) -> str:
        fields = [_fields(kind) for kind in getattr(signature, "args", signature)]
        key = DIGEST(f"{self.source} {signature} {fields} {processor}".encode()).hexdigest()[:32]
        return f"{self.name}-{key}.kernel"


def _fields(kind: Any) -> list[Any]:
    """Names of the fields of a named tuple, numba's name for which has their types alone, and of those within."""
    return [getattr(kind, "fields", ()), *(_fields(one) for one in getattr(kind, "types", ()))]


@functools.cache
def _empty_bitcode() -> bytes:
    """Of a module without functions."""
    from llvmlite.binding import parse_assembly

    return bytes(parse_assembly("").as_bitcode())


def _whole(path: Path) -> bytes | None:
    """What a file holds after its own digest; None if there is no such file, or it is damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, data = content[: DIGEST().digest_size], content[DIGEST().digest_size :]
    return data if data and DIGEST(data).digest() == digest else None


_watching: list[Callable[[], None]] = []


@contextlib.contextmanager
def compiling(tell: Callable[[], None]) -> Iterator[None]:
    """Call `tell` before each compilation; a kernel that was kept needs none."""
    _watching.append(tell)
    try:
        yield
    finally:
        _watching.remove(tell)


Found: TypeAlias = dict[str, str]  # by name and bytecode of each kernel: the rest of what it is made of


def source_digest(compiled: Any) -> str:
    """Of everything that decides the machine code, types and processor excepted, as hexadecimal digits."""
    import numba
    import numpy

    found: Found = {}
    _describe_kernel(compiled, found)
    versions = (sys.version_info[:2], numba.__version__, numpy.__version__.split(".")[:2])
    return DIGEST(repr((versions, sorted(found.items()))).encode()).hexdigest()


def _describe_kernel(compiled: Any, found: Found) -> None:
    """Add the kernel and all that it calls, by name."""
    function = compiled.py_func
    own = [(code.co_code, _literals(code), code.co_names, code.co_varnames) for code in _codes(function.__code__)]
    name = f"{function.__module__}.{function.__qualname__} {own}"
    if name in found:
        return
    found[name] = ""
    names = sorted({name for code in _codes(function.__code__) for name in code.co_names})
    used = {name: function.__globals__[name] for name in names if name in function.__globals__}
    closed = [cell.cell_contents for cell in function.__closure__ or ()]
    constants = {name: _describe(value, found) for name, value in used.items()}
    rest = [_describe(value, found) for value in (*closed, *(function.__defaults__ or ()))]
    found[name] = repr(
        (constants, rest, sorted((name, _even(value)) for name, value in compiled.targetoptions.items()))
    )


def _even(option: Any) -> str:
    """An option in words that are the same in every process; the order of a set's members is not."""
    return repr(sorted(option) if isinstance(option, set | frozenset) else option)


def _codes(code: CodeType) -> list[CodeType]:
    """A function's code and that of the functions inside it."""
    return [code, *(inner for one in code.co_consts if isinstance(one, CodeType) for inner in _codes(one))]


def _literals(code: CodeType) -> str:
    """The constants in the code itself; its docstring is not compiled."""
    docstring = code.co_consts[:1] if code.co_consts and isinstance(code.co_consts[0], str) else ()
    return repr([one for one in code.co_consts[len(docstring) :] if not isinstance(one, CodeType)])


def _describe(value: Any, found: Found) -> str:
    """A constant as numba freezes it into the code, by value; another kernel by name, with its own entry in `found`."""
    if hasattr(value, "py_func"):
        _describe_kernel(value, found)
        return f"kernel {value.py_func.__module__}.{value.py_func.__qualname__}"
    if isinstance(value, tuple | list):
        return f"{type(value).__qualname__}({', '.join(_describe(one, found) for one in value)})"
    if hasattr(value, "tobytes") and hasattr(value, "dtype"):
        return f"{value.dtype}{getattr(value, 'shape', '')}{value.tobytes().hex()}"
    if isinstance(value, ModuleType):
        return value.__name__
    if isinstance(value, type | FunctionType) or callable(value):
        fields = getattr(value, "_fields", "")  # of a named tuple that the kernel makes
        return f"{fields}{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', type(value).__qualname__)}"
    if isinstance(value, bool | int | float | complex | str | bytes | enum.Enum | None):
        return repr(value)
    return type(value).__qualname__  # what numba cannot freeze: an attribute of the same name is meant
