"""A phone's film of a printed box, made up, with all that a real one has against it.

Held upright by a hand that shakes, 30 frames a second of which some are dropped, rows read one
after the other, a lens that distorts and breathes, exposure that drifts, H.264, and a turn that is
told by the container only. The box is twelve triangles with print on plain cardboard; it stands on
a table in a room, and somebody may walk behind it.

make_film   the film, the box, picked points, and where everything was seen
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.lens import Lens
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.jit import kernel

BOX = np.array([190.0, 270.0, 70.0])  # mm
ROOM = np.array([3000.0, 2400.0, 3600.0])
PERSON = np.array([450.0, 1700.0, 250.0])
TICK = Fraction(1, 90000)
READOUT, EXPOSURE = 0.020, 0.008  # seconds: from the first row to the last; of each
DENSITY = 4.0  # texels per mm of the box
SIDE = 1080  # texels that a face of the box may have at most
SAMPLES = ((-0.25, -0.25), (0.25, 0.25), (-0.25, 0.25), (0.25, -0.25))  # of a pixel
K1, BREATH = 0.03, 0.004
SHAKE = np.radians(0.35), 3.0  # RMS turn, and shift in mm
PICKED, PICK_ERROR = 10, 1.5  # points, and pixels by which each is wrong at full HD
LAMP = np.array([0.35, 0.86, 0.37])


@dataclass(frozen=True)
class Options:
    """width, height : pixels as shown, upright; frames : before some are dropped

    turn : degrees walked around the box; person : whether somebody walks behind it
    """

    width: int = 720
    height: int = 1280
    frames: int = 150
    turn: float = 120.0
    person: bool = True
    seed: int = 0


@dataclass(frozen=True)
class Film:
    """What was made.

    lens : of the frames as they were filmed, at its mean focal length
    times : seconds, of each frame's middle column
    picks : the file of picked points of the first frame
    """

    path: Path
    picks: Path
    mesh: Mesh
    lens: Lens
    times: np.ndarray
    hand: Hand

    def seen(self, frame: int, points: np.ndarray) -> np.ndarray:
        """Where a frame shows points (n, 3): pixels (n, 2) as filmed, rolling shutter and all."""
        time = np.full(len(points), self.times[frame])
        for _ in range(6):
            R, C = self.hand(time)
            local = np.einsum("nij,nj->ni", R, points - C)
            breath = self.hand.breath(time)[:, None]
            pixels = self.lens.distort(local[:, :2] / local[:, 2:] * breath)
            time = self.times[frame] + _delay(pixels[:, 0], self.lens.width)
        return pixels

    def error(self, frame: int, camera: Camera, lens: Lens | None) -> float:
        """Pixels, RMS, as filmed, by which a camera (of undistorted frames) misses the box."""
        points = self.facing(frame)
        local = points @ camera.R.T + camera.t
        rays = local[:, :2] / local[:, 2:]
        plain = Lens(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
        miss = (lens or plain).distort(rays) - self.seen(frame, points)
        return float(np.sqrt((miss**2).sum(1).mean()))

    def facing(self, frame: int, each: int = 4) -> np.ndarray:
        """Points (n, 3) spread over the faces that a frame sees, where it shows them."""
        side = np.linspace(-0.95, 0.95, each)
        points = []
        _, C = self.hand(self.times[[frame]])
        for axis in range(3):
            for sign in (-1, 1):
                if sign * C[0, axis] > BOX[axis] / 2:
                    grid = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
                    points.append(np.insert(grid, axis, sign, axis=1) * BOX / 2)
        found = np.concatenate(points)
        pixels = self.seen(frame, found)
        inside = (pixels >= 0).all(1) & (pixels < [self.lens.width, self.lens.height]).all(1)
        return found[inside]


class Hand:
    """The phone's way around the box: seconds (n,) to R (n, 3, 3), world to camera, and centres."""

    def __init__(self, turn: float, seconds: float, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.turn, self.seconds = np.radians(turn), seconds
        self.hertz = np.geomspace(0.4, 7.0, 8)
        strength = self.hertz**-0.8
        self.strength = strength / np.linalg.norm(strength) * np.sqrt(2)
        self.phase = rng.uniform(0, 2 * np.pi, (6, 8))

    def __call__(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        share = time / self.seconds
        angle = self.turn * share
        climb = np.radians(32 + 14 * np.sin(3.1 * share + 0.5))
        far = 560 + 50 * np.sin(4.3 * share)
        level = np.cos(climb)
        C = far[:, None] * np.column_stack(
            [np.sin(angle) * level, np.sin(climb), np.cos(angle) * level]
        )
        shake = np.sin(2 * np.pi * time[:, None, None] * self.hertz + self.phase) @ self.strength
        C = C + SHAKE[1] * shake[:, :3]
        forward = -C / np.linalg.norm(C, axis=1, keepdims=True)
        right = np.cross(forward, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right, axis=1, keepdims=True)
        R = np.stack([right, np.cross(forward, right), forward], 1)
        return Rotation.from_rotvec(SHAKE[0] * shake[:, 3:]).as_matrix() @ R, C

    def breath(self, time: np.ndarray) -> np.ndarray:
        """The focal length over its mean: focus hunts."""
        return 1 + BREATH * np.sin(2 * np.pi * time / 2.3)


def make_film(folder: Path, options: Options | None = None) -> Film:
    """Write box_film.mp4 and points.csv into a folder, seeded; a film that is there is kept."""
    o = options or Options()
    rng = np.random.default_rng(o.seed)
    focal = 0.85 * o.height
    lens = Lens(
        o.width, o.height, focal, focal, (o.width - 1) / 2, (o.height - 1) / 2,
        (K1, 0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    times = np.arange(o.frames) / 30 + rng.normal(scale=0.001, size=o.frames)
    times = times[(rng.uniform(size=o.frames) > 0.03) | (np.arange(o.frames) == 0)]
    times = np.maximum(times - times[0], 0)
    hand = Hand(o.turn, o.frames / 30, o.seed)
    folder.mkdir(parents=True, exist_ok=True)
    film = Film(
        folder / "box_film.mp4", folder / "points.csv", box_mesh(), lens, times, hand
    )  # fmt: skip
    if not film.path.is_file():
        _write_picks(film, rng)
        part = folder / "part.mp4"
        _write_video(part, film, o, rng)
        part.replace(film.path)
    return film


def box_mesh(grown: float = 0.0) -> Mesh:
    """The box about the origin, twelve triangles; grown : mm, by which it was measured wrong."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [f for a, b, c, d in quads for f in ([a, b, c], [a, c, d])]
    return Mesh(signs * (BOX + grown) / 2, np.array(faces, np.int32))


def _delay(column: np.ndarray, width: int) -> np.ndarray:
    """Seconds by which a column is read later than the middle one: the sensor's rows are columns
    of the upright picture, the last one first."""
    return READOUT * (0.5 - (column + 0.5) / width)


def _write_picks(film: Film, rng: np.random.Generator) -> None:
    """Points on the box and in the first frame, as a user picks them: not quite where they are."""
    points = film.facing(0)
    chosen = points[rng.permutation(len(points))[:PICKED]]
    pixels = film.seen(0, chosen)
    wrong = PICK_ERROR * film.lens.width / 1080
    pixels = pixels + rng.normal(scale=wrong / np.sqrt(2), size=pixels.shape)
    lines = [
        ", ".join(f"{v:.3f}" for v in (*p, *q)) for p, q in zip(chosen, pixels, strict=True)
    ]  # fmt: skip
    film.picks.write_text("# x, y, z, column, row\n" + "\n".join(lines) + "\n")


def _write_video(path: Path, film: Film, options: Options, rng: np.random.Generator) -> None:
    lens, prints = film.lens, _prints(rng)
    shape = lens.height, lens.width
    rays = [_rays(lens, aside) for aside in SAMPLES]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "22", "preset": "faster"})
        stream.width, stream.height, stream.pix_fmt = lens.height, lens.width, "yuv420p"
        stream.codec_context.time_base = TICK
        for time in film.times:
            light = np.zeros((*shape, 3), np.float32)
            boxes = _boxes(options, time / film.hand.seconds)
            for nth, directions in enumerate(rays):
                moment = time + _delay(np.arange(shape[1]), shape[1])
                moment = moment + EXPOSURE * ((nth + 0.5) / len(SAMPLES) - 0.5)
                R, C = film.hand(moment)
                breath = film.hand.breath(moment)
                _shoot(directions, breath, R, C, boxes, *prints, LAMP, light)
            gain = 1.1 * 2 ** (0.3 * np.sin(2 * np.pi * time / 5.1)) / len(SAMPLES)
            codes = 255 * np.clip(light * gain, 0, 1) ** (1 / 2.2)
            codes += rng.normal(scale=2.0, size=shape).astype(np.float32)[..., None]
            shown = np.clip(np.rint(codes), 0, 255).astype(np.uint8)
            stored = np.ascontiguousarray(np.rot90(shown))
            picture = av.VideoFrame.from_ndarray(stored, format="rgb24")
            picture.pts, picture.time_base = round(time / TICK), TICK
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    turn(path, 0, 1, -1, 0)


def turn(path: Path, a: int, b: int, c: int, d: int) -> None:
    """Let an MP4 be shown with x' = a x + c y, y' = b x + d y."""
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 44
    matrix = np.array([a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30], ">i4")
    data[at : at + 36] = matrix.tobytes()
    path.write_bytes(data)


def _rays(lens: Lens, aside: tuple[float, float]) -> np.ndarray:
    """X/Z and Y/Z of all pixels, (h, w, 2) float32: one number distorts, found by steps."""
    x, y = np.meshgrid(
        (np.arange(lens.width) + aside[0] - lens.cx) / lens.fx,
        (np.arange(lens.height) + aside[1] - lens.cy) / lens.fy,
    )
    k1 = lens.coefficients[0]
    wrong = x * x + y * y
    r2 = wrong
    for _ in range(8):
        r2 = wrong / (1 + k1 * r2) ** 2
    return (np.stack([x, y], -1) / (1 + k1 * r2)[..., None]).astype(np.float32)


def _boxes(options: Options, share: float) -> np.ndarray:
    """Lowest and highest corner of the box, the room and, if there is one, the person."""
    floor = -BOX[1] / 2
    found = [[-BOX / 2, BOX / 2], [-ROOM / 2, ROOM / 2]]
    found[1] = [[-ROOM[0] / 2, floor, -ROOM[2] / 2], [ROOM[0] / 2, floor + ROOM[1], ROOM[2] / 2]]
    if options.person:
        way = np.radians(150 + 260 * share)
        low = 900 * np.array([np.sin(way), 0, np.cos(way)]) - PERSON / 2
        low[1] = floor
        found.append([low, low + PERSON])
    return np.array(found, float)


def _prints(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Print of every face of box, room and person, (3, 6, SIDE, SIDE, 3) uint8, and the size of
    each, (3, 6, 2) texels."""
    prints = np.zeros((3, 6, SIDE, SIDE, 3), np.uint8)
    sizes = np.full((3, 6, 2), SIDE)
    board = np.array([[214, 196, 160], [40, 84, 150], [214, 196, 160]])
    for face in range(6):
        axis = face // 2
        across, up = np.round(np.delete(BOX, axis) * DENSITY).astype(int)
        sizes[0, face] = across, up
        prints[0, face, :up, :across] = _label((up, across), board[axis], rng)
        prints[1, face] = _clutter(rng, 12, 110)
        prints[2, face] = _clutter(rng, 40, 90)
    return prints, sizes


def _label(shape: tuple[int, int], board: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Plain cardboard with a picture, a bar and lines of text: most of it is empty."""
    h, w = shape
    face = np.full((h, w, 3), board, np.uint8)
    top, left = h // 10, w // 8
    cv2.rectangle(face, (left, top), (w - left, top + h // 12), (170, 30, 36), -1)
    size = w / 420
    cv2.putText(face, "PRINTED BOX", (left + 8, top + h // 16), cv2.FONT_HERSHEY_DUPLEX, size,
                (245, 245, 240), max(int(2 * size), 1), cv2.LINE_AA)  # fmt: skip
    picture = cv2.resize(rng.integers(0, 256, (9, 9, 3), np.uint8), (w // 3, h // 4),
                         interpolation=cv2.INTER_CUBIC)  # fmt: skip
    face[h // 3 : h // 3 + h // 4, left : left + w // 3] = picture
    words = ["flour", "water", "salt", "yeast", "honey", "barley", "malt", "oats", "rye", "wheat"]
    for line in range(9):
        text = " ".join(rng.choice(words, 4))
        at = left, int(h * 0.68) + line * max(h // 45, 9)
        cv2.putText(face, text, at, cv2.FONT_HERSHEY_SIMPLEX, w / 1500, (30, 30, 30), 1,
                    cv2.LINE_AA)  # fmt: skip
    return face


def _clutter(rng: np.random.Generator, things: int, spread: int) -> np.ndarray:
    """A wall or a cloth: soft noise and rectangles, (SIDE, SIDE, 3) uint8."""
    soft = rng.normal(size=(SIDE // 12, SIDE // 12)).astype(np.float32)
    soft = cv2.resize(cv2.GaussianBlur(soft, (0, 0), 1.5), (SIDE, SIDE))
    wall = 120 + spread * 0.5 * soft[..., None] + rng.normal(scale=15, size=3)
    wall = np.clip(wall, 0, 255).astype(np.uint8)
    for _ in range(things):
        at, size = rng.integers(0, SIDE, 2), rng.integers(20, 180, 2)
        color = tuple(int(v) for v in rng.integers(20, 235, 3))
        cv2.rectangle(wall, tuple(map(int, at)), tuple(map(int, at + size)), color, -1)
    return wall


@kernel
def _shoot(rays, breath, R, C, boxes, prints, sizes, lamp, light):
    """Add what each pixel sees to `light` (h, w, 3), linear; box 1 is seen from within.

    rays : (h, w, 2), the mean lens's; breath, R, C : of each column
    """
    height, width = rays.shape[:2]
    d = np.empty(3)
    mirrored = np.empty(3)
    for row in range(height):
        for col in range(width):
            x, y = rays[row, col, 0] / breath[col], rays[row, col, 1] / breath[col]
            for k in range(3):
                d[k] = R[col, 0, k] * x + R[col, 1, k] * y + R[col, 2, k]
            best, body, axis = np.inf, -1, 0
            for b in range(len(boxes)):
                near, far, on_near, on_far = -np.inf, np.inf, 0, 0
                for k in range(3):
                    one = (boxes[b, 0, k] - C[col, k]) / d[k]
                    two = (boxes[b, 1, k] - C[col, k]) / d[k]
                    if min(one, two) > near:
                        near, on_near = min(one, two), k
                    if max(one, two) < far:
                        far, on_far = max(one, two), k
                if b == 1 and far < best:
                    best, body, axis = far, b, on_far
                if b != 1 and 0 < near < far and near < best:
                    best, body, axis = near, b, on_near
            # Where on the face, and its print there
            up, across = (1, 0) if axis == 2 else (2, 1) if axis == 0 else (2, 0)
            outward = -1.0 if (d[axis] > 0) == (body != 1) else 1.0
            face = 2 * axis + (1 if outward > 0 else 0)
            u = C[col, across] + best * d[across] - boxes[body, 0, across]
            v = C[col, up] + best * d[up] - boxes[body, 0, up]
            u *= (sizes[body, face, 0] - 1) / (boxes[body, 1, across] - boxes[body, 0, across])
            v *= (sizes[body, face, 1] - 1) / (boxes[body, 1, up] - boxes[body, 0, up])
            v = sizes[body, face, 1] - 1 - v
            c = min(max(int(u), 0), sizes[body, face, 0] - 2)
            r = min(max(int(v), 0), sizes[body, face, 1] - 2)
            a, b_ = u - c, v - r
            # Light from above, a sheen on the box, shadow around its foot
            shade = 0.45 + 0.4 * max(outward * lamp[axis], 0.0)
            sheen = 0.0
            if body == 0:
                length = np.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
                for k in range(3):
                    mirrored[k] = d[k] / length * (-1 if k == axis else 1)
                lobe = mirrored[0] * lamp[0] + mirrored[1] * lamp[1] + mirrored[2] * lamp[2]
                sheen = 0.25 * max(lobe, 0.0) ** 40
            elif body == 1 and axis == 1 and d[1] < 0:
                away = 0.0
                for k in (0, 2):
                    at = C[col, k] + best * d[k]
                    beyond = max(abs(at) - boxes[0, 1, k], 0.0)
                    away += beyond * beyond
                shade *= 1 - 0.6 * np.exp(-np.sqrt(away) / 40)
            for k in range(3):
                p = prints[body, face]
                upper = (1 - a) * p[r, c, k] + a * p[r, c + 1, k]
                lower = (1 - a) * p[r + 1, c, k] + a * p[r + 1, c + 1, k]
                value = ((1 - b_) * upper + b_ * lower) / 255
                light[row, col, k] += value * value * shade + sheen
