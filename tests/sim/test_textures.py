"""Textures: one projection for every shape and renderer, and safely read images."""

from __future__ import annotations

import base64
import io
import itertools
import json
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
import PIL.Image
import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.errors import RendererError
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.export.mcap import drawn_shapes, textured_glb
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import check_record
from bt_dualarm.replay.stored_model import stored_model
from bt_dualarm.robots.mjspec import LOOP_GROUPS
from bt_dualarm.sim.frame import Exposure, Image, Renderer, Viewpoint
from bt_dualarm.sim.painter import ScenePainter
from bt_dualarm.sim.ray_trace_kernels import texel_at
from bt_dualarm.sim.renderers import RayRenderer, RayScene, Shading, choose_renderer, fan_of
from bt_dualarm.sim.skins import TEXTURE_PREFIX, image_coordinates, image_of, skins_of, surface_of
from bt_dualarm.sim.world import World
from bt_dualarm.skill.registry import Registry
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.texture import MOST_BYTES, TextureSpec
from bt_dualarm.spec.values import PoseSpec
from bt_dualarm.sweeps.inputs import inputs_of
from bt_dualarm.viewer.signals import visual_meshes
from tests.families import some
from tests.sim.test_mesh_objects import BRACKET, write_obj
from tests.sim.worlds import arm, file_of

YELLOW = (0.95, 0.85, 0.05)
BLUE = (0.05, 0.15, 0.80)
CHECKER = {"pattern": "checker", "color": "blue"}
AT = (0.5, -0.4, 0.6)


def object_of(shape: str, texture: dict[str, Any] | None, **fields: Any) -> ObjectSpec:
    data: dict[str, Any] = {"shape": shape, "mass": 0.1, "color": "yellow", "fixed": True}
    pose = PoseSpec(xyz=AT, rpy=fields.pop("rpy", (0.0, 0.0, 0.0)))
    return ObjectSpec.model_validate(data | {"pose": pose, "texture": texture} | fields)


def world_of(obj: ObjectSpec, folder: Path | None = None) -> World:
    file = file_of({"arm1": arm("ur3", xyz=(5.0, 0.0, 0.0))}, {"thing": obj})
    if folder is not None:
        obj.look_in(folder)
    return World(file)


def colors_at(world: World, points: Matrix, normal: Vector) -> Matrix:
    """Colors of points in the object's frame, seen along a normal from 0.5 m, of shape (n, 3).

    They are divided by the brightest channel, so that light does not matter.
    """
    still = mujoco.MjData(world.model)
    mujoco.mj_kinematics(world.model, still)
    mujoco.mj_camlight(world.model, still)
    pose = world.object_pose("thing")
    found = []
    scene = RayScene(world.model, LOOP_GROUPS)
    shading = Shading(world.model)
    for point in points:
        target = pose.apply(point)
        shift = np.array((1e-5, 2e-5, 0.0))  # a viewpoint cannot look straight down
        eye = target + 0.5 * pose.rotation_matrix @ normal + shift
        fan = fan_of(Viewpoint(eye, target, 0.01), 1, 1)
        pixel = shading.colors(still, fan, scene.trace(still, fan))[0, 0].astype(float)
        found.append(pixel / max(pixel.max(), 1.0))
    return np.array(found)


def is_blue(world: World, points: list[tuple[float, float, float]], normal: Vector) -> list[bool]:
    colors = colors_at(world, np.array(points), normal)
    return [bool(color[2] > color[0]) for color in colors]


X, Y, Z = np.eye(3)


def test_checker_on_a_box_starts_at_the_center_of_each_side() -> None:
    """Squares of 2 cm meet at the center; the upper left one has the second color."""
    world = world_of(object_of("box", CHECKER, size=(0.1, 0.1, 0.1), rpy=(10.0, 20.0, 30.0)))
    for normal, right, up in (
        (X, Y, Z),
        (-X, -Y, Z),
        (Y, -X, Z),
        (-Y, X, Z),
        (Z, X, Y),
        (-Z, X, -Y),
    ):
        corners = [
            tuple((0.05 * normal + 0.01 * (a * right + b * up)).tolist())
            for a, b in ((-1, 1), (1, 1), (1, -1), (-1, -1), (3, 1), (3, -1), (-3, 3))
        ]
        assert is_blue(world, corners, normal) == [True, False, True, False, True, False, True]


def test_stripes_are_vertical_on_a_cylinder() -> None:
    stripes = {"pattern": "stripes", "color": "blue", "size": 0.01}
    world = world_of(object_of("cylinder", stripes, size=(0.05, 0.2)))
    for height in (-0.08, 0.0, 0.08):
        places = [(np.sqrt(0.05**2 - y**2), y, height) for y in (-0.015, -0.005, 0.005, 0.015)]
        assert is_blue(world, places, X) == [True, False, True, False]
    tops = [(x, 0.0, 0.1) for x in (-0.035, -0.025, -0.015, -0.005, 0.005)]
    assert is_blue(world, tops, Z) == [True, False, True, False, True]


def test_dots_on_a_sphere_are_round_where_it_faces_an_axis() -> None:
    dots = {"pattern": "dots", "color": "blue", "size": 0.04}
    world = world_of(object_of("sphere", dots, size=(0.1,)))
    for normal, right, up in ((X, Y, Z), (-Y, X, Z), (Z, X, Y)):
        for out, expected in (
            (0.0, True),
            (0.0115, True),
            (0.0135, False),
            (0.0265, False),
            (0.0285, True),
        ):
            flat = [out * (np.cos(turn) * right + np.sin(turn) * up) for turn in (0.0, np.pi / 2)]
            places = [tuple((f + np.sqrt(0.01 - f @ f) * normal).tolist()) for f in flat]
            assert is_blue(world, places, normal) == [expected] * 2, (normal, out)


def test_texture_is_projected_on_a_mesh_as_a_whole(tmp_path: Path) -> None:
    """Its convex parts share one pattern, from the center of its bounding box."""
    write_obj(tmp_path / "bracket.obj", BRACKET)
    texture = {"pattern": "checker", "color": "blue", "size": 0.01}
    obj = object_of("mesh", texture, file="bracket.obj", scale=0.001)
    world = world_of(obj, tmp_path)
    assert len([*world.object_geoms("thing")]) == 2
    # The side at -y of both plates: 80 x 60 mm with the center of the bounding box at z = 0.
    places = [(0.035, -0.015, z) for z in (-0.025, -0.015, -0.005, 0.005, 0.015, 0.025)]
    assert is_blue(world, places, -Y) == [False, True, False, True, False, True]
    along = [(x, -0.015, -0.025) for x in (-0.035, -0.025, -0.015, 0.015, 0.025, 0.035)]
    assert is_blue(world, along, -Y) == [True, False, True, False, True, False]


PARTS = {
    "body": {"shape": "box", "size": (0.1, 0.1, 0.04)},
    "lid": {
        "shape": "box",
        "size": (0.04, 0.04, 0.1),
        "pose": {"xyz": (0.0, 0.0, 0.07), "rpy": (0.0, 0.0, 90.0)},
        "color": "red",
        "texture": {"pattern": "stripes", "color": "blue", "size": 0.01},
    },
}


def test_part_has_its_own_texture_or_that_of_the_compound() -> None:
    world = world_of(object_of("compound", CHECKER, parts=PARTS))
    body = [(-0.01, 0.04, 0.02), (0.01, 0.04, 0.02)]
    assert is_blue(world, body, Z) == [True, False]
    # The lid is turned by 90°: its stripes change along the compound's y axis.
    lid = [(x, y, 0.12) for y in (-0.015, -0.005, 0.005, 0.015) for x in (-0.01, 0.01)]
    assert is_blue(world, lid, Z) == [True, True, False, False, True, True, False, False]
    assert colors_at(world, np.array([lid[2]]), Z)[0] == pytest.approx((1, 0.06, 0.06), abs=0.02)


def labeled(folder: Path, pixels: npt.NDArray[np.uint8], name: str = "label.png") -> str:
    PIL.Image.fromarray(pixels).save(folder / name)
    return name


def quarters() -> npt.NDArray[np.uint8]:
    """White, red over green, transparent: each a quarter of 8 x 4 pixels."""
    pixels = np.zeros((4, 8, 4), np.uint8)
    pixels[:2, :4] = 255
    pixels[:2, 4:] = (255, 0, 0, 255)
    pixels[2:, :4] = (0, 255, 0, 255)
    return pixels


@pytest.mark.parametrize("size", [None, 0.04])
def test_image_covers_each_side_or_repeats(tmp_path: Path, size: float | None) -> None:
    """It is upright on the sides; the color shows through transparent pixels."""
    texture = {"image": labeled(tmp_path, quarters()), "size": size}
    obj = object_of("box", texture, size=(0.12, 0.06, 0.2))
    world = world_of(obj, tmp_path)
    a, b = (0.03, 0.05) if size is None else (0.01, 0.005)
    places = [(a * x, -0.03, b * z) for z in (1, -1) for x in (-1, 1)]
    expected = [(1, 1, 1), (1, 0, 0), (0, 1, 0), (1, 0.9, 0.05)]
    assert colors_at(world, np.array(places), -Y) == pytest.approx(np.array(expected), abs=0.03)
    if size is not None:  # one copy to the right, its height by the image's: 20 mm
        again = np.add(places, (0.04, 0.0, 0.02))
        assert colors_at(world, again, -Y) == pytest.approx(np.array(expected), abs=0.03)


SHAPES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("box", {"size": (0.1, 0.08, 0.06)}),
    ("cylinder", {"size": (0.05, 0.12)}),
    ("capsule", {"size": (0.04, 0.08)}),
    ("sphere", {"size": (0.06,)}),
    ("ellipsoid", {"size": (0.12, 0.08, 0.1)}),
    ("prism", {"size": (0.05, 0.1), "sides": 5}),
    ("cup", {"size": (0.05, 0.1)}),
    ("bin", {"size": (0.12, 0.1, 0.06)}),
)


@pytest.mark.parametrize(("shape", "fields"), SHAPES, ids=[name for name, _ in SHAPES])
def test_texture_coordinates_of_triangles_agree_with_rays(
    shape: str, fields: dict[str, Any]
) -> None:
    """OpenGL and exports use coordinates of the image at triangles, the ray caster a kernel."""
    world = world_of(object_of(shape, CHECKER, **fields, rpy=(20.0, 10.0, 40.0)))
    skins = skins_of(world.model)
    assert skins is not None
    for skin, geom in enumerate(skins.geoms.tolist()):
        surface = surface_of(world.model, geom)
        assert surface is not None
        # The surface is closed and its triangles are counterclockwise from outside.
        sides = surface.points[:, 1:] - surface.points[:, :1]
        areas = 0.5 * np.cross(sides[:, 0], sides[:, 1])
        assert np.abs(areas.sum(axis=0)).max() < 1e-9
        assert (np.einsum("ij,ikj->ik", areas, surface.normals) > -1e-12).all()
        corners = image_coordinates(skins, skin, surface)
        turn = skins.turns[skin]
        # Slightly inside of the corners, where no texel ends.
        for weights in ((0.5, 0.3, 0.2), (0.9, 0.07, 0.03), (0.1, 0.2, 0.7)):
            points = np.einsum("k,nkj->nj", weights, surface.points) @ turn.T + skins.shifts[skin]
            normals = surface.normals.mean(axis=1) @ turn.T
            u, v = np.einsum("k,nkj->nj", weights, corners).T
            clear = (np.abs((2 * u) % 1 - 0.5) < 0.49) & (np.abs((2 * v) % 1 - 0.5) < 0.49)
            both = zip(points.tolist(), normals.tolist(), strict=True)
            texels = [texel_at(skins, skin, *point, *normal) for point, normal in both]
            start = skins.images[skin, 0]
            rows = (np.floor(2 * v).astype(int) % 2)[clear]
            columns = (np.floor(2 * u).astype(int) % 2)[clear]
            assert (np.array(texels)[clear] == start + 2 * rows + columns).all()


def images_of(world: World, size: tuple[int, int] = (160, 120)) -> Image:
    data = mujoco.MjData(world.model)
    mujoco.mj_kinematics(world.model, data)
    mujoco.mj_camlight(world.model, data)
    eye = np.add(AT, (0.25, -0.3, 0.25))
    return ScenePainter(world.model).draw(data, Viewpoint(eye, np.array(AT), 35.0), size)


@pytest.fixture(scope="module")
def opengl() -> Iterator[Renderer]:
    """OpenGL, if this machine has it."""
    try:
        renderer = choose_renderer("gl").create()
    except RendererError as error:
        pytest.skip(str(error))
    yield renderer
    renderer.close()


@pytest.mark.parametrize(("shape", "fields"), some(SHAPES, 3))
def test_opengl_agrees_with_rays(shape: str, fields: dict[str, Any], opengl: Renderer) -> None:
    camera = {"mount": PoseSpec(xyz=(0.5, -0.8, 0.85), rpy=(-122.0, 0.0, 0.0)), "fov": 25}
    files = file_of(
        {"arm1": arm("ur3", xyz=(5.0, 0.0, 0.0), camera=camera | {"resolution": (320, 240)})},
        {"thing": object_of(shape, CHECKER, **fields, rpy=(0.0, 0.0, 25.0))},
    )
    world = World(files)
    shots = []
    data = mujoco.MjData(world.model)
    mujoco.mj_forward(world.model, data)
    exposure = Exposure(world.model.camera("arm1/camera").id, 320, 240)
    for one in (RayRenderer(), opengl):
        image = one.render(world.model, data, exposure).astype(int)
        shots.append((image[..., 2] - image[..., 0] > 40, image[..., 0] - image[..., 2] > 40))
    (blue, yellow), (gl_blue, gl_yellow) = shots
    assert min(blue.sum(), yellow.sum()) > 500
    wrong = (blue & gl_yellow) | (yellow & gl_blue)
    assert wrong.sum() < 0.04 * (blue | yellow).sum()  # pixels on edges


def test_textures_appear_in_images_for_users_and_the_browser_view() -> None:
    world = world_of(object_of("capsule", CHECKER, size=(0.04, 0.08)))
    image = images_of(world).astype(int)
    assert (image[..., 2] - image[..., 0] > 40).sum() > 200
    assert (image[..., 0] - image[..., 2] > 40).sum() > 200
    looks = visual_meshes(world.model, {})
    drawn = [shape for shape in looks.shapes if "texture" in shape]
    assert [shape["name"] for shape in drawn] == ["tube", "sphere", "sphere"]
    ((name, url),) = looks.textures.items()
    assert {shape["texture"]["image"] for shape in drawn} == {name}
    content = base64.b64decode(url.removeprefix("data:image/png;base64,"))
    pixels = np.asarray(PIL.Image.open(io.BytesIO(content)))
    assert pixels.shape == (2, 2, 3)
    assert pixels[0, 0] == pytest.approx(255 * np.array(BLUE), abs=1)
    # The upper hemisphere is 4 cm above the center.
    place = np.array(drawn[1]["texture"]["place"]).reshape(4, 4).T
    assert place @ (0, 0, 1, 1) == pytest.approx((0, 0, 0.08, 1), abs=1e-6)


def test_exported_model_contains_the_image_and_its_coordinates() -> None:
    world = world_of(object_of("box", CHECKER, size=(0.1, 0.1, 0.1)))
    (shape,) = [one for one in drawn_shapes(world.model, {}) if one.body == "thing"]
    assert shape.textured is not None
    content = textured_glb(shape.textured)
    length = struct.unpack_from("<I", content, 12)[0]
    document = json.loads(content[20 : 20 + length])
    binary = content[28 + length :]
    assert document["buffers"][0]["byteLength"] == len(binary)
    views = [binary[v["byteOffset"] :][: v["byteLength"]] for v in document["bufferViews"]]
    image = np.asarray(PIL.Image.open(io.BytesIO(views[3])))
    places = np.frombuffer(views[2], "<f4").reshape(-1, 2)
    assert (places.min(), places.max()) == pytest.approx((-0.75, 1.75))  # 5 squares of 2 cm
    assert image[0, 0] == pytest.approx(255 * np.array(BLUE), abs=1)
    # Without a texture the shape stays a primitive.
    plain = world_of(object_of("box", None, size=(0.1, 0.1, 0.1)))
    (shape,) = [one for one in drawn_shapes(plain.model, {}) if one.body == "thing"]
    assert shape.textured is None
    assert plain.model.nuser_geom == 0


def test_textures_change_only_the_appearance() -> None:
    plain = world_of(object_of("cup", None, size=(0.05, 0.1))).model
    textured = world_of(object_of("cup", CHECKER, size=(0.05, 0.1))).model
    for name in ("qpos0", "body_mass", "body_inertia", "geom_pos", "geom_quat", "geom_size",
                 "geom_friction", "mesh_vert", "geom_contype", "geom_conaffinity"):  # fmt: skip
        assert (getattr(plain, name) == getattr(textured, name)).all(), name


def test_removed_object_leaves_no_image() -> None:
    obj = object_of("box", CHECKER, size=(0.1, 0.1, 0.1))
    elsewhere = {"pose": PoseSpec(xyz=(0.0, -0.5, 0.6))}
    other = obj.model_copy(update=elsewhere)
    world = World(
        file_of({"arm1": arm("ur3", xyz=(5.0, 0.0, 0.0))}, {"thing": obj, "other": other})
    )

    def images() -> list[str]:
        names = [str(world.model.texture(number).name) for number in range(world.model.ntex)]
        return [name for name in names if name.startswith(TEXTURE_PREFIX)]

    assert len(images()) == 1  # both share it
    world.remove_object("other")
    assert len(images()) == 1
    world.remove_object("thing")
    assert not images()


def test_marker_stays_above_the_texture() -> None:
    plain, textured = (
        world_of(object_of("box", texture, size=(0.1, 0.1, 0.1), marker={"id": 3, "size": 0.05}))
        for texture in (None, CHECKER)
    )
    places = [(x, y, 0.0504) for x, y in itertools.product((-0.03, -0.01, 0.01, 0.03), repeat=2)]
    one, other = (colors_at(world, np.array(places), Z) for world in (plain, textured))
    assert one == pytest.approx(other, abs=1e-9)


# Records, and untrusted files


def tree_with(texture: dict[str, Any]) -> dict[str, Any]:
    return {
        "bt_dualarm": 1,
        "name": "label",
        "world": {"scene": "table", "reality": "lab", "time_limit": 5},
        "objects": {
            "box": {
                "shape": "box", "size": [0.1, 0.1, 0.1], "mass": 0.3, "color": "yellow",
                "pose": {"xyz": [0.4, -0.4, 0.45]}, "texture": texture,
            }
        },
        "arms": {"arm1": {"robot": "ur5", "base": {"xyz": [0, 0.2, 0.4]},
                          "tree": {"wait": {"seconds": 0.2}}}},
    }  # fmt: skip


@pytest.mark.usefixtures("without_plots")
def test_record_can_be_replayed_without_the_image_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / labeled(tmp_path, quarters())
    results = [bt.run(tree_with({"image": "label.png"}), record=name) for name in ("a", "b")]
    assert results[0].state_sha256 == results[1].state_sha256 != ""
    file.unlink()
    record = Record.read(tmp_path / "a")
    check = check_record(record, Registry.load())
    assert check.agrees
    assert any("label.png" in one and "has changed" in one for one in check.changed)
    model = record.model(0)
    skins = skins_of(model)
    assert skins is not None
    assert (image_of(skins, 0)[:2, :4] == 255).all()


def test_changed_image_is_another_trial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    def identity() -> dict[str, str]:
        file = load_tree_file(tree_with({"image": "label.png"}))
        return dict(inputs_of(file.texts.values(), file, ()))

    labeled(tmp_path, quarters())
    first = identity()
    assert identity() == first
    labeled(tmp_path, quarters()[::-1])
    assert identity()["tree"] != first["tree"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nothing.png", "does not exist"),
        ("folder.png", "is not a regular file"),
        ("text.png", "is not a PNG or JPEG image"),
        ("half.png", "is not a PNG or JPEG image"),
        ("gif.png", "is not a PNG or JPEG image"),
        ("wide.png", "has 2000 x 1000 pixels; at most 1048576"),
        ("bomb.png", "has too many pixels; at most 1048576"),
        ("deep.png", "more than 8 bits"),
        ("heavy.png", "has 2.1 MB; the maximum is 2 MB"),
        ("link.png", "is a link to a place outside"),
        ("../label.png", "is not below the folder"),
    ],
)
def test_unusable_image_is_an_error_with_its_location(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, message: str
) -> None:
    folder = tmp_path / "own"
    folder.mkdir()
    monkeypatch.chdir(folder)
    labeled(folder, quarters(), "good.png")
    labeled(tmp_path, quarters())
    (folder / "folder.png").mkdir()
    (folder / "link.png").symlink_to(tmp_path / "label.png")
    (folder / "text.png").write_text("a label", encoding="utf-8")
    (folder / "half.png").write_bytes((folder / "good.png").read_bytes()[:70])
    (folder / "heavy.png").write_bytes(
        (folder / "good.png").read_bytes() + bytes(MOST_BYTES + 10**5)
    )
    PIL.Image.fromarray(quarters()).convert("RGB").save(folder / "gif.png", format="GIF")
    PIL.Image.new("L", (2000, 1000)).save(folder / "wide.png")
    PIL.Image.fromarray(np.zeros((4, 4), np.uint16)).save(folder / "deep.png")
    bomb = bytearray((folder / "good.png").read_bytes())
    bomb[16:24] = struct.pack(">II", 100_000, 100_000)
    bomb[29:33] = struct.pack(">I", zlib.crc32(bytes(bomb[12:29])))
    (folder / "bomb.png").write_bytes(bytes(bomb))
    found = bt.check(tree_with({"image": name}))
    assert [problem for problem in found if message in problem.message], found
    assert found[0].place.keys == "objects.box.texture.image"


def test_total_size_of_images_is_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    tree = tree_with({"pattern": "dots"})
    for number in range(9):
        PIL.Image.new("L", (1024, 1024), number).save(f"{number}.png")
        pose = {"xyz": [0.2 * number, -3.0, 0.05]}
        texture = {"image": f"{number}.png"}
        box = {"shape": "box", "size": [0.1, 0.1, 0.1], "mass": 1, "pose": pose}
        tree["objects"][f"box{number}"] = box | {"texture": texture}
    (problem,) = bt.check(tree)
    assert "with it, the images have 9.0 million pixels" in problem.message


def test_damaged_texture_in_a_record_is_harmless() -> None:
    """User data of a geom may be any numbers; sizes of zero would divide by zero."""
    world = world_of(object_of("box", CHECKER, size=(0.1, 0.1, 0.1)))
    model = world.model
    geom = model.geom("thing").id
    good = model.geom_user[geom].copy()
    pairs = itertools.product(range(13), (0.0, -1.0, 1e-300, 1e9, np.inf, np.nan))
    for index, value in some(pairs, 5):  # all indices and all values
        model.geom_user[geom] = good
        model.geom_user[geom, index] = value
        images_of(world, (16, 12))  # does not crash
    model.geom_user[geom] = good
    kept = stored_model(stored(model))
    assert skins_of(kept) is not None
    model.geom_user[geom, 0] = np.nan
    with pytest.raises(ValueError, match="geom_user"):
        stored_model(stored(model))


def stored(model: mujoco.MjModel) -> bytes:
    content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return content.tobytes()


def test_size_of_a_tile_follows_from_its_pattern() -> None:
    for pattern, cells in (("checker", (2, 2)), ("stripes", (2, 1)), ("dots", (1, 1))):
        texture = TextureSpec.model_validate({"pattern": pattern, "size": 0.03})
        size = texture.tile(YELLOW).size
        assert size == pytest.approx((0.03 * cells[0], 0.03 * cells[1]))
