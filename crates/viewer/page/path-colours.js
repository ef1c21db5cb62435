// Colours of the flown paths, by weather, side of the split, or error, with a legend.

import { colour, line, stroke } from './colours.js';
import { element } from './dom.js';
import { fixed } from './units.js';

const SIDES = ['train', 'validation', 'test'];
const SIDE_LINES = { train: 0, validation: 2, test: 4 };
/** Classes of errors, from the smallest to the largest. */
const STEPS = 4;

/** Options of the choice of colours. */
export const colourings = hasErrors => [['weather', 'weather'], ['side', 'side'], ...hasErrors ? [['error', 'error']] : []];

/** The classes of some rows: { name, style: { colour, dash }, has(row) }, those that have a row. `all` are the rows of the corpus. */
export function classes(by, rows, all) {
  const made = by === 'error' ? errorClasses(rows) : by === 'side' ? sideClasses() : weatherClasses(all);
  const rest = { name: by === 'error' ? 'no error known' : `no ${by}`, style: () => ({ colour: colour('edge'), dash: [] }),
    has: row => !made.some(one => one.has(row)) };
  return [...made, rest].filter(one => rows.some(one.has));
}

/** A weather keeps its colour whatever is filtered. */
function weatherClasses(all) {
  const names = [...new Set(all.map(row => row.weather).filter(Boolean))].sort();
  return names.map((name, number) => ({ name, style: () => line(number), has: row => row.weather === name }));
}

const sideClasses = () => SIDES.map(name => ({ name, style: () => line(SIDE_LINES[name]), has: row => row.side === name }));

/** As many rows in each class, by their mean errors. */
function errorClasses(rows) {
  const errors = rows.map(row => row.mape_pct).filter(Number.isFinite).sort((one, other) => one - other);
  const ends = Array.from({ length: STEPS }, (_, step) => errors[Math.ceil((step + 1) * errors.length / STEPS) - 1]);
  return ends.map((end, step) => {
    const from = step ? ends[step - 1] : -Infinity;
    return { name: `${step ? fixed(from, 3) : 'up'} to ${fixed(end, 3)} %`, style: () => ({ colour: colour(`step-${step}`), dash: [] }),
      has: row => row.mape_pct > from && row.mape_pct <= end };
  });
}

/** The entries of a legend of some classes. */
export function legend(shown) {
  return shown.map(({ name, style }) => element('li', {}, stroke(style()), name));
}
