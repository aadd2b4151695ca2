#!/usr/bin/env python3
"""Checks that the C files are as clang-format would write them; prints totals as Unity does."""
import os
import re
import shutil
import subprocess
import sys

root = sys.argv[1]
if not shutil.which('clang-format'):
    print('format: clang-format is not installed')
    sys.exit(77)
files = sorted(os.path.relpath(os.path.join(folder, name), root)
               for top in ('cmd', 'factor', 'firmware', 'lib', 'render', 'rig', 'study', 'tests')
               for folder, _, names in os.walk(os.path.join(root, top))
               for name in names if name.endswith(('.c', '.h')))
# One process for all: starting it costs more than most files do.
check = subprocess.run(['clang-format', '--dry-run', '--Werror', *files], cwd=root, capture_output=True, text=True)
wrong = sorted(set(re.findall(r'^([^:\n]+):\d+:\d+: error: ', check.stderr, re.MULTILINE)))
for file in wrong:
    print(f'clang-format -i {file}')
if check.returncode != 0 and not wrong:
    print(check.stderr)
good = files and check.returncode == 0
print('tools/check_format.py:1:every_file_is_formatted:' +
      ('PASS' if good else f'FAIL: {len(wrong)} of {len(files)} are not, see above'))
print(f'1 Tests {0 if good else 1} Failures 0 Ignored')
sys.exit(0 if good else 1)
