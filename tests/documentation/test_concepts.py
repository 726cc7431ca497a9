"""docs/concepts.md defines each word once, and has the product's words for robots' states and lost time."""

import ast
import re
from collections import Counter

from actors.installation.repository import REPOSITORY
from actors.observer.glyphs import OWN_STATES, SEEN_STATES
from command_line.documentation.markdown import pages
from observation.accounting.time_spent import Cause
from observation.trace.rows import ACTIVITIES

PAGE = next(page.text for page in pages() if page.name == "docs/concepts.md")


def words(title: str) -> list[str]:
    """The words that the table below a heading defines, in order."""
    section = PAGE.partition(f"## {title}\n")[2].partition("\n## ")[0]
    return re.findall(r"^\| `([^`]+)`", section, re.MULTILINE)


def test_the_causes_are_those_of_every_picture_in_the_order_in_which_they_hold() -> None:
    assert words("Causes") == [cause.value for cause in Cause]
    assert set(SEEN_STATES) == {cause.value for cause in Cause}


def test_what_a_robot_does_has_the_words_of_the_viewer() -> None:
    assert sorted(words("What a robot does")) == sorted(ACTIVITIES)
    assert set(ACTIVITIES) < set(OWN_STATES)


def test_each_word_is_defined_once() -> None:
    cells = re.findall(r"^\| (\*[^|]+)", PAGE, re.MULTILINE)
    defined = Counter(word for cell in cells for word in re.findall(r"\*([^*]+)\*", cell))
    assert len(defined) > 40
    assert [word for word, count in defined.items() if count > 1] == []


def test_no_two_classes_that_an_author_meets_share_a_name() -> None:
    files = [file for room in ("cleaning", "examples") for file in (REPOSITORY / room).rglob("*.py")]
    texts = [file.read_text() for file in (*files, *(REPOSITORY / "actors/robot/behaviour").glob("*.py"))]
    texts += [block.text for page in pages() for block in page.blocks() if block.language == "python"]
    classes = (node for text in texts for node in ast.parse(text).body if isinstance(node, ast.ClassDef))
    counted = Counter(one.name for one in classes if not one.name.startswith("_"))
    assert [name for name, count in counted.items() if count > 1] == []
