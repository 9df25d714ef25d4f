"""Standard output and standard error that no command dies of: closed, full, or read by nobody."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from typing import TextIO


class Outlet:
    """A text stream that goes on when it cannot write any more, and remembers why.

    Args:
        stream: The stream that it stands before.
        is_plain: Whether nothing that goes through it may move or colour anything: what a
            terminal would act on is written out, wherever it came from.

    Attributes:
        error: What kept it from writing, None while it could.
    """

    def __init__(self, stream: TextIO, *, is_plain: bool = False) -> None:
        self._stream = stream
        self._is_plain = is_plain
        self.error: OSError | None = None

    def write(self, text: str) -> int:
        """Write, or lose the text."""
        if self.error is None:
            try:
                self._stream.write(self._plain(text) if self._is_plain else text)
            except OSError as error:
                self._give_up(error)
        return len(text)

    @staticmethod
    def _plain(text: str) -> str:
        if text.replace("\n", "").isprintable():
            return text
        from bt_dualarm.spec.wording import escaped  # which takes a while at the first time

        return escaped(text)

    def flush(self) -> None:
        """Write what is held back, or lose it."""
        if self.error is None:
            try:
                self._stream.flush()
            except OSError as error:
                self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self.error = error
        # What Python flushes at its exit must go somewhere.
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)


class Output:
    """What a command writes to.

    Args:
        program: Name of the program, for complaints.
        standard: Standard output.
    """

    def __init__(self, program: str, standard: Outlet) -> None:
        self._program = program
        self._standard = standard
        self._is_said = False

    def failed(self) -> bool:
        """Whether standard output lost something that somebody wanted to read; it is said once.

        A reader who goes away, as ``head`` does, has what it wanted.
        """
        self._standard.flush()
        error = self._standard.error
        if error is None or isinstance(error, BrokenPipeError):
            return False
        if not self._is_said:
            self._is_said = True
            why = error.strerror or error
            print(f"{self._program}: error: cannot write the output: {why}", file=sys.stderr)
        return True


@contextmanager
def outlets(program: str, *, is_plain: bool = False) -> Iterator[Output]:
    """Put outlets before standard output and standard error for the time of the block.

    One that is closed is None to Python, which libraries do not expect: it leads nowhere then.

    Args:
        program: Name of the program, for complaints.
        is_plain: Whether no control character gets through, as of `Outlet`.
    """
    before = sys.stdout, sys.stderr
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        out, err = (Outlet(stream or nowhere, is_plain=is_plain) for stream in before)
        sys.stdout, sys.stderr = cast("TextIO", out), cast("TextIO", err)
        try:
            yield Output(program, out)
        finally:
            out.flush()
            err.flush()
            sys.stdout, sys.stderr = before
