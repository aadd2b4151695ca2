#!/usr/bin/env python3
"""What --within promises of factoring and scanning against what they took: printed; fails where a promise was broken.

usage: promises.py NACRE     (about three minutes)

Factoring is timed by the wall's clock, from the command's beginning to its end, so that other load counts as it does for
users. A virtual station's hours pass on its own clock, which `nacre scan` reports. Pictures' promises: bench_promise.
"""
import json
import os
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
program = os.path.abspath(sys.argv[1])
broken = 0


def nacre(*arguments):
    """What a command says, as JSON, and the seconds it took."""
    begun = time.monotonic()
    child = subprocess.run([program, *arguments, '--quiet', '--json'], cwd=folder, check=False, capture_output=True, text=True)
    seconds = time.monotonic() - begun
    # Status 1 with a result: a goal was not reached in the time, which is told.
    if not child.stdout.strip():
        sys.exit(f'promises: nacre {" ".join(arguments)} failed: {child.stderr.strip()}')
    return json.loads(child.stdout), seconds


def tell(what, within, took, more):
    global broken
    broken += took > within
    print(f'{what:40} within {within:7.1f} s: {took:7.1f} s taken, {100 * took / within:3.0f} %{more}'
          f'{"; BROKEN" if took > within else ""}', flush=True)


def main():
    sample = os.path.join(ROOT, 'rig/samples/table1/candle-small.yaml')
    nacre('simulate', sample, '-o', 'scan.exr', '--window', '13')
    for model in ('terms', 'clusters'):
        # Kernels of settings that were never used are compiled in an iteration, which nobody can foretell: now they are.
        nacre('factor', 'scan.exr', '-o', 'material.exr', '--model', model, '--within', '40s')
        for within in (10, 25):
            told, seconds = nacre('factor', 'scan.exr', '-o', 'material.exr', '--model', model, '--within', f'{within}s')
            tell(f'factor --model {model}', within, seconds, f', error {100 * told["error"]["mean"]:.3f} %')
    station = os.path.join(ROOT, 'rig/examples/station.yaml')
    for within in (300, 900):
        told, _ = nacre('scan', f'session-{within}', '--station', station, '--within', f'{within}s')
        tell('scan (the station\'s clock)', within, told['station_seconds'], f', {told["patterns"]} patterns, {told["left"]} left')


with tempfile.TemporaryDirectory() as folder:
    main()
sys.exit(1 if broken else 0)
