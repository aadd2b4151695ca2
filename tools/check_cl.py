#!/usr/bin/env python3
"""Checks every OpenCL file with clang as OpenCL C 1.2, warnings being errors; prints totals as Unity does."""
import os
import shutil
import subprocess
import sys

root = sys.argv[1]
if not shutil.which('clang'):
    print('kernels: clang is not installed')
    sys.exit(77)
files = sorted(os.path.relpath(os.path.join(folder, name), root)
               for top in ('factor', 'lib', 'render', 'rig')
               for folder, _, names in os.walk(os.path.join(root, top))
               for name in names if name.endswith('.cl'))
wrong = 0
for file in files:
    check = subprocess.run(['clang', '-x', 'cl', '-cl-std=CL1.2', '-fsyntax-only', '-Xclang', '-finclude-default-header',
                            '-Wall', '-Wextra', '-Wno-unused-parameter', '-Wno-unused-function', '-Wshadow', '-Werror', file],
                           cwd=root, capture_output=True, text=True)
    print(check.stderr, end='')
    print(f'{file}:1:is_valid_opencl_1_2:' + ('PASS' if check.returncode == 0 else 'FAIL: see above'))
    wrong += check.returncode != 0
print(f'{len(files)} Tests {wrong} Failures 0 Ignored')
sys.exit(1 if wrong or not files else 0)
