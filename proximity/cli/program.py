"""Shared behaviour of all commands: negative numbers among the arguments, errors and exit codes.

Library errors become one line on stderr and exit code 2, and so does output that cannot be written. Whatever
else is raised is our bug and keeps its traceback.
"""

import errno
import inspect
import os
import re
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from proximity.cli.output import report
from proximity.errors import ProximityError

EXIT_NOTHING = 1  # no frame came
EXIT_UNUSABLE = 2  # as for a usage error
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells count
EXIT_BROKEN_PIPE = 141  # 128 + SIGPIPE: the reader, say `head`, went first

_NO_SUCH_OPTION: Any = vars(sys.modules[typer.BadParameter.__module__])["NoSuchOption"]
"""Of Click, or of the copy of it that newer versions of Typer have."""

SETTINGS = {"help_option_names": ["-h", "--help"]}
NEGATIVE = re.compile(r"-(\d|\.\d|(inf|infinity|nan)$)", re.IGNORECASE)
"""What begins a negative number, be it misspelt as -1,5: no option begins like that."""
DISK_IS_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}
"""What the system says where nothing can be written: the disk is full, or broken."""


def stop_after(limit: float | None, stop: threading.Event) -> None:
    """Have an event set after so many seconds."""
    if limit is not None:
        timer = threading.Timer(limit, stop.set)
        timer.daemon = True
        timer.start()


def help_and_examples(command: Callable[..., Any]) -> tuple[str, str]:
    """Return the help of a command, a line a paragraph, and its examples; both stand in its docstring."""
    text, _, examples = (inspect.getdoc(command) or "").partition("\n\nExamples:\n")
    paragraphs = (" ".join(paragraph.split()) for paragraph in text.split("\n\n"))
    # what is in brackets is no mark of Rich's
    return "\n\n".join(paragraphs).replace("[", "\\["), f"\nExamples:\n{examples}\n"


def add_command(
    app: typer.Typer, function: Callable[..., Any], name: str = "", *, is_bare: bool = False
) -> typer.Typer:
    """Add a command to *app* by its function, whose docstring is the help; *is_bare*: needs no argument."""
    text, examples = help_and_examples(function)
    app.command(
        name or function.__name__,
        cls=Command,
        help=text,
        epilog=examples,
        no_args_is_help=not is_bare,
        context_settings=SETTINGS,
    )(function)
    return app


def group_of(name: str, help: str, *functions: Callable[..., Any], bare: Iterable[str] = ()) -> typer.Typer:
    """Return a command that is a group: a command for each function; *bare*: those without arguments."""
    app = typer.Typer(
        name=name, cls=Group, help=help, no_args_is_help=True, add_completion=False, context_settings=SETTINGS
    )
    for function in functions:
        add_command(app, function, is_bare=function.__name__ in bare)
    return app


class _Plain(NamedTuple):
    """Passes on text, paths and defaults; Typer converts the rest by Pydantic: a third of a query's time."""

    of_typer: Callable[[], Any]
    kind: Any

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return a value as Typer's converters do."""
        kind, is_many = self.kind.annotation, param.multiple or param.nargs == -1
        if value is None:
            return () if is_many else None
        if kind is str or (kind is type(value) and (value == param.default or not self.kind.is_ranged)):
            return value
        if kind is Path and isinstance(value, str):
            return Path(value)
        if kind in (list[str], tuple[str, str, str]):
            return list(value) if is_many else tuple(value)
        return self.of_typer().coerce(value, param=param, ctx=ctx)


def _no_type(ctx: Any) -> None:
    """What stands in the help for the type of a flag, or of an argument, which has a name."""


class _Plainly:
    """A command or a group whose values `_Plain` converts."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return arguments and options, that for help as well; only values have a type in the help."""
        params: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for param in params:
            if param.param_type_name == "argument" or param.is_flag:
                param.display_type_rich = _no_type
            of_typer = getattr(param, "get_runtime_param", None)  # versions without it are let be
            if of_typer is not None and not isinstance(of_typer, partial):
                param.get_runtime_param = partial(_Plain, of_typer, param.type_descriptor)
        return params


class Command(_Plainly, TyperCommand):
    """A command to which ``-2.5`` is a number, and whose examples stay lines."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help, and the examples below it line by line: some versions of Typer would join them."""
        examples, self.epilog = self.epilog, None
        try:
            super().format_help(ctx, formatter)
        finally:
            self.epilog = examples
        formatter.write(examples or "")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse *args* so that negative numbers are values, wherever they stand, with a space before them."""
        try:
            return super().parse_args(ctx, [f" {arg}" if NEGATIVE.match(arg) else arg for arg in args])
        except _NO_SUCH_OPTION as error:
            error.possibilities = get_close_matches(error.option_name, error.possibilities or (), cutoff=0.8)
            raise


class Group(_Plainly, TyperGroup):
    """Commands whose expected ends are exit codes."""

    meant: ClassVar[dict[str, str]] = {"wasm": "library wasm", "javascript": "client js"}
    """Words that are no commands, and the command that people mean by them."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that is asked for; of an unknown one, name the one that is meant."""
        word = args[0].lower()
        if self.get_command(ctx, args[0]) is None and word in self.meant:
            ctx.fail(f"No such command {args[0]!r}. Did you mean {self.meant[word]!r}?")
        return super().resolve_command(ctx, args)

    def make_context(self, *args: Any, **options: Any) -> Any:
        """Read the arguments, and print help or version where that is asked for."""
        with _expected_ends():
            return super().make_context(*args, **options)

    def invoke(self, ctx: Any) -> Any:
        """Run the command that is asked for."""
        if sys.stdout is None:
            _complain("standard output is closed, expected a terminal, a file or a pipe to write to")
        with _expected_ends():
            answer = super().invoke(ctx)
            sys.stdout.flush()  # here, where a reader that has gone is still expected
            return answer


@contextmanager
def _expected_ends() -> Iterator[None]:
    """Turn errors of the library, and output that cannot be written or that nobody reads, into exit codes."""
    try:
        yield
    except ProximityError as error:
        _complain(str(error), error)
    except BrokenPipeError as gone:
        _discard_output()
        raise typer.Exit(EXIT_BROKEN_PIPE) from gone
    except SystemExit as end:
        # how Rich, which prints the help, ends a program whose reader has gone: with 1
        if isinstance(end.__context__, BrokenPipeError):
            raise typer.Exit(EXIT_BROKEN_PIPE) from end
        raise
    except OSError as failure:
        if failure.errno not in DISK_IS_FULL:
            raise
        _discard_output()
        _complain(f"the output cannot be written ({failure.strerror})", failure)
    except ImportError as broken:
        if not _is_interrupt(broken):
            raise
        raise typer.Exit(EXIT_INTERRUPTED) from broken


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind an error: compiled modules turn it into one of theirs as they are imported."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _complain(sentence: str, reason: BaseException | None = None) -> NoReturn:
    """Say why what is asked cannot be done, in one line on stderr, and end."""
    report(sentence)
    raise typer.Exit(EXIT_UNUSABLE) from reason


def _discard_output() -> None:
    """Point stdout at nothing, so that the interpreter's last flush cannot fail."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, sys.stdout.fileno())
    os.close(nothing)
