"""WebAssembly: replacement of fused multiply-add, and linking of a module without imports.

With relaxed vector instructions processors fuse if they can, and answers equal those of other targets to the
bit; otherwise a product is rounded before the sum.
"""

import re
from pathlib import Path

from kernel_build.link import library_objects, zig
from kernel_build.targets import Target
from proximity.core import CORE

_DECLARED = re.compile(r"^declare .*@llvm\.fma\..*$", re.MULTILINE)
_CALLED = re.compile(r"@llvm\.fma\.(v8f64|v8f32|f64|f32)")
_EXPORTED = re.compile(r"^PROXIMITY_API[^;]*?\b(proximity_\w+)\(", re.MULTILINE)
_NOT_THERE = {
    "proximity_open",
    "proximity_use_instructions",
}  # no files, and one set of instructions
STACK = 1 << 20  # bytes


def without_fused(code: str, *, is_relaxed: bool) -> str:
    """Return LLVM code with fused multiply-add replaced by functions of the module."""
    code = _CALLED.sub(r"@fused_\1", _DECLARED.sub("", code))
    functions = [code]
    for real, bits, lanes in (("double", 64, 2), ("float", 32, 4)):
        if is_relaxed:
            vector = f"<{lanes} x {real}>"
            functions.append(f"declare {vector} {_relaxed(bits, lanes)}({vector}, {vector}, {vector})")
        functions += [_of_numbers(real, bits, lanes, is_relaxed), _of_vectors(real, bits, lanes, is_relaxed)]
    return "\n".join(functions)


def _relaxed(bits: int, lanes: int) -> str:
    return f"@llvm.wasm.relaxed.madd.v{lanes}f{bits}"


def _of_numbers(real: str, bits: int, lanes: int, is_relaxed: bool) -> str:
    head = f"define internal {real} @fused_f{bits}({real} %a, {real} %b, {real} %c) alwaysinline {{\n"
    if not is_relaxed:
        return head + f"  %p = fmul {real} %a, %b\n  %s = fadd {real} %p, %c\n  ret {real} %s\n}}"
    vector = f"<{lanes} x {real}>"
    lines = [f"  %v{k} = insertelement {vector} zeroinitializer, {real} %{k}, i64 0" for k in "abc"]
    words = ", ".join(f"{vector} %v{k}" for k in "abc")
    lines += [f"  %r = call {vector} {_relaxed(bits, lanes)}({words})"]
    lines += [f"  %s = extractelement {vector} %r, i64 0", f"  ret {real} %s\n}}"]
    return head + "\n".join(lines)


def _of_vectors(real: str, bits: int, lanes: int, is_relaxed: bool) -> str:
    """Return the function for eight lanes, split into registers of *lanes* each."""
    whole = f"<8 x {real}>"
    head = f"define internal {whole} @fused_v8f{bits}({whole} %a, {whole} %b, {whole} %c) alwaysinline {{\n"
    if not is_relaxed:
        return head + f"  %p = fmul {whole} %a, %b\n  %s = fadd {whole} %p, %c\n  ret {whole} %s\n}}"
    vector, lines = f"<{lanes} x {real}>", []
    parts = []
    for at in range(0, 8, lanes):
        mask = _mask(at, lanes)
        lines += [f"  %{k}{at} = shufflevector {whole} %{k}, {whole} poison, {mask}" for k in "abc"]
        words = ", ".join(f"{vector} %{k}{at}" for k in "abc")
        lines.append(f"  %r{at} = call {vector} {_relaxed(bits, lanes)}({words})")
        parts.append(f"%r{at}")
    while len(parts) > 1:
        kind, pairs = f"<{lanes} x {real}>", zip(parts[::2], parts[1::2], strict=True)
        lanes, parts = 2 * lanes, []
        for first, second in pairs:
            parts.append(f"%j{lanes}_{len(parts)}")
            lines.append(f"  {parts[-1]} = shufflevector {kind} {first}, {kind} {second}, {_mask(0, lanes)}")
    return head + "\n".join([*lines, f"  ret {whole} {parts[0]}\n}}"])


def _mask(first: int, count: int) -> str:
    return f"<{count} x i32> <{', '.join(f'i32 {k}' for k in range(first, first + count))}>"


def link_module(
    target: Target, objects: list[Path], wrappers: list[tuple[str, str, str]], digest: str, folder: Path
) -> Path:
    """Return the module of one set of instructions: the library in C, whose functions are exported."""
    headers = (CORE / "library" / name for name in ("proximity.h", "proximity_tracker.h"))
    names = {name for path in headers for name in _EXPORTED.findall(path.read_text(encoding="utf-8"))}
    exports = [f"-Wl,--export={name}" for name in sorted(names - _NOT_THERE | {"malloc", "free"})]
    files = map(str, [*library_objects(target, wrappers, digest, folder), *objects])
    module = folder / target.library
    options = ["-mexec-model=reactor", "-s", f"-Wl,-z,stack-size={STACK}", *exports]
    zig(target, folder, *options, "-o", str(module), *files)
    return module
