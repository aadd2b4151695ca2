#!/usr/bin/env python3
"""Shows that an effect which no file calls for costs what one that does not exist costs.

For each effect, a program that takes frames (probe_effects.c) is built once more with the effect compiled out. Against the
usual build, whose station file forbids it, its frames must be the same bit for bit, its counters of work the same and 0 for
the effect, and the instructions that callgrind counts while it takes frames the same within 0.05 %. Without --all only the
build without any effect is compared, with a station that calls for none. The kernels of Monte Carlo: what the preprocessor
leaves of the source for a scene without an effect is what it leaves of a source without the effect's lines.

Usage: effects_cost.py SOURCES BUILD [--all]; totals are printed as Unity does."""
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile

SOURCES, BUILD = (os.path.abspath(a) for a in sys.argv[1:3])
ALL = '--all' in sys.argv[3:]
TARGET = 'tests/virtual/probe_effects'
PATTERNS = 4
TOLERANCE = 0.0005
# Sources that ask whether an effect is there.
ASKING = [f'rig/virtual/{n}.c' for n in ('faults', 'light', 'optics', 'projection', 'surface', 'virtual')]

PLAIN = '''sample: {width: 16, height: 12, pitch_mm: 0.5}
camera: {driver: virtual, width: 80, height: 60, bits: 12, bayer: RGGB, pedestal: 64}
projector: {driver: virtual, wheel_hz: 30}
trigger: {driver: virtual}
virtual: {sample: plain.yaml}
'''
FULL = '''sample: {width: 16, height: 12, pitch_mm: 0.5}
camera: {driver: virtual, width: 80, height: 60, bits: 12, bayer: RGGB, pedestal: 64, read_noise: 4, electrons: 1}
projector: {driver: virtual, wheel_hz: 30}
trigger: {driver: virtual}
virtual:
  sample: full.yaml
  seed: 3
  tilt_deg: [2, -1.5]
  projector:
    contrast: 500
    vignetting: 0.2
    latency_ms: 16
    defocus_points: 1
    shift_points: [0.25, -0.15]
    wheel: {segments: [{color: [1, 0, 0], angle_deg: 120}, {color: [0, 1, 0], angle_deg: 120},
                       {color: [0, 0, 1], angle_deg: 120}]}
    lamp: {drift_hours: 0.5, flicker_hz: 100, drift: 0.02, flicker: 0.01}
  camera:
    {elevation_deg: 20, pixels_per_point: 4.6, distance_mm: 200, vignetting: 0.15, readout_ms: 15,
     distortion: [-0.02, 0.002], defocus_px: 2, dark_per_s: 200, nonuniformity: 0.02, hot_pixels: 0.005,
     hot_per_s: 20000, dead_pixels: 0.005, dropped_frames: 0.1, late_frames: 0.2}
  trigger: {stray: 0.2}
'''
SLAB = '''width: 16
height: 12
pitch_mm: 0.5
thickness_mm: 4
margin_points: 4
base: pale
materials:
  - {name: pale, scattering_per_mm: [2.6, 2.5, 2.4], absorption_per_mm: [0.2, 0.3, 0.5], index: 1.3}
'''
SURFACE = 'surface: {roughness: 0.25}\ndust: {per_cm2: 20, size_mm: 0.3, seed: 2}\n'

failures = 0
tests = 0


def report(name, problem):
    """One line as Unity prints it."""
    global failures, tests
    tests += 1
    failures += bool(problem)
    print(f'effects_cost.py:1:{name}:' + (f'FAIL: {problem}' if problem else 'PASS'), flush=True)


def effects():
    """The enum's names and what files call them, in order."""
    with open(os.path.join(SOURCES, 'rig/virtual/effects.h'), encoding='utf-8') as file:
        enum = re.search(r'enum effect_id \{(.*?)\}', file.read(), re.S).group(1)
    with open(os.path.join(SOURCES, 'rig/virtual/effect_names.c'), encoding='utf-8') as file:
        names = re.findall(r'"([^"]+)"[,}]', file.read())
    ids = [i.strip() for i in enum.split(',') if i.strip() and i.strip() != 'EFFECTS']
    assert len(ids) == len(names), (ids, names)
    return list(zip(ids, names))


def run(command, **more):
    return subprocess.run(command, cwd=BUILD, check=True, capture_output=True, text=True, **more).stdout


def build_without(effect, folder):
    """The probe with an effect compiled out: by the build's own commands, into another folder."""
    commands = [shlex.split(c) for c in run(['ninja', '-t', 'commands', TARGET]).splitlines()]
    objects = []
    for source in ASKING:
        command = next(c for c in commands if '-c' in c and c[c.index('-c') + 1].endswith(source))
        command = command[:command.index('-o')] + command[command.index('-o') + 2:]
        if '-MF' in command:
            command = command[:command.index('-MF')] + command[command.index('-MF') + 2:]
        command = [c for c in command if c not in ('-MD', '-MQ')]
        command = [c for i, c in enumerate(command) if not c.endswith('.o')]
        made = os.path.join(folder, os.path.basename(source) + '.o')
        run(command + [f'-DEFFECTS_WITHOUT={effect}', '-o', made])
        objects.append(made)
    link = next(c for c in commands if '-o' in c and c[c.index('-o') + 1] == TARGET and '-c' not in c)
    at = link.index('-o')
    program = os.path.join(folder, 'probe')
    run(link[:at] + ['-o', program] + objects + link[at + 2:])
    return program


def measure(program, station):
    """What the program prints, as a dictionary."""
    lines = run([program, station, str(PATTERNS)], env=dict(os.environ, OMP_NUM_THREADS='1')).splitlines()
    return dict(line.split(': ') for line in lines)


def count_instructions(program, station, folder):
    """Instructions while frames are taken, by callgrind."""
    out = os.path.join(folder, 'callgrind.out')
    run(['valgrind', '--tool=callgrind', '--collect-atstart=no', '--toggle-collect=take_frames',
         f'--callgrind-out-file={out}', program, station, str(PATTERNS)], env=dict(os.environ, OMP_NUM_THREADS='1'))
    with open(out, encoding='utf-8') as file:
        return int(re.search(r'^(?:summary|totals): (\d+)', file.read(), re.M).group(1))


def compare(name, ours, without, effect_name, called, forbidden, folder):
    """The usual build on `forbidden` against the one without the effect on `called`."""
    here, there = measure(ours, forbidden), measure(without, called)
    report(f'{name}_frames_are_the_same', here['frames'] != there['frames'] and 'they differ')
    report(f'{name}_work_is_the_same', here != there and f'{here} against {there}')
    if effect_name:
        report(f'{name}_absent_effect_does_no_work', here[effect_name] != '0' and here[effect_name])
    if shutil.which('valgrind'):
        counts = [count_instructions(p, s, folder) for p, s in ((ours, forbidden), (without, called))]
        off = counts[0] / counts[1] - 1
        print(f'{name}: {counts[0]} instructions, {counts[1]} without it in the program: {100 * off:+.4f} %')
        report(f'{name}_instructions_are_the_same', (counts[1] < 1000000 or abs(off) > TOLERANCE) and counts)


def write(folder, name, text):
    path = os.path.join(folder, name)
    with open(path, 'w', encoding='utf-8') as file:
        file.write(text)
    return path


def cut(source, macro):
    """A kernel's source without the lines of an effect that `macro` tells to be absent."""
    kept, hidden = [], []
    for line in source.splitlines(keepends=True):
        if re.match(r'#\s*if', line):
            hidden.append(bool(re.match(rf'#\s*ifndef {macro}\b', line)))
            if hidden[-1]:
                continue
        elif re.match(r'#\s*endif', line) and hidden.pop():
            continue
        if not any(hidden):
            kept.append(line)
    return ''.join(kept)


def compare_kernels():
    """Each effect of the kernel that paths are traced with."""
    with open(os.path.join(SOURCES, 'rig/virtual/montecarlo.cl'), encoding='utf-8') as file:
        source = file.read()
    for macro in ('MATCHED', 'ISOTROPIC', 'CLEAR', 'ALIKE'):
        def preprocess(text, *defines):
            return subprocess.run(['cc', '-E', '-P', '-xc', *defines, '-'], input=text, check=True, capture_output=True,
                                  text=True).stdout
        bare = cut(source, macro)
        absent = preprocess(source, f'-D{macro}')
        same = absent == preprocess(bare) and macro not in re.sub(r'/\*.*?\*/', '', bare, flags=re.S)
        there = preprocess(source) != absent
        report(f'kernel_without_{macro}_is_built_from_the_source_without_it', not (same and there) and 'it differs')


def main():
    ours = os.path.join(BUILD, TARGET)
    with tempfile.TemporaryDirectory() as folder:
        write(folder, 'plain.yaml', SLAB)
        write(folder, 'full.yaml', SLAB + SURFACE)
        full = write(folder, 'full-station.yaml', FULL)
        plain = write(folder, 'plain-station.yaml', PLAIN)
        compare('no_effect', ours, build_without('EFFECTS', folder), None, plain, plain, folder)
        for effect, name in effects() if ALL else []:
            lacking = write(folder, 'lacking.yaml', FULL + f'without: [{name}]\n')
            compare(name.replace(' ', '_').replace('-', '_'), ours, build_without(effect, folder), name, full, lacking,
                    folder)
    compare_kernels()
    if not shutil.which('valgrind'):
        print('valgrind is not installed: instructions were not counted')
    print(f'{tests} Tests {failures} Failures 0 Ignored')
    return 1 if failures else 0


sys.exit(main())
