from importlib.util import find_spec

import pytest


def test_what_draws_a_run_is_there_to_be_tested() -> None:
    if find_spec("rerun") is None:
        pytest.skip("rerun is not installed, so the view is not tested; `./acrc view` installs it")
