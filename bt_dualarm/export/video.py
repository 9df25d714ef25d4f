"""Export of a record as a video: the scene, wrist cameras, and the behavior trees next to it."""

from __future__ import annotations

import subprocess
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryFile
from typing import Final, Self, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.core.share import beside, refuse_special, write_atomically
from bt_dualarm.replay.record import Facts, Moment, Record, ReplayError
from bt_dualarm.replay.timeline import Change, Timeline, TimelineNode
from bt_dualarm.robots.mjspec import OBJECT_GROUP, SCENE_GROUP, TOOL_SITE
from bt_dualarm.sim.frame import Exposure, Viewpoint, fitted
from bt_dualarm.sim.painter import ScenePainter, StillRenderer, best_viewpoint
from bt_dualarm.sim.renderers import RayRenderer

RGB: TypeAlias = tuple[int, int, int]

ARM_COLORS: Final[tuple[RGB, ...]] = (
    (255, 176, 0),
    (30, 136, 229),
    (67, 190, 90),
    (216, 27, 96),
    (142, 90, 220),
    (0, 172, 193),
)
"""Colors of the arms and of the paths of their tools, in the order of the file."""

BORDER: Final[RGB] = (24, 28, 36)
PAPER: Final[RGB] = (250, 250, 248)
INK: Final[RGB] = (28, 32, 40)
FAINT: Final[RGB] = (150, 155, 163)

STATUS: Final[dict[str, tuple[str, RGB]]] = {
    "INVALID": ("·", FAINT),
    "RUNNING": ("▶", (190, 110, 0)),
    "SUCCESS": ("✔", (24, 128, 56)),
    "FAILURE": ("✘", (200, 30, 40)),
    "HALTED": ("■", (110, 115, 125)),
}
"""Mark and color of each status, as on the terminal."""


@cache
def font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """A font with the marks of all statuses: DejaVu Sans, which matplotlib includes."""
    import matplotlib as mpl

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(mpl.get_data_path()) / "fonts" / "ttf" / name), size)


# Scene: antialiased, with shadows, the recent paths of the tools, and wrist cameras


FINER: Final = 2
"""Rays per pixel along each axis, for antialiasing."""

_TRAIL_S: Final = 3.0
_FADING: Final = 12
"""Segments of a trail, older ones fainter."""

INSET: Final = 0.27
"""Width of a wrist camera's image as a fraction of the scene's."""

_FRESH_S: Final = 0.2


@dataclass(frozen=True, eq=False)
class _World:
    """One compiled model, ready to be rendered."""

    model: mujoco.MjModel
    data: mujoco.MjData
    painter: ScenePainter

    @classmethod
    def of(cls, model: mujoco.MjModel) -> _World:
        return cls(model, mujoco.MjData(model), ScenePainter(model))


@dataclass(eq=False)
class FilmScene:
    """Renders moments of a record, in chronological order.

    Attributes:
        record: The record.
        size: Width and height of the image in pixels.
        at_left: Whether the camera images are at the left.
        at_top: Whether they are at the top.
    """

    record: Record
    size: tuple[int, int]
    at_left: bool = True
    at_top: bool = False
    _worlds: dict[int, _World] = field(default_factory=dict)
    _trails: dict[tuple[str, int], deque[tuple[float, Vector]]] = field(default_factory=dict)
    _looks: dict[str, list[Facts]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._eyes = RayRenderer()
        for arm in self.record.arms:
            own = (note for note in self.record.notes if note["arm"] == arm)
            self._looks[arm] = [note for note in own if note["kind"] == "look"]

    def draw(self, moment: Moment, viewpoint: Viewpoint) -> Image.Image:
        """Render the image of one moment."""
        world = self._at(moment)
        width, height = (FINER * side for side in self.size)
        image = Image.fromarray(world.painter.draw(world.data, viewpoint, (width, height), FINER))
        self._draw_trails(image, moment, world, viewpoint)
        image = image.resize(self.size, Image.Resampling.BOX)
        self._draw_insets(image, moment, world)
        return image

    def _at(self, moment: Moment) -> _World:
        if moment.generation not in self._worlds:
            self._worlds = {moment.generation: _World.of(self.record.model(moment.generation))}
        world = self._worlds[moment.generation]
        world.data.qpos[:] = moment.qpos
        mujoco.mj_kinematics(world.model, world.data)
        mujoco.mj_camlight(world.model, world.data)
        return world

    def _draw_trails(
        self, image: Image.Image, moment: Moment, world: _World, viewpoint: Viewpoint
    ) -> None:
        draw = ImageDraw.Draw(image, "RGBA")
        for arm, color in zip(self.record.arms, ARM_COLORS * 9, strict=False):
            # A trail ends with the stay of its arm: spawned again, the tool is elsewhere at once.
            life = self.record.lives(arm, moment.generation)
            trail = self._trails.setdefault((arm, life), deque())
            site = mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_SITE, f"{arm}/{TOOL_SITE}")
            if site >= 0:
                trail.append((moment.time, world.data.site_xpos[site].copy()))
            while trail and trail[0][0] < moment.time - _TRAIL_S:
                trail.popleft()
            if len(trail) > 1:
                points = np.array([point for _, point in trail])
                _faded(draw, viewpoint.pixels(points, *image.size), color)

    def _draw_insets(self, image: Image.Image, moment: Moment, world: _World) -> None:
        """Images of the wrist cameras, with a circle around the target of a tracker."""
        at = margin = round(0.02 * self.size[0])
        for arm, facts in self.record.arms.items():
            camera = mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_CAMERA, f"{arm}/camera")
            if camera >= 0 and facts.get("camera"):
                columns, rows = facts["camera"]["resolution"]
                width = round(INSET * self.size[0])
                height = round(width * rows / columns)
                exposure = Exposure(camera, FINER * width, FINER * height)
                seen = Image.fromarray(self._eyes.render(world.model, world.data, exposure))
                self._mark(seen, arm, moment.time, seen.size[0] / columns)
                seen = seen.resize((width, height), Image.Resampling.BOX)
                x = at if self.at_left else self.size[0] - at - width
                y = margin if self.at_top else self.size[1] - height - margin
                _framed(image, seen, (x, y), f"{arm}  camera")
                at += width + margin

    def _mark(self, seen: Image.Image, arm: str, time: float, scale: float) -> None:
        looks = [n for n in self._looks[arm] if time - _FRESH_S < n["time_s"] <= time]
        if looks and looks[-1]["pixel"] is not None:
            x, y = (scale * each for each in looks[-1]["pixel"])
            radius = scale * (looks[-1]["area_px"] / np.pi) ** 0.5 * 1.5 + 4.0
            color = (60, 220, 90) if looks[-1]["locked"] else (255, 170, 0)
            box = (x - radius, y - radius, x + radius, y + radius)
            ImageDraw.Draw(seen).ellipse(box, outline=color, width=2 * FINER)


def _faded(draw: ImageDraw.ImageDraw, pixels: Matrix, color: RGB) -> None:
    """Draw a line that fades toward its start."""
    cuts = np.linspace(0, len(pixels) - 1, min(_FADING, len(pixels) - 1) + 1).astype(int)
    for number, (first, last) in enumerate(pairwise(cuts), 1):
        piece = [(float(x), float(y)) for x, y in pixels[first : last + 1]]
        alpha = round(230 * number / (len(cuts) - 1))
        draw.line(piece, fill=(*color, alpha), width=3 * FINER, joint="curve")


def _framed(image: Image.Image, seen: Image.Image, corner: tuple[int, int], text: str) -> None:
    """Paste an image with a thin border and a caption in its corner."""
    x, y = corner
    draw = ImageDraw.Draw(image, "RGBA")
    draw.rectangle((x - 2, y - 2, x + seen.width + 1, y + seen.height + 1), fill=(*BORDER, 255))
    image.paste(seen, corner)
    letters = font(max(11, seen.width // 20))
    box = draw.textbbox((x + 7, y + 5), text, font=letters)
    draw.rectangle((x, y, box[2] + 7, box[3] + 5), fill=(*BORDER, 190))
    draw.text((x + 7, y + 5), text, fill=(255, 255, 255), font=letters)


_STILLS: Final = 7
"""Number of moments by which the viewing direction is chosen."""

_EVERY_S: Final = 0.2
_CALM_S: Final = 1.5
"""Standard deviation in s of the Gaussian that smooths the camera's motion."""

_NEAR: Final = 0.2
"""Closeness of the view: 0 always shows the whole cell, 1 only what moves."""

_AT_HAND_M: Final = 0.35


def followed(record: Record, times: Sequence[float], aspect: float) -> list[Viewpoint]:
    """Viewpoints over time: from one direction, and closer to the moving parts.

    Args:
        record: The record.
        times: Simulated times in s, ascending.
        aspect: Width of the image over its height.

    Raises:
        ReplayError: The record shows no arm or object.
    """
    stills = [_still(record, time) for time in np.linspace(times[0], times[-1], _STILLS).tolist()]
    whole = best_viewpoint(stills, aspect)
    if whole is None:
        raise ReplayError(f"{record.folder} contains nothing to render: no arm, no object")
    knots = np.arange(times[0], times[-1] + _EVERY_S, _EVERY_S)
    desired = np.array([_wanted(_still(record, time), whole, aspect) for time in knots.tolist()])
    weights = np.exp(-0.5 * ((knots[:, None] - knots[None]) / _CALM_S) ** 2)
    smoothed = weights @ desired / weights.sum(axis=1, keepdims=True)
    columns = [np.interp(times, knots, column) for column in smoothed.T]
    return [
        Viewpoint(row[:3], row[3:], whole.fov_deg) for row in np.column_stack(columns).astype(float)
    ]


def clear_corner(
    record: Record, times: Sequence[float], viewpoints: Sequence[Viewpoint], aspect: float
) -> tuple[bool, bool]:
    """The corner of the image that covers least; whether it is at the left, and at the top.

    Args:
        record: The record.
        times: Simulated times in s.
        viewpoints: Viewpoint of each time.
        aspect: Width of the picture by its height.
    """
    found = np.zeros((2, 2))
    for place in np.linspace(0, len(times) - 1, _STILLS).astype(int).tolist():
        still = _still(record, times[place])
        own = still.model.geom_group != SCENE_GROUP
        x, y = viewpoints[place].pixels(still.corners(own), 1000, round(1000 / aspect)).T
        share = INSET * 1000 * 1.1
        for left in (False, True):
            for top in (False, True):
                across = x < share if left else x > 1000 - share
                along = y < share if top else y > 1000 / aspect - share
                found[int(left), int(top)] += np.count_nonzero(across & along)
    order = [(True, False), (False, False), (True, True), (False, True)]
    return min(order, key=lambda corner: float(found[int(corner[0]), int(corner[1])]))


def _still(record: Record, time: float) -> StillRenderer:
    moment = record.moment(record.index_at(min(time, record.until)))
    return StillRenderer(record.model(moment.generation), moment.qpos, moment.time)


def _wanted(still: StillRenderer, whole: Viewpoint, aspect: float) -> Matrix:
    """Camera position and target, of shape (6,), m, between those of the cell and of the action."""
    points = still.corners(_work(still))
    if not len(points):
        return np.concatenate((whole.eye, whole.look_at))
    near = fitted(points, whole.eye - whole.look_at, whole.fov_deg, aspect)
    far = np.concatenate((whole.eye, whole.look_at))
    wanted: Matrix = far + _NEAR * (np.concatenate((near.eye, near.look_at)) - far)
    return wanted


def _work(still: StillRenderer) -> npt.NDArray[np.bool_]:
    """Mask of the geoms of the action: the outer halves of the arms, and objects at their tools."""
    model = still.model
    data = still.data
    names = [model.body(body).name for body in model.geom_bodyid]
    sites = [s for s in range(model.nsite) if model.site(s).name.endswith(f"/{TOOL_SITE}")]
    tools = data.site_xpos[sites]
    outer = {
        model.body(body).name
        for site in sites
        for body in _outer_half(model, int(model.site_bodyid[site]))
    }
    at_hand = np.zeros(model.ngeom, bool)
    if len(tools):
        away = np.linalg.norm(data.geom_xpos[:, None] - tools[None], axis=2).min(axis=1)
        at_hand = (model.geom_group == OBJECT_GROUP) & (away < _AT_HAND_M)
    found: npt.NDArray[np.bool_] = at_hand | np.array([name in outer for name in names], bool)
    return found


def _outer_half(model: mujoco.MjModel, tip: int) -> list[int]:
    """Bodies from the tool to the middle of its arm."""
    chain = [tip]
    while model.body_parentid[chain[-1]]:
        chain.append(int(model.body_parentid[chain[-1]]))
    return chain[: -(-len(chain) // 2)]


_SIZES: Final = (19, 18, 17, 16, 15, 14, 13, 12, 11, 10)
_MOST_REASON_LINES: Final = 3
_INDENT: Final = 1.3
"""Indentation of a child, in letter heights."""


@dataclass(frozen=True)
class _PanelLine:
    """One line: indentation, mark, text, and the text at its right end."""

    depth: int
    mark: str
    text: str
    color: RGB
    bold: bool = False
    end: str = ""
    lit: bool = False


@dataclass(eq=False)
class FilmPanel:
    """Renders the behavior trees of a record.

    Attributes:
        record: The record.
        size: Width and height of the panel in pixels.
    """

    record: Record
    size: tuple[int, int]
    _letters: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._timeline = Timeline(self.record)
        room = self.size[1] - 110 / self._scale
        for size in _SIZES:
            self._letters = round(size / self._scale)
            whole = len([*self._lines(self.record.until, folded=False)])
            self._folded = whole * size * 1.6 >= room * self._scale
            if not self._folded:
                break

    @property
    def _scale(self) -> float:
        """Scale of the layout, which is designed for a width of 400 pixels."""
        return 400.0 / self.size[0]

    @property
    def _margin(self) -> int:
        return round(20 / self._scale)

    def draw(self, time: float) -> Image.Image:
        """Render the panel at a time in s."""
        image = Image.new("RGB", self.size, PAPER)
        draw = ImageDraw.Draw(image)
        margin = self._margin
        title = font(round(22 / self._scale), bold=True)
        small = font(round(18 / self._scale))
        draw.text((margin, margin), self.record.name, fill=INK, font=title)
        label = f"{time:.1f} s"
        right = self.size[0] - margin
        draw.text((right, margin + title.size // 6), label, fill=FAINT, font=small, anchor="ra")
        self._draw_bar(draw, time, margin + round(34 / self._scale), margin, right)
        y = margin + round(52 / self._scale)
        for line in self._lines(time, folded=self._folded):
            y = self._write(draw, line, y, margin, right)
            if y > self.size[1] - margin:
                break
        return image

    def _draw_bar(
        self, draw: ImageDraw.ImageDraw, time: float, y: int, left: int, right: int
    ) -> None:
        share = min(1.0, time / max(self.record.until, 1e-9))
        draw.rectangle((left, y, right, y + 3), fill=(222, 224, 226))
        draw.rectangle((left, y, left + share * (right - left), y + 3), fill=INK)
        for event in self.record.events:
            if event["new"] == "FAILURE":
                x = left + event["time_s"] / max(self.record.until, 1e-9) * (right - left)
                draw.rectangle((x - 1, y - 3, x + 1, y + 6), fill=STATUS["FAILURE"][1])

    def _write(
        self, draw: ImageDraw.ImageDraw, line: _PanelLine, y: int, left: int, right: int
    ) -> int:
        """Draw a line; returns the position of the next one."""
        letters = font(self._letters, bold=line.bold)
        step = round(1.6 * self._letters)
        x = left + round(line.depth * _INDENT * self._letters)
        if line.lit:
            box = (x - 4, y - 1, right + 4, y + step - 3)
            draw.rounded_rectangle(box, radius=4, fill=(255, 240, 214))
        if line.mark:
            draw.text((x, y), line.mark, fill=line.color, font=letters)
            x += round(1.4 * self._letters)
        room = right - x - (draw.textlength(line.end, font=letters) + 8 if line.end else 0)
        text = line.text
        while len(text) > 1 and draw.textlength(text, font=letters) > room:
            text = f"{text[:-2]}…"
        draw.text((x, y), text, fill=line.color, font=letters)
        if line.end:
            draw.text((right, y), line.end, fill=line.color, font=letters, anchor="ra")
        return y + step

    def _lines(self, time: float, *, folded: bool) -> Iterator[_PanelLine]:
        for color, (arm, root) in zip(ARM_COLORS * 9, self._timeline.roots.items(), strict=False):
            yield _PanelLine(0, "", "", INK)
            robot = self.record.arms[arm]["robot"]
            yield _PanelLine(0, "●", f"{arm}   {robot}", color, bold=True)
            for line in _of_node(root, root.standing_at(time), 0, time, folded=folded):
                yield from [line] if line.mark else self._wrapped(line)

    def _wrapped(self, line: _PanelLine) -> list[_PanelLine]:
        """A reason in at most three lines, each as wide as the panel."""
        letters = font(self._letters)
        room = self.size[0] - 2 * self._margin - line.depth * _INDENT * self._letters
        texts = [""]
        for word in line.text.split():
            longer = f"{texts[-1]} {word}".strip()
            if texts[-1] and letters.getlength(longer) > room:
                texts.append(word)
            else:
                texts[-1] = longer
        if len(texts) > _MOST_REASON_LINES:
            texts[_MOST_REASON_LINES - 1] += " …"
        return [replace(line, text=text) for text in texts[:_MOST_REASON_LINES]]


def _of_node(
    node: TimelineNode, standing: Mapping[str, Change], depth: int, time: float, *, folded: bool
) -> Iterator[_PanelLine]:
    change = standing.get(node.path)
    status = "INVALID" if change is None else change.new
    if change is not None and (change.old, change.new) == ("RUNNING", "INVALID"):
        status = "HALTED"
    mark, color = STATUS[status]
    runs = change is not None and status == "RUNNING" and not node.children
    end = f"{time - change.time:.1f} s" if change is not None and runs else ""
    ink = INK if status == "SUCCESS" and node.children else color
    yield _PanelLine(depth, mark, node.path.rpartition("/")[2], ink, bold=runs, end=end, lit=runs)
    if change is not None and status == "FAILURE" and not node.children and change.reason:
        yield _PanelLine(depth + 1, "", change.reason, color)
    if not folded or status == "RUNNING":
        for child in node.children:
            yield from _of_node(child, standing, depth + 1, time, folded=folded)


Picture = npt.NDArray[np.uint8]

_PANEL: Final = 0.3125
"""Width of the trees' panel as a fraction of the image's."""

_MOST_BYTES: Final = 3 * 2**20
"""Largest size of an animation, bytes: what most web pages accept."""


@dataclass(frozen=True)
class Format:
    """Size and frame rate of a video.

    Attributes:
        width: Width in pixels, even.
        height: Height in pixels, even.
        fps: Frames per simulated second.
    """

    width: int
    height: int
    fps: int


FILM: Final = Format(1280, 720, 25)
ANIMATION: Final = Format(800, 450, 10)


def write_film(record: Record, path: Path) -> None:
    """Write a video in H.264; the file appears only when it is complete.

    Args:
        record: The record.
        path: File to write; its name ends with ``.mp4``.

    Raises:
        ReplayError: The record shows no arm or object, or imageio-ffmpeg is not installed.
        OSError: The file cannot be written.
    """
    refuse_special(path)
    half = beside(path, ".mp4")
    try:
        half.touch()
        with Encoder(half, (FILM.width, FILM.height), FILM.fps) as film:
            for picture in pictures(record, FILM):
                film.add(picture)
        half.replace(path)
    finally:
        half.unlink(missing_ok=True)


class Encoder:
    """Encodes images as H.264 (yuv420p), one by one, in a process of its own.

    An exception in its ``with`` block ends the process, with a file that is not complete.

    Args:
        path: File to write, which ends with ``.mp4``.
        size: Width and height in pixels, even.
        fps: Frames per second, a whole number.
        key_every: Interval of key frames, in frames.

    Raises:
        ReplayError: The package imageio-ffmpeg is not installed.
        OSError: The encoder cannot be started.
    """

    def __init__(self, path: Path, size: tuple[int, int], fps: int, key_every: int = 50) -> None:
        try:
            import imageio_ffmpeg
        except ImportError as error:
            message = "a film needs the package imageio-ffmpeg (the extra bt_dualarm[export])"
            raise ReplayError(message) from error
        width, height = size
        images = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(fps))
        coded = ("-vcodec", "libx264", "-pix_fmt", "yuv420p", "-crf", "25", "-g", str(key_every))
        program = imageio_ffmpeg.get_ffmpeg_exe()
        # The prefix, because ffmpeg takes what stands before a colon for a protocol.
        command = [program, "-v", "error", "-y", *images, "-i", "-", *coded, f"file:{path}"]
        self._messages = TemporaryFile()  # noqa: SIM115 - as long as the process
        self._process = subprocess.Popen(  # noqa: S603 - the package's program
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._messages,
            start_new_session=True,  # Ctrl-C is for this process, which then ends that one
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if kind is not None:
            self._process.kill()
            with suppress(OSError):
                self.close()
        else:
            self.close()

    def add(self, picture: Picture) -> None:
        """Add an image of shape (height, width, 3), red, green, blue.

        Raises:
            OSError: The file cannot be written, for instance because the disk is full.
        """
        assert self._process.stdin is not None  # noqa: S101 - a pipe
        try:
            self._process.stdin.write(np.ascontiguousarray(picture).tobytes())
        except BrokenPipeError:
            self.close()  # raises what the process said

    def close(self) -> None:
        """Finish the file; harmless when repeated.

        Raises:
            OSError: The file is not complete.
        """
        if self._messages.closed:
            return
        assert self._process.stdin is not None  # noqa: S101 - a pipe
        with suppress(BrokenPipeError):
            self._process.stdin.close()
        code = self._process.wait()
        with self._messages as file:
            file.seek(0)
            lines = file.read().decode(errors="replace").splitlines()
        if code:
            why = lines[0].rpartition("] ")[2] if lines else f"it ended with {code}"
            raise OSError(f"the encoder ffmpeg failed: {why}")


def write_animation(record: Record, path: Path) -> None:
    """Write an animated WebP of at most 3 MB, which needs no player.

    Args:
        record: The record.
        path: File to write; its name ends with ``.webp``.

    Raises:
        ReplayError: The record shows no arm or object.
        OSError: The file cannot be written there.
    """
    images = [Image.fromarray(picture) for picture in pictures(record, ANIMATION)]
    for quality in (70, 55, 40, 25, 10):
        content = BytesIO()
        images[0].save(
            content,
            "WEBP",
            save_all=True,
            append_images=images[1:],
            duration=round(1000 / ANIMATION.fps),
            loop=0,
            quality=quality,
            method=4,
        )
        if content.tell() <= _MOST_BYTES:
            break
    write_atomically(path, lambda file: file.write(content.getbuffer()))


def pictures(record: Record, form: Format) -> Iterator[Picture]:
    """Render the frames of the video, of shape (height, width, 3), red, green, blue.

    Raises:
        ReplayError: The record shows no arm or object.
    """
    if not len(record.times):
        raise ReplayError(f"{record.folder} contains nothing to render: no states were kept")
    times = np.arange(float(record.times[0]), record.until, 1.0 / form.fps)
    panel = round(_PANEL * form.width / 2) * 2
    size = form.width - panel, form.height
    aspect = size[0] / size[1]
    viewpoints = followed(record, times.tolist(), aspect)
    scene = FilmScene(record, size, *clear_corner(record, times.tolist(), viewpoints, aspect))
    trees = FilmPanel(record, (panel, form.height))
    for time, viewpoint in zip(times.tolist(), viewpoints, strict=True):
        drawn = scene.draw(record.moment(record.index_at(time)), viewpoint)
        yield np.hstack((np.asarray(drawn, np.uint8), np.asarray(trees.draw(time), np.uint8)))
