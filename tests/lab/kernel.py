"""Debian's kernel for the lab: fetched and unpacked, never installed, with modules that Debian does not build."""
import fcntl
import glob
import hashlib
import lzma
import os
import re
import shutil
import subprocess
import tempfile
import time

# Modules built from Debian's kernel source; the files are paths in it, or in /usr/src of a package of their own. Edits
# replace text that must be there.
EXTRA = {
    'gpio-sim': {
        'files': ['drivers/gpio/gpio-sim.c', 'drivers/gpio/gpiolib.h', 'kernel/irq/irq_sim.c'],
        'objects': 'gpio-sim.o irq_sim.o',
        'edits': {
            # irq_to_desc is not exported to modules.
            'irq_sim.c': [('handle_simple_irq(irq_to_desc(irqnum));', 'generic_handle_irq(irqnum);')],
            # The file `value` tells, behind the level, how often the line rose, and when it last rose and fell.
            'gpio-sim.c': [
                ('\tconst struct attribute_group **attr_groups;\n};\n',
                 '\tconst struct attribute_group **attr_groups;\n\tbool level[32];\n\tu32 rises[32];\n'
                 '\ts64 rise_ns[32], fall_ns[32];\n};\n\n'
                 'static void gpio_sim_note(struct gpio_sim_chip *chip)\n{\n\tunsigned int i;\n'
                 '\tfor (i = 0; i < chip->gc.ngpio && i < 32; i++) {\n'
                 '\t\tbool level = test_bit(i, chip->value_map);\n\t\tif (level == chip->level[i])\n\t\t\tcontinue;\n'
                 '\t\tchip->level[i] = level;\n\t\tchip->rises[i] += level;\n'
                 '\t\t*(level ? &chip->rise_ns[i] : &chip->fall_ns[i]) = ktime_get_ns();\n\t}\n}\n'),
                ('\t__assign_bit(offset, chip->value_map, value);\n\tmutex_unlock',
                 '\t__assign_bit(offset, chip->value_map, value);\n\tgpio_sim_note(chip);\n\tmutex_unlock'),
                ('chip->value_map, bits, mask, gc->ngpio);\n\tmutex_unlock',
                 'chip->value_map, bits, mask, gc->ngpio);\n\tgpio_sim_note(chip);\n\tmutex_unlock'),
                ('return sysfs_emit(buf, "%d\\n", val);',
                 'return sysfs_emit(buf, "%d %u %lld %lld\\n", val, chip->rises[line_attr->offset % 32],\n'
                 '\t\tchip->rise_ns[line_attr->offset % 32], chip->fall_ns[line_attr->offset % 32]);')]},
    },
    'vkms': {'files': ['drivers/gpu/drm/vkms'], 'config': 'CONFIG_DRM_VKMS=m'},
    # Stock vkms has no properties that change colours: here it keeps them, but one, which it refuses to change.
    'vkms-colour': {
        'files': ['drivers/gpu/drm/vkms'],
        'config': 'CONFIG_DRM_VKMS=m',
        'edits': {
            'Makefile': [('vkms-y', 'vkms-colour-y'), ('+= vkms.o', '+= vkms-colour.o')],
            'vkms_crtc.c': [
                ('\tdrm_crtc_helper_add(crtc, &vkms_crtc_helper_funcs);\n',
                 '\tdrm_crtc_helper_add(crtc, &vkms_crtc_helper_funcs);\n\tdrm_mode_crtc_set_gamma_size(crtc, 256);\n'
                 '\tdrm_crtc_enable_color_mgmt(crtc, 256, true, 256);\n')],
            'vkms_output.c': [
                ('static const struct drm_connector_funcs vkms_connector_funcs = {\n',
                 'static const struct drm_prop_enum_list ranges[] = {{0, "Automatic"}, {1, "Full"}};\n'
                 'static const struct drm_prop_enum_list ditherings[] = {{0, "off"}, {1, "on"}};\n'
                 'static struct drm_property *range;\nstatic u64 range_value;\n\n'
                 'static int get(struct drm_connector *connector, const struct drm_connector_state *state,\n'
                 '\t       struct drm_property *property, u64 *value)\n'
                 '{\n\t*value = property == range ? range_value : 1;\n\treturn 0;\n}\n\n'
                 'static int set(struct drm_connector *connector, struct drm_connector_state *state,\n'
                 '\t       struct drm_property *property, u64 value)\n'
                 '{\n\tif (property != range)\n\t\treturn -EINVAL;\n\trange_value = value;\n\treturn 0;\n}\n\n'
                 'static const struct drm_connector_funcs vkms_connector_funcs = {\n'
                 '\t.atomic_get_property = get,\n\t.atomic_set_property = set,\n'),
                ('\tdrm_connector_helper_add(connector, &vkms_conn_helper_funcs);\n',
                 '\tdrm_connector_helper_add(connector, &vkms_conn_helper_funcs);\n'
                 '\trange = drm_property_create_enum(dev, 0, "Broadcast RGB", ranges, 2);\n'
                 '\tdrm_object_attach_property(&connector->base, range, 0);\n'
                 '\tdrm_object_attach_property(&connector->base,\n'
                 '\t\t\t\t   drm_property_create_enum(dev, 0, "dithering mode", ditherings, 2), 1);\n'),
                ('\tdrm_mode_config_reset(dev);\n',
                 '\tdrm_mode_config_reset(dev);\n\tdrm_connector_attach_max_bpc_property(connector, 6, 12);\n')]},
    },
    # Stock vivid has no exposure: here it is a control, in 100 us, that makes the picture brighter.
    'vivid-exposure': {
        'files': ['drivers/media/test-drivers/vivid'],
        'config': 'CONFIG_VIDEO_VIVID=m',
        'edits': {
            'Makefile': [('vivid-objs', 'vivid-exposure-objs'), ('+= vivid.o', '+= vivid-exposure.o')],
            'vivid-ctrls.c': [
                ('\tcase V4L2_CID_CONTRAST:\n\t\ttpg',
                 '\tcase V4L2_CID_EXPOSURE_ABSOLUTE:\n\t\ttpg_s_brightness(&dev->tpg, min(ctrl->val, 255));\n\t\tbreak;\n'
                 '\tcase V4L2_CID_CONTRAST:\n\t\ttpg'),
                ('\t\t\tV4L2_CID_CONTRAST, 0, 255, 1, 128);\n',
                 '\t\t\tV4L2_CID_CONTRAST, 0, 255, 1, 128);\n\t\tv4l2_ctrl_new_std(hdl_user_vid, &vivid_user_vid_ctrl_ops,'
                 ' V4L2_CID_EXPOSURE_ABSOLUTE, 1, 2550, 1, 128);\n')]},
    },
    # A camera that shows what it is fed.
    'v4l2loopback': {
        'package': 'v4l2loopback-dkms',
        'files': ['v4l2loopback-*'],
        'edits': {'v4l2loopback.c': [
            # What feeds it numbers the frames, as a sensor does, and says which are damaged.
            ('\t\tb->buffer.bytesused = buf->bytesused;\n',
             '\t\tb->buffer.bytesused = buf->bytesused;\n\t\tb->buffer.sequence = buf->sequence;\n'
             '\t\tb->buffer.flags &= ~V4L2_BUF_FLAG_ERROR;\n'
             '\t\tb->buffer.flags |= V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | (buf->flags & V4L2_BUF_FLAG_ERROR);\n'),
            # The end of feeding unplugs the camera.
            ('\tMARK();\n\tdprintk("%d\\n", type);\n\treturn 0;\n',
             '\tif (type == V4L2_BUF_TYPE_VIDEO_OUTPUT) {\n\t\tvideo_unregister_device(video_devdata(file));\n'
             '\t\twake_up_all(&v4l2loopback_getdevice(file)->read_event);\n\t}\n\treturn 0;\n'),
            ('vdev->release = &video_device_release;', 'vdev->release = &video_device_release_empty;')]},
    },
}
# What the guest needs before it sees the host's files.
BOOT = ['virtio_pci', 'virtio_console', '9pnet_virtio', '9p', 'overlay']


class Missing(Exception):
    """The lab cannot be had here; the text says why."""


def call(*command, **options):
    """The standard output of a command that must succeed."""
    try:
        done = subprocess.run(command, check=True, capture_output=True, text=True, **options)
    except FileNotFoundError as error:
        raise Missing(f'needs the program {command[0]}') from error
    except subprocess.CalledProcessError as error:
        lines = (error.stderr or error.stdout).strip().splitlines() or ['no reason given']
        raise Missing(f'{" ".join(command[:3])}: {lines[-1]}') from error
    return done.stdout


def cache_folder():
    """Where kernels are kept, outside the tree."""
    base = os.environ.get('XDG_CACHE_HOME') or os.path.join(os.path.expanduser('~'), '.cache')
    return os.environ.get('NACRE_LAB_CACHE') or os.path.join(base, 'nacre', 'lab')


def recipe():
    """Changes when this file does, so that what an older one made is not used."""
    with open(__file__, 'rb') as file:
        return hashlib.sha256(file.read()).hexdigest()[:12]


def kernels():
    """Folders of complete kernels made by this recipe, newest last."""
    return sorted(glob.glob(os.path.join(cache_folder(), f'*-{recipe()}')), key=os.path.getmtime)


def use(folder):
    """Mark a kernel as used, and throw away those that nobody used for a week."""
    os.utime(folder)
    for other in glob.glob(os.path.join(cache_folder(), '*-*')):
        if time.time() - os.path.getmtime(other) > 7 * 86400:
            shutil.rmtree(other)
    return folder


def latest_release():
    """The release that Debian's meta package stands for, '6.1.0-56-amd64'."""
    found = re.search(r'Depends: linux-image-(\S+)', call('apt-cache', 'depends', 'linux-image-amd64'))
    if not found:
        raise Missing('apt knows no kernel linux-image-amd64')
    return found.group(1)


def download(folder, packages):
    """Fetch packages; the lists of apt may be older than the archive."""
    try:
        call('apt-get', 'download', '-qq', *packages, cwd=folder)
    except Missing:
        if os.geteuid() != 0:
            raise
        call('apt-get', 'update', '-qq')
        call('apt-get', 'download', '-qq', *packages, cwd=folder)


def unpack_source(work, version):
    """The few files of the kernel's source that EXTRA names."""
    prefix = f'linux-source-{version}'
    members = [f'{prefix}/{name}' for module in EXTRA.values() if 'package' not in module for name in module['files']]
    package = glob.glob(f'{work}/{prefix}_*.deb')[0]
    with subprocess.Popen(['dpkg-deb', '--fsys-tarfile', package], stdout=subprocess.PIPE) as outer, \
            subprocess.Popen(['tar', 'xO', f'./usr/src/{prefix}.tar.xz'], stdin=outer.stdout,
                             stdout=subprocess.PIPE) as inner:
        call('tar', 'xJ', '-C', work, *dict.fromkeys(members), stdin=inner.stdout)
    return os.path.join(work, prefix)


def edit(path, changes):
    with open(path, encoding='utf-8') as file:
        text = file.read()
    for old, new in changes:
        if old not in text:
            raise Missing(f'{os.path.basename(path)}: has no "{old}" to replace')
        text = text.replace(old, new)
    with open(path, 'w', encoding='utf-8') as file:
        file.write(text)


def build_module(name, source, work, headers, modules):
    """Build one of EXTRA out of the kernel's tree into modules/extra."""
    folder = os.path.join(work, name)
    os.mkdir(folder)
    for path in EXTRA[name]['files']:
        for file in [os.path.join(source, path)] if path.endswith(('.c', '.h')) else \
                glob.glob(os.path.join(source, path, '*')):
            shutil.copy(file, folder)
    for file, changes in EXTRA[name].get('edits', {}).items():
        edit(os.path.join(folder, file), changes)
    if 'objects' in EXTRA[name]:
        with open(os.path.join(folder, 'Kbuild'), 'w', encoding='ascii') as file:
            # The module may not have the name of one of its objects.
            os.rename(os.path.join(folder, f'{name}.c'), os.path.join(folder, f'{name}-main.c'))
            objects = EXTRA[name]['objects'].replace(f'{name}.o', f'{name}-main.o')
            file.write(f'obj-m := {name}.o\n{name}-objs := {objects}\n')
    call('make', '-j2', '-C', headers, f'M={folder}', *EXTRA[name].get('config', '').split(), 'modules')
    os.makedirs(os.path.join(modules, 'extra'), exist_ok=True)
    shutil.copy(os.path.join(folder, f'{name}.ko'), os.path.join(modules, 'extra'))


def unpack_kernel(path):
    """The ELF kernel inside a bzImage, which QEMU starts without unpacking."""
    with open(path, 'rb') as file:
        data = file.read()
    start = data.find(b'\xfd7zXZ\0')
    if start < 0:
        raise Missing(f'{os.path.basename(path)}: is not compressed with xz')
    return lzma.LZMADecompressor().decompress(data[start:])


def boot_modules(modules):
    """Files of BOOT and what they need, in the order in which they load."""
    needs = {}
    with open(os.path.join(modules, 'modules.dep'), encoding='ascii') as file:
        for line in file:
            path, rest = line.split(':')
            needs[os.path.basename(path).removesuffix('.ko')] = [path, *rest.split()]
    order = []
    for name in BOOT:
        path, *rest = needs[name]
        order += [other for other in (*reversed(rest), path) if other not in order]
    return [os.path.join(modules, path) for path in order]


def cpio(entries):
    """A `newc` archive, which the kernel unpacks as its first root, of (name, mode, bytes)."""
    out = bytearray()
    for inode, (name, mode, data) in enumerate([*entries, ('TRAILER!!!', 0, b'')], 1):
        fields = (inode, mode, 0, 0, 1, 0, len(data), 0, 0, 0, 0, len(name) + 1, 0)
        out += b'070701' + b''.join(b'%08X' % field for field in fields) + name.encode() + b'\0'
        out += b'\0' * (-len(out) % 4) + data
        out += b'\0' * (-len(out) % 4)
    return bytes(out)


def make_initramfs(modules, more):
    """The first root of a guest, with `more` entries for cpio."""
    busybox = shutil.which('busybox')
    if not busybox:
        raise Missing('needs the package busybox-static')
    entries = [(name, 0o40755, b'') for name in ('bin', 'dev', 'proc', 'sys', 'lower', 'upper', 'root', 'modules')]
    with open(busybox, 'rb') as file:
        entries.append(('bin/busybox', 0o100755, file.read()))
    for number, path in enumerate(boot_modules(modules)):
        with open(path, 'rb') as file:
            entries.append((f'modules/{number:02}.ko', 0o100644, file.read()))
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), 'init.sh'), 'rb') as file:
        entries.append(('init', 0o100755, file.read()))
    return cpio(entries + more)


def make(release, work):
    """Fill `work`/kernel with what a guest boots from."""
    version = '.'.join(release.split('.')[:2])
    flavour = release.rsplit('-', 1)[1]
    common = release.removesuffix(flavour) + 'common'
    download(work, [f'linux-image-{release}', f'linux-headers-{release}', f'linux-headers-{common}',
                    f'linux-kbuild-{version}', f'linux-source-{version}',
                    *(module['package'] for module in EXTRA.values() if 'package' in module)])
    tree = os.path.join(work, 'tree')
    for package in glob.glob(f'{work}/*.deb'):
        if not os.path.basename(package).startswith('linux-source'):
            call('dpkg-deb', '-x', package, tree)
    headers = f'{tree}/usr/src/linux-headers-{release}'
    edit(f'{headers}/Makefile', [('include /usr/src/', f'include {tree}/usr/src/')])
    source = unpack_source(work, version)
    made = os.path.join(work, 'kernel')
    modules = os.path.join(made, 'lib/modules', release)
    os.makedirs(os.path.dirname(modules))
    shutil.move(f'{tree}/lib/modules/{release}', modules)
    for name in EXTRA:
        build_module(name, f'{tree}/usr/src' if 'package' in EXTRA[name] else source, work, headers, modules)
    call('depmod', '-b', made, release)
    with open(os.path.join(made, 'vmlinux'), 'wb') as file:
        file.write(unpack_kernel(f'{tree}/boot/vmlinuz-{release}'))
    return made


def prepare(say):
    """Make sure that the newest kernel is in the cache; without a network the newest that is there will do."""
    os.makedirs(cache_folder(), exist_ok=True)
    with open(os.path.join(cache_folder(), 'lock'), 'w', encoding='ascii') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            release = latest_release()
            folder = os.path.join(cache_folder(), f'{release}-{recipe()}')
            if os.path.isdir(folder):
                return use(folder)
            say(f'lab: fetching Debian\'s kernel {release} and building {" and ".join(EXTRA)} for it')
            with tempfile.TemporaryDirectory(dir=cache_folder()) as work:
                os.rename(make(release, work), folder)
        except Missing:
            if not kernels():
                raise
        return use(kernels()[-1])
