"""Fixtures, and the table of cells that ``make matrix`` prints."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.matrix.columns import columns
from tests.matrix.operations import ROWS
from tests.matrix.recordings import Recordings
from tests.no_plots import no_plots
from tests.own_models import tried_here

SIGNS = {"passed": ".", "failed": "F", "error": "E", "skipped": "s"}


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory, worker: str) -> Recordings:
    """Recorded runs that all workers of this test run share."""
    base = tmp_path_factory.getbasetemp()
    return Recordings((base.parent if worker else base) / "matrix")


@pytest.fixture(scope="session")
def worker(request: pytest.FixtureRequest) -> str:
    """Name of this worker process; empty if it is the only one."""
    return str(getattr(request.config, "workerinput", {}).get("workerid", ""))


@pytest.fixture(autouse=True, scope="package")
def records_without_plots() -> Iterator[None]:
    """Plots and stills have their own tests, and would take half the time of a short run."""
    with no_plots():
        yield


@pytest.fixture(autouse=True, scope="package")
def models_tried_here() -> Iterator[None]:
    """The models of these records are the tests' own."""
    with tried_here():
        yield


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Prints a row for each operation, a sign for each column, and the number of failing cells."""
    cells: dict[tuple[str, str], str] = {}
    for outcome, sign in SIGNS.items():
        for report in terminalreporter.stats.get(outcome, []):
            properties = dict(getattr(report, "user_properties", []))
            if "row" in properties:
                cells[properties["row"], properties["column"]] = sign
    if not cells:
        return
    names = [column.name for column in columns() if any(c == column.name for _, c in cells)]
    terminalreporter.section("interaction matrix")
    for number, name in enumerate(names):
        terminalreporter.write_line(f"{'':18}{'|' * number} {name}"[: 18 + 80])
    for row in ROWS:
        signs = "".join(cells.get((row, name), " ") for name in names)
        terminalreporter.write_line(f"{row:18}{signs}")
    failing = sum(sign in "FE" for sign in cells.values())
    skipped = sum(sign == "s" for sign in cells.values())
    terminalreporter.write_line(
        f"{len(cells)} cells of {len(ROWS)} rows and {len(names)} columns: "
        f"{failing} failing, {skipped} not applicable here"
    )
