#!/bin/sh
# Starts a Dask cluster over ssh: the scheduler here, on each host a worker for each core. Ctrl-C ends all of it.
#
#     deploy/hosts/ssh.sh HERE:PORT HOST...
#
# HERE is the name or address by which the hosts reach this computer. Each host has a clone at the same place, and the
# keys that docs/clusters.md makes.
set -eu

if [ $# -lt 2 ] || [ "${1%:*}" = "$1" ]; then
    echo "ssh.sh: $*; must be HERE:PORT HOST..., such as 192.168.1.5:8786 lab1 lab2" >&2
    exit 2
fi
address=$1
shift
clone=$(CDPATH='' cd -- "$(dirname -- "$0")/../.." && pwd -P)
started=
# shellcheck disable=SC2086  # a list of words
trap 'kill $started 2>/dev/null || true' EXIT
trap 'exit 130' INT TERM

"$clone/.venv/bin/python" -m distributed.cli.dask_scheduler --protocol tls --port "${address##*:}" --no-dashboard &
started=$!
for host; do
    # With a terminal of its own a worker ends with its connection.
    ssh -tt "$host" "cd '$clone' && exec .venv/bin/python -m distributed.cli.dask_worker 'tls://$address' \
        --nworkers \$(nproc) --nthreads 1 --no-dashboard" </dev/null &
    started="$started $!"
done
wait
