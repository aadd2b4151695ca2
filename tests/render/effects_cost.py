#!/usr/bin/env python3
"""Shows that an effect which a scene does not call for costs what one that does not exist costs.

For each effect, a program that calculates a scene's light (probe_effects.c) is built once more with the effect compiled
out. Against the usual build, for which the scene forbids it, the light must be the same bit for bit, the counters of work
the same and 0 for the effect, the programs that OpenCL compiles the same byte for byte, and the instructions that
callgrind counts in the C code (Embree with SSE2 on one thread) the same to 0.05 %. Without --all only the build without
any effect is compared, with a scene that calls for none but the material itself.

Usage: effects_cost.py SOURCES BUILD [--all [RENDER_EFFECT]...]; totals are printed as Unity does."""
import os
import re
import shutil
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..'))
from effects_probe import Probe, write  # noqa: E402

SOURCES, BUILD = (os.path.abspath(a) for a in sys.argv[1:3])
ALL = '--all' in sys.argv[3:]
CHOSEN = [a for a in sys.argv[3:] if a != '--all']
# Sources that ask whether an effect is there.
ASKING = [f'render/{n}.c' for n in ('bake', 'effects', 'irradiance', 'samples', 'stage', 'stage_bake')]
# Those that calculated light depends on, each with the name of its counter or None.
EFFECTS = [('RENDER_SHADOWS', 'shadows'), ('RENDER_SOFT_LIGHT', None), ('RENDER_PROJECTED', 'projected picture'),
           ('RENDER_ENVIRONMENT', 'environment'), ('RENDER_BOUNCES', 'interreflection'),
           ('RENDER_FRESNEL', 'Fresnel transmission'), ('RENDER_LOCAL', None),
           ('RENDER_SUBSURFACE', 'subsurface scattering'), ('RENDER_THIN', None)]

VIEW = '''image: {width: 32, height: 24}
camera: {position_mm: [0, -60, 40], at_mm: [0, 0, 5], angle_deg: 30}
'''
BALL = '''objects:
  - shape: sphere
    size_mm: 20
    material: {file: material.exr, mapping: sphere, point_mm: 1.5}
'''
PLAIN = VIEW + 'lights:\n  - {kind: point, position_mm: [10, -20, 60]}\n' + BALL
FULL = VIEW + '''environment: {color: [0.5, 0.4, 0.3]}
bounces: 1
lights:
  - {kind: area, position_mm: [10, -20, 60], size_mm: [20, 20]}
  - {kind: projector, position_mm: [-20, -10, 50], at_mm: [0, 0, 8], texture: {pattern: checks}}
''' + BALL + '''    index: 1.4
  - {shape: quad, size_mm: [80, 80, 1]}
'''

PROBE = Probe(BUILD, 'tests/render/probe_effects', ASKING, 'RENDER_EFFECTS_WITHOUT', 'take_light')


def names():
    """What scenes call the effects, by their identifiers."""
    with open(os.path.join(SOURCES, 'render/effects.h'), encoding='utf-8') as file:
        enum = re.search(r'enum render_effect \{(.*?)\}', file.read(), re.S).group(1)
    with open(os.path.join(SOURCES, 'render/effects.c'), encoding='utf-8') as file:
        text = file.read()
    table = re.search(r'render_effect_names\[RENDER_EFFECTS\] = \{(.*?)\};', text, re.S).group(1)
    for name, parts in re.findall(r'#define (\w+)((?:[^\n]*\\\n)*[^\n]*)', text):
        table = re.sub(rf'\b{name}\b', lambda _, parts=parts: parts, table)
    ids = [i.strip() for i in enum.split(',') if i.strip() and i.strip() != 'RENDER_EFFECTS']
    texts = re.findall(r'"([^"]+)"', table)
    assert len(ids) == len(texts), (ids, texts)
    return dict(zip(ids, texts))


def environment(folder, cache='cache'):
    """One thread, no instructions that valgrind does not know, and calloc clears all that it gives: whether it must
    hangs on what was freed long before, and comes to 0.4 % of the smallest scene's instructions."""
    home = os.path.join(folder, 'home')
    os.makedirs(home, exist_ok=True)
    with open(os.path.join(home, '.embree3'), 'w', encoding='utf-8') as file:
        file.write('isa=sse2,threads=1\n')
    return dict(os.environ, OMP_NUM_THREADS='1', HOME=home, GLIBC_TUNABLES='glibc.malloc.perturb=1',
                POCL_CACHE_DIR=os.path.join(folder, cache))


def measure(program, scene, folder, cache):
    return PROBE.measure([program, scene, 'all'], environment(folder, cache))


def programs(folder, cache):
    """What OpenCL compiled: PoCL names programs after a hash of source, options and device; the machine code."""
    found = {}
    for place, _, files in os.walk(os.path.join(folder, cache)):
        for file in files:
            if file.endswith('.so'):
                with open(os.path.join(place, file), 'rb') as opened:
                    found[os.path.relpath(os.path.join(place, file), os.path.join(folder, cache))] = opened.read()
    return found


def compare(name, ours, without, counter, called, forbidden, folder):
    """The usual build on `forbidden` against the one without the effect on `called`."""
    here, there = measure(ours, forbidden, folder, 'here'), measure(without, called, folder, 'there')
    PROBE.report(f'{name}_light_is_the_same', here['light'] != there['light'] and 'it differs')
    PROBE.report(f'{name}_work_is_the_same', here != there and f'{here} against {there}')
    if counter:
        PROBE.report(f'{name}_absent_effect_does_no_work', here[counter] != '0' and here[counter])
    ours_built, others = programs(folder, 'here'), programs(folder, 'there')
    PROBE.report(f'{name}_kernels_are_built_from_the_same_source_and_options', sorted(ours_built) != sorted(others) and 'no')
    PROBE.report(f'{name}_kernels_are_the_same_byte_for_byte', ours_built != others and 'they differ')
    shutil.rmtree(os.path.join(folder, 'there'), ignore_errors=True)
    shutil.rmtree(os.path.join(folder, 'here'), ignore_errors=True)
    PROBE.compare_instructions(name, [ours, forbidden, 'light'], [without, called, 'light'], environment(folder), folder)


def main():
    ours = PROBE.ours
    PROBE.check_built()
    with tempfile.TemporaryDirectory() as folder:
        PROBE.run([os.path.join(BUILD, 'tests/render/make_material'), os.path.join(folder, 'material.exr')])
        plain = write(folder, 'plain.yaml', PLAIN)
        full = write(folder, 'full.yaml', FULL)
        compare('no_effect', ours, PROBE.build_without('RENDER_EFFECTS', folder), None, plain, plain, folder)
        known = names()
        busy = measure(ours, full, folder, 'busy') if ALL else {}
        for effect, counter in EFFECTS if ALL else []:
            if CHOSEN and effect not in CHOSEN:
                continue
            if counter:
                PROBE.report(f'{counter.replace(" ", "_")}_is_counted_where_it_is_called_for', busy[counter] == '0' and busy)
            lacking = write(folder, 'lacking.yaml', FULL + f'without: [{known[effect]}]\n')
            compare(known[effect].replace(' ', '_'), ours, PROBE.build_without(effect, folder), counter, full, lacking,
                    folder)
    return PROBE.end()


sys.exit(main())
