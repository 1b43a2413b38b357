#!/bin/bash
# Boots systemd on a copy of this machine's files, installs all of Slipstream there, and has a probe
# in place of each daemon write what it can read. Runs as root in namespaces of its own:
#   unshare --mount --pid --fork --cgroup --uts --ipc --propagation private boot.sh CHECKOUT RESULTS
set -eu
checkout=$(realpath "$1") results=$(realpath "$2")
work=$results/files root=$results/files/root
mkdir "$work"
mount -t tmpfs none "$work"
mkdir "$work/upper" "$work/work" "$root"
# What is changed below is gone with the namespace.
mount -t overlay none -o "lowerdir=/,upperdir=$work/upper,workdir=$work/work" "$root"
mount -t proc none "$root/proc"
mount -t sysfs none "$root/sys"
mount -t tmpfs none "$root/sys/fs/cgroup"
mount -t cgroup2 none "$root/sys/fs/cgroup"
mount --rbind /dev "$root/dev"
mount -t tmpfs none "$root/run"
mount -t tmpfs none "$root/tmp"
mkdir -p "$root/srv/checkout" "$root/srv/results" "$root/srv/old"
mount --bind "$checkout" "$root/srv/checkout"
mount --bind "$results" "$root/srv/results"
cd "$root"

# Nothing but what the test needs; the kernel's settings are those of the machine outside.
rm -rf etc/systemd/system/*.wants
for unit in systemd-sysctl.service systemd-binfmt.service systemd-modules-load.service \
    systemd-remount-fs.service systemd-timesyncd.service systemd-udevd.service \
    systemd-udev-trigger.service systemd-random-seed.service proc-sys-fs-binfmt_misc.automount; do
    ln -sf /dev/null "etc/systemd/system/$unit"
done
rm -rf etc/slipstream opt/slipstream
mkdir -p opt/slipstream/current/bin etc/systemd/system/slipstream-.service.d
cat >etc/systemd/system/slipstream-.service.d/probe.conf <<'END'
[Service]
Type=exec
WatchdogSec=0
StandardOutput=append:/srv/results/%N
END
cat >opt/slipstream/current/bin/slipstream <<'END'
#!/bin/sh
# In place of a daemon: once all run, every secret that it can read, by its path and through /proc.
until [ -e /run/all-run ]; do sleep 0.1; done
for file in $(cat /run/secrets) /proc/[0-9]*/root/run/credentials/*/*; do
    if cat "$file" >/dev/null 2>&1; then echo "$file"; fi
done
id -un
echo end
exec sleep 600
END
cp opt/slipstream/current/bin/slipstream opt/slipstream/current/bin/python
chmod 755 opt/slipstream/current/bin/*

cat >srv/test.sh <<'END'
set -eu
sh /srv/checkout/deploy/install.sh --no-venv all
cd /etc/slipstream
printf '[rsus.north]\n[rsus.north.source]\n' >>site.toml
install -d -m 750 -g slipstream tls
install -m 600 /dev/stdin tls/router.key </etc/hostname
sh /srv/checkout/deploy/install.sh --no-venv all
units='slipstream-router slipstream-dispatcher slipstream-dashboard slipstream-edge@rsu-1 slipstream-edge@north slipstream-agent@depot-1'
systemctl start $units
{
    find /etc/slipstream -type f
    find /run/credentials -path '*slipstream*' -type f
} >/run/secrets.new
mv /run/secrets.new /run/secrets
touch /run/all-run
for unit in $units; do
    until grep -q '^end$' "/srv/results/$unit" 2>/dev/null; do sleep 0.1; done
done
END
cat >etc/systemd/system/test.service <<'END'
[Unit]
Requires=basic.target
After=basic.target
[Service]
Type=oneshot
ExecStart=/bin/sh /srv/test.sh
ExecStopPost=/bin/kill -s RTMIN+4 1
TimeoutStartSec=120
StandardOutput=append:/srv/results/log
StandardError=append:/srv/results/log
END

# Not chroot, in which the kernel makes no user namespaces (PrivateUsers=).
mount --make-rprivate /
pivot_root . srv/old
mount --make-rshared /
umount -l /srv/old
exec env -i container=other PATH=/usr/sbin:/usr/bin:/sbin:/bin \
    /lib/systemd/systemd --system --unit=test.service --log-target=null
