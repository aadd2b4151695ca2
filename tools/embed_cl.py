#!/usr/bin/env python3
"""Turns an OpenCL source into a C source that holds it, with a #line so that messages name file and line."""
import json
import os
import sys

source, output = sys.argv[1:3]
name = os.path.basename(source)
symbol = name.replace('.', '_')
with open(source, encoding='utf-8') as file:
    lines = file.read().splitlines()
text = [json.dumps(line + '\n') for line in [f'#line 1 "{name}"'] + lines]
with open(output, 'w', encoding='utf-8') as file:
    file.write('#include "base/opencl.h"\n')
    # Several literals: C17 promises only 4095 characters in one, and an array initialiser has no such limit.
    file.write('static const char *const lines[] = {\n')
    file.write(''.join(f'    {line},\n' for line in text))
    file.write('};\n')
    file.write(f'const struct opencl_source {symbol} = {{"{name}", lines, sizeof lines / sizeof lines[0]}};\n')
