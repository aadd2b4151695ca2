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
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..'))
from effects_probe import Probe, write  # noqa: E402

SOURCES, BUILD = (os.path.abspath(a) for a in sys.argv[1:3])
ALL = '--all' in sys.argv[3:]
PATTERNS = 4
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

PROBE = Probe(BUILD, 'tests/virtual/probe_effects', ASKING, 'EFFECTS_WITHOUT', 'take_frames')
ENVIRONMENT = dict(os.environ, OMP_NUM_THREADS='1')


def effects():
    """The enum's names and what files call them, in order."""
    with open(os.path.join(SOURCES, 'rig/virtual/effects.h'), encoding='utf-8') as file:
        enum = re.search(r'enum effect_id \{(.*?)\}', file.read(), re.S).group(1)
    with open(os.path.join(SOURCES, 'rig/virtual/effect_names.c'), encoding='utf-8') as file:
        names = re.findall(r'"([^"]+)"[,}]', file.read())
    ids = [i.strip() for i in enum.split(',') if i.strip() and i.strip() != 'EFFECTS']
    assert len(ids) == len(names), (ids, names)
    return list(zip(ids, names))


def compare(name, ours, without, effect_name, called, forbidden, folder):
    """The usual build on `forbidden` against the one without the effect on `called`."""
    commands = [ours, forbidden, str(PATTERNS)], [without, called, str(PATTERNS)]
    here, there = (PROBE.measure(command, ENVIRONMENT) for command in commands)
    PROBE.report(f'{name}_frames_are_the_same', here['frames'] != there['frames'] and 'they differ')
    PROBE.report(f'{name}_work_is_the_same', here != there and f'{here} against {there}')
    if effect_name:
        PROBE.report(f'{name}_absent_effect_does_no_work', here[effect_name] != '0' and here[effect_name])
    PROBE.compare_instructions(name, *commands, ENVIRONMENT, folder)


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
        PROBE.report(f'kernel_without_{macro}_is_built_from_the_source_without_it', not (same and there) and 'it differs')


def main():
    ours = PROBE.ours
    PROBE.check_built()
    with tempfile.TemporaryDirectory() as folder:
        write(folder, 'plain.yaml', SLAB)
        write(folder, 'full.yaml', SLAB + SURFACE)
        full = write(folder, 'full-station.yaml', FULL)
        plain = write(folder, 'plain-station.yaml', PLAIN)
        compare('no_effect', ours, PROBE.build_without('EFFECTS', folder), None, plain, plain, folder)
        for effect, name in effects() if ALL else []:
            lacking = write(folder, 'lacking.yaml', FULL + f'without: [{name}]\n')
            compare(name.replace(' ', '_').replace('-', '_'), ours, PROBE.build_without(effect, folder), name, full, lacking,
                    folder)
    compare_kernels()
    return PROBE.end()


sys.exit(main())
