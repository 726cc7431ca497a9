"""Strict readers of systemd units and udev rules: whatever is not understood raises ValueError."""

import re

KNOWN = {
    "Unit": "Description Wants After StartLimitIntervalSec StartLimitBurst",
    "Service": "Type NotifyAccess TimeoutStartSec WatchdogSec ExecStopPost "
    "User SupplementaryGroups StateDirectory WorkingDirectory ExecStart Restart RestartSec "
    "KillMode SuccessExitStatus TimeoutStopSec Nice StandardOutput StandardError SyslogIdentifier "
    "DevicePolicy DeviceAllow ProtectSystem ReadWritePaths PrivateTmp NoNewPrivileges CapabilityBoundingSet "
    "ProtectClock ProtectControlGroups ProtectHostname ProtectKernelLogs ProtectKernelModules "
    "ProtectKernelTunables RestrictAddressFamilies RestrictRealtime RestrictSUIDSGID "
    "LockPersonality SystemCallArchitectures",
    "Install": "WantedBy",
}
"""systemd.unit(5), systemd.service(5), systemd.exec(5), systemd.kill(5), systemd.resource-control(5)."""
MANY = {"DeviceAllow"}

_RULE_TOKEN = re.compile(
    r'(?P<key>[A-Z]+)(?:\{(?P<attribute>[A-Za-z0-9_/.]+)\})?(?P<operator>==|!=|\+=|=)"(?P<value>[^"\\]*)"'
)
_OPERATORS = {
    "ACTION": {"==", "!="},
    "SUBSYSTEM": {"==", "!="},
    "ATTRS": {"==", "!="},
    "KERNELS": {"=="},
    "ATTR": {"="},
    "GROUP": {"="},
    "MODE": {"="},
    "SYMLINK": {"+="},
    "TAG": {"+="},
    "GOTO": {"="},
    "LABEL": {"="},
}
"""udev(7)."""


def read_unit(text: str) -> dict[str, dict[str, list[str]]]:
    """Values by section and key."""
    sections: dict[str, dict[str, list[str]]] = {}
    for line in text.splitlines():
        if not line or line.startswith("#"):
            continue
        if header := re.fullmatch(r"\[(\w+)\]", line):
            current = sections.setdefault(header[1], {})
            known = KNOWN[header[1]].split()
            continue
        key, equals, value = line.partition("=")
        if not equals or key not in known or (key in current and key not in MANY):
            raise ValueError(line)
        current.setdefault(key, []).append(value)
    return sections


def words(line: str) -> list[str]:
    """A command line as systemd splits it; specifiers and variables must be escaped, and raise ValueError."""
    found = []
    for quoted, plain in re.findall(r'"((?:[^"\\]|\\["\\])*)"|(\S+)', line):
        word = re.sub(r'\\(["\\])', r"\1", quoted) if quoted else plain
        if re.search(r"(?<!%)(?:%%)*%(?!%)|(?<!\$)(?:\$\$)*\$(?!\$)", word):
            raise ValueError(word)
        found.append(word.replace("%%", "%").replace("$$", "$"))
    return found


Rule = dict[str, str]


def read_rules(text: str) -> list[Rule]:
    """The rules, each as a value by `KEY operator` or `KEY{attribute} operator`."""
    rules = []
    for line in text.splitlines():
        if not line or line.startswith("#"):
            continue
        rule: Rule = {}
        for token in line.split(", "):
            match = _RULE_TOKEN.fullmatch(token)
            if match is None or match["operator"] not in _OPERATORS[match["key"]]:
                raise ValueError(token)
            attribute = f"{{{match['attribute']}}}" if match["attribute"] else ""
            rule[f"{match['key']}{attribute}{match['operator']}"] = match["value"]
        rules.append(rule)
    return rules


def effect(rules: list[Rule], device: Rule, action: str = "add") -> Rule:
    """What the rules make of a device with these attributes (`SUBSYSTEM`, `idVendor`, …), as udev would.

    Symlinks are joined by blanks.
    """
    made: Rule = {}
    goal = ""
    for rule in rules:
        if goal:
            goal = "" if rule.get("LABEL=") == goal else goal
            continue
        if not all(_holds(key, value, device, action) for key, value in rule.items()):
            continue
        goal = rule.get("GOTO=", "")
        made |= {key: value for key, value in rule.items() if key[-2] not in "=!" and key != "GOTO="}
    return {key: value for key, value in made.items() if key != "LABEL="}


def _holds(key: str, value: str, device: Rule, action: str) -> bool:
    if not key.endswith(("==", "!=")):
        return True
    name = key[:-2].removeprefix("ATTRS{").rstrip("}")
    actual = (device | {"ACTION": action}).get(name)
    if actual is None:
        return False
    pattern = re.escape(value).replace(r"\*", ".*")
    return (re.fullmatch(pattern, actual) is not None) is key.endswith("==")
