"""Programs that try to undo a robot's file tree from inside."""

NEST = """
import os
from contextlib import suppress
from pathlib import Path
from actors.runtime.lifecycle import linux
with suppress(OSError):
    user, group = os.getuid(), os.getgid()
    linux.unshare(linux.CLONE_NEWUSER | linux.CLONE_NEWNS)
    print("nested")
    Path("/proc/self/setgroups").write_text("deny")
    Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
    Path("/proc/self/gid_map").write_text(f"{group} {group} 1")
"""
"""In a child: become root of a new user namespace, with all capabilities there."""
UNDO = """
import ctypes, sys
from contextlib import suppress
from pathlib import Path
from actors.runtime.lifecycle import linux
repository, token, out = sys.argv[1:]
for folder in (out, "/tmp", "/run"):
    if Path(repository).is_relative_to(folder):
        continue  # what is to be written to would go with it
    ctypes.CDLL(None).umount2(folder.encode(), 2)
for folder in ("/", repository, "/tmp", "/run", out):
    with suppress(OSError):
        linux.mount(None, folder, None, linux.MS_REMOUNT | linux.MS_BIND | linux.mount_flags(folder))
with suppress(OSError):
    Path(repository, "." + token).write_text(token)
    print("written")
with suppress(OSError):
    print(Path(out, "r2", "credentials").read_text().split(":")[0])
"""
"""Undo the mounts, then do what is forbidden; argv: the repository, the token, the run's output folder."""
