"""Commands `acrc list`: strategies, presets, robot models, scenarios and maps, as tables or JSON.

Summaries come from docstrings and from the comments at the head of files.
"""

import ast
import contextlib
import inspect
import os
import re
import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import entry_points
from itertools import pairwise
from pathlib import Path
from typing import Any

from acrc_testbed.command_line.shared_options import Json, answer, command_group
from actors.installation.repository import REPOSITORY, SHIPPED

Row = Mapping[str, Any]


def strategies(json: Json = False) -> None:
    """List strategies, also those of installed packages."""
    registry = REPOSITORY / "cleaning" / "strategies" / "registry.py"
    if entry_points(group=ast.literal_eval(assigned(registry, "GROUP")[0])):
        rows = _registered_strategies()
    else:  # parsed, not imported: the import takes as long as all of the rest
        table = ast.literal_eval(_dicts(assigned(registry, "STRATEGIES")[0])[0])
        rows = [_shipped_row(name, entry) for name, entry in table.items()]
    shown = [{**row, "text": row["error"] or row["summary"]} for row in rows]
    columns = {"name": "{name}", "from": "{source}", "summary and entry": "{text}\n{entry}"}
    _print_rows(rows, columns, shown, json=json)


def presets(json: Json = False) -> None:
    """List presets of radio, localisation and navigation."""
    # parsed, not imported: the import takes as long as starting a simulation
    actors = REPOSITORY / "actors"
    summary = dict_constant(actors / "robot" / "stack.py", "ODOMETRY")[1].removesuffix(".")
    odometry = {"table": "localisation", "name": "odometry", "summary": summary}
    localisation = dict_constant(actors / "robot" / "localisation" / "parameters.py", "PRESETS")
    navigation = dict_constant(actors / "robot" / "navigation" / "navigator.py", "NAVIGATION_PRESETS")
    rows = [
        *_preset_rows("radio", *_commented_tables(actors / "radio" / "presets.toml")),
        *_preset_rows("localisation", *localisation),
        odometry,
        *_preset_rows("navigation", *navigation),
    ]
    columns = {"table": "[{table}]", "preset": "{name}", "summary": "{summary}"}
    _print_rows(rows, columns, json=json)


def models(json: Json = False) -> None:
    """List shipped robot models and their range sensors."""
    rows = [_model_row(path) for path in sorted((REPOSITORY / "actors" / "models").glob("*.toml"))]
    shown = [{**row, "sensors": "\n".join(map(_sensor_text, row["sensors"]))} for row in rows]
    columns = {"model": "{name}", "drive": "{drive}", "sensors": "{sensors}", "summary": "{summary}"}
    _print_rows(rows, columns, shown, json=json)


def scenarios(json: Json = False) -> None:
    """List shipped scenarios."""
    rows = [
        {"name": path.stem, "path": os.path.relpath(path), "summary": head_comment(path.read_text("utf-8"))}
        for path in sorted((SHIPPED / "scenarios").glob("*.toml"))
    ]
    _print_rows(rows, {"scenario": "{path}", "summary": "{summary}"}, json=json)


def maps(json: Json = False) -> None:
    """List shipped floor plans and their sizes."""
    rows = [_map_row(path) for path in sorted((SHIPPED / "maps").glob("*.yaml"))]
    columns = {
        "map": "{path}",
        "west to east": "{width:.2f} m",
        "south to north": "{depth:.2f} m",
        "cell": "{resolution:g} m",
    }
    _print_rows(rows, columns, json=json)


app = command_group(
    "List strategies, presets, robot models, scenarios and maps.",
    strategies,
    presets,
    models,
    scenarios,
    maps,
)


def _print_rows(
    rows: Sequence[Row], columns: Mapping[str, str], shown: Sequence[Row] = (), *, json: bool
) -> None:
    """Print all rows as JSON, or a table of `columns` (format of a cell by title); `shown`: its rows."""
    from rich.table import Table

    table = Table(*columns, box=None, pad_edge=False)
    for row in shown or rows:
        table.add_row(*(cell.format_map(row) for cell in columns.values()))
    answer([table], rows, json=json)


def _shipped_row(name: str, entry: str) -> Row:
    module, _, function = entry.partition(":")
    body = ast.parse(REPOSITORY.joinpath(*module.split(".")).with_suffix(".py").read_bytes()).body
    behaviour = next(node for node in body if isinstance(node, ast.FunctionDef) and node.name == function)
    summary = (ast.get_docstring(behaviour) or "").partition("\n")[0]
    return {"name": name, "entry": entry, "source": "shipped", "summary": summary, "error": ""}


def _registered_strategies() -> list[Row]:
    from cleaning.strategies import strategies as known

    with contextlib.redirect_stdout(sys.stderr):  # imported modules may print
        return [_strategy_row(one) for one in known()]


def _strategy_row(strategy: Any) -> Row:
    """Return the row of a strategy, with an `error` if it cannot be imported."""
    from actors.robot.behaviour.loading import entry_function
    from actors.runtime.errors import AcrcError

    summary = error = ""
    try:
        summary = (inspect.getdoc(entry_function(strategy.entry)) or "").partition("\n")[0]
    except AcrcError as fault:
        error = str(fault)
    except (Exception, SystemExit) as fault:
        error = f"cannot be imported: {type(fault).__name__}: {fault}"
    names = {"name": strategy.name, "entry": strategy.entry, "source": strategy.source}
    return {**names, "summary": summary, "error": strategy.fault or error}


def _commented_tables(path: Path) -> tuple[Iterable[str], str]:
    """Return the tables of a TOML file, and its comments on one line."""
    text = path.read_text("utf-8")
    return tomllib.loads(text), " ".join(re.findall("^# (.*)", text, re.MULTILINE))


def _preset_rows(table: str, names: Iterable[str], doc: str) -> list[Row]:
    return [{"table": table, "name": one, "summary": preset_summary(one, doc)} for one in names]


def _model_row(path: Path) -> Row:
    text = path.read_text("utf-8")
    file: dict[str, Any] = tomllib.loads(text)
    keys = ("field_of_view_deg", "rays", "range_max", "rate")
    sensors = [
        {"name": name, "default": name == file["default_sensor"], **{key: sensor[key] for key in keys}}
        for name, sensor in file["sensors"].items()
    ]
    summary = head_comment(text)
    return {"name": path.stem, "drive": file["drive"]["kind"], "sensors": sensors, "summary": summary}


def _sensor_text(sensor: Row) -> str:
    rays = f"{sensor['rays']} rays over {sensor['field_of_view_deg']:g}°"
    default = " (default)" if sensor["default"] else ""
    return f"{sensor['name']}{default}: {rays}, to {sensor['range_max']:g} m, {sensor['rate']:g} Hz"


def _map_row(path: Path) -> Row:
    from actors.floor.map_file import load_map

    grid = load_map(path)
    size = {"width": grid.columns * grid.resolution, "depth": grid.rows * grid.resolution}
    return {"name": path.stem, "path": os.path.relpath(path), **size, "resolution": grid.resolution}


def head_comment(text: str) -> str:
    """Return the first sentence of the comment at the head of a TOML file, or ""."""
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.removeprefix("#").strip())
    return re.split(r"(?<=\.)\s", " ".join(lines), maxsplit=1)[0]


def assigned(source: Path, name: str) -> tuple[ast.expr, str]:
    """Return the expression that a module assigns to a name, and its docstring on one line."""
    for here, below in pairwise(ast.parse(source.read_bytes()).body):
        targets = here.targets if isinstance(here, ast.Assign) else [getattr(here, "target", None)]
        if any(isinstance(target, ast.Name) and target.id == name for target in targets):
            assert isinstance(here, ast.Assign | ast.AnnAssign) and here.value is not None
            doc = below.value if isinstance(below, ast.Expr) else None
            return here.value, " ".join(str(doc.value).split()) if isinstance(doc, ast.Constant) else ""
    raise AssertionError(f"{source}: {name} is not assigned")


def dict_constant(source: Path, name: str) -> tuple[list[str], str]:
    """Return the keys of the first dict literal that a module assigns to a name, and its docstring."""
    value, doc = assigned(source, name)
    return [ast.literal_eval(key) for node in _dicts(value)[:1] for key in node.keys if key is not None], doc


def _dicts(value: ast.expr) -> list[ast.Dict]:
    return [node for node in ast.walk(value) if isinstance(node, ast.Dict)]


def preset_summary(name: str, doc: str) -> str:
    """Return the text of `name` in a docstring "`name`: this. `other`: that.", or "".

    Drops brackets; ends at the first full stop, colon or semicolon.
    """
    found = re.search(rf"`{re.escape(name)}`[^:`]*: (.+?)[.:;](?: |$)", re.sub(r" \([^()]*\)", "", doc))
    return found[1] if found else ""
