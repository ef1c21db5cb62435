// Colours of the style sheet, for drawing.

const SERIES = 6;
const DASHES = [[], [6, 3], [2, 3], [8, 3, 2, 3]];

const dark = matchMedia('(prefers-color-scheme: dark)');
// Asking for a style makes the browser compute all that changed: too often for charts that move with a video.
const known = new Map();
dark.addEventListener('change', () => known.clear());

/** A colour by its name in the style sheet. */
export function colour(name) {
  if (!known.has(name)) known.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return known.get(name);
}

/** Colour and dash of a line, by its number: four times as many lines as colours can be told apart. */
export function line(number) {
  return { colour: colour(`series-${number % SERIES}`), dash: DASHES[Math.floor(number / SERIES) % DASHES.length] };
}

/** A stroke of a line, for legends. */
export function stroke(style) {
  const canvas = document.createElement('canvas');
  canvas.className = 'stroke';
  drawStroke(canvas, style);
  return canvas;
}

/** Draws it again, for example after the system changed between light and dark. */
export function drawStroke(canvas, { colour, dash }) {
  Object.assign(canvas, { width: 28, height: 10 });
  const context = canvas.getContext('2d');
  context.strokeStyle = colour;
  context.lineWidth = 3;
  context.setLineDash(dash);
  context.beginPath();
  context.moveTo(0, 5);
  context.lineTo(28, 5);
  context.stroke();
}

/** Calls `redraw` when the system changes between light and dark. */
export function onSchemeChange(redraw, signal) {
  dark.addEventListener('change', redraw, { signal });
}
