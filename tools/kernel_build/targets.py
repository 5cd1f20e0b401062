"""Target processors and systems of compiled kernels. Needs only Python, as it is imported first."""

import platform
from dataclasses import dataclass
from pathlib import Path

WRAPPER_PREFIX = "proximity_entry_"
"""Prefix of the wrappers' symbols."""


@dataclass(frozen=True, slots=True)
class Instructions:
    """Target set of instructions of objects."""

    name: str  # as in Python and the names of wrappers
    cpu: str  # as LLVM calls it
    features: str = ""
    needs: tuple[str, ...] = ()  # features of a processor, in LLVM's names


@dataclass(frozen=True, slots=True)
class Target:
    """A system, with the sets of instructions of its objects."""

    name: str
    triple: str
    zig: str  # in the linker's names
    wheel: str  # tag of wheels
    sets: tuple[Instructions, ...]
    extension: str = "_kernels.abi3.so"  # name of the extension module's file; "": without Python
    library: str = "libproximity.so"  # name of the library in C
    import_library: str = ""  # by which linkers find that, where a system needs one
    static_library: str = ""  # the same for programs that contain it

    @property
    def is_web(self) -> bool:
        """True if modules for browsers replace the library."""
        return self.name == "wasm32"


_X86 = (
    Instructions("v3", "x86-64-v3", needs=("avx2", "bmi2", "fma")),
    Instructions("v4", "x86-64-v4", needs=("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")),
)
_WASM = "+simd128,+bulk-memory,+nontrapping-fptoint,+sign-ext"
_WEB = Instructions("plain", "generic", _WASM), Instructions("relaxed", "generic", f"{_WASM},+relaxed-simd")
STATIC = "libproximity.a"
_ARM, _APPLE = (Instructions("neon", "generic", "+neon"),), (Instructions("neon", "apple-m1"),)
TARGETS = {
    target.name: target
    for target in (
        Target(
            "linux-x86_64",
            "x86_64-unknown-linux-gnu",
            "x86_64-linux-gnu.2.17",
            "manylinux_2_17_x86_64",
            _X86,
            static_library=STATIC,
        ),
        Target(
            "linux-aarch64",
            "aarch64-unknown-linux-gnu",
            "aarch64-linux-gnu.2.17",
            "manylinux_2_17_aarch64",
            _ARM,
            static_library=STATIC,
        ),
        Target(
            "macos-arm64",
            "arm64-apple-macosx11.0.0",
            "aarch64-macos.11.0",
            "macosx_11_0_arm64",
            _APPLE,
            library="libproximity.dylib",
            static_library=STATIC,
        ),
        Target(
            "windows-x86_64",
            "x86_64-pc-windows-gnu",
            "x86_64-windows-gnu",
            "win_amd64",
            _X86,
            "_kernels.pyd",
            "proximity.dll",
            "proximity.lib",
        ),
        # Compiled with headers of another C library, and linked by hand: see `link.link_library`.
        Target(
            "android-aarch64", "aarch64-unknown-linux-android", "aarch64-linux-musl", "", _ARM, extension=""
        ),
        Target("wasm32", "wasm32-unknown-wasi", "wasm32-wasi", "", _WEB, "", "proximity.wasm"),
    )
}


def host_target() -> Target:
    """Return this machine's target; raise `SystemExit` if it has none."""
    name = _host_name()
    if name not in TARGETS:
        raise SystemExit(
            f"kernels cannot be compiled ahead of time for {name}, only for {', '.join(TARGETS)}"
        )
    return TARGETS[name]


def target_folder(target: Target, folder: Path) -> Path:
    """Return the folder of a target's files: for this machine the folder itself."""
    return folder if target.name == _host_name() else folder / target.name


def module_path(instructions: Instructions, folder: Path) -> Path:
    """Return the path of the module for browsers with a set of instructions."""
    return folder / f"proximity.{instructions.name}.wasm"


def made_files(target: Target, folder: Path, *, every_set: bool) -> list[Path]:
    """Return the files that are built for a target: extension module and library, or modules for browsers."""
    if target.is_web:
        return [module_path(each, folder) for each in (target.sets if every_set else target.sets[-1:])]
    names = target.extension, target.library, target.static_library, target.import_library
    return [target_folder(target, folder) / name for name in names if name]


def wrapper_symbol(name: str, instructions: Instructions) -> str:
    """Return the symbol of an entry point's wrapper in the objects of a set of instructions."""
    return f"{WRAPPER_PREFIX}{name}_{instructions.name}"


def _host_name() -> str:
    system = {"Linux": "linux", "Darwin": "macos", "Windows": "windows"}.get(platform.system(), "other")
    return f"{system}-{'x86_64' if platform.machine() == 'AMD64' else platform.machine()}"
