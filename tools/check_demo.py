#!/usr/bin/env python3
"""Runs the demo and looks at what it made; prints totals as Unity does.

usage: check_demo.py NACRE FOLDER
"""
import json
import os
import subprocess
import sys

nacre, folder = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
here = os.path.dirname(os.path.abspath(__file__))
failures = []
count = 0


def check(name, holds, why):
    global count
    count += 1
    print(f'demo:1:{name}:' + ('PASS' if holds else f'FAIL: {why}'), flush=True)
    if not holds:
        failures.append(name)


def beginning(name):
    try:
        with open(os.path.join(folder, name), 'rb') as file:
            return file.read(24)
    except OSError:
        return b''


def mean_error(scan):
    run = subprocess.run([nacre, 'error', scan, 'material.exr', '--json'], cwd=folder, capture_output=True, text=True)
    return json.loads(run.stdout)['error']['mean'] if run.returncode == 0 else 1


run = subprocess.run([os.path.join(here, 'demo.py'), nacre, folder], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                     text=True)
print(run.stdout)
check('runs_to_its_end', run.returncode == 0, f'exit status {run.returncode}')
for name in ('area.png', 'projector.png'):
    header = beginning(name)
    size = int.from_bytes(header[16:20], 'big'), int.from_bytes(header[20:24], 'big')
    check(name.replace('.', '_') + '_is_a_picture', header[:8] == b'\x89PNG\r\n\x1a\n' and min(size) >= 240, size)
check('report_is_a_page', beginning('report.html').lower().startswith(b'<!doctype html>'), 'no HTML')
# The factors leave 1.2 % of the demo's scan, and the station 0.7 % of the exact responses; a coarse fault leaves more
# than twice their sum.
if run.returncode == 0:
    for scan in ('scan.exr', 'exact.exr'):
        error = mean_error(scan)
        check(f'material_is_near_{scan.replace(".", "_")}', 0 < error < 0.03, f'mean relative error {error}')
print(f'{count} Tests {len(failures)} Failures 0 Ignored')
sys.exit(1 if failures else 0)
