"""Cost of a simulated second compared with robosuite, dm_control and Drake.

    python -m benchmarks.peers [--env DIR] [--rounds 3] [--seconds 15]

The peers are installed with pip, at the versions below, into a separate environment (`--env`, by
default in the temporary folder; it is kept). Each job is a process with one BLAS thread; the figure
is simulated seconds per CPU second of the steps alone, the median over the rounds. Jobs alternate,
because machines are shared: compare ratios.

The jobs differ. Ours: two dynamic arms with joint friction, sensors at 500 Hz, a tree each,
computed torque, collision detection, and tracking by a camera if stated. robosuite: two Pandas,
operational-space control at 500 Hz, actions at 20 Hz, no camera; and one Panda with a camera of 320
by 240 pixels at 20 Hz, if OpenGL is available (`MUJOCO_GL`). dm_control: one Jaco arm with velocity
actions, no camera; it ships no task with two arms. Drake: a UR5 and a Panda from the same
descriptions as ours, inverse dynamics at 500 Hz in Python, no contacts (it does not read STL).
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent

PACKAGES: Final = ("mujoco==3.3.2", "dm_control==1.0.30", "robosuite==1.5.2", "drake==1.51.1")
"""robosuite 1.5.2 and dm_control up to 1.0.50 do not work with MuJoCo 4."""

_HEAD = "import logging, sys, time\nseconds = float(sys.argv[1])\n"
_TAIL = "print('factor', seconds / (time.process_time() - begin))\n"

_OURS = """
import bt_dualarm as bt
run = bt.open({tree!r}).__enter__()
run.step(0.5)
begin = time.process_time()
run.step(seconds)
"""

_ROBOSUITE = """
import numpy as np
import robosuite
options = dict(has_renderer=False, control_freq=20, horizon=10**6, ignore_done=True)
options |= {options}
env = robosuite.make({name!r}, robots={robots!r}, **options)
env.reset()
env.step(np.zeros(env.action_dim))
begin = time.process_time()
for number in range(round(20 * seconds)):
    env.step(np.full(env.action_dim, 0.1 * np.sin(0.1 * number)))
"""

_DM_CONTROL = """
import numpy as np
from dm_control import manipulation
env = manipulation.load("place_brick_features", seed=0)
env.reset()
shape = env.action_spec().shape
begin = time.process_time()
for number in range(round(seconds / env.control_timestep())):
    env.step(np.full(shape, 0.1 * np.sin(0.1 * number)))
"""

_DRAKE = """
import numpy as np
from pydrake.all import ConstantVectorSource, DiagramBuilder, InverseDynamicsController
from pydrake.all import MultibodyPlant, Parser, Simulator

def plant_of(urdf, base, step):
    plant = MultibodyPlant(step)
    parser = Parser(plant)
    parser.package_map().Add("example-robot-data", {robots!r} + "/..")
    parser.AddModels({robots!r} + "/" + urdf)
    if base:
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(base))
    if plant.num_actuators() == 0:
        for index in plant.GetJointIndices():
            joint = plant.get_joint(index)
            if joint.num_velocities() == 1:
                plant.AddJointActuator(joint.name(), joint)
    plant.Finalize()
    return plant

logging.getLogger("drake").setLevel(logging.ERROR)
builder = DiagramBuilder()
for urdf, base in (
    ("ur_description/urdf/ur5_robot.urdf", ""),
    ("panda_description/urdf/panda.urdf", "panda_link0"),
):
    plant = builder.AddSystem(plant_of(urdf, base, 0.002))
    size = plant.num_positions()
    gains = [np.full(size, value) for value in (100.0, 1.0, 20.0)]
    law = builder.AddSystem(InverseDynamicsController(plant_of(urdf, base, 0.0), *gains, False))
    wanted = builder.AddSystem(ConstantVectorSource(np.full(2 * size, 0.1)))
    builder.Connect(plant.get_state_output_port(), law.get_input_port_estimated_state())
    builder.Connect(wanted.get_output_port(), law.get_input_port_desired_state())
    builder.Connect(law.GetOutputPort("generalized_force"), plant.get_actuation_input_port())
simulator = Simulator(builder.Build())
simulator.Initialize()
simulator.AdvanceTo(0.5)
begin = time.process_time()
simulator.AdvanceTo(0.5 + seconds)
"""

_TWO_ARMS = {
    "bt_dualarm": 1,
    "world": {"scene": "table", "reality": "lab"},
    "arms": {
        name: {
            "robot": robot,
            "base": base,
            "tree": {"repeat": {"times": 50, "child": {"circle": {"radius": 0.08, "speed": 0.5}}}},
        }
        for name, robot, base in (
            ("arm1", "ur5", {"xyz": [0.0, -0.5, 0.4]}),
            ("arm2", "panda", {"xyz": [0.0, 0.5, 0.4]}),
        )
    },
}
"""Two arms without a camera, which move for a long time."""


def jobs(python: Path) -> dict[str, tuple[Path, str]]:
    """Interpreter and code of each job, by name."""
    from bt_dualarm.robots.urdf_arm import robot_data_dir

    robots = str(robot_data_dir())
    here = Path(sys.executable)
    camera: dict[str, object] = {
        "has_offscreen_renderer": True,
        "use_camera_obs": True,
        "camera_heights": 240,
    }
    camera |= {"camera_widths": 320, "camera_names": "robot0_eye_in_hand"}
    blind = {"has_offscreen_renderer": False, "use_camera_obs": False}
    return {
        "bt_dualarm, UR5 and Panda": (here, _OURS.format(tree=_TWO_ARMS)),
        "bt_dualarm, pick_and_track (camera)": (here, _OURS.format(tree="pick_and_track")),
        "robosuite, TwoArmLift": (
            python,
            _ROBOSUITE.format(name="TwoArmLift", robots=["Panda", "Panda"], options=blind),
        ),
        "robosuite, Lift (one arm, camera)": (
            python,
            _ROBOSUITE.format(name="Lift", robots="Panda", options=camera),
        ),
        "dm_control, place_brick (one arm)": (python, _DM_CONTROL),
        "Drake, UR5 and Panda (no contacts)": (python, _DRAKE.format(robots=robots)),
    }


def install(folder: Path) -> Path:
    """The interpreter of an environment with the peers, which is created if missing.

    Raises:
        subprocess.CalledProcessError: A peer has no wheel for this machine.
    """
    python = folder / "bin" / "python"
    if not (folder / "installed").exists():
        print(f"installing the peers in {folder}: some minutes", flush=True)
        venv.create(folder, with_pip=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
        (folder / "installed").touch()
    return python


def main() -> int:
    """Print the factor of each job; returns 0."""
    parser = argparse.ArgumentParser(description="cost of a simulated second compared with peers")
    default = Path(tempfile.gettempdir()) / "bt_dualarm_peers"
    parser.add_argument("--env", type=Path, default=default)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=15.0)
    options = parser.parse_args()
    found = jobs(install(options.env))
    factors: dict[str, list[float]] = {name: [] for name in found}
    one_thread = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
    for _ in range(options.rounds):
        for name, (python, code) in list(found.items()):
            done = subprocess.run(
                [python, "-c", _HEAD + code + _TAIL, str(options.seconds)],
                cwd=ROOT,
                env=os.environ | one_thread,
                capture_output=True,
                text=True,
                check=False,
            )
            lines = done.stdout.splitlines()
            if done.returncode or not lines:
                reason = (done.stderr.splitlines() or ["no output"])[-1]
                print(f"{name}: did not run: {reason[:160]}", flush=True)
                del found[name]
                continue
            factors[name].append(float(lines[-1].split()[1]))
    print("simulated seconds per CPU second, median of the rounds (smallest, largest):")
    for name in found:
        values = factors[name]
        print(
            f"  {name:<38} {statistics.median(values):6.2f} ({min(values):.2f}, {max(values):.2f})"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
