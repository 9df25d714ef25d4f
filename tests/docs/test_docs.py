"""Documentation pages are true: commands run, examples work, links are valid, tables agree."""

from __future__ import annotations

import io
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

from bt_dualarm.core.share import share_dir
from tests.commands import Ran, in_this_process
from tests.no_plots import no_plots

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
EXAMPLE_PAGES = (
    "docs/objects.md",
    "docs/grasping.md",
    "docs/poses.md",
    "README.md",
    "docs/first_tree.md",
    "docs/skills.md",
    "docs/motion.md",
    "docs/colors.md",
    "docs/tracking.md",
    "docs/reality.md",
    "docs/running.md",
    "docs/sweeps.md",
    "docs/first_skill.md",
    "docs/own_robot.md",
    "docs/expressions.md",
    "docs/conditions.md",
    "docs/ticking.md",
)

FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)#\s]+)(#[\w-]+)?\)")

ROBOT_DATA = (
    '.venv/bin/python -c "from bt_dualarm.robots.urdf_arm import robot_data_dir; '
    'print(robot_data_dir())"'
)

RUN_ELSEWHERE = {
    ROBOT_DATA: "test_the_folder_of_the_urdfs_is_printed",
    "python3 -m venv .venv": "Makefile, and tests/test_packaging.py",
    ".venv/bin/python -m pip install --constraint constraints.txt --editable '.[dev]'": "by hand",
    ".venv/bin/python -m pytest": "this suite",
    ".venv/bin/python -m bt_dualarm circle --display quiet": "tests/runtime/test_api.py",
    ".venv/bin/python docs/images/pick_and_track_film.py": "by hand: a run and 207 pictures",
    "bt-run handover": "tests/test_trees.py",
    "bt-run shared_bin": "tests/test_trees.py",
    "bt-run assembly": "tests/test_trees.py",
    "bt-record export out --lerobot data": "docs/running.md",
    "bt-record export run_* --lerobot data --only-successes": "tests/replay/test_lerobot.py",
    "bt-record export more_* --lerobot data --append": "tests/replay/test_lerobot.py",
}
"""Commands of the pages that a test cannot run inside itself, and where they are run."""

MAIN_JOB = "bt-run pick_and_track --record out"
"""A command on several pages, with the same output and record wherever it is run."""

ONE_CELL = (
    "bt-experiments --case circle --speed 1.0 --controller predictive --fps 60 --seeds 1"
    " --json cell.json"
)
"""A command that tests/cli/test_experiments.py runs and checks."""

SWEEP = "bt-sweep circle --seeds 0:2 --param speed=0.5:1.0:2 --reality lab --out "
"""A command that a page has twice, for two folders to compare: the rows are the same."""

MAIN_JOB_BY_PATH = ".venv/bin/bt-run trees/pick_and_track.yaml"

BEGINNING = "bt-run pick_and_track --duration 1.5 --record begun"
"""The first 1.5 s of the main job, whose record is read and exported faster than a whole one."""

SHORTER = {
    "bt-replay out --check": "bt-replay begun --check",
    "bt-run --resume out@12.4 --record again": "bt-run --resume out@18 --record again",
    "bt-record export out --html out.html": "bt-record export begun --html out.html",
    "bt-record export out --mcap out.mcap": "bt-record export begun --mcap out.mcap",
    "bt-record export out --lerobot data": "bt-record export begun --lerobot data",
}
"""Commands on the record of the main job and their replacements: tests/replay has whole runs."""

SHIPPED = {path.stem for path in share_dir("trees").glob("*.yaml")}


@dataclass(frozen=True)
class Block:
    """One fenced block of a page."""

    language: str
    text: str

    @property
    def commands(self) -> list[str]:
        """Commands without comments: all lines of a bash block, lines with $ of a console block."""
        lines = (re.sub(r"\s+#.*", "", line).strip() for line in self.text.splitlines())
        if self.language == "console":
            return [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
        if self.language == "bash":
            return [line for line in lines if line and not line.startswith("#")]
        return []

    @property
    def output(self) -> str:
        """The output of a console block's command."""
        return self.text.partition("\n")[2]

    @property
    def file_name(self) -> str:
        """The file name in the comment of its first line, or an empty string."""
        match = re.match(r"# ([\w/]+\.\w+)\n", self.text)
        return match[1] if match else ""


def blocks_of(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [Block(language, body) for language, body in FENCE.findall(text)]


def commands_of(page: Path) -> list[str]:
    return [command for block in blocks_of(page) for command in block.commands]


ALL_COMMANDS = sorted({command for page in PAGES for command in commands_of(page)})
TARGETS = sorted({command for command in ALL_COMMANDS if command.startswith("make ")})


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_on_a_page_is_run_by_a_test(page: Path) -> None:
    unknown = [
        command
        for command in commands_of(page)
        if command not in RUN_ELSEWHERE
        and not command.startswith("make ")
        and not (command.startswith("bt-") and str(page.relative_to(ROOT)) in EXAMPLE_PAGES)
        and not command.startswith(".venv/bin/bt-run ")
    ]
    assert unknown == []


def test_make_knows_the_targets() -> None:
    """Continuous integration runs the targets themselves."""
    targets = [word for command in TARGETS for word in command.split()[1:]]
    dry = subprocess.run(
        ["make", "--dry-run", *targets],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert dry.returncode == 0, dry.stderr


def run_in(folder: Path, command: str, monkeypatch: pytest.MonkeyPatch) -> tuple[int, str]:
    """Runs a command of a page in this process; returns its exit code and combined output."""
    program, *arguments = command.removeprefix(".venv/bin/").split()
    monkeypatch.chdir(folder)
    output = io.StringIO()
    return in_this_process(program, arguments, output, output), output.getvalue()


@pytest.fixture(scope="module")
def records(main_job: Ran, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the record of the main job and that of its beginning."""
    assert main_job.code == 0, main_job.err
    folder = tmp_path_factory.mktemp("records")
    (folder / "out").symlink_to(main_job.folder)
    with pytest.MonkeyPatch.context() as patch, no_plots():
        run_in(folder, BEGINNING, patch)
    return folder


def test_the_folder_of_the_urdfs_is_printed(tmp_path: Path) -> None:
    code = shlex.split(ROBOT_DATA)[2]
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, text=True, check=True
    )
    assert (Path(done.stdout.strip()) / "ur_description" / "urdf" / "ur5_robot.urdf").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("page", EXAMPLE_PAGES)
def test_examples_work_in_the_order_of_the_page(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """A reader who saves every file and types every command sees what the page says.

    Commands in bash blocks succeed; those in console blocks print the text below them.
    """
    shutil.copytree(share_dir("trees"), tmp_path / "trees")
    for block in blocks_of(ROOT / page):
        if block.file_name:
            (tmp_path / block.file_name).parent.mkdir(exist_ok=True)
            (tmp_path / block.file_name).write_text(block.text, encoding="utf-8")
        for command in block.commands:
            if not command.removeprefix(".venv/bin/").startswith("bt-"):
                continue
            if command.removeprefix("bt-run ") in SHIPPED:
                continue  # another test checks that every shipped tree succeeds
            if command == MAIN_JOB_BY_PATH:
                continue  # the same file as MAIN_JOB
            if command == ONE_CELL:
                continue
            if command == f"{SWEEP}after":
                shutil.copytree(tmp_path / "before", tmp_path / "after")
                continue
            if command.startswith("bt-sweep "):
                command += " --jobs 1"  # each worker process would import everything
            if command == MAIN_JOB:
                shutil.copytree(request.getfixturevalue("records"), tmp_path, dirs_exist_ok=True)
                continue
            with no_plots():  # drawing has its own tests
                code, output = run_in(tmp_path, SHORTER.get(command, command), monkeypatch)
            if block.language == "console":
                assert output == block.output
            else:
                assert code == 0, f"{command}\n{output}"


@pytest.mark.slow
def test_main_job_does_and_writes_what_the_pages_say(main_job: Ran) -> None:
    """The README's accuracy is reached, and the guide lists all files of the record."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    guide = (ROOT / "docs" / "running.md").read_text(encoding="utf-8")
    (track,) = main_job.leaves("arm2", "track")
    assert "less than 1 mm RMS" in readme
    assert track["metrics"]["yz_rms_m"] < 0.001

    written = {re.sub(r"^arm\d", "ARM", path.name) for path in main_job.folder.iterdir()}
    assert {name for name in written if f"`{name}`" not in guide} == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page: Path) -> None:
    targets = [target for target, _ in LINK.findall(page.read_text(encoding="utf-8"))]
    local = [target for target in targets if not target.startswith(("http://", "https://"))]
    assert [target for target in local if not (page.parent / target).exists()] == []


def test_guide_names_every_shipped_tree() -> None:
    """Skills and node types are in the generated reference, which has its own test."""
    text = (ROOT / "docs" / "running.md").read_text(encoding="utf-8")
    trees = {path.stem for path in share_dir("trees").glob("*.yaml")}
    assert {name for name in trees if f"`{name}`" not in text} == set()


def test_readme_has_at_most_150_lines() -> None:
    """Longer texts belong on pages of their own."""
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


def test_every_page_is_in_the_navigation_of_the_site() -> None:
    """``make docs-html`` also checks this, with packages that the tests do not need."""
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    entries = set(re.findall(r"^(\w+)$", index, re.MULTILINE))
    assert {path.stem for path in (ROOT / "docs").glob("*.md")} - {"index"} == entries


def declared_ranges(*extras: str) -> dict[str, str]:
    """Ranges of ``pyproject.toml`` by package, in the notation of the page."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    optional = project["optional-dependencies"]
    entries = [*project["dependencies"], *(one for extra in extras for one in optional[extra])]
    pairs = (entry.split(">=") for entry in entries)
    return {name: "≥ " + span.replace(",<", ", < ") for name, span in pairs}


def test_dependencies_page_agrees_with_pyproject() -> None:
    """One row for each package, with the same range."""
    text = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([\w.-]+) \| (≥ [^|]+?) \|", text, re.MULTILINE)
    assert dict(rows) == declared_ranges("dev", "docs")


def test_constraints_hold_exact_versions_only() -> None:
    """Paths and addresses would have different meanings on different machines."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = [line for line in lines if not line.startswith("#")]
    assert [line for line in pinned if not re.fullmatch(r"[\w.-]+==[\w.]+", line)] == []


def test_constraints_cover_every_dependency() -> None:
    text = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    pinned = {line.split("==")[0].lower().replace("_", "-") for line in text.splitlines()}
    names = {name.lower().replace("_", "-") for name in declared_ranges("dev")}
    assert names <= pinned


def test_lock_file_has_the_same_versions_and_hashes_of_their_wheels() -> None:
    """`make setup` installs exactly the versions of the constraints."""

    def normalized(pin: str) -> str:
        return pin.lower().replace("_", "-")

    text = (ROOT / "requirements.lock").read_text(encoding="utf-8").replace("\\\n", "")
    entries = [line.split() for line in text.splitlines() if not line.startswith("#")]
    constraints = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {normalized(line) for line in constraints if not line.startswith("#")}
    assert {normalized(entry[0]) for entry in entries} == pinned
    assert len(entries) == len(pinned)
    for _, *hashes in entries:
        assert hashes
        assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", one) for one in hashes)
