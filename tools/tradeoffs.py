#!/usr/bin/env python3
"""Tells what accuracy costs at each stage, on the virtual station: scans a virtual sample with other grids, exposures and
black frames, develops, factors and renders it, compares with the exact responses, and prints tables; --write puts them into
docs/accuracy.md, and plots into docs/images/tradeoffs.svg.

usage: tradeoffs.py NACRE LOOP_TABLE HDR_TABLE [--write] [--quick] [FOLDER]     (a quarter of an hour of one core; --quick: a
little of each, as a test; FOLDER keeps sessions and the study, which are not made again)

`ninja -C build tradeoffs` does so. LOOP_TABLE is firmware/loop_table, HDR_TABLE tests/develop/hdr_table.
"""
import array
import json
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
SAMPLE = os.path.join(ROOT, 'rig/samples/demo.yaml')
DOCUMENT = os.path.join(ROOT, 'docs/accuracy.md')
PICTURE = os.path.join(ROOT, 'docs/images/tradeoffs.svg')
lines, spent = [], {}


def nacre(*arguments):
    """What one nacre command says, as JSON; spent['seconds'] becomes its processor time."""
    child = subprocess.Popen([program, *arguments, '--quiet', '--json'], cwd=folder, text=True, stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE)
    output = child.stdout.read()
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    spent['seconds'] = usage.ru_utime + usage.ru_stime
    if child.returncode != 0:
        sys.exit(f'tradeoffs: nacre {" ".join(arguments)} failed: {child.stderr.read().strip()}')
    return json.loads(output) if output.strip() else {}


def settings(name, station='rig/examples/station.yaml', plan='rig/examples/plan.yaml', **changes):
    """Write a station file and its plan; changes are keys of the plan."""
    base = os.path.dirname(os.path.join(ROOT, station))
    with open(os.path.join(ROOT, station), encoding='utf-8') as file:
        text = re.sub(r'(?m)^( +sample:) (\S+\.yaml)', lambda found: f'{found[1]} {os.path.normpath(os.path.join(base, found[2]))}',
                      file.read())
    with open(os.path.join(folder, f'{name}-station.yaml'), 'w', encoding='utf-8') as file:
        file.write(re.sub(r'(?m)^plan:.*', f'plan: {name}-plan.yaml', text))
    with open(os.path.join(ROOT, plan), encoding='utf-8') as file:
        text = file.read()
    for key, value in changes.items():
        text = re.sub(rf'(?m)^{key}:.*\n', '', text) + f'{key}: {value}\n'
    with open(os.path.join(folder, f'{name}-plan.yaml'), 'w', encoding='utf-8') as file:
        file.write(text)
    return f'{name}-station.yaml'


def station_hours(**changes):
    """Of the whole scan, without making it."""
    told = nacre('scan', 'none', '--station', settings('hours', **changes), '--dry-run')
    return told['station_seconds'] / 3600, told['grids']


def exact(window):
    """The exact responses of that window: file and share of light beyond it."""
    name = f'exact-{window}.exr'
    if name not in spent:
        spent[name] = nacre('simulate', SAMPLE, '-o', name, '--window', str(window))['outside_mean']
    return name, spent[name]


def scan(name, **changes):
    station = settings(name, **changes)
    if not os.path.exists(os.path.join(folder, name)):
        nacre('scan', name, '--station', station)


def measure(name, window, grids, **changes):
    """Scan some of the grids and develop: mean error against the exact responses, how much their sums are off, the report."""
    scan(name, window=window, grid_patterns=grids, **changes)
    return develop(name, window)


def develop(name, window, *options):
    report = nacre('develop', name, '-o', f'{name}.exr', *options)
    spent['develop'] = spent['seconds']
    told = nacre('error', exact(window)[0], f'{name}.exr')
    return told['mean'], told['bias'], report


def say(line=''):
    print(line, flush=True)
    lines.append(line)


def head(*titles):
    say()
    say('| ' + ' | '.join(titles) + ' |')
    say('| --- ' * len(titles) + '|')


def row(*cells):
    say('| ' + ' | '.join(str(cell) for cell in cells) + ' |')


def percent(value, digits=2):
    return f'{100 * value:.{digits}f} %'


def minutes(hours):
    return f'{60 * hours:.1f} min' if hours < 2 else f'{hours:.1f} h'


def grids():
    """Spacing: what is lit at once, how long all grids take, and what is lost of each response."""
    say('### Acquisition: how far apart lit points stand')
    say()
    say('Grids whose points stand that far apart, with a window as wide (25 at most; for all responses there are as many grids as the '
        'square of the spacing). *Light beyond the window* is lost, and lands in the windows of neighbours; *error* is that of what '
        'was developed, inside the window. *Candle\'s size* is the station time of 212 x 154 points by the same exposures and one of '
        '8 s. Where a point of the sample is lit at a time (48 here), nothing can overlap.')
    head('spacing', 'grids', 'station time', 'candle\'s size', 'light beyond the window', 'error', 'sums off by')
    points = []
    for spacing in (9, 25, 48) if quick else (9, 13, 17, 21, 25, 33, 48):
        window = min(spacing, 25)
        hours, count = station_hours(grid_spacing=spacing, window=window)
        large = station_hours(station='tests/bench/candle/station.yaml', plan='tests/bench/candle/plan.yaml', grid_spacing=spacing,
                              window=window)[0] if spacing < 48 else large_point_by_point()
        error, bias, _ = measure(f'grid{spacing}', window, min(few, spacing ** 2), grid_spacing=spacing)
        beyond = exact(window)[1]
        row(f'{spacing}' + (' (plan of the demo)' if spacing == 25 else ' (point by point)' if spacing == 48 else ''), count,
            minutes(hours), minutes(large), percent(beyond), percent(error), f'{100 * bias:+.2f} %')
        points.append((60 * hours, 100 * error, 100 * beyond, str(spacing)))
    say()
    say(f'The paper took 3 to 6 hours, and expected 50 or more point by point; K = 49 takes '
        f'{station_hours(station="tests/bench/candle/station.yaml", plan="tests/bench/candle/plan.yaml")[0]:.1f} h here. `nacre plan` '
        'chooses the spacing for a share of light from a pilot scan.')
    return points


def large_point_by_point():
    """One of 212 x 154 points at a time, for which there is no grid: from the time of a grid."""
    candle = {'station': 'tests/bench/candle/station.yaml', 'plan': 'tests/bench/candle/plan.yaml'}
    few_hours, few_count = station_hours(grid_spacing=25, window=25, **candle)
    more_hours, more_count = station_hours(grid_spacing=49, window=25, **candle)
    return few_hours + (212 * 154 - few_count) * (more_hours - few_hours) / (more_count - few_count)


def exposures():
    say()
    say('### Acquisition: exposures of a pattern')
    head('turns of the wheel (30 Hz)', 'station time', 'error', 'sums off by', 'noise in the dark', 'light found on the rim')
    for turns in ([1], [1, 4, 15, 60]) if quick else ([1], [1, 4], [1, 15], [1, 60], [1, 4, 15, 60], [1, 2, 4, 8, 15, 30, 60],
                                                     [1, 4, 15, 60, 240]):
        error, bias, report = measure('turns' + '-'.join(map(str, turns)), 25, few, exposure_turns=turns)
        row(', '.join(map(str, turns)), minutes(station_hours(exposure_turns=turns)[0]), percent(error), f'{100 * bias:+.2f} %',
            darkness(report), percent(report['rim_share'], 3))
    say()
    say('*Noise in the dark*: deviation of an entry without light, over the mean entry of lit points. *The rim*: share of a '
        f'response\'s light in the outermost ring of its window; {percent(exact(25)[1], 3)} lie beyond. The shortest must not '
        'saturate white; the longest decides the time. What lies between is worth more than a longest one, as pixels that '
        'saturate in one exposure are told by the next shorter alone.')


def darkness(report):
    return f'{1e6 * report["noise"] / report["centre"]:.3g} ppm'


def black_frames():
    say()
    say('### Acquisition: black frames')
    counts = (100, 2) if quick else (100, 40, 20, 10, 5, 2)
    shutil.rmtree(os.path.join(folder, 'black'), ignore_errors=True)
    scan('black', window=25, grid_patterns=few, black_frames=counts[0])
    calibration = os.path.join(folder, 'black/calibration')
    frames = sorted(name for name in os.listdir(calibration) if name.startswith('black'))
    assert len(frames) == counts[0], frames
    found = []
    for count in counts:
        for name in frames[count:]:
            os.remove(os.path.join(calibration, name))
        frames = frames[:count]
        error, bias, report = develop('black', 25)
        found.append((count, minutes(station_hours(black_frames=count)[0]), percent(error), f'{100 * bias:+.2f} %',
                      darkness(report), percent(report['rim_share'], 3)))
    head('black frames', 'station time', 'error', 'sums off by', 'noise in the dark', 'light found on the rim')
    for cells in reversed(found):
        row(*cells)
    say()
    say('What is wrong with the black level is wrong at every entry, and shows on the rim and in the sums first.')


def developing():
    """Ways from camera pixels to surface points, seen by a sharp camera and by one out of focus; weights of exposures."""
    say()
    say('### Developing: demosaicing')
    say()
    say('The demo\'s station, whose camera is sharp, and the same with a camera out of focus by a disc of 2 pixels, half a point. '
        'Processor seconds are those of one development of the sharp one. Where dots and grids agree that the camera is out of focus, '
        '`auto` fits with that blur, which the other ways do not know of.')
    sharp, blurred = 'turns1-4-15-60', 'blurred'
    station = settings(blurred, window=25, grid_patterns=few, exposure_turns=[1, 4, 15, 60])
    with open(os.path.join(folder, station), encoding='utf-8') as file:
        text, count = re.subn(r'(?m)^( +)(pixels_per_point:)', r'\1defocus_px: 2\n\1\2', file.read())
    assert count == 1
    with open(os.path.join(folder, station), 'w', encoding='utf-8') as file:
        file.write(text)
    if not os.path.exists(os.path.join(folder, blurred)):
        nacre('scan', blurred, '--station', station)
    head('option', 'error, sharp', 'error, out of focus', 'processor seconds')
    for option in ('--demosaic=fit', '--demosaic=area', '--demosaic=malvar', '--demosaic=auto')[2 if quick else 0:]:
        error = develop(sharp, 25, option)[0]
        seconds = spent['develop']
        out_of_focus, _, report = develop(blurred, 25, option)
        row(f'`{option}`' + (f' (default; {chosen(report["geometry"])} where out of focus)' if option.endswith('auto') else ''),
            percent(error), percent(out_of_focus), f'{seconds:.1f}')
    say()
    say('### Developing: weights of the exposures')
    say()
    say('200,000 pixels that see the same light, in the demo\'s exposures: bias of the merged radiance, in parentheses its standard '
        'error. What is developed is weighted by the inverse of the noise of the estimate from all exposures, in the same time.')
    say()
    table = subprocess.run([programs[2]], check=True, capture_output=True, text=True).stdout
    for line in table.splitlines():
        say(line)


def chosen(geometry):
    """The way that auto took, in words."""
    blur = geometry['blur_px']
    return geometry['demosaic'] + (f' with a blur of {blur:.2f} px' if blur > 0 else '')


def factors():
    """The study of a whole scan of the demo's plan."""
    say()
    say('### Factorization')
    say()
    say('The quickest and the smallest factorization of the demo\'s scan whose error, against the scan and its noise, is at most so '
        'much: `nacre tradeoff` finds them for any scan, with their commands.')
    scan('whole', **({'grid_patterns': 150} if quick else {}))
    if not os.path.exists(os.path.join(folder, 'study/tradeoff.json')):
        nacre('develop', 'whole', '-o', 'scan.exr')
        nacre('tradeoff', 'scan.exr', '-o', 'study', '--budget', '15s' if quick else '4min')
    with open(os.path.join(folder, 'study/tradeoff.json'), encoding='utf-8') as file:
        points = json.load(file)['points']
    head('mean error at most', 'quickest', 'terms, clusters', 'against the exact', 'smallest', 'terms, clusters',
         'against the exact')
    for goal in (0.1, 0.05, 0.03, 0.02, 0.015, 0.01, 0.008, 0.006, 0.005):
        able = [point for point in points if point['error'] <= goal]
        if not able:
            break
        quickest = min(able, key=lambda point: point['seconds'])
        smallest = min(able, key=lambda point: point['bytes'])
        row(percent(goal, 1), f'{quickest["seconds"]:.2g} s', f'{quickest["terms"]}, {quickest["clusters"] or "a kernel each"}',
            against_exact(quickest), f'{smallest["bytes"] / 1024:.3g} KiB',
            f'{smallest["terms"]}, {smallest["clusters"] or "a kernel each"}', against_exact(smallest))
    say()
    say('The scan itself is about 1 % from the exact responses. A model that is nearer to the scan than that follows its noise; one '
        'that is small cannot, and may be nearer to the exact responses than the scan it was made of.')
    return points


def against_exact(point):
    """The error of a point's material against the exact responses, by the point's own command."""
    if point['command'] not in spent:
        nacre(*shlex.split(point['command'])[1:])
        told = nacre('error', exact(25)[0], 'material.exr')
        spent[point['command']] = percent(told['error']['mean'])
    return spent[point['command']]


def radiance(path):
    """Colours of all vertices of a binary PLY of floats."""
    with open(os.path.join(folder, path), 'rb') as file:
        data = file.read()
    text, _, body = data.partition(b'end_header\n')
    names = re.findall(r'property float (\w+)', text.decode('ascii'))
    count = int(re.search(rb'element vertex (\d+)', text)[1])
    values = array.array('f', body[:4 * count * len(names)])
    return [values[names.index(name)::len(names)] for name in ('red', 'green', 'blue')]


def rendering():
    say()
    say('### Rendering: light samples')
    say()
    scene = os.path.join(ROOT, 'render/examples/area.yaml')
    nacre('factor', 'scan.exr', '-o', 'material.exr', '--model', 'clusters', '--terms', '12', '--clusters', '5')
    triangles = ['--triangles', '20000'] if quick else []
    ways = [('--samples', '3'), ('--samples', '12'), ('--samples', '12', '--rays', '32'), ('--samples', '48')]
    ways = ways[:2] if quick else ways
    coarse = [('--samples', '48', '--tolerance', tolerance) for tolerance in ('2%', '0.67%', '0.05%', '1e-9')]
    coarse = coarse[:1] if quick else coarse
    best = ('--samples', '30', '--rays', '8', '--seed', '7') if quick else ('--samples', '200', '--rays', '32', '--seed', '7')
    say(f'The knot of `render/examples/area.yaml` (`nacre bake`), against `{" ".join(best[:4])}`: root mean square over vertices and '
        'channels, relative.')
    nacre('bake', '--scene', scene, '--material', 'material.exr', '-o', 'best.ply', *best, *triangles)
    reference = radiance('best.ply')
    norm = sum(value * value for plane in reference for value in plane)
    head('options', 'error', 'processor seconds')
    points = []
    for way in ways + coarse:
        nacre('bake', '--scene', scene, '--material', 'material.exr', '-o', 'some.ply', *way, *triangles)
        seconds = spent['seconds']
        square = sum((a - b) ** 2 for plane, other in zip(radiance('some.ply'), reference) for a, b in zip(plane, other))
        row(f'`{" ".join(way)}`' + (' (default)' if way == ('--samples', '12') else ''), percent(math.sqrt(square / norm)),
            f'{seconds:.1f}')
        if way in ways:
            points.append((seconds, 100 * math.sqrt(square / norm), None, way[1]))
    say()
    say('`--tolerance` is the error that summing up far light by a hierarchy may make: 0.2 % where it is not given, and in what '
        'all are compared with; 1e-9 sums up nothing. How that goes on with larger samples is told in [rendering.md](rendering.md#what-accuracy-costs).')
    return points


def trigger():
    """By the firmware's own loop: three columns of what its table tells."""
    say()
    say('### Trigger: the loop\'s gain')
    say()
    say('An exposure of one turn, index pulses early or late by up to 20 us; the firmware\'s loop on the host '
        '([trigger-board.md](trigger-board.md)).')
    table = subprocess.run([programs[1]], check=True, capture_output=True, text=True).stdout
    head('gain', 'wrong length', 'settles in')
    for line in table.splitlines()[2:]:
        cells = [cell.strip() for cell in line.strip('|').split('|')]
        row(cells[0], cells[3], cells[6])


def axis(lowest, highest):
    """Ticks of a logarithmic axis: 1, 2 and 5 times powers of ten."""
    ticks = [step * 10.0 ** power for power in range(-4, 6) for step in (1, 2, 5)]
    return [tick for tick in ticks if lowest <= tick * 1.0001 and tick <= highest * 1.0001]


def draw(left, title, label, series):
    """A panel with logarithmic axes: series of (name, colour, [(x, y, text)])."""
    every = [point for _, _, points in series for point in points]
    xs, ys = [point[0] for point in every], [point[1] for point in every]
    low_x, high_x, low_y, high_y = min(xs) / 1.4, max(xs) * 1.6, min(ys) / 1.3, max(ys) * 1.3
    across = lambda x: left + 46 + 200 * math.log(x / low_x) / math.log(high_x / low_x)
    down = lambda y: 226 - 180 * math.log(y / low_y) / math.log(high_y / low_y)
    out = [f'<text x="{left + 46}" y="20" font-weight="bold">{title}</text>']
    for tick in axis(low_y, high_y):
        out.append(f'<path d="M{left + 46} {down(tick):.1f}h200" stroke="#ddd"/><text x="{left + 42}" y="{down(tick) + 4:.1f}" '
                   f'text-anchor="end">{tick:g}</text>')
    ticks = axis(low_x, high_x)
    for tick in ticks[::1 + len(ticks) // 6]:
        out.append(f'<text x="{across(tick):.1f}" y="242" text-anchor="middle">{tick:g}</text>')
    out.append(f'<path d="M{left + 46} 226h200" stroke="#888"/><text x="{left + 146}" y="258" text-anchor="middle">{label}</text>')
    for index, (name, colour, points) in enumerate(series):
        for x, y, text in points:
            out.append(f'<circle cx="{across(x):.1f}" cy="{down(y):.1f}" r="{3 if text else 1.6}" fill="{colour}"/>')
            out.append(f'<text x="{across(x) + 5:.1f}" y="{down(y) - 4:.1f}" font-size="9">{text}</text>' if text else '')
        if name:
            out.append(f'<circle cx="{left + 150}" cy="{34 + 14 * index}" r="3" fill="{colour}"/>'
                       f'<text x="{left + 157}" y="{38 + 14 * index}">{name}</text>')
    return '\n'.join(out)


def picture(grid_points, study_points, render_points):
    """Error in percent against what is paid, for three stages."""
    colours = {'terms': '#1a5e8c', 'clusters': '#d9772b'}
    panels = [draw(0, 'Scanning: grid spacing, error %', 'minutes of the station',
                   [('error', '#1a5e8c', [(point[0], point[1], point[3]) for point in grid_points]),
                    ('light beyond', '#d9772b', [(point[0], point[2], '') for point in grid_points])]),
              draw(270, 'Factoring: mean error %', 'seconds',
                   [(model if model == 'clusters' else 'kernel a term', colour,
                     [(point['seconds'], 100 * point['error'], '') for point in study_points if point['model'] == model])
                    for model, colour in colours.items() if any(point['model'] == model for point in study_points)]),
              draw(540, 'Rendering: samples, error %', 'processor seconds',
                   [('', '#1a5e8c', [(point[0], point[1], point[3]) for point in render_points])])]
    body = '\n'.join(panels)
    return ('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 800 268" font-family="sans-serif" font-size="11">\n'
            f'<rect width="100%" height="100%" fill="white"/>\n{body}\n</svg>\n')


def write(drawing):
    """Put what was said between the marks of the document, and the plots beside it."""
    with open(PICTURE, 'w', encoding='utf-8') as file:
        file.write(drawing)
    marks = re.compile(r'(<!-- begin tradeoffs -->\n).*?(<!-- end tradeoffs -->\n)', re.DOTALL)
    with open(DOCUMENT, encoding='utf-8') as file:
        text = file.read()
    with open(DOCUMENT, 'w', encoding='utf-8') as file:
        file.write(marks.sub(lambda found: found[1] + '\n'.join(lines) + '\n' + found[2], text))


def main():
    grid_points = grids()
    exposures()
    black_frames()
    developing()
    trigger()
    study_points = factors()
    render_points = rendering()
    drawing = picture(grid_points, study_points, render_points)
    if '--write' in sys.argv:
        write(drawing)


names = [argument for argument in sys.argv[1:] if not argument.startswith('--')]
quick = '--quick' in sys.argv
few = 12 if quick else 120
if len(names) < 3:
    sys.exit(__doc__)
programs = [os.path.abspath(name) for name in names[:3]]
program = programs[0]
if len(names) > 3:
    folder = os.path.abspath(names[3])
    os.makedirs(folder, exist_ok=True)
    main()
else:
    with tempfile.TemporaryDirectory() as folder:
        main()
