#!/bin/sh
# First process of a guest once it has the host's files: runs the commands of the job, one after the other.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root
. /lab-job/environment
if [ $$ = 1 ]; then
    mount -t proc proc /proc
    mount -t sysfs sysfs /sys
    mount -t tmpfs tmpfs /run
    mkdir -p /dev/pts /dev/shm
    mount -t devpts devpts /dev/pts
    mount -t tmpfs tmpfs /dev/shm
    mkdir -p "/lib/modules/$LAB_RELEASE"
    mount --bind "$LAB_KERNEL/lib/modules/$LAB_RELEASE" "/lib/modules/$LAB_RELEASE"
    if [ -n "$LAB_SYSTEMD" ]; then
        . /lab-job/systemd.sh
    fi
fi

# port NAME: the device of one of QEMU's serial ports.
port() {
    for entry in /sys/class/virtio-ports/*; do
        if [ "$(cat "$entry/name")" = "$1" ]; then
            echo "/dev/${entry##*/}"
        fi
    done
}

status=$(port lab.status)
exec >"$(port lab.output)" 2>&1 </dev/null
cd "$LAB_FOLDER" || exit
while IFS= read -r command; do
    timeout -k 5 "$LAB_LIMIT" sh -c "$command"
    echo "$? $command" >"$status"
done </lab-job/commands
echo o >/proc/sysrq-trigger
# Until the power is off, and no program can be loaded any more.
sleep 60 2>/dev/null
