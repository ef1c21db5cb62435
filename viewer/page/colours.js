// Colours of the style sheet, for drawing.

const SERIES = 6;
const DASHES = [[], [6, 3], [2, 3], [8, 3, 2, 3]];

/** A colour by its name in the style sheet. */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** Colour and dash of a line, by its number: four times as many lines as colours can be told apart. */
export function line(number) {
  return { colour: colour(`series-${number % SERIES}`), dash: DASHES[Math.floor(number / SERIES) % DASHES.length] };
}

/** Calls `redraw` when the system changes between light and dark. */
export function onSchemeChange(redraw, signal) {
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw, { signal });
}
