#!/usr/bin/env python3
"""Puts what a program prints between the two marks of a document, or with --check says whether it stands there.

usage: doc_table.py DOCUMENT PROGRAM [ARGUMENT...] [--check]; the marks are lines <!-- begin NAME --> and <!-- end NAME -->, where NAME
is the program's."""
import os
import re
import subprocess
import sys

document, program, *rest = sys.argv[1:]
name = re.escape(os.path.basename(program))
table = subprocess.run([program, *(a for a in rest if a != '--check')], capture_output=True, text=True, check=True).stdout
with open(document, encoding='utf-8') as file:
    text = file.read()
marks = re.compile(rf'(<!-- begin {name} -->\n).*?(<!-- end {name} -->\n)', re.DOTALL)
if not marks.search(text):
    sys.exit(f'{document} has no marks for {os.path.basename(program)}')
wanted = marks.sub(lambda found: found[1] + table + found[2], text)
if '--check' in rest:
    right = wanted == text
    print(f'{os.path.basename(document)}:1:holds_what_{os.path.basename(program)}_prints:' +
          ('PASS' if right else 'FAIL: run its target that writes the table'))
    print(f'1 Tests {int(not right)} Failures 0 Ignored')
    sys.exit(0 if right else 1)
if wanted != text:
    with open(document, 'w', encoding='utf-8') as file:
        file.write(wanted)
