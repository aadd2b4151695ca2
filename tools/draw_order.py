#!/usr/bin/env python3
"""Draws docs/images/order.svg from what tests/develop/test_effects.c writes: NACRE_ORDER_CSV=order.csv test-develop-effects.
Usage: draw_order.py order.csv order.svg"""
import csv
import sys

rows = [(int(x), int(y), float(a), float(b)) for x, y, a, b in csv.reader(open(sys.argv[1], encoding='utf-8'))]
width = max(r[0] for r in rows) + 1
height = max(r[1] for r in rows) + 1
CELL, LEFT, TOP, GAP, MARK = 14, 10, 40, 40, 70
MEANS = [sum(r[2 + k] for r in rows) / len(rows) for k in range(2)]
rows = [(r[0], r[1], r[2] / MEANS[0], r[3] / MEANS[1]) for r in rows]
SPAN = max(abs(v - 1) for r in rows for v in r[2:])


def colour(ratio):
    """Blue below 1, white at it, red above."""
    part = max(-1.0, min(1.0, (ratio - 1) / SPAN))
    fade = round(255 * (1 - abs(part)))
    return f'#ff{fade:02x}{fade:02x}' if part > 0 else f'#{fade:02x}{fade:02x}ff'


out = []
for k, title in enumerate(('sequential', 'random')):
    x0 = LEFT + k * (width * CELL + MARK + GAP)
    out.append(f'<text x="{x0}" y="{TOP - 12}">order: {title}</text>')
    for r in rows:
        out.append(f'<rect x="{x0 + r[0] * CELL}" y="{TOP + r[1] * CELL}" width="{CELL}" height="{CELL}" '
                   f'fill="{colour(r[2 + k])}"/>')
    middle = x0 + width * CELL + MARK / 2
    means = [sum(r[2 + k] for r in rows if r[1] == y) / width for y in range(height)]
    points = ' '.join(f'{middle + (m - 1) / SPAN * MARK / 2:.1f},{TOP + (y + 0.5) * CELL:.1f}'
                      for y, m in enumerate(means))
    out.append(f'<line x1="{middle}" y1="{TOP}" x2="{middle}" y2="{TOP + height * CELL}" stroke="#999"/>')
    out.append(f'<polyline points="{points}" fill="none" stroke="black" stroke-width="2"/>')
total = LEFT + 2 * (width * CELL + MARK + GAP)
legend = f'blue {-100 * SPAN:.1f} %, white the mean, red +{100 * SPAN:.1f} %; the line is the mean of each row'
body = '\n'.join(out)
high = TOP + height * CELL
with open(sys.argv[2], 'w', encoding='utf-8') as file:
    file.write(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total} {high + 30}" font-family="sans-serif" '
               f'font-size="14">\n<rect width="100%" height="100%" fill="white"/>\n{body}\n'
               f'<text x="{LEFT}" y="{high + 20}" font-size="12">{legend}</text>\n</svg>\n')
