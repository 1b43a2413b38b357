#!/bin/sh
# Makes what is released, under dist/; the Makefile says what each part is for.
set -eu

usage='usage: release.sh locks|packages|sbom|sums|wheelhouse ROLE|deb ROLE|image ROLE'
fail() {
    printf 'release.sh: %s\n' "$1" >&2
    exit 2
}

[ $# -ge 1 ] || fail "$usage"
cd "$(dirname -- "$0")/.."
python=${PYTHON:-python3} tools=build/release-tools role=${2:-}
version=$(sed -n 's/^__version__ = "\(.*\)"$/\1/p' slipstream/__init__.py)
mkdir -p build dist
case $1 in wheelhouse | deb | image)
    [ -r "deploy/locks/$role.txt" ] ||
        fail "$1 $role: no such role; there are $(basename -s .txt deploy/locks/*.txt | paste -sd , -)"
    # Wheels are of one Python and one kind of machine.
    python_name=$("$python" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
    machine=$(dpkg --print-architecture)
    tree=build/slipstream-$version-$role
    ;;
esac

need_tools() {
    [ -x "$tools/bin/uv" ] && return 0
    "$python" -m venv "$tools"
    "$tools/bin/python" -m pip install --quiet --disable-pip-version-check \
        'build>=1.3,<2' 'cyclonedx-bom>=7.5,<8' 'uv>=0.9,<1'
}

compile() (
    lock=$1
    shift
    for extra; do set -- "$@" --extra "$extra"; shift; done
    UV_CUSTOM_COMPILE_COMMAND='make locks' "$tools/bin/uv" pip compile --quiet --universal \
        --python-version 3.11 --generate-hashes --no-annotate --only-binary :all: pyproject.toml \
        --output-file "$lock" "$@" ${constraints:+--constraints "$constraints"}
)

case $1 in
    locks)
        need_tools
        # All from one resolution, so that roles and extras go together. iskay has no lock: it asks
        # for another qiskit-ibm-runtime than the dispatcher.
        rm -f build/every.txt
        constraints=''
        compile build/every.txt edge dispatcher dashboard cluster cplex osm parquet postgres tracing
        constraints=build/every.txt
        mkdir -p deploy/locks/extras
        compile deploy/locks/agent.txt
        compile deploy/locks/edge.txt edge
        compile deploy/locks/server.txt dispatcher dashboard cluster
        compile deploy/locks/worker.txt dispatcher cluster
        compile deploy/locks/all.txt edge dispatcher dashboard cluster
        for extra in cplex osm parquet postgres tracing; do
            compile "deploy/locks/extras/$extra.txt" "$extra"
        done
        ;;
    packages)
        need_tools
        rm -f dist/slipstream*.whl dist/slipstream-*.tar.gz
        "$tools/bin/python" -m build --outdir dist . >build/packages.log
        "$tools/bin/python" -m build --wheel --outdir dist lab >>build/packages.log
        ;;
    sbom)
        need_tools
        # What a machine with all roles has, in an environment as install.sh makes it.
        rm -rf build/sbom
        "$python" -m venv build/sbom
        build/sbom/bin/python -m pip install --quiet --disable-pip-version-check \
            --only-binary :all: --require-hashes -r deploy/locks/all.txt
        build/sbom/bin/python -m pip install --quiet --disable-pip-version-check --no-deps \
            "dist/slipstream-$version-py3-none-any.whl"
        "$tools/bin/cyclonedx-py" environment --output-reproducible --output-format JSON \
            --output-file build/sbom.json build/sbom/bin/python
        "$tools/bin/python" deploy/sbom.py build/sbom.json build/sbom "$version" >"dist/slipstream-$version.cdx.json"
        ;;
    wheelhouse)
        rm -rf "$tree"
        mkdir -p "$tree/wheels"
        "$python" -m venv --clear build/wheelhouse # or it would stay another Python's
        set -- -r "deploy/locks/$role.txt"
        for extra in $(printf %s "${EXTRAS:-}" | tr , ' '); do set -- "$@" -r "deploy/locks/extras/$extra.txt"; done
        build/wheelhouse/bin/python -m pip download --quiet --disable-pip-version-check \
            --only-binary :all: --require-hashes "$@" --dest "$tree/wheels"
        cp "dist/slipstream-$version-py3-none-any.whl" "$tree/wheels"
        (cd "$tree/wheels" && sha256sum ./*.whl | sed 's,\./,,' >SHA256SUMS)
        # What install.sh installs besides.
        git ls-files deploy docs/operations.md slipstream/__init__.py \
            slipstream_cli/daemons/router.py slipstream_cli/place/bus_files.py LICENSE | xargs cp --parents -t "$tree"
        tar -C build --sort=name --owner=0 --group=0 --numeric-owner --mtime=@0 \
            -cf "dist/slipstream-$version-$role-$python_name-$machine.tar" "$(basename "$tree")"
        ;;
    deb)
        [ -d "$tree" ] || fail "deb $role: no $tree; make wheelhouse ROLE=$role first"
        stage=build/deb-$role
        rm -rf "$stage"
        mkdir -p "$stage/DEBIAN" "$stage/usr/lib"
        cp -Rl "$tree" "$stage/usr/lib/slipstream"
        cat >"$stage/DEBIAN/control" <<TEXT
Package: slipstream-$role
Version: $version
Architecture: $machine
Maintainer: $(git log -1 --format='%an <%ae>')
Section: net
Priority: optional
Depends: $python_name, $python_name-venv, systemd (>= 247)
Provides: slipstream
Conflicts: slipstream
Description: $(sed -n 's/^description = "\(.*\)"$/\1/p' pyproject.toml)
 The role $role: its libraries, its units and its example settings.
TEXT
        program=/usr/lib/slipstream/deploy/install.sh
        on() { printf '#!/bin/sh\nset -e\n[ "$%s" = %s ] || exit 0\n' 1 "$1"; }
        { on configure; echo "sh $program --python /usr/bin/$python_name $role"; } >"$stage/DEBIAN/postinst"
        { on remove; echo "sh $program remove"; } >"$stage/DEBIAN/prerm"
        # The installer is gone when a package is purged: this has it in itself.
        { on purge; echo 'set -- remove --data'; cat deploy/install.sh; } >"$stage/DEBIAN/postrm"
        chmod 755 "$stage"/DEBIAN/p*
        # Wheels are compressed.
        dpkg-deb --root-owner-group -Znone --build "$stage" "dist/slipstream-${role}_${version}_$machine.deb" >/dev/null
        rm -rf "$stage"
        ;;
    image)
        [ -d "$tree" ] || fail "image $role: no $tree; make wheelhouse ROLE=$role first"
        command -v buildah >/dev/null || fail "image $role: buildah is not installed; apt install buildah"
        base=${BASE:-}
        set -- --root "$PWD/build/containers" --runroot "$PWD/build/containers-run" --storage-driver vfs
        if [ -z "$base" ]; then
            # Without a registry: a Debian root as the image to build on.
            base=localhost/slipstream-base
            if ! buildah "$@" inspect --type image "$base" >/dev/null 2>&1; then
                mkdir -p build/base
                mmdebstrap --quiet --variant=minbase bookworm build/base/root.tar
                printf 'FROM scratch\nADD root.tar /\n' |
                    buildah "$@" bud --quiet --isolation chroot -t "$base" -f - build/base >/dev/null
            fi
        fi
        buildah "$@" bud --quiet --isolation chroot --build-arg "BASE=$base" --build-arg "ROLE=$role" \
            -t "slipstream-$role:$version" -f deploy/Containerfile "$tree" >/dev/null
        rm -f "dist/slipstream-$version-$role-image.tar"
        buildah "$@" push --quiet "slipstream-$role:$version" \
            "oci-archive:dist/slipstream-$version-$role-image.tar:slipstream-$role:$version"
        ;;
    sums)
        (cd dist && rm -f SHA256SUMS SHA256SUMS.asc && sha256sum -- * >../build/SHA256SUMS && mv ../build/SHA256SUMS .)
        if [ -n "${KEY:-}" ]; then
            gpg --batch --local-user "$KEY" --armor --detach-sign dist/SHA256SUMS
        else
            echo 'dist/SHA256SUMS is not signed; KEY=FINGERPRINT of a gpg key signs it'
        fi
        ;;
    *) fail "$usage" ;;
esac
