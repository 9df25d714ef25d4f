"""A newcomer finds things by the names of folders and files and the rooms' maps alone."""

from __future__ import annotations

import pytest

from tests.source import PACKAGE, ROOT
from tests.where_is import where_is

LOOKED_AT = 3
"""Files that a newcomer opens before giving up."""

QUESTIONS = {
    "the jerk limit of a set-point": ("motion/setpoints/limiter.py", "jerk"),
    "the hue that wraps around at red": ("spec/color.py", "hue"),
    "what does the decorator retry do": ("tree/decorators.py", "class Retry"),
    "when does an arm brake for another arm": ("motion/safety/failsafe.py", "brak"),
    "the budget of a search by an OMPL planner": ("motion/planning/ompl_search.py", "budget"),
    "inverse kinematics of an arm": ("motion/kinematics/arm_kinematics.py", "class Kinematics"),
    "how a torque is computed": ("motion/control/computed_torque.py", "torque"),
    "duplicate keys in YAML are refused by the reader": ("spec/reader.py", "twice"),
    "the latency of a camera and lost frames": ("world/cameras/camera.py", "latency"),
    "how an object is attached to the tool": ("world/attachments.py", "attach"),
    "what is written into the summary of a record": ("runtime/summary.py", "state_sha256"),
    "the tree as ASCII lines in the terminal": ("runtime/drawing.py", "def "),
    "what happens when Ctrl-C sends a signal": ("runtime/signals.py", "SIGINT"),
    "the search along a spiral for a lost target": ("skill/spiral_search.py", "class Spiral"),
    "how the motion of a target is predicted": ("vision/motion_model.py", "class Oscillator"),
    "the curve of a lissajous": ("motion/paths/curves.py", "def lissajous"),
    "the page of a robot in the catalogue": ("world/robots/page.py", "class "),
    "reading a URDF": ("world/robots/urdf.py", "urdf"),
    "the blackboard of one arm": ("tree/board.py", "class Board"),
    "theoretical bounds of tracking experiments": ("experiments/bounds.py", "bound"),
    "the time-optimal motion along a path": ("motion/timing/time_optimal.py", "TOPP-RA"),
    "pixels become a point of the world": ("vision/localise.py", "def "),
    "poses out of reach are found before a run": ("preflight/reaching.py", "reach"),
    "an image by casting rays": ("world/rendering/raycast.py", "class RayRenderer"),
}
"""What newcomers ask, the file that answers, and a text that stands in it."""


@pytest.mark.parametrize("question", QUESTIONS)
def test_a_newcomer_finds(question: str) -> None:
    answer, _ = QUESTIONS[question]
    found = where_is(question)
    assert answer in found[:LOOKED_AT], found[:8]


@pytest.mark.parametrize(("answer", "text"), QUESTIONS.values())
def test_the_answer_is_there(answer: str, text: str) -> None:
    place = PACKAGE / answer if (PACKAGE / answer).is_file() else ROOT / answer
    assert text in place.read_text(encoding="utf-8").replace("Sigint", "SIGINT")


def test_nonsense_is_found_nowhere() -> None:
    assert where_is("xylophone quux") == []
