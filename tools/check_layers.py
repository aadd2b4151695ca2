#!/usr/bin/env python3
"""Checks that sources name only headers of the layers that theirs may use; prints totals as Unity does."""
import os
import re
import sys

# Layer: the layers whose headers its files may name beside their own. docs/architecture.md says why.
MAY_USE = {
    'lib/nacre': [],
    'lib/base': ['lib/nacre'],
    'firmware': [],
    'rig': ['lib/base', 'lib/nacre'],
    'rig/virtual': ['rig', 'lib/base', 'lib/nacre'],
    'rig/daemon': ['rig', 'lib/base', 'lib/nacre'],
    'rig/develop': ['rig', 'lib/base', 'lib/nacre'],
    'factor': ['lib/base', 'lib/nacre'],
    'render': ['lib/base', 'lib/nacre'],
    'study': ['factor', 'render', 'rig/develop', 'rig', 'lib/base', 'lib/nacre'],
    'cmd': ['study', 'factor', 'render', 'rig/virtual', 'rig/develop', 'rig/daemon', 'rig', 'lib/base',
            'lib/nacre'],
    'tests': ['firmware', 'study', 'factor', 'render', 'rig/virtual', 'rig/develop', 'rig/daemon', 'rig',
              'lib/base', 'lib/nacre'],
}
# A station file holds the settings of every driver, of the virtual ones too; behind them are only the checks of single
# values, which the station's library holds.
# The trigger board's back end speaks the firmware's protocol; nothing else of the firmware is for the host.
EXCEPTIONS = {('rig/station.h', 'rig/virtual/settings.h'), ('rig/station.c', 'rig/virtual/settings.h'),
              ('rig/station_check.c', 'rig/virtual/settings_check.h'),
              ('rig/trigger_usb.c', 'firmware/protocol.h'), ('rig/trigger_usb.h', 'firmware/protocol.h')}
# Headers from outside that a layer must do without: the public library has no OpenCL.
OUTSIDE = {'lib/nacre': ('CL/', 'yaml.h', 'jansson.h')}

INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*(["<])([^">]+)[">]', re.MULTILINE)


def layer_of(path):
    """The layer with the longest name that holds the file."""
    holding = [layer for layer in MAY_USE if path.startswith(layer + '/')]
    return max(holding, key=len) if holding else None


def locate(root, file, header):
    """The path of a header named in quotes, from the root of the project, or None where there is none."""
    for folder in (os.path.dirname(file), '', 'lib'):
        path = os.path.normpath(os.path.join(folder, header))
        if os.path.exists(os.path.join(root, path)):
            return path
    return None


def faults(file, text, find):
    """What is wrong with the includes of a file; `find` maps a header's name to its path."""
    layer = layer_of(file)
    for quote, header in INCLUDE.findall(text):
        if quote == '<':
            if header.startswith(OUTSIDE.get(layer, ())):
                yield f'{layer} must do without <{header}>'
            continue
        path = find(header)
        if path is None:
            if layer != 'tests':  # unity.h is not ours
                yield f'"{header}" is no file of the project; name it in angle brackets'
            continue
        used = layer_of(path)
        if used != layer and used not in MAY_USE[layer] and (file, path) not in EXCEPTIONS:
            yield f'{layer} must not use {used or "what is outside the layers"} ("{header}")'


def check_itself():
    """The twins: includes that must pass, and includes that must not."""
    cases = [
        ('factor/a.c', '#include "rig/plan.h"', False),
        ('factor/a.c', '#include "base/opencl.h"', True),
        ('factor/a.c', '  # include "render/scene.h"', False),
        ('lib/base/a.c', '#include "factor/a.h"', False),
        ('lib/nacre/a.c', '#include "base/clock.h"', False),
        ('lib/nacre/a.c', '#include <CL/cl.h>', False),
        ('lib/nacre/a.c', '#include <math.h>', True),
        ('rig/sequence.c', '#include "rig/virtual/settings.h"', False),
        ('rig/station.h', '#include "rig/virtual/settings.h"', True),
        ('rig/develop/a.c', '#include "rig/virtual/sample.h"', False),
        ('rig/daemon/a.c', '#include "rig/virtual/virtual.h"', False),
        ('rig/sequence.c', '#include "firmware/protocol.h"', False),
        ('rig/trigger_usb.c', '#include "firmware/protocol.h"', True),
        ('rig/trigger_usb.c', '#include "firmware/board.h"', False),
        ('firmware/loop.c', '#include "lib/nacre/error.h"', False),
        ('rig/develop/a.c', '#include "rig/plan.h"', True),
        ('study/a.c', '#include "cmd/verbs.h"', False),
        ('cmd/a.c', '#include "tests/cmd/spawn.h"', False),
        ('cmd/a.c', '#include "study/report.h"', True),
        ('factor/a.c', '// see "rig/plan.h"', True),
    ]

    def find(header):
        return 'lib/' + header if header.startswith(('base/', 'nacre/')) else header

    return [f'{file}: {text}' for file, text, right in cases if (not list(faults(file, text, find))) != right]


def main(root):
    files = sorted(os.path.relpath(os.path.join(folder, name), root)
                   for top in sorted({layer.split('/')[0] for layer in MAY_USE})
                   for folder, _, names in os.walk(os.path.join(root, top))
                   for name in names if name.endswith(('.c', '.h', '.cl')))
    wrong = 0
    mistakes = check_itself()
    print('check_layers.py:1:tells_allowed_includes_from_forbidden_ones:' +
          (f'FAIL: {mistakes[0]}' if mistakes else 'PASS'))
    for file in files:
        with open(os.path.join(root, file), encoding='utf-8') as stream:
            found = list(faults(file, stream.read(), lambda header, file=file: locate(root, file, header)))
        if found:
            print(f'{file}: ' + '; '.join(found))
        wrong += bool(found)
    print('check_layers.py:1:files_use_only_layers_below:' +
          (f'FAIL: {wrong} of {len(files)} do not, see above' if wrong else 'PASS'))
    print(f'2 Tests {bool(wrong) + bool(mistakes)} Failures 0 Ignored')
    return 1 if wrong or mistakes or not files else 0


sys.exit(main(sys.argv[1]))
