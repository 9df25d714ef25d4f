"""Standard streams that survive write errors, and the report of lost output."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from typing import TextIO


class SafeStream:
    r"""Text stream that ignores write errors (closed, full, no reader) and keeps the first one.

    Characters that its encoding lacks, as that of ``LC_ALL=en_US``, are written out: ``\u2265``.

    Args:
        stream: The underlying stream.
        is_plain: Whether control characters are escaped, so that text cannot affect the terminal.

    Attributes:
        error: The first write error, None if there was none.
    """

    def __init__(self, stream: TextIO, *, is_plain: bool = False) -> None:
        self._stream = stream
        self._is_plain = is_plain
        self.error: OSError | None = None

    def write(self, text: str) -> int:
        """Write the text, or drop it after an error."""
        if self.error is None:
            shown = self._plain(text) if self._is_plain else text
            try:
                try:
                    self._stream.write(shown)
                except UnicodeEncodeError as error:
                    known = shown.encode(error.encoding, "backslashreplace")
                    self._stream.write(known.decode(error.encoding))
            except OSError as error:
                self._give_up(error)
        return len(text)

    @staticmethod
    def _plain(text: str) -> str:
        if text.replace("\n", "").isprintable():
            return text
        from bt_dualarm.spec.node_types import escaped

        return escaped(text)

    def flush(self) -> None:
        """Flush the stream, or drop the text after an error."""
        if self.error is None:
            try:
                self._stream.flush()
            except OSError as error:
                self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        # Its traceback would keep the frames of the command, and with them the run, past the exit.
        self.error = error.with_traceback(None)
        # Python flushes the stream at its exit, which must not fail again.
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)


class Output:
    """Standard output of a command, with the report of write errors.

    Args:
        program: Name of the program, for error messages.
        standard: Standard output.
    """

    def __init__(self, program: str, standard: SafeStream) -> None:
        self._program = program
        self._standard = standard
        self._is_reported = False

    def failed(self) -> bool:
        """Whether output was lost; prints an error message the first time.

        A reader that closes the pipe, such as ``head``, is not an error.
        """
        self._standard.flush()
        error = self._standard.error
        if error is None or isinstance(error, BrokenPipeError):
            return False
        if not self._is_reported:
            self._is_reported = True
            why = error.strerror or error
            print(f"{self._program}: error: cannot write the output: {why}", file=sys.stderr)
        return True


@contextmanager
def safe_streams(program: str, *, is_plain: bool = False) -> Iterator[Output]:
    """Replace standard output and standard error by `SafeStream` objects within the block.

    A closed stream, which is None in Python and unexpected by libraries, is replaced by the null
    device.

    Args:
        program: Name of the program, for error messages.
        is_plain: Whether control characters are escaped, as in `SafeStream`.
    """
    before = sys.stdout, sys.stderr
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        out, err = (SafeStream(stream or nowhere, is_plain=is_plain) for stream in before)
        sys.stdout = cast("TextIO", out)
        sys.stderr = cast("TextIO", err)
        try:
            yield Output(program, out)
        finally:
            out.flush()
            err.flush()
            sys.stdout, sys.stderr = before
