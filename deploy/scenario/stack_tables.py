"""What the tables about localisation and navigation say, in a scenario or in a fleet file."""

from actors.robot.stack import TABLES, StackError, stack
from actors.table import Table


def stack_fault(file: Table) -> str | None:
    """What is wrong in them, in words without an end; None if nothing is."""
    try:
        stack(file.model_dump(include=set(TABLES)))
    except StackError as error:
        return str(error)
    return None
