"""Kernels to one LLVM module: numba's front end, with its optimiser and its linker switched off.

numba infers types and lowers each function to raw LLVM code. By default it would optimise every function
again for each of its callers; here all raw modules are linked once, and only the wrappers stay visible. A
*wrapper* is a function of one address: words of arguments, followed by the words of results. This uses
internals of numba, whose version is fixed; see `disable_code_generation`.
"""

import itertools
import re
from collections.abc import Iterator
from typing import Any

from llvmlite import binding, ir
from numba import types
from numba.core import cgutils, codegen, compiler, cpu, dispatcher, registry, targetconfig
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import intrinsic

from kernel_build.targets import WRAPPER_PREFIX
from proximity.kernels.compiled_stack import array_in_memory
from proximity.native.jit import numba_type
from proximity.native.signature import Array, Bundle, Signature

LINKED_AT_ONCE = 8
NO_ADDRESS = 123456789
"""Placeholder for every address of the compiling process."""
_NAMED_AFTER_ADDRESS = re.compile(r"numba\.dynamic\.globals\.[0-9a-f]+|(?<=__numba_array_expr_)0x[0-9a-f]+")
_NAMED_AFTER_ERROR = re.compile(
    r"(?<=\.const\.pickledata\.)[0-9a-f]{40}|(?<=\.const\.picklebuf\.)[0-9a-f]{40}"
)
_ADDRESS = re.compile(r"inttoptr \(i64 \d{9,}")
_ERROR = re.compile(r"^(@\.const\.pickledata\.\S+ = internal constant )\[\d+ x i8\] c\".*\"$", re.MULTILINE)
_ERROR_SIZE = re.compile(r"^(@\.const\.picklebuf\..*?) i32 \d+,", re.MULTILINE)


def disable_code_generation() -> None:
    """Stop numba after its front end, in this process, permanently."""
    library = codegen.CPUCodeLibrary
    numbers = itertools.count(1)

    def set_layout(self, module):
        module.data_layout = self._codegen._data_layout

    def finalize(self):
        self._finalized = True

    def executable(self, library, fndesc, env):
        return [].append  # a builtin, as numba requires, and a new one for each function: it is a key

    library._optimize_functions = set_layout
    library.finalize = finalize
    library._get_module_for_linking = lambda self: self._final_module
    codegen.JITCodeLibrary.get_pointer_to_function = lambda self, name: next(numbers)
    cpu.CPUContext.get_executable = executable
    customize = dispatcher._FunctionCompiler._customize_flags

    def without_wrappers(self, flags):
        flags = customize(self, flags)
        flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        return flags

    dispatcher._FunctionCompiler._customize_flags = without_wrappers

    def is_equal(self, other):
        return self._values == other._values or self.values() == other.values()

    targetconfig.TargetConfig.__eq__ = is_equal  # usually the first is true, in a tenth of the time


# --- words to values, inside compiled code ---------------------------------------------------------------


def _word(builder, words, at):
    return builder.load(builder.gep(words, [ir.Constant(words.type.pointee, at)]))


def _words_behind(builder, address):
    return builder.inttoptr(address, ir.IntType(64).as_pointer())


def _array(context, builder, value, words, at):
    """Return the array whose words are at a position."""
    word = ir.IntType(64)
    lengths = [
        _word(builder, words, at + 1 + axis) if length < 0 else ir.Constant(word, length)
        for axis, length in enumerate(value.lengths)
    ]
    data = builder.inttoptr(_word(builder, words, at), ir.IntType(8).as_pointer())
    return array_in_memory(context, builder, numba_type(value), data, lengths)


def _value_at(context, builder, value, words, at):
    if isinstance(value, Array):
        return _array(context, builder, value, words, at)
    if isinstance(value, Bundle):
        table = _words_behind(builder, _word(builder, words, at))
        arrays, place = [], 0
        for array in value.arrays:
            arrays.append(_array(context, builder, array, table, place))
            place += array.word_count
        return context.make_tuple(builder, numba_type(value), arrays)
    word = _word(builder, words, at)
    if value.kind == "float":
        return builder.bitcast(word, ir.DoubleType())
    if value.kind == "bool":
        return builder.icmp_signed("!=", word, ir.Constant(word.type, 0))
    return word


def _reader(value, at):
    """Return a function of the address of the words: the value at that position."""

    @intrinsic
    def read(typingctx, address):
        def generate(context, builder, sig, args):
            return _value_at(context, builder, value, _words_behind(builder, args[0]), at)

        return numba_type(value)(types.int64), generate

    return read


def _writer(value, at):
    """Return a function that writes a value as words at a position.

    An array is its address, its lengths, and the address of its owner, with one reference to it.
    """

    @intrinsic
    def write(typingctx, address, result):
        def generate(context, builder, sig, args):
            words = _words_behind(builder, args[0])

            def store(number, offset):
                builder.store(number, builder.gep(words, [ir.Constant(ir.IntType(64), at + offset)]))

            if isinstance(value, Array):
                array = context.make_array(sig.args[1])(context, builder, args[1])
                context.nrt.incref(builder, sig.args[1], args[1])
                store(builder.ptrtoint(array.data, ir.IntType(64)), 0)
                for axis, length in enumerate(cgutils.unpack_tuple(builder, array.shape)):
                    store(length, 1 + axis)
                store(builder.ptrtoint(array.meminfo, ir.IntType(64)), 1 + len(value.lengths))
            elif value.kind == "float":
                store(builder.bitcast(args[1], ir.IntType(64)), 0)
            else:
                number = args[1]
                if number.type.width < 64:
                    number = builder.zext(number, ir.IntType(64))
                store(number, 0)
            return context.get_dummy_value()

        return types.void(types.int64, numba_type(value)), generate

    return write


# --- wrappers -----------------------------------------------------------------------------------------------


def _wrapper(name: str, kernel: Any, signature: Signature) -> Any:
    """Return the wrapper of a kernel: a function of one address."""
    names: dict[str, Any] = {"kernel": kernel}
    lines, at = [], 0
    for k, value in enumerate(signature.arguments):
        names[f"read_{k}"] = _reader(value, at)
        lines.append(f"    a{k} = read_{k}(words)")
        at += value.word_count
    call = f"kernel({', '.join(f'a{k}' for k in range(len(signature.arguments)))})"
    results = ", ".join(f"r{k}" for k in range(len(signature.results)))
    lines.append(f"    {results + ' = ' if results else ''}{call}")
    for k, value in enumerate(signature.results):
        names[f"write_{k}"] = _writer(value, at)
        lines.append(f"    write_{k}(words, r{k})")
        at += value.word_count + isinstance(value, Array)
    exec(f"def {name}(words):\n" + "\n".join(lines), names)
    return names[name]


def _compiled(function: Any) -> Any:
    target = registry.cpu_target
    flags = compiler.Flags()
    options = {"nopython": True, "nogil": True, "error_model": "numpy"}
    target.options.parse_as_flags(flags, options)
    flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
    return compiler.compile_extra(
        target.typing_context, target.target_context, function, (types.int64,), types.none, flags, {}
    )


def _modules(library: Any, seen: set[int]) -> Iterator[Any]:
    """Yield raw modules of a library and of all libraries linked with it, each once."""
    if id(library) in seen:
        return
    seen.add(id(library))
    for other in library._linking_libraries:
        yield from _modules(other, seen)
    yield library._final_module


def _linked(parts: list[Any]) -> Any:
    """Link all modules in a tree: the time of linking grows with the size of the target."""
    while len(parts) > 1:
        for at in range(0, len(parts), LINKED_AT_ONCE):
            for other in parts[at + 1 : at + LINKED_AT_ONCE]:
                parts[at].link_in(other)
        parts = parts[::LINKED_AT_ONCE]
    return parts[0]


def linked_wrappers(entries: dict[str, tuple[Any, Signature]]) -> str:
    """Return the LLVM code of all wrappers, not optimised, as text."""
    with global_compiler_lock:
        seen: set[int] = set()
        parts = []
        symbols = {}
        for name, (kernel, signature) in entries.items():
            result = _compiled(_wrapper(name, kernel, signature))
            symbols[name] = result.fndesc.mangled_name
            for module in _modules(result.library, seen):
                part = module.clone()
                for function in part.functions:
                    if not function.is_declaration and function.name != symbols[name]:
                        function.linkage = "weak_odr"
                parts.append(part)
    whole = _linked(parts)
    wrappers = {symbol: name for name, symbol in symbols.items()}
    for function in whole.functions:
        if function.name in wrappers:
            function.name = WRAPPER_PREFIX + wrappers[function.name]
            function.linkage = "external"
        elif not function.is_declaration:
            function.linkage = "internal"
    for variable in whole.global_variables:
        if variable.linkage is not binding.Linkage.private and not variable.is_declaration:
            variable.linkage = "internal"
    whole.verify()
    return _without_traces(str(whole))


def _without_traces(code: str) -> str:
    """Remove traces of this process and this machine from the code: builds must be reproducible.

    Those are numba's names with addresses, and the errors it would raise, which name its files. None of it is
    used: `objects.emit_object` refuses optimised code that contains an address or raises.
    """
    names: dict[str, str] = {}
    for pattern in (_NAMED_AFTER_ADDRESS, _NAMED_AFTER_ERROR):
        code = pattern.sub(lambda name: names.setdefault(name[0], f"numba.{len(names)}"), code)
    for pattern, instead in (
        (_ADDRESS, f"inttoptr (i64 {NO_ADDRESS}"),
        (_ERROR, r"\1[1 x i8] zeroinitializer"),
        (_ERROR_SIZE, r"\1 i32 0,"),
    ):
        code = pattern.sub(instead, code)
    return code
