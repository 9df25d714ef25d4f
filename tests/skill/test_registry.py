"""The registry finds skills, and refuses invalid ones with the name of the file."""

from __future__ import annotations

import importlib.metadata
import shutil
import sys
from pathlib import Path
from textwrap import dedent

import pytest

from bt_dualarm.skill import registry
from bt_dualarm.skill.registry import Registry, RegistryError, yaml_name
from bt_dualarm.skill.skill import Skill

GOOD = '''
    """A skill."""
    from bt_dualarm.skill.skill import Skill
    from bt_dualarm.spec.node_types import PortModel, port

    class WaveOnce(Skill):
        """Waves."""

        class Ports(PortModel):
            angle: float = port(20.0, "How far", unit="deg", gt=0)

        failures = {"TIRED": "the arm is tired"}
        example = "wave_once: {angle: 30}"

        def run(self):
            yield
'''


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder, without any shipped or installed skills."""
    shipped = tmp_path / "shipped"
    shipped.mkdir()
    monkeypatch.setattr(registry, "share_dir", lambda _: shipped)
    monkeypatch.setattr(registry, "_entry_points", lambda: ())
    return tmp_path


def complaints(folder: Path, text: str, name: str = "wave.py") -> list[str]:
    (folder / name).write_text(dedent(text))
    with pytest.raises(RegistryError) as caught:
        Registry.load([folder])
    return [c.replace(f"{folder}/", "") for c in caught.value.complaints]


@pytest.mark.parametrize(
    ("name", "yaml"),
    [
        ("Circle", "circle"),
        ("ReachToPose", "reach_to_pose"),
        ("PickXY", "pick_xy"),
        ("HTTPGet", "http_get"),
        ("Move2D", "move2_d"),
    ],
)
def test_yaml_names_of_classes(name: str, yaml: str) -> None:
    assert yaml_name(type(name, (Skill,), {})) == yaml


def test_valid_skill_is_registered(folder: Path) -> None:
    (folder / "wave.py").write_text(dedent(GOOD))
    (folder / "_shared.py").write_text("raise RuntimeError('not a skill file')")
    found = Registry.load([folder])
    kind = found.kinds["wave_once"]
    assert kind.summary == "Waves."
    assert kind.is_leaf
    assert kind.failures == {"TIRED": "the arm is tired"}
    assert kind.origin.endswith("wave.py")
    assert Registry.load([folder]).skills["wave_once"] is found.skills["wave_once"]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("yield", "pass", "wave.py: WaveOnce: run() has no yield: every yield ends a tick"),
        ('"""Waves."""', "", "wave.py: WaveOnce: has no docstring;"
                             " its first line is shown to users"),
        ("class Ports(PortModel)", "class Ports", "wave.py: WaveOnce: Ports is not a PortModel"),
        ("port(20.0", "port(-1.0", "wave.py: WaveOnce: Ports.angle refuses its own default:"
                                   " Input should be greater than 0"),
        ('port(20.0, "How far", unit="deg", gt=0)', "1.0", "wave.py: WaveOnce: Ports.angle has no"
         " description; declare it with port(default, description)"),
        ("angle: float", "name: float", "wave.py: WaveOnce: 'name' cannot be the name of a port:"
                                        " it is reserved in every node"),
        ('"TIRED": "the', '"tired": "the', "wave.py: WaveOnce: failure code 'tired' must consist of"
                                           " capital letters, digits and _"),
        ("WaveOnce", "Wait", "wave.py: 'wait' is a node type of the language; rename the class"),
        ("from bt_dualarm.skill.skill", "from bt_dualarm.skil",
         "wave.py:3: cannot be imported: ModuleNotFoundError: No module named 'bt_dualarm.skil'"),
        ("failures =", 'brings_in = ("angle",)\n        failures =', "wave.py: WaveOnce: brings_in"
         " names 'angle', which is not a port with the name of an object or arm"),
        ("failures =", 'takes_out = ("angle",)\n        failures =', "wave.py: WaveOnce: takes_out"
         " names 'angle', which is not a port with the name of an object or arm"),
        ("class WaveOnce(Skill)", "class WaveOnce", "wave.py: has no subclass of Skill"),
        ('{"TIRED": "the arm is tired"}', '["TIRED"]', "wave.py: WaveOnce: failures is ['TIRED']:"
         " it is a mapping from each code to its meaning"),
        ('"the arm is tired"', "3",
         "wave.py: WaveOnce: failures has 'TIRED': 3: codes and their meanings are text"),
        ("failures =", 'needs = ("nowhere",)\n        failures =',
         "wave.py: WaveOnce: needs names the module 'nowhere', which is not installed"),
        ("failures =", 'needs = "scipy"\n        failures =',
         "wave.py: WaveOnce: needs is the text 'scipy': it is a tuple of module names"),
        ("failures =", 'needs_camera = "yes"\n        failures =',
         "wave.py: WaveOnce: needs_camera is 'yes': it is True or False"),
        ("failures =", 'counterpart = "take"\n        failures =',
         "wave.py: WaveOnce: counterpart is 'take': it is a Counterpart"),
        ('"wave_once: {angle: 30}"', "None",
         "wave.py: WaveOnce: example is None: it is text in YAML"),
        ("angle: float", "angle: Skill", "wave.py: WaveOnce: Ports has a port of a type that a file"
         " cannot hold: Unable to generate pydantic-core schema for"
         " <class 'bt_dualarm.skill.skill.Skill'>"),
        ('"""A skill."""', "1 / 0",
         "wave.py:2: cannot be imported: ZeroDivisionError: division by zero"),
    ],
)  # fmt: skip
def test_invalid_skill_is_refused(old: str, new: str, complaint: str, folder: Path) -> None:
    assert complaints(folder, GOOD.replace(old, new, 1)) == [complaint]


def test_port_and_output_of_the_same_name_are_refused(folder: Path) -> None:
    text = GOOD.replace(
        "failures =",
        'class Outputs(PortModel):\n            angle: float = port(0, "It")\n\n        failures =',
    )
    assert complaints(folder, text) == [
        "wave.py: WaveOnce: 'angle' is a port and an output; rename one of them"
    ]


def test_two_skills_of_the_same_name_are_refused(folder: Path) -> None:
    (folder / "a.py").write_text(dedent(GOOD))
    assert complaints(folder, GOOD) == ["wave.py: skill 'wave_once' is already in a.py"]


def test_skills_are_loaded_from_user_folders(folder: Path) -> None:
    more = folder / "more"
    more.mkdir()
    (more / "wave.py").write_text(dedent(GOOD))
    assert "wave_once" in Registry.load([more]).skills
    with pytest.raises(RegistryError, match="there is no such folder"):
        Registry.load([folder / "none"])


def test_newly_installed_skill_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It disappears when it is uninstalled: package metadata is read again on each load."""
    monkeypatch.syspath_prepend(tmp_path)
    before = Registry.load().skills.keys()
    assert "wave_once" not in before
    (tmp_path / "later_skills.py").write_text(dedent(GOOD))
    metadata = tmp_path / "later-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: later\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        f"[{registry.ENTRY_POINTS}]\nlater = later_skills:WaveOnce\n"
    )
    assert Registry.load().skills.keys() - before == {"wave_once"}
    shutil.rmtree(metadata)
    assert Registry.load().skills.keys() == before


def test_skills_are_loaded_from_installed_packages(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An entry point names a class or a module; a broken one is named."""
    (folder / "their_skills.py").write_text(dedent(GOOD))
    monkeypatch.syspath_prepend(folder)
    (folder / "more").mkdir()
    monkeypatch.setattr(registry, "share_dir", lambda _: folder / "more")

    def installed(value: str) -> None:
        entry = importlib.metadata.EntryPoint("theirs", value, registry.ENTRY_POINTS)
        monkeypatch.setattr(registry, "_entry_points", lambda: (entry,))

    installed("their_skills:WaveOnce")
    assert "wave_once" in Registry.load().skills
    installed("their_skills")
    assert "wave_once" in Registry.load().skills
    installed("their_skills:GONE")
    with pytest.raises(RegistryError, match=r"entry point 'theirs' \(their_skills:GONE\): cannot"):
        Registry.load()
    installed("pathlib:Path")
    with pytest.raises(RegistryError, match="is neither a skill nor a module of skills"):
        Registry.load()


def test_shipped_skill_is_imported_on_first_access(folder: Path) -> None:
    """Its file has its name; a damaged file is reported on access, not at each start."""
    shipped = folder / "shipped"
    (shipped / "wave_once.py").write_text(dedent(GOOD))
    (shipped / "damaged.py").write_text("1 / 0")
    (shipped / "elsewhere.py").write_text(dedent(GOOD))
    before = set(sys.modules)
    found = Registry.load()
    assert list(found.kinds) == list(found.skills) == ["damaged", "elsewhere", "wave_once"]
    assert "wave_once" in found.kinds
    assert len(found.skills) == 3
    assert set(sys.modules) == before
    assert found.kinds["wave_once"].origin == str(shipped / "wave_once.py")
    assert found.kinds["wave_once"] is found.kinds["wave_once"]
    with pytest.raises(RegistryError, match=r"damaged\.py: cannot be imported: ZeroDivisionError"):
        found.skills["damaged"]
    with pytest.raises(RegistryError, match=r"elsewhere\.py: has no skill 'elsewhere'"):
        found.kinds["elsewhere"]
    with pytest.raises(KeyError):
        found.skills["nothing"]
    assert complaints(folder, GOOD) == [
        "wave.py: skill 'wave_once' is already in shipped/wave_once.py"
    ]


def test_shipped_files_have_the_names_of_their_skills() -> None:
    found = Registry.load()
    assert {name: yaml_name(skill) for name, skill in found.skills.items()} == {
        name: name for name in found.kinds
    }
