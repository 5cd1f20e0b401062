"""Processors and systems that kernels are compiled for, and how LLVM makes an object for one of them."""

import re
from dataclasses import dataclass

from llvmlite import binding

DOOR_PREFIX = "proximity_door_"
"""How the symbols of doors begin."""

LEVEL = 3
"""Of optimisation."""
ALLOWED_UNDEFINED = {
    *("atan2", "ceil", "cos", "exp", "floor", "fmod", "log", "memcpy", "memmove", "memset", "pow", "sin", "sqrt"),
    *("NRT_MemInfo_alloc_aligned", "NRT_MemInfo_call_dtor", "numba_frexp", "numba_ldexp"),
}
"""What compiled kernels may ask of others: functions of C's libraries, and those in ``runtime.c``."""


@dataclass(frozen=True, slots=True)
class Instructions:
    """A set of instructions that objects are made for."""

    name: str  # as Python and the names of doors have it
    cpu: str  # as LLVM calls it
    features: str = ""


@dataclass(frozen=True, slots=True)
class Target:
    """A system, with the sets of instructions that its objects are made for."""

    name: str
    triple: str
    zig: str  # as the linker calls it
    wheel: str  # tag of wheels
    sets: tuple[Instructions, ...]


_X86 = (Instructions("v3", "x86-64-v3"), Instructions("v4", "x86-64-v4"))
_ARM = (Instructions("neon", "generic", "+neon"),)
TARGETS = {
    target.name: target
    for target in (
        Target("linux-x86_64", "x86_64-unknown-linux-gnu", "x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64", _X86),
        Target("linux-aarch64", "aarch64-unknown-linux-gnu", "aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64", _ARM),
        Target("macos-arm64", "arm64-apple-macosx11.0.0", "aarch64-macos.11.0", "macosx_11_0_arm64",
               (Instructions("neon", "apple-m1"),)),
        Target("windows-x86_64", "x86_64-pc-windows-gnu", "x86_64-windows-gnu", "win_amd64", _X86),
    )
}  # fmt: skip


def door_symbol(name: str, instructions: Instructions) -> str:
    """Return the symbol of an entry point's door in the objects of a set of instructions."""
    return f"{DOOR_PREFIX}{name}_{instructions.name}"


def emit_object(code: str, target: Target, instructions: Instructions) -> bytes:
    """Return an object file of all doors, named after the set of instructions.

    Parameters
    ----------
    code : str
        As `front_end.linked_doors` gives it.
    target : Target
        The system.
    instructions : Instructions
        One of its sets.
    """
    binding.initialize_all_targets()
    binding.initialize_all_asmprinters()
    module = binding.parse_assembly(code)
    machine = binding.Target.from_triple(target.triple).create_target_machine(
        cpu=instructions.cpu, features=instructions.features, opt=LEVEL, reloc="pic"
    )
    module.triple, module.data_layout = target.triple, str(machine.target_data)
    options = binding.create_pipeline_tuning_options(LEVEL)
    options.loop_vectorization = True
    builder = binding.create_pass_builder(machine, options)
    passes = builder.getModulePassManager()
    passes.run(module, builder)
    doors = [function for function in module.functions if function.name.startswith(DOOR_PREFIX)]
    for door in doors:
        door.name = door_symbol(door.name.removeprefix(DOOR_PREFIX), instructions)
    _refuse_undefined(module)
    return machine.emit_object(module)


def _refuse_undefined(module: binding.ModuleRef) -> None:
    """Refuse code that could ask for what is not there: of numba's errors above all."""
    unknown = {
        function.name
        for function in module.functions
        if function.is_declaration
        and not function.name.startswith("llvm.")
        and function.name not in ALLOWED_UNDEFINED
    }
    unknown |= {variable.name for variable in module.global_variables if variable.is_declaration}
    if unknown:
        raise SystemExit(f"kernels ask for {', '.join(sorted(unknown))}, which the engine does not have")
    address = re.search(r"inttoptr \(i64 \d{6,}", str(module))
    if address:
        raise SystemExit(f"kernels hold an address of the process that compiled them: {address[0]}")
