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
    print(f'{file}:1:is_formatted:' + ('PASS' if check.returncode == 0 else 'FAIL: run clang-format -i ' + file))
    if check.returncode != 0:
        wrong.append(file)
print(f'{len(files)} Tests {len(wrong)} Failures 0 Ignored')
sys.exit(1 if wrong or not files else 0)
