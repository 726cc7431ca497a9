"""Keys of a cluster that is thrown away: an authority, one key for all hosts, and Dask's configuration."""

from datetime import UTC, datetime
from pathlib import Path

import yaml

from deploy.hosts import certificates

_DAYS = 1


def write_keys(folder: Path, scratch: Path) -> None:
    """Make the folder, with what DASK_CONFIG is to name; keys are readable by their owner alone.

    `scratch`: where programs put temporary files; those that are killed leave them there.
    """
    folder.mkdir(mode=0o700)
    now = datetime.now(UTC)
    authority = certificates.authority("hosts", now, _DAYS)
    both = (certificates.SERVER, certificates.CLIENT)
    pair = certificates.machine(authority, "cluster", both, (), now, _DAYS)
    key = folder / "key.pem"
    key.touch(mode=0o600)
    key.write_bytes(pair.private_pem)
    (folder / "authority.pem").write_bytes(authority.certificate_pem)
    (folder / "certificate.pem").write_bytes(pair.certificate_pem)
    own = {"cert": str(folder / "certificate.pem"), "key": str(key)}
    roles = {role: dict(own) for role in ("scheduler", "worker", "client")}
    tls = {"ca-file": str(folder / "authority.pem"), **roles}
    comm = {"require-encryption": True, "tls": tls}
    configuration = {"distributed": {"comm": comm}, "temporary-directory": str(scratch)}
    (folder / "cluster.yaml").write_text(yaml.safe_dump(configuration))
