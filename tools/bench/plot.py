#!/usr/bin/env python3
# SPDX-License-Identifier: MIT OR Apache-2.0
"""Curves as SVG, for the documents that tools here write."""

import math

COLOURS = ["#c0392b", "#2c6fbb", "#2e8b57", "#8e6bbf"]


def plot(path, title, x_name, y_name, curves, log=(False, False), legend_top=40):
    """Curves (name, xs, ys) as an SVG with axes, ticks and a legend; `log` selects the logarithmic axes.

    `legend_top` is the legend's distance from the top, of 400: a place without curves."""
    wide, high, left, right, top, bottom = 720, 400, 70, 20, 40, 50
    spans, marks = [], []
    for axis in (0, 1):
        values = [v for curve in curves for v in curve[1 + axis]]
        low, upper = min(values), max(values)
        if log[axis] and axis == 1:
            low, upper = 10 ** math.floor(math.log10(low)), 10 ** math.ceil(math.log10(upper))
            marks.append([10**e for e in range(round(math.log10(low)), round(math.log10(upper)) + 1)])
        elif log[axis]:
            marks.append(sorted(set(values)))
        else:
            low = 0 if axis == 1 else low
            step = 10 ** math.floor(math.log10((upper - low) / 4))
            step *= max(m for m in (1, 2, 5) if m * step <= (upper - low) / 3)
            upper = math.ceil(upper / step - 1e-9) * step
            marks.append([i * step for i in range(math.ceil(low / step - 1e-9), round(upper / step) + 1)])
        spans.append((low, upper))

    def place(axis, value):
        low, upper = spans[axis]
        part = math.log(value / low) / math.log(upper / low) if log[axis] else (value - low) / (upper - low)
        return left + part * (wide - left - right) if axis == 0 else high - bottom - part * (high - top - bottom)

    svg = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide} {high}" font-family="sans-serif" font-size="13">',
        f'<rect width="{wide}" height="{high}" fill="white"/>',
        f'<text x="{left}" y="22" font-size="15">{title}</text>',
    ]
    for value in marks[0]:
        x = place(0, value)
        svg.append(f'<path d="M{x:.1f} {top}V{high - bottom}" stroke="#eee"/>')
        svg.append(f'<text x="{x:.1f}" y="{high - bottom + 18}" text-anchor="middle">{value:.4g}</text>')
    for value in marks[1]:
        y = place(1, value)
        svg.append(f'<path d="M{left} {y:.1f}H{wide - right}" stroke="#eee"/>')
        svg.append(f'<text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">{value:.4g}</text>')
    svg.append(f'<path d="M{left} {top}V{high - bottom}H{wide - right}" fill="none" stroke="#333"/>')
    svg.append(f'<text x="{(left + wide - right) / 2}" y="{high - 12}" text-anchor="middle">{x_name}</text>')
    svg.append(f'<text x="16" y="{high / 2}" text-anchor="middle" transform="rotate(-90 16 {high / 2})">{y_name}</text>')
    for i, (name, xs, ys) in enumerate(curves):
        points = " ".join(f"{place(0, x):.1f},{place(1, y):.1f}" for x, y in zip(xs, ys))
        svg.append(f'<polyline points="{points}" fill="none" stroke="{COLOURS[i]}" stroke-width="2"/>')
        y = legend_top + 14 + 18 * i
        svg.append(f'<path d="M{wide - 290} {y - 4}h24" stroke="{COLOURS[i]}" stroke-width="2"/>')
        svg.append(f'<text x="{wide - 260}" y="{y}">{name}</text>')
    path.write_text("\n".join(svg + ["</svg>", ""]))
