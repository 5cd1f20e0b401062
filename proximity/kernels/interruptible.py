"""Compiling beside the main thread, which waits: so Ctrl-C is answered at once.

A signal's handler runs between two steps of the main thread, and a step within LLVM may take ten seconds.
"""

import threading
from collections.abc import Callable
from typing import Any

from numba.core.compiler_lock import global_compiler_lock

LOOK_EVERY_S = 0.1
"""How long a wait lasts that no signal ends, as on Windows."""
STACK_BYTES = 2**26
"""What LLVM has in a main thread at least; some systems give other threads less."""


def interruptible(compile_now: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that does the same in another thread where the main one calls it.

    Whoever is interrupted leaves that thread behind. It ends its work, which is kept, and whoever compiles
    something meanwhile waits for it.

    Parameters
    ----------
    compile_now : function of one argument
        As a numba dispatcher's ``compile``.
    """

    def compile_beside(types: Any) -> Any:
        # Whoever compiles a function of their own that calls a kernel holds numba's lock already: another
        # thread would wait for it, and its owner for that thread, for ever.
        if threading.current_thread() is not threading.main_thread() or global_compiler_lock.is_locked():
            return compile_now(types)
        outcome: list[Any] = []
        errors: list[BaseException] = []

        def work() -> None:
            try:
                outcome.append(compile_now(types))
            except BaseException as error:
                errors.append(error)

        worker = _started(work)
        while worker.is_alive():
            worker.join(LOOK_EVERY_S)
        if errors:
            raise errors[0]
        return outcome[0]

    return compile_beside


def _started(work: Callable[[], None]) -> threading.Thread:
    worker = threading.Thread(target=work, name="compiling", daemon=True)
    before = threading.stack_size(STACK_BYTES)
    try:
        worker.start()
    finally:
        threading.stack_size(before)
    return worker
