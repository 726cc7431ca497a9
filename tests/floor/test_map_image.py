import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.floor.map_file import MapLimits, load_map, map_warnings
from actors.floor.map_header import MapError
from tests.floor.map_files import GREYS, refusal, written

CELLS = [[FREE, FREE, OCCUPIED], [OCCUPIED, UNKNOWN, UNKNOWN]]
GREY = Image.fromarray(GREYS)
WIDE = GREYS.astype(np.uint16) * 257


def image_map(folder: Path, content: bytes | Image.Image, name: str = "image", **options: Any) -> Path:
    """Write a map whose image is encoded as the name's ending says, or has these bytes."""
    path = written(folder, image=name)
    if isinstance(content, bytes):
        (folder / name).write_bytes(content)
    else:
        content.save(folder / name, **options)
    return path


def plain_pgm(maximum: int, scale: float) -> bytes:
    values = " ".join(str(round(grey * scale)) for grey in GREYS.ravel().tolist())
    return f"P2\n# by hand\n3 2\n{maximum}\n{values}\n".encode()


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "P"])
@pytest.mark.parametrize("name", ["a.PNG", "a.tiff", "a.webp"])
def test_grey_in_other_formats_gives_the_same_map(tmp_path: Path, mode: str, name: str) -> None:
    path = image_map(tmp_path, GREY.convert(mode), name, **({"lossless": True} if "webp" in name else {}))
    assert load_map(path).cells.tolist() == CELLS and map_warnings(path) == ()


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(b"P5 3 2 255\n" + GREYS.tobytes(), id="P5"),
        pytest.param(b"P5 3 2 65535\n" + WIDE.astype(">u2").tobytes(), id="P5 of 16 bits"),
        pytest.param(plain_pgm(255, 1), id="P2"),
        pytest.param(plain_pgm(65535, 257), id="P2 of 16 bits"),
        pytest.param(plain_pgm(1023, 1023 / 255), id="P2 of 10 bits"),
        pytest.param(b"P6 3 2 255\n" + np.repeat(GREYS, 3).tobytes(), id="P6"),
    ],
)
def test_netpbm_formats(tmp_path: Path, content: bytes) -> None:
    assert load_map(image_map(tmp_path, content)).cells.tolist() == CELLS


def test_netpbm_with_other_maxima_and_bits(tmp_path: Path) -> None:
    assert load_map(image_map(tmp_path, b"P5 2 1 100\n\x00\x64")).cells.tolist() == [[OCCUPIED, FREE]]
    for content in (b"P1 2 1\n1 0", b"P4 2 1\n\x80", b"P3 2 1 1\n0 0 0 1 1 1"):
        assert load_map(image_map(tmp_path, content)).cells.tolist() == [[OCCUPIED, FREE]]
    assert load_map(image_map(tmp_path, Image.fromarray(np.array([[False, True]])), "a.png")).free.any()


@pytest.mark.parametrize("name", ["a.png", "a.tiff", "a.pgm"])
def test_16_bits_are_scaled_to_8(tmp_path: Path, name: str) -> None:
    assert load_map(image_map(tmp_path, Image.fromarray(WIDE), name)).cells.tolist() == CELLS


@pytest.mark.parametrize("mode", ["L", "RGB", "P", "RGBA", "LA", "PA", "I;16"])
def test_transparent_pixels_are_unknown(tmp_path: Path, mode: str) -> None:
    white: Image.Image = Image.fromarray(np.array([[0, 254, 254]], np.uint8))
    options: dict[str, Any] = {}
    if mode == "I;16":
        white, options = Image.fromarray(np.array([[0, 60000, 65278]], np.uint16)), {"transparency": 60000}
    elif mode in {"L", "RGB", "P"}:
        white.putpixel((1, 0), 253)
        white = white.convert(mode)
        clear = white.getpixel((1, 0))
        options["transparency"] = clear
    else:
        white = white.convert("LA")
        white.putpixel((1, 0), (254, 128))  # half transparent
        white = white.convert("RGBA") if mode == "RGBA" else white
    name = "a.tiff" if mode == "PA" else "a.png"
    assert load_map(image_map(tmp_path, white, name, **options)).cells.tolist() == [[OCCUPIED, UNKNOWN, FREE]]


def test_channels_are_averaged_and_colours_warned_of(tmp_path: Path) -> None:
    colours = np.repeat(GREYS[..., None], 3, axis=2)
    colours[1, 0] = 254, 254, 255
    path = image_map(tmp_path, Image.fromarray(colours), "a.png")
    assert load_map(path).cells.tolist() == CELLS and map_warnings(path) == ()
    colours[1, 2] = 200, 0, 61  # a mean of 87: occupied
    path = image_map(tmp_path, Image.fromarray(colours), "a.png")
    assert load_map(path).cells.tolist() == [[FREE, FREE, OCCUPIED], [OCCUPIED, UNKNOWN, UNKNOWN]]
    assert map_warnings(path) == (
        "plan.yaml: 1 pixels have a colour, the first in column 2, row 1 from the top: (200, 0, 61); the mean"
        " of red, green and blue counts",
    )


def test_jpeg_is_read_with_a_warning(tmp_path: Path) -> None:
    room = np.full((32, 32), 254, np.uint8)
    room[:8] = 0
    for mode in ("L", "RGB", "CMYK"):
        path = image_map(tmp_path, Image.fromarray(room).convert("RGB").convert(mode), "a.jpg")
        assert load_map(path).free[:24].all() and not load_map(path).free[24:].any()
        assert map_warnings(path) == ("plan.yaml: JPEG blurs the edges of walls; save the image as PNG",)


def saved_by_slam(folder: Path, pixels: NDArray[np.uint8], free: str) -> Path:
    return written(folder, Image.fromarray(pixels), free_thresh=free)


def building(window: bool) -> NDArray[np.uint8]:
    """Draw a room of white floor in black walls, the unknown grey of map_saver around it."""
    pixels = np.full((60, 80), 205, np.uint8)
    pixels[10:50, 10:70] = 0
    pixels[12:48, 12:68] = 254
    if window:
        pixels[10:12, 20:30] = 205
    return pixels


@pytest.mark.parametrize("window", [True, False])
def test_unknown_grey_that_counts_as_free_is_warned_of(tmp_path: Path, window: bool) -> None:
    path = saved_by_slam(tmp_path, building(window), "0.25")
    (told,) = map_warnings(path)
    assert "makes grey 205 free floor" in told and "border" in told
    assert told.endswith("set free_thresh to 0.196")
    assert map_warnings(saved_by_slam(tmp_path, building(window), "0.196")) == ()


def test_other_greys_and_pockets_that_count_as_free_are_warned_of(tmp_path: Path) -> None:
    pixels = building(window=True)
    pixels[pixels == 205] = 128
    (told,) = map_warnings(saved_by_slam(tmp_path, pixels, "0.55"))
    assert "grey 128" in told and told.endswith("set free_thresh to 0.498")
    assert (load_map(saved_by_slam(tmp_path, pixels, "0.498")).cells[0] == UNKNOWN).all()
    pocket = building(window=False)[10:50, 10:70]
    pocket[20:30, 20:40] = 205
    (told,) = map_warnings(saved_by_slam(tmp_path, pocket, "0.25"))
    assert "grey 205" in told and "border" not in told


def test_rooms_without_grey_are_not_warned_of(tmp_path: Path) -> None:
    room = building(window=False)[10:50, 10:70]
    assert map_warnings(saved_by_slam(tmp_path, room, "0.25")) == ()
    room[0, :] = 254  # an open side
    assert map_warnings(saved_by_slam(tmp_path, room, "0.25")) == ()
    assert map_warnings("offices:7") == ()


def test_damaged_images(tmp_path: Path) -> None:
    assert refusal(image_map(tmp_path, b"not an image")) == (
        "image: this is not an image that can be read; right are PNG, PPM, BMP, GIF, TIFF, WEBP, JPEG."
    )
    path = written(tmp_path)
    whole = (tmp_path / "plan.png").read_bytes()
    refused = 0
    for length in range(len(whole)):
        (tmp_path / "plan.png").write_bytes(whole[:length])
        try:  # without its last bytes an image may still have all its pixels
            assert load_map(path).cells.tolist() == CELLS
        except MapError as error:
            assert str(error).startswith(f"{tmp_path}/plan.png: ")
            refused += 1
    assert refused > len(whole) / 2


def test_an_image_too_large_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    path = written(tmp_path)
    for limits, reason in (
        (MapLimits(cells=5), "3 x 2 pixels are more than 5"),
        (MapLimits(image_bytes=20), "has more than 20 bytes"),
    ):
        assert refusal(path, limits=limits) == f"plan.png: the map's image cannot be read: {reason}."
    huge = image_map(tmp_path, b"P5 12000 12000 255\n")
    assert refusal(huge).endswith("12000 x 12000 pixels are more than 16000000.")
    assert "decompression bomb" in refusal(image_map(tmp_path, b"P5 99999 99999 255\n"))


def encoded(form: str, mode: str) -> bytes:
    written_to = io.BytesIO()
    GREY.convert(mode).save(written_to, form)
    return written_to.getvalue()


IMAGES = [
    encoded(form, mode)
    for form, mode in (
        ("PNG", "P"), ("PNG", "LA"), ("PPM", "L"), ("BMP", "RGB"), ("GIF", "L"), ("WEBP", "RGB"),
        ("JPEG", "L"),
    )
]  # fmt: skip
"""Not TIFF: libtiff writes about damage to standard error itself."""


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    image=st.sampled_from(IMAGES),
    changes=st.lists(st.tuples(st.integers(0, 200), st.binary(max_size=4)), max_size=4),
)
def test_any_image_gives_a_grid_or_a_refusal(
    tmp_path: Path, image: bytes, changes: list[tuple[int, bytes]]
) -> None:
    for at, content in changes:
        image = image[:at] + content + image[at + len(content) + at % 2 :]
    try:
        assert isinstance(load_map(image_map(tmp_path, image)), OccupancyGrid)
    except MapError as error:
        assert str(error).startswith(f"{tmp_path}/image: ")
