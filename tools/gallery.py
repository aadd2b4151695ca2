#!/usr/bin/env python3
"""Makes the pictures of docs/gallery: simulates and factors the materials, makes the meshes, renders the scenes of
render/examples/gallery.

usage: gallery.py NACRE FOLDER [--small] [--preview] [SCENE...]

--small takes the wax a quarter as wide, which is simulated in seconds and not minutes; --preview draws by OpenGL.
Materials and meshes that FOLDER holds already are not made again.
"""
import os
import shutil
import subprocess
import sys
import time

import gallery_shapes

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
SCENES = os.path.join(ROOT, 'render/examples/gallery')
SAMPLES = os.path.join(ROOT, 'rig/samples/table1')
# Material: sample, window, terms, clusters.
MATERIALS = {'candle': ('candle', 49, 12, 100), 'crystal-onyx': ('crystal-onyx-small', 15, 12, 5),
             'onyx-lines': ('onyx-lines-small', 15, 20, 10)}
SMALL = {'candle': ('candle-small', 13, 12, 20)}

flags = [word for word in sys.argv[1:] if word.startswith('--')]
words = [word for word in sys.argv[1:] if not word.startswith('--')]
if len(words) < 2 or not set(flags) <= {'--small', '--preview'}:
    sys.exit(__doc__)
nacre, folder = os.path.abspath(words[0]), words[1]


def run(*arguments):
    """One nacre command in the folder, shown."""
    print(f'$ nacre {" ".join(arguments)}', flush=True)
    began = time.monotonic()
    if subprocess.run([nacre, *arguments], cwd=folder, check=False).returncode != 0:
        sys.exit(f'gallery: nacre {arguments[0]} failed')
    print(f'({time.monotonic() - began:.0f} s)', flush=True)


def make_material(name):
    sample, window, terms, clusters = (SMALL if '--small' in flags else {}).get(name, MATERIALS[name])
    made = f'{sample}-{window}.exr'
    if not os.path.exists(os.path.join(folder, made)):
        run('simulate', os.path.join(SAMPLES, f'{sample}.yaml'), '-o', 'scan.exr', '--window', str(window))
        run('factor', 'scan.exr', '-o', made, '--terms', str(terms), '--clusters', str(clusters))
        os.remove(os.path.join(folder, 'scan.exr'))    # up to 0.9 GB
    shutil.copy(os.path.join(folder, made), os.path.join(folder, f'{name}.exr'))


def main():
    chosen = words[2:] or sorted(name[:-5] for name in os.listdir(SCENES))
    os.makedirs(folder, exist_ok=True)
    texts = {}
    for name in chosen:
        with open(os.path.join(SCENES, f'{name}.yaml'), encoding='utf-8') as file:
            texts[name] = file.read()
        shutil.copy(os.path.join(SCENES, f'{name}.yaml'), folder)
    everything = ''.join(texts.values())
    if not os.path.exists(os.path.join(folder, 'terrain.ply')):
        gallery_shapes.vessel(os.path.join(folder, 'vessel.ply'))
        gallery_shapes.terrain(os.path.join(folder, 'terrain.ply'))
    for name in MATERIALS:
        if f'{name}.exr' in everything:
            make_material(name)
    for name in chosen:
        run('render', f'{name}.yaml', '-o', f'{name}.png', *(['--preview'] if '--preview' in flags else []))
    print(f'pictures: {", ".join(os.path.join(folder, name + ".png") for name in chosen)}')


main()
