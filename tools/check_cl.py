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
# Every branch that the preprocessor takes out somewhere is looked at once.
variants = [[], ['-DLANES=16', '-DCLUSTERED=1', '-DMASKED=1', '-DNEGATIVE=1', '-DHALF=1']]
wrong = 0
for file, variant in [(file, variant) for file in files for variant in variants]:
    check = subprocess.run(['clang', '-x', 'cl', '-cl-std=CL1.2', '-fsyntax-only', '-Xclang', '-finclude-default-header',
                            '-Wall', '-Wextra', '-Wno-unused-parameter', '-Wno-unused-function', '-Wshadow', '-Werror', *variant, file],
                           cwd=root, capture_output=True, text=True)
    print(check.stderr, end='')
    wrong += check.returncode != 0
good = files and not wrong
print('tools/check_cl.py:1:every_kernel_is_opencl_1_2:' +
      ('PASS' if good else f'FAIL: {wrong} of {len(files) * len(variants)} are not, see above'))
print(f'1 Tests {0 if good else 1} Failures 0 Ignored')
sys.exit(0 if good else 1)
