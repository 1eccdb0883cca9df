"""Films that are written: read back picture by picture; whole or not at all."""

import av
import numpy as np
import pytest
from films import noise

from meshlab_svbrdf.document.video import VideoReader
from meshlab_svbrdf.document.video_file import frame_times
from meshlab_svbrdf.document.video_writer import writing_video
from meshlab_svbrdf.errors import DocumentError


def test_a_film_is_read_back_in_its_colours(tmp_path):
    """An odd size loses its last row and column; colours are Rec. 709's, and say so."""
    pictures = noise(12, 48, 64).repeat(2, 1).repeat(2, 2)
    odd = np.pad(pictures, ((0, 0), (0, 1), (0, 1), (0, 0)))
    with writing_video(tmp_path / "a.mp4", 25) as append:
        for picture in odd:
            append(picture)
    times = frame_times(tmp_path / "a.mp4")
    np.testing.assert_allclose(np.diff(times), 1 / 25, atol=1e-3)
    reader = VideoReader(tmp_path / "a.mp4", times)
    found = [reader.read(time) for time in times]
    reader.close()
    assert len(found) == 12
    errors = np.abs(pictures[:, None].astype(int) - np.array(found)[None]).mean((2, 3, 4))
    assert np.argmin(errors, 0).tolist() == list(range(12))
    assert np.min(errors, 0).max() < 6
    with av.open(str(tmp_path / "a.mp4")) as container:
        (stream,) = container.streams.video
        assert stream.codec_context.colorspace == 1
        assert stream.average_rate == 25


def test_a_film_that_is_broken_off_is_none(tmp_path):
    def broken_off() -> None:
        with writing_video(tmp_path / "a.mp4", 25) as append:
            append(np.zeros((16, 16, 3), np.uint8))
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        broken_off()
    assert not list(tmp_path.iterdir())
    with pytest.raises(DocumentError, match=r"written as \.mp4"), writing_video("a.avi", 25):
        pass
