#!/usr/bin/env python3
"""Runs programs as root on real kernel drivers: in a guest of QEMU with Debian's kernel that sees the host's files.

  lab.py prepare          fetch the kernel and build modules for it, once a machine
  lab.py run COMMAND...   boot once and run each COMMAND (a shell's line) there, in this folder; what it writes comes out
                          here and what it does to files is lost. Status 0: all succeeded; 1: one failed; 77: no lab here
  lab.py path             print the kernel's folder
  lab.py missing WHAT     end as a test that cannot be run for want of WHAT

With NACRE_REQUIRE_LAB=1 there being no lab is a failure.
"""
import argparse
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading

import kernel

CONSOLE_LINES = 30
# Passed on to the guest.
PREFIXES = ('NACRE_', 'ASAN_', 'UBSAN_', 'LSAN_', 'OMP_')
KERNEL_LINE = ('console=ttyS0 loglevel=4 panic=-1 mitigations=off nokaslr no_timer_check random.trust_cpu=on '
               'tsc=reliable rcupdate.rcu_expedited=1')


def environment(folder, options, installed):
    release = os.listdir(os.path.join(folder, 'lib/modules'))[0]
    values = {name: value for name, value in os.environ.items() if name.startswith(PREFIXES)}
    values |= {'LAB_KERNEL': folder, 'LAB_RELEASE': release, 'LAB_FOLDER': os.getcwd(),
               'LAB_LIMIT': str(options.limit), 'LAB_SYSTEMD': 'yes' if options.systemd else '', 'LAB_INSTALLED': installed}
    return ''.join(f'export {name}={shlex.quote(value)}\n' for name, value in values.items())


def install(build, work):
    """Install what was built, for the guest to copy to its root; the folder, '' for nothing."""
    if not build:
        return ''
    root = os.path.join(work, 'installed')
    kernel.call('meson', 'install', '-C', build, '--no-rebuild', '--quiet', env=os.environ | {'DESTDIR': root})
    return root


def make_initramfs(folder, commands, options, installed):
    """The guest's first files: the kernel's, and the job."""
    here = os.path.dirname(os.path.abspath(__file__))
    job = [('job', 0o40755, b''),
           ('job/environment', 0o100644, environment(folder, options, installed).encode()),
           ('job/commands', 0o100644, ''.join(f'{command}\n' for command in commands).encode())]
    for name in ('guest.sh', 'systemd.sh'):
        with open(os.path.join(here, name), 'rb') as file:
            job.append((f'job/{name}', 0o100755, file.read()))
    release = os.listdir(os.path.join(folder, 'lib/modules'))[0]
    return kernel.make_initramfs(os.path.join(folder, 'lib/modules', release), job)


def make_disk(work, size):
    """Options of QEMU for an empty disk, /dev/vda in the guest, that outlives boots; none for a size of 0."""
    if size == 0:
        return []
    with open(f'{work}/disk', 'ab') as file:
        file.truncate(size << 20)
    return ['-drive', f'if=none,id=disk,format=raw,file={work}/disk', '-device', 'virtio-blk-pci,drive=disk']


def qemu(folder, work, display, memory, disk):
    program = shutil.which('qemu-system-x86_64')
    if not program:
        raise kernel.Missing('needs the package qemu-system-x86')
    # One processor, whose clock goes by what it has executed, 4 ns an instruction, and by the host's only while it waits for
    # something: a busy host makes a test take longer and not its guest's timing worse.
    return [program, '-machine', 'q35', '-accel', 'tcg,thread=single', '-icount', 'shift=2,sleep=on', '-cpu', 'max',
            '-smp', '1', '-m', str(memory),
            '-nodefaults', '-no-reboot', '-no-user-config', '-display', 'none',
            *([] if display == 'none' else ['-device', display]),
            '-kernel', f'{folder}/vmlinux', '-initrd', f'{work}/initramfs',
            # The kernel makes a variable of what it does not know: the folder for what the monitor writes.
            '-append', f'{KERNEL_LINE} LAB_WORK={work}',
            '-serial', f'file:{work}/console', *make_disk(work, disk),
            '-chardev', 'stdio,id=output,signal=off', '-chardev', f'file,id=status,path={work}/status',
            '-device', 'virtio-serial', '-device', 'virtserialport,chardev=output,name=lab.output',
            '-device', 'virtserialport,chardev=status,name=lab.status',
            # QEMU's monitor, which commands in the guest can speak to.
            '-chardev', f'socket,id=monitor,path={work}/monitor,server=on,wait=off', '-mon', 'chardev=monitor',
            '-chardev', f'socket,id=speaker,path={work}/monitor',
            '-device', 'virtserialport,chardev=speaker,name=lab.monitor',
            '-fsdev', 'local,id=host,path=/,security_model=none,readonly=on,multidevs=remap',
            '-device', 'virtio-9p-pci,fsdev=host,mount_tag=host']


def boot(command, seconds):
    """Run QEMU with its output passed on; whether it ended in time."""
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=sys.stdout) as process:
        late = threading.Event()

        def stop():
            late.set()
            process.kill()
        timer = threading.Timer(seconds, stop)
        timer.start()
        try:
            process.wait()
        finally:
            timer.cancel()
            process.kill()
    return not late.is_set()


def read(path):
    try:
        with open(path, encoding='utf-8', errors='replace') as file:
            return file.read()
    except OSError:
        return ''


def report(commands, statuses, in_time, console):
    """Say what failed; the exit status."""
    failed = False
    for number, command in enumerate(commands):
        status = statuses[number] if number < len(statuses) else None
        if status != 0:
            failed = True
            # Up to 123 a Unity program has told its failures itself.
            why = 'did not come to its end' if status is None else \
                'ran out of time' if status == 124 else f'exit status {status}'
            name = os.path.basename(command.split()[0])
            print(f'lab.py:1:{name}:FAIL: {why}' if status is None or status > 123 else f'lab: {name}: {why}')
    if len(statuses) < len(commands):
        print('lab: the guest ' + ('died' if in_time else 'ran out of time') + '; its last messages:')
        print('\n'.join(console.splitlines()[-CONSOLE_LINES:]))
    return 1 if failed else 0


def run_guest(options, folder, work, commands):
    """Boot once; the statuses of commands that came to their end, and whether the guest did in time."""
    with open(f'{work}/initramfs', 'wb') as file:
        file.write(make_initramfs(folder, commands, options, install(options.install, work)))
    in_time = boot(qemu(folder, work, options.display, options.memory, options.disk), options.timeout)
    return [int(line.split()[0]) for line in read(f'{work}/status').splitlines()], in_time


def run(options):
    kernels = kernel.kernels()
    if not kernels:
        raise kernel.Missing('no kernel is prepared; run tests/lab/lab.py prepare')
    commands = options.command
    with tempfile.TemporaryDirectory(prefix='nacre-lab-') as work:
        while options.cut and len(commands) > 1:
            statuses, in_time = run_guest(options, kernels[-1], work, commands[:1])
            if statuses or not in_time:
                print(f'lab.py:1:{os.path.basename(commands[0])}:FAIL: the guest was to lose its power, and ' +
                      (f'its command ended with status {statuses[0]}' if statuses else 'ran out of time'))
                return 1
            commands = commands[1:]
        statuses, in_time = run_guest(options, kernels[-1], work, commands)
        return report(commands, statuses, in_time, read(f'{work}/console'))


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest='verb', required=True)
    verbs.add_parser('prepare')
    verbs.add_parser('path')
    verbs.add_parser('missing').add_argument('what')
    verb = verbs.add_parser('run')
    verb.add_argument('--timeout', type=float, default=800, help='seconds that the guest may run')
    verb.add_argument('--limit', type=float, default=150, help='seconds that one command may run')
    verb.add_argument('--memory', type=int, default=1024, help='MiB')
    verb.add_argument('--display', default='bochs-display', help="the guest's graphics card, as QEMU calls it, or none")
    verb.add_argument('--disk', type=int, default=0, help='MiB of an empty disk, /dev/vda in the guest; 0: none')
    verb.add_argument('--systemd', action='store_true', help='boot systemd, which runs the commands as a service')
    verb.add_argument('--install', metavar='BUILD', default='',
                      help='install what was built in this folder, as meson does, in the guest alone')
    verb.add_argument('--cut', action='store_true',
                      help="boot for each command, as all but the last cut the guest's power (sysrq b)")
    verb.add_argument('command', nargs='+')
    return parser.parse_args()


def main():
    options = parse()
    # Whoever ends us does not leave half a kernel or a guest behind.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        if options.verb == 'missing':
            raise kernel.Missing(f'needs {options.what}')
        if platform.machine() != 'x86_64':
            raise kernel.Missing(f'the guest is a PC, which cannot run the programs of this {platform.machine()}')
        if options.verb == 'run':
            return run(options)
        folder = kernel.prepare(lambda text: print(text, file=sys.stderr))
        if options.verb == 'path':
            print(folder)
        return 0
    except kernel.Missing as missing:
        print(f'lab: {missing}')
        return 1 if os.environ.get('NACRE_REQUIRE_LAB') == '1' else 77


sys.exit(main())
