#!/usr/bin/env python3
"""Runs the whole way with nacre: scans a virtual sample, develops, factors, measures, renders and reports.

usage: demo.py NACRE FOLDER
"""
import os
import shutil
import subprocess
import sys
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
STATION = os.path.join(ROOT, 'rig/examples/station.yaml')
SAMPLE = os.path.join(ROOT, 'rig/samples/demo.yaml')
WINDOW = 25

nacre, folder = os.path.abspath(sys.argv[1]), sys.argv[2]
times = []


def stage(what, *arguments):
    """Run one nacre command, showing it, what it prints and how long it took."""
    print(f'\n== {what}\n$ nacre {" ".join(arguments)}', flush=True)
    began = time.monotonic()
    status = subprocess.run([nacre, *arguments], cwd=folder, check=False).returncode
    seconds = time.monotonic() - began
    if status != 0:
        sys.exit(f'demo: `nacre {arguments[0]}` failed with exit status {status}')
    times.append((what, seconds))
    print(f'({seconds:.1f} s)', flush=True)


def main():
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(folder)
    stage('Scan the sample at the virtual station', 'scan', 'session', '--station', STATION)
    stage('Develop the raw frames', 'develop', 'session', '-o', 'scan.exr')
    stage('Compute what a perfect station would measure', 'simulate', SAMPLE, '-o', 'exact.exr',
          '--window', str(WINDOW))
    stage('Factor the scan', 'factor', 'scan.exr', '-o', 'material.exr')
    stage('Error of the material against the scan', 'error', 'scan.exr', 'material.exr', '--map', 'error.exr')
    stage('Error of the material against the exact responses', 'error', 'exact.exr', 'material.exr')
    for scene in ('area', 'projector'):
        shutil.copy(os.path.join(ROOT, f'render/examples/{scene}.yaml'), folder)
        stage(f'Render under the {scene} light', 'render', f'{scene}.yaml', '-o', f'{scene}.png')
    stage('Write the report', 'report', 'scan.exr', 'material.exr', 'area.png', 'projector.png',
          '-o', 'report.html')
    summarise()


def summarise():
    made = [('session/', 'raw frames of every pattern and exposure, as a camera writes them'),
            ('scan.exr', 'the responses developed from them'),
            ('exact.exr', 'the exact responses, for comparison'),
            ('material.exr', 'the factored material'),
            ('error.exr', 'its relative error at each surface point'),
            ('area.png', 'the material on a mesh, under an area light'),
            ('projector.png', 'the same under a light that projects a picture'),
            ('report.html', 'all of this on one page; open it in a browser')]
    print('\n== Time')
    for what, seconds in times:
        print(f'{seconds:7.1f} s  {what}')
    print(f'{sum(seconds for _, seconds in times):7.1f} s  in all')
    print(f'\n== Made in {os.path.abspath(folder)}')
    for name, what in made:
        if not os.path.exists(os.path.join(folder, name)):
            sys.exit(f'demo: {name} is missing')
        print(f'{name:14s} {what}')


main()
