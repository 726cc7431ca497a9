import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.floor.map_file import MapError, MapLimits, load_map, map_warnings
from actors.geometry import Point
from tests.floor.maps import GREYS, YAML, refusal, written

CELLS = [[FREE, FREE, OCCUPIED], [OCCUPIED, UNKNOWN, UNKNOWN]]
"""Cells of `written`: 0 → 1, 100 → .608, 205 → .19608 (not below .196), 254 → .004, 88 → .655."""


def test_thresholds_and_orientation(tmp_path: Path) -> None:
    grid = load_map(written(tmp_path))
    assert grid.cells.tolist() == CELLS
    assert (grid.resolution, grid.origin) == (0.05, Point(-1.0, 2.0))
    assert map_warnings(tmp_path / "plan.yaml") == ()
    grid = load_map(written(tmp_path, free_thresh="0", occupied_thresh="1"))
    assert (grid.cells == UNKNOWN).all(), "a pixel exactly at a threshold"
    grid = load_map(written(tmp_path, occupied_thresh='"0.99"', free_thresh="1e-3", negate='"0"'))
    assert grid.cells.tolist() == [[UNKNOWN, FREE, UNKNOWN], [OCCUPIED, UNKNOWN, UNKNOWN]]


@pytest.mark.parametrize(
    ("key", "text", "value"),
    [
        ("resolution", '"0.050000"', 0.05),
        ("resolution", "'0.05'", 0.05),
        ("resolution", "5e-2", 0.05),
        ("resolution", "+.05", 0.05),
        ("resolution", "1.", 1.0),
        ("resolution", "!!float '0.1'", 0.1),
        ("resolution", "1", 1.0),
        ("origin", "[-1e-05, -2, 0]", (-1e-05, -2.0)),
        ("origin", '["-1.5", "2.", "-0.0"]', (-1.5, 2.0)),
        ("origin", "\n- 1E1\n- -2\n- 0.000000", (10.0, -2.0)),
    ],
)
def test_numbers_given_as_text(
    tmp_path: Path, key: str, text: str, value: float | tuple[float, float]
) -> None:
    assert getattr(load_map(written(tmp_path, **{key: text})), key) == value


@pytest.mark.parametrize("text", ["1", '"1"', "true", '"true"', "True", "yes"])
def test_negate_inverts_the_image(tmp_path: Path, text: str) -> None:
    grid = load_map(written(tmp_path, negate=text))
    assert grid.cells.tolist() == [[OCCUPIED, OCCUPIED, UNKNOWN], [FREE, UNKNOWN, OCCUPIED]]


@pytest.mark.parametrize("key", ["negate", "occupied_thresh", "free_thresh"])
@pytest.mark.parametrize("text", [None, "", "null"])
def test_optional_keys_have_defaults(tmp_path: Path, key: str, text: str | None) -> None:
    assert load_map(written(tmp_path, **{key: text})).cells.tolist() == CELLS


@pytest.mark.parametrize("mode", ["trinary", "Trinary", "scale", "SCALE", '"scale"', "raw", "Raw"])
def test_scale_is_thresholded_like_trinary_and_raw_pixels_are_percentages(tmp_path: Path, mode: str) -> None:
    raw = [[UNKNOWN, UNKNOWN, OCCUPIED], [FREE, OCCUPIED, UNKNOWN]]
    cells = raw if mode.lower() == "raw" else CELLS
    assert load_map(written(tmp_path, mode=mode, negate=str(int(cells is raw)))).cells.tolist() == cells


@pytest.mark.parametrize(
    ("yaw", "cells", "origin"),
    [
        ("6.123233995736766e-17", CELLS, (-1.0, 2.0)),
        ("-0.0", CELLS, (-1.0, 2.0)),
        ("6.283185307", CELLS, (-1.0, 2.0)),
        ("1.5708", [[OCCUPIED, FREE], [UNKNOWN, FREE], [UNKNOWN, OCCUPIED]], (-1.1, 2.0)),
        ("-4.71", [[OCCUPIED, FREE], [UNKNOWN, FREE], [UNKNOWN, OCCUPIED]], (-1.1, 2.0)),
        ("3.1416", [[UNKNOWN, UNKNOWN, OCCUPIED], [OCCUPIED, FREE, FREE]], (-1.15, 1.9)),
        ("-3.14", [[UNKNOWN, UNKNOWN, OCCUPIED], [OCCUPIED, FREE, FREE]], (-1.15, 1.9)),
        ("-1.57", [[OCCUPIED, UNKNOWN], [FREE, UNKNOWN], [FREE, OCCUPIED]], (-1.0, 1.85)),
    ],
)
def test_quarter_turns(tmp_path: Path, yaw: str, cells: list[list[int]], origin: tuple[float, float]) -> None:
    path = written(tmp_path, origin=f"[-1.0, 2.0, {yaw}]")
    grid = load_map(path)
    assert grid.cells.tolist() == cells
    assert grid.origin == pytest.approx(origin)
    assert len(map_warnings(path)) == (cells is not CELLS)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_points_of_rotated_images(tmp_path: Path, turns: int) -> None:
    plain = load_map(written(tmp_path))
    turned = load_map(written(tmp_path, origin=f"[-1.0, 2.0, {turns * math.pi / 2}]"))
    for row in range(plain.rows):
        for column in range(plain.columns):
            x, y = (column + 0.5) * 0.05, (row + 0.5) * 0.05
            for _ in range(turns):
                x, y = -y, x
            assert turned.cells[turned.cell(Point(-1.0 + x, 2.0 + y))] == plain.cells[row, column]


def test_keys_of_other_tools_are_ignored_with_one_warning(tmp_path: Path) -> None:
    path = written(tmp_path, map_frame="map", cost_translation_table="null", **{"7": "x", "{1: 2}": "3"})
    assert load_map(path).cells.tolist() == CELLS
    assert map_warnings(path) == ("plan.yaml: ignored keys: 'map_frame, cost_translation_table, 7, …'",)


@pytest.mark.parametrize(
    "content", ["---\n{}---\n", "{}---\nanother: document\n", "# Büro\n{}", "tab:\t1\n{}\t\n"]
)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_yaml_as_editors_save_it(tmp_path: Path, content: str, end: str) -> None:
    path = written(tmp_path)
    text = content.replace("{}", path.read_text()).replace("\n", end)
    for encoding in ("utf-8", "utf-8-sig", "utf-16", "latin-1"):
        path.write_bytes(text.encode(encoding))
        assert load_map(path).cells.tolist() == CELLS


@pytest.mark.parametrize("name", ["{0}/plan.png", "file://{0}/plan.png", '" plan.png "', "~/plan.png"])
def test_image_paths(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    path = written(tmp_path, image=name.format(tmp_path))
    assert load_map(path).cells.tolist() == CELLS and map_warnings(path) == ()


@pytest.mark.parametrize(
    "name", ["/home/alice/maps/plan.png", "'C:\\maps\\plan.png'", "package://p/maps/plan.png"]
)
def test_a_missing_image_is_replaced_by_the_one_beside_the_yaml(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, image=name)
    assert load_map(path).cells.tolist() == CELLS
    assert "does not exist; reading plan.png beside the YAML" in map_warnings(path)[0]


NEEDED = "the key '{}' is missing; required are image, resolution, origin."


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        *[({key: None}, NEEDED.format(key)) for key in ("image", "resolution", "origin")],
        ({"origin": "[0, 0, 0.3]"},
         "origin has yaw 0.3 rad, but must be a multiple of 90°; rotate the image by 17.19°"
         " counter-clockwise and set yaw to 0."),
        ({"mode": "scaled"}, "mode is 'scaled', but must be trinary, scale or raw."),
        ({"image": "[a, b]"}, "image is ['a', 'b'], but must be a file name."),
        ({"resolution": "fine"}, "resolution is 'fine', but must be a number below 1e9."),
        ({"resolution": "nan"}, "resolution is 'nan', but must be a number below 1e9."),
        ({"resolution": "0"}, "resolution is 0, but must be above 0 m."),
        ({"negate": "2"}, "negate is '2', but must be 0, 1, true or false."),
        ({"origin": "[0, 0]"},
         "origin is ['0', '0'], but must be three numbers below 1e9: x, y in m, yaw in rad."),
        ({"free_thresh": "0.7"}, "free_thresh 0.7 and occupied_thresh 0.65 are out of order;"
         " must be 0 ≤ free_thresh ≤ occupied_thresh ≤ 1."),
        ({"origin": "[99999.9, 0, 0]"},
         "origin (99999.9, 0) is too far away: coordinates of the map must be within ±100000 m; set"
         " origin to [0, 0, 0] and subtract (99999.9, 0) from all your coordinates."),
        ({"free_thresh": "0.1\nfree_thresh: 0.2"},
         "duplicate key 'free_thresh'; delete one."),
    ],
)  # fmt: skip
def test_invalid_values_are_refused(tmp_path: Path, changes: dict[str, str | None], sentence: str) -> None:
    assert refusal(written(tmp_path, **changes)) == f"plan.yaml: {sentence}"


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"- image", "the YAML must be a mapping with the keys image, resolution, origin, negate,"
         " occupied_thresh, free_thresh, mode."),
        (b"image: [", "invalid YAML: while parsing a flow node expected the node content, but found"
         ' \'<stream end>\' in "<byte string>", line 1, column 9: image: [ ^.'),
        (b"# " + b"x" * 65_536, "the map cannot be read: has more than 65536 bytes."),
    ],
)  # fmt: skip
def test_invalid_yaml_is_refused(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "plan.yaml"
    path.write_bytes(content)
    assert refusal(path) == f"plan.yaml: {sentence}"
    missing = tmp_path / "gone.yaml"
    assert refusal(missing) == "gone.yaml: the map cannot be read: No such file or directory."
    gone = written(tmp_path, image="gone.png")
    assert refusal(gone) == "gone.png: the map's image cannot be read: No such file or directory."


scalars = st.one_of(st.floats().map(str), st.integers().map(str), st.text(max_size=8), st.just("[1, 2, 3]"))


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=80) | st.dictionaries(st.sampled_from([*YAML, "mode"]), scalars))
def test_any_yaml_gives_a_grid_or_a_refusal(tmp_path: Path, content: bytes | dict[str, str]) -> None:
    path = written(tmp_path, **(content if isinstance(content, dict) else {}))
    if isinstance(content, bytes):
        path.write_bytes(path.read_bytes() + content)
    try:
        load_map(path)
    except MapError as error:
        assert str(error).endswith(".")


GREY = Image.fromarray(GREYS)
WIDE = GREYS.astype(np.uint16) * 257


def image_map(folder: Path, content: bytes | Image.Image, name: str = "image", **options: Any) -> Path:
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
    if "webp" not in name:
        path = image_map(tmp_path, Image.fromarray(WIDE), name)  # of 16 bits
        assert load_map(path).cells.tolist() == CELLS


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


def test_channels_are_averaged_and_colours_cause_a_warning(tmp_path: Path) -> None:
    colours = np.repeat(GREYS[..., None], 3, axis=2)
    colours[1, 0] = 254, 254, 255
    path = image_map(tmp_path, Image.fromarray(colours), "a.png")
    assert load_map(path).cells.tolist() == CELLS and map_warnings(path) == ()
    colours[1, 2] = 200, 0, 61  # a mean of 87: occupied
    path = image_map(tmp_path, Image.fromarray(colours), "a.png")
    assert load_map(path).cells.tolist() == [[FREE, FREE, OCCUPIED], [OCCUPIED, UNKNOWN, UNKNOWN]]
    assert map_warnings(path) == (
        "plan.yaml: 1 pixels are coloured, the first in column 2, row 1 from the top: (200, 0, 61); using"
        " the mean of red, green and blue",
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
    pixels = np.full((60, 80), 205, np.uint8)
    pixels[10:50, 10:70] = 0
    pixels[12:48, 12:68] = 254
    if window:
        pixels[10:12, 20:30] = 205
    return pixels


@pytest.mark.parametrize("window", [True, False])
def test_unknown_grey_as_free_causes_a_warning(tmp_path: Path, window: bool) -> None:
    path = saved_by_slam(tmp_path, building(window), "0.25")
    (told,) = map_warnings(path)
    assert "makes grey 205 free floor" in told and "border" in told
    assert told.endswith("set free_thresh to 0.196")
    assert map_warnings(saved_by_slam(tmp_path, building(window), "0.196")) == ()


def test_other_greys_and_pockets_as_free_cause_a_warning(tmp_path: Path) -> None:
    pixels = building(window=True)
    pixels[pixels == 205] = 128
    (told,) = map_warnings(saved_by_slam(tmp_path, pixels, "0.55"))
    assert "grey 128" in told and told.endswith("set free_thresh to 0.498")
    assert (load_map(saved_by_slam(tmp_path, pixels, "0.498")).cells[0] == UNKNOWN).all()
    pocket = building(window=False)[10:50, 10:70]
    pocket[20:30, 20:40] = 205
    (told,) = map_warnings(saved_by_slam(tmp_path, pocket, "0.25"))
    assert "grey 205" in told and "border" not in told


def test_rooms_without_grey_cause_no_warning(tmp_path: Path) -> None:
    room = building(window=False)[10:50, 10:70]
    assert map_warnings(saved_by_slam(tmp_path, room, "0.25")) == ()
    room[0, :] = 254  # an open side
    assert map_warnings(saved_by_slam(tmp_path, room, "0.25")) == ()
    assert map_warnings("offices:7") == ()


def test_damaged_images(tmp_path: Path) -> None:
    assert refusal(image_map(tmp_path, b"not an image")) == (
        "image: unknown image format; supported are PNG, PPM, BMP, GIF, TIFF, WEBP, JPEG."
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
        (MapLimits(cells=5), "3 x 2 pixels; the limit is 5"),
        (MapLimits(image_bytes=20), "has more than 20 bytes"),
    ):
        assert refusal(path, limits=limits) == f"plan.png: the map's image cannot be read: {reason}."
    huge = image_map(tmp_path, b"P5 12000 12000 255\n")
    assert refusal(huge).endswith("12000 x 12000 pixels; the limit is 16000000.")
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
"""Without TIFF, as libtiff writes to standard error."""


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    image=st.sampled_from(IMAGES),
    changes=st.lists(st.tuples(st.integers(0, 200), st.binary(max_size=4)), max_size=4),
)
def test_any_image_is_read_or_refused(tmp_path: Path, image: bytes, changes: list[tuple[int, bytes]]) -> None:
    for at, content in changes:
        image = image[:at] + content + image[at + len(content) + at % 2 :]
    try:
        assert isinstance(load_map(image_map(tmp_path, image)), OccupancyGrid)
    except MapError as error:
        assert str(error).startswith(f"{tmp_path}/image: ")
