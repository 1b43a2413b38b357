#!/bin/sh
# Installs Slipstream from this checkout as systemd services. Run it again to upgrade: settings that
# are there stay as they are, running daemons are left alone until you restart them.
set -eu

usage() {
    cat <<'TEXT'
usage: install.sh [--dry-run] [--no-venv] [--root DIR] [--python PYTHON] [--extras NAMES]
                  edge|agent|server|worker|all

  edge        for an RSU box: edge daemons and a zenoh router
  agent       for a vehicle's box, or for the agents of a depot: vehicle agents and a zenoh router
  server      for the server: dispatcher, dashboard and a zenoh router
  worker      for a machine that solves for the dispatcher of the server
  all         all of them, for one machine

  --dry-run   print what would be done, change nothing
  --no-venv   leave the Python environment as it is: units, settings and documentation only
  --root DIR  put files under DIR, as for a package; no user, no Python environment, no systemd
  --python P  Python 3.11 or later to use (default: python3)
  --extras E  also install these, as postgres,tracing; kept for later runs, '' forgets them
TEXT
}

fail() {
    printf 'install.sh: %s\n' "$1" >&2
    exit 2
}

run() {
    if [ "$dry_run" = yes ]; then
        printf '+ %s\n' "$*"
    else
        "$@"
    fi
}

remember_extras() {
    printf '%s\n' "$more" >"$opt/extras"
}

umask 022 # the daemons are not root and have to read what is installed
dry_run=no venv=yes root='' python=python3 role='' more='' named=no
while [ $# -gt 0 ]; do
    case $1 in
        --dry-run) dry_run=yes ;;
        --no-venv) venv=no ;;
        --root | --python | --extras)
            [ $# -ge 2 ] || fail "$1 needs a value; see --help"
            # An environment holds its own path: one made under DIR would not run elsewhere.
            case $1 in
                --root) root=$2 venv=no ;;
                --python) python=$2 ;;
                --extras) more=$2 named=yes ;;
            esac
            shift
            ;;
        -h | --help) usage; exit 0 ;;
        edge | agent | server | worker | all)
            [ -z "$role" ] || fail "one role only; see --help"
            role=$1
            ;;
        *) fail "unknown argument $1; see --help" ;;
    esac
    shift
done
[ -n "$role" ] || fail "say what this machine is: edge, agent, server, worker or all"

here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
source=$(dirname -- "$here")
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' "$source/pyproject.toml" | head -n 1)
[ -n "$version" ] || fail "$source/pyproject.toml: no version; run this from a complete checkout"

live=no # are we changing this very system?
if [ "$dry_run" = no ] && [ -z "$root" ]; then
    live=yes
    [ "$(id -u)" = 0 ] || fail "needs root; see --dry-run for what it would do"
fi

case $role in
    edge) extras=edge units='slipstream-edge@ slipstream-router' settings=site-edge ;;
    # Agents need nothing but what all daemons need.
    agent) extras='' units='slipstream-agent@ slipstream-router' settings=site-agent ;;
    server)
        extras=dispatcher,dashboard,cluster
        units='slipstream-dispatcher slipstream-dashboard slipstream-router slipstream-scheduler'
        settings=site-server
        ;;
    worker) extras=dispatcher,cluster units=slipstream-worker settings=site-worker ;;
    all)
        extras=edge,dispatcher,dashboard,cluster
        units='slipstream-edge@ slipstream-agent@ slipstream-dispatcher slipstream-dashboard'
        units="$units slipstream-router slipstream-scheduler slipstream-worker"
        settings=site
        ;;
esac

etc=$root/etc/slipstream
opt=$root/opt/slipstream
release=$opt/releases/$version

# Those named once stay, or an upgrade would lack what the settings ask for.
if [ "$named" = no ] && [ -r "$opt/extras" ]; then
    more=$(cat "$opt/extras")
fi
case $more in *[!a-z0-9,-]*) fail "--extras $more: give names with commas between, as postgres,tracing" ;; esac
# pip only warns of a name that it does not know.
for name in $(printf %s "$more" | tr , ' '); do
    grep -q "^$name = \\[" "$source/pyproject.toml" || fail "--extras: no extra $name; name some of pyproject.toml"
done
extras=$extras${extras:+${more:+,}}$more

# The account first: the settings belong to its group.
run install -D -m 644 "$here/systemd/slipstream.sysusers" "$root/etc/sysusers.d/slipstream.conf"
if [ -z "$root" ]; then
    run systemd-sysusers /etc/sysusers.d/slipstream.conf
    group='-g slipstream'
else
    group=''
fi

if [ "$venv" = yes ]; then
    "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
        fail "$python: not Python 3.11 or later; give one with --python"
    "$python" -c 'import ensurepip' 2>/dev/null ||
        fail "$python: cannot make environments; install the package python3-venv"
    case $("$python" -c 'import sys; print(sys.base_prefix)') in
        /home/* | /root/*) fail "$python: below a home, where the daemons cannot look; give /usr/bin/python3" ;;
    esac
    before=$(basename -- "$(readlink "$opt/current" || echo none)")
    # One that was killed half-way has no mark, and never became the current one: it is made anew.
    if [ ! -e "$release/.complete" ] && [ "$before" != "$version" ]; then
        run rm -rf "$release"
        run install -d -m 755 "$opt/releases"
        run "$python" -m venv "$release"
    fi
    run rm -f "$release/.complete"
    # A folder is installed anew each time, also where its version is the one that is there.
    run "$release/bin/python" -m pip install --quiet --disable-pip-version-check \
        "$source${extras:+[$extras]}"
    run touch "$release/.complete"
    run remember_extras
    # One rename: whoever starts now gets the old release or the new one.
    run ln -sfn "releases/$version" "$opt/current.new"
    run mv -T "$opt/current.new" "$opt/current"
    # The release before stays for the way back, older ones go.
    if [ "$before" != "$version" ]; then
        for old in "$opt"/releases/*; do
            case $(basename -- "$old") in
                "$version" | "$before" | '*') ;;
                *) run rm -rf "$old" ;;
            esac
        done
    fi
fi

for unit in $units; do
    run install -D -m 644 "$here/systemd/$unit.service" "$root/etc/systemd/system/$unit.service"
done

run install -D -m 644 "$source/slipstream_cli/daemons/router.py" "$opt/share/router.py"
for file in "$here"/config/*.toml "$here"/zenoh/*.json5 "$here"/proxy/nginx.conf \
    "$here"/grafana/*.json "$here"/prometheus/*.yml; do
    run install -D -m 644 "$file" "$opt/share/examples/$(basename -- "$file")"
done
run install -D -m 644 "$source/docs/operations.md" "$opt/share/doc/operations.md"

# Settings may hold passwords of cameras: root writes and reads them, systemd hands them to the
# daemons. A calibration holds none, and the daemons read it by its path.
# shellcheck disable=SC2086 # $group is two words or none
run install -d -m 750 $group "$etc"
[ -e "$etc/site.toml" ] || run install -m 600 "$here/config/$settings.toml" "$etc/site.toml"
case $role in
    edge | all)
        # shellcheck disable=SC2086
        [ -e "$etc/camera-rsu-1.toml" ] ||
            run install -m 640 $group "$here/config/camera-rsu-1.toml" "$etc/camera-rsu-1.toml"
        ;;
esac
if [ "$role" != worker ] && [ ! -e "$etc/router.json5" ]; then
    run install -m 600 "$here/zenoh/router.json5" "$etc/router.json5"
fi

# Who the daemons of site.toml are on the bus, and what the router lets them do. A release that was
# copied without this file has it among its packages.
bus_files=$source/slipstream_cli/place/bus_files.py
[ -r "$bus_files" ] || bus_files=$(echo "$opt"/current/lib/python3*/site-packages/slipstream_cli/place/bus_files.py)
run "$python" "$bus_files" "$etc/site.toml" "$root/" >/dev/null ||
    fail "$etc/site.toml: users of the bus could not be made"

if [ "$live" = yes ] && [ -d /run/systemd/system ]; then
    systemctl daemon-reload
fi

if [ "$dry_run" = yes ]; then
    echo 'Nothing has been changed.'
    exit 0
fi
cat <<TEXT
Slipstream $version is in place ($role). Next:
- Edit the settings in /etc/slipstream; examples are in /opt/slipstream/share/examples.
TEXT
case $role in edge | all)
    cat <<'TEXT'
- The camera rsu-1 is an example: put its address and calibration into site.toml, then
    /opt/slipstream/current/bin/slipstream check /etc/slipstream/site.toml
    systemctl enable --now slipstream-router slipstream-edge@rsu-1
- Each further camera, with its own calibration:
    /opt/slipstream/current/bin/slipstream rsu add NAME --camera FILE --url URL
TEXT
;; esac
case $role in agent | all)
    cat <<'TEXT'
- The agents depot-1 are an example: put your vehicles into site.toml (on a vehicle's box:
  examples/router-vehicle.json5 as router.json5), then
    /opt/slipstream/current/bin/slipstream check /etc/slipstream/site.toml
    systemctl enable --now slipstream-router slipstream-agent@depot-1
- Each further process of agents:
    /opt/slipstream/current/bin/slipstream agent add NAME --vehicles ID ...
TEXT
;; esac
case $role in worker | all)
    cat <<'TEXT'
- To solve for a dispatcher: put the scheduler's address and certificates into site.toml, then
    /opt/slipstream/current/bin/slipstream check /etc/slipstream/site.toml
    systemctl enable --now slipstream-worker
TEXT
;; esac
case $role in server | all)
    cat <<'TEXT'
- Edit [dispatcher] and [dashboard] of site.toml, then
    /opt/slipstream/current/bin/slipstream check /etc/slipstream/site.toml
    systemctl enable --now slipstream-router slipstream-dispatcher slipstream-dashboard
  and open http://127.0.0.1:8080 on this machine; for other machines see examples/nginx.conf.
TEXT
;; esac
shared=$(find "$etc" -maxdepth 2 -type f -perm /077 \
    \( -name site.toml -o -name router.json5 -o -name '*.key' \))
if [ -n "$shared" ]; then
    printf '%s\n' "- Each daemon can read these, as before version 0.2; see 'Passwords and keys' in" \
        "  operations.md:" "$shared"
fi
cat <<'TEXT'
- After an upgrade: systemctl restart 'slipstream-*'
- Read on in /opt/slipstream/share/doc/operations.md
TEXT
