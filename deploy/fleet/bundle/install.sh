#!/bin/sh
# Installs a robot's bundle on the robot's own computer, without a network: `sudo ./install.sh`.
# The new version is made beside the one that runs; the link `current` leads to it once it is complete. Recordings, the
# last pose and the counted starts lie in /var/lib/acrc and stay as they are.
set -eu
LC_ALL=C PATH="${PATH:-}:/usr/sbin:/sbin"
export LC_ALL PATH
umask 022

place=/srv/acrc
kept=/var/lib/acrc
rules=/etc/udev/rules.d/60-acrc.rules

say() { printf 'acrc: %s\n' "$*" >&2; }

give_up() {
    say "$*"
    exit 1
}

# What a bundle says of itself: robot, machine, python.
told() { sed -n "s/^$1 //p" "$2/about"; }

# Every file as it was bundled; the list of sums first, by the sum of its own lines at its end.
check_files() {
    again='copy the bundle again'
    [ -f SHA256SUMS ] || give_up "$here/SHA256SUMS: is missing; $again"
    sum=$(sed -n '$s/^# SHA-256 of the lines above: //p' SHA256SUMS)
    [ "$sum" = "$(sed '$d' SHA256SUMS | sha256sum | cut -d' ' -f1)" ] || give_up "$here/SHA256SUMS: is damaged; $again"
    bad=$(sha256sum -c --quiet SHA256SUMS 2>/dev/null) ||
        give_up "$here/$(printf '%s\n' "$bad" | sed -n '1s/: FAILED.*//p'): is damaged or missing; $again"
}

# The right computer: its processor, its Python, and the robot that it already is.
check_computer() {
    command -v python3 >/dev/null || give_up "no python3 was found; the bundle is for Python $python"
    found=$(python3 -c 'import platform, struct, sys
print(platform.machine(), "of", struct.calcsize("P") * 8, "bits with Python", "%d.%d" % sys.version_info[:2])')
    wanted="$machine of 64 bits with Python $python"
    [ "$found" = "$wanted" ] ||
        give_up "this computer is $found, but the bundle is for $wanted; make one that fits with --machine and --python"
    [ ! -f "$place/current/about" ] || before=$(told robot "$place/current")
    [ "${before:-$robot}" = "$robot" ] ||
        give_up "this computer is $before, but the bundle is for $robot; to make it $robot:" \
            "sudo systemctl disable --now acrc-$before; sudo rm $place/current"
    [ "$(id -u)" = 0 ] || give_up "the installation changes the system; run it as root: sudo $here/install.sh"
}

# The robot's own user, and a place for what it keeps; both stay as they are if they are there.
make_user() {
    id acrc >/dev/null 2>&1 ||
        useradd --system --home-dir "$kept" --no-create-home --shell /usr/sbin/nologin --groups dialout acrc
    for folder in "$kept" "$kept/state"; do
        [ -d "$folder" ] || install -d -o acrc -g acrc "$folder"
    done
}

# A version that is not complete is of an installation that was interrupted. Pip is told where the wheels are by a path
# without blanks; the kernels are compiled now, since the robot should not wait for them.
make_version() {
    rm -rf "$version"
    { mkdir -p "$place/versions" && cp -R program "$version"; } ||
        give_up "the version that was here stays; $version cannot be written, see above"
    chown -R acrc "$version/fleets"
    ln -s "$here/wheels" "$version/wheels"
    PIP_NO_INDEX=1 PIP_FIND_LINKS="$version/wheels" PIP_CONFIG_FILE=/dev/null write_units >/dev/null ||
        give_up "the version that was here stays; this one was not installed, see above"
    rm "$version/wheels"
    "$version/.venv/bin/python" -P -c "from actors.processes.kernels import compile_kernels as c; c(onboard=True)" ||
        give_up "the version that was here stays; this one cannot compute on this computer, see above"
    chown -R acrc "$version/actors/__pycache__/kernels"
    : >"$version/.complete"
    sync
}

# The udev rules hold serial numbers, which only the robot's own computer knows.
write_units() { "$version/acrc" fleet units "$version/fleets/fleet.toml" --robot "$robot" --user acrc --out "$version/units/here"; }

# A file in place of another one, whole or not at all.
put() {
    mkdir -p "${2%/*}"
    cp "$1" "$2.new"
    chmod 644 "$2.new"
    mv -f "$2.new" "$2"
}

put_units() {
    put "$version/units/acrc-$robot.service" "/etc/systemd/system/acrc-$robot.service"
    write_units >/dev/null 2>&1
    new=$version/units/here/60-acrc.rules
    if [ -f "$rules" ] && grep -q 'so nothing gets this name' "$new"; then
        say "$rules stays as it was: not all devices of the robot are plugged in; plug them in and install again"
    else
        put "$new" "$rules"
    fi
    if [ -d /run/systemd/system ]; then
        systemctl daemon-reload
        udevadm control --reload && udevadm trigger --subsystem-match=tty
    fi
}

# What is wrong with the robot's computer, for the user that the robot runs as; a device may come later.
ask_doctor() {
    set -- fleet doctor "$place/current/fleets/fleet.toml" --robot "$robot"
    [ ! -d "$version/modules" ] || set -- "$@" --modules "$place/current/modules"
    (cd "$kept" && runuser -u acrc -- "$place/current/acrc" "$@") >&2 || true
}

main() {
    here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd -P)
    cd -- "$here"
    check_files
    robot=$(told robot program) machine=$(told machine program) python=$(told python program)
    check_computer
    version=$place/versions/$(sha256sum SHA256SUMS | cut -c 1-12)
    make_user
    [ -f "$version/.complete" ] || make_version
    ln -sfn "versions/${version##*/}" "$place/current.new"
    mv -T "$place/current.new" "$place/current"
    put_units
    ask_doctor
    say "$robot is installed in $version, $(($(du -sk "$version" | cut -f1) / 1024)) MB; nothing was started"
    for other in "$place"/versions/*; do
        [ "$other" = "$version" ] || say "another version is kept; once nothing runs of it: sudo rm -r $other"
    done
    say "start it, somebody beside it: sudo systemctl enable acrc-$robot && sudo systemctl restart acrc-$robot"
}

main "$@"
