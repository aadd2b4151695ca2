#!/usr/bin/env python3
"""Reproduces Table 1 of Peers et al. 2006 on stand-ins for its eight samples, of its sizes, and prints it beside the
paper's: responses are computed (nacre simulate), factored by the paper's method (hard clusters, multiplicative updates,
floats) and with a kernel for each term.

usage: table1.py NACRE FOLDER [--small] [--show] [--samples NAME,...] [--scanned NAME,...] [--write] [--iterations N]
       [--checkpoint-every TIME] [--device NAME]

--small takes stand-ins a quarter as wide. --scanned tells of those samples, too, what comes of responses that are measured:
on the virtual station of the candle (nacre scan, nacre develop), beside the ones computed. --show prints what is there and
computes nothing; --write puts the tables into docs/accuracy.md. All of it takes hours; whatever was finished is kept, and
the paper's method goes on from its checkpoint, when the command is given again.
"""
import argparse
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))

# The paper's rows: points, K, terms, clusters, sizes as printed, min/avg/max relative error.
ROWS = {
    'candle': ('Candle', (212, 154), 49, 12, 100, '898 Mb', '13 Mb', '1/69', '0.002/0.031/0.050'),
    'marble-4x4': ('Marble 4 x 4', (277, 277), 39, 20, 100, '1.4 Gb', '39 Mb', '1/37', '0.003/0.010/0.060'),
    'marble-8x8': ('Marble 8 x 8', (222, 222), 39, 8, 10, '859 Mb', '12 Mb', '1/72', '0.003/0.019/0.094'),
    'onyx-lines': ('White onyx', (229, 229), 39, 20, 10, '914 Mb', '26 Mb', '1/35', '0.004/0.017/0.100'),
    'crystal-onyx': ('Crystal onyx', (270, 260), 45, 12, 5, '1.6 Gb', '22 Mb', '1/74', '0.011/0.040/0.560'),
    'marble-close': ('Marble, close up', (128, 128), 39, 16, 1, '286 Mb', '6.6 Mb', '1/43', '0.006/0.013/0.056'),
    'marble-dense': ('Densely veined', (213, 211), 29, 8, 10, '433 Mb', '9.9 Mb', '1/44', '0.003/0.096/0.163'),
    'marble-slight': ('Slightly veined', (207, 207), 29, 20, 1, '413 Mb', '21.0 Mb', '1/19', '0.001/0.005/0.024'),
}
# What takes least comes first.
ORDER = ['marble-close', 'marble-dense', 'marble-slight', 'marble-8x8', 'candle', 'onyx-lines', 'crystal-onyx', 'marble-4x4']
DOCUMENT = os.path.join(ROOT, 'docs/accuracy.md')
# What --scanned scans by: its grids are put as far apart as the window is wide, or twice that where more light than this falls
# outside of it, and would fall into the windows of neighbours.
OUTSIDE = 0.01
STATION = os.path.join(ROOT, 'tests/bench/candle/station.yaml')
PLAN = os.path.join(ROOT, 'tests/bench/candle/plan.yaml')
# Terms with a kernel each that are tried, until the error is below the paper's method's.
LADDER = [8, 16, 24, 32]
running = {'child': None, 'stopped_by': 0}


def stop(number, _frame):
    """Let nacre write its checkpoint."""
    running['stopped_by'] = number
    if running['child']:
        running['child'].send_signal(signal.SIGINT)


def load(path):
    try:
        with open(path, encoding='utf-8') as file:
            return json.load(file)
    except (OSError, ValueError):
        return {}


def store(path, value):
    with open(path + '.new', 'w', encoding='utf-8') as file:
        json.dump(value, file, indent=1)
    os.replace(path + '.new', path)


def run(folder, name, key, *arguments):
    """What a nacre command says, as JSON; one that was run before, of the same key, is not run again. Its processor time
    is that of all attempts."""
    path = os.path.join(folder, name + '.json')
    known = load(path)
    if known.get('key') == key and 'result' in known:
        return known
    spent = known.get('processor_seconds', 0) if known.get('key') == key else 0
    if options.show:
        return {}
    if running['stopped_by']:
        sys.exit(128 + running['stopped_by'])
    print(f'$ nacre {" ".join(arguments)}', file=sys.stderr, flush=True)
    child = subprocess.Popen([program, *arguments, '--quiet', '--json', *device], cwd=folder, text=True,
                             stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    running['child'] = child
    # Nothing is printed before the end but a few lines, which pipes hold.
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    running['child'] = None
    record = {'key': key, 'processor_seconds': spent + usage.ru_utime + usage.ru_stime}
    if child.returncode == 0:
        record['result'] = json.loads(child.stdout.read())
    store(path, record)
    if running['stopped_by']:
        sys.exit(128 + running['stopped_by'])
    if child.returncode != 0:
        sys.exit(f'table1: nacre {arguments[0]} failed: {child.stderr.read().strip()}')
    return record


def sample_of(name):
    """The sample file, K, terms and clusters."""
    _, _, window, terms, clusters = ROWS[name][:5]
    path = os.path.join(ROOT, 'rig/samples/table1', name + ('-small' if options.small else '') + '.yaml')
    return path, window // 4 | 1 if options.small else window, terms, clusters


def changed(path, output, changes):
    """A copy of a settings file in which patterns are replaced, each where it is found once."""
    with open(path, encoding='utf-8') as file:
        text = file.read()
    for pattern, value in changes:
        text, count = re.subn(pattern, value, text)
        assert count == 1, pattern
    with open(output, 'w', encoding='utf-8') as file:
        file.write(text)
    return text


def write_station(folder, path, exact):
    """A station with this sample and as many camera pixels a point as the candle's; what tells it from others."""
    width, height, window = (exact[key] for key in ('width', 'height', 'window'))
    spacing = window if exact['outside_mean'] < OUTSIDE else 2 * window
    wide, high = (round(4 * points * 1.038 / 8) * 8 for points in (width, height))
    station = changed(STATION, os.path.join(folder, 'station.yaml'),
                      [(r'(?m)^sample: .*', f'sample: {{width: {width}, height: {height}, pitch_mm: {exact["pitch_mm"]:g}}}'),
                       (r'width: 880, height: 640', f'width: {wide}, height: {high}'), (r'(?m)^  sample: .*', f'  sample: {path}')])
    plan = changed(PLAN, os.path.join(folder, 'plan.yaml'),
                   [(r'(?m)^grid_spacing: .*', f'grid_spacing: {spacing}'), (r'(?m)^window: .*', f'window: {window}')])
    return hashlib.sha256((station.replace(path, '') + plan).encode()).hexdigest()[:16]


def measure(name):
    """All steps of one sample with responses computed, as far as they have been made."""
    path, window, _, _ = sample_of(name)
    folder = os.path.join(options.folder, name)
    os.makedirs(folder, exist_ok=True)
    sample = digest(path)
    made = {'scan': run(folder, 'scan', f'{sample} {window}', 'simulate', path, '-o', 'scan.exr', '--window', str(window))}
    made['paper'] = factor_as_paper(name, folder, f'{sample} {window}') if made['scan'] else {}
    for count in LADDER if made['paper'] else []:
        made['ours'] = factor_by_terms(folder, f'{sample} {window}', count)
        if not made['ours'] or is_better(made):
            break
    return made


def measure_scanned(name, exact):
    """The same with responses that were scanned and developed; all are compared with the exact, too."""
    path = sample_of(name)[0]
    folder = os.path.join(options.folder, name + '-scanned')
    os.makedirs(folder, exist_ok=True)
    key = f'{digest(path)} {write_station(folder, path, exact["scan"]["result"])}'
    if not options.show and load(os.path.join(folder, 'session.json')).get('key', key) != key:
        # Of another sample or station: what was begun must not go on as if it were of this one.
        shutil.rmtree(os.path.join(folder, 'session'), ignore_errors=True)
        if os.path.exists(os.path.join(folder, 'scan.exr.work')):
            os.remove(os.path.join(folder, 'scan.exr.work'))
    begun = os.path.exists(os.path.join(folder, 'session/session.yaml'))
    made = {'session': run(folder, 'session', key, 'scan', 'session', *(['--resume'] if begun else ['--station', 'station.yaml']))}
    if not made['session']:
        return made
    begun = os.path.exists(os.path.join(folder, 'scan.exr.work'))
    made['scan'] = run(folder, 'scan', key, 'develop', 'session', '-o', 'scan.exr', *(['--resume'] if begun else []))
    if not made['scan']:
        return made
    made['scan error'] = compare(folder, key, name, 'scan')
    made['paper'] = factor_as_paper(name, folder, key)
    if made['paper']:
        made['paper error'] = compare(folder, f'{key} {options.iterations}', name, 'paper')
    # More parameters come nearer to the scan's noise, too; who is better is told by the exact responses.
    for count in LADDER:
        made['ours'] = factor_by_terms(folder, key, count)
        if made['ours']:
            made['ours error'] = compare(folder, key, name, f'terms-{count}')
        if not is_complete(made) or is_better(made):
            break
    return made


def compare(folder, key, name, output):
    return run(folder, f'{output}-error', key, 'error', f'../{name}/scan.exr', f'{output}.exr')


def digest(path):
    with open(path, 'rb') as file:
        return hashlib.sha256(file.read()).hexdigest()[:16]


def factor_as_paper(name, folder, sample):
    _, _, terms, clusters = sample_of(name)
    scan, checkpoint = (os.path.join(folder, file) for file in ('scan.exr', 'paper.checkpoint'))
    if not options.show and os.path.exists(checkpoint) and os.path.getmtime(checkpoint) < os.path.getmtime(scan):
        os.remove(checkpoint)  # of responses that were there before these
    return run(folder, 'paper', f'{sample} {options.iterations} {terms} {clusters}', 'factor', 'scan.exr', '-o', 'paper.exr',
               '--model', 'clusters', '--method', 'mu', '--terms', str(terms), '--clusters', str(clusters), '--iterations',
               str(options.iterations), '--tolerance', '0', '--store', 'float', '--checkpoint', 'paper.checkpoint',
               '--checkpoint-every', options.checkpoint_every)


def factor_by_terms(folder, sample, count):
    return run(folder, f'terms-{count}', f'{sample} {count} to its own end', 'factor', 'scan.exr', '-o', f'terms-{count}.exr',
               '--model', 'terms', '--terms', str(count))


def is_complete(made):
    """Whether both ways were gone, to the end: --show may find a material that was not compared."""
    return all(made.get(way) and made.get(way + ' error', made[way]) for way in ('ours', 'paper'))


def is_better(made):
    """Whether a kernel a term has a lower error than the paper's method, against the exact responses, in fewer bytes."""
    ours, paper = (mean_error(made, way) for way in ('ours', 'paper'))
    return ours < paper and made['ours']['result']['bytes_factored'] <= made['paper']['result']['bytes_factored']


def mean_error(made, way):
    """Against the exact: those that were factored, unless they were scanned."""
    return made.get(way + ' error', made[way])['result']['error']['mean']


def size(count):
    return f'{count / 2**30:.3g} GiB' if count >= 1000 * 2**20 else f'{count / 2**20:.3g} MiB'


def errors(error):
    return '/'.join(f'{error[key]:.4f}' for key in ('min', 'mean', 'max'))


def cells(made):
    """A factorization: terms, size, ratio, errors, seconds; empty where it has not been made."""
    if not made:
        return ['', '', '', '', '']
    result = made['result']
    return [str(result['terms']), size(result['bytes_factored']), f'1/{result["ratio"]:.0f}', errors(result['error']),
            f'{made["processor_seconds"]:.0f}']


def table(results, scanned):
    """Tables in Markdown: sizes and errors beside the paper's, what a kernel for each term makes of it, and what scanning does."""
    lines = ['| sample | points | K | terms | clusters | responses: paper | ours | factored: paper | ours | ratio: paper | ours |'
             ' error: paper, its scan | ours, paper\'s method on the stand-in |', '| --- ' * 13 + '|']
    for name, made in results.items():
        title, points, window, terms, clusters, original, factored, ratio, error = ROWS[name]
        result = made.get('paper', {}).get('result')
        if options.small and result:
            points, window = (made['scan']['result']['width'], made['scan']['result']['height']), made['scan']['result']['window']
        ours = [size(result['bytes_measured']), size(result['bytes_factored']), f'1/{result["ratio"]:.0f}',
                errors(result['error'])] if result else ['not run'] * 4
        lines.append(f'| {title} | {points[0]} x {points[1]} | {window} | {terms} | {clusters} | {original} | {ours[0]} | '
                     f'{factored} | {ours[1]} | {ratio} | {ours[2]} | {error} | {ours[3]} |')
    lines += ['', '| sample | simulated, s | paper\'s method: size | error min/avg/max | s | a kernel a term: terms | size | ratio |'
              ' error min/avg/max | s | lower error in fewer bytes |', '| --- ' * 11 + '|']
    for name, made in results.items():
        if made.get('paper'):
            paper, ours = cells(made['paper']), cells(made.get('ours'))
            verdict = '' if not made.get('ours') else 'yes' if is_better(made) else 'no'
            lines.append(f'| {ROWS[name][0]} | {made["scan"]["processor_seconds"]:.0f} | {paper[1]} | {paper[3]} | {paper[4]} | '
                         f'{ours[0]} | {ours[1]} | {ours[2]} | {ours[3]} | {ours[4]} | {verdict} |')
    if scanned:
        lines += scanned_table(results, scanned)
    return '\n'.join(lines) + '\n'


def scanned_table(results, scanned):
    """Measured responses beside computed ones, and what is made of both."""
    lines = ['', '| sample | responses | error against the exact | s | paper\'s method: error min/avg/max | against the exact | s |'
             ' a kernel a term: terms | size | error min/avg/max | against the exact | s |', '| --- ' * 12 + '|']
    for name, made in scanned.items():
        for title, way in (('computed', results[name]), ('scanned, developed', made)):
            if way.get('scan'):
                seconds = way['scan']['processor_seconds'] + way.get('session', {}).get('processor_seconds', 0)
                paper, ours = cells(way.get('paper')), cells(way.get('ours'))
                lines.append(f'| {ROWS[name][0]} | {title} | {against_exact(way, "scan")} | {seconds:.0f} | {paper[3] or "not run"} | '
                             f'{against_exact(way, "paper")} | {paper[4]} | {ours[0]} | {ours[1]} | {ours[3]} | '
                             f'{against_exact(way, "ours")} | {ours[4]} |')
    return lines


def against_exact(made, which):
    """The mean error of a scan or a material against computed responses, where it was told."""
    told = made.get(which + ' error', {}).get('result')
    return f'{told.get("error", told)["mean"]:.4f}' if told else ''


def write(text):
    """Put the tables between the marks of the document."""
    marks = re.compile(r'(<!-- begin table1 -->\n).*?(<!-- end table1 -->\n)', re.DOTALL)
    with open(DOCUMENT, encoding='utf-8') as file:
        before = file.read()
    with open(DOCUMENT, 'w', encoding='utf-8') as file:
        file.write(marks.sub(lambda found: found[1] + text + found[2], before))


def main():
    names = options.samples.split(',') if options.samples else ORDER
    to_scan = options.scanned.split(',') if options.scanned else []
    unknown = [name for name in names + to_scan if name not in ROWS]
    if unknown:
        sys.exit(f'table1: no sample is called {unknown[0]}; there are {", ".join(ROWS)}')
    os.makedirs(options.folder, exist_ok=True)
    results, scanned = {}, {}
    for name in names + [name for name in to_scan if name not in names]:
        results[name] = measure(name)
        if name in to_scan and results[name].get('ours'):
            scanned[name] = measure_scanned(name, results[name])
        text = table({name: results[name] for name in ROWS if name in results}, scanned)
        if not options.show:
            with open(os.path.join(options.folder, 'table1.md'), 'w', encoding='utf-8') as file:
                file.write(text)
    print(text, end='')
    if options.write:
        write(text)
    done = [made for made in [*results.values(), *scanned.values()] if is_complete(made)]
    return 1 if any(not is_better(made) for made in done) else 0


parser = argparse.ArgumentParser(usage=__doc__[__doc__.index('table1.py NACRE'):].split('\n')[0], description=__doc__)
parser.add_argument('nacre')
parser.add_argument('folder')
parser.add_argument('--small', action='store_true')
parser.add_argument('--show', action='store_true')
parser.add_argument('--samples')
parser.add_argument('--scanned')
parser.add_argument('--write', action='store_true')
parser.add_argument('--iterations', type=int, default=1000)
parser.add_argument('--checkpoint-every', default='1min')
parser.add_argument('--device')
options = parser.parse_args()
program = os.path.abspath(options.nacre)
options.folder = os.path.abspath(options.folder)
device = ['--device', options.device] if options.device else []
signal.signal(signal.SIGTERM, stop)
signal.signal(signal.SIGINT, stop)
sys.exit(main())
