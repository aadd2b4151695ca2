# Read by guest.sh where the guest is to run systemd: makes the host's files fit for it, and goes on as it. It runs guest.sh
# again, as a service.
rm -f /.dockerenv
if [ -n "$LAB_INSTALLED" ]; then
    tar -C "$LAB_INSTALLED" -c . | tar -C / -x --keep-directory-symlink --no-same-owner
fi
mkdir -p /run/systemd/system
# What takes long, waits for what is not here, or changes files of the host's.
for unit in timers.target systemd-tmpfiles-setup.service systemd-udev-trigger.service systemd-udev-settle.service \
    systemd-firstboot.service systemd-machine-id-commit.service systemd-timesyncd.service systemd-networkd.service \
    systemd-resolved.service systemd-logind.service systemd-update-utmp.service systemd-journal-flush.service \
    systemd-random-seed.service systemd-pstore.service systemd-binfmt.service proc-sys-fs-binfmt_misc.automount \
    systemd-remount-fs.service ldconfig.service systemd-journal-catalog-update.service systemd-hwdb-update.service \
    dev-hugepages.mount dev-mqueue.mount sys-kernel-tracing.mount sys-kernel-debug.mount; do
    ln -s /dev/null "/run/systemd/system/$unit"
done
cat >/run/systemd/system/lab.target <<END
[Unit]
Requires=basic.target
Wants=lab.service
END
cat >/run/systemd/system/lab.service <<END
[Unit]
After=basic.target
[Service]
ExecStart=/bin/sh /lab-job/guest.sh
StandardInput=null
END
exec /lib/systemd/systemd --unit=lab.target
