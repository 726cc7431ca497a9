#!/bin/sh
# Stands in for python3 in the tests of ./acrc: makes environments that hold only itself, notes what pip was
# told in $NOTES, and runs small programs in the real Python.
case "$1 $2" in
    '-m venv')
        for folder; do :; done
        mkdir -p "$folder/bin"
        cp "$FAKE" "$folder/bin/python"
        ;;
    '-m pip')
        echo "pip $*" >>"$NOTES"
        sleep "${FAKE_PIP_TAKES:-0}"
        [ -z "${FAKE_PIP_FAILS:-}" ] || exit 1
        [ ! -f .venv/pins.txt ] || cat .venv/pins.txt >"$NOTES.pins"
        [ ! -f .venv/hashed.txt ] || cat .venv/hashed.txt >"$NOTES.hashed"
        [ ! -f .venv/build.txt ] || cat .venv/build.txt >"$NOTES.build"
        ;;
    '-P -m')
        echo "in $PWD: $*"
        [ -z "${SHOW_ENV:-}" ] || env
        [ -z "${SHOW_BYTECODE:-}" ] || echo "byte code: ${PYTHONPYCACHEPREFIX:-none}, ${PYTHONDONTWRITEBYTECODE:-written}"
        ;;
    '-V '*) echo "Python ${VERSION:-3.11.7}" ;;
    '-c import ensurepip, venv') [ -z "${NO_VENV:-}" ] || exit 1 ;;
    "-c import sys; print"*) echo "${VERSION:-3.11.7}" | cut -d. -f1,2 ;;
    '-c import sys; sys.exit(sys.version_info'*) [ -z "${TOO_OLD:-}" ] || exit 1 ;;
    '-c import site; print'*) mkdir -p .venv/lib && echo .venv/lib ;;
    *) exec "$REAL" "$@" ;;
esac
