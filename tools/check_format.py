#!/usr/bin/env python3
"""Checks that the C files are as clang-format would write them; prints totals as Unity does."""
import os
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
wrong = []
for file in files:
    check = subprocess.run(['clang-format', '--dry-run', '--Werror', file], cwd=root, capture_output=True, text=True)
    if check.returncode != 0:
        wrong.append(file)
        print(f'clang-format -i {file}')
good = files and not wrong
print('tools/check_format.py:1:every_file_is_formatted:' +
      ('PASS' if good else f'FAIL: {len(wrong)} of {len(files)} are not, see above'))
print(f'1 Tests {0 if good else 1} Failures 0 Ignored')
sys.exit(0 if good else 1)
