"""Videos: the right frame at its time, each decoded once, in its own colours, whoever asks."""

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import av
import numpy as np
import pytest
from films import noise, write_video

from benchmarks.phone_film import turn
from meshlab_svbrdf.document import video as module
from meshlab_svbrdf.document.images import write_jpeg
from meshlab_svbrdf.document.video import VideoReader
from meshlab_svbrdf.document.video_file import (
    VideoCoding,
    coding_of,
    frame_times,
    video_problem,
)
from meshlab_svbrdf.errors import DocumentError

COUNT = 90
PICTURES = noise(COUNT)
UNEVEN = np.cumsum(np.random.default_rng(6).integers(5, 120, COUNT)) + 300  # milliseconds
CONTAINERS = ("film.mp4", "film.mov", "film.mkv", "film.ts")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Of one film in several containers, its frames at uneven times."""
    folder = tmp_path_factory.mktemp("films")
    for name in CONTAINERS:
        write_video(folder / name, PICTURES, UNEVEN.tolist())
    return folder


@pytest.fixture
def film(folder) -> Path:
    return folder / "film.mp4"


def read(path: Path, indices, threads: int = 1) -> tuple[list[np.ndarray], int]:
    """The frames of those indices, asked for in that order, and how many were decoded.

    As by the sample store, no more are asked for at a time than twice the threads.
    """
    times = frame_times(path)
    reader = VideoReader(path, [times[k] for k in indices])
    found, pending = [], deque()
    with ThreadPoolExecutor(threads) as pool:
        for k in indices:
            pending.append(pool.submit(reader.read, times[k]))
            if len(pending) == 2 * threads:
                found.append(pending.popleft().result())
    found += [each.result() for each in pending]
    reader.close()
    return found, reader.decoded


# Which frame


@pytest.mark.parametrize("name", CONTAINERS)
def test_every_frame_is_found_at_its_own_time(folder, name):
    times = frame_times(folder / name)
    shift = times[0] - UNEVEN[0] / 1000  # containers may start their clock elsewhere
    np.testing.assert_allclose(times - shift, UNEVEN / 1000, rtol=0, atol=1.1e-4)
    found, decoded = read(folder / name, range(COUNT))
    np.testing.assert_array_equal(found, PICTURES)
    assert decoded == COUNT


@pytest.mark.parametrize("name", CONTAINERS)
def test_times_and_frames_are_those_of_a_plain_decoder(folder, name):
    with av.open(str(folder / name)) as container:
        shown = [frame.time for frame in container.decode(video=0)]
    np.testing.assert_allclose(frame_times(folder / name), shown, rtol=0, atol=1e-9)


def test_a_copy_in_another_container_serves_as_well(folder):
    times = frame_times(folder / "film.mp4")
    reader = VideoReader(folder / "film.mkv", times)
    np.testing.assert_array_equal([reader.read(time) for time in times], PICTURES)


def test_frames_that_an_edit_list_hides_do_not_count(tmp_path):
    path = write_video(tmp_path / "a.mp4", PICTURES[:40], [40 * k - 520 for k in range(40)])
    assert frame_times(path).tolist() == [k / 25 for k in range(27)]
    found, decoded = read(path, range(27), threads=4)
    np.testing.assert_array_equal(found, PICTURES[13:40])
    assert decoded == 27


@pytest.mark.parametrize(
    ("name", "codec", "pixels"),
    [
        ("a.avi", "mpeg4", "yuv420p"),
        ("a.webm", "libvpx-vp9", "yuv420p"),
        ("a.mp4", "libx265", "yuv420p10le"),
        ("a.mkv", "ffv1", "yuv422p10le"),
        ("a.mov", "mjpeg", "yuvj444p"),
    ],
)
def test_other_codecs_and_depths_are_read(tmp_path, name, codec, pixels):
    if codec not in av.codecs_available:
        pytest.skip(f"PyAV was built without {codec}")
    options = {"b": "4000000", "lossless": "1"} | {"x265-params": "log-level=none"}
    write_video(tmp_path / name, PICTURES[:30], codec=codec, pixels=pixels, options=options)
    found, decoded = read(tmp_path / name, range(0, 30, 2), threads=4)
    errors = [np.abs(PICTURES[:30].astype(int) - image).mean((1, 2, 3)) for image in found]
    assert np.argmin(errors, 1).tolist() == list(range(0, 30, 2))
    assert np.min(errors, 1).max() < 15
    assert decoded <= 30


# How often


@pytest.mark.parametrize("threads", [2, 8])
@pytest.mark.parametrize("step", [1, 3, 7])
def test_threads_read_what_one_reads_and_decode_no_frame_twice(film, threads, step):
    indices = range(0, COUNT, step)
    found, decoded = read(film, indices, threads)
    np.testing.assert_array_equal(found, PICTURES[::step])
    assert decoded == indices[-1] + 1


def test_frames_before_a_late_start_are_not_decoded(film):
    found, decoded = read(film, range(75, 80))
    np.testing.assert_array_equal(found, PICTURES[75:80])
    assert decoded <= 10


@pytest.mark.parametrize("name", CONTAINERS)
def test_frames_far_apart_are_sought(folder, name):
    indices = range(1, COUNT, 30)
    found, decoded = read(folder / name, indices, threads=2)
    np.testing.assert_array_equal(found, PICTURES[1::30])
    if name != "film.ts":  # it has no index to seek by
        assert decoded < 20


@pytest.mark.parametrize("name", CONTAINERS)
@pytest.mark.parametrize("order", ["backward", "shuffled", "twice"])
def test_any_order_gives_the_same_frames(folder, name, order):
    indices = {
        "backward": np.arange(COUNT)[::-3],
        "shuffled": np.random.default_rng(7).permutation(COUNT),
        "twice": np.repeat(np.arange(0, COUNT, 4), 2),
    }[order]
    found, _ = read(folder / name, indices, threads=3)
    np.testing.assert_array_equal(found, PICTURES[indices])


def test_no_more_frames_are_held_than_there_is_room_for(film, monkeypatch):
    monkeypatch.setattr(module, "thread_count", lambda: 1)
    times, most = frame_times(film), 0
    reader = VideoReader(film, times)
    for index in np.random.default_rng(8).permutation(COUNT):
        np.testing.assert_array_equal(reader.read(times[index]), PICTURES[index])
        most = max(most, len(reader._held))
    assert 0 < most <= 16


# Colour and attitude

KR_KB = {"709": (0.2126, 0.0722), "601": (0.299, 0.114), "2020": (0.2627, 0.0593)}


def yuv_to_rgb(yuv: np.ndarray, matrix: str, full: bool) -> np.ndarray:
    """R'G'B' in 0..255 by the definition of the recommendations; yuv : (3,)."""
    kr, kb = KR_KB[matrix]
    y, u, v = yuv.astype(float) - np.array([0 if full else 16, 128, 128])
    y, u, v = y / (255 if full else 219), u / (255 if full else 224), v / (255 if full else 224)
    r, b = y + 2 * (1 - kr) * v, y + 2 * (1 - kb) * u
    g = (y - kr * r - kb * b) / (1 - kr - kb)
    return 255 * np.clip([r, g, b], 0, 1)


@pytest.mark.parametrize(
    ("named", "full", "lines", "expected"),
    [
        (1, 1, 48, ("709", False)),
        (1, 2, 48, ("709", True)),
        (6, 1, 48, ("601", False)),
        (5, 2, 48, ("601", True)),
        (9, 1, 48, ("2020", False)),
        (2, 0, 576, ("601", False)),  # nothing is said
        (2, 0, 720, ("709", False)),
    ],
)
def test_matrix_and_range_are_the_videos_own(tmp_path, named, full, lines, expected):
    rng = np.random.default_rng(9)
    colors = np.column_stack([rng.integers(60, 190, 12), rng.integers(90, 165, (12, 2))])
    planes = np.broadcast_to(colors.astype(np.uint8)[:, :, None, None], (12, 3, lines, lines))
    write_video(
        tmp_path / "a.mp4", planes, codec="libx264", pixels="yuv444p", source="yuv444p",
        options={"qp": "0", "preset": "ultrafast"}, colorspace=named, color_range=full,
    )  # fmt: skip
    found, _ = read(tmp_path / "a.mp4", range(12))
    for image, color in zip(found, colors, strict=True):
        assert (image == image[0, 0]).all()
        assert np.abs(image[0, 0] - yuv_to_rgb(color, *expected)).max() <= 1


def test_chroma_of_half_size_is_interpolated(tmp_path):
    """Colours that change from pixel to pixel come back, at their own places."""
    ramp = np.broadcast_to(np.linspace(20, 230, 64), (48, 64))
    picture = np.rint(np.stack([ramp, np.full((48, 64), 120), 250 - ramp], 2)).astype(np.uint8)
    write_video(tmp_path / "a.mp4", [picture], codec="libx264", pixels="yuv420p")
    (found,), _ = read(tmp_path / "a.mp4", [0])
    error = found[:, 2:-2].astype(int) - picture[:, 2:-2]
    assert np.abs(error).max() <= 3
    assert np.abs(error.mean((0, 1))).max() < 0.6  # a shift by half a pixel would be 1.3


@pytest.mark.parametrize(
    ("matrix", "expected"),
    [
        ((1, 0, 0, 1), lambda image: image),
        ((0, 1, -1, 0), lambda image: np.rot90(image, -1)),  # clockwise: a telephone held upright
        ((-1, 0, 0, -1), lambda image: np.rot90(image, 2)),
        ((0, -1, 1, 0), lambda image: np.rot90(image)),
        ((-1, 0, 0, 1), lambda image: image[:, ::-1]),
        ((0, 1, 1, 0), lambda image: image.swapaxes(0, 1)),
    ],
)
def test_pictures_are_turned_as_the_video_says(tmp_path, matrix, expected):
    write_video(tmp_path / "a.mp4", PICTURES[:3])
    turn(tmp_path / "a.mp4", *matrix)
    found, _ = read(tmp_path / "a.mp4", range(3))
    np.testing.assert_array_equal(found, [expected(image) for image in PICTURES[:3]])


def test_interlaced_videos_are_told_once(tmp_path, caplog):
    write_video(
        tmp_path / "a.mp4", PICTURES[:8], codec="libx264", pixels="yuv420p",
        options={"x264-params": "tff=1"},
    )  # fmt: skip
    read(tmp_path / "a.mp4", range(8))
    assert [record.message.split(": ")[0] for record in caplog.records] == [
        f"{tmp_path / 'a.mp4'} is interlaced"
    ]


# Files that are none


def test_files_that_are_no_videos_are_named(tmp_path, film):
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "text.txt").write_text(
        "a text, which a demultiplexer of ANSI art would take\n" * 99
    )
    (tmp_path / "list.mp4").write_text(f"#EXTM3U\n#EXTINF:1,\n{film}\n#EXT-X-ENDLIST\n")
    (tmp_path / "concat.mp4").write_text(f"ffconcat version 1.0\nfile '{film}'\n")
    (tmp_path / "cut.mp4").write_bytes(film.read_bytes()[: film.stat().st_size // 2])
    write_jpeg(tmp_path / "picture.jpg", PICTURES[0])
    for path in sorted(tmp_path.iterdir()):
        for attempt in (frame_times, lambda path: VideoReader(path, [0.0])):
            with pytest.raises(DocumentError, match=f"{path.name}: is not a video, or is cut off"):
                attempt(path)
        assert video_problem(path)
    for path in (tmp_path, tmp_path / "none.mp4"):
        with pytest.raises(DocumentError, match=f"{path.name}: does not exist"):
            frame_times(path)
    assert video_problem(film) == ""


def test_sound_alone_is_no_video(tmp_path):
    with av.open(str(tmp_path / "a.mp4"), "w") as container:
        stream = container.add_stream("aac", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 4096), np.float32), "fltp", "mono")
        frame.sample_rate, frame.pts = 8000, 0
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(DocumentError, match=r"a\.mp4: holds no video"):
        frame_times(tmp_path / "a.mp4")


@pytest.mark.parametrize(
    ("number", "name"), [(16, "pq"), (18, "hlg"), (8, "linear"), (1, "srgb"), (13, "srgb")]
)
def test_a_video_tells_its_transfer_function(tmp_path, number, name):
    for pixels, deep in (("yuv420p", False), ("yuv420p10le", True)):
        write_video(tmp_path / "a.mp4", PICTURES[:2], codec="libx264", pixels=pixels, options={},
                    colorspace=9, color_trc=number, color_primaries=9)  # fmt: skip
        assert coding_of(tmp_path / "a.mp4") == VideoCoding(name, deep, True)


def test_pixels_of_more_than_8_bits_are_read_whole(tmp_path):
    ramp = np.linspace(0, 65535, 64).astype(np.uint16)
    picture = np.broadcast_to(ramp[:, None], (48, 64, 3)).copy()
    write_video(tmp_path / "a.mkv", [picture], codec="ffv1", pixels="gbrp16le", source="rgb48le",
                options={})  # fmt: skip
    reader = VideoReader(tmp_path / "a.mkv", [0.0])
    np.testing.assert_array_equal(reader.read(0.0, deep=True), picture)


def test_frames_without_time_stamps_are_refused(tmp_path):
    write_video(tmp_path / "a.avi", PICTURES[:20])  # with frames that refer to later ones
    with pytest.raises(DocumentError, match=r"a\.avi: frames have no time stamps"):
        frame_times(tmp_path / "a.avi")


def test_of_a_video_that_was_cut_off_the_rest_is_read(tmp_path, folder):
    times = frame_times(folder / "film.mkv")
    data = (folder / "film.mkv").read_bytes()
    (tmp_path / "cut.mkv").write_bytes(data[: len(data) // 2])
    reader = VideoReader(tmp_path / "cut.mkv", times)
    for index in range(20):
        np.testing.assert_array_equal(reader.read(times[index]), PICTURES[index])
    with pytest.raises(DocumentError, match=r"cut\.mkv: has no frame at .* it is cut off"):
        reader.read(times[-1])


def test_damage_costs_the_frames_that_it_hits_and_no_others(tmp_path, folder):
    data = bytearray((folder / "film.mp4").read_bytes())
    middle = len(data) // 2
    data[middle : middle + 3000] = np.random.default_rng(10).bytes(3000)
    (tmp_path / "a.mp4").write_bytes(data)
    times = frame_times(tmp_path / "a.mp4")
    reader = VideoReader(tmp_path / "a.mp4", times)
    lost, told = [], set()
    for index, time in enumerate(times):
        try:
            found = reader.read(time)
        except DocumentError as error:
            lost.append(index)
            told.add(str(error).partition("cannot")[2])
        else:
            np.testing.assert_array_equal(found, PICTURES[index])
    assert 0 < len(lost) <= 12
    assert told == {
        " be decoded: the video is damaged; copy it again, convert it, or remove the raster"
    }
    assert reader.decoded <= COUNT
