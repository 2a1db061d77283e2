"""How kernels become machine code: only whole, within the kernel that Python calls.

Numba optimises every function that a kernel calls on its own, writes wrappers by which Python and C could call it, and
turns it into machine code; then it does all of that again with the copy that it links into the caller. Here a kernel
that another one calls is a *part*: it is typed and translated once for all its callers, and optimised within them. The
kernel that Python calls, an *entry*, is never linked into another, so that its cache holds machine code alone, which
loads quickly. A kernel may be both.

This reaches into numba. It is done with the versions that it was tried with; with any other, kernels are compiled as
numba does it, which gives the same results later.
"""

from __future__ import annotations

import contextlib
import functools
import gc
from collections.abc import Iterator
from typing import Any

import llvmlite.binding
from numba import version_info
from numba.core import codegen, compiler, compiler_lock, dispatcher, errors, event, sigutils, types, typing
from numba.core.registry import CPUDispatcher

__all__ = ["KNOWN", "Kernel", "rebuilt"]

KNOWN = (0, 61) <= version_info.short <= (0, 68)
"""Whether this numba is one whose inside was looked at and tried."""

_PART, _ENTRY = "mirror_scan part", "mirror_scan entry"  # kinds of libraries, as they are kept


class Kernel(CPUDispatcher):
    """A function compiled by numba, as an entry for Python and as a part for other kernels."""

    _cache: Any
    _can_compile: Any
    _compiler: Any

    @classmethod
    def of(cls, plain: Any) -> Kernel:
        """What :func:`numba.njit` made becomes one of these."""
        plain.__class__ = cls
        plain._compiler = plain._compiler_with(_EntryCompiler)
        return plain

    def compile(self, sig: Any) -> Any:
        """Called by numba for arguments of new types."""
        with compiler_lock.global_compiler_lock, _rare_collections():
            return super().compile(sig)

    def add_overload(self, cres: Any) -> None:
        """Called by numba with a new entry."""
        super().add_overload(cres)
        # what its parts need to raise errors; read from the cache, it has it already
        for environment in cres._find_referenced_environments():
            cres.codegen.set_env(environment.env_name, environment)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Called by numba where another kernel calls this one."""
        signature, args = self._compiler.fold_argument_types(args, kws)
        if not self._can_compile:
            return super().get_call_template(args, {})
        try:
            part = self._part(tuple(map(_general, args)))
        except errors.TypingError:  # it may need to know the value
            part = self._part(tuple(args))
        name = self.py_func.__name__
        template = typing.make_concrete_template(f"CallTemplate({name})", key=name, signatures=[part.signature])
        return template, signature, args, {}

    def get_overload(self, sig: Any) -> Any:
        """What numba knows the code by that a caller is linked with."""
        args, _ = sigutils.normalize_signature(sig)
        part = self._parts.get(tuple(args))
        return super().get_overload(sig) if part is None else part.entry_point

    @functools.cached_property
    def _parts(self) -> dict[tuple, Any]:
        """Compile results by types of the arguments."""
        return {}

    @functools.cached_property
    def _part_compiler(self) -> Any:
        return self._compiler_with(_PartCompiler)

    def _compiler_with(self, pipeline: type) -> Any:
        # The same for both: numba compiles np.empty and the like once more for those who are compiled in another way.
        options = self.targetoptions | {"no_cfunc_wrapper": True, "no_cpython_wrapper": True}
        make: Any = getattr(dispatcher, "_FunctionCompiler")  # noqa: B009  # numba's types do not list it
        return make(self.py_func, self.targetdescr, options, self.locals, pipeline)

    def _part(self, args: tuple) -> Any:
        with compiler_lock.global_compiler_lock, self._compiling_counter:
            found = self._parts.get(args)
            if found is not None:
                return found
            key = (_PART, *args)
            found = self._cache.load_overload(key, self.targetctx)
            if found is None:
                with event.trigger_event("numba:compile", data={"dispatcher": self, "args": args, "return_type": None}):
                    found = self._part_compiler.compile(args, None)
                self._parts[args] = found
                self._cache.save_overload(key, found)
            else:
                self.targetctx.insert_user_function(found.entry_point, found.fndesc, [found.library])
                self._parts[args] = found
            return found


@contextlib.contextmanager
def _rare_collections() -> Iterator[None]:
    """Python looks for garbage less often meanwhile, which took 7 % of the time: numba makes many small objects.

    To be entered with the compiler's lock, since what is changed is changed for all threads.
    """
    before = gc.get_threshold()
    gc.set_threshold(*_COLLECTED)
    try:
        yield
    finally:
        gc.set_threshold(*before)


_COLLECTED = (50_000, 20, 50)
"""New objects before a collection, and collections of one generation before the next is looked through, too."""


def _general(kind: Any) -> Any:
    """The type that one part for all callers takes: no constant, and a narrow integer as a wide one."""
    kind = types.unliteral(kind)
    return types.int64 if kind in _NARROW else kind


_NARROW = (types.int8, types.int16, types.int32)


# --- libraries -------------------------------------------------------------------------------------------------------


class _EntryLibrary(codegen.JITCodeLibrary):
    """Code that Python calls and no other kernel."""

    def serialize_using_object_code(self) -> tuple:
        self._ensure_finalized()
        module = self._final_module
        names = [value.name for values in (module.functions, module.global_variables) for value in values
                 if not value.is_declaration]  # fmt: skip
        return _ENTRY, self.name, self._get_compiled_object(), names

    @classmethod
    def restored(cls, target: Any, name: str, machine_code: bytes, names: list[str]) -> _EntryLibrary:
        self = cls(target, name)
        self.enable_object_caching()
        self._set_compiled_object(machine_code)
        self._finalize_final_module()
        target._engine._defined_symbols.update(names)
        return self


class _PartLibrary(codegen.JITCodeLibrary):
    """Code that is linked into other kernels and never called where it stands."""

    reassociates = False
    """Sums are in the order in which it is optimised: what has leave to change that is optimised before it is linked
    too, so that it adds in one order whoever calls it."""

    @property
    def codegen(self) -> Any:
        return _Nowhere

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple:
        return _PART, self.name, self._get_module_for_linking().as_bitcode()

    @classmethod
    def restored(cls, target: Any, name: str, bitcode: bytes) -> _PartLibrary:
        self = cls(target, name)
        self._final_module = self._shared_module = llvmlite.binding.parse_bitcode(bitcode)
        self._finalized = True
        return self

    def _optimize_final_module(self) -> None:
        if self.reassociates:
            super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


class _Nowhere:
    """Stands for the engine that would hold a part's machine code: its callers hold it."""

    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        pass


_LIBRARIES: dict[str, Any] = {_ENTRY: _EntryLibrary, _PART: _PartLibrary}


class _EntryCompiler(compiler.Compiler):
    def __init__(self, typingctx: Any, targetctx: Any, library: Any, *others: Any) -> None:
        library = _EntryLibrary(targetctx.codegen(), "entry")
        library.enable_object_caching()
        super().__init__(typingctx, targetctx, library, *others)

    def define_pipelines(self) -> Any:
        """What numba runs; the entry itself, and nothing that is compiled on its way, can be called by Python."""
        self.state.flags.no_cpython_wrapper = False
        return super().define_pipelines()


class _PartCompiler(compiler.Compiler):
    def __init__(self, typingctx: Any, targetctx: Any, library: Any, args: Any, result: Any, flags: Any, *others: Any):
        library = _PartLibrary(targetctx.codegen(), "part")
        library.reassociates = bool(flags.fastmath)
        super().__init__(typingctx, targetctx, library, args, result, flags, *others)


def rebuilt(target: Any, kept: tuple) -> Any:
    """A compile result of :class:`Kernel` from what its ``_reduce`` gave."""
    library, description, environment, signature, _, lifted, annotation, reload_init, environments = kept
    for prepare in reload_init:
        prepare()
    kind, *content = library
    library = _LIBRARIES[kind].restored(target.codegen(), *content)
    function = target.get_executable(library, description, environment)
    for other in environments:
        library.codegen.set_env(other.env_name, other)
    return compiler.compile_result(
        target_context=target,
        typing_context=target.typing_context,
        library=library,
        environment=environment,
        entry_point=function,
        fndesc=description,
        type_annotation=annotation,
        signature=signature,
        objectmode=False,
        lifted=lifted,
        reload_init=reload_init,
        referenced_envs=environments,
    )
