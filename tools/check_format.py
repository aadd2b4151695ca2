#!/usr/bin/env python3
"""Checks that the C and OpenCL files are as clang-format would write them; prints totals as Unity does."""
import shutil
import subprocess
import sys

root = sys.argv[1]
if not shutil.which('clang-format'):
    print('format: clang-format is not installed')
    sys.exit(77)
listed = subprocess.run(['git', '-C', root, '-c', f'safe.directory={root}', 'ls-files', '*.c', '*.h'],
                        capture_output=True, text=True)
files = listed.stdout.split()
if listed.returncode != 0 or not files:
    print('format: not a git checkout, so the list of files is unknown')
    sys.exit(77)
wrong = []
for file in files:
    check = subprocess.run(['clang-format', '--dry-run', '--Werror', file], cwd=root, capture_output=True, text=True)
    print(f'{file}:1:is_formatted:' + ('PASS' if check.returncode == 0 else 'FAIL: run clang-format -i ' + file))
    if check.returncode != 0:
        wrong.append(file)
print(f'{len(files)} Tests {len(wrong)} Failures 0 Ignored')
sys.exit(1 if wrong else 0)
