from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN
from actors.floor.map_file import MapError, MapLimits, load_map
from actors.geometry import Point

YAML = {
    "image": "plan.png",
    "resolution": "0.05",
    "origin": "[-1.0, 2.0, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}
GREYS = np.array([[0, 100, 205], [254, 255, 88]], dtype=np.uint8)


def written(directory: Path, picture: Image.Image | None = None, /, **changes: str | None) -> Path:
    """A map in `directory`; a change to None leaves the key out."""
    (picture or Image.fromarray(GREYS)).save(directory / "plan.png")
    fields = {key: text for key, text in (YAML | changes).items() if text is not None}
    path = directory / "plan.yaml"
    path.write_text("".join(f"{key}: {text}\n" for key, text in fields.items()), encoding="utf-8")
    return path


def refusal(path: Path, **options: Any) -> str:
    """The sentence that `load_map` refuses with, without the directory."""
    with pytest.raises(MapError) as caught:
        load_map(path, **options)
    return str(caught.value).replace(f"{path.parent}/", "")


def test_the_thresholds_make_three_states_and_the_top_row_is_the_north(tmp_path: Path) -> None:
    grid = load_map(written(tmp_path))
    # occupancies: 0 → 1; 100 → .608; 205 → .19608, just not below .196; 254 → .004; 255 → 0; 88 → .655
    assert grid.cells.tolist() == [[FREE, FREE, OCCUPIED], [OCCUPIED, UNKNOWN, UNKNOWN]]
    assert (grid.resolution, grid.origin) == (0.05, Point(-1.0, 2.0))


def test_a_pixel_exactly_at_a_threshold_is_unknown(tmp_path: Path) -> None:
    grid = load_map(written(tmp_path, free_thresh="0", occupied_thresh="1"))
    assert (grid.cells == UNKNOWN).all()


def test_negate_makes_white_the_wall(tmp_path: Path) -> None:
    grid = load_map(written(tmp_path, negate="1", mode="trinary"))
    assert grid.cells.tolist() == [[OCCUPIED, OCCUPIED, UNKNOWN], [FREE, UNKNOWN, OCCUPIED]]


def test_pgm_and_grey_in_other_clothes_give_the_same_map(tmp_path: Path) -> None:
    expected = load_map(written(tmp_path)).cells.tolist()
    grey = Image.fromarray(GREYS)
    for mode in ("RGB", "RGBA", "LA"):
        assert load_map(written(tmp_path, grey.convert(mode))).cells.tolist() == expected
    palette = grey.convert("P")
    assert palette.mode == "P" and load_map(written(tmp_path, palette)).cells.tolist() == expected
    grey.save(tmp_path / "plan.pgm")
    assert load_map(written(tmp_path, image="plan.pgm")).cells.tolist() == expected
    (tmp_path / "text.pgm").write_text("P2\n# by hand\n3 2\n255\n0 100 205\n254 255 88\n")
    assert load_map(written(tmp_path, image="text.pgm")).cells.tolist() == expected
    bits = Image.fromarray(np.array([[True, False]]))
    assert bits.mode == "1" and load_map(written(tmp_path, bits)).cells.tolist() == [[FREE, OCCUPIED]]


@pytest.mark.parametrize("key", YAML)
def test_every_key_is_needed(tmp_path: Path, key: str) -> None:
    assert refusal(written(tmp_path, **{key: None})) == (
        f"plan.yaml: the key '{key}' is missing; a map needs image, resolution, origin, negate,"
        " occupied_thresh, free_thresh."
    )


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"resolutoin": "0.05"},
            "the key 'resolutoin' is not known; a map has image, resolution, origin, negate, occupied_thresh,"
            " free_thresh and mode.",
        ),
        ({"mode": "scale"}, "mode is 'scale', but only 'trinary' is supported."),
        ({"image": "7"}, "image is 7, but must be the name of a file."),
        ({"resolution": "fine"}, "resolution is 'fine', but must be a number below 1e9."),
        ({"resolution": ".inf"}, "resolution is inf, but must be a number below 1e9."),
        ({"resolution": "true"}, "resolution is True, but must be a number below 1e9."),
        ({"resolution": "0"}, "resolution is 0, but a cell must be longer than 0 m."),
        ({"resolution": "-0.05"}, "resolution is -0.05, but a cell must be longer than 0 m."),
        ({"negate": "2"}, "negate is 2, but must be 0 or 1."),
        ({"negate": "no way"}, "negate is 'no way', but must be 0 or 1."),
        (
            {"origin": "[0, 0]"},
            "origin is [0, 0], but must be three numbers below 1e9: x and y in m, yaw 0.",
        ),
        (
            {"origin": "[0, .nan, 0]"},
            "origin is [0, nan, 0], but must be three numbers below 1e9: x and y in m, yaw 0.",
        ),
        (
            {"origin": "[0, 0, 1.5]"},
            "the origin is turned by 1.5 rad, but only maps with yaw 0 are supported.",
        ),
        (
            {"free_thresh": "0.7"},
            "free_thresh 0.7 and occupied_thresh 0.65 are out of order;"
            " right is 0 ≤ free_thresh ≤ occupied_thresh ≤ 1.",
        ),
        (
            {"occupied_thresh": "65"},
            "free_thresh 0.196 and occupied_thresh 65 are out of order;"
            " right is 0 ≤ free_thresh ≤ occupied_thresh ≤ 1.",
        ),
    ],
)
def test_a_wrong_value_is_named_with_what_would_be_right(
    tmp_path: Path, changes: dict[str, str], sentence: str
) -> None:
    assert refusal(written(tmp_path, **changes)) == f"plan.yaml: {sentence}"


def test_an_integer_beyond_any_float_is_no_number(tmp_path: Path) -> None:
    path = written(tmp_path, resolution="1" + "0" * 400)
    assert refusal(path).endswith(", but must be a number below 1e9.")


def test_files_that_are_not_there(tmp_path: Path) -> None:
    missing = tmp_path / "gone.yaml"
    assert refusal(missing) == "gone.yaml: the map cannot be read: No such file or directory."
    assert refusal(written(tmp_path, image="gone.png")) == (
        "gone.png: the map's image cannot be read: No such file or directory."
    )


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"- image", "a map's YAML must be a list of keys and values, image, resolution, origin, negate,"
         " occupied_thresh, free_thresh."),
        (b"image: [", "this is not YAML: while parsing a flow node expected the node content, but found"
         ' \'<stream end>\' in "<byte string>", line 1, column 9: image: [ ^.'),
        (b"# " + b"x" * 65_536, "a map's YAML may have at most 65536 bytes, but this is larger."),
    ],
)  # fmt: skip
def test_yaml_that_is_none(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "plan.yaml"
    path.write_bytes(content)
    assert refusal(path) == f"plan.yaml: {sentence}"


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"[" * 60_000, b"\x00", b"d: 2001-99-99"])
def test_bytes_at_random_are_refused_too(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "plan.yaml"
    path.write_bytes(content)
    assert refusal(path).startswith("plan.yaml: this is not YAML: ")


def test_images_that_are_no_floor_plan(tmp_path: Path) -> None:
    colours = np.repeat(GREYS[..., None], 3, axis=2)
    colours[1, 2] = 10, 20, 30
    assert refusal(written(tmp_path, Image.fromarray(colours))) == (
        "plan.png: the pixel in column 2, row 1 from the top has the colour (10, 20, 30),"
        " but each must be black, white or grey."
    )
    clear = Image.fromarray(GREYS).convert("LA")
    clear.putpixel((0, 0), (0, 0))
    assert refusal(written(tmp_path, clear)) == (
        "plan.png: the image has transparent pixels, but each must be black, white or grey."
    )
    assert refusal(written(tmp_path, Image.fromarray(GREYS.astype(np.uint16)))) == (
        "plan.png: the image is of Pillow's mode 'I;16', but must be grey with 8 bits."
    )


def test_damaged_images(tmp_path: Path) -> None:
    path = written(tmp_path)
    whole = (tmp_path / "plan.png").read_bytes()
    (tmp_path / "plan.png").write_bytes(b"not an image")
    assert refusal(path) == "plan.png: this is not an image that can be read; right are PNG, PGM and BMP."
    refused = 0
    for length in range(len(whole)):
        (tmp_path / "plan.png").write_bytes(whole[:length])
        try:  # without its last bytes an image may still have all its pixels
            assert load_map(path).cells.tolist() == load_map(written(tmp_path)).cells.tolist()
        except MapError as error:
            assert str(error).startswith(f"{tmp_path}/plan.png: ")
            refused += 1
    assert refused > len(whole) / 2


def test_an_image_too_large_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    path = written(tmp_path)
    assert refusal(path, limits=MapLimits(cells=5)) == (
        "plan.png: the image has 3 x 2 pixels, but at most 5 are allowed."
    )
    assert refusal(path, limits=MapLimits(image_bytes=20)) == (
        "plan.png: a map's image may have at most 20 bytes, but this is larger."
    )
    (tmp_path / "huge.pgm").write_bytes(b"P5 12000 12000 255\n")
    assert refusal(written(tmp_path, image="huge.pgm")) == (
        "huge.pgm: the image has 12000 x 12000 pixels, but at most 16000000 are allowed."
    )
    (tmp_path / "bomb.pgm").write_bytes(b"P5 99999 99999 255\n")
    assert refusal(written(tmp_path, image="bomb.pgm")) == (
        "bomb.pgm: the image has far more than the 16000000 pixels allowed."
    )
