#!/usr/bin/env python3
"""Checks that the tests' summary counts what ran, and takes no crash or skip for a success; totals as Unity's."""
import json
import os
import subprocess
import sys
import tempfile

SUMMARY = os.path.join(os.path.dirname(os.path.abspath(__file__)), 'summary.py')
GOOD = '../t.c:5:adds_up:PASS\n../t.c:6:takes_away:PASS\n\n-----\n2 Tests 0 Failures 0 Ignored \nOK\n'
BAD = '../t.c:5:adds_up:PASS\n../t.c:6:takes_away:FAIL: Expected 1 Was 2\n\n-----\n2 Tests 1 Failures 0 Ignored \nFAIL\n'
LACKS = '../t.c:5:adds_up:PASS\n../t.c:6:drives_it:IGNORE: {}\n\n-----\n2 Tests 0 Failures 1 Ignored \nOK\n'

# What it is about, meson's results and outputs, in CI or not, the last line, the exit status.
CASES = [
    ('good_programs_add_up', [('OK', GOOD), ('OK', GOOD)], True, '4 passed, 0 failed, 0 skipped', 0),
    ('failures_fail', [('OK', GOOD), ('FAIL', BAD)], False, '3 passed, 1 failed, 0 skipped', 1),
    ('a_crash_counts_as_failure', [('FAIL', '../t.c:5:adds_up:PASS\n')], False, '1 passed, 1 failed, 0 skipped', 1),
    ('a_leak_after_good_tests_fails', [('FAIL', GOOD)], False, '2 passed, 1 failed, 0 skipped', 1),
    ('a_timeout_fails', [('TIMEOUT', '')], False, '0 passed, 1 failed, 0 skipped', 1),
    ('a_program_without_tests_fails', [('OK', ''), ('OK', GOOD)], False, '2 passed, 1 failed, 0 skipped', 1),
    ('no_programs_at_all_fail', [], False, '0 passed, 0 failed, 0 skipped', 1),
    ('skips_are_counted', [('OK', LACKS.format('no printer'))], False, '1 passed, 0 failed, 1 skipped', 0),
    ('ci_refuses_skips', [('OK', LACKS.format('no printer'))], True, '1 passed, 0 failed, 1 skipped', 1),
    ('ci_allows_missing_hardware', [('OK', LACKS.format('hardware: a wheel'))], True, '1 passed, 0 failed, 1 skipped', 0),
    ('exit_status_77_is_a_skip', [('SKIP', 'no clang\n'), ('OK', GOOD)], False, '2 passed, 0 failed, 1 skipped', 0),
]


def run(results, in_ci):
    environment = {key: value for key, value in os.environ.items() if key != 'CI'}
    if in_ci:
        environment['CI'] = 'true'
    with tempfile.TemporaryDirectory() as folder:
        log = os.path.join(folder, 'testlog.json')
        with open(log, 'w', encoding='utf-8') as file:
            for result, output in results:
                file.write(json.dumps({'name': 'p', 'result': result, 'stdout': output, 'returncode': 0}) + '\n')
        return subprocess.run([SUMMARY, log], env=environment, capture_output=True, text=True)


wrong = 0
for name, results, in_ci, last, status in CASES:
    got = run(results, in_ci)
    lines = got.stdout.splitlines() or ['']
    good = lines[-1] == last and got.returncode == status
    print(f'check_summary.py:1:{name}:' + ('PASS' if good else f'FAIL: {lines[-1]}, exit status {got.returncode}'))
    wrong += not good
print(f'{len(CASES)} Tests {wrong} Failures 0 Ignored')
sys.exit(1 if wrong else 0)
