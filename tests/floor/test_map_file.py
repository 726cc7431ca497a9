import math
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN
from actors.floor.map_file import load_map, map_warnings
from actors.floor.map_header import MapError
from actors.geometry import Point
from tests.floor.map_files import YAML, refusal, written

CELLS = [[FREE, FREE, OCCUPIED], [OCCUPIED, UNKNOWN, UNKNOWN]]
"""Of `written`. Occupancies: 0 → 1; 100 → .608; 205 → .19608, not below .196; 254 → .004; 88 → .655."""


def test_the_thresholds_make_three_states_and_the_top_row_is_the_north(tmp_path: Path) -> None:
    grid = load_map(written(tmp_path))
    assert grid.cells.tolist() == CELLS
    assert (grid.resolution, grid.origin) == (0.05, Point(-1.0, 2.0))
    assert map_warnings(tmp_path / "plan.yaml") == ()


def test_a_pixel_exactly_at_a_threshold_is_unknown(tmp_path: Path) -> None:
    grid = load_map(written(tmp_path, free_thresh="0", occupied_thresh="1"))
    assert (grid.cells == UNKNOWN).all()


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
def test_numbers_that_yaml_takes_as_text(
    tmp_path: Path, key: str, text: str, value: float | tuple[float, float]
) -> None:
    assert getattr(load_map(written(tmp_path, **{key: text})), key) == value


@pytest.mark.parametrize("text", ["1", '"1"', "true", '"true"', "True", "yes"])
def test_negate_makes_white_the_wall(tmp_path: Path, text: str) -> None:
    grid = load_map(written(tmp_path, negate=text))
    assert grid.cells.tolist() == [[OCCUPIED, OCCUPIED, UNKNOWN], [FREE, UNKNOWN, OCCUPIED]]


@pytest.mark.parametrize("key", ["negate", "occupied_thresh", "free_thresh"])
@pytest.mark.parametrize("text", [None, "", "null"])
def test_optional_keys_have_defaults(tmp_path: Path, key: str, text: str | None) -> None:
    assert load_map(written(tmp_path, **{key: text})).cells.tolist() == CELLS


def test_exponents_and_quotes_in_thresholds(tmp_path: Path) -> None:
    grid = load_map(written(tmp_path, occupied_thresh='"0.99"', free_thresh="1e-3", negate='"0"'))
    assert grid.cells.tolist() == [[UNKNOWN, FREE, UNKNOWN], [OCCUPIED, UNKNOWN, UNKNOWN]]


@pytest.mark.parametrize("mode", ["trinary", "Trinary", "scale", "SCALE", '"scale"'])
def test_scale_is_thresholded_like_trinary(tmp_path: Path, mode: str) -> None:
    assert load_map(written(tmp_path, mode=mode)).cells.tolist() == CELLS


@pytest.mark.parametrize("mode", ["raw", "Raw"])
def test_raw_pixels_are_percentages(tmp_path: Path, mode: str) -> None:
    grid = load_map(written(tmp_path, mode=mode, negate="1"))
    assert grid.cells.tolist() == [[UNKNOWN, UNKNOWN, OCCUPIED], [FREE, OCCUPIED, UNKNOWN]]


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
def test_quarter_turns_of_the_origin_turn_the_grid(
    tmp_path: Path, yaw: str, cells: list[list[int]], origin: tuple[float, float]
) -> None:
    path = written(tmp_path, origin=f"[-1.0, 2.0, {yaw}]")
    grid = load_map(path)
    assert grid.cells.tolist() == cells
    assert grid.origin == pytest.approx(origin)
    assert len(map_warnings(path)) == (cells is not CELLS)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_point_of_the_image_lies_where_the_turned_origin_puts_it(tmp_path: Path, turns: int) -> None:
    plain = load_map(written(tmp_path))
    turned = load_map(written(tmp_path, origin=f"[-1.0, 2.0, {turns * math.pi / 2}]"))
    for row in range(plain.rows):
        for column in range(plain.columns):
            x, y = (column + 0.5) * 0.05, (row + 0.5) * 0.05
            for _ in range(turns):
                x, y = -y, x
            assert turned.cells[turned.cell(Point(-1.0 + x, 2.0 + y))] == plain.cells[row, column]


def test_other_angles_are_refused_with_the_turn_of_the_image(tmp_path: Path) -> None:
    assert refusal(written(tmp_path, origin="[0, 0, 0.3]")) == (
        "plan.yaml: origin has yaw 0.3 rad, but only multiples of 90° can be read; turn the image by 17.19°"
        " counter-clockwise and set yaw to 0."
    )


def test_keys_of_other_tools_are_ignored_with_one_warning(tmp_path: Path) -> None:
    path = written(tmp_path, map_frame="map", cost_translation_table="null", **{"7": "x", "{1: 2}": "3"})
    assert load_map(path).cells.tolist() == CELLS
    assert map_warnings(path) == ("plan.yaml: ignored keys: 'map_frame, cost_translation_table, 7, …'",)


@pytest.mark.parametrize(
    "content",
    [
        "---\n{}---\n",
        "{}---\nanother: document\n",
        "# Büro\n{}",
        "tab:\t1\n{}\t\n",
    ],
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
def test_an_image_path_of_another_computer_means_the_image_beside(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, image=name)
    assert load_map(path).cells.tolist() == CELLS
    assert "does not exist; plan.png beside the YAML is read" in map_warnings(path)[0]


@pytest.mark.parametrize("key", ["image", "resolution", "origin"])
def test_keys_without_default_are_needed(tmp_path: Path, key: str) -> None:
    assert refusal(written(tmp_path, **{key: None})) == (
        f"plan.yaml: the key '{key}' is missing; a map needs image, resolution, origin."
    )


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"mode": "scaled"}, "mode is 'scaled', but must be trinary, scale or raw."),
        ({"image": "[a, b]"}, "image is ['a', 'b'], but must be the name of a file."),
        ({"resolution": "fine"}, "resolution is 'fine', but must be a number below 1e9."),
        ({"resolution": "nan"}, "resolution is 'nan', but must be a number below 1e9."),
        ({"resolution": "0"}, "resolution is 0, but a cell must be longer than 0 m."),
        ({"negate": "2"}, "negate is '2', but must be 0, 1, true or false."),
        (
            {"origin": "[0, 0]"},
            "origin is ['0', '0'], but must be three numbers below 1e9: x, y in m, yaw in rad.",
        ),
        (
            {"free_thresh": "0.7"},
            "free_thresh 0.7 and occupied_thresh 0.65 are out of order;"
            " right is 0 ≤ free_thresh ≤ occupied_thresh ≤ 1.",
        ),
        (
            {"origin": "[99999.9, 0, 0]"},
            "origin (99999.9, 0) is too far from 0: coordinates of the map must be within ±100000 m; set"
            " origin to [0, 0, 0] and subtract (99999.9, 0) from coordinates that you give.",
        ),
        (
            {"free_thresh": "0.1\nfree_thresh: 0.2"},
            "the key 'free_thresh' is there twice; delete one of the two.",
        ),
    ],
)
def test_a_wrong_value_is_named_with_what_would_be_right(
    tmp_path: Path, changes: dict[str, str], sentence: str
) -> None:
    assert refusal(written(tmp_path, **changes)) == f"plan.yaml: {sentence}"


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
         " occupied_thresh, free_thresh, mode."),
        (b"image: [", "this is not YAML: while parsing a flow node expected the node content, but found"
         ' \'<stream end>\' in "<byte string>", line 1, column 9: image: [ ^.'),
        (b"# " + b"x" * 65_536, "the map cannot be read: has more than 65536 bytes."),
    ],
)  # fmt: skip
def test_yaml_that_is_none(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "plan.yaml"
    path.write_bytes(content)
    assert refusal(path) == f"plan.yaml: {sentence}"


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
