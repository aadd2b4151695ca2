#!/usr/bin/env python3
"""Tells how much each effect adds to the error of developed responses: scans a virtual sample with all effects and with
each forbidden in turn, compares with the exact responses, and prints tables; --write puts them into docs/accuracy.md.

usage: accuracy.py NACRE [--write] [FOLDER]     (about three minutes on one core)

`ninja -C build accuracy` does so.
"""
import json
import os
import re
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
SAMPLE = os.path.join(ROOT, 'rig/samples/demo.yaml')
WINDOW, SPACING, GRIDS = 25, 25, 200
DOCUMENT = os.path.join(ROOT, 'docs/accuracy.md')
lines = []


def nacre(*arguments):
    """What one nacre command says, as JSON."""
    done = subprocess.run([program, *arguments, '--quiet', '--json'], cwd=folder, check=False, capture_output=True,
                          text=True)
    if done.returncode != 0:
        sys.exit(f'accuracy: nacre {" ".join(arguments)} failed: {done.stderr.strip()}')
    return json.loads(done.stdout) if done.stdout.strip() else {}


def settings(name, without=(), spacing=SPACING, **changes):
    """Write a station and its plan for the effects that are left."""
    with open(os.path.join(ROOT, 'rig/examples/station.yaml'), encoding='utf-8') as file:
        station = file.read()
    station = station.replace('../samples/demo.yaml', SAMPLE).replace('plan.yaml', f'{name}-plan.yaml')
    for key, value in changes.items():
        station, count = re.subn(rf'(?m)^( +{key}:) [^\s#]+', rf'\1 {value}', station)
        assert count, key
    if without:
        station += f'without: [{", ".join(without)}]\n'
    with open(os.path.join(ROOT, 'rig/examples/plan.yaml'), encoding='utf-8') as file:
        plan = file.read().replace('grid_spacing: 25', f'grid_spacing: {spacing}\ngrid_patterns: {GRIDS}')
    for what, text in (('station', station), ('plan', plan)):
        with open(os.path.join(folder, f'{name}-{what}.yaml'), 'w', encoding='utf-8') as file:
            file.write(text)


def error_of(name, *options):
    """Develop a session and compare it with the exact responses: (mean error, bias, what develop says)."""
    report = nacre('develop', name, '-o', 'scan.exr', *options)
    difference = nacre('error', 'exact.exr', 'scan.exr')
    return difference['mean'], difference['bias'], report


def edit(name, pattern, replacement):
    """Change one thing in the station file of `name`."""
    path = os.path.join(folder, f'{name}-station.yaml')
    with open(path, encoding='utf-8') as file:
        text, count = re.subn(pattern, replacement, file.read())
    assert count == 1, pattern
    with open(path, 'w', encoding='utf-8') as file:
        file.write(text)


def scan(name):
    if not os.path.exists(os.path.join(folder, name)):
        nacre('scan', name, '--station', f'{name}-station.yaml')


def identity(name):
    """The id that the frame files of a session carry, as many bytes for each session."""
    with open(os.path.join(folder, name, 'session.yaml'), encoding='utf-8') as file:
        return re.search(r'(?m)^id: *"?([0-9a-f]{16})', file.read())[1].encode()


def replace_dots(name, source):
    """Put the dots of the session `source` in place of those of `name`, as if they had been taken there."""
    for file in os.listdir(os.path.join(folder, name, 'calibration')):
        if file.startswith('dots'):
            with open(os.path.join(folder, source, 'calibration', file), 'rb') as frame:
                content = frame.read()
            assert identity(source) in content, file
            with open(os.path.join(folder, name, 'calibration', file), 'wb') as frame:
                frame.write(content.replace(identity(source), identity(name)))


def measure(name, *options, dots_of=None, **station):
    """Scan and develop with the effects of `station`; the dots patterns may be those of another session."""
    settings(name, **station)
    scan(name)
    if dots_of:
        replace_dots(name, dots_of)
    return error_of(name, *options)


def say(line):
    print(line, flush=True)
    lines.append(line)


def write():
    """Put what was said between the marks of the document."""
    marks = re.compile(r'(<!-- begin accuracy -->\n).*?(<!-- end accuracy -->\n)', re.DOTALL)
    with open(DOCUMENT, encoding='utf-8') as file:
        text = file.read()
    table = '\n'.join(lines) + '\n'
    with open(DOCUMENT, 'w', encoding='utf-8') as file:
        file.write(marks.sub(lambda found: found[1] + table + found[2], text))


def percent(value):
    return f'{100 * value:.2f} %'


def row(what, result, full):
    """What forbidding it takes off, in squares, as independent errors add."""
    gain = full[0] ** 2 - result[0] ** 2
    share = percent(gain ** 0.5) if gain > 0 else 'none'
    say(f'| {what} | {percent(result[0])} | {share} | {100 * result[1]:+.2f} % |')


def main():
    nacre('simulate', SAMPLE, '-o', 'exact.exr', '--window', str(WINDOW))
    full = measure('full')
    say('| forbidden | error without it | its part | sum off by |\n| --- | --- | --- | --- |')
    row('nothing', full, full)
    row('shot noise', measure('shot', without=['shot noise']), full)
    row('read noise', measure('read', without=['read noise']), full)
    silent = ['shot noise', 'read noise']
    quiet = measure('silent', without=silent)
    row('all noise', quiet, full)
    row('quantisation (16 bits)', measure('deep', bits=16, pedestal=2048, read_noise=44.8, electrons=0.234375), full)
    row('black level', measure('black', without=['black level']), full)
    row("projector's fall-off", measure('even', without=['projector vignetting']), full)
    row("camera's vignetting", measure('plain', without=['camera vignetting']), full)
    row('noise of the dots (homography)', measure('map', dots_of='silent'), full)
    row('overlap of neighbours', measure('apart', spacing=49), full)
    row('half of the pixels\' size, beside no noise (demosaicing, points\' borders)',
        measure('fine', without=silent, width=416, height=392, pixels_per_point=8), quiet)
    say('\n| developed with | error | more than the default | sum off by |\n| --- | --- | --- | --- |')
    settings('lossy')
    edit('lossy', r'(  projector:\n    contrast: 2000\n    vignetting:) [0-9.]+', r'\1 0.5')
    scan('lossy')
    for name, options in (('full', ['--flat=paper']), ('full', ['--black=clip']), ('full', ['--demosaic=area']),
                          ('full', ['--demosaic=malvar'])):
        result = error_of(name, *options)
        more = result[0] ** 2 - full[0] ** 2
        say(f'| `{options[0]}` | {percent(result[0])} | {percent(more ** 0.5) if more > 0 else "none"} | '
            f'{100 * result[1]:+.2f} % |')
    say('\n| flat field of a projector that loses half its light | error | sum off by |\n| --- | --- | --- |')
    for options in (['--flat=separate'], ['--flat=paper']):
        result = error_of('lossy', *options)
        say(f'| `{options[0]}` | {percent(result[0])} | {100 * result[1]:+.2f} % |')


arguments = [argument for argument in sys.argv[1:] if argument != '--write']
if not arguments:
    sys.exit(__doc__)
program = os.path.abspath(arguments[0])
if len(arguments) > 1:
    folder = os.path.abspath(arguments[1])
    os.makedirs(folder, exist_ok=True)
    main()
else:
    with tempfile.TemporaryDirectory() as folder:
        main()
if '--write' in sys.argv:
    write()
