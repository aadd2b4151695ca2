#!/usr/bin/env python3
"""Runs table1.py on the smallest stand-in, interrupts it and lets it go on; totals as Unity's."""
import json
import os
import signal
import subprocess
import sys
import tempfile
import time

SCRIPT = os.path.join(os.path.dirname(os.path.abspath(__file__)), 'table1.py')
# So many iterations that they have not ended when the first checkpoint is there.
ARGUMENTS = ['--small', '--samples', 'marble-close', '--iterations', '2000', '--checkpoint-every', '0.2s']
CHECKPOINT = 'marble-close/paper.checkpoint'
failures = 0


def check(name, holds):
    global failures
    failures += not holds
    print(f'{SCRIPT}:1:{name}:{"PASS" if holds else "FAIL"}', flush=True)


def start(*arguments):
    return subprocess.Popen([SCRIPT, program, folder, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def interrupt():
    """Stop it in the paper's method: its exit status."""
    child = start(*ARGUMENTS)
    while child.poll() is None and not os.path.exists(os.path.join(folder, CHECKPOINT)):
        time.sleep(0.02)
    child.send_signal(signal.SIGTERM)
    child.communicate()
    return child.returncode


def load(name):
    with open(os.path.join(folder, 'marble-close', name), encoding='utf-8') as file:
        return json.load(file)


def check_scanned():
    """The way through scan and develop. A response is much wider than its window of 9 x 9, and what falls beyond the grids'
    spacing of 18 is foreign light, evenly over the 18 x 18 points of others: a quarter of it is in their windows, its norm there
    a ninth of that. That of a response is no less than a ninth of what it has in its window. So the error is at most a quarter
    of the share beyond the spacing over the share in the window, and 2 % of noise and developing."""
    child = start(*ARGUMENTS, '--scanned', 'marble-close')
    table = child.communicate()[0]
    sample = os.path.join(os.path.dirname(os.path.dirname(SCRIPT)), 'rig/samples/table1/marble-close-small.yaml')
    told = subprocess.run([program, 'simulate', sample, '-o', os.path.join(folder, 'wide.exr'), '--window', '17', '--json', '--quiet'],
                          stdout=subprocess.PIPE, check=True)
    error = load('../marble-close-scanned/scan-error.json')['result']['mean']
    foreign = json.loads(told.stdout)['outside_mean'] / 4 / (1 - load('scan.json')['result']['outside_mean'])
    check('scanned_responses_are_the_exact_and_neighbours_light', 0 < error < foreign + 0.02)
    rows = [line for line in table.splitlines() if line.startswith('| Marble, close up')]
    check('the_scanned_row_stands_beside_the_computed', child.returncode == 0 and len(rows) == 4 and 'computed' in rows[2]
          and 'scanned' in rows[3] and f'| {error:.4f} |' in rows[3])


def main():
    status = interrupt()
    stopped = load('paper.json')
    check('what_is_stopped_leaves_a_checkpoint',
          status == 128 + signal.SIGTERM and os.path.exists(os.path.join(folder, CHECKPOINT)))
    child = start(*ARGUMENTS)
    table, log = child.communicate()
    paper = load('paper.json')
    check('processor_time_adds_up', 0 < stopped['processor_seconds'] < paper['processor_seconds'])
    paper = paper['result']
    check('it_goes_on_from_there', child.returncode == 0 and 'simulate' not in log and paper['continued'])
    check('all_iterations_are_the_papers', paper['method'].startswith('mu') and paper['iterations'] == 2000
          and paper['stored'] == 'float')
    rows = [line for line in table.splitlines() if line.startswith('| Marble, close up')]
    check('both_tables_have_a_row', len(rows) == 2 and '0.006/0.013/0.056' in rows[0] and '32 x 32' in rows[0])
    check('a_kernel_for_each_term_is_more_exact_in_fewer_bytes', rows[1].endswith('| yes |'))
    child = start(*ARGUMENTS)
    again, log = child.communicate()
    check('nothing_is_done_twice', child.returncode == 0 and log == '' and again == table)
    check_scanned()
    child = start('--samples', 'butter')
    log = child.communicate()[1]
    check('an_unknown_sample_is_refused', child.returncode == 1 and 'butter' in log)


program = os.path.abspath(sys.argv[1])
with tempfile.TemporaryDirectory() as folder:
    main()
print(f'\n10 Tests {failures} Failures 0 Ignored ')
sys.exit(1 if failures else 0)
