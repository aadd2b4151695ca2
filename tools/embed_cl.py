#!/usr/bin/env python3
"""Turns an OpenCL source into a C source that holds it, with #lines so that messages name file and line. A line
`#include "NAME.cl"` is replaced by that file from the same folder."""
import json
import os
import re
import sys

source, output, depfile = sys.argv[1:4]
used = []


def read(path):
    used.append(path)
    name = os.path.basename(path)
    yield f'#line 1 "{name}"'
    with open(path, encoding='utf-8') as file:
        for number, line in enumerate(file.read().splitlines(), 1):
            include = re.fullmatch(r'#include "(\w+\.cl)"', line)
            if include:
                yield from read(os.path.join(os.path.dirname(path), include[1]))
                yield f'#line {number + 1} "{name}"'
            else:
                yield line


text = [json.dumps(line + '\n') for line in read(source)]
name = os.path.basename(source)
symbol = name.replace('.', '_')
with open(output, 'w', encoding='utf-8') as file:
    file.write('#include "base/opencl.h"\n')
    # Several literals: C17 promises only 4095 characters in one, and an array initialiser has no such limit.
    file.write('static const char *const lines[] = {\n')
    file.write(''.join(f'    {line},\n' for line in text))
    file.write('};\n')
    file.write(f'const struct opencl_source {symbol} = {{"{name}", lines, sizeof lines / sizeof lines[0]}};\n')
with open(depfile, 'w', encoding='utf-8') as file:
    file.write(f'{output}: {" ".join(used)}\n')
