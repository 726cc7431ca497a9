"""What needs rerun is left out where that is not installed, and one skipped test says so."""

from importlib.util import find_spec

collect_ignore = [] if find_spec("rerun") else ["test_glyphs.py", "test_view.py"]
