// One view: its picture, magnified or whole, with what the tables say drawn over it.

import { element } from './dom.js';
import { fixed } from './units.js';

/** Screen pixels for each pixel of the picture; null is the whole picture. */
export const ZOOMS = [null, 1, 2, 4, 8, 16, 32];
/** Part of the inset's width that the aircraft may fill. */
const FILLED = 0.6;
/** Width of the inset in parts of the picture's, as in the style sheet, and its height in parts of its width. */
const INSET = { width: 0.34, height: 2 / 3 };
/** Pixels around a magnified part that are there when it is dragged. */
const MARGIN_PX = 24;
/** Colours over pictures, which are neither light nor dark, and the parts of a frame: those of equal boxes do not cover each other. */
export const MARKS = {
  truth: { colour: '#39ff5a', part: 'corners' },
  other: { colour: 'rgba(57, 255, 90, .6)', part: 'box' },
  detection: { colour: '#ffb000', part: 'sides' },
  unconfirmed: { colour: '#c8c8c8', part: 'sides' },
  shift: { colour: '#3fd0ff' },
};
/** Screen pixels between a box and its frame, which would cover a small aircraft, and between two marks. */
const GAP = 4;
/** Least width and height of a frame, screen pixels. */
const LEAST_FRAME = 22;
/** Parts of a frame's side that a corner and a side have. */
const CORNER = 0.25, SIDE = 0.3;
/** Longest arm of a corner and of a cross, screen pixels. */
const LONGEST_ARM = 14;
/** Farthest from its point that an arm of a cross begins, screen pixels. */
const MOST_CLEAR = 40;

/** A view of the player. `view` has id, width_px and height_px. */
export class Picture {
  constructor(view, { onzoom, ondrag, onneed }) {
    this.view = view;
    /** A picture from the server, or a video that plays; null with a message. */
    this.image = null;
    this.message = '';
    /** Boxes { kind, cx, cy, width, height, label } and points { kind, x, y }, in pixels of the picture; (0, 0) is the centre of a pixel. */
    this.marks = [];
    /** Where the aircraft is, or is thought to be. */
    this.target = null;
    this.zoom = null;
    /** Where the middle of a magnified picture is; null follows the aircraft. */
    this.centre = null;
    this.hasInset = true;
    this.canvas = element('canvas', { class: 'picture', role: 'img', 'aria-label': `Image of view ${view.id}` });
    this.inset = element('canvas', { class: 'inset', 'aria-hidden': 'true' });
    this.said = element('span', { class: 'said' });
    this.frame = element('div', { class: 'frame' }, this.canvas, this.inset);
    this.element = element('figure', { class: 'view' }, this.frame,
      element('figcaption', {}, element('strong', {}, view.id), ' ', this.said));
    this.canvas.style.aspectRatio = `${view.width_px || 3} / ${view.height_px || 2}`;
    this.sizes = new Map();
    this.canvas.addEventListener('wheel', event => {
      event.preventDefault();
      onzoom(event.deltaY < 0 ? 1 : -1);
    }, { passive: false });
    this.canvas.addEventListener('pointerdown', event => this.beginDrag(event, ondrag, onneed));
    const resized = new ResizeObserver(entries => {
      // Asking the canvas for its size would lay out the page again at every tick.
      for (const { target, contentRect } of entries) this.sizes.set(target, contentRect);
      this.draw();
      onneed();
    });
    for (const canvas of [this.canvas, this.inset]) resized.observe(canvas);
  }

  /** What is visible of a picture in which the aircraft is at `target`: one of `every` columns, and a part { x, y, width, height } of it. */
  need(target) {
    const { width, height } = this.sizes.get(this.canvas) ?? { width: this.canvas.clientWidth, height: this.canvas.clientHeight };
    if (!width || !height) return { every: 1, part: null };
    const inset = { width: width * INSET.width, height: width * INSET.width * INSET.height };
    const isWhole = this.zoom === null;
    const small = (isWhole ? width : inset.width) * (devicePixelRatio || 1);
    const every = Math.max(1, Math.min(16, Math.floor(this.view.width_px / small)));
    if (isWhole && !(target && this.hasInset)) return { every, part: null };
    const magnified = isWhole ? { ...inset, scale: closest(inset.width * FILLED / target.width), middle: target }
      : { width, height, scale: this.zoom, middle: this.centre ?? target ?? this.middle() };
    // Colours belong to two by two pixels.
    const even = value => 2 * Math.floor(value / 2);
    const stretch = (middle, length, side) => {
      const from = Math.max(0, even(middle - length / 2 - MARGIN_PX));
      return [from, Math.min(even(side), even(middle + length / 2 + MARGIN_PX) + 2) - from];
    };
    const [x, columns] = stretch(magnified.middle.x, magnified.width / magnified.scale, this.view.width_px);
    const [y, rows] = stretch(magnified.middle.y, magnified.height / magnified.scale, this.view.height_px);
    return { every, part: columns > 0 && rows > 0 ? [x, y, columns, rows] : null };
  }

  /** Takes a picture, a video, or an error; `draw` shows it. */
  take(found) {
    const isError = found instanceof Error;
    this.image = isError ? null : found;
    this.message = isError ? found.message : '';
    if (this.image === this.video) return;
    this.video?.remove();
    this.video = this.image instanceof HTMLVideoElement ? this.image : undefined;
    // A canvas would convert every picture once more. Whole pictures are shown by the video below it.
    if (this.video) this.frame.prepend(this.video);
  }

  beginDrag(event, ondrag, onneed) {
    if (this.zoom === null) return;
    const [startX, startY] = [event.clientX, event.clientY];
    const from = this.middle();
    const move = event => {
      this.centre = { x: from.x - (event.clientX - startX) / this.zoom, y: from.y - (event.clientY - startY) / this.zoom };
      ondrag();
      this.draw();
    };
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.addEventListener('pointermove', move);
    this.canvas.addEventListener('pointerup', () => {
      this.canvas.removeEventListener('pointermove', move);
      onneed();
    }, { once: true });
  }

  /** The pixel in the middle of the magnified picture. */
  middle() {
    return this.centre ?? this.target ?? { x: (this.view.width_px - 1) / 2, y: (this.view.height_px - 1) / 2 };
  }

  draw() {
    const size = this.context(this.canvas);
    if (!size) return;
    const whole = { x: (this.view.width_px - 1) / 2, y: (this.view.height_px - 1) / 2 };
    const fit = Math.min(size.width / this.view.width_px, size.height / this.view.height_px);
    const main = this.zoom === null ? { scale: fit, middle: whole } : { scale: this.zoom, middle: this.middle() };
    this.canvas.classList.toggle('magnified', this.zoom !== null);
    this.drawOn(size, main, 2, this.marks);
    // A small copy of a whole picture costs as much as a large one: too much while it plays.
    const isUseful = this.hasInset && this.image && (this.zoom === null ? this.target : !this.video);
    this.inset.hidden = !isUseful;
    if (!isUseful) return;
    const isRight = this.zoom === null && this.target.x > this.view.width_px * 0.6 && this.target.y > this.view.height_px * 0.55;
    this.inset.classList.toggle('other-side', isRight);
    const inset = this.context(this.inset);
    if (!inset) return;
    if (this.zoom === null) {
      this.drawOn(inset, { scale: closest(inset.width * FILLED / this.target.width), middle: this.target }, 2, this.marks);
      return;
    }
    const small = Math.min(inset.width / this.view.width_px, inset.height / this.view.height_px);
    this.drawOn(inset, { scale: small, middle: whole }, 1, []);
    const { context } = inset;
    const [width, height] = [size.width / this.zoom * small, size.height / this.zoom * small];
    const [x, y] = place(inset, { scale: small, middle: whole }, this.middle());
    context.strokeStyle = '#fff';
    context.lineWidth = 1;
    context.strokeRect(x - width / 2, y - height / 2, width, height);
  }

  /** A canvas as large as its place on the screen, with a context in CSS pixels; null if it has no place. */
  context(canvas) {
    const { width, height } = this.sizes.get(canvas) ?? { width: 0, height: 0 };
    if (!width || !height) return null;
    const ratio = devicePixelRatio || 1;
    const [columns, rows] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== columns) canvas.width = columns;
    if (canvas.height !== rows) canvas.height = rows;
    const context = canvas.getContext('2d');
    context.setTransform(columns / width, 0, 0, rows / height, 0, 0);
    return { context, width, height };
  }

  drawOn(size, shown, lineWidth, marks) {
    const { context, width, height } = size;
    const { scale } = shown;
    context.clearRect(0, 0, width, height);
    const { width_px, height_px } = this.view;
    if (this.video) {
      // Whole, it is below the canvas.
      if (scale >= 1) drawImage(size, shown, this.video, { x: 0, y: 0, width: width_px, height: height_px, every: 1 });
    } else if (this.image) {
      const { whole, every, part } = this.image;
      drawImage(size, shown, whole, { x: 0, y: 0, width: width_px, height: height_px, every });
      if (part && every * scale > 1) drawImage(size, shown, part.image, { ...part, every: 1 });
    } else {
      context.fillStyle = '#e6edf3';
      context.font = '13px system-ui, sans-serif';
      context.textAlign = 'center';
      wrapped(context, this.message, width - 40).forEach((line, index) => context.fillText(line, width / 2, height / 2 + 18 * index));
    }
    for (const mark of marks) {
      const { colour, part } = MARKS[mark.kind];
      const path = new Path2D();
      const around = frame(size, shown, mark);
      const lines = part ? frameLines(around, part) : crossLines(place(size, shown, mark), frame(size, shown, this.target ?? mark));
      for (const [from, ...points] of lines) {
        path.moveTo(...from);
        for (const point of points) path.lineTo(...point);
      }
      const isThin = part === 'box';
      // A dark line below a bright one is visible on any sky.
      context.strokeStyle = 'rgba(0, 0, 0, .45)';
      context.lineWidth = isThin ? 2 : lineWidth + 1.5;
      context.stroke(path);
      context.strokeStyle = colour;
      context.lineWidth = isThin ? 1 : lineWidth;
      context.stroke(path);
      if (!mark.label) continue;
      const at = [Math.max(around[0], GAP), around[1] - GAP];
      context.fillStyle = colour;
      context.strokeStyle = 'rgba(0, 0, 0, .45)';
      context.lineWidth = 3;
      context.font = '11px system-ui, sans-serif';
      context.textAlign = 'left';
      context.strokeText(mark.label, ...at);
      context.fillText(mark.label, ...at);
    }
  }

  /** Says in words what is drawn. */
  say(words) {
    this.said.textContent = words;
    this.canvas.setAttribute('aria-label', `Image of view ${this.view.id}: ${words}`);
  }
}

/**
 * Draws what is visible of an image that covers { x, y, width, height } of the picture with one column for each `every`. Of a coded image only
 * that is converted, which is most of the work.
 */
function drawImage(size, shown, image, covered) {
  const { context } = size;
  const step = shown.scale * covered.every;
  // Edges of pixels are half a pixel before and after their centres.
  const [left, top] = place(size, shown, { x: covered.x - 0.5, y: covered.y - 0.5 });
  const [x, y] = [left, top].map(edge => Math.max(0, Math.floor(-edge / step)));
  const columns = Math.min(covered.width / covered.every, Math.ceil((size.width - left) / step)) - x;
  const rows = Math.min(covered.height / covered.every, Math.ceil((size.height - top) / step)) - y;
  if (!(columns > 0 && rows > 0)) return;
  context.imageSmoothingEnabled = step < 1 || covered.every > 1;
  context.imageSmoothingQuality = 'medium';
  const at = [left + x * step, top + y * step, columns * step, rows * step];
  if (image instanceof ImageBitmap) {
    context.drawImage(image, x, y, columns, rows, ...at);
    return;
  }
  // Two columns and two rows share their colour.
  const [first, second] = [x - x % 2, y - y % 2];
  const [width, height] = [columns + x - first, rows + y - second].map(side => 2 * Math.ceil(side / 2));
  const part = new VideoFrame(image, { visibleRect: { x: first, y: second, width, height }, displayWidth: width, displayHeight: height });
  context.drawImage(part, x - first, y - second, columns, rows, ...at);
  part.close();
}

/** Where a point of the picture is on a canvas. */
function place({ width, height }, { scale, middle }, { x, y }) {
  return [(x - middle.x) * scale + width / 2, (y - middle.y) * scale + height / 2];
}

/** The frame around a box, or around a point: [left, top, right, bottom] on a canvas. */
function frame(size, shown, { cx, cy, x = cx, y = cy, width = 0, height = 0 }) {
  const [middleX, middleY] = place(size, shown, { x, y });
  const [halfX, halfY] = [width, height].map(side => Math.max(side * shown.scale / 2 + GAP, LEAST_FRAME / 2));
  return [middleX - halfX, middleY - halfY, middleX + halfX, middleY + halfY];
}

/** Lines of the corners of a frame, of the middles of its sides, or all of it. */
function frameLines([left, top, right, bottom], part) {
  if (part === 'box') return [[[left, top], [right, top], [right, bottom], [left, bottom], [left, top]]];
  if (part === 'corners') {
    const [x, y] = [right - left, bottom - top].map(side => Math.min(side * CORNER, LONGEST_ARM));
    return [[left, top, x, y], [right, top, -x, y], [right, bottom, -x, -y], [left, bottom, x, -y]]
      .map(([cornerX, cornerY, armX, armY]) => [[cornerX + armX, cornerY], [cornerX, cornerY], [cornerX, cornerY + armY]]);
  }
  const ends = (from, to) => [from + (to - from) * (1 - SIDE) / 2, to - (to - from) * (1 - SIDE) / 2];
  const [[x, toX], [y, toY]] = [ends(left, right), ends(top, bottom)];
  return [[[x, top], [toX, top]], [[x, bottom], [toX, bottom]], [[left, y], [left, toY]], [[right, y], [right, toY]]];
}

/** Lines of a cross at a point that begin outside of a frame, unless that is much larger than they are. */
function crossLines([x, y], [left, top, right, bottom]) {
  const clear = distance => Math.min(Math.max(distance, 0) + GAP, MOST_CLEAR);
  const arms = [[-clear(x - left), 0], [clear(right - x), 0], [0, -clear(y - top)], [0, clear(bottom - y)]];
  return arms.map(([armX, armY]) => [[x + armX, y + armY],
    [x + armX + Math.sign(armX) * LONGEST_ARM, y + armY + Math.sign(armY) * LONGEST_ARM]]);
}

/** The largest zoom up to a limit. */
function closest(limit) {
  return ZOOMS.findLast(zoom => zoom && zoom <= limit) ?? 1;
}

function wrapped(context, text, width) {
  const lines = [''];
  for (const word of text.split(' ')) {
    const longer = `${lines.at(-1)} ${word}`.trim();
    if (context.measureText(longer).width > width && lines.at(-1)) lines.push(word);
    else lines[lines.length - 1] = longer;
  }
  return lines;
}

/** A box in words. */
export function boxWords({ cx, cy, width, height }) {
  return `${fixed(width, 1)} × ${fixed(height, 1)} px at (${fixed(cx, 1)}, ${fixed(cy, 1)})`;
}
