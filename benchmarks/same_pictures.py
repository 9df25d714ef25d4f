"""Images of two states of this project for the same requests: pixels and cost.

    python -m benchmarks.same_pictures 5d47b18 [--tree pick_and_track] [--scenes 500]

The first state is a revision of this repository, or a folder with a checkout; the second is this
checkout. Requests are all those of the cameras of a run, and ``--scenes`` windows into random
scenes with every shape, near the camera and around it. The states render all of them in separate
processes, one after the other. Prints the number of pixels that differ, and the mean of the
smallest CPU time of each image.
"""

from __future__ import annotations

import argparse
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from benchmarks.alternating import ROOT, checkout_of
from benchmarks.real_time import play
from bt_dualarm.runtime.run import Run

KINDS = ("sphere", "cylinder", "capsule", "box", "mesh", "mesh", "sphere", "box", "ellipsoid")
POSES = ("geom_xpos", "geom_xmat", "light_xpos", "light_xdir", "cam_xpos", "cam_xmat")

_DRAW = """
import pickle, sys, time
import mujoco, numpy as np
from bt_dualarm.sim.renderers import RayRenderer
from bt_dualarm.sim.frame import Exposure
models, requests = pickle.load(open(sys.argv[1], "rb"))
renderer, pictures, spent, latest = RayRenderer(), [], [], None
for number, poses, asked in requests:
    if number != latest:
        latest, data = number, mujoco.MjData(models[number])
    for name, values in poses.items():
        getattr(data, name)[:] = values
    exposure, costs = Exposure(*asked), []
    for _ in range(4):
        began = time.process_time_ns()
        picture = renderer.render(models[number], data, exposure)
        costs.append(time.process_time_ns() - began)
    pictures.append(picture)
    spent.append(min(costs))
pickle.dump((pictures, spent), open(sys.argv[2], "wb"))
"""


class Request(NamedTuple):
    """Request of one image.

    Attributes:
        model: Number of its model.
        poses: Poses of everything, by the names of MuJoCo's arrays.
        asked: Camera, width, height, region, stride.
    """

    model: int
    poses: dict[str, Any]
    asked: tuple[Any, ...]


def requests_of_run(tree: str) -> tuple[list[Any], list[Request]]:
    """Models and requests of a run with the ray caster."""
    models: list[Any] = []
    requests: list[Request] = []

    def record_requests(opened: Run) -> None:
        renderer: Any = opened.assembly.renderer
        original = renderer.render

        def render(model: Any, data: Any, exposure: Any) -> Any:
            if not models or models[-1] is not model:
                models.append(model)
            requests.append(_request(len(models) - 1, data, exposure))
            return original(model, data, exposure)

        renderer.render = render

    play(tree, "ray", record_requests)
    return models, requests


def _request(number: int, data: Any, exposure: Any) -> Request:
    poses = {name: getattr(data, name).copy() for name in POSES}
    asked = (exposure.camera_id, exposure.width, exposure.height, exposure.region, exposure.stride)
    return Request(number, poses, asked)


def random_requests(count: int) -> tuple[list[Any], list[Request]]:
    """Models and requests of random scenes."""
    models = []
    requests = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        models.append(_scene(rng))
        data = mujoco.MjData(models[-1])
        mujoco.mj_forward(models[-1], data)
        left, top = rng.integers(-20, 150, 2)
        right = left + rng.integers(1, 180)
        bottom = top + rng.integers(1, 140)
        region = None if seed % 3 == 0 else (int(left), int(top), int(right), int(bottom))
        poses = {name: getattr(data, name).copy() for name in POSES}
        requests.append(Request(seed, poses, (0, 160, 120, region, int(rng.integers(1, 5)))))
    return models, requests


def _scene(rng: np.random.Generator) -> Any:
    """A scene with a floor and random shapes in front of a camera or around it."""
    spec = mujoco.MjSpec()
    hull = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    vertices = rng.normal(0.0, 0.1, (int(rng.integers(5, 60)), 3))
    spec.add_mesh(name="mesh", uservert=vertices.ravel(), userface=_faces(vertices), inertia=hull)
    distance = rng.choice([0.2, 0.6, 2.0])
    for kind in KINDS if rng.random() < 0.3 else KINDS[:-1]:
        geom: dict[str, Any] = {"type": getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")}
        if kind == "mesh":
            geom["meshname"] = kind
        else:
            geom["size"] = rng.uniform(0.02, 0.3, 3)
        spec.worldbody.add_geom(
            pos=rng.normal(0.0, 0.5 * distance, 3), quat=rng.normal(size=4),
            rgba=(*rng.random(3), 1.0), **geom,
        )  # fmt: skip
    floor = (0, 0, 0.1) if rng.random() < 0.5 else (*rng.uniform(0.2, 2.0, 2), 0.1)
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    turn = (1.0, *rng.normal(0.0, 0.2, 3))
    spec.worldbody.add_geom(type=plane, size=floor, pos=(0, 0, -0.5), quat=turn)
    for kind in (mujoco.mjtLightType.mjLIGHT_SPOT, mujoco.mjtLightType.mjLIGHT_DIRECTIONAL):
        place = rng.normal(0.0, 2.0, 3)
        along = rng.normal(size=3)
        spec.worldbody.add_light(type=kind, pos=place, dir=along, diffuse=rng.random(3))
    spec.worldbody.add_camera(
        pos=rng.normal(0.0, distance, 3), quat=rng.normal(size=4), fovy=rng.uniform(20.0, 90.0)
    )
    return spec.compile()


def _faces(vertices: Any) -> Any:
    """Outward triangles of the convex hull of vertices of shape (n, 3)."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(vertices)
    faces = []
    for simplex, plane in zip(hull.simplices, hull.equations, strict=True):
        a, b, c = vertices[simplex]
        faces.append(simplex if np.cross(b - a, c - a) @ plane[:3] > 0 else simplex[::-1])
    return np.array(faces).ravel()


def render_all(checkouts: Sequence[Path], models: Any, requests: Any) -> Iterator[tuple[Any, Any]]:
    """Images and CPU times, in ns, of each checkout."""
    with tempfile.TemporaryDirectory() as folder:
        asked = Path(folder) / "asked"
        answer = Path(folder) / "answer"
        asked.write_bytes(pickle.dumps((models, [tuple(request) for request in requests])))
        for checkout in checkouts:
            subprocess.run(
                [sys.executable, "-c", _DRAW, str(asked), str(answer)],
                cwd=checkout,
                env=os.environ | {"PYTHONPATH": str(checkout)},
                check=True,
            )
            yield pickle.loads(answer.read_bytes())  # noqa: S301 - written by our own process


def compare(name: str, before: Path, models: Any, requests: Any) -> int:
    """Print a line for some requests; returns the number of pixels that differ."""
    (old, old_ns), (new, new_ns) = render_all((before, ROOT), models, requests)
    pairs = zip(old, new, strict=True)
    different = sum(int((one != other).any(axis=2).sum()) for one, other in pairs)
    lit = sum(int(one.any(axis=2).sum()) for one in old)
    text = f"{name}: {len(requests)} pictures, {different} of {lit} pixels that are not black"
    text += f" differ; {np.mean(old_ns) / 1e6:.3f} ms -> {np.mean(new_ns) / 1e6:.3f} ms"
    print(f"{text}, {np.sum(old_ns) / np.sum(new_ns):.2f} times as fast", flush=True)
    return different


def main() -> int:
    """Print a line for the requests of the run, and one for the random scenes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("before")
    parser.add_argument("--tree", default="pick_and_track")
    parser.add_argument("--scenes", type=int, default=500)
    arguments = parser.parse_args()
    with checkout_of(arguments.before) as before:
        different = compare(arguments.tree, before, *requests_of_run(arguments.tree))
        different += compare("random scenes", before, *random_requests(arguments.scenes))
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
