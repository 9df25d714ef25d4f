"""Importing skills: what stands in their files outside of functions is somebody's code, too."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bt_dualarm.cli.early_signals import early

if TYPE_CHECKING:
    from bt_dualarm.skill.registry import Registry

IMPORT_S: Final = 30.0
"""Seconds on the wall that the import of all skills gets, unless said otherwise."""


def imported_skills(
    program: str, folders: Sequence[Path], seconds: float | None = None
) -> Registry:
    """The installed skills and those of some folders, each file imported once in a process.

    Args:
        program: Name of the program, for what it says if nothing but its end helps.
        folders: Folders of the user.
        seconds: Seconds on the wall that this gets; infinite for as long as it takes, by default
            `IMPORT_S`.

    Raises:
        Overrun: A file has not been imported in time; it says at which line that stands.
        RegistryError: A skill is badly made.
        DualArmError: A file raises what ends programs.
    """
    from bt_dualarm.cli.last_resort import ProcessEnd, exit_refused
    from bt_dualarm.errors import DualArmError, Interruption
    from bt_dualarm.runtime.signals import StopRequest
    from bt_dualarm.runtime.watchdog import Watchdog
    from bt_dualarm.skill.registry import Registry

    stop = StopRequest()
    watchdog = Watchdog(IMPORT_S if seconds is None else seconds, stop, of="the import of skills")
    last_resort = ProcessEnd(program, stop)
    with last_resort as watchdog.last_resort, closing(watchdog), watchdog.awake(), exit_refused():
        try:
            with watchdog:
                return Registry.load(folders)
        except (KeyboardInterrupt, Interruption) as error:
            if early:  # a signal has come
                raise
            raise DualArmError(" ".join(error.__notes__)) from error
