#!/usr/bin/env python3
"""lint.py BUILD [FILE...]: runs clang-tidy over these sources, or all of BUILD's compile_commands.json, in parallel.

Prints totals as Unity does."""
import concurrent.futures
import json
import os
import shutil
import subprocess
import sys

build = os.path.abspath(sys.argv[1])
if not shutil.which('clang-tidy'):
    print('lint: clang-tidy is not installed')
    sys.exit(77)
root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def sources():
    """The project's own C files that are compiled: neither generated nor a subproject's."""
    with open(os.path.join(build, 'compile_commands.json'), encoding='utf-8') as file:
        entries = json.load(file)
    paths = {os.path.relpath(os.path.join(e['directory'], e['file']), root) for e in entries}
    own_build = os.path.relpath(build, root)
    return sorted(p for p in paths if p.endswith('.c') and not p.startswith((own_build, 'subprojects', '..')))


def asked_for():
    """The files of the command line, which must be among the sources; all sources without any."""
    paths = [os.path.relpath(os.path.abspath(p), root) for p in sys.argv[2:]]
    unknown = sorted(set(paths) - set(sources()))
    if unknown:
        sys.exit(f'lint: {build} does not compile {", ".join(unknown)}')
    return paths or sources()


def check(path):
    run = subprocess.run(['clang-tidy', '--quiet', '-p', build, path], cwd=root, capture_output=True, text=True)
    return path, run.returncode, run.stdout


# The machine's other work goes first; long files first, so that no processor waits for the last.
os.nice(19)
files = sorted(asked_for(), key=lambda path: os.path.getsize(os.path.join(root, path)), reverse=True)
wrong = 0
with concurrent.futures.ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
    for path, status, output in pool.map(check, files):
        if status != 0:
            print(output, f'{path} is not clean', sep='', flush=True)
        wrong += status != 0
good = files and not wrong
print('tools/lint.py:1:every_file_is_clean_for_clang_tidy:' +
      ('PASS' if good else f'FAIL: {wrong} of {len(files)} are not, see above'))
print(f'1 Tests {0 if good else 1} Failures 0 Ignored')
sys.exit(0 if good else 1)
