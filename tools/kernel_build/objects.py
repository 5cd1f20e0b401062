"""Object file of the wrappers by LLVM, for one set of instructions."""

import re

from llvmlite import binding

from core_tables import ENTRIES
from kernel_build.targets import WRAPPER_PREFIX, Instructions, Target, wrapper_symbol
from kernel_build.wasm import without_fused

LEVEL = 3
"""Optimisation level."""
ALLOWED_UNDEFINED = {
    *(
        "atan2",
        "ceil",
        "cos",
        "exp",
        "floor",
        "fmod",
        "log",
        "memcpy",
        "memmove",
        "memset",
        "pow",
        "sin",
        "sqrt",
    ),
    *("NRT_MemInfo_alloc_aligned", "NRT_MemInfo_call_dtor", "numba_frexp", "numba_ldexp"),
}
"""External symbols allowed in compiled kernels: functions of C's libraries, and those in ``runtime.c``."""


def emit_object(code: str, target: Target, instructions: Instructions) -> bytes:
    """Return an object file of all wrappers, named after the set of instructions."""
    binding.initialize_all_targets()
    binding.initialize_all_asmprinters()
    if target.is_web:
        code = without_fused(code, is_relaxed="relaxed" in instructions.features)
    module = binding.parse_assembly(code)
    machine = binding.Target.from_triple(target.triple).create_target_machine(
        cpu=instructions.cpu,
        features=instructions.features,
        opt=LEVEL,
        reloc="pic",
        codemodel="small",  # as in any shared library; the default takes two instructions more a constant
    )
    module.triple, module.data_layout = target.triple, str(machine.target_data)
    options = binding.create_pipeline_tuning_options(LEVEL)
    options.loop_vectorization = True
    for function in module.functions if not target.extension else ():
        name = function.name.removeprefix(WRAPPER_PREFIX)
        if name != function.name and name not in ENTRIES:  # only Python calls it
            function.linkage = "internal"
    _remove_counting(module, machine)
    builder = binding.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    for function in module.functions:
        if function.name.startswith(WRAPPER_PREFIX) and function.linkage == binding.Linkage.external:
            function.name = wrapper_symbol(function.name.removeprefix(WRAPPER_PREFIX), instructions)
            function.visibility = "hidden"  # called only by the objects linked with them
    _refuse_undefined(module)
    return machine.emit_object(module)


def _remove_counting(module: binding.ModuleRef, machine: binding.TargetMachine) -> None:
    """Remove pairs that count the references of an array up and down: as calls they keep loops from vectors.

    As in numba, after passes that bring the two of a pair into one function.
    """
    builder = binding.create_pass_builder(machine, binding.create_pipeline_tuning_options(1))
    passes = builder.getModulePassManager()
    passes.add_refprune_pass()
    passes.run(module, builder)


def _refuse_undefined(module: binding.ModuleRef) -> None:
    """Raise for code with undefined symbols, above all numba's errors."""
    unknown = {
        function.name
        for function in module.functions
        if function.is_declaration
        and not function.name.startswith("llvm.")
        and function.name not in ALLOWED_UNDEFINED
    }
    unknown |= {variable.name for variable in module.global_variables if variable.is_declaration}
    if unknown:
        raise SystemExit(f"kernels need {', '.join(sorted(unknown))}, which the engine does not have")
    address = re.search(r"inttoptr \(i64 \d{6,}", str(module))
    if address:
        raise SystemExit(f"kernels hold an address of the process that compiled them: {address[0]}")
