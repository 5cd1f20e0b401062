"""Where people read: Rich's console, which leaves a reader that has gone to the command."""

import rich.console


class Console(rich.console.Console):
    """Rich's console; where nobody reads any more it raises BrokenPipeError, as any other file does."""

    def on_broken_pipe(self) -> None:
        """Say that the reader has gone. Rich itself would end the program, with 1."""
        raise BrokenPipeError
