"""What a check has found."""

import msgspec


class DoctorFinding(msgspec.Struct, frozen=True):
    """One thing that was looked at: how it is, and if it is wrong what would put it right: one sentence."""

    subject: str
    ok: bool
    text: str


def well(subject: str, text: str) -> DoctorFinding:
    """As it should be."""
    return DoctorFinding(subject, True, text)


def wrong(subject: str, text: str) -> DoctorFinding:
    """Not as it should be."""
    return DoctorFinding(subject, False, text)
