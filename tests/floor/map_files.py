"""Map files for tests."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from actors.floor.map_file import load_map
from actors.floor.map_header import MapError

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
    """Write a map into `directory`; a change to None leaves the key out."""
    (picture or Image.fromarray(GREYS)).save(directory / "plan.png")
    fields = {key: text for key, text in (YAML | changes).items() if text is not None}
    path = directory / "plan.yaml"
    path.write_text("".join(f"{key}: {text}\n" for key, text in fields.items()), encoding="utf-8")
    return path


def refusal(path: Path, **options: Any) -> str:
    """Return the sentence that `load_map` refuses with, without the directory."""
    with pytest.raises(MapError) as caught:
        load_map(path, **options)
    return str(caught.value).replace(f"{path.parent}/", "")
