#!/bin/busybox sh
# First process of a guest: puts the host's files, read-only, under a layer in memory and goes on from there.
busybox=/bin/busybox
$busybox mount -t proc proc /proc
$busybox mount -t devtmpfs devtmpfs /dev
for module in /modules/*.ko; do
    $busybox insmod "$module"
done
$busybox mount -t 9p -o ro,trans=virtio,version=9p2000.L,cache=loose,msize=524288 host /lower &&
    $busybox mount -t tmpfs -o size=75% upper /upper &&
    $busybox mkdir /upper/files /upper/work &&
    $busybox mount -t overlay -o lowerdir=/lower,upperdir=/upper/files,workdir=/upper/work overlay /root &&
    $busybox cp -r /job /root/lab-job &&
    $busybox mount --move /dev /root/dev &&
    $busybox umount /proc &&
    exec $busybox switch_root /root /bin/sh /lab-job/guest.sh
echo 'lab: the guest cannot mount its files'
$busybox poweroff -f
