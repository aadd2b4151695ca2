#!/usr/bin/env python3
"""Times a picture of a translucent knot by nacre and by POV-Ray's own `subsurface`, same mesh, camera and light.

They do not calculate the same: POV-Ray's is one homogeneous material by the dipole of its translucency, nacre's what was
factored. The comparison is the processor time to a picture, povray's share of nacre's included; the pictures stay in
FOLDER to be looked at.

usage: povray_subsurface.py NACRE MAKE_MATERIAL FOLDER [WIDTH HEIGHT [SAMPLES...]]; SAMPLES as POV-Ray's `subsurface { samples }`: 10,5
"""
import os
import re
import resource
import shutil
import subprocess
import sys

if len(sys.argv) < 4:
    sys.exit(__doc__)
nacre, make_material, folder = (os.path.abspath(word) for word in sys.argv[1:4])
width, height = (int(word) for word in (sys.argv[4:6] or ['200', '150']))
samples = sys.argv[6:] or ['10,5']

SCENE = '''image: {{width: {width}, height: {height}, exposure: 1.1}}
camera: {{position_mm: [0, -330, 210], at_mm: [0, 0, 22], angle_deg: 27}}
lights:
  - {{kind: area, position_mm: [-90, 60, 320], at_mm: [0, 0, 25], size_mm: [220, 220], irradiance: [1, 0.97, 0.92]}}
objects:
  - shape: knot
    size_mm: 130
    thickness: 0.7
    rotation_deg: [0, 0, 15]
    {surface}
  - {{shape: quad, size_mm: [4000, 4000, 1], color: [0.45, 0.44, 0.42]}}
'''
# Millimetres that light goes in wax, in red, green and blue; zeros there stop POV-Ray.
TRANSLUCENCY = '<3.0, 2.4, 1.6>'


def timed(*command, cwd=None):
    """Processor seconds of a command and all that it starts."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if run.returncode != 0:
        sys.exit(f'{command[0]} failed: {run.stderr[-1000:]}')
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def write_scene(name, surface):
    path = os.path.join(folder, name)
    with open(path, 'w', encoding='utf-8') as file:
        file.write(SCENE.format(width=width, height=height, surface=surface))
    return path


def edit(path, pattern, replacement):
    with open(path, encoding='utf-8') as file:
        text = file.read()
    text, count = re.subn(pattern, replacement, text, count=1)
    if count != 1:
        sys.exit(f'{path}: nothing like {pattern} in it; what nacre writes has changed')
    with open(path, 'w', encoding='utf-8') as file:
        file.write(text)


def main():
    if not shutil.which('povray'):
        print('povray is not installed (Debian: apt install povray): nothing to compare with')
        sys.exit(77)
    os.makedirs(folder, exist_ok=True)
    subprocess.run([make_material, os.path.join(folder, 'material.exr')], check=True)
    print(f'{width} x {height} pixels, processor seconds of all threads; pictures in {folder}')
    scene = write_scene('factored.yaml', 'material: {file: material.exr, mapping: uv, point_mm: 1.4}')
    for wish in ('2%', '1%'):
        seconds = timed(nacre, 'render', scene, '-o', os.path.join(folder, f'factored-{wish[0]}.png'), '--error', wish)
        print(f'nacre --error {wish:4}               {seconds:8.1f} s', flush=True)
    scene = write_scene('plain.yaml', 'color: [0.9, 0.8, 0.6]')
    files = os.path.join(folder, 'pov')
    shutil.rmtree(files, ignore_errors=True)  # edited below, so nacre would not write over it
    timed(nacre, 'render', scene, '-o', os.path.join(folder, 'plain.png'), '--povray-shadows', '--pov', files)
    edit(os.path.join(files, 'scene.pov'), 'assumed_gamma 1.0', 'assumed_gamma 1.0 mm_per_unit 1 subsurface { samples SAMPLES }')
    edit(os.path.join(files, 'object-0.inc'), 'emission 0', f'emission 0 subsurface {{ translucency rgb {TRANSLUCENCY} }}')
    edit(os.path.join(files, 'object-0.inc'), r'finish { finish_0 }', 'finish { finish_0 } interior { ior 1.3 }')
    for count in samples:
        edit(os.path.join(files, 'scene.pov'), r'samples [^}]*', f'samples {count} ')
        name = f'povray-{count.replace(",", "-")}.png'
        seconds = timed('povray', '+Iscene.pov', f'+O{name}', '+FN', f'+W{width}', f'+H{height}', '+A0.1', '+AM2', '+R2',
                        '-J', '-D', 'Declare=baked=0', cwd=files)
        shutil.copy(os.path.join(files, name), folder)
        print(f'povray, subsurface samples {count:6} {seconds:8.1f} s', flush=True)


main()
