#!/usr/bin/env python3
"""Adds up Unity's test cases over meson's logs and ends with one line: N passed, N failed, N skipped."""
import json
import os
import re
import sys

TOTALS = re.compile(r'^(\d+) Tests (\d+) Failures (\d+) Ignored', re.MULTILINE)
PASSED = re.compile(r'^(?:.*/)?[^/:\n]+:\d+:\w+:PASS$', re.MULTILINE)
FAILED = re.compile(r'^(?:.*/)?([^/:\n]+):(\d+):(\w+):FAIL(?:: ?(.*))?$', re.MULTILINE)
IGNORED = re.compile(r'^(?:.*/)?([^/:\n]+):\d+:(\w+):IGNORE(?:: ?(.*))?$', re.MULTILINE)
# In continuous integration only hardware that cannot exist there may be missing.
ALLOWED = 'hardware:'


def count(program):
    """The cases that passed, and lines that name the failed and the skipped ones, of one entry of testlog.json."""
    name, output = program['name'], program.get('stdout', '')
    failed = [f'{name}: {case} ({file}:{line}): {why or "no reason given"}'
              for file, line, case, why in FAILED.findall(output)]
    skipped = [(f'{name}: {case}', why or 'no reason given') for _, case, why in IGNORED.findall(output)]
    totals = TOTALS.findall(output)
    # A program that dies does not come to its totals.
    passed = sum(int(t) - int(f) - int(i) for t, f, i in totals) if totals else len(PASSED.findall(output))
    if program['result'] == 'SKIP':
        last = output.strip().splitlines()[-1:] or ['no reason given']
        skipped.append((name, last[0]))
    elif program['result'] != 'OK' and not failed:
        failed.append(f'{name}: {program["result"].lower()}, exit status {program.get("returncode")}')
    elif program['result'] == 'OK' and passed + len(skipped) == 0:
        failed.append(f'{name}: ran no test')
    return passed, failed, skipped


def main(logs):
    passed, failed, skipped, parts = 0, [], [], []
    for log in logs:
        try:
            with open(log, encoding='utf-8') as file:
                programs = [json.loads(line) for line in file]
        except OSError as error:
            programs = []
            failed.append(f'{log}: {error.strerror}')
        folder, before = log.split('/')[0], passed
        for program in programs:
            more = count(program)
            passed += more[0]
            failed += [f'{folder}: {line}' for line in more[1]]
            skipped += more[2]
        parts.append(f'{folder}: {len(programs)} programs, {passed - before} tests passed')
    print('\n' + '\n'.join(parts))
    for name, why in skipped:
        print(f'skipped: {name}: {why}')
    for line in failed:
        print(f'failed: {line}')
    refused = [name for name, why in skipped if os.environ.get('CI') and not why.startswith(ALLOWED)]
    for name in refused:
        print(f'not allowed in CI: skipping {name} (only a reason that begins with "{ALLOWED}" is)')
    print(f'{passed} passed, {len(failed)} failed, {len(skipped)} skipped')
    return 1 if failed or refused or passed == 0 else 0


sys.exit(main(sys.argv[1:]))
