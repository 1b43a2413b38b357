#!/bin/sh
# Installs Slipstream from this checkout, or from an unpacked release, as systemd services. Run it
# again to upgrade: settings that are there stay as they are, running daemons are left alone until
# you restart them. Each release has a copy of it: /opt/slipstream/current/source/deploy/install.sh
set -eu

usage() {
    cat <<'TEXT'
usage: install.sh [--wheelhouse W] [--extras NAMES] [--python PYTHON] [--no-venv] [--root DIR]
                  [--dry-run] edge|agent|server|worker|all
       install.sh use VERSION
       install.sh remove [--data]

  edge        for an RSU box: edge daemons and a zenoh router
  agent       for a vehicle's box, or for the agents of a depot: vehicle agents and a zenoh router
  server      for the server: dispatcher, dashboard and a zenoh router
  worker      for a machine that solves for the dispatcher of the server
  all         all of them, for one machine
  use         go back to a release that is installed, or forth: its program and its units
  remove      stop the daemons, take units and releases away; keep settings and data

  --wheelhouse W  install from this folder or tarball of `make wheelhouse`, without a network
  --extras E  also install these, as postgres,tracing; kept for later runs, '' forgets them
  --python P  Python 3.11 to 3.13 to use (default: python3)
  --no-venv   leave the Python environment as it is: units, settings and documentation only
  --root DIR  put files under DIR, as for a package; no user, no Python environment, no systemd
  --dry-run   print what would be done, change nothing
  --data      remove settings, keys and data too: /etc/slipstream and /var/lib/slipstream*
TEXT
}

building=''
fail() {
    [ -z "$building" ] || rm -rf "$building"
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

# A file is old or new, never half, also where the power fails.
put() {
    cmp -s "$1" "$2" && return 0
    run install -D -m 644 "$1" "$2.new"
    run sync "$2.new"
    run mv -T "$2.new" "$2"
}

remember() {
    [ "$dry_run" = no ] || return 0
    install -d -m 755 "$opt"
    printf '%s\n' "$2" >"$opt/$1.new"
    mv -T "$opt/$1.new" "$opt/$1"
}

# pip of an environment; its faults become one line.
pip() {
    at=$1
    shift
    run "$at/bin/python" -m pip "$@" --quiet --disable-pip-version-check --no-input \
        ${house:+--no-index --find-links "$house"} 2>"$tmp/told" ||
        fail "$({ echo "Python packages for $roles:"; sed -n '/ERROR/,$p' "$tmp/told"; } | tr -s ' \n' ' ' | cut -c 1-400)"
}

is_built() {
    [ "$(cat "$opt/releases/$release/.complete" 2>/dev/null)" = "$made_of" ]
}

# The release that is current keeps running, whatever becomes of this one.
point_at() {
    run ln -sfn "releases/$1" "$opt/current.new"
    run mv -T "$opt/current.new" "$opt/current"
    run sync -f "$opt"
}

check_database() {
    if [ "$dry_run" = yes ] || [ ! -r "$etc/site.toml" ]; then return 0; fi
    told=$("$opt/releases/$1/bin/python" "$here/database.py" "$etc/site.toml" 2>&1) ||
        fail "release $1: $(printf '%s\n' "$told" | tail -n 1)"
    [ -z "$told" ] || printf '%s\n' "$told" >&2
}

umask 022 # the daemons are not root and have to read what is installed
command=install dry_run=no venv=yes data=no root='' python=python3 role='' more='' named=no house=''
while [ $# -gt 0 ]; do
    case $1 in
        --dry-run) dry_run=yes ;;
        --no-venv) venv=no ;;
        --data) data=yes ;;
        --root | --python | --extras | --wheelhouse | use)
            [ $# -ge 2 ] || fail "$1 needs a value; see --help"
            # An environment holds its own path: one made under DIR would not run elsewhere.
            case $1 in
                --root) root=$2 venv=no ;;
                --python) python=$2 ;;
                --extras) more=$2 named=yes ;;
                --wheelhouse) house=$2 ;;
                use) command=use role=use wanted=$2 ;;
            esac
            shift
            ;;
        -h | --help) usage; exit 0 ;;
        remove) command=remove role=remove ;;
        edge | agent | server | worker | all)
            [ -z "$role" ] || fail "one role only; see --help"
            role=$1
            ;;
        *) fail "unknown argument $1; see --help" ;;
    esac
    shift
done
[ -n "$role" ] || fail "say what this machine is: edge, agent, server, worker or all"

live=no booted=no # are we changing this very system, and does it run?
if [ "$dry_run" = no ] && [ -z "$root" ]; then
    live=yes
    [ "$(id -u)" = 0 ] || fail "needs root; see --dry-run for what it would do"
    [ ! -d /run/systemd/system ] || booted=yes
fi

here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
source=$(dirname -- "$here")
etc=$root/etc/slipstream
opt=$root/opt/slipstream
system=$root/etc/systemd/system
before=$(basename -- "$(readlink "$opt/current" || echo none)")

if [ "$command" = use ]; then
    [ -e "$opt/releases/$wanted/.complete" ] ||
        fail "use $wanted: no such release; installed: $(cd "$opt/releases" 2>/dev/null && echo *)"
    check_database "$wanted"
    point_at "$wanted"
    own=$opt/releases/$wanted/source/deploy/install.sh
    if [ -r "$own" ]; then
        while read -r role; do
            run sh "$own" ${root:+--root "$root"} --no-venv "$role" >/dev/null
        done <"$opt/roles"
    else
        echo "Release $wanted has no units of its own (before 0.2): take those of its checkout." >&2
    fi
    echo "Slipstream $wanted is current. Next: systemctl restart 'slipstream-*'"
    exit 0
fi

if [ "$command" = remove ]; then
    for unit in edge@ agent@ dispatcher dashboard scheduler worker router; do
        unit=slipstream-$unit
        case $unit in *@) all="$unit*.service" ;; *) all=$unit.service ;; esac
        if [ "$booted" = yes ] && [ -e "$system/$unit.service" ]; then
            systemctl stop "$all"
        fi
        run find "$system" -name "$all" ! -type d -delete
        # What `systemctl edit` made is a setting.
        [ "$data" = no ] || run find "$system" -depth -path "*/$all.d*" -delete
    done
    [ "$booted" = no ] || systemctl daemon-reload
    run rm -f "$root/etc/sysusers.d/slipstream.conf"
    if [ "$data" = yes ]; then
        for name in '' -agent -edge -dashboard; do
            run rm -rf "$root/var/lib/slipstream$name" "$root/var/lib/private/slipstream$name"
        done
        run rm -rf "$etc"
        [ "$live" = no ] || ! id slipstream >/dev/null 2>&1 || userdel slipstream
    else
        echo "Kept: $etc and $root/var/lib/slipstream*; remove --data takes them away too."
    fi
    run rm -rf "$opt"
    exit 0
fi

version=$(sed -n 's/^__version__ = "\(.*\)"$/\1/p' "$source/slipstream/__init__.py") || version=''
[ -n "$version" ] || fail "$source: not a complete checkout or release"

case $role in
    edge) units='slipstream-edge@ slipstream-router' settings=site-edge ;;
    agent) units='slipstream-agent@ slipstream-router' settings=site-agent ;;
    server)
        units='slipstream-dispatcher slipstream-dashboard slipstream-router slipstream-scheduler'
        settings=site-server
        ;;
    worker) units=slipstream-worker settings=site-worker ;;
    all)
        units='slipstream-edge@ slipstream-agent@ slipstream-dispatcher slipstream-dashboard'
        units="$units slipstream-router slipstream-scheduler slipstream-worker"
        settings=site
        ;;
esac

# A machine may have several roles, and extras named once stay: an upgrade has to have what the
# settings ask for.
roles=$(cat "$opt/roles" 2>/dev/null) || roles=''
roles=$(printf '%s\n%s\n' "$roles" "$role" | sed '/^$/d' | sort -u)
if [ "$named" = no ] && [ -r "$opt/extras" ]; then
    more=$(cat "$opt/extras")
fi
case $more in *[!a-z0-9,-]*) fail "--extras $more: give names with commas between, as postgres,tracing" ;; esac
more=$(printf %s "$more" | tr , '\n')
for name in $more; do
    [ -r "$here/locks/extras/$name.txt" ] ||
        fail "--extras: no extra $name; there are $(basename -s .txt "$here"/locks/extras/*.txt | paste -sd , -)"
done

if [ "$venv" = yes ]; then
    told=$("$python" -c 'import sys; v = sys.version_info; (3, 11) <= v < (3, 14) or sys.exit("%d.%d" % v[:2])' 2>&1) ||
        fail "$python: not Python 3.11 to 3.13, which the libraries are locked for ($(printf %s "$told" | tail -n 1)); give one with --python"
    "$python" -c 'import ensurepip' 2>/dev/null ||
        fail "$python: cannot make environments; install the package python3-venv"
    case $("$python" -c 'import sys; print(sys.base_prefix)') in
        /home/* | /root/*) fail "$python: below a home, where the daemons cannot look; give /usr/bin/python3" ;;
    esac
    tmp=$(mktemp -d)
    trap 'rm -rf "$tmp"' EXIT

    wheel=slipstream-$version-py3-none-any.whl
    given=${house:-$source}
    if [ -n "$house" ] && [ ! -d "$house" ]; then
        tar -xf "$house" -C "$tmp" 2>/dev/null || fail "--wheelhouse $given: no tarball that can be read"
        house=$(echo "$tmp"/*/wheels)
    elif [ -z "$house" ] && [ -d "$source/wheels" ]; then
        house=$source/wheels # an unpacked release
    fi
    if [ -n "$house" ]; then
        cat "$house/SHA256SUMS" "$house/$wheel" >/dev/null 2>&1 ||
            fail "--wheelhouse $given: no SHA256SUMS or no $wheel in it; see make wheelhouse"
        wrong=$(cd "$house" && sha256sum --quiet --check SHA256SUMS 2>/dev/null) ||
            fail "--wheelhouse $given: missing or altered: $(printf '%s\n' "$wrong" | cut -d : -f 1 | paste -sd ' ' -)"
        wheel=$house/$wheel
    elif [ -r "$source/$wheel" ]; then
        wheel=$source/$wheel # a release that is installed
    else
        run "$python" -m venv "$tmp/build"
        pip "$tmp/build" wheel --no-deps --wheel-dir "$tmp" "$source"
        wheel=$tmp/$wheel
    fi

    set --
    for name in $roles; do set -- "$@" -r "$here/locks/$name.txt"; done
    for name in $more; do set -- "$@" -r "$here/locks/extras/$name.txt"; done
    # What a release is made of. One that was killed half-way says nothing of it and is made anew.
    made_of=$version
    if [ "$dry_run" = no ]; then
        made_of="$version $("$python" -V) $(cksum <"$wheel") $(printf '%s\n' "$@" | grep -v '^-r$' | xargs sort -u | cksum)"
    fi
    release=$before
    if ! is_built; then
        release=$version
        [ "$before" != "$version" ] || release=$version-again # a running one is left as it is
    fi
    if ! is_built; then
        building=$opt/releases/$release
        run rm -rf "$building"
        run install -d -m 755 "$building"
        run "$python" -m venv "$building"
        pip "$building" install --only-binary :all: --require-hashes "$@"
        pip "$building" install --no-deps --no-index "$wheel"
        for part in deploy docs/operations.md slipstream/__init__.py slipstream_cli/daemons/router.py \
            slipstream_cli/place/bus_files.py; do
            run install -d "$building/source/$(dirname "$part")"
            run cp -R "$source/$part" "$building/source/$(dirname "$part")"
        done
        run cp "$wheel" "$building/source"
        run "$building/bin/slipstream" --version >/dev/null || fail "release $release: does not start"
        run sync -f "$building"
        [ "$dry_run" = yes ] || printf '%s\n' "$made_of" >"$building/.complete"
        building=''
    fi
    check_database "$release"
    remember extras "$(printf '%s\n' "$more" | paste -sd , -)"
    point_at "$release"
    # The release before stays for the way back, older ones go.
    if [ "$before" != "$release" ]; then
        for old in "$opt"/releases/*; do
            case $(basename -- "$old") in
                "$release" | "$before" | '*') ;;
                *) run rm -rf "$old" ;;
            esac
        done
    fi
fi
remember roles "$roles"

# The account before the settings, which belong to its group.
put "$here/systemd/slipstream.sysusers" "$root/etc/sysusers.d/slipstream.conf"
if [ -z "$root" ]; then
    run systemd-sysusers /etc/sysusers.d/slipstream.conf
    group='-g slipstream'
else
    group=''
fi

for unit in $units; do
    put "$here/systemd/$unit.service" "$system/$unit.service"
done

put "$source/slipstream_cli/daemons/router.py" "$opt/share/router.py"
for file in "$here"/config/*.toml "$here"/zenoh/*.json5 "$here"/proxy/nginx.conf \
    "$here"/grafana/*.json "$here"/prometheus/*.yml; do
    put "$file" "$opt/share/examples/$(basename -- "$file")"
done
put "$source/docs/operations.md" "$opt/share/doc/operations.md"

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

# Who the daemons of site.toml are on the bus, and what the router lets them do.
run "$python" "$source/slipstream_cli/place/bus_files.py" "$etc/site.toml" "$root/" >/dev/null ||
    fail "$etc/site.toml: users of the bus could not be made"

[ "$booted" = no ] || systemctl daemon-reload

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
