// Charts on canvases: lines over a shared axis, and rows of states, with one cursor.

import { colour } from './colours.js';

const LEFT = 64, RIGHT = 10, TOP = 22, BOTTOM = 24;

/** Round numbers between two ends, about one for each `spacing` of `pixels`. */
function roundSteps([from, to], pixels, spacing) {
  const step = Math.abs(to - from) / Math.max(1, pixels / spacing);
  if (!(step > 0)) return [];
  const power = 10 ** Math.floor(Math.log10(step));
  const round = power * ([1, 2, 5, 10].find(factor => factor * power >= step) ?? 10);
  const [low, high] = [Math.min(from, to), Math.max(from, to)];
  const steps = [];
  for (let value = Math.ceil(low / round - 1e-9) * round; value <= high + round * 1e-9; value += round) steps.push(value);
  return steps.map(value => [value, value.toFixed(Math.max(0, -Math.floor(Math.log10(round) + 1e-9))).replace('-', '−')]);
}

/** What covers all values of some lines, with some room. */
export function range(values, room = 0.06) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value === null || !Number.isFinite(value)) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  if (low > high) return [0, 1];
  const margin = (high - low || Math.abs(high) || 1) * room;
  return [low - margin, high + margin];
}

/** The canvas of a chart, as large as its place and as sharp as the screen. */
class Plot {
  constructor({ title, label, height, bottom = true }) {
    this.canvas = document.createElement('canvas');
    /** Everything but the cursor, which moves more often than the rest changes. */
    this.still = document.createElement('canvas');
    this.canvas.className = 'plot';
    this.canvas.style.height = `${height}px`;
    this.canvas.setAttribute('role', 'img');
    this.canvas.setAttribute('aria-label', label ?? title);
    this.title = title;
    this.bottom = bottom ? BOTTOM : 6;
    this.x = [0, 1];
    this.cursor = null;
    this.onpoint = null;
    this.onpick = null;
    this.canvas.addEventListener('pointermove', event => this.onpoint?.(this.valueAt(event), event));
    this.canvas.addEventListener('pointerdown', event => this.onpick?.(this.valueAt(event), event));
    this.size = { width: 0, height: 0 };
    new ResizeObserver(([{ contentRect }]) => {
      // Asking the canvas for its size would lay out the page again at every tick.
      this.size = { width: Math.round(contentRect.width), height: Math.round(contentRect.height) };
      this.draw();
    }).observe(this.canvas);
  }

  get box() {
    const { width, height } = this.size;
    return { left: LEFT, top: TOP, right: width - RIGHT, bottom: height - this.bottom };
  }

  screenX(value) {
    const { left, right } = this.box;
    return left + (value - this.x[0]) / (this.x[1] - this.x[0]) * (right - left);
  }

  valueAt(event) {
    const { left, right } = this.box;
    return this.x[0] + (event.offsetX - left) / (right - left) * (this.x[1] - this.x[0]);
  }

  /** A cleared context of one of the two canvases, in CSS pixels. */
  begin(canvas) {
    const { width, height } = this.size;
    const ratio = devicePixelRatio || 1;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    const context = canvas.getContext('2d');
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = '12px system-ui, sans-serif';
    return context;
  }

  /** Draws everything. */
  draw() {
    if (this.size.width <= LEFT + RIGHT) return;
    this.paint(this.begin(this.still));
    this.point();
  }

  /** Moves the cursor, over a range of x. */
  moveTo(cursor, x) {
    this.cursor = cursor;
    const isSame = x[0] === this.x[0] && x[1] === this.x[1];
    this.x = x;
    if (isSame) this.point();
    else this.draw();
  }

  /** Draws the cursor over everything else. */
  point() {
    const { width, height } = this.size;
    if (!this.still.width || !width) return;
    const context = this.begin(this.canvas);
    context.drawImage(this.still, 0, 0, width, height);
    this.drawCursor(context);
  }

  drawXAxis(context) {
    const { left, top, right, bottom } = this.box;
    context.fillStyle = colour('quiet');
    context.strokeStyle = colour('line');
    context.lineWidth = 1;
    context.textAlign = 'center';
    context.textBaseline = 'top';
    for (const [value, text] of roundSteps(this.x, right - left, 90)) {
      const x = Math.round(this.screenX(value)) + 0.5;
      stroke(context, [[x, top], [x, bottom]]);
      if (this.bottom === BOTTOM) context.fillText(text, x, bottom + 6);
    }
  }

  drawTitle(context, text) {
    context.fillStyle = colour('ink');
    context.textAlign = 'left';
    context.textBaseline = 'top';
    context.font = '600 12px system-ui, sans-serif';
    context.fillText(text, LEFT, 4);
  }

  drawCursor(context) {
    if (this.cursor === null) return;
    const { top, bottom } = this.box;
    const x = this.screenX(this.cursor);
    context.strokeStyle = colour('ink');
    context.setLineDash([]);
    context.lineWidth = 1;
    stroke(context, [[x, top], [x, bottom]]);
  }
}

function stroke(context, points) {
  context.beginPath();
  points.forEach(([x, y], index) => index ? context.lineTo(x, y) : context.moveTo(x, y));
  context.stroke();
}

/** Lines over x. A line is { x, y, colour, dash, width }; y may have gaps (null). Marks are points { x, y, colour }. */
export class LineChart extends Plot {
  constructor(options) {
    super(options);
    this.unit = options.unit;
    this.lines = [];
    this.marks = [];
    this.y = [0, 1];
  }

  screenY(value) {
    const { top, bottom } = this.box;
    return bottom - (value - this.y[0]) / (this.y[1] - this.y[0]) * (bottom - top);
  }

  paint(context) {
    const { left, top, right, bottom } = this.box;
    this.drawXAxis(context);
    context.textAlign = 'right';
    context.textBaseline = 'middle';
    for (const [value, text] of roundSteps(this.y, bottom - top, 26)) {
      const y = Math.round(this.screenY(value)) + 0.5;
      context.strokeStyle = colour(value === 0 ? 'edge' : 'line');
      stroke(context, [[left, y], [right, y]]);
      context.fillText(text, left - 6, y);
    }
    context.save();
    context.beginPath();
    context.rect(left, top, right - left, bottom - top);
    context.clip();
    for (const line of this.lines) this.drawLine(context, line);
    context.restore();
    context.setLineDash([]);
    this.drawTitle(context, this.unit ? `${this.title}, ${this.unit}` : this.title);
  }

  drawCursor(context) {
    super.drawCursor(context);
    for (const mark of this.marks) {
      context.fillStyle = mark.colour;
      context.beginPath();
      context.arc(this.screenX(mark.x), this.screenY(mark.y), 4.5, 0, 7);
      context.fill();
      context.strokeStyle = colour('paper');
      context.lineWidth = 1.5;
      context.stroke();
    }
  }

  drawLine(context, { x, y, colour, dash = [], width = 1.5 }) {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.setLineDash(dash);
    context.beginPath();
    // A screen has fewer columns than a flight has ticks: of each, the first, lowest, highest and last points are enough.
    let [column, low, high, last, open] = [null, 0, 0, 0, false];
    const flush = () => {
      if (column === null) return;
      context.lineTo(column, low);
      context.lineTo(column, high);
      context.lineTo(column, last);
      column = null;
    };
    for (let index = 0; index < x.length; index++) {
      if (y[index] === null || y[index] === undefined) {
        flush();
        open = false;
        continue;
      }
      const [at, value] = [this.screenX(x[index]), this.screenY(y[index])];
      if (!open) {
        context.moveTo(at, value);
        // A point between two gaps is visible, too.
        if (y[index + 1] === null || index + 1 === x.length) context.lineTo(at + 1, value);
        open = true;
      } else if (column !== null && Math.abs(at - column) < 0.5) {
        low = Math.min(low, value);
        high = Math.max(high, value);
        last = value;
      } else {
        flush();
        context.lineTo(at, value);
        [column, low, high, last] = [at, value, value, value];
      }
    }
    flush();
    context.stroke();
  }
}

/** Rows of coloured cells over x: a row is { name, cells: [{ from, to, colour }] }. */
export class RowChart extends Plot {
  constructor(options) {
    super(options);
    this.rows = [];
  }

  paint(context) {
    const { left, top, right, bottom } = this.box;
    this.drawXAxis(context);
    const height = (bottom - top) / Math.max(1, this.rows.length);
    this.rows.forEach(({ name, cells }, index) => {
      const y = top + index * height;
      for (const { from, to, colour } of cells) {
        const [a, b] = [this.screenX(from), this.screenX(to)].sort((one, other) => one - other);
        if (b < left || a > right) continue;
        context.fillStyle = colour;
        const start = Math.max(left, a);
        context.fillRect(start, y + 2, Math.max(0.75, Math.min(right, b) - start), height - 4);
      }
      context.fillStyle = colour('quiet');
      context.textAlign = 'right';
      context.textBaseline = 'middle';
      context.fillText(shortened(name), left - 6, y + height / 2);
    });
    this.drawTitle(context, this.title);
  }
}

const shortened = name => name.length > 9 ? `${name.slice(0, 8)}…` : name;
