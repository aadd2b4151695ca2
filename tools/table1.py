#!/usr/bin/env python3
"""Reproduces Table 1 of Peers et al. 2006 on stand-ins for its eight samples, of its sizes, and prints it beside the
paper's: responses are computed (nacre simulate), factored by the paper's method (hard clusters, multiplicative updates,
floats) and with a kernel for each term.

usage: table1.py NACRE FOLDER [--small] [--show] [--samples NAME,...] [--iterations N] [--checkpoint-every TIME] [--device NAME]

--small takes stand-ins a quarter as wide. --show prints what is there and computes nothing. All of it takes hours;
whatever was finished is kept, and the paper's method goes on from its checkpoint, when the command is given again.
"""
import argparse
import hashlib
import json
import os
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


def measure(name):
    """All steps of one sample, as far as they have been made."""
    path, window, terms, clusters = sample_of(name)
    folder = os.path.join(options.folder, name)
    os.makedirs(folder, exist_ok=True)
    with open(path, 'rb') as file:
        sample = hashlib.sha256(file.read()).hexdigest()[:16]
    made = {'scan': run(folder, 'scan', f'{sample} {window}', 'simulate', path, '-o', 'scan.exr', '--window', str(window))}
    if not made['scan']:
        return made
    key = f'{sample} {window} {options.iterations}'
    made['paper'] = run(folder, 'paper', f'{key} {terms} {clusters}', 'factor', 'scan.exr', '-o', 'paper.exr', '--model', 'clusters',
                        '--method', 'mu', '--terms', str(terms), '--clusters', str(clusters), '--iterations', str(options.iterations),
                        '--tolerance', '0', '--store', 'float', '--checkpoint', 'paper.checkpoint', '--checkpoint-every', options.checkpoint_every)
    if not made['paper']:
        return made
    for count in LADDER:
        made['ours'] = run(folder, f'terms-{count}', f'{sample} {window} {count}', 'factor', 'scan.exr', '-o',
                           f'terms-{count}.exr', '--model', 'terms', '--terms', str(count), '--iterations', '200')
        if not made['ours'] or is_better(made):
            return made
    return made


def is_better(made):
    ours, paper = made['ours']['result'], made['paper']['result']
    return ours['error']['mean'] < paper['error']['mean'] and ours['bytes_factored'] <= paper['bytes_factored']


def size(count):
    return f'{count / 2**20:.3g} MiB'


def errors(error):
    return '/'.join(f'{error[key]:.4f}' for key in ('min', 'mean', 'max'))


def cells(made):
    """A factorization: terms, size, ratio, errors, seconds; empty where it has not been made."""
    if not made:
        return ['', '', '', '', '']
    result = made['result']
    return [str(result['terms']), size(result['bytes_factored']), f'1/{result["ratio"]:.0f}', errors(result['error']),
            f'{made["processor_seconds"]:.0f}']


def table(results):
    """Two tables in Markdown: sizes and errors beside the paper's, and what a kernel for each term makes of it."""
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
    return '\n'.join(lines) + '\n'


def main():
    names = options.samples.split(',') if options.samples else ORDER
    unknown = [name for name in names if name not in ROWS]
    if unknown:
        sys.exit(f'table1: no sample is called {unknown[0]}; there are {", ".join(ROWS)}')
    os.makedirs(options.folder, exist_ok=True)
    results = {}
    for name in names:
        results[name] = measure(name)
        text = table({name: results[name] for name in ROWS if name in results})
        if not options.show:
            with open(os.path.join(options.folder, 'table1.md'), 'w', encoding='utf-8') as file:
                file.write(text)
    print(text, end='')
    done = [made for made in results.values() if made.get('ours')]
    return 1 if any(not is_better(made) for made in done) else 0


parser = argparse.ArgumentParser(usage=__doc__[__doc__.index('table1.py NACRE'):].split('\n')[0], description=__doc__)
parser.add_argument('nacre')
parser.add_argument('folder')
parser.add_argument('--small', action='store_true')
parser.add_argument('--show', action='store_true')
parser.add_argument('--samples')
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
