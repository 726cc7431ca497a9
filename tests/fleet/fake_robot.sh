#!/bin/sh
# Stands in for python3 on a robot's computer: writes rules, compiles nothing; all else as tests/cli/fake_python.sh.
case "$1 $2 $3" in
    '-P -c from actors.processes.kernels'*)
        [ -z "${KERNELS_FAIL:-}" ] || exit 1
        mkdir -p "${0%/.venv/*}/actors/__pycache__/kernels"
        ;;
    '-P -m command_line')
        case "$*" in
            *'fleet units'*) for out; do :; done && mkdir -p "$out" && echo "${RULES:-all named}" >"$out/60-acrc.rules" ;;
        esac
        echo "$*" >>"$NOTES"
        ;;
    *) . "$BASE" ;;
esac
