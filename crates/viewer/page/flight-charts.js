// The charts below the images: distance, errors, speeds and boxes found over the flight, with one cursor.

import { LineChart, RowChart, range } from './chart.js';
import { colour, line } from './colours.js';
import { choice, element } from './dom.js';
import { note } from './link.js';
import { METRES_PER_NM } from './units.js';

const WINDOWS_S = [['', 'whole flight'], ['300', '5 min'], ['60', '1 min'], ['10', '10 s']];
/** States of the boxes of a view: what the cell means, and its colour. */
const CELLS = [
  ['found', 'found', 'series-1'], ['unconfirmed', 'found, but of no confirmed track', 'series-3'],
  ['missed', 'missed, though most of it is in the image', 'bad'], ['away', 'not in the image, or not searched', 'line'],
];
/** Errors far out would flatten all others. */
const SHOWN_SHARE = 0.985;

/** The charts of a flight. `ongo` is told the tick that is pointed at. */
export class FlightCharts {
  constructor({ flight, asked, ongo }) {
    this.flight = flight;
    this.tick = 0;
    const hasLabels = Boolean(flight.columns?.dtd_m);
    this.axis = asked.axis === 'dtd' && hasLabels ? 'dtd' : 'time';
    this.window_s = WINDOWS_S.some(([value]) => value === asked.window) ? asked.window : '';
    this.distance = new LineChart({ title: 'Distance to touchdown', unit: 'NM', height: 130, bottom: false });
    this.error = new LineChart({ title: 'Error: predicted − true', unit: '% of the distance', height: 150, bottom: false });
    this.speeds = new LineChart({ title: 'Ground speed, and true airspeed (dashed)', unit: 'm/s', height: 100, bottom: false });
    this.found = new RowChart({ title: 'Boxes found', height: 48 + 22 * flight.views.length });
    this.all = !flight.columns ? [] : [this.distance, ...flight.lines.length && hasLabels ? [this.error] : [], this.speeds, this.found];
    for (const chart of this.all) {
      chart.onpick = chart.onpoint = (x, event) => {
        if (event.buttons & 1) ongo(this.tickAt(x));
      };
    }
    this.axisName = element('p', { class: 'axis' });
    const axes = [['time', 'time'], ...hasLabels ? [['dtd', 'distance to touchdown']] : []];
    this.element = element('section', { class: 'charts', 'aria-label': 'Charts' },
      element('div', { class: 'layers' },
        choice('Over', axes, this.axis, axis => {
          this.axis = axis;
          note({ axis: axis === 'time' ? undefined : axis });
          this.draw();
        }),
        choice('Show', WINDOWS_S, this.window_s, window_s => {
          this.window_s = window_s;
          note({ window: window_s });
          this.moveTo(this.tick);
        }),
        element('span', { class: 'note' }, 'Click or drag in a chart to go to a tick.')),
      this.all.map(chart => chart.canvas), this.axisName,
      element('ul', { class: 'legend', 'aria-label': 'Boxes found' }, CELLS.map(([kind, words]) =>
        element('li', {}, element('span', { class: `swatch ${kind}` }), words))));
  }

  get xs() {
    return this.axis === 'time' ? this.flight.columns.time_s : this.flight.distances;
  }

  tickAt(x) {
    const { xs } = this;
    let best = 0;
    for (let tick = 1; tick < xs.length; tick++) if (Math.abs(xs[tick] - x) < Math.abs(xs[best] - x)) best = tick;
    return best;
  }

  draw() {
    const { flight, xs } = this.all.length ? this : { flight: null };
    if (!flight) return;
    const { columns } = flight;
    const nm = values => values.map(value => value === null ? null : value / METRES_PER_NM);
    const visible = flight.lines.filter(one => one.isShown);
    this.distance.lines = [
      ...columns.dtd_m ? [{ x: xs, y: nm(columns.dtd_m), colour: colour('ink'), width: 2 }] : [],
      ...visible.map(one => ({ x: xs, y: nm(one.dtd), ...line(one.number) })),
    ];
    this.distance.title = columns.dtd_m ? 'Distance to touchdown: true (bold) and predicted' : 'Distance to touchdown: no labels yet';
    this.error.lines = visible.map(one => ({ x: xs, y: one.error, ...line(one.number) }));
    this.speeds.lines = [
      { x: xs, y: columns.ground_speed_mps, colour: colour('series-0') },
      { x: xs, y: columns.true_airspeed_mps, colour: colour('series-4'), dash: [5, 3] },
    ];
    this.found.rows = flight.views.map(view => ({ name: view.id, cells: this.cells(view) }));
    this.distance.y = range(this.distance.lines.flatMap(one => one.y));
    this.error.y = mostOf(this.error.lines.flatMap(one => one.y));
    this.speeds.y = range(this.speeds.lines.flatMap(one => one.y));
    this.axisName.textContent = this.axis === 'time' ? 'time since the first tick, s' : 'distance to touchdown, NM; negative past it';
    this.moveTo(this.tick);
    for (const chart of this.all) chart.draw();
  }

  /** Runs of ticks with the same state of a view's boxes. */
  cells(view) {
    const colours = Object.fromEntries(CELLS.map(([kind, , name]) => [kind, colour(name)]));
    const { flight, xs } = this;
    const cells = [];
    let from = 0;
    let state = flight.outcome(view, 0);
    for (let tick = 1; tick <= flight.ticks; tick++) {
      const next = tick < flight.ticks ? flight.outcome(view, tick) : null;
      if (next === state) continue;
      const end = tick < flight.ticks ? xs[tick] : xs[tick - 1] + (xs[tick - 1] - (xs[tick - 2] ?? xs[tick - 1]));
      cells.push({ from: xs[from], to: end, colour: colours[state] });
      [from, state] = [tick, next];
    }
    return cells;
  }

  /** Moves the cursor. */
  moveTo(tick) {
    this.tick = tick;
    if (!this.all.length) return;
    const { xs, flight } = this;
    const ends = [xs[0], xs.at(-1)];
    let shown = ends[0] === ends[1] ? [ends[0] - 1, ends[0] + 1] : ends;
    if (this.window_s) {
      const half = Math.round(Number(this.window_s) / 2 * flight.rate.numerator / flight.rate.denominator);
      const [first, last] = [Math.max(0, tick - half), Math.min(flight.ticks - 1, tick + half)];
      if (last > first) shown = [xs[first], xs[last]];
    }
    for (const chart of this.all) chart.moveTo(xs[tick], shown);
  }
}

/** A range around 0 that holds most values. */
function mostOf(values) {
  const sizes = values.filter(value => value !== null).map(Math.abs).sort((one, other) => one - other);
  if (!sizes.length) return [-1, 1];
  const size = Math.max(0.1, sizes[Math.floor((sizes.length - 1) * SHOWN_SHARE)] * 1.25);
  return [-size, size];
}
